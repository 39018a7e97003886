"""Stages of labels: extents in images, boxes and poses, projections, and what keypoints show."""

import functools
from dataclasses import dataclass

import warp as wp

from warpcam.kernels.flags import Lens
from warpcam.kernels.plan.launches import THREADS, SceneTypes
from warpcam.kernels.plan.trace import blocks
from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.types import HeightFields, Materials, Meshes, Shapes, View

wp.set_module_options(compiler_flags())

REGION = 64  # pixels of a window's side: native/labels/coverage.h, COVER_SIZE
EXTENT_NUMBERS = 5  # native/labels/coverage.h
ABSENT = 2**31 - 1  # stands after the keys of a world's instances
CORNERS = 8  # of a box
LANES = 32  # of a CUDA block that work on a keypoint


@wp.struct
class Members:
    """Shapes of each instance: row r is that of world r, or row 0 that of all worlds."""

    columns: wp.array2d(dtype=wp.int32)  # (row, place) shapes, instance after instance
    starts: wp.array2d(dtype=wp.int32)  # (row, instance + 1) place of an instance's first shape, and the end


@wp.struct
class Cover:
    """What is traced of each instance alone, and where the result goes."""

    mask: wp.array(dtype=wp.uint8)  # (world,) worlds with 0 are left alone
    members: Members
    extents: wp.array3d(dtype=wp.int32)  # (world, instance, EXTENT_NUMBERS) left, top, right, bottom, pixels
    masks: wp.array4d(dtype=wp.uint8)  # (world, instance, height, width) 1: the instance alone is there; or empty
    width: wp.int32  # of the image [pixels]
    height: wp.int32
    parts: wp.int32  # blocks of an instance, each of which has every so many-th window


@wp.struct
class MeshBoxes:
    """Boxes of meshes along the axes of their instances' frames, about the shapes' origins.

    Each holds for one mesh, turn and scale. Where a shape has others its mesh's own box counts.
    """

    assets: wp.array(dtype=wp.int32)  # (shape,) or -1
    turns: wp.array(dtype=wp.mat33)  # (shape,) rotation from the shape's frame to the instance's
    scales: wp.array(dtype=wp.vec3)  # (shape,) of the mesh along its axes; 1 where the scene has none
    low: wp.array(dtype=wp.vec3)  # (shape,) [m]
    high: wp.array(dtype=wp.vec3)  # (shape,)


@wp.struct
class Boxes:
    """Frames of instances, and boxes along their axes."""

    mask: wp.array(dtype=wp.uint8)  # (world,)
    members: Members
    meshes: MeshBoxes
    frame_bodies: wp.array2d(dtype=wp.int32)  # (row, instance) body whose frame it has, or -1
    frame_shapes: wp.array2d(dtype=wp.int32)  # (row, instance) shape whose frame it has, or -1; both -1: the world's
    body_positions: wp.array2d(dtype=wp.vec3)  # (world, body) world frame [m]
    body_rotations: wp.array2d(dtype=wp.mat33)  # (world, body)
    positions: wp.array2d(dtype=wp.vec3)  # (world, instance) of the frame in the world [m]; written
    rotations: wp.array2d(dtype=wp.mat33)  # (world, instance); written
    centers: wp.array2d(dtype=wp.vec3)  # (world, instance) of the box in the frame [m]; written
    half_extents: wp.array2d(dtype=wp.vec3)  # (world, instance) along the frame's axes [m]; written


@wp.struct
class Poses:
    """Frames and boxes as one camera sees them: in its own frame."""

    positions: wp.array2d(dtype=wp.vec3)  # (world, instance) [m]
    rotations: wp.array2d(dtype=wp.vec4)  # (world, instance) w x y z
    corners: wp.array2d(dtype=wp.vec3)  # (world, 8 * instance) [m]
    centers: wp.array2d(dtype=wp.vec3)  # (world, instance) [m]
    depths: wp.array2d(dtype=wp.float32)  # (world, instance) planar, of the centre [m]


