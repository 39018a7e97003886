"""Domain randomisation: what looks different in every world, drawn on the device."""

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal
from weakref import WeakKeyDictionary
from zlib import crc32

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core import torch_interop
from warpcam.core.arrays import MAX_EXPOSURE
from warpcam.core.errors import WarpcamError
from warpcam.core.world_arrays import WorldArrays, ranges_of, world_count
from warpcam.core.world_mask import Selection
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import ROLE_COLOR
from warpcam.kernels.update import randomize as kernels
from warpcam.scene.scene import Scene

Of = Literal["value", "offset", "factor", "turn"]
KINDS: Mapping[str, int] = {
    "value": kernels.VALUE,
    "offset": kernels.OFFSET,
    "factor": kernels.FACTOR,
    "turn": kernels.TURN,
}
SINGLE = ("background", "skybox")  # arrays of a scene without a second dimension that counts something
TURNED = ("light_directions", "rotation")
# What Light and Camera refuse is not drawn either: the lowest and the highest value of these.
LIT = ("light_intensity", "light_ambient", "light_diffuse", "light_specular", "light_attenuation", "light_exponent")
RANGES: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys((*LIT, "gain", "near", "height"), (0.0, math.inf)),
    "background": (0.0, 1.0),
    "exposure": (-math.inf, MAX_EXPOSURE),
    "fovy": (0.0, 180.0),
}
MAX_STAGES = 256  # of a target that are kept, beside those that are part of a graph of the user's


@dataclass(frozen=True, eq=False)
class Uniform:
    """A number anywhere between two bounds.

    Attributes:
        low: A number, or one for each component, in the shape of an entry or one after another.
        high: Likewise.
        of: What is drawn: the "value" itself; an "offset" that is added to what was there when the attribute was first
            drawn in this way; a "factor" of that; or an angle [degrees] by which a direction or a quaternion "turn"s
            from that, about any axis.
        rows: Indices of the materials, lights or shapes; None is all. That of a rope or tendon is of all its pieces.
        linked: One draw for all components of an entry, so that a grey stays grey.
    """

    low: Any
    high: Any
    of: Of = "value"
    rows: Sequence[int] | None = None
    linked: bool = False


@dataclass(frozen=True, eq=False)
class Choice:
    """One of several: of indices of textures, of materials, of skyboxes; or of on and off.

    Attributes:
        values: Whole numbers, all as likely; one that is there twice is twice as likely.
        rows: As ``Uniform`` has it.
    """

    values: Sequence[int]
    rows: Sequence[int] | None = None


class Randomizer:
    """Random draws of one target: its arrays, and the stages that draw."""

    def __init__(self, num_worlds: int, device: wp.Device):
        self.num_worlds, self.device = num_worlds, device
        self.selection = Selection(num_worlds, device)
        # One for all worlds, and one for each, by how many: all stages read these, whatever was given.
        self.seeds = {count: wp.zeros(count, dtype=wp.int32, device=device) for count in (1, num_worlds)}
        self.stages: dict[tuple[Any, ...], Stage] = {}  # the last used at the end
        self.captured: set[tuple[Any, ...]] = set()
        self.nominal: dict[str, wp.array] = {}

    def keep(self, key: tuple[Any, ...], stage: Stage, captured: bool) -> Stage:
        """Put a stage at the end, and let go of what was not used for long."""
        self.stages.pop(key, None)
        self.stages[key] = stage
        if captured:
            self.captured.add(key)
        if len(self.stages) - len(self.captured) > MAX_STAGES:
            del self.stages[next(known for known in self.stages if known not in self.captured)]
        return stage


_randomizers: "WeakKeyDictionary[Any, Randomizer]" = WeakKeyDictionary()


def randomize(target: Any, *, seed: Any = 0, worlds: Any = None, by_world: bool = True, **recipes: Any) -> None:
    """Give worlds other looks, seen at the next render.

    The numbers follow from the seed, the attribute, the world and the row alone: the same call gives the same, and a
    world gets the same whichever others are drawn with it. All of it runs on the device and nothing is waited for. The
    first call with some recipes makes room for them; after that it may be part of a CUDA graph, where another ``seed``
    is a tensor that is written between replays.

    Args:
        target: A scene, the arrays of a camera, ``renderer.camera("front")``, or the parameters of its sensor,
            ``rig.parameters("front")``.
        seed: A whole number; or int32 on the scene's device, (1,) or (world,).
        worlds: Which worlds are drawn: ids or a mask, as ``Renderer.render`` takes them. None is all.
        by_world: Whether the world's number counts. False: worlds with the same seed draw the same, so that with a seed
            for each sample of a data set no sample depends on which world draws it.
        recipes: By attribute: names of ``Scene.vary``, or of the arrays. A pair (low, high) stands for
            ``Uniform(low, high)``, a list for ``Choice``.
    """
    if isinstance(target, Scene):
        num_worlds, device = target.num_worlds, target.device
    elif isinstance(target, WorldArrays):
        num_worlds, device = world_count(target)
    else:
        raise WarpcamError(
            "randomize: target must be a scene, renderer.camera(...) or rig.parameters(...), got "
            f"{type(target).__name__}"
        )
    if not isinstance(by_world, bool | np.bool_):
        raise WarpcamError(f"randomize: by_world must be True or False, got {by_world!r}")
    if not recipes:
        raise WarpcamError("randomize: no recipe came; give some, like light_intensity=(0.5, 1.5)")
    if target not in _randomizers:
        _randomizers[target] = Randomizer(num_worlds, device)
    state = _randomizers[target]
    capturing = torch_interop.is_capturing(device)
    given = _seeds(state, seed)
    seeds = state.seeds[1 if given is None else len(given)]
    stages = [_stage(state, target, name, recipe, seeds, bool(by_world), capturing) for name, recipe in recipes.items()]
    with torch_interop.in_order(device):
        if worlds is None:
            state.selection.mask.fill_(1)
        else:
            state.selection.select(worlds, capturing, "randomize")
        if given is None:
            seeds.fill_(int(seed))
        else:
            wp.copy(seeds, given)
        for stage in stages:
            stage.launch()


