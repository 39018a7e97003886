"""The box around what can be seen."""

from collections.abc import Mapping, Sequence

import numpy as np

from warpcam.accel.heightfields import HeightField
from warpcam.kernels.types import BARREL, CAPSULE, CONE, CYLINDER, HEIGHT_FIELD, MESH, PLANE, SPHERE, SPLATS

Bounds = tuple[np.ndarray, np.ndarray]

# How the half extents of a box are made of the three sizes: their indices, and the one added to the third.
EXTENTS = {
    SPHERE: ((0, 0, 0), None),
    CAPSULE: ((0, 0, 0), 1),
    CYLINDER: ((0, 0, 1), None),
    CONE: ((0, 0, 1), None),
    BARREL: ((0, 0, 1), None),
}
DEFAULT_COLOR = np.array((0.5, 0.5, 0.5, 1.0), np.float32)  # a shape's colour that leaves the say to its material


def bounds_of(
    arrays: Mapping[str, np.ndarray],
    types: np.ndarray,
    drawn: Sequence[int],
    meshes: Bounds,
    height_fields: Sequence[HeightField],
    scaled: bool = False,
    clouds: Bounds | None = None,
) -> Bounds:
    """Lowest and highest corner, (3,) float32 each [m]; zeros where there is nothing.

    Args:
        arrays: The scene's live arrays on the host, by the names in ``scene.LIVE_ARRAYS``.
        types: (shape,) int32.
        drawn: ids of the shapes that may be seen. Of those, infinite planes, transparent shapes and shapes whose
            pose is not a number do not count.
        meshes: Lowest and highest corner, (mesh, 3), of what ``shape_assets`` counts for meshes.
        height_fields: What ``shape_assets`` counts for height fields.
        scaled: Whether the sizes of meshes and height fields are scales along their axes.
        clouds: Like ``meshes``, for splats, whose sizes always are.
    """
    boxes = {
        MESH: _stacked([_mesh_box(low, high) for low, high in zip(*meshes, strict=True)]),
        HEIGHT_FIELD: _stacked([_field_box(field) for field in height_fields]),
    }
    if clouds is not None:
        boxes[SPLATS] = _stacked([_mesh_box(low, high) for low, high in zip(*clouds, strict=True)])
    worlds = np.arange(len(arrays["shape_positions"]))
    lowest, highest = np.full(3, np.inf, np.float32), np.full(3, -np.inf, np.float32)
    for shape in drawn:
        kind = int(types[shape])
        if kind in boxes:
            low, high = boxes[kind]
            assets = _by_world(arrays["shape_assets"], worlds, shape)  # -1 takes the last row, which is nothing
            low, high = low[assets], high[assets]
            if scaled or kind == SPLATS:
                scales = _by_world(arrays["shape_sizes"], worlds, shape)
                low, high = np.minimum(low * scales, high * scales), np.maximum(low * scales, high * scales)
        else:
            high = _half_extents(kind, _by_world(arrays["shape_sizes"], worlds, shape))
            low = -high
        rotations = arrays["shape_rotations"][:, shape]
        middle = arrays["shape_positions"][:, shape] + np.einsum("wij,wj->wi", rotations, 0.5 * (low + high))
        reach = np.einsum("wij,wj->wi", np.abs(rotations), 0.5 * (high - low))
        counts = np.isfinite(middle + reach).all(axis=1) & _opaque(shape, worlds, arrays)
        if counts.any():
            lowest = np.minimum(lowest, (middle - reach)[counts].min(axis=0))
            highest = np.maximum(highest, (middle + reach)[counts].max(axis=0))
    if not np.isfinite(lowest).all():
        return np.zeros(3, np.float32), np.zeros(3, np.float32)
    return lowest.astype(np.float32), highest.astype(np.float32)


def _by_world(values: np.ndarray, worlds: np.ndarray, row: int) -> np.ndarray:
    return values[worlds % len(values), row]


def _opaque(shape: int, worlds: np.ndarray, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    color = _by_world(arrays["shape_colors"], worlds, shape)
    material = _by_world(arrays["shape_materials"], worlds, shape)
    table = arrays["material_color"]
    alpha = color[:, 3]
    if table.size:
        from_material = (material >= 0) & (color == DEFAULT_COLOR).all(axis=1)
        alpha = np.where(from_material, table[worlds % len(table), np.maximum(material, 0), 3], alpha)
    return alpha > 0.0


def _half_extents(kind: int, sizes: np.ndarray) -> np.ndarray:
    """(world, 3); NaN for an infinite plane."""
    if kind == PLANE:
        half = sizes * np.array((1.0, 1.0, 0.0), np.float32)
        finite = np.all((sizes[:, :2] > 0.0) & np.isfinite(sizes[:, :2]), axis=1)
        return np.where(finite[:, None], half, np.float32(np.nan))
    order, added = EXTENTS.get(kind, ((0, 1, 2), None))
    half = sizes[:, order]
    if added is not None:
        half[:, 2] += sizes[:, added]
    if kind == BARREL:
        arc, along = np.maximum(sizes[:, 2], sizes[:, 1]), sizes[:, 1]
        belly = along**2 / np.maximum(arc + np.sqrt(arc**2 - along**2), 1e-30)
        half[:, :2] += np.where(sizes[:, 2] > 0.0, belly, 0.0)[:, None]
    return half


def _stacked(boxes: Sequence[Bounds]) -> Bounds:
    """Lowest and highest corners, (asset + 1, 3); the last row stands for no asset."""
    nothing = np.full(3, np.nan, np.float32)
    return np.stack([*(box[0] for box in boxes), nothing]), np.stack([*(box[1] for box in boxes), nothing])


def _mesh_box(low: np.ndarray, high: np.ndarray) -> Bounds:
    if not (high >= low).all():  # without faces
        return np.full(3, np.nan, np.float32), np.full(3, np.nan, np.float32)
    return low, high


def _field_box(field: HeightField) -> Bounds:
    x, y = field.half_size
    low = np.array((-x, -y, -field.base), np.float32)
    return low, np.array((x, y, float(np.max(field.heights))), np.float32)
