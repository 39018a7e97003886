"""Newton's SensorCamera. The Newton model is built shape by shape from the compiled MuJoCo model.

That gives both the same geometry; Newton's own MJCF reader decides itself which geoms are visible.
"""

import mujoco
import newton
import numpy as np
import warp as wp
from newton.sensors import SensorCamera
from problem import Problem

GEOM = mujoco.mjtGeom


class NewtonPeer:
    variants = ("TILED 8x8", "PIXEL_PRIORITY")

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.model, self.moving, self.geoms = build_model(problem)
        self.state = self.model.state()
        self.sensor = SensorCamera(self.model, load_textures=False)
        self.configs = {
            "TILED 8x8": SensorCamera.RenderConfig(
                render_order=SensorCamera.RenderOrder.TILED, tile_width=8, tile_height=8
            ),
            "PIXEL_PRIORITY": SensorCamera.RenderConfig(render_order=SensorCamera.RenderOrder.PIXEL_PRIORITY),
        }
        # Views that share a lens are rendered by one call.
        fovy = problem.mjm.cam_fovy[problem.camera_ids]
        self.batches = [Batch(self, np.flatnonzero(fovy == value), float(value)) for value in np.unique(fovy)]
        self.pull_poses()

    def pull_poses(self) -> None:
        d = self.problem.d
        xpos, xquat = d.xpos.numpy()[:, self.moving], d.xquat.numpy()[:, self.moving]
        body_q = np.concatenate([xpos, xquat[..., [1, 2, 3, 0]]], axis=-1)
        if len(self.moving):
            self.state.body_q.assign(body_q.reshape(-1, 7).astype(np.float32))
        for batch in self.batches:
            batch.pull_cameras()

    def frame(self, variant: str) -> None:
        self.model.bvh_refit_shapes(self.state)
        for batch in self.batches:
            self.sensor.update(
                self.state,
                batch.transforms,
                batch.rays,
                forward_depth_image=batch.depth,
                shape_index_image=batch.shapes,
                world_indices=batch.worlds,
                render_config=self.configs[variant],
            )

    def images(self, worlds: int) -> list[tuple[np.ndarray, np.ndarray]]:
        images: list[tuple[np.ndarray, np.ndarray]] = [(np.empty(0), np.empty(0))] * len(self.problem.cameras)
        for batch in self.batches:
            for k, camera in enumerate(batch.cameras):
                views = slice(k * self.problem.worlds, k * self.problem.worlds + worlds)
                shapes = batch.shapes[views].numpy().astype(np.int64)
                missed = shapes >= len(self.geoms)
                ids = np.where(missed, -1, self.geoms[np.where(missed, 0, shapes)])
                images[camera] = (np.where(missed, np.inf, batch.depth[views].numpy()), ids)
        return images


class Batch:
    """Views of all worlds through cameras with one lens, camera by camera."""

    def __init__(self, peer: NewtonPeer, cameras: np.ndarray, fovy: float) -> None:
        self.problem, self.cameras = peer.problem, cameras
        width, height, count = self.problem.width, self.problem.height, len(cameras) * self.problem.worlds
        self.rays = SensorCamera.compute_camera_rays_pinhole(
            width, height, camera_fov=np.radians(fovy), device=peer.model.device
        )
        self.transforms = wp.zeros(count, dtype=wp.transformf)
        self.worlds = wp.array(np.tile(np.arange(self.problem.worlds), len(cameras)), dtype=wp.int32)
        self.depth = peer.sensor.allocate_image_depth_forward(count, width, height)
        self.shapes = peer.sensor.allocate_image_shape_index(count, width, height)

    def pull_cameras(self) -> None:
        ids = np.asarray(self.problem.camera_ids)[self.cameras]
        position = self.problem.d.cam_xpos.numpy()[:, ids].swapaxes(0, 1).reshape(-1, 3)
        rotation = self.problem.d.cam_xmat.numpy()[:, ids].swapaxes(0, 1).reshape(-1, 9)
        quaternion = np.empty((len(rotation), 4))
        for view, matrix in enumerate(rotation.astype(np.float64)):
            mujoco.mju_mat2Quat(quaternion[view], matrix)
        self.transforms.assign(np.concatenate([position, quaternion[:, [1, 2, 3, 0]]], axis=1).astype(np.float32))


