"""Validation of what a source gives a scene, and of what a user names in it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.kernels.types import HEIGHT_FIELD, MESH, NUM_TYPES, SPLATS
from warpcam.scene.source import LiveArray, SceneDescription


def check_num_worlds(num_worlds: Any) -> None:
    """Check the number of worlds of a scene of a file."""
    if isinstance(num_worlds, bool) or not isinstance(num_worlds, int | np.integer) or num_worlds < 1:
        raise WarpcamError(f"num_worlds must be a whole number, at least 1, got {num_worlds!r}")
    if num_worlds >= 2**31:
        raise WarpcamError(f"num_worlds must be less than 2^31, got {num_worlds}")


def check_unit(meters_per_unit: Any) -> None:
    """Check the length of a file's unit [m]; None for the file's own."""
    is_number = isinstance(meters_per_unit, int | float | np.number) and not isinstance(meters_per_unit, bool)
    if meters_per_unit is not None and not (is_number and 0.0 < meters_per_unit < np.inf):
        raise WarpcamError(f"meters_per_unit must be a positive number, got {meters_per_unit!r}")


def check_semantics(labels: Any) -> dict[str, int]:
    """A user's numbers of labels."""
    if not isinstance(labels, Mapping):
        raise WarpcamError(f"semantics must map labels to whole numbers, got {type(labels).__name__}")
    for name, number in labels.items():
        if not isinstance(name, str) or isinstance(number, bool) or not isinstance(number, int | np.integer):
            raise WarpcamError(f"semantics: must map labels to whole numbers, got {name!r}: {number!r}")
        if not -(2**31) <= number < 2**31:
            raise WarpcamError(f"semantics: numbers must be of 32 bits, got {name!r}: {number!r}")
    return {name: int(number) for name, number in labels.items()}


def check_description(parts: SceneDescription, counts: Mapping[str, int]) -> None:
    """Numbers of worlds and rows, types of shapes, the skybox.

    Args:
        parts: What never changes.
        counts: Rows of each kind, by name.
    """
    if parts.num_worlds < 1:
        raise WarpcamError(f"worlds: the scene has {parts.num_worlds}; at least 1 is needed")
    for name, rows in counts.items():
        if rows >= 2**31 // parts.num_worlds:
            raise WarpcamError(f"{name}: {rows} in {parts.num_worlds} worlds are 2^31 or more; fewer are allowed")
    for shape in parts.drawn:
        if not 0 <= parts.shape_types[shape] < NUM_TYPES:
            raise WarpcamError(
                f"shape {shape}: its type is {parts.shape_types[shape]}; allowed are 0 to {NUM_TYPES - 1}"
            )
    if not -1 <= parts.skybox < len(parts.textures):
        raise WarpcamError(
            f"skybox: texture {parts.skybox} of {len(parts.textures)}; allowed are -1 for none and those"
        )


def check_array(label: str, field: LiveArray, array: Any, rows: int, num_worlds: int, device: wp.Device) -> None:
    """One live array: its type, shape and device; ``label`` is what the user calls it."""
    if not isinstance(array, wp.array):
        raise WarpcamError(f"{label}: a Warp array is needed, got {type(array).__name__}")
    device_rule.require_same(device, "the scene's other arrays are", array.device, label)
    more = len(field.more)
    shape = tuple(array.shape)
    leading = f"{num_worlds}" if field.every_world else "1 or more"
    expected = f"({leading}, {rows}{''.join(f', {n} or more' for n in field.more)})"
    fits = (
        len(shape) == 2 + more
        and (shape[0] == num_worlds if field.every_world else shape[0] >= 1)
        and shape[1] == rows
        and all(have >= need for have, need in zip(shape[2:], field.more, strict=True))
    )
    # Without rows nothing is read, and a source may leave the array as empty as it likes.
    if (rows > 0 and not fits) or array.ndim != 2 + more or array.dtype is not field.dtype:
        raise WarpcamError(
            f"{label}: expected {field.dtype.__name__} of shape {expected}, got {array.dtype.__name__} of {shape}"
        )


def check_indices(
    arrays: Mapping[str, wp.array], parts: SceneDescription, seen: Sequence[int], label: Callable[[str], str]
) -> None:
    """Indices as they are when the scene is made; one written later is the user's own responsibility.

    Args:
        arrays: The live arrays by name.
        parts: What they count.
        seen: Ids of the shapes that may be seen.
        label: What the user calls an array.
    """

    def check(name: str, count: int, rows: Sequence[int] | None = None) -> None:
        array = arrays[name]
        if array.size == 0:
            return
        values = array.numpy() if rows is None else array.numpy()[:, rows]
        if values.min() < -1 or values.max() >= count:
            worst = int(values.min()) if values.min() < -1 else int(values.max())
            raise WarpcamError(f"{label(name)}: has {worst}; allowed are -1 for none and 0 to {count - 1}")

    check("shape_materials", parts.num_materials)
    check("material_texture", len(parts.textures))
    for kind, assets in ((MESH, parts.meshes), (HEIGHT_FIELD, parts.height_fields), (SPLATS, parts.clouds)):
        if shapes := [shape for shape in seen if parts.shape_types[shape] == kind]:
            check("shape_assets", len(assets), shapes)


def find_index(key: str | int, names: tuple[str, ...], where: str, what: str) -> int:
    """Return the index of a camera or body that the user gives by name or index.

    Raises:
        WarpcamError: The scene has none of that name or index.
    """
    if isinstance(key, str) and key and key in names:
        return names.index(key)
    if isinstance(key, int | np.integer) and not isinstance(key, bool) and 0 <= key < len(names):
        return int(key)
    known = ", ".join(repr(name) if name else str(index) for index, name in enumerate(names)) or "none"
    raise WarpcamError(f"{where}: the scene has no {what} {key!r}; it has: {known}")


def find_body(parts: SceneDescription, key: str | int, where: str) -> int:
    """Return the index of a body that the user gives by name or index, or by its label where the source has labels.

    Raises:
        WarpcamError: The scene has none of that name, label or index.
    """
    if parts.body_labels is not None and parts.body_places is not None:
        if isinstance(key, str) and key in parts.body_labels:
            return int(parts.body_places[parts.body_labels.index(key)])
        if isinstance(key, int | np.integer) and not isinstance(key, bool) and 0 <= key < len(parts.body_places):
            return int(parts.body_places[key])
        if not isinstance(key, str):
            raise WarpcamError(
                f"{where}: the scene has no body {key!r}; it has indices 0 to {len(parts.body_places) - 1}"
            )
    return find_index(key, tuple(parts.bodies), where, "body")
