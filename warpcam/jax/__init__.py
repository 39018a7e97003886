"""Cameras inside ``jax.jit`` and ``jax.vmap``: images as JAX arrays of a state that is given as JAX arrays."""

from warpcam.core.errors import WarpcamError

try:
    from warpcam.jax.renderer import Renderer
except ModuleNotFoundError as error:
    if error.name is None or error.name.partition(".")[0] not in ("jax", "jaxlib", "mujoco"):
        raise
    raise WarpcamError(
        f"{error.name} is not installed, and warpcam.jax needs it: pip install 'warpcam[jax]'"
    ) from error

__all__ = ["Renderer"]
