"""The arguments of ``create_render_context``, checked: which cameras, of what size, with which images."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from warpcam.compat.common.scalars import whole
from warpcam.core.errors import WarpcamError
from warpcam.sources.mujoco.visual_geoms import check_kinds

# Options whose other value would change images in a way that is not offered, and what is drawn instead.
FIXED = {
    "enable_backface_culling": "faces seen from inside a shape are never drawn",
    "enable_vertex_normals": "meshes are lit as MuJoCo lights them, by the normals of their vertices",
    "flex_render_smooth": "flexes are lit as their own flatskin says",
}
SPLATS = ("splat_position", "splat_rotation", "splat_scale", "splat_rgba", "splat_adr", "splat_group_id")
WHERE = "create_render_context"


@dataclass(frozen=True)
class View:
    """One camera of a context.

    Attributes:
        camera: Its id in the model.
        size: Width and height [pixels].
        outputs: Of "rgb", "depth", "segmentation".
    """

    camera: int
    size: tuple[int, int]
    outputs: tuple[str, ...]

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]


def read_views(mjm: mujoco.MjModel, settings: dict[str, Any]) -> list[View]:
    """The cameras that the arguments ask for."""
    ids = _active(mjm, settings["cam_active"])
    sizes = _sizes(mjm, ids, settings["cam_res"])
    bits = mujoco.mjtCamOutBit
    asked = {
        "rgb": _each("render_rgb", settings, mjm, ids, bits.mjCAMOUT_RGB),
        "depth": _each("render_depth", settings, mjm, ids, bits.mjCAMOUT_DEPTH),
        "segmentation": _each("render_seg", settings, mjm, ids, bits.mjCAMOUT_SEG),
    }
    return [
        View(camera, sizes[place], tuple(name for name, flags in asked.items() if flags[place]))
        for place, camera in enumerate(ids)
    ]


def check_settings(settings: dict[str, Any]) -> None:
    """Raise for what is not offered; groups become a list."""
    for name, instead in FIXED.items():
        if not settings[name]:
            raise WarpcamError(f"{WHERE}: {name}=False is not offered: {instead}; allowed is True")
    if settings["samples_per_pixel"] not in (1, 2, 4, 8):
        came = settings["samples_per_pixel"]
        raise WarpcamError(f"{WHERE}: samples_per_pixel is {came!r}; allowed are 1, 2, 4 and 8, along a side")
    if settings["shadow_light_fraction"] not in (0.0, 0.3):
        raise WarpcamError(
            f"{WHERE}: shadow_light_fraction is {settings['shadow_light_fraction']!r}; a shadow is without its light, "
            "as in MuJoCo; allowed are 0 and the default, 0.3, which means the same"
        )
    nworld = settings["nworld"]
    if isinstance(nworld, bool) or not isinstance(nworld, int | np.integer) or nworld < 1:
        raise WarpcamError(f"{WHERE}: nworld must be a whole number, at least 1, got {nworld!r}")
    settings["enabled_geom_groups"] = read_groups(WHERE, settings["enabled_geom_groups"])
    try:
        check_kinds(settings["draw"])
    except WarpcamError as error:
        raise WarpcamError(f"{WHERE}: {error}") from None
    try:
        color = np.asarray(settings["background_color"], np.float64)
    except (TypeError, ValueError):
        color = np.zeros(0)
    if color.shape != (4,) or not ((color >= 0.0) & (color <= 1.0)).all():
        raise WarpcamError(
            f"{WHERE}: background_color must be red, green, blue and alpha in [0, 1], got "
            f"{settings['background_color']!r}"
        )


def read_groups(where: str, value: Any) -> list[int]:
    """Read groups from any iterable of numbers.

    Args:
        where: What errors begin with.
        value: What came as ``enabled_geom_groups``.
    """
    try:
        found = [None if isinstance(group, bool | np.bool_) else whole(group) for group in value]
    except TypeError:
        found = [None]
    groups = [group for group in found if group is not None]
    if isinstance(value, str | bytes) or len(groups) < len(found):
        raise WarpcamError(f"{where}: enabled_geom_groups must be whole numbers, got {value!r}")
    return groups


def has_skybox(mjm: mujoco.MjModel) -> bool:
    return bool((mjm.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).any())


def _active(mjm: mujoco.MjModel, cam_active: Any) -> list[int]:
    """Ids of the cameras to render."""
    if cam_active is None:
        return list(range(mjm.ncam))
    wanted = _listed("cam_active", cam_active, "None, or a list of flags, names or ids")
    if all(isinstance(item, bool | np.bool_) for item in wanted):
        if wanted and len(wanted) != mjm.ncam:
            raise WarpcamError(f"{WHERE}: cam_active has {len(wanted)} flags, the model {mjm.ncam} cameras")
        return [camera for camera, active in enumerate(wanted) if active]
    ids = []
    for item in wanted:
        camera = -1
        if isinstance(item, str):
            camera = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_CAMERA, item)
        elif isinstance(item, int | np.integer) and not isinstance(item, bool):
            camera = int(item)
        if not 0 <= camera < mjm.ncam:
            known = ", ".join(repr(mjm.camera(index).name or index) for index in range(mjm.ncam)) or "none"
            raise WarpcamError(f"{WHERE}: cam_active has {item!r}; the model's cameras are {known}")
        ids.append(camera)
    if len(set(ids)) < len(ids):
        raise WarpcamError(f"{WHERE}: cam_active names a camera twice: {wanted!r}")
    return ids


def _sizes(mjm: mujoco.MjModel, ids: Sequence[int], cam_res: Any) -> list[tuple[int, int]]:
    if cam_res is None:
        sizes = [mjm.cam_resolution[camera] for camera in ids]
    elif isinstance(cam_res, tuple):
        sizes = [cam_res] * len(ids)
    else:
        sizes = list(cam_res)
        if len(sizes) == 1:
            sizes *= len(ids)
    if len(sizes) != len(ids):
        raise WarpcamError(f"{WHERE}: cam_res has {len(sizes)} sizes for {len(ids)} active cameras")
    checked = []
    for size in sizes:
        pair = np.asarray(size)
        if pair.shape != (2,) or pair.dtype.kind not in "iu" or (pair < 1).any():
            raise WarpcamError(f"{WHERE}: cam_res must be (width, height), at least 1 pixel each, got {size!r}")
        checked.append((int(pair[0]), int(pair[1])))
    return checked


def _listed(name: str, value: Any, allowed: str) -> list[Any]:
    try:
        return list(value)
    except TypeError:
        raise WarpcamError(f"{WHERE}: {name} must be {allowed}, got {value!r}") from None


def _each(name: str, settings: dict[str, Any], mjm: mujoco.MjModel, ids: Sequence[int], bit: Any) -> list[bool]:
    """A flag for each active camera."""
    flags = settings[name]
    if flags is None:
        return [bool(int(mjm.cam_output[camera]) & int(bit)) for camera in ids]
    if isinstance(flags, bool | np.bool_):
        return [bool(flags)] * len(ids)
    values = [bool(flag) for flag in _listed(name, flags, "None, True, False or a list of these")]
    if len(values) == mjm.ncam and len(ids) != mjm.ncam:
        return [values[camera] for camera in ids]
    if len(values) == 1:
        return values * len(ids)
    if len(values) != len(ids):
        raise WarpcamError(f"{WHERE}: {name} has {len(values)} flags for {len(ids)} active cameras")
    return values