def build_model(problem: Problem) -> tuple[newton.Model, np.ndarray, np.ndarray]:
    """The model, the MuJoCo bodies behind a world's bodies in order, and the geom id of each shape.

    Planes and height fields of the ground are in all worlds at once, as in Newton's own benchmarks.
    """
    mjm = problem.mjm
    mjd = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, mjd)
    scene, world = newton.ModelBuilder(), newton.ModelBuilder()
    # What Newton's own benchmark of this sensor uses on a GPU.
    scene.default_bvh_cfg.shape_constructor = "sah"
    scene.default_bvh_cfg.mesh_constructor = "cubql" if wp.get_device().is_cuda else None

    drawn = problem.drawn_geoms()
    moving = [body for body in np.unique(mjm.geom_bodyid[drawn]) if mjm.body_weldid[body] != 0]
    links = {body: world.add_link(xform=transform(mjd.xpos[body], mjd.xquat[body]), mass=1.0) for body in moving}
    meshes: dict[int, newton.Mesh] = {}
    for_all, for_each = [], []
    for geom in drawn:
        body = int(mjm.geom_bodyid[geom])
        if body in links:
            add_shape(world, mjm, geom, links[body], transform(mjm.geom_pos[geom], mjm.geom_quat[geom]), meshes)
            for_each.append(geom)
            continue
        position = mjd.xpos[body] + mjd.xmat[body].reshape(3, 3) @ mjm.geom_pos[geom]
        rotation = np.empty(4)
        mujoco.mju_mulQuat(rotation, mjd.xquat[body], mjm.geom_quat[geom])
        shared = int(mjm.geom_type[geom]) in (int(GEOM.mjGEOM_PLANE), int(GEOM.mjGEOM_HFIELD))
        add_shape(scene if shared else world, mjm, geom, -1, transform(position, rotation), meshes)
        (for_all if shared else for_each).append(geom)
    scene.replicate(world, problem.worlds)
    model = scene.finalize(skip_all_validations=True)
    geoms = np.concatenate([for_all, np.tile(for_each, problem.worlds)]).astype(np.int64)
    if len(geoms) != model.shape_count:
        raise RuntimeError(f"Newton has {model.shape_count} shapes where {len(geoms)} were given")
    return model, np.array(moving, dtype=np.int64), geoms


def transform(position: np.ndarray, quaternion: np.ndarray) -> wp.transform:
    """From a position [m] and a quaternion wxyz."""
    w, x, y, z = (float(q) for q in quaternion)
    return wp.transform(wp.vec3(*(float(p) for p in position)), wp.quat(x, y, z, w))


def add_shape(
    builder: newton.ModelBuilder,
    mjm: mujoco.MjModel,
    geom: int,
    body: int,
    xform: wp.transform,
    meshes: dict[int, newton.Mesh],
) -> None:
    """Add one MuJoCo geom as something to see, without mass or contact."""
    config = newton.ModelBuilder.ShapeConfig(density=0.0, has_shape_collision=False, has_particle_collision=False)
    x, y, z = (float(s) for s in mjm.geom_size[geom])
    common = {"xform": xform, "cfg": config}
    kind, asset = mjm.geom_type[geom], int(mjm.geom_dataid[geom])
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
        if asset not in meshes:
            vertices = slice(mjm.mesh_vertadr[asset], mjm.mesh_vertadr[asset] + mjm.mesh_vertnum[asset])
            faces = slice(mjm.mesh_faceadr[asset], mjm.mesh_faceadr[asset] + mjm.mesh_facenum[asset])
            meshes[asset] = newton.Mesh(mjm.mesh_vert[vertices], mjm.mesh_face[faces].ravel(), compute_inertia=False)
        builder.add_shape_mesh(body, mesh=meshes[asset], **common)
    elif kind == GEOM.mjGEOM_HFIELD:
        rows, columns, start = mjm.hfield_nrow[asset], mjm.hfield_ncol[asset], mjm.hfield_adr[asset]
        hx, hy, top, _ = (float(s) for s in mjm.hfield_size[asset])
        data = mjm.hfield_data[start : start + rows * columns].reshape(rows, columns)
        bounds = {"min_z": top * float(data.min()), "max_z": top * float(data.max())}
        field = newton.Heightfield(data, int(rows), int(columns), hx, hy, **bounds)
        builder.add_shape_heightfield(heightfield=field, **common)
    else:
        raise NotImplementedError(f"geom {geom} has type {GEOM(kind).name}, which has no counterpart in Newton")


create = NewtonPeer
