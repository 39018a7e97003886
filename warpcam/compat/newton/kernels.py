"""Views that name their worlds, as Newton's camera has them: their poses go to cameras of worlds, the images come back.

A view is one pose and one image. Worlds may have several views: the first of a world is seen by the first camera, the
next by the second. Each pixel's ray is at hand, so that nothing depends on where its camera stands.
"""

import warp as wp

from warpcam.core.color import decode_srgb
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())

PRESERVE = wp.constant(-101)  # leave the view's image as it is
CLEAR = wp.constant(-102)  # nothing is seen by the view


@wp.struct
class ClearValues:
    """Values written where nothing is hit."""

    color: wp.uint32
    depth: wp.float32
    shape: wp.uint32
    normal: wp.vec3
    albedo: wp.uint32


@wp.struct
class RenderedImages:
    """Images of one camera, (world, height, width, channels); those that are not asked for are empty."""

    depth: wp.array4d(dtype=wp.float32)  # planar, or along the ray; inf where nothing is hit [m]
    along: wp.int32  # 1: the latter
    color: wp.array4d(dtype=wp.uint8)
    hdr: wp.array4d(dtype=wp.float32)
    shape: wp.array4d(dtype=wp.int32)
    normal: wp.array4d(dtype=wp.float32)
    albedo: wp.array4d(dtype=wp.uint8)


@wp.struct
class SensorImages:
    """Images of the views, (view, height, width); those that are not asked for are empty."""

    color: wp.array3d(dtype=wp.uint32)
    hdr: wp.array3d(dtype=wp.vec3)
    depth: wp.array3d(dtype=wp.float32)
    forward: wp.array3d(dtype=wp.float32)
    shape: wp.array3d(dtype=wp.uint32)
    normal: wp.array3d(dtype=wp.vec3)
    albedo: wp.array3d(dtype=wp.uint32)


@wp.kernel(enable_backward=False)
def choose_cameras(
    wanted: wp.array(dtype=wp.int32),
    num_cameras: wp.int32,
    counts: wp.array(dtype=wp.int32),
    worlds: wp.array(dtype=wp.int32),
    cameras: wp.array(dtype=wp.int32),
    mask: wp.array(dtype=wp.uint8),
    left_out: wp.array(dtype=wp.int32),
):
    """Assign each view its world and its camera, from ``counts`` and ``mask`` that are zero before."""
    view = wp.tid()
    world = wanted[view]
    camera = wp.int32(0)
    if world >= 0 and world < counts.shape[0]:
        camera = wp.atomic_add(counts, world, 1)
        if camera >= num_cameras:
            wp.atomic_add(left_out, 0, 1)
            world = CLEAR
            camera = 0
        else:
            mask[world] = wp.uint8(1)
    elif world != PRESERVE:
        world = CLEAR
    worlds[view] = world
    cameras[view] = camera


@wp.kernel(enable_backward=False)
def place_views(
    transforms: wp.array(dtype=wp.transform),
    worlds: wp.array(dtype=wp.int32),
    cameras: wp.array(dtype=wp.int32),
    camera: wp.int32,
    origin: wp.vec3,
    lens: wp.vec4,
    positions: wp.array(dtype=wp.vec3),
    rotations: wp.array(dtype=wp.vec4),
    lenses: wp.array(dtype=wp.vec4),
    heights: wp.array(dtype=wp.float32),
):
    """Poses and lenses of the views that ``camera`` sees."""
    view = wp.tid()
    world = worlds[view]
    if world < 0 or cameras[view] != camera:
        return
    transform = transforms[view]
    turn = wp.transform_get_rotation(transform)
    positions[world] = wp.transform_point(transform, origin)
    rotations[world] = wp.vec4(turn[3], turn[0], turn[1], turn[2])
    if lenses.shape[0] > 0:
        lenses[world] = lens
    if heights.shape[0] > 0:
        heights[world] = lens[0]