def _seeds(state: Randomizer, seed: Any) -> wp.array | None:
    """The array that was given, None for a number."""
    array = torch_interop.as_array(seed)
    if array is None:
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not -(2**31) <= seed < 2**31:
            allowed = "a whole number of 32 bits, -2^31 to 2^31 - 1, or an int32 tensor"
            raise WarpcamError(f"randomize: seed must be {allowed}, got {seed!r}")
        return None
    device_rule.require_same(state.device, "the scene is", array.device, "randomize: seed")
    if array.dtype is not wp.int32 or tuple(array.shape) not in ((1,), (state.num_worlds,)):
        raise WarpcamError(
            f"randomize: seed must be int32 of shape (1,) or ({state.num_worlds},), got {array.dtype.__name__} of "
            f"{tuple(array.shape)}"
        )
    return array


def _stage(
    state: Randomizer, target: Any, name: str, recipe: Any, seeds: wp.array, by_world: bool, capturing: bool
) -> Stage:
    if isinstance(recipe, tuple) and len(recipe) == 2:
        recipe = Uniform(*recipe)
    elif isinstance(recipe, list):
        recipe = Choice(recipe)
    if not isinstance(recipe, Uniform | Choice):
        raise WarpcamError(f"randomize: {name} must be (low, high), a list, Uniform or Choice, got {recipe!r}")
    rows = None if recipe.rows is None else _whole(f"{name}: rows", recipe.rows, truths=False)
    if isinstance(recipe, Choice):
        what: tuple[Any, ...] = (_whole(f"{name}: what is chosen from", recipe.values),)
    else:
        if not isinstance(recipe.linked, bool | np.bool_):
            raise WarpcamError(f"randomize: {name}: linked must be True or False, got {recipe.linked!r}")
        if not isinstance(recipe.of, str) or recipe.of not in KINDS:
            raise WarpcamError(f"randomize: {name}: of must be one of {', '.join(map(repr, KINDS))}, got {recipe.of!r}")
        what = (_bounds(name, recipe.low), _bounds(name, recipe.high), recipe.of, bool(recipe.linked))
    key = (name, what, rows, len(seeds), by_world)
    stage = state.stages.get(key)
    if stage is None:
        if capturing:
            raise WarpcamError(f"randomize: a capture is under way, and {name} is new; call it once before")
        stage = _record(state, target, name, recipe=recipe, what=what, rows=rows, seeds=seeds, by_world=by_world)
        stage.prepare()
    return state.keep(key, stage, capturing)


def _whole(what: str, values: Any, truths: bool = True) -> tuple[int, ...]:
    """Return a sequence as whole numbers; ``truths`` allows booleans, which are 1 and 0."""
    try:
        plain = [value.item() if isinstance(value, np.bool_) else value for value in values]
        if not truths and any(isinstance(value, bool) for value in plain):
            raise TypeError
        return tuple(map(operator.index, plain))
    except TypeError:
        raise WarpcamError(f"randomize: {what} must be whole numbers, got {values!r}") from None


def _bounds(name: str, value: Any) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Their shape, and they themselves one after another."""
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        numbers = np.full(1, np.nan)
    # What float32 cannot hold is not finite.
    if not (np.abs(numbers) <= np.finfo(np.float32).max).all() or not numbers.size:
        raise WarpcamError(f"randomize: {name}: bounds must be finite numbers, got {value!r}")
    return numbers.shape, tuple(numbers.ravel().tolist())


def _array(target: Any, name: str) -> tuple[wp.array, tuple[int, ...]]:
    """The attribute's memory as (world, row, width), and the shape of an entry."""
    if isinstance(target, Scene):
        tensor = target.vary(name)
        single = name in SINGLE
    else:
        tensor, single = getattr(target, name), True
    rows, entry = (1, tensor.shape[1:]) if single else (tensor.shape[1], tensor.shape[2:])
    array: Any = torch_interop.as_array(tensor.reshape(tensor.shape[0], rows, math.prod(entry)))
    return array.view(wp.uint8) if array.dtype is wp.bool else array, tuple(entry)


