"""Sensors of a recipe: effects by name, and a rig whose noise follows from the sample alone."""

import dataclasses
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from warpcam import sensors
from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate.recipes import SensorRecipe
from warpcam.sensors.depth_cameras import CAMERA_MODELS

EFFECTS: Mapping[str, type] = {
    name: value
    for name, value in vars(sensors).items()
    if isinstance(value, type) and issubclass(value, sensors.Effect) and value is not sensors.Effect
}


def effects_of(recipe: SensorRecipe, where: str) -> tuple[sensors.Effect, ...]:
    """The effects of a recipe, those of a model first."""
    effects: list[sensors.Effect] = []
    if recipe.model is not None:
        if recipe.model not in CAMERA_MODELS:
            raise WarpcamError(f"{where}: model must be one of {', '.join(CAMERA_MODELS)}, got {recipe.model!r}")
        effects += CAMERA_MODELS[recipe.model]().effects
    for given in recipe.effects:
        settings = dict(given)
        effects.append(_effect(settings.pop("name"), settings, where))
    if not effects:
        raise WarpcamError(f"{where}: a model or effects are needed")
    if any(effect.kind == "delivery" for effect in effects):
        raise WarpcamError(f"{where}: samples have no time, so no effect may delay images")
    return tuple(effects)


def outputs_of(effects: Sequence[sensors.Effect]) -> tuple[str, ...]:
    """Outputs that effects read beside those that they change."""
    return tuple(dict.fromkeys(name for effect in effects for name in effect.reads))


def _effect(name: str, settings: dict[str, Any], where: str) -> sensors.Effect:
    if name not in EFFECTS:
        near = get_close_matches(str(name), EFFECTS, 1)
        hint = f", did you mean {near[0]!r}?" if near else ""
        raise WarpcamError(f"{where}: there is no effect {name!r}{hint}; there are {', '.join(sorted(EFFECTS))}")
    known = [each.name for each in dataclasses.fields(EFFECTS[name]) if each.init]
    for key in settings:
        if key not in known:
            raise WarpcamError(f"{where}: {name} has no parameter {key!r}; it has {', '.join(known)}")
    try:
        return EFFECTS[name](**settings)
    except TypeError as error:
        raise WarpcamError(f"{where}: {name}: {error}") from None
