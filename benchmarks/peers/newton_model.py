"""A Newton model built shape by shape from a compiled MuJoCo model.

That gives both the same geometry and colours; Newton's own MJCF reader decides itself which geoms are visible, and
knows no lights.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import newton
import numpy as np
import warp as wp

from warpcam.benchmarks.cases import Cloth
from warpcam.benchmarks.problem import Problem

if TYPE_CHECKING:  # Newton 1.6, of Isaac Lab, has it under another name
    from newton.sensors import SensorCamera

GEOM = mujoco.mjtGeom
SPOTLIGHT, DIRECTIONAL = 0, 1  # Newton's numbers for kinds of lights
# A world with more fixed geoms than this is a room, built once for all worlds: Newton can share what does not move.
ROOM = 256


@dataclass
class Built:
    """The model and what belongs to its shapes.

    Attributes:
        moving: The MuJoCo bodies behind a world's bodies, in order.
        geoms: The geom id of each shape.
        checkered: Indices of shapes without texture coordinates whose material has a texture.
        lacks: What of the textures cannot be shown.
    """

    model: newton.Model
    moving: np.ndarray
    geoms: np.ndarray
    checkered: np.ndarray
    lacks: tuple[str, ...]


def build_model(problem: Problem, fields_as_meshes: bool = False) -> Built:
    """Planes and height fields of the ground are in all worlds at once, as in Newton's own benchmarks.

    Args:
        problem: What is built.
        fields_as_meshes: Height fields are meshes, of MuJoCo's triangles.
    """
    mjm = problem.mjm
    mjd = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, mjd)
    scene, world = newton.ModelBuilder(), newton.ModelBuilder()
    # What Newton's own benchmark of this sensor uses on a GPU.
    scene.default_bvh_cfg.shape_constructor = "sah"
    scene.default_bvh_cfg.mesh_constructor = "cubql" if wp.get_device().is_cuda else None

    drawn = problem.drawn_geoms()
    is_moving = mjm.body_weldid[mjm.geom_bodyid] != 0
    moving = [int(body) for body in np.unique(mjm.geom_bodyid[drawn[is_moving[drawn]]])]
    links = {body: world.add_link(xform=transform(mjd.xpos[body], mjd.xquat[body]), mass=1.0) for body in moving}
    share_all = int((~is_moving[drawn]).sum()) > ROOM
    shapes = Shapes(problem, fields_as_meshes)
    for_all: list[int] = []
    for_each: list[int] = []
    for geom in (int(g) for g in drawn):
        body = int(mjm.geom_bodyid[geom])
        if body in links:
            shapes.add(world, geom, links[body], transform(mjm.geom_pos[geom], mjm.geom_quat[geom]))
            for_each.append(geom)
            continue
        position = mjd.xpos[body] + mjd.xmat[body].reshape(3, 3) @ mjm.geom_pos[geom]
        rotation = np.empty(4)
        mujoco.mju_mulQuat(rotation, mjd.xquat[body], mjm.geom_quat[geom])
        shared = share_all or int(mjm.geom_type[geom]) in (int(GEOM.mjGEOM_PLANE), int(GEOM.mjGEOM_HFIELD))
        shapes.add(scene if shared else world, geom, -1, transform(position, rotation))
        (for_all if shared else for_each).append(geom)
    if problem.case.cloth is not None:
        add_cloth(world, problem.case.cloth)
    scene.replicate(world, problem.worlds)
    model = scene.finalize(skip_all_validations=True)
    geoms = np.concatenate([for_all, np.tile(for_each, problem.worlds)]).astype(np.int64)
    if len(geoms) != model.shape_count:
        raise RuntimeError(f"Newton has {model.shape_count} shapes where {len(geoms)} were given")
    # Newton shows either the textures of meshes or its own checkerboard, which it can project on any shape.
    plain = shapes.textured_primitives if not shapes.textured_meshes else []
    lacks = ("textures of shapes that are not meshes",) if shapes.textured_meshes and shapes.textured_primitives else ()
    if plain:
        lacks = ("the scene's own textures: a checkerboard stands in for them",)
    return Built(model, np.array(moving, dtype=np.int64), geoms, np.flatnonzero(np.isin(geoms, plain)), lacks)


def add_cloth(builder: newton.ModelBuilder, cloth: Cloth) -> None:
    """Add its triangles, without what a solver needs: the particles are moved by a kernel."""
    across, along = cloth.cells
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, across + 1), np.linspace(-0.5, 0.5, along + 1), indexing="ij")
    points = np.stack((cloth.size * x, cloth.size * y, np.full_like(x, cloth.height)), axis=-1).reshape(-1, 3)
    count = len(points)
    first = builder.particle_count
    builder.add_particles(points.tolist(), [(0.0, 0.0, 0.0)] * count, [0.01] * count, radius=[0.01] * count)
    corner = first + (np.arange(across)[:, None] * (along + 1) + np.arange(along)).ravel()
    right, up = corner + along + 1, corner + 1
    i, j, k = np.concatenate(((corner, right, right + 1), (corner, right + 1, up)), axis=1)
    builder.add_triangles(i.tolist(), j.tolist(), k.tolist())


def transform(position: np.ndarray, quaternion: np.ndarray) -> wp.transform:
    """From a position [m] and a quaternion wxyz."""
    w, x, y, z = (float(q) for q in quaternion)
    return wp.transform(wp.vec3(*(float(p) for p in position)), wp.quat(x, y, z, w))


class Shapes:
    """Adds MuJoCo geoms as things to see, without mass or contact; meshes are shared."""

    def __init__(self, problem: Problem, fields_as_meshes: bool) -> None:
        self.mjm, self.colors = problem.mjm, problem.colors()
        self.fields_as_meshes = fields_as_meshes
        self.meshes: dict[tuple[int, int], newton.Mesh] = {}
        self.textured_primitives: list[int] = []
        self.textured_meshes: list[int] = []

    def add(self, builder: newton.ModelBuilder, geom: int, body: int, xform: wp.transform) -> None:
        mjm = self.mjm
        config = newton.ModelBuilder.ShapeConfig(density=0.0, has_shape_collision=False, has_particle_collision=False)
        x, y, z = (float(s) for s in mjm.geom_size[geom])
        color = tuple(float(c) for c in self.colors[geom, :3])
        common: dict[str, Any] = {"xform": xform, "cfg": config, "color": color}
        kind = mjm.geom_type[geom]
        texture = self.texture(geom)
        if texture >= 0:
            (self.textured_meshes if kind == GEOM.mjGEOM_MESH else self.textured_primitives).append(geom)
        if kind == GEOM.mjGEOM_PLANE:
            builder.add_shape_plane(None, width=2.0 * x, length=2.0 * y, body=body, **common)
        elif kind == GEOM.mjGEOM_SPHERE:
            builder.add_shape_sphere(body, radius=x, **common)
        elif kind == GEOM.mjGEOM_CAPSULE:
            builder.add_shape_capsule(body, radius=x, half_height=y, **common)
        elif kind == GEOM.mjGEOM_CYLINDER:
            builder.add_shape_cylinder(body, radius=x, half_height=y, **common)
        elif kind == GEOM.mjGEOM_ELLIPSOID:
            builder.add_shape_ellipsoid(body, rx=x, ry=y, rz=z, **common)
        elif kind == GEOM.mjGEOM_BOX:
            builder.add_shape_box(body, hx=x, hy=y, hz=z, **common)
        elif kind == GEOM.mjGEOM_MESH:
            builder.add_shape_mesh(body, mesh=self.mesh(int(mjm.geom_dataid[geom]), texture), **common)
        elif kind == GEOM.mjGEOM_HFIELD and self.fields_as_meshes:
            builder.add_shape_mesh(body, mesh=self.field_mesh(int(mjm.geom_dataid[geom])), **common)
        elif kind == GEOM.mjGEOM_HFIELD:
            builder.add_shape_heightfield(heightfield=self.heights(int(mjm.geom_dataid[geom])), **common)
        else:
            raise NotImplementedError(f"geom {geom} has type {GEOM(kind).name}, which has no counterpart in Newton")

    def texture(self, geom: int) -> int:
        """The texture of a geom's colour, or -1."""
        material = int(self.mjm.geom_matid[geom])
        return -1 if material < 0 else int(self.mjm.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])

    def mesh(self, asset: int, texture: int) -> newton.Mesh:
        mjm = self.mjm
        if mjm.mesh_texcoordnum[asset] == 0:
            texture = -1
        if (asset, texture) not in self.meshes:
            vertices = slice(mjm.mesh_vertadr[asset], mjm.mesh_vertadr[asset] + mjm.mesh_vertnum[asset])
            faces = slice(mjm.mesh_faceadr[asset], mjm.mesh_faceadr[asset] + mjm.mesh_facenum[asset])
            points, corners = mjm.mesh_vert[vertices], mjm.mesh_face[faces]
            image: dict[str, Any] = {}
            if texture >= 0:  # corners that differ in their texture coordinates become vertices of their own
                own = mjm.mesh_facetexcoord[faces].ravel()
                pairs, index = np.unique(np.stack((corners.ravel(), own), axis=1), axis=0, return_inverse=True)
                start = mjm.mesh_texcoordadr[asset]
                points, corners = points[pairs[:, 0]], index.reshape(-1, 3)
                uvs = mjm.mesh_texcoord[start + pairs[:, 1]] * (1.0, -1.0) + (0.0, 1.0)  # rows from the other end
                image = {"uvs": uvs, "texture": self.pixels(texture)}
            mesh = newton.Mesh(points, corners.ravel().astype(np.int32), compute_inertia=False, **image)
            self.meshes[asset, texture] = mesh
        return self.meshes[asset, texture]

    def pixels(self, texture: int) -> np.ndarray:
        mjm = self.mjm
        shape = (mjm.tex_height[texture], mjm.tex_width[texture], mjm.tex_nchannel[texture])
        start = mjm.tex_adr[texture]
        return np.array(mjm.tex_data[start : start + int(np.prod(shape))].reshape(shape))

    def heights(self, asset: int) -> newton.Heightfield:
        mjm = self.mjm
        rows, columns, start = mjm.hfield_nrow[asset], mjm.hfield_ncol[asset], mjm.hfield_adr[asset]
        hx, hy, top, _ = (float(s) for s in mjm.hfield_size[asset])
        data = mjm.hfield_data[start : start + rows * columns].reshape(rows, columns)
        bounds = {"min_z": top * float(data.min()), "max_z": top * float(data.max())}
        return newton.Heightfield(data, int(rows), int(columns), hx, hy, **bounds)

    def field_mesh(self, asset: int) -> newton.Mesh:
        """The top of a height field: two triangles a cell, whose common edge runs up in x and in y."""
        mjm = self.mjm
        rows, columns, start = mjm.hfield_nrow[asset], mjm.hfield_ncol[asset], mjm.hfield_adr[asset]
        hx, hy, top, _ = (float(s) for s in mjm.hfield_size[asset])
        x, y = np.meshgrid(np.linspace(-hx, hx, columns), np.linspace(-hy, hy, rows))
        points = np.stack((x, y, top * mjm.hfield_data[start : start + rows * columns].reshape(rows, columns)), -1)
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        right, up = corner + 1, corner + columns
        faces = np.concatenate((np.stack((corner, right, up + 1), -1), np.stack((corner, up + 1, up), -1)))
        return newton.Mesh(points.reshape(-1, 3), faces.ravel().astype(np.int32), compute_inertia=False)


