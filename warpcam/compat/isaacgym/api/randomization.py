"""Random properties as Isaac Gym's ``gymutil`` makes them: numbers by a table, added to or multiplied with the first.

A table of one number has "range", "distribution" ("uniform", "loguniform", "gaussian"), "operation" ("additive",
"scaling"), and may have "schedule" ("linear", "constant") with "schedule_steps", and "num_buckets".
"""
# ruff: noqa: NPY002, programs seed numpy's own

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from warpcam.compat.isaacgym.api.params import SimParams
from warpcam.core.errors import WarpcamError

Table = Mapping[str, Any]
MOST_SURFACES = 64000


def get_property_setter_map(gym: Any) -> dict[str, Callable[..., Any]]:
    """The call that sets each kind of property."""
    return {
        "dof_properties": gym.set_actor_dof_properties,
        "tendon_properties": gym.set_actor_tendon_properties,
        "rigid_body_properties": gym.set_actor_rigid_body_properties,
        "rigid_shape_properties": gym.set_actor_rigid_shape_properties,
        "sim_params": gym.set_sim_params,
    }


def get_property_getter_map(gym: Any) -> dict[str, Callable[..., Any]]:
    """The call that gets each kind of property."""
    return {
        "dof_properties": gym.get_actor_dof_properties,
        "tendon_properties": gym.get_actor_tendon_properties,
        "rigid_body_properties": gym.get_actor_rigid_body_properties,
        "rigid_shape_properties": gym.get_actor_rigid_shape_properties,
        "sim_params": gym.get_sim_params,
    }


def get_default_setter_args(gym: Any) -> dict[str, list[Any]]:
    """Return the arguments of each setter beside the properties: inertias grow as masses do."""
    return {name: [True] if name == "rigid_body_properties" else [] for name in get_property_setter_map(gym)}


def generate_random_samples(
    attr_randomization_params: Table, shape: Any, curr_gym_step_count: int, extern_sample: Any = None
) -> Any:
    """Numbers by a table, of a shape, or those that are given, as far as the schedule has come by this step."""
    table = attr_randomization_params
    neutral = {"additive": 0.0, "scaling": 1.0}[_one(table, "operation", ("additive", "scaling"))]
    share = _share(table, curr_gym_step_count)
    if extern_sample is not None:
        return neutral + (extern_sample - neutral) * share
    first, second = (float(value) for value in table["range"])
    first = neutral + (first - neutral) * share
    kind = _one(table, "distribution", ("uniform", "loguniform", "gaussian"))
    if kind == "gaussian":
        return np.random.normal(first, second * share, shape)
    second = neutral + (second - neutral) * share
    if kind == "uniform":
        return np.random.uniform(first, second, shape)
    return np.exp(np.random.uniform(np.log(first), np.log(second), shape))


def apply_random_samples(
    prop: Any,
    og_prop: Any,
    attr: str,
    attr_randomization_params: Table,
    curr_gym_step_count: int,
    extern_sample: Any = None,
    bucketing_randomization_params: Table | None = None,
) -> None:
    """Set one of a property's numbers.

    Args:
        prop: To be changed: ``SimParams`` (gravity, rest_offset), an array of properties of degrees of freedom, or
            those of a body or a shape.
        og_prop: As they were at first, by name.
        attr: Which one.
        attr_randomization_params: Its table.
        curr_gym_step_count: Steps so far, for the schedule.
        extern_sample: In place of random numbers.
        bucketing_randomization_params: The table that buckets are made of, if not the same.
    """
    table, step = attr_randomization_params, curr_gym_step_count
    scales = _one(table, "operation", ("additive", "scaling")) == "scaling"
    if isinstance(prop, SimParams):
        if attr == "gravity":
            sample = generate_random_samples(table, 3, step)
            first = np.array(tuple(og_prop["gravity"]))
            prop.gravity.x, prop.gravity.y, prop.gravity.z = first * sample if scales else first + sample
        elif attr == "rest_offset":
            prop.physx.rest_offset = float(generate_random_samples(table, None, step))
        else:
            raise WarpcamError(f"apply_random_samples: of SimParams gravity and rest_offset may change, not {attr!r}")
        return
    is_array = isinstance(prop, np.ndarray)
    sample = generate_random_samples(table, prop[attr].shape if is_array else None, step, extern_sample)
    value = og_prop[attr] * sample if scales else og_prop[attr] + sample
    if table.get("num_buckets", 0) > 0:
        buckets = table if is_array or bucketing_randomization_params is None else bucketing_randomization_params
        value = _bucketed(value, buckets)
    if is_array:
        prop[attr] = value
    else:
        setattr(prop, attr, float(np.asarray(value).item()))


def check_buckets(gym: Any, envs: Sequence[Any], dr_params: Table) -> None:
    """Raise where Isaac Gym would have too many surfaces for PhysX, so that a table that runs here runs there."""
    tables, buckets = dr_params["actor_params"], 0
    for properties in tables.values():
        attributes = properties.get("rigid_shape_properties", {})
        counts = [attributes.get(name, {}).get("num_buckets", 0) for name in ("restitution", "friction")]
        buckets += max(counts[0], 1) * max(counts[1], 1) if any(counts) else 0
    shapes = 0
    for env in envs:
        for actor in range(gym.get_actor_count(env)):
            handle = gym.get_actor_handle(env, actor)
            if "rigid_shape_properties" in tables.get(gym.get_actor_name(env, handle), {}):
                shapes += gym.get_actor_rigid_shape_count(env, handle)
    if buckets > MOST_SURFACES or (shapes > MOST_SURFACES and not buckets):
        raise WarpcamError(
            f"check_buckets: at most {MOST_SURFACES} surfaces may differ, got {buckets or shapes}; num_buckets of "
            "friction and restitution make them fewer"
        )


def _share(table: Table, step: int) -> float:
    """Return the progress of the schedule, from 0 to 1."""
    if "schedule" not in table or table["schedule"] is None:
        return 1.0
    last = table["schedule_steps"]
    if _one(table, "schedule", ("linear", "constant")) == "linear":
        return min(step, last) / last
    return float(step >= last)


def _bucketed(values: Any, table: Table) -> Any:
    """Each as the lower end of the bucket that it is in."""
    first, second = table["range"]
    if table["distribution"] == "gaussian":
        first, second = first - 2.0 * np.sqrt(second), first + 2.0 * np.sqrt(second)
    starts = np.linspace(first, second, table["num_buckets"], endpoint=False)
    return starts[np.maximum(np.searchsorted(starts, values, side="right") - 1, 0)]


def _one(table: Table, name: str, allowed: Sequence[str]) -> str:
    if table.get(name) not in allowed:
        raise WarpcamError(f"{name} {table.get(name)!r} came; allowed are {', '.join(allowed)}")
    return str(table[name])
