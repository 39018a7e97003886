"""Delivery of frames: which are captured, how long they are on their way, and which is shown."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.random import Randomness, element_state

wp.set_module_options(compiler_flags())

NORMAL, UNIFORM, EXPONENTIAL = 0, 1, 2
NO_FRAME = -1
LIVE_FRAME = -2  # the frame that was measured just now
SHUTTER_TOLERANCE = 0.01  # [periods]; times of a simulator are sums of float32
MAX_COUNT = 2147483000.0
CAPTURED, DROPPED, OVERRUN = 0, 1, 2  # columns of the counts


@wp.struct
class DeliveryParams:
    """Parameters of a delivery, (world,)."""

    rate: wp.array(dtype=wp.float32)  # [Hz]; 0: every frame
    phase: wp.array(dtype=wp.float32)  # [periods]
    latency: wp.array(dtype=wp.float32)  # [s]
    jitter: wp.array(dtype=wp.float32)  # [s]
    hold: wp.array(dtype=wp.float32)  # probability
    redraw: wp.array(dtype=wp.float32)  # [s]
    drop: wp.array(dtype=wp.float32)  # probability
    distribution: wp.int32


@wp.struct
class DeliveryState:
    """State of a delivery that lasts from frame to frame; all 0 before the first frame."""

    started: wp.array(dtype=wp.int32)  # (world,) 1 once there was a frame
    last: wp.array(dtype=wp.float32)  # (world,) time of the last frame that was measured [s]
    period: wp.array(dtype=wp.int32)  # (world,) number of the period that the last captured frame is of
    epoch: wp.array(dtype=wp.int32)  # (world,) number of the span of time that the jitter was drawn in
    deviation: wp.array(dtype=wp.float32)  # (world,) what was drawn, in units of the jitter
    shown: wp.array(dtype=wp.float32)  # (world,) time at which the frame that is shown was captured [s]
    pending: wp.array2d(dtype=wp.int32)  # (world, slot) 1 where a frame is on its way
    captured: wp.array2d(dtype=wp.float32)  # (world, slot) [s]
    arrival: wp.array2d(dtype=wp.float32)  # (world, slot) [s]


@wp.func
def count_of(time: wp.float32, rate: wp.float32, phase: wp.float32) -> wp.int32:
    """Number of the period that a time is in."""
    place = wp.float64(0.0)
    if wp.isfinite(time):
        place = wp.float64(time) * wp.float64(rate) - wp.float64(phase) + wp.float64(SHUTTER_TOLERANCE)
    limit = wp.float64(MAX_COUNT)
    return wp.int32(wp.floor(wp.clamp(place, -limit, limit)))


@wp.func
def has_come(time: wp.float32, arrival: wp.float32) -> wp.bool:
    """True from the arrival on, but for the rounding of float32 times."""
    return time >= arrival - 1.0e-5 - 5.0e-7 * wp.abs(time)


@wp.func
def draw(state: wp.uint32, distribution: wp.int32) -> wp.float32:
    """Deviation in units of the jitter."""
    value = wp.float32(0.0)
    if distribution == NORMAL:
        value = wp.randn(state)
    elif distribution == UNIFORM:
        value = wp.randf(state)
    else:
        value = -wp.log(1.0 - wp.randf(state))
    return value


@wp.kernel(enable_backward=False)
def deliver(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    params: DeliveryParams,
    times: wp.array(dtype=wp.float32),
    state: DeliveryState,
    counts: wp.array2d(dtype=wp.int32),
    stored: wp.array(dtype=wp.int32),
    shown: wp.array(dtype=wp.int32),
    ages: wp.array(dtype=wp.float32),
    first: wp.int32,
):
    """Decide where the new frame of a world is stored, and which is shown: a slot, NO_FRAME or LIVE_FRAME."""
    world = first + wp.tid()
    stored[world] = NO_FRAME
    shown[world] = NO_FRAME
    if mask[world] == wp.uint8(0):
        return
    now = times[world]
    slots = state.pending.shape[1]
    is_first = state.started[world] == 0 or now < state.last[world]
    period = count_of(now, params.rate[world], params.phase[world])
    epoch = count_of(now, 1.0 / wp.max(params.redraw[world], 1.0e-6), params.phase[world])
    state.last[world] = now
    random = element_state(randomness, world, 0)
    is_dropped = wp.randf(random) < params.drop[world]
    is_held = wp.randf(random) < params.hold[world]
    deviation = draw(random, params.distribution)

    if is_first:
        for slot in range(slots):
            state.pending[world, slot] = 0
    newest = wp.int32(NO_FRAME)
    for slot in range(slots):
        if state.pending[world, slot] != 0 and has_come(now, state.arrival[world, slot]):
            if newest == NO_FRAME or state.captured[world, slot] > state.captured[world, newest]:
                newest = slot
    if newest != NO_FRAME:
        shown[world] = newest
        state.shown[world] = state.captured[world, newest]

    is_period_new = params.rate[world] == 0.0 or period != state.period[world]
    is_due = is_first or (wp.isfinite(now) and is_period_new)
    if is_due:
        is_new_epoch = params.redraw[world] == 0.0 or epoch != state.epoch[world]
        if is_first or (is_new_epoch and not is_held):
            state.deviation[world] = deviation
        state.started[world] = 1
        state.period[world] = period
        state.epoch[world] = epoch
        counts[world, CAPTURED] = counts[world, CAPTURED] + 1
        arrival = now + wp.max(params.latency[world] + params.jitter[world] * state.deviation[world], 0.0)
        if is_first or (has_come(now, arrival) and not is_dropped):
            shown[world] = LIVE_FRAME
            state.shown[world] = now
        elif is_dropped:
            counts[world, DROPPED] = counts[world, DROPPED] + 1
        else:
            for slot in range(slots):
                free = state.pending[world, slot] == 0 or state.captured[world, slot] <= state.shown[world]
                if free and stored[world] == NO_FRAME:  # also the one that is shown, which is read before
                    stored[world] = slot
                    state.captured[world, slot] = now
                    state.arrival[world, slot] = arrival
                    state.pending[world, slot] = 1
            if stored[world] == NO_FRAME:
                counts[world, OVERRUN] = counts[world, OVERRUN] + 1
    for slot in range(slots):
        if state.captured[world, slot] <= state.shown[world] and slot != stored[world]:
            state.pending[world, slot] = 0
    ages[world] = now - state.shown[world]


@wp.kernel(enable_backward=False)
def move_frames(
    stored: wp.array(dtype=wp.int32),
    shown: wp.array(dtype=wp.int32),
    source: wp.array3d(dtype=Any),
    ring: wp.array4d(dtype=Any),
    target: wp.array3d(dtype=Any),
    first: wp.int32,
):
    """Store and show frames, (world, element, channel); the ring is (world, slot, element, channel)."""
    world, element = row_and_column(first + wp.tid(), source.shape[1])
    slot = stored[world]
    frame = shown[world]
    for k in range(source.shape[2]):
        if frame >= 0:
            target[world, element, k] = ring[world, frame, element, k]
        elif frame == LIVE_FRAME:
            target[world, element, k] = source[world, element, k]
        if slot >= 0:
            ring[world, slot, element, k] = source[world, element, k]


for _dtype in (wp.int32, wp.uint8):
    _frames = wp.array3d(dtype=_dtype)
    _slots = wp.array(dtype=wp.int32)
    wp.overload(move_frames, [_slots, _slots, _frames, wp.array4d(dtype=_dtype), _frames, wp.int32])
