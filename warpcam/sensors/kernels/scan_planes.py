"""Endless planes along which rays run: directions are rounded, so that level rays meet them somewhere."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.sensors.kernels.scan_poses import ScanPoses, pose_at
from warpcam.sensors.kernels.scan_rays import ScanRays, direction_of, origin_of

wp.set_module_options(compiler_flags())

# Sines of angles between rays and planes are known to about 3e-7: pose and direction are float32. Below LEVEL a ray and
# a plane are parallel.
LEVEL = wp.constant(1.0e-6)
FAR_AWAY = wp.constant(1.0e3)  # a ray that is not parallel meets a plane a millimetre below it before that [m]


@wp.struct
class EndlessPlanes:
    """Planes of a scene, those that end among them."""

    shapes: wp.array(dtype=wp.int32)  # (plane,) their numbers
    positions: wp.array2d(dtype=wp.vec3)  # as Shapes has these three
    rotations: wp.array2d(dtype=wp.mat33)
    sizes: wp.array2d(dtype=wp.vec3)


@wp.func
def within_reach(distance: wp.float32, far: wp.float32) -> wp.float32:
    """Limit a traced distance to the greatest range, which it exceeds by rounding alone; inf stays."""
    return wp.where(wp.isfinite(distance), wp.min(distance, far), distance)


@wp.func
def runs_along_plane(
    planes: EndlessPlanes, rays: ScanRays, poses: ScanPoses, world: wp.int32, ray: wp.int32, distance: wp.float32
) -> wp.bool:
    """True if a ray that ends at a distance is parallel to an endless plane and farther along it than can be told."""
    position = poses.positions[world]
    rotation = poses.rotations[world]
    if rays.parts.shape[0] > 0:
        position, rotation = pose_at(poses, world, rays.parts[ray])
    origin = position + wp.quat_rotate(rotation, origin_of(rays, ray))
    direction = wp.quat_rotate(rotation, direction_of(rays, ray))
    for k in range(planes.shapes.shape[0]):
        shape = planes.shapes[k]
        size = planes.sizes[world % planes.sizes.shape[0], shape]
        if size[0] <= 0.0 or size[1] <= 0.0:
            normal = wp.normalize(planes.rotations[world, shape] * wp.vec3(0.0, 0.0, 1.0))
            if wp.length_sq(normal) > 0.0:  # zeros: this world has no such plane
                height = wp.dot(normal, origin - planes.positions[world, shape])
                if wp.abs(wp.dot(normal, direction)) < LEVEL and wp.abs(height) < LEVEL * distance:
                    return True
    return False
