"""The first stages of a frame: which worlds it draws, and each camera's view in them."""

import math
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import View

wp.set_module_options(compiler_flags())


@dataclass(frozen=True, eq=False)
class FrameCounters:
    """Counters that tell one frame of a world from another.

    Attributes:
        frames: int32, (world,): how many frames have drawn it.
        times: float32, (world,): the simulation's time in the last of them [s]; NaN where it has none.
    """

    frames: wp.array
    times: wp.array

    @classmethod
    def of(cls, num_worlds: int, device: wp.Device) -> "FrameCounters":
        return cls(
            wp.zeros(num_worlds, dtype=wp.int32, device=device),
            wp.full(num_worlds, math.nan, dtype=wp.float32, device=device),
        )


# How a lens is given: LensParams.
FOVY = 0  # vertical field of view [degrees]
INTRINSICS = 1  # focal lengths and principal point [pixels]
SENSOR = 2  # focal lengths (orthographic: units a metre), principal point off the centre, sensor size, all in one unit
HEIGHT = 3  # orthographic: what the image spans vertically [m]
TABLE = 4  # a table of rays: scale and center of View, ready made

# What depth shows where nothing is hit: LensParams.
CLIP_NONE = 0  # infinity
CLIP_MAX = 1  # far
CLIP_ZERO = 2

# State of a world's last frame, FlowHistory.frame_state of flow.py. What it showed is kept in the first or the second
# of two places, and what is shown goes to the other.
SECOND, FIRST = 1, 2
NEW = 4  # nothing is known; what is shown goes to the first. Between frames: 0

# Threads in a CUDA block: few, so that few worlds are spread over all multiprocessors.
BLOCK_DIM = 32

DEGREE = 0.017453292519943295


@wp.struct
class CameraPose:
    """Pose of one camera: in the source's own arrays, or in ours, on a body or in the world."""

    own: wp.int32  # 1: a camera of the user's, 0: one of the source's
    column: wp.int32  # of the camera in `positions` and `rotations`
    positions: wp.array2d(dtype=wp.vec3)  # (world, camera) world frame; own: parent's frame [m]
    rotations: wp.array2d(dtype=wp.mat33)  # (world, camera) world frame; not read for own ones
    quaternions: wp.array(dtype=wp.vec4)  # (world,) own: w x y z of any length but 0, parent's frame
    parent: wp.int32  # body that an own camera is fixed to, or -1
    parent_positions: wp.array2d(dtype=wp.vec3)  # (world, body) world frame [m]
    parent_rotations: wp.array2d(dtype=wp.mat33)  # (world, body)


@wp.struct
class LensParams:
    """Lens parameters of one camera."""

    kind: wp.int32  # FOVY, INTRINSICS, SENSOR, HEIGHT or TABLE
    column: wp.int32  # of the camera in `angles` and `intrinsics`
    angles: wp.array2d(dtype=wp.float32)  # (world*, camera) FOVY [degrees], HEIGHT [m]
    intrinsics: wp.array2d(dtype=wp.vec4)  # (world*, camera) focal lengths x, y, principal point x, y; TABLE: see there
    sensor: wp.vec2  # SENSOR: width and height
    near: wp.array(dtype=wp.float32)  # (world,) [m]
    far: wp.array(dtype=wp.float32)  # (world,) [m]
    clipping: wp.int32  # CLIP_NONE, CLIP_MAX or CLIP_ZERO
    width: wp.int32  # of the image [pixels]
    height: wp.int32
    parts: wp.vec2  # of a pixel, across and down, each of which is a pixel of the image that is drawn


@wp.struct
class FrameStart:
    """Changes that a frame makes to a world before it draws it; see ``start_frame``."""

    everything: wp.int32  # 1: all worlds are drawn, and the mask is made to say so; 0: those that it has
    frame_state: wp.array(dtype=wp.uint8)  # (world,) what is known of their last frames, turned over; or empty
    clock: wp.array(dtype=wp.float32)  # (world,) the simulation's time [s], or empty
    frames: wp.array(dtype=wp.int32)  # (world,) of Tags
    times: wp.array(dtype=wp.float32)  # (world,) of Tags


