"""JAX's side of a call: one primitive, which vmap gives more worlds, and which XLA runs through Warp's FFI."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from warpcam.core.errors import WarpcamError
from warpcam.jax.calls import Calls
from warpcam.jax.drawing import Input

# Arguments are arrays (world, ...) or, if `is_shared` says so, (1, ...); results are images (world, height, width,
# channels).
render_p = Primitive("warpcam_render")
render_p.multiple_results = True


def render(arrays: Sequence[jax.Array], calls: Calls, inputs: tuple[Input, ...]) -> list[jax.Array]:
    """Images of the worlds that the arrays are of, in the order of the recipe's outputs."""
    return render_p.bind(*arrays, calls=calls, inputs=inputs)


@render_p.def_abstract_eval  # type: ignore[untyped-decorator]
def _shapes(*arrays: Any, calls: Calls, inputs: tuple[Input, ...]) -> list[Any]:
    worlds = max(array.shape[0] for array in arrays)
    outputs = zip(calls.recipe.outputs, calls.dtypes, strict=True)
    return [jax.core.ShapedArray((worlds, *shape), dtype) for (_, _, shape), dtype in outputs]


def _call(*arrays: Any, calls: Calls, inputs: tuple[Input, ...]) -> list[Any]:
    drawings = calls.drawings(inputs, tuple(array.shape[0] for array in arrays))
    return drawings.call(*arrays)


def _lower(context: Any, *arrays: Any, calls: Calls, inputs: tuple[Input, ...]) -> Any:
    """Allocate and compile for the device that is likely, and leave the rest to XLA's program."""
    rows = tuple(aval.shape[0] for aval in context.avals_in)
    platforms = context.module_context.platforms
    calls.drawings(inputs, rows).on(calls.device_of(platforms[0]))
    return mlir.lower_fun(_call, multiple_results=True)(context, *arrays, calls=calls, inputs=inputs)


def _more_worlds(arrays: Any, axes: Any, *, calls: Calls, inputs: tuple[Input, ...]) -> Any:
    """One call for the worlds of all instances: of each instance in turn all there were."""
    size = next(array.shape[axis] for array, axis in zip(arrays, axes, strict=True) if axis is not None)
    batched = [
        array if axis is None else jnp.moveaxis(array, axis, 0) for array, axis in zip(arrays, axes, strict=True)
    ]
    worlds = max(array.shape[int(axis is not None)] for array, axis in zip(batched, axes, strict=True))
    given = []
    for array, axis, each in zip(batched, axes, inputs, strict=True):
        if axis is None and each.is_shared and array.shape[0] == 1:
            given.append(array)
            continue
        everywhere = array if axis is not None else array[None]
        full = jnp.broadcast_to(everywhere, (size, worlds, *everywhere.shape[2:]))
        given.append(full.reshape(size * worlds, *full.shape[2:]))
    images = render(given, calls, inputs)
    return [image.reshape(size, worlds, *image.shape[1:]) for image in images], [0] * len(images)


def _no_gradients(*_: Any, **__: Any) -> Any:
    raise WarpcamError(
        "render: images have no gradients; give it jax.lax.stop_gradient(data) where what is differentiated depends on "
        "images"
    )


def _evaluate(*arrays: Any, calls: Calls, inputs: tuple[Input, ...]) -> Any:
    return calls.compiled(render, inputs)(arrays)


render_p.def_impl(_evaluate)
mlir.register_lowering(render_p, _lower)
batching.primitive_batchers[render_p] = _more_worlds
ad.primitive_jvps[render_p] = _no_gradients
