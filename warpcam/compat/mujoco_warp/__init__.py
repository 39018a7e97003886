"""MuJoCo-Warp's renderer, by the calls it has: ``from warpcam.compat import mujoco_warp as mjr``.

``create_render_context``, ``refit_bvh``, ``render``, ``get_rgb``, ``get_depth``, ``get_segmentation``, ``rays`` and
``ray`` take the same arguments, and images are packed alike. What is drawn looks as ``mujoco.Renderer`` draws it: see
docs/compat/mujoco_warp.md. All other names are MuJoCo-Warp's own: ``mjr.put_model`` is ``mujoco_warp.put_model``.
"""

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import warp as wp

from warpcam.compat.common import packing
from warpcam.compat.common.scalars import real, whole
from warpcam.compat.mujoco_warp.arguments import check_settings, read_views
from warpcam.compat.mujoco_warp.context import RenderContext
from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import launch_kernel

__all__ = [
    "RenderContext",
    "create_render_context",
    "get_depth",
    "get_rgb",
    "get_segmentation",
    "ray",
    "rays",
    "refit_bvh",
    "refit_splat_bvh",
    "render",
]


def __getattr__(name: str) -> Any:
    """Return the simulator's attribute for a name that is not about rendering."""
    message = f"neither warpcam.compat.mujoco_warp nor mujoco_warp has {name!r}"
    if name.startswith("_"):
        raise AttributeError(message)
    try:
        import mujoco_warp
    except ImportError as error:
        raise AttributeError(f"warpcam.compat.mujoco_warp has no {name!r}, and MuJoCo-Warp is not installed") from error
    if not hasattr(mujoco_warp, name):
        raise AttributeError(message)
    return getattr(mujoco_warp, name)


def create_render_context(
    mjm: mujoco.MjModel,
    nworld: int = 1,
    cam_res: Any = None,
    render_rgb: Any = None,
    render_depth: Any = None,
    render_seg: Any = None,
    use_textures: bool = True,
    use_fast_math: bool = True,
    use_shadows: bool = False,
    use_ambient_lighting: bool = True,
    enabled_geom_groups: Sequence[int] = (0, 1, 2),
    cam_active: Any = None,
    background_color: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
    flex_render_smooth: bool = True,
    use_precomputed_rays: bool = True,
    render_skybox: bool = False,
    enable_backface_culling: bool = True,
    shadow_light_fraction: float = 0.3,
    samples_per_pixel: int = 1,
    enable_vertex_normals: bool = True,
    enable_specular: bool = True,
    enable_emission: bool = True,
    enable_per_light_ambient: bool = True,
    splat_position: Any = None,
    splat_rotation: Any = None,
    splat_scale: Any = None,
    splat_rgba: Any = None,
    splat_adr: Any = None,
    splat_group_id: Any = None,
    deterministic: bool = False,
    *,
    draw: Sequence[str] = ("geoms", "flexes"),
    reflections: bool | None = None,
    transparency: bool | None = None,
) -> RenderContext:
    """A context on Warp's current device, with the images that ``render`` writes.

    Args:
        mjm: The host's model.
        nworld: How many worlds.
        cam_res: (width, height) of all cameras, or a list of one for all or one for each; None is the model's.
        render_rgb: Whether to render colour: for all cameras, or a list for each; None is what the model's cameras say.
        render_depth: Likewise depth.
        render_seg: Likewise segmentation.
        use_textures: Whether materials show their textures.
        use_fast_math: Changes nothing.
        use_shadows: Whether lights cast shadows.
        use_ambient_lighting: False leaves out all ambient light.
        enabled_geom_groups: Groups that are drawn.
        cam_active: Cameras to render: a bool for each, or names or ids; None is all.
        background_color: Red, green, blue, alpha in [0, 1] where nothing is hit and no skybox is drawn.
        flex_render_smooth: Only True.
        use_precomputed_rays: Changes nothing: lenses of each world are always followed.
        render_skybox: Whether to draw the model's skybox, if it has one.
        enable_backface_culling: Only True.
        shadow_light_fraction: 0.3, its default, and 0 are the same: a shadow is without its light, as in MuJoCo.
        samples_per_pixel: Along a pixel's side: 1, 2 for smooth edges, or 4 or 8, for shapes thinner than a pixel.
        enable_vertex_normals: Only True.
        enable_specular: False leaves out highlights.
        enable_emission: False leaves out what materials emit.
        enable_per_light_ambient: False leaves out the ambient light of lights, but for the headlight's.
        splat_position: (n, 3), centres of Gaussians in the world [m]; None: there are none.
        splat_rotation: (n, 4), quaternions w x y z.
        splat_scale: (n, 3), standard deviations along the axes [m].
        splat_rgba: (n, 4), display colour and opacity, the latter in [0, 1].
        splat_adr: (groups + 1,) int, ascending from 0 to n, where in these arrays each group begins and the last one
            ends; None is one group.
        splat_group_id: (nworld,) int, the group of each world; None is the first.
        deterministic: Changes nothing: images always are the same.
        draw: What is drawn: see ``warpcam.from_mujoco_warp``. MuJoCo-Warp has neither this nor what follows.
        reflections: See ``warpcam.from_mujoco_warp``.
        transparency: See ``warpcam.from_mujoco_warp``.

    Raises:
        WarpcamError: An argument cannot be used, or asks for what is not offered.
    """
    settings = dict(locals())
    del settings["mjm"]
    if not isinstance(mjm, mujoco.MjModel):
        raise WarpcamError(f"create_render_context: mjm must be a mujoco.MjModel, got {type(mjm).__name__}")
    check_settings(settings)
    return RenderContext(mjm, int(nworld), read_views(mjm, settings), settings)


