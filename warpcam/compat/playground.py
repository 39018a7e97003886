"""MuJoCo Playground's pictures, and those of all that renders by MJX's calls: ``playground.install()``.

``mjx.create_render_context``, ``refit_bvh``, ``render``, ``render_with_segmentation``, ``get_rgb``, ``get_depth`` and
``get_segmentation`` are rendered here from then on, so environments need no change: see docs/compat/playground.md.
"""

import copy
import inspect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx

from warpcam.compat import mujoco_warp as mjr
from warpcam.compat.common.scalars import real
from warpcam.compat.mujoco_warp.arguments import check_settings, read_views
from warpcam.compat.mujoco_warp.context import cameras_of, without_looks
from warpcam.core.errors import WarpcamError
from warpcam.jax import Renderer, state
from warpcam.jax.drawing import MODEL_FIELDS
from warpcam.jax.renderer import PLACES
from warpcam.sources.mujoco.visual_geoms import objects

__all__ = [
    "RenderContext",
    "create_render_context",
    "get_depth",
    "get_rgb",
    "get_segmentation",
    "install",
    "refit_bvh",
    "render",
    "render_with_segmentation",
    "uninstall",
]

_DEFAULTS = {
    name: parameter.default
    for name, parameter in inspect.signature(mjr.create_render_context).parameters.items()
    if name != "mjm"
}
_original: dict[str, Any] = {}  # MJX's functions, while ours are in their place


def install() -> None:
    """Have all that calls MJX's renderer from now on render here, environments that were made before excepted."""
    if _original:
        return
    for name in set(__all__) - {"RenderContext", "install", "uninstall"}:
        if hasattr(mjx, name):
            _original[name] = getattr(mjx, name)
            setattr(mjx, name, globals()[name])


def uninstall() -> None:
    """Give MJX its own functions back. Environments that have a context of ours can no longer be compiled anew."""
    while _original:
        setattr(mjx, *_original.popitem())


