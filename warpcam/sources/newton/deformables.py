"""Deformables of a Newton model: cloth and the surfaces of soft bodies as moving meshes, and loose particles."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import newton
import numpy as np

from warpcam.accel.meshes import Mesh
from warpcam.core.errors import WarpcamError
from warpcam.sources.newton.deformable_part import DeformablePart
from warpcam.sources.newton.options import NewtonOptions
from warpcam.sources.newton.triangle_colors import differ

MAX_PARTS = 32  # of one world; of more those of one opacity are drawn as one, and if these are more, all
MAX_PARTICLES = 1024  # in one world


@dataclass(frozen=True, eq=False)
class Deformables:
    """All of it.

    Attributes:
        parts: The surfaces.
        num_columns: Soft columns of the table.
        particles: (world, column) int32, loose particles; -1 where a world has none.
    """

    parts: Sequence[DeformablePart]
    num_columns: int
    particles: np.ndarray

    def meshes(self) -> list[Mesh]:
        """Part by part, one for each world that has it."""
        return [part.mesh() for part in self.parts for _ in part.worlds]


def read_deformables(model: newton.Model, covered: np.ndarray, choice: NewtonOptions) -> Deformables:
    """Read the deformables that are simulated and visible.

    Args:
        model: All of it.
        covered: (particle,) bool, on which something hangs that may be seen instead: then surfaces that hang together
            with these are left out.
        choice: What is drawn.
    """
    num_worlds = model.world_count
    nothing = np.full((num_worlds, 0), -1, np.int32)
    if not model.particle_count:
        return Deformables((), 0, nothing)
    worlds = model.particle_world.numpy()
    positions = model.particle_q.numpy()
    bound = np.zeros(model.particle_count, bool)
    parts: list[DeformablePart] = []
    if model.tri_count:
        triangles = model.tri_indices.numpy().reshape(-1, 3)
        if triangles.min() < 0 or triangles.max() >= model.particle_count:
            raise WarpcamError(
                f"model.tri_indices: must be from 0 to {model.particle_count - 1}, got {triangles.min()} to "
                f"{triangles.max()}"
            )
        bound[triangles.reshape(-1)] = True
        elements = [triangles]
        if model.tet_count:
            elements.append(model.tet_indices.numpy().reshape(-1, 4))
            bound[elements[1].reshape(-1)] = True
        numbers = np.arange(len(triangles)) if choice.simulated else np.zeros(0, np.int64)
        if choice.simulated is None:
            numbers = _uncovered(elements, covered)
        if not choice.shared:
            numbers = numbers[worlds[triangles[numbers, 0]] >= 0]
        values, opacities = (
            None if array is None or array.shape[0] != model.tri_count else array.numpy()
            for array in (model.tri_color, model.tri_opacity)
        )
        opacities = np.ones(len(triangles)) if opacities is None else opacities
        parts = _parts(triangles[numbers], numbers, worlds, positions, opacities, choice.backs) if len(numbers) else []
        parts = [replace(part, tinted=differ(values, part.all_triangles)) for part in parts]
    loose = np.flatnonzero(~bound & (choice.shared | (worlds >= 0)) & choice.particles)
    return Deformables(
        parts, 1 + max((part.column for part in parts), default=-1), _particles(loose, worlds, num_worlds)
    )


def _uncovered(elements: list[np.ndarray], covered: np.ndarray) -> np.ndarray:
    """The numbers of triangles, first of the elements, that hang together with nothing that is covered."""
    reached, count = covered.copy(), -1
    while count != reached.sum():
        count = reached.sum()
        for element in elements if count else ():
            reached[element[reached[element].any(axis=1)]] = True
    return np.flatnonzero(~reached[elements[0]].any(axis=1))


def _parts(
    triangles: np.ndarray,
    numbers: np.ndarray,
    worlds: np.ndarray,
    positions: np.ndarray,
    opacities: np.ndarray,
    backs: bool | None,
) -> list[DeformablePart]:
    of_triangle = worlds[triangles[:, 0]]
    order = np.argsort(of_triangle, kind="stable")
    known: dict[bytes, list[DeformablePart]] = {}
    members: dict[bytes, list[np.ndarray]] = {}
    connected: dict[bytes, np.ndarray] = {}
    shared = 0
    for block in np.split(order, np.flatnonzero(np.diff(of_triangle[order])) + 1):
        base, world = int(triangles[block].min()), int(of_triangle[block[0]])
        own = triangles[block] - base
        key = own.tobytes() + (b"all" if world < 0 else b"")
        if key not in connected:
            connected[key] = _components(own)
        labels = connected[key]
        if len(np.unique(labels)) > MAX_PARTS:
            labels = _alike(labels, opacities[numbers[block]])
            key += labels.tobytes()
        if key not in known:
            known[key], members[key] = [], []
            for number, label in enumerate(np.unique(labels)):
                faces = own[labels == label]
                vertices = positions[base : base + int(own.max()) + 1].astype(np.float32)
                both = not is_closed(faces) if backs is None else backs
                known[key].append(
                    DeformablePart(np.ascontiguousarray(faces, np.int32), vertices, shared + number, both)
                )
                members[key].append(np.flatnonzero(labels == label))
            if world < 0:  # what is in all worlds has columns before the worlds' own
                shared = len(known[key])
        for part, own_faces in zip(known[key], members[key], strict=True):
            part.worlds.append(world)
            part.bases.append(base)
            part.all_triangles.append(numbers[block[own_faces]])
            part.triangles.append(int(part.all_triangles[-1][0]))
    return [part for parts in known.values() for part in parts]


def _components(faces: np.ndarray) -> np.ndarray:
    """A number for each face, equal for those that hang together."""
    labels = np.arange(int(faces.max()) + 1)
    while True:
        least = labels[faces].min(axis=1)
        new = labels.copy()
        for corner in range(3):
            np.minimum.at(new, faces[:, corner], least)
        new = new[new]
        if (new == labels).all():
            break
        labels = new
    return labels[faces[:, 0]]


def _alike(labels: np.ndarray, opacities: np.ndarray) -> np.ndarray:
    """A number for each face, equal for those whose surfaces have one opacity; all equal if there are too many."""
    _, first, place = np.unique(labels, return_index=True, return_inverse=True)
    values, groups = np.unique(opacities[first], return_inverse=True)
    return groups[place] if len(values) <= MAX_PARTS else np.zeros(len(labels), np.int64)


def is_closed(faces: np.ndarray) -> bool:
    """Return whether each edge occurs once in each direction."""
    edges = np.concatenate((faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)])).astype(np.int64)
    width = int(faces.max()) + 1
    there, back = edges[:, 0] * width + edges[:, 1], edges[:, 1] * width + edges[:, 0]
    return len(np.unique(there)) == len(there) and np.array_equal(np.sort(there), np.sort(back))


def _particles(loose: np.ndarray, worlds: np.ndarray, num_worlds: int) -> np.ndarray:
    shared = loose[worlds[loose] < 0]
    own = loose[worlds[loose] >= 0]
    own = own[np.argsort(worlds[own], kind="stable")]
    counts = np.bincount(worlds[own], minlength=num_worlds)
    most = int(counts.max()) + len(shared)
    if most > MAX_PARTICLES:
        logging.getLogger("warpcam").warning(
            "from_newton: particles are not drawn: a world has %d, at most %d are", most, MAX_PARTICLES
        )
        return np.full((num_worlds, 0), -1, np.int32)
    table = np.full((num_worlds, most), -1, np.int32)
    table[:, : len(shared)] = shared
    rank = np.arange(len(own)) - np.repeat(np.cumsum(counts) - counts, counts)
    table[worlds[own], len(shared) + rank] = own
    return table
