"""Newton models to look at."""

from collections.abc import Sequence
from typing import Any

import newton
import numpy as np
import scenes
import warp as wp
from newton.sensors import SensorCamera

import warpcam as wc

FOVY = 50.0


def pose(x: float, y: float, z: float, rotation: Any = None) -> wp.transform:
    """At a place [m]; ``rotation`` is x y z w of any length."""
    q = np.array((0.0, 0.0, 0.0, 1.0)) if rotation is None else np.asarray(rotation, np.float64)
    return wp.transform(wp.vec3(x, y, z), wp.quat(*(q / np.linalg.norm(q))))


def tetrahedron(size: Sequence[float] = (0.5, 0.6, 0.7)) -> newton.Mesh:
    x, y, z = size
    corners = np.array(((0, 0, 0), (x, 0, 0), (0, y, 0), (0, 0, z)), np.float32)
    return newton.Mesh(corners, np.array((0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3)), compute_inertia=False)


def zoo(seed: int = 0) -> newton.ModelBuilder:
    """One shape of each type, turned every way, in front of ``eye``."""
    random = np.random.default_rng(seed)
    builder = newton.ModelBuilder()

    def at(x: float, z: float) -> wp.transform:
        return pose(x, 0.0, z, random.normal(size=4))

    ball = builder.add_body(xform=at(0.0, 1.0), label="ball")
    builder.add_shape_sphere(ball, radius=0.3, xform=pose(0.1, 0.0, 0.0), label="sphere")
    builder.add_shape_box(-1, hx=0.1, hy=0.2, hz=0.3, xform=at(0.7, 0.5), label="box")
    builder.add_shape_cone(-1, radius=0.3, half_height=0.3, xform=at(-0.7, 0.3), label="cone")
    builder.add_shape_cylinder(-1, radius=0.2, half_height=0.3, barrel_radius=0.35, xform=at(-1.4, 0.4), label="barrel")
    builder.add_shape_cylinder(-1, radius=0.2, half_height=0.3, xform=at(-1.4, 1.4), label="cylinder")
    builder.add_shape_capsule(-1, radius=0.2, half_height=0.3, xform=at(-0.7, 1.4), label="capsule")
    builder.add_shape_ellipsoid(-1, rx=0.2, ry=0.3, rz=0.4, xform=at(0.0, 1.8), label="ellipsoid")
    round_mesh = newton.Mesh.create_sphere(0.3, num_latitudes=8, num_longitudes=8, compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=round_mesh, scale=(-1.0, 1.0, 2.0), xform=at(1.4, 0.7), label="mirrored")
    builder.add_shape_mesh(-1, mesh=tetrahedron(), scale=(-1.0, 1.3, 0.7), xform=at(1.4, 1.7), label="tetrahedron")
    builder.add_shape_convex_hull(-1, mesh=tetrahedron(), scale=(1.0, 1.3, -0.7), xform=at(0.7, 1.5), label="convex")
    builder.add_shape_plane(None, width=0.8, length=0.4, xform=pose(0.0, 0.6, 0.2, (0.5, 0.0, 0.0, 1.0)), label="plane")
    return builder


def finalize(builder: newton.ModelBuilder, device: wp.Device) -> tuple[newton.Model, newton.State]:
    model = builder.finalize(device=device)
    return model, model.state()


def eye(**changes: Any) -> wc.Camera:
    """Looks at the zoo."""
    position = (0.0, -4.0, 1.6)
    settings = {
        "width": 96,
        "height": 64,
        "outputs": ("depth", "segmentation", "normals"),
        "lens": wc.Pinhole(fovy=FOVY),
        "position": position,
        "rotation": scenes.looking(position, (0.0, 0.0, 0.8)),
    }
    return scenes.own_camera(**{**settings, **changes})


def newtons_own(model: newton.Model, state: newton.State, camera: wc.Camera) -> dict[str, np.ndarray]:
    """Planar depth [m], inf where nothing is, shape index, -1 there, and normals, as Newton's camera sees them."""
    sensor = SensorCamera(model)
    rays = SensorCamera.compute_camera_rays_pinhole(
        camera.width, camera.height, camera_fov=np.radians(FOVY), device=model.device
    )
    w, x, y, z = (float(value) for value in camera.rotation)
    views = [wp.transform(wp.vec3(*camera.position), wp.quat(x, y, z, w))] * model.world_count
    size = (model.world_count, camera.width, camera.height)
    depth, shape = sensor.allocate_image_depth_forward(*size), sensor.allocate_image_shape_index(*size)
    normals = sensor.allocate_image_normal(*size)
    model.bvh_refit_shapes(state)
    sensor.update(
        state,
        wp.array(views, dtype=wp.transformf, device=model.device),
        rays,
        forward_depth_image=depth,
        shape_index_image=shape,
        normal_image=normals,
    )
    ids = shape.numpy().astype(np.int64)
    missed = ids >= model.shape_count
    return {
        "segmentation": np.where(missed, -1, ids),
        "depth": np.where(missed, np.inf, depth.numpy()),
        "normals": np.where(missed[..., None], 0.0, normals.numpy()),
    }


def cloth(cells: int = 12, height: float = 1.2) -> newton.ModelBuilder:
    """A cloth that lies flat, a cube of jelly beside it, and three loose particles, the last of them inactive."""
    builder = newton.ModelBuilder()
    builder.add_cloth_grid(
        pos=wp.vec3(-0.6, -0.6, height), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=cells, dim_y=cells,
        cell_x=1.2 / cells, cell_y=1.2 / cells, mass=0.1,
    )  # fmt: skip
    builder.add_soft_grid(
        pos=wp.vec3(0.9, -0.2, 0.4), rot=wp.quat_identity(), vel=wp.vec3(), dim_x=3, dim_y=3, dim_z=3,
        cell_x=0.15, cell_y=0.15, cell_z=0.15, density=1.0, k_mu=1.0, k_lambda=1.0, k_damp=0.0,
    )  # fmt: skip
    for x, flags in ((-1.0, 1), (-1.3, 1), (-1.6, 0)):
        builder.add_particle(wp.vec3(x, 0.0, 0.8), wp.vec3(), 0.1, radius=0.12, flags=flags)
    return builder