def refit_bvh(m: Any, d: Any, rc: RenderContext) -> None:
    """Nothing needs refitting; the first call for a Model and a Data reads them, as ``RenderContext.bind`` does."""
    _context(rc, "refit_bvh").bind(m, d)


def refit_splat_bvh(rc: RenderContext) -> None:
    """Draw the Gaussians as the arrays ``rc.splat_position`` and so on have them now. It may be part of a capture."""
    _context(rc, "refit_splat_bvh").refit_splats()


def render(m: Any, d: Any, rc: RenderContext) -> None:
    """Render the state as it is now into the context's images. It may be part of a capture."""
    _context(rc, "render")._bound(m, d).render()


def rays(
    m: Any,
    d: Any,
    pnt: wp.array,
    vec: wp.array,
    geomgroup: Any,
    flg_static: bool,
    bodyexclude: wp.array,
    dist: wp.array,
    geomid: wp.array,
    normal: wp.array,
    rc: Any = None,
) -> None:
    """Cast rays into the geoms of a context of ours; without one, or with MuJoCo-Warp's own, by ``mujoco_warp.rays``.

    The first call with such rays reads the scene and allocates; those after it do not, and may be part of a capture.

    Args:
        m: The Model.
        d: The Data.
        pnt: vec3 (1 or world, ray), where rays begin [m].
        vec: vec3 of the same shape, of any length; what is hit is at ``pnt + dist * vec``.
        geomgroup: Six numbers, 0 for a group that is left out; all -1: none is.
        flg_static: False leaves out geoms that never move.
        bodyexclude: int32 (ray,), body that each ray does not meet, or -1. Read when this array is first seen: of rays
            for which it was written since, ``dist`` is NaN.
        dist: float32 (world, ray), written: -1 where nothing is hit.
        geomid: int32 (world, ray), written: -1 where nothing is hit.
        normal: vec3 (world, ray), written: 0 where nothing is hit.
        rc: The context.
    """
    if not isinstance(rc, RenderContext):
        _theirs("rays")(m, d, pnt, vec, geomgroup, flg_static, bodyexclude, dist, geomid, normal, rc)
        return
    rc.cast_rays(m, d, pnt, vec, geomgroup, flg_static, bodyexclude, dist, geomid, normal)