class RenderContext:
    """Settings and the renderer behind ``render``. Made by ``create_render_context``.

    Attributes:
        nworld: As it was given; any number of worlds is rendered.
        nrender: How many cameras are rendered.
        views: The cameras: id, size, outputs.
        starts: Where in a world's row each camera's image begins, by "rgb", "depth", "segmentation"; -1 for none.
        renderer: The ``warpcam.jax.Renderer``; None if no camera has an image.
    """

    def __init__(self, mjm: mujoco.MjModel, settings: dict[str, Any], device: Any):
        self.nworld, self.views = int(settings["nworld"]), tuple(read_views(mjm, settings))
        self.nrender = len(self.views)
        self.starts: dict[str, list[int]] = {}
        for output in ("rgb", "depth", "segmentation"):
            sizes = [view.pixels if output in view.outputs else 0 for view in self.views]
            begins = np.cumsum([0, *sizes])[:-1]
            self.starts[output] = [int(begin) if size else -1 for begin, size in zip(begins, sizes, strict=True)]
        looks, blank = without_looks(mjm, settings)
        looks = copy.copy(looks)
        for name, value in blank.items():
            getattr(looks, name)[:] = value
        self._fields = {*MODEL_FIELDS, *PLACES} - set(blank)
        self._miss_alpha = int(255.0 * settings["background_color"][3])
        self._objects = objects(mjm, 0)
        cameras, self._color = cameras_of(self.views, mjm, settings)
        self.renderer = None
        if cameras:
            self.renderer = Renderer(
                looks,
                cameras,
                device=device,
                groups=_groups(settings["enabled_geom_groups"]),
                draw=settings["draw"],
                reflections=settings["reflections"],
                transparency=settings["transparency"],
            )

    def pytree(self) -> "RenderContextPytree":
        """The handle that ``render`` and the others take."""
        return RenderContextPytree(self)

    def packed(self, m: Any, d: Any) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Images of a state, one row of each kind for all cameras; an empty one where no camera has it."""
        rows: dict[str, list[jax.Array]] = {"rgb": [], "depth": [], "segmentation": []}
        # Fields that the settings leave out are as the renderer's model has them.
        images = {} if self.renderer is None else self.renderer(d, state.read(m, "model", self._fields, ()))
        for view in self.views:
            for output in view.outputs:
                image = images[view.camera][self._color if output == "rgb" else output]
                flat = image.reshape(*image.shape[:-3], view.pixels, image.shape[-1])
                if output == "rgb":
                    rows[output].append(self._colors(flat.astype(jnp.uint32)))
                elif output == "depth":
                    rows[output].append(flat[..., 0])
                else:
                    rows[output].append(jnp.asarray(self._objects)[flat[..., 0]])
        rgb, depth, pairs = rows["rgb"], rows["depth"], rows["segmentation"]
        return (
            jnp.concatenate(rgb, axis=-1) if rgb else jnp.zeros(0, jnp.uint32),
            jnp.concatenate(depth, axis=-1) if depth else jnp.zeros(0, jnp.float32),
            jnp.concatenate(pairs, axis=-2) if pairs else jnp.zeros((0, 2), jnp.int32),
        )

    def _colors(self, bands: jax.Array) -> jax.Array:
        """Bytes B G R A of red, green, blue and, where the background is not opaque, 0 in place of its alpha."""
        alpha = jnp.uint32(255)
        if bands.shape[-1] == 4:
            alpha = jnp.where(bands[..., 3] == 0, jnp.uint32(self._miss_alpha), alpha)
        return alpha << 24 | bands[..., 0] << 16 | bands[..., 1] << 8 | bands[..., 2]


@jax.tree_util.register_static
@dataclass(frozen=True, eq=True)
class RenderContextPytree:
    """A context that programs of JAX take as they take static values."""

    context: RenderContext


def create_render_context(
    mjm: mujoco.MjModel, nworld: int = 1, devices: Sequence[str] | None = None, **settings: Any
) -> RenderContext:
    """A context for ``render``.

    Args:
        mjm: The host's model.
        nworld: How many worlds the environment means to have. Each number that is rendered gets its own memory.
        devices: Where to allocate when a program is compiled: the first of them counts. None is JAX's default device.
        settings: Those of ``warpcam.compat.mujoco_warp.create_render_context``.

    Raises:
        WarpcamError: An argument cannot be used, or asks for what is not offered.
    """
    if not isinstance(mjm, mujoco.MjModel):
        raise WarpcamError(f"create_render_context: mjm must be a mujoco.MjModel, got {type(mjm).__name__}")
    if unknown := [name for name in settings if name not in _DEFAULTS]:
        raise WarpcamError(f"create_render_context: {unknown[0]!r} is no setting; allowed are {', '.join(_DEFAULTS)}")
    merged = {**_DEFAULTS, **settings, "nworld": nworld}
    check_settings(merged)
    return RenderContext(mjm, merged, devices[0] if devices else None)


def refit_bvh(m: Any, d: Any, ctx: Any) -> Any:
    """Return ``d``: nothing needs refitting."""
    if not _is_ours(ctx, "refit_bvh"):
        return _original["refit_bvh"](m, d, ctx)
    return d


def render(m: Any, d: Any, ctx: Any) -> tuple[jax.Array, jax.Array, Any]:
    """Render packed colours and depth.

    Args:
        m: The ``mjx.Model``; its colours, materials, lights and lenses count, also where vmap gives each world its own.
        d: The ``mjx.Data``, of either implementation.
        ctx: ``RenderContext.pytree()``.

    Returns:
        uint32 (pixel,), bytes B G R A, and float32 (pixel,) [m], 0 where nothing is hit, all cameras in one row; and
        ``d``. vmap gives them a leading dimension.
    """
    if not _is_ours(ctx, "render"):
        return _original["render"](m, d, ctx)
    rgb, depth, _ = ctx.context.packed(m, d)
    return rgb, depth, d


def render_with_segmentation(m: Any, d: Any, ctx: Any) -> tuple[jax.Array, jax.Array, jax.Array, Any]:
    """Render as ``render`` does, with int32 (pixel, 2) before ``d``: id and ``mjtObj``, (-1, -1) where nothing is."""
    if not _is_ours(ctx, "render_with_segmentation"):
        return _original["render_with_segmentation"](m, d, ctx)
    if not any(start >= 0 for start in ctx.context.starts["segmentation"]):
        raise WarpcamError("render_with_segmentation: no camera of this context renders it; give render_seg=True")
    return (*ctx.context.packed(m, d), d)


def get_rgb(rc: Any, cam_id: int, rgb_data: jax.Array) -> jax.Array:
    """Colours of a camera: float32 (..., height, width, 3) in [0, 1] of packed ones (..., pixel)."""
    if not _is_ours(rc, "get_rgb"):
        return _original["get_rgb"](rc, cam_id, rgb_data)
    row = _cut(rc.context, "get_rgb", "rgb", cam_id, rgb_data)
    return jnp.stack([(row >> shift) & 0xFF for shift in (16, 8, 0)], axis=-1).astype(jnp.float32) / 255.0


def get_depth(rc: Any, cam_id: int, depth_data: jax.Array, depth_scale: float) -> jax.Array:
    """Depth of a camera as float32 (..., height, width, 1): 1 is ``depth_scale`` [m] and all beyond it."""
    if not _is_ours(rc, "get_depth"):
        return _original["get_depth"](rc, cam_id, depth_data, depth_scale)
    if not isinstance(depth_scale, jax.Array) and math.isnan(real(depth_scale)):
        raise WarpcamError(f"get_depth: depth_scale must be a number [m], got {depth_scale!r}")
    row = _cut(rc.context, "get_depth", "depth", cam_id, depth_data)
    return jnp.clip(row / depth_scale, 0.0, 1.0)[..., None]


def get_segmentation(rc: Any, cam_id: int, seg_data: jax.Array) -> jax.Array:
    """Ids of a camera, int32 (..., height, width), -1 where nothing is hit, of pairs (..., pixel, 2)."""
    if not _is_ours(rc, "get_segmentation"):
        return _original["get_segmentation"](rc, cam_id, seg_data)
    return _cut(rc.context, "get_segmentation", "segmentation", cam_id, seg_data[..., 0])


def _is_ours(ctx: Any, where: str) -> bool:
    """Whether a handle is of a context of ours; MJX's own are left to MJX while its functions are replaced."""
    if isinstance(ctx, RenderContextPytree):
        return True
    if where in _original:
        return False
    hint = "; RenderContext.pytree() gives it" if isinstance(ctx, RenderContext) else ""
    raise WarpcamError(f"{where}: ctx must be a RenderContextPytree, got {type(ctx).__name__}{hint}")