@wp.func
def packed(
    image: wp.array4d(dtype=wp.uint8), world: wp.int32, row: wp.int32, column: wp.int32, behind: wp.uint32
) -> wp.uint32:
    """A pixel; where its alpha leaves something, that of ``behind`` counts, packed likewise."""
    red, green = wp.uint32(image[world, row, column, 0]), wp.uint32(image[world, row, column, 1])
    blue, alpha = wp.uint32(image[world, row, column, 2]), wp.uint32(255)
    if image.shape[3] == 4:
        alpha = wp.uint32(image[world, row, column, 3])
        alpha += ((wp.uint32(255) - alpha) * (behind >> wp.uint32(24)) + wp.uint32(127)) / wp.uint32(255)
    return red | (green << wp.uint32(8)) | (blue << wp.uint32(16)) | (alpha << wp.uint32(24))


@wp.func
def byte_of(value: wp.float32) -> wp.uint32:
    return wp.uint32(wp.clamp(value, 0.0, 1.0) * 255.0 + 0.5)


@wp.func
def decoded(byte: wp.uint8) -> wp.float32:
    """Decode sRGB to linear."""
    return decode_srgb(wp.float32(byte) / 255.0)


@wp.func
def linear_bytes(red: wp.float32, green: wp.float32, blue: wp.float32) -> wp.uint32:
    low = byte_of(red) | (byte_of(green) << wp.uint32(8))
    return low | (byte_of(blue) << wp.uint32(16)) | (wp.uint32(255) << wp.uint32(24))


@wp.kernel(enable_backward=False)
def write_views(
    worlds: wp.array(dtype=wp.int32),
    cameras: wp.array(dtype=wp.int32),
    camera: wp.int32,
    rays: wp.array4d(dtype=wp.vec3),
    max_distance: wp.float32,
    linear: wp.int32,
    clear: ClearValues,
    seen: RenderedImages,
    out: SensorImages,
    first: wp.int32,
):
    view, pixel = row_and_column(first + wp.tid(), rays.shape[0] * rays.shape[1])
    world = worlds[view]
    if world == PRESERVE or cameras[view] != camera:
        return
    row, column = row_and_column(pixel, rays.shape[1])
    origin = rays[row, column, 0, 0]
    ray = rays[row, column, 0, 1]
    forward = wp.float32(0.0)
    distance = max_distance
    if world >= 0 and seen.along != 0:
        distance = seen.depth[world, row, column, 0] / wp.length(ray)
        forward = distance * -ray[2]
    elif world >= 0 and ray[2] < 0.0:
        forward = seen.depth[world, row, column, 0]
        distance = forward / -ray[2]
    hit = distance < max_distance
    if out.color.shape[0] > 0:
        color = clear.color
        if hit or (seen.color.shape[3] == 4 and world >= 0):
            if linear != 0:
                color = linear_bytes(
                    seen.hdr[world, row, column, 0], seen.hdr[world, row, column, 1], seen.hdr[world, row, column, 2]
                )
            else:
                color = packed(seen.color, world, row, column, clear.color)
        out.color[view, row, column] = color
    if out.hdr.shape[0] > 0:
        hdr = wp.vec3(0.0, 0.0, 0.0)
        if hit:
            hdr = wp.vec3(
                seen.hdr[world, row, column, 0], seen.hdr[world, row, column, 1], seen.hdr[world, row, column, 2]
            )
        out.hdr[view, row, column] = hdr
    if out.depth.shape[0] > 0:
        out.depth[view, row, column] = wp.where(hit, distance, clear.depth)
    if out.forward.shape[0] > 0:
        out.forward[view, row, column] = wp.where(hit, forward - origin[2], clear.depth)
    if out.shape.shape[0] > 0:
        shape = clear.shape
        if hit:
            shape = wp.uint32(seen.shape[world, row, column, 0])
        out.shape[view, row, column] = shape
    if out.normal.shape[0] > 0:
        normal = clear.normal
        if hit:
            normal = wp.vec3(
                seen.normal[world, row, column, 0],
                seen.normal[world, row, column, 1],
                seen.normal[world, row, column, 2],
            )
        out.normal[view, row, column] = normal
    if out.albedo.shape[0] > 0:
        albedo = clear.albedo
        if hit:
            if linear != 0:
                albedo = linear_bytes(
                    decoded(seen.albedo[world, row, column, 0]),
                    decoded(seen.albedo[world, row, column, 1]),
                    decoded(seen.albedo[world, row, column, 2]),
                )
            else:
                albedo = packed(seen.albedo, world, row, column, clear.albedo)
        out.albedo[view, row, column] = albedo