def ray(
    m: Any,
    d: Any,
    pnt: wp.array,
    vec: wp.array,
    geomgroup: Any = None,
    flg_static: bool = True,
    bodyexclude: int = -1,
    rc: Any = None,
) -> tuple[wp.array, wp.array, wp.array]:
    """Cast one ray in every world, as ``rays`` does.

    Args:
        m: The Model.
        d: The Data.
        pnt: vec3 (1 or world, 1) [m].
        vec: vec3 of the same shape.
        geomgroup: As ``rays`` has it; None: no group is left out.
        flg_static: As ``rays`` has it.
        bodyexclude: Body that rays do not meet, or -1.
        rc: The context.

    Returns:
        New arrays (world, 1): distances, geom ids, normals.
    """
    if not isinstance(rc, RenderContext):
        answer: tuple[wp.array, wp.array, wp.array] = _theirs("ray")(
            m, d, pnt, vec, geomgroup, flg_static, bodyexclude, rc
        )
        return answer
    return rc.cast_ray(m, d, pnt, vec, geomgroup, flg_static, bodyexclude)


def get_rgb(rc: RenderContext, camera_index: int, rgb_out: wp.array) -> None:
    """Unpack one camera's colours.

    Args:
        rc: The context.
        camera_index: Counts the context's cameras.
        rgb_out: vec3 (world, height, width), in [0, 1]; written.
    """
    start = _image(rc, "rgb", camera_index, rgb_out, wp.vec3)
    launch_kernel(packing.unpack_colors, rgb_out.shape, [rc.rgb_data, start], [rgb_out], device=rc.device)


def get_depth(rc: RenderContext, camera_index: int, depth_scale: float, depth_out: wp.array) -> None:
    """Copy one camera's planar depth.

    Args:
        rc: The context.
        camera_index: Counts the context's cameras.
        depth_scale: Depth that becomes 1 [m]; what is farther is 1, too.
        depth_out: float32 (world, height, width); written.
    """
    start = _image(rc, "depth", camera_index, depth_out, wp.float32)
    scale = real(depth_scale)
    if math.isnan(scale) or scale == 0.0:
        raise WarpcamError(f"get_depth: depth_scale must be a number other than 0, got {depth_scale!r}")
    inputs = [rc.depth_data, start, scale]
    launch_kernel(packing.scale_depth, depth_out.shape, inputs, [depth_out], device=rc.device)


def get_segmentation(rc: RenderContext, camera_index: int, seg_out: wp.array) -> None:
    """Copy one camera's pairs of id and ``mjtObj``.

    Args:
        rc: The context.
        camera_index: Counts the context's cameras.
        seg_out: vec2i (world, height, width); written.
    """
    start = _image(rc, "segmentation", camera_index, seg_out, wp.vec2i)
    launch_kernel(packing.copy_pairs, seg_out.shape, [rc.seg_data, start], [seg_out], device=rc.device)


def _image(rc: RenderContext, output: str, camera_index: int, out: wp.array, dtype: Any) -> int:
    """Return the start of the camera's image in a row, with ``out`` checked."""
    _context(rc, f"get_{output}")
    place = whole(camera_index)
    if place is None or not 0 <= place < rc.nrender:
        raise WarpcamError(f"camera_index is {camera_index!r}; the context's cameras are 0 to {rc.nrender - 1}")
    view, start = rc.views[place], rc.starts[output][place]
    if start < 0:
        raise WarpcamError(f"camera_index {camera_index} renders {', '.join(view.outputs) or 'nothing'}, not {output}")
    shape = (rc.nworld, view.size[1], view.size[0])
    if not isinstance(out, wp.array) or out.shape != shape or out.dtype is not dtype:
        came = f"{out.dtype.__name__} {tuple(out.shape)}" if isinstance(out, wp.array) else type(out).__name__
        raise WarpcamError(f"{output} is written to a Warp array of {dtype.__name__} {shape}, got {came}")
    device_rule.require_same(rc.device, "the render context is", out.device, f"{output}'s array")
    return start


def _theirs(name: str) -> Any:
    """MuJoCo-Warp's own function."""
    import mujoco_warp

    return getattr(mujoco_warp, name)


def _context(rc: Any, where: str) -> RenderContext:
    if not isinstance(rc, RenderContext):
        raise WarpcamError(f"{where}: rc must be what create_render_context gives, got {type(rc).__name__}")
    return rc