def _record(
    state: Randomizer,
    target: Any,
    name: str,
    recipe: Uniform | Choice,
    what: tuple[Any, ...],
    rows: tuple[int, ...] | None,
    seeds: wp.array,
    by_world: bool,
) -> Stage:
    (out, entry), device = _array(target, name), state.device
    count, width = out.shape[1:]
    numbers = out.dtype is wp.float32
    if rows is not None and (not rows or min(rows) < 0 or max(rows) >= count or len(set(rows)) < len(rows)):
        raise WarpcamError(
            f"randomize: {name}: rows must be different indices from 0 to {count - 1}, got {recipe.rows!r}"
        )
    if numbers != isinstance(recipe, Uniform):
        needed = "Uniform or (low, high)" if numbers else "Choice or a list of whole numbers"
        raise WarpcamError(f"randomize: {name} takes {needed}, got {recipe!r}")
    draw = kernels.Draw()
    draw.mask, draw.seeds, draw.by_world = state.selection.mask, seeds, int(by_world)
    owners = target.owners() if isinstance(target, Scene) and name.startswith("shape_") else np.arange(count)
    written = np.arange(count)
    if rows is not None:
        written = np.flatnonzero(np.isin(written, rows) | np.isin(owners, rows))
    draw.rows = wp.array(written, dtype=wp.int32, device=device)
    draw.owners = wp.array(owners[written], dtype=wp.int32, device=device)
    draw.salt = wp.int32(np.uint32(crc32(name.encode())).view(np.int32))
    draw.low, draw.high = (wp.zeros(1, dtype=wp.float32, device=device) for _ in range(2))
    if isinstance(recipe, Choice):
        if not what[0]:
            raise WarpcamError(f"randomize: {name}: a choice needs at least one value")
        most = target.count_of(name) if isinstance(target, Scene) else None
        if most is not None and (min(what[0]) < -1 or max(what[0]) >= most):
            allowed = f"-1 for none and 0 to {most - 1}" if most else "-1 for none alone"
            raise WarpcamError(f"randomize: {name}: a choice of indices takes {allowed}, got {recipe.values!r}")
        limits = ranges_of(target).get(name) if isinstance(target, WorldArrays) else None
        if limits is not None and not limits[0] <= min(what[0]) <= max(what[0]) <= limits[1]:
            raise WarpcamError(
                f"randomize: {name}: a choice takes whole numbers from {limits[0]:g} to {limits[1]:g}, got "
                f"{recipe.values!r}"
            )
        if name == "skybox" and isinstance(target, Scene) and set(what[0]) - {-1, *target.cubes()}:
            cubes = ", ".join(map(str, target.cubes()))
            raise WarpcamError(f"randomize: skybox takes -1 for none and cube textures, {cubes}, got {recipe.values!r}")
        if out.dtype is wp.uint8 and not set(what[0]) <= {0, 1}:
            raise WarpcamError(f"randomize: {name}: a choice of on and off takes 1 and 0, got {recipe.values!r}")
        choices = wp.array(np.array(what[0]), dtype=wp.int32, device=device)
        column = ROLE_COLOR if name == "material_texture" else 0
        return kernels.bind_draw(draw, out, choices, device, column)
    shapes, bounds = zip(*what[:2], strict=True)
    low, high = (numbers * width if len(numbers) == 1 else numbers for numbers in bounds)
    if recipe.of == "turn" and (name not in TURNED or not set(shapes) <= {(), (1,)}):
        raise WarpcamError(f"randomize: {name}: only {' and '.join(TURNED)} turn, by angles from low to high [degrees]")
    if recipe.of != "turn" and not set(shapes) <= {(), (1,), (width,), entry}:
        raise WarpcamError(
            f"randomize: {name}: bounds must be a number or {width}, got {recipe.low!r}, {recipe.high!r}"
        )
    if any(one > other for one, other in zip(low, high, strict=True)):
        raise WarpcamError(f"randomize: {name}: low must not be above high, got {recipe.low!r}, {recipe.high!r}")
    ranges = ranges_of(target) if isinstance(target, WorldArrays) else {}
    lowest, highest = ranges.get(name, RANGES.get(name, (-math.inf, math.inf)))
    beyond = min(low) < lowest or max(high) > highest
    turned_round = lowest == 0.0 and min(low) < 0.0
    if (recipe.of == "value" and beyond) or (recipe.of == "factor" and turned_round):
        allowed = f"from {lowest:g} to {highest:g}" if lowest > -math.inf else f"at most {highest:g}"
        raise WarpcamError(f"randomize: {name}: {recipe.of}s must be {allowed}, got {recipe.low!r}, {recipe.high!r}")
    draw.low, draw.high = (wp.array(np.array(values), dtype=wp.float32, device=device) for values in (low, high))
    draw.kind, draw.linked = KINDS[recipe.of], int(recipe.linked)
    if recipe.of == "value":
        return kernels.bind_draw(draw, out, out, device)
    if name not in state.nominal:
        state.nominal[name] = wp.clone(out)
    return kernels.bind_draw(draw, out, state.nominal[name], device)
