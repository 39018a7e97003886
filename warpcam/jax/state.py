"""Arrays of a state and a model as users give them: a mapping by MuJoCo's names, or MJX's Data and Model."""

from collections.abc import Collection, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.jax.drawing import Input

BODIES = {"xpos": (3,), "xquat": (4,), "xmat": (3, 3), "subtree_com": (3,)}  # shape of a body's numbers


def read(owner: Any, what: str, names: Collection[str], known: Collection[str]) -> dict[str, Any]:
    """Return those of the arrays that there are.

    Args:
        owner: The user's mapping or object.
        what: Its name in errors.
        names: What is looked for.
        known: Names that a mapping may have.
    """
    if isinstance(owner, Mapping):
        if wrong := [name for name in owner if name not in known]:
            raise WarpcamError(f"render: {what} has {wrong[0]!r}; known are {', '.join(sorted(known))}")
        return {name: owner[name] for name in names if name in owner}
    fields = getattr(owner, "__dict__", {})
    inner = fields.get("_impl")  # where MJX has what only one of its implementations holds
    found = {name: fields[name] if name in fields else getattr(inner, name, None) for name in names}
    found = {name: array for name, array in found.items() if hasattr(array, "shape")}
    if not found:
        raise WarpcamError(
            f"render: {what} must be an mjx.{what.capitalize()} or a mapping of arrays by MuJoCo's names, got "
            f"{type(owner).__name__}"
        )
    return found


def leading(array: Any, dims: tuple[int, ...], name: str) -> tuple[int, ...]:
    """Shape of the worlds of an array, whose last dimensions must be ``dims``."""
    shape = np.shape(array)
    split = len(shape) - len(dims)
    if split < 0 or shape[split:] != dims:
        raise WarpcamError(f"render: {name} must be (..., {', '.join(map(str, dims))}), got {shape}")
    return shape[:split]


def numbers(array: Any, dtype: Any, name: str) -> Any:
    """Return the array with the dtype that kernels read."""
    values = array if isinstance(array, jax.Array) else jnp.asarray(array)
    real, wanted = jnp.issubdtype(values.dtype, jnp.floating), jnp.issubdtype(dtype, jnp.floating)
    if real and not wanted:
        raise WarpcamError(f"render: {name} must be {np.dtype(dtype).name}, got {values.dtype}")
    return values.astype(dtype)


def differs(array: Any, own: Any) -> bool:
    """Whether an array may hold other numbers than the host's model: so if it is not known before the program runs."""
    if isinstance(array, jax.core.Tracer):
        return True
    host = np.asarray(array)
    return host.size != own.size or not np.array_equal(host.ravel(), own.ravel().astype(host.dtype))


def arranged(array: Any, given: Input, worlds: tuple[int, ...], own: tuple[int, ...], count: int) -> Any:
    """Return an array as the primitive takes it: (world, ...), or (1, ...) where one row may stand for all."""
    if given.is_shared and not own:
        return array[None]
    return jnp.broadcast_to(array, (*worlds, *given.dims)).reshape(count, *given.dims)