@wp.struct
class Projection:
    """Points that are projected."""

    mask: wp.array(dtype=wp.uint8)  # (world,)
    points: wp.array2d(dtype=wp.vec3)  # (world, point) in the camera's frame [m]
    pixels: wp.array2d(dtype=wp.vec2)  # (world, point) column and row [pixels]; written
    starts: wp.array2d(dtype=wp.vec3)  # (world, point) where the ray begins, likewise [m]; written, if not empty


@wp.struct
class Keypoints:
    """Keypoints on bodies, and what one camera sees of them."""

    bodies: wp.array(dtype=wp.int32)  # (keypoint,) or -1 for the world
    offsets: wp.array(dtype=wp.vec3)  # (keypoint,) in the body's frame [m]
    projection: Projection  # of the keypoints
    depths: wp.array2d(dtype=wp.float32)  # (world, keypoint) planar [m]; written
    visibility: wp.array2d(dtype=wp.uint8)  # (world, keypoint) native/labels/keypoint_visibility.h; written
    shapes: wp.array(dtype=wp.int32)  # (place,) those that the camera sees
    tolerance: wp.float32  # by which a surface may be nearer that does not hide a keypoint [m]
    width: wp.int32  # of the image [pixels]
    height: wp.int32


@wp.struct
class ImageExtents:
    """Extents of instances in the images of one camera, and the labels that follow."""

    visible: wp.array3d(dtype=wp.int32)  # (world, instance, EXTENT_NUMBERS)
    amodal: wp.array3d(dtype=wp.int32)  # likewise; empty where nothing is traced alone
    visible_boxes: wp.array3d(dtype=wp.int32)  # (world, instance, 4)
    visible_pixels: wp.array2d(dtype=wp.int32)
    amodal_boxes: wp.array3d(dtype=wp.int32)
    amodal_pixels: wp.array2d(dtype=wp.int32)
    visibility: wp.array2d(dtype=wp.float32)
    truncated: wp.array2d(dtype=wp.uint8)


@dataclass(frozen=True)
class CoverKey:
    """A kernel that traces instances alone: native/labels/coverage.h."""

    types: SceneTypes
    lens: Lens
    capacity: int  # shapes that a block lists
    masks: bool = False  # masks are written, too


@functools.cache
def cover_kernel(key: CoverKey) -> wp.Kernel:
    return make_kernel(
        "cover_instance",
        f"warpcam::cover_instance<{key.types.native}, {int(key.lens)}, {key.capacity}, {str(key.masks).lower()}>"
        "(shapes, materials, meshes, fields, views, cover, index);",
        {
            "shapes": Shapes,
            "materials": Materials,
            "meshes": Meshes,
            "fields": HeightFields,
            "views": wp.array(dtype=View),
            "cover": Cover,
        },
        native_module("labels/coverage.h"),
        (THREADS, blocks(key.types, key.capacity)),
    )


@functools.cache
def box_kernel(types: SceneTypes) -> wp.Kernel:
    return make_kernel(
        "write_instance_box",
        f"warpcam::write_instance_box<{types.native}>(shapes, materials, meshes, fields, boxes, index);",
        {"shapes": Shapes, "materials": Materials, "meshes": Meshes, "fields": HeightFields, "boxes": Boxes},
        native_module("labels/instance_boxes.h"),
    )


@functools.cache
def projection_kernel(lens: Lens) -> wp.Kernel:
    return make_kernel(
        "project_points",
        f"warpcam::project_points<{int(lens)}>(views, projection, index);",
        {"views": wp.array(dtype=View), "projection": Projection},
        native_module("labels/project_points.h"),
    )


@functools.cache
def keypoint_kernel(types: SceneTypes, is_table: bool) -> wp.Kernel:
    return make_kernel(
        "write_keypoint_visibility",
        f"warpcam::write_keypoint_visibility<{types.native}, {str(is_table).lower()}>"
        "(shapes, materials, meshes, fields, views, keypoints, index);",
        {
            "shapes": Shapes,
            "materials": Materials,
            "meshes": Meshes,
            "fields": HeightFields,
            "views": wp.array(dtype=View),
            "keypoints": Keypoints,
        },
        native_module("labels/keypoint_visibility.h"),
    )