def light_scene(sensor: "SensorCamera", problem: Problem) -> tuple[str, ...]:
    """Give the sensor the scene's lights, as they are in the first world; returns what it lacks.

    Its public interface makes one directional light, though its kernels take any number of both kinds. The rest are
    put where that one is kept, so that it traces as many shadow rays as the others; should a later version keep them
    elsewhere, it goes with one light, and the results say so.
    """
    mjm, pose = problem.mjm, problem.poses[0]
    lights = np.flatnonzero(mjm.light_active)
    lacks = ["specular highlights"]
    if mjm.vis.headlight.active:
        sensor.set_ambient_light(tuple(float(c) for c in mjm.vis.headlight.ambient))
        lacks.append("the headlight, but for its ambient part")
    if not len(lights):
        return tuple(lacks)
    if any(np.ptp(pose[name].numpy(), axis=0).max() > 0.0 for name in ("light_xpos", "light_xdir")):
        lacks.append("lights that move with the world")
    directions = pose["light_xdir"].numpy()[0, lights]
    casts = mjm.light_castshadow[lights].astype(bool)
    first = tuple(float(x) for x in directions[0])
    sensor.create_default_light(enable_shadows=bool(casts.any()), direction=first, color=mjm.light_diffuse[lights[0]])
    context = getattr(sensor, "_render_context", None)
    if not hasattr(context, "_lights_orientation"):
        return (*lacks, f"{len(lights) - 1} of {len(lights)} lights")
    directional = mjm.light_type[lights] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    arrays = {
        "active": (np.ones(len(lights), dtype=bool), wp.bool),
        "type": (np.where(directional, DIRECTIONAL, SPOTLIGHT), wp.int32),
        "cast_shadow": (casts, wp.bool),
        "position": (pose["light_xpos"].numpy()[0, lights], wp.vec3f),
        "orientation": (directions, wp.vec3f),
        "color": (mjm.light_diffuse[lights], wp.vec3f),
    }
    for name, (values, dtype) in arrays.items():
        setattr(context, f"_lights_{name}", wp.array(values, dtype=dtype, device=sensor.device))
    return tuple(lacks)