@wp.func
def rotation_of(quaternion: wp.vec4) -> wp.mat33:
    """``quaternion`` is w x y z; not finite for one of length 0, or whose length is not."""
    length = wp.length(quaternion)
    q = quaternion / wp.where(wp.isfinite(length), length, 0.0)
    return wp.quat_to_matrix(wp.quat(q[1], q[2], q[3], q[0]))


@wp.func
def is_finite(position: wp.vec3, rotation: wp.mat33, scale: wp.vec2, center: wp.vec2) -> wp.bool:
    total = wp.abs(position[0]) + wp.abs(position[1]) + wp.abs(position[2]) + scale[0] + scale[1]
    total += wp.abs(center[0]) + wp.abs(center[1])
    for i in range(3):
        for j in range(3):
            total += wp.abs(rotation[i, j])
    return wp.isfinite(total)


@wp.func
def camera_pose(world: wp.int32, pose: CameraPose):
    """Position and rotation of a camera in the world frame."""
    position = pose.positions[world, pose.column]
    rotation = wp.identity(n=3, dtype=wp.float32)
    if pose.own != 0:
        rotation = rotation_of(pose.quaternions[world])
        if pose.parent >= 0:
            frame = pose.parent_rotations[world, pose.parent]
            position = pose.parent_positions[world, pose.parent] + frame * position
            rotation = frame * rotation
    else:
        rotation = pose.rotations[world, pose.column]
    return position, rotation


@wp.func
def view_of(world: wp.int32, pose: CameraPose, lens: LensParams, faults: wp.array(dtype=wp.uint8)) -> View:
    near = lens.near[world]  # loaded with the rest: memory is waited for once
    far = lens.far[world]
    position, rotation = camera_pose(world, pose)

    width = wp.float32(lens.width)
    height = wp.float32(lens.height)
    center = wp.vec2(0.5 * width, 0.5 * height)
    scale = wp.vec2()
    if lens.kind == INTRINSICS or lens.kind == SENSOR:
        given = lens.intrinsics[world % lens.intrinsics.shape[0], lens.column]
        scale = wp.vec2(1.0 / given[0], 1.0 / given[1])
        center = wp.vec2(given[2], given[3])
        if lens.kind == SENSOR:
            scale = wp.vec2(scale[0] * lens.sensor[0] / width, scale[1] * lens.sensor[1] / height)
            center = wp.vec2(
                width * (0.5 - given[2] / lens.sensor[0]),
                height * (0.5 - given[3] / lens.sensor[1]),
            )
    elif lens.kind == TABLE:
        scale = wp.vec2(1.0, 1.0)
    else:
        extent = lens.angles[world % lens.angles.shape[0], lens.column]
        if lens.kind == FOVY:
            if extent < 180.0:
                extent = 2.0 * wp.tan(0.5 * DEGREE * extent)
            else:
                extent = -1.0
        scale = wp.vec2(extent / height, extent / height)

    view = View()
    view.near = near
    view.far = far
    view.miss = wp.inf
    if lens.clipping == CLIP_MAX:
        view.miss = far
    if lens.clipping == CLIP_ZERO:
        view.miss = 0.0
    seeing = scale[0] > 0.0 and scale[1] > 0.0 and near >= 0.0 and far > near
    seeing = seeing and wp.ddot(rotation, rotation) > 0.0  # 0: kinematics never ran
    if seeing and is_finite(position, rotation, scale, center):
        view.origin = position
        view.rotation = rotation
        view.scale = wp.cw_div(scale, lens.parts)
        view.center = wp.cw_mul(center, lens.parts)
    else:
        faults[world] = wp.uint8(1)
        view.origin = wp.vec3(wp.nan, wp.nan, wp.nan)
        view.rotation = wp.identity(n=3, dtype=wp.float32)
        view.scale = wp.vec2(1.0 / height, 1.0 / height)
        view.center = wp.vec2(0.5 * width, 0.5 * height)
        view.near = 0.0
        view.far = wp.inf
    if lens.kind == TABLE:  # its address is no number, and is needed where nothing is seen, too
        table = lens.intrinsics[world % lens.intrinsics.shape[0], lens.column]
        view.scale = wp.vec2(table[0], table[1])
        view.center = wp.vec2(table[2], table[3])
    return view


@wp.func
def write_view(
    world: wp.int32,
    pose: CameraPose,
    lens: LensParams,
    faults: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    before: wp.array(dtype=View),
):
    if before.shape[0] > 0:
        before[world] = views[world]
    views[world] = view_of(world, pose, lens, faults)