@wp.func
def clear_extent(extents: wp.array3d(dtype=wp.int32), world: wp.int32, instance: wp.int32):
    extents[world, instance, 0] = ABSENT
    extents[world, instance, 1] = ABSENT
    for k in range(2, EXTENT_NUMBERS):
        extents[world, instance, k] = 0


@wp.kernel(enable_backward=False)
def clear_extents(mask: wp.array(dtype=wp.uint8), extents: ImageExtents, first: wp.int32):
    index = first + wp.tid()
    instances = extents.visible.shape[1]
    world = index // instances
    if mask[world] == wp.uint8(0):
        return
    clear_extent(extents.visible, world, index % instances)
    if extents.amodal.shape[0] > 0:
        clear_extent(extents.amodal, world, index % instances)


@wp.kernel(enable_backward=False)
def clear_masks(mask: wp.array(dtype=wp.uint8), masks: wp.array4d(dtype=wp.uint8), first: wp.int32):
    """Clear a row of a mask."""
    index = first + wp.tid()
    height = masks.shape[2]
    row = index % height
    instance = index // height % masks.shape[1]
    world = index // height // masks.shape[1]
    if mask[world] == wp.uint8(0):
        return
    for column in range(masks.shape[3]):
        masks[world, instance, row, column] = wp.uint8(0)


@wp.func
def instance_of(keys: wp.array2d(dtype=wp.int32), world: wp.int32, key: wp.int32) -> wp.int32:
    """Place of a key among those of a world, which ascend; -1 if it is none of them."""
    row = world % keys.shape[0]
    low = wp.int32(0)
    high = keys.shape[1]
    while low < high:
        middle = (low + high) // 2
        if keys[row, middle] < key:
            low = middle + 1
        else:
            high = middle
    if low < keys.shape[1] and keys[row, low] == key and key != ABSENT:
        return low
    return -1


@wp.func
def add_run(
    extents: wp.array3d(dtype=wp.int32),
    world: wp.int32,
    instance: wp.int32,
    left: wp.int32,
    right: wp.int32,
    row: wp.int32,
):
    """Extend an extent by the pixels of a row from ``left`` up to ``right``, which is not among them."""
    if instance < 0:
        return
    # what other threads make of it meanwhile is never less than what is read
    if left < extents[world, instance, 0]:
        wp.atomic_min(extents, world, instance, 0, left)
    if row < extents[world, instance, 1]:
        wp.atomic_min(extents, world, instance, 1, row)
    if right > extents[world, instance, 2]:
        wp.atomic_max(extents, world, instance, 2, right)
    if row + 1 > extents[world, instance, 3]:
        wp.atomic_max(extents, world, instance, 3, row + 1)
    wp.atomic_add(extents, world, instance, 4, right - left)


@wp.kernel(enable_backward=False)
def count_visible(
    mask: wp.array(dtype=wp.uint8),
    keys: wp.array2d(dtype=wp.int32),
    image: wp.array3d(dtype=wp.int32),
    run: wp.int32,
    extents: ImageExtents,
    first: wp.int32,
):
    """Read the ids of ``run`` pixels of a world, row after row, and extend the extents of what they show.

    Pixels beside each other that show the same count together. On a CPU one thread has a world: extents are then
    nobody else's.
    """
    index = first + wp.tid()
    height = image.shape[1]
    width = image.shape[2]
    runs = (width * height + run - 1) // run
    world = index // runs
    if mask[world] == wp.uint8(0):
        return
    pixel = index % runs * run
    end = wp.min(pixel + run, width * height)
    while pixel < end:
        row = pixel // width
        begin = row * width
        stop = wp.min(end - begin, width)
        left = pixel - begin
        shown = image[world, row, left]
        for column in range(left + 1, stop):
            key = image[world, row, column]
            if key != shown:
                add_run(extents.visible, world, instance_of(keys, world, shown), left, column, row)
                left = column
                shown = key
        add_run(extents.visible, world, instance_of(keys, world, shown), left, stop, row)
        pixel = begin + stop


