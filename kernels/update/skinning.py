"""Surfaces that lie beside vertices, along their normals: the sides of cloth that has a thickness, and skins."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())


@wp.struct
class SkinWeights:
    """Weights of a skin: each vertex is attached to some bodies."""

    starts: wp.array(dtype=wp.int32)  # (vertex + 1,) first of a vertex's bonds
    bodies: wp.array(dtype=wp.int32)  # (bond,)
    places: wp.array(dtype=wp.vec4)  # (bond,) the vertex in the body's frame [m]; w: the bond's weight


@wp.struct
class OffsetSurface:
    """Faces between vertices, and how far beside the vertices it lies."""

    faces: wp.array(dtype=wp.vec3i)  # (face,) those that make normals
    starts: wp.array(dtype=wp.int32)  # (vertex + 1,) first of a vertex's faces in `around`
    around: wp.array(dtype=wp.int32)  # (entry,) faces
    offset: wp.float32  # along the normal [m]
    by_area: wp.int32  # whether a large face counts more for the normal of a vertex than a small one
    first_vertex: wp.int32  # in the array of all
    first_point: wp.int32  # likewise
    both: wp.int32  # whether the other side, as many points, follows on the first


@wp.kernel(enable_backward=False)
def pose_vertices(
    bones: SkinWeights,
    positions: wp.array2d(dtype=wp.vec3),
    rotations: wp.array2d(dtype=wp.mat33),
    vertices: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """(world, vertex) from where bodies are."""
    world, vertex = row_and_column(first + wp.tid(), vertices.shape[1])
    place = wp.vec3(0.0, 0.0, 0.0)
    for bond in range(bones.starts[vertex], bones.starts[vertex + 1]):
        body = bones.bodies[bond]
        at = bones.places[bond]
        place += at[3] * (positions[world, body] + rotations[world, body] * wp.vec3(at[0], at[1], at[2]))
    vertices[world, vertex] = place


@wp.func
def _normal(surface: OffsetSurface, vertices: wp.array2d(dtype=wp.vec3), world: wp.int32, number: wp.int32) -> wp.vec3:
    """Return a face's contribution to the normals of its vertices."""
    face = surface.faces[number]
    a = vertices[world, surface.first_vertex + face[0]]
    b = vertices[world, surface.first_vertex + face[1]]
    c = vertices[world, surface.first_vertex + face[2]]
    normal = wp.cross(b - a, c - a)
    if surface.by_area == 0:
        normal = wp.normalize(normal)
    return normal


@wp.func
def _write_offset(
    surface: OffsetSurface,
    vertices: wp.array2d(dtype=wp.vec3),
    points: wp.array2d(dtype=wp.vec3),
    normals: wp.array2d(dtype=wp.vec3),
    world: wp.int32,
    vertex: wp.int32,
    sum: wp.vec3,
):
    """A vertex's points and normals, from the sum of its faces' normals."""
    normal = wp.normalize(sum)
    place = vertices[world, surface.first_vertex + vertex]
    at = surface.first_point + vertex
    points[world, at] = place + surface.offset * normal
    normals[world, at] = normal
    if surface.both != 0:
        width = surface.starts.shape[0] - 1
        points[world, at + width] = place - surface.offset * normal
        normals[world, at + width] = -normal