def _cut(context: RenderContext, where: str, output: str, camera: Any, rows: jax.Array) -> jax.Array:
    """The image of one camera, (..., height, width), out of rows (..., pixel)."""
    if not isinstance(camera, int | np.integer) or isinstance(camera, bool) or not 0 <= camera < context.nrender:
        raise WarpcamError(f"{where}: cam_id must be from 0 to {context.nrender - 1}, got {camera!r}")
    start, view = context.starts[output][camera], context.views[camera]
    if start < 0:
        raise WarpcamError(f"{where}: camera {camera} of this context renders {', '.join(view.outputs) or 'nothing'}")
    whole = max(one.pixels + begin for one, begin in zip(context.views, context.starts[output], strict=True))
    if rows.shape[-1:] != (whole,):
        name = {"rgb": "rgb_data", "depth": "depth_data", "segmentation": "seg_data"}[output]
        raise WarpcamError(f"{where}: {name} must be (..., {whole}), got {rows.shape}")
    width, height = view.size
    image = jax.lax.slice_in_dim(rows, start, start + view.pixels, axis=rows.ndim - 1)
    return image.reshape(*rows.shape[:-1], height, width)


def _groups(groups: Sequence[int]) -> dict[str, list[int]]:
    """Groups of geoms and of all else."""
    wrong = [group for group in groups if not 0 <= group < 6]
    if wrong:
        raise WarpcamError(f"create_render_context: enabled_geom_groups must be from 0 to 5, got {wrong[0]}")
    return {kind: list(groups) for kind in ("geoms", "sites", "tendons", "flexes", "skins")}