@wp.func
def write_extent(
    extents: wp.array3d(dtype=wp.int32),
    boxes: wp.array3d(dtype=wp.int32),
    pixels: wp.array2d(dtype=wp.int32),
    world: wp.int32,
    instance: wp.int32,
) -> wp.int32:
    count = extents[world, instance, 4]
    for k in range(4):
        boxes[world, instance, k] = wp.where(count > 0, extents[world, instance, k], 0)
    pixels[world, instance] = count
    return count


@wp.kernel(enable_backward=False)
def write_extents(
    mask: wp.array(dtype=wp.uint8), width: wp.int32, height: wp.int32, extents: ImageExtents, first: wp.int32
):
    index = first + wp.tid()
    instances = extents.visible.shape[1]
    world = index // instances
    instance = index % instances
    if mask[world] == wp.uint8(0):
        return
    seen = write_extent(extents.visible, extents.visible_boxes, extents.visible_pixels, world, instance)
    if extents.amodal.shape[0] == 0:
        return
    whole = write_extent(extents.amodal, extents.amodal_boxes, extents.amodal_pixels, world, instance)
    extents.visibility[world, instance] = wp.where(whole > 0, wp.float32(seen) / wp.float32(wp.max(whole, 1)), 0.0)
    inside = extents.amodal[world, instance, 0] > 0 and extents.amodal[world, instance, 1] > 0
    inside = inside and extents.amodal[world, instance, 2] < width and extents.amodal[world, instance, 3] < height
    extents.truncated[world, instance] = wp.where(whole == 0 or inside, wp.uint8(0), wp.uint8(1))


@wp.func
def corner_sign(corner: wp.int32, axis: wp.int32) -> wp.float32:
    return wp.where((corner >> axis) & 1 == 1, 1.0, -1.0)


@wp.kernel(enable_backward=False)
def place_instances(views: wp.array(dtype=View), boxes: Boxes, poses: Poses, first: wp.int32):
    """Write frames and boxes in the camera's frame."""
    index = first + wp.tid()
    instances = poses.positions.shape[1]
    world = index // instances
    instance = index % instances
    if boxes.mask[world] == wp.uint8(0):
        return
    view = views[world]
    to_camera = wp.transpose(view.rotation)
    position = to_camera * (boxes.positions[world, instance] - view.origin)
    rotation = to_camera * boxes.rotations[world, instance]
    quaternion = wp.quat_from_matrix(rotation)
    poses.positions[world, instance] = position
    turn = wp.vec4(quaternion[3], quaternion[0], quaternion[1], quaternion[2])
    if turn[0] < 0.0:
        turn = -turn
    if not wp.isfinite(position[0]):
        turn = wp.vec4(wp.nan, wp.nan, wp.nan, wp.nan)
    poses.rotations[world, instance] = turn
    center = boxes.centers[world, instance]
    half = boxes.half_extents[world, instance]
    middle = position + rotation * center
    poses.centers[world, instance] = middle
    poses.depths[world, instance] = -middle[2]
    for corner in range(CORNERS):
        offset = wp.vec3(corner_sign(corner, 0), corner_sign(corner, 1), corner_sign(corner, 2))
        poses.corners[world, CORNERS * instance + corner] = position + rotation * (center + wp.cw_mul(offset, half))


@wp.kernel(enable_backward=False)
def place_keypoints(views: wp.array(dtype=View), boxes: Boxes, keypoints: Keypoints, first: wp.int32):
    """Write keypoints in the camera's frame."""
    index = first + wp.tid()
    count = keypoints.depths.shape[1]
    world = index // count
    number = index % count
    if boxes.mask[world] == wp.uint8(0):
        return
    point = keypoints.offsets[number]
    body = keypoints.bodies[number]
    if body >= 0:
        point = boxes.body_positions[world, body] + boxes.body_rotations[world, body] * point
    view = views[world]
    local = wp.transpose(view.rotation) * (point - view.origin)
    keypoints.projection.points[world, number] = local
    keypoints.depths[world, number] = -local[2]