@wp.kernel(enable_backward=False)
def offset_vertices(
    surface: OffsetSurface,
    vertices: wp.array2d(dtype=wp.vec3),
    points: wp.array2d(dtype=wp.vec3),
    normals: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """A vertex for each index."""
    world, vertex = row_and_column(first + wp.tid(), surface.starts.shape[0] - 1)
    sum = wp.vec3(0.0, 0.0, 0.0)
    for entry in range(surface.starts[vertex], surface.starts[vertex + 1]):
        sum += _normal(surface, vertices, world, surface.around[entry])
    _write_offset(surface, vertices, points, normals, world, vertex, sum)


@wp.kernel(enable_backward=False)
def offset_vertices_by_world(
    surface: OffsetSurface,
    vertices: wp.array2d(dtype=wp.vec3),
    points: wp.array2d(dtype=wp.vec3),
    normals: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Offset vertices with a world for each index: a face's normal is computed once, not for each of its vertices."""
    world = first + wp.tid()
    width = surface.starts.shape[0] - 1
    begin = surface.first_point
    for vertex in range(width):
        normals[world, begin + vertex] = wp.vec3(0.0, 0.0, 0.0)
    for number in range(surface.faces.shape[0]):
        normal = _normal(surface, vertices, world, number)
        face = surface.faces[number]
        for k in range(3):
            normals[world, begin + face[k]] += normal
    for vertex in range(width):
        _write_offset(surface, vertices, points, normals, world, vertex, normals[world, begin + vertex])


@dataclass(frozen=True, eq=False)
class Shell:
    """A surface on the host.

    Attributes:
        faces: (face, 3) int32, those that make the vertices' normals, counted from its first vertex.
        num_vertices: Of the surface.
        offset: See ``OffsetSurface``, as for the rest.
        by_area: See there.
        first_vertex: See there.
        first_point: See there.
        both: See there.
    """

    faces: np.ndarray
    num_vertices: int
    offset: float
    by_area: bool
    first_vertex: int
    first_point: int
    both: bool

    def upload(self, device: wp.Device) -> Any:
        surface = OffsetSurface()
        flat = self.faces.reshape(-1)
        order = np.argsort(flat, kind="stable")
        counts = np.bincount(flat, minlength=self.num_vertices)
        surface.faces = wp.array(self.faces.astype(np.int32), dtype=wp.vec3i, device=device)
        surface.starts = wp.array(np.r_[0, np.cumsum(counts)].astype(np.int32), dtype=wp.int32, device=device)
        surface.around = wp.array((order // 3).astype(np.int32), dtype=wp.int32, device=device)
        surface.offset, surface.by_area, surface.both = self.offset, int(self.by_area), int(self.both)
        surface.first_vertex, surface.first_point = self.first_vertex, self.first_point
        return surface


def bind_skin(bones: Any, positions: wp.array, rotations: wp.array, vertices: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that writes ``vertices`` (world, vertex) of skins from the poses of bodies, (world, body)."""
    return bind_launch(pose_vertices, vertices.size, [bones, positions, rotations, vertices], device)


def bind_offset_vertices(
    surface: Any, vertices: wp.array, points: wp.array, normals: wp.array, device: wp.Device
) -> Stage:
    """Bind the stage that writes the points and normals, (world, point), of one surface from (world, vertex)."""
    inputs, worlds = [surface, vertices, points, normals], points.shape[0]
    if not device.is_cuda:
        return bind_launch(offset_vertices_by_world, worlds, inputs, device)
    return bind_launch(offset_vertices, worlds * (surface.starts.shape[0] - 1), inputs, device)


@wp.kernel(enable_backward=False)
def attach_vertices(
    bonds: wp.array2d(dtype=wp.vec4i),
    weights: wp.array2d(dtype=wp.vec4),
    particles: wp.array(dtype=wp.vec3),
    bodies: wp.array(dtype=wp.transform),
    vertices: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """(mesh, vertex): the sum of particles, -1 is none, by weights; or where the first is -1 a place on a body.

    The second is the body then, -1 for the world, and the weights are the place in its frame [m].
    """
    mesh, vertex = row_and_column(first + wp.tid(), vertices.shape[1])
    bond = bonds[mesh, vertex]
    weight = weights[mesh, vertex]
    place = wp.vec3(weight[0], weight[1], weight[2])
    if bond[0] >= 0:
        place = wp.vec3(0.0, 0.0, 0.0)
        for k in range(4):
            if bond[k] >= 0:
                place += weight[k] * particles[bond[k]]
    elif bond[1] >= 0:
        place = wp.transform_point(bodies[bond[1]], place)
    vertices[mesh, vertex] = place


def bind_attached_vertices(
    bonds: wp.array, weights: wp.array, particles: wp.array, bodies: wp.array, vertices: wp.array, device: wp.Device
) -> Stage:
    """Bind the stage that writes ``vertices`` (mesh, vertex): see ``attach_vertices``."""
    return bind_launch(attach_vertices, vertices.size, [bonds, weights, particles, bodies, vertices], device)
