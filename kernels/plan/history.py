"""Choices of optical flow: who composes motions, and what is kept of the last frame."""

import warp as wp

from warpcam.kernels.plan import launches
from warpcam.kernels.scene_tables import SceneTables

OUTPUTS = ("flow", "flow_valid")  # that need the last frame
ROWS, MOVING_ROWS = 4, 7  # of a shape in FlowHistory.motions, without and with meshes that move
COMPACT_SHAPES = 255  # as many have an id in eight bits, beside none
MOST_COMPOSED = 128  # shapes whose motions each block composes
FLOOR_REGION = 64  # pixels, native/flow/plane_history.h


def is_compact(tables: SceneTables) -> bool:
    """Return whether the history of a pixel has 16 bits, not 32: if all shapes are convex and few."""
    convex = tables.splats is None and launches.is_analytic(tables.shape_types)
    return convex and tables.num_shapes <= COMPACT_SHAPES


def composes(tables: SceneTables, device: wp.Device) -> bool:
    """Return whether the trace or view_shape_lists.py composes how shapes have moved, not a stage of its own."""
    few = tables.num_shapes <= launches.list_capacity(tables.num_drawn, device) <= MOST_COMPOSED
    return device.is_cuda and few and not tables.moving and tables.splats is None


def history_words(tables: SceneTables, width: int, height: int) -> int:
    """Numbers of 32 bits in which one image's words are kept: those of strips of eight pixels' width."""
    return -(-width // 8) * 8 * height // (2 if is_compact(tables) else 1)


def motion_rows(tables: SceneTables) -> int:
    """Rows of FlowHistory.motions a world; at least those of one shape, which are read where nothing is hit."""
    return (MOVING_ROWS if tables.moving else ROWS) * max(tables.num_shapes, 1)


def floor_parts(tables: SceneTables, device: wp.Device, width: int, height: int) -> int:
    """Parts of 8 x 8 pixels of an image, of each of which a trace of validity may keep whether it shows but a floor."""
    if width % 8 or height % 8 or not composes(tables, device) or not is_compact(tables):
        return 0
    return launches.regions_of(width, height, (FLOOR_REGION, FLOOR_REGION)) * (FLOOR_REGION // 8) ** 2