@wp.func
def next_frame_state(state: wp.int32) -> wp.int32:
    """Return the state of a world's history in the following frame."""
    turned = FIRST
    if state == 0:
        turned = NEW
    elif state == FIRST:
        turned = SECOND
    return turned


@wp.func
def count_frame(world: wp.int32, frame_start: FrameStart):
    frame_start.frames[world] = frame_start.frames[world] + 1
    if world < frame_start.clock.shape[0]:
        frame_start.times[world] = frame_start.clock[world]


@wp.func
def start_world(world: wp.int32, frame_start: FrameStart, faults: wp.array(dtype=wp.uint8)):
    faults[world] = wp.uint8(0)
    if frame_start.frame_state.shape[0] > 0:
        frame_start.frame_state[world] = wp.uint8(next_frame_state(wp.int32(frame_start.frame_state[world])))
    count_frame(world, frame_start)


@wp.kernel(enable_backward=False)
def start_frame(
    frame_start: FrameStart,
    pose: CameraPose,
    lens: LensParams,
    mask: wp.array(dtype=wp.uint8),
    faults: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    before: wp.array(dtype=View),
    first: wp.int32,
):
    world = first + wp.tid()
    if frame_start.everything != 0:
        mask[world] = wp.uint8(1)
    if mask[world] != wp.uint8(0):
        start_world(world, frame_start, faults)
        write_view(world, pose, lens, faults, views, before)


@wp.kernel(enable_backward=False)
def write_views(
    pose: CameraPose,
    lens: LensParams,
    mask: wp.array(dtype=wp.uint8),
    faults: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    before: wp.array(dtype=View),
    first: wp.int32,
):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        write_view(world, pose, lens, faults, views, before)


@wp.kernel(enable_backward=False)
def mark_worlds(ids: wp.array(dtype=Any), mask: wp.array(dtype=wp.uint8)):
    """Ids out of range are passed over."""
    world = ids[wp.tid()]
    if world >= ids.dtype(0) and world < ids.dtype(mask.shape[0]):
        mask[world] = wp.uint8(1)


# Both are compiled with the module, so that none is when ids first come.
for _dtype in (wp.int32, wp.int64):
    wp.overload(mark_worlds, [wp.array(dtype=_dtype), wp.array(dtype=wp.uint8)])


LAUNCHED = (write_views, BLOCK_DIM)  # in every frame; the others are compiled with it


def make_frame_start(
    everything: bool, clock: wp.array | None, tags: FrameCounters, device: wp.Device, known: wp.array | None = None
) -> Any:
    """The FrameStart of a stage of ``bind_views``.

    It clears the faults of the worlds drawn, counts the frame, and notes the ``clock``, (world,) float32 [s], if there
    is one. ``known``, uint8, (world,), says what is known of their last frames, and is turned over.
    """
    frame_start = FrameStart()
    frame_start.everything = int(everything)
    frame_start.frame_state = wp.empty(0, dtype=wp.uint8, device=device) if known is None else known
    frame_start.clock = wp.empty(0, dtype=wp.float32, device=device) if clock is None else clock
    frame_start.frames, frame_start.times = tags.frames, tags.times
    return frame_start


def bind_views(
    pose: CameraPose,
    lens: LensParams,
    mask: wp.array,
    faults: wp.array,
    views: wp.array,
    device: wp.Device,
    before: wp.array | None = None,
    frame_start: Any = None,
) -> Stage:
    """Bind the stage that writes one camera's views.

    Args:
        pose: Where the camera is.
        lens: How it sees.
        mask: uint8, (world,); worlds with 0 are left alone.
        faults: uint8, (world,); set to 1 where a pose or a lens makes no view. Its origin is NaN then.
        views: View, (world,); written.
        device: Where all of these lie.
        before: View, (world,); the views that were written last go there. None: nowhere.
        frame_start: FrameStart; what the stage does to a world first, as the one that opens the frame; None: it is
            another's.
    """
    before = wp.empty(0, dtype=View, device=device) if before is None else before
    values = [pose, lens, mask, faults, views, before]
    if frame_start is None:
        return bind_launch(write_views, views.shape[0], values, device, block_dim=BLOCK_DIM)
    return bind_launch(start_frame, views.shape[0], [frame_start, *values], device, block_dim=BLOCK_DIM)
