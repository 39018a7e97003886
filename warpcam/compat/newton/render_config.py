"""Newton's render settings: which are honoured, and how, and which are refused."""

import math
from collections.abc import Sequence
from typing import Any

import newton
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.core.color import srgb_to_linear
from warpcam.core.errors import WarpcamError
from warpcam.kernels.types import ROLE_COLOR

SKY, GROUND = (0.2, 0.2, 0.225), (0.05, 0.05, 0.06)  # what shines on what faces up and down unless told
HALF_LOST = 0.49  # of the light comes through: where splats are a surface to Newton, unless told
USUAL_LIMITS = float(np.nextafter(np.float32(HALF_LOST), np.float32(-1.0))), 20.0  # see splat_limits
FAST, QUALITY = range(2)  # Newton's GaussianRenderMode: the nearest splats of a cloud, or all
UP_SHARE = 1.5  # a surface takes two thirds of a sky's first order
DOWN = (-0.57735026, 0.57735026, -0.57735026)  # where the light shines where z is up, unless told
GREYS = (128, 191)  # of a checkerboard's squares
LEFT = 0.3  # of the light is there in its shadow
SHARP = 512  # texels of a checkerboard at least along each side


class RenderSettings:
    """Settings of Newton's camera for a scene: light, ambient light, visible textures.

    Args:
        model: What scenes are made of.
        physical: Whether surfaces gleam as their roughness and metalness say. False: matt, as Newton's camera has it.
    """

    def __init__(self, model: newton.Model, physical: bool):
        self._model, self._up, self._physical = model, np.eye(3)[int(model.up_axis)], physical
        self._light: tuple[bool, tuple[float, ...], tuple[float, ...]] | None = None
        self._settings = {"enable_textures": True, "enable_ambient_lighting": True, "enable_shadows": False}
        self._sky, self._ground = np.array(SKY), np.array(GROUND)

    def take(self, scene: wc.Scene, num_finishes: int) -> None:
        """Be those of this scene from now on.

        Args:
            scene: Made with two lights and no ambient light.
            num_finishes: How many of its materials are the model's; as many more, or yet more, may show a checkerboard.
        """
        self._scene, self._count = scene, num_finishes
        self._textures = scene.array("material_texture")
        self._all, self._none = wp.clone(self._textures), wp.full_like(self._textures, -1)
        source: Any = scene._source
        source.tints.choose(self._none)  # colours of triangles are no textures to Newton
        scene.array("light_active").fill_(False)
        if not self._physical:
            scene.array("material_reflectance").zero_()
            scene.array("material_metallic").zero_()
        if self._light is not None:
            self._write_light()
        self._write()
        self._write_sky()

    def set_light(self, shadows: bool, direction: Any, color: Any) -> None:
        way = default_direction(self._model) if direction is None else _triple("direction", direction)
        if not 0.0 < math.hypot(*way) < math.inf:
            raise WarpcamError(f"direction must be finite and not zero, got {direction!r}")
        self._light = bool(shadows), way, (1.0, 1.0, 1.0) if color is None else _triple("color", color)
        self._write_light()

    def set_ambient(self, sky: Any, ground: Any) -> None:
        self._sky = np.array(_triple("sky_color", sky))
        self._ground = self._sky if ground is None else np.array(_triple("ground_color", ground))
        self._write_sky()

    def check(self, shapes: np.ndarray, texture: int) -> None:
        """Let these shapes alone show a texture, which the scene's last materials have."""
        scene, count = self._scene, self._count
        columns, textures = scene.columns, self._all.numpy()
        finishes = scene.array("shape_materials").numpy() % count
        textures[:, np.unique(np.broadcast_to(finishes, columns.shape)[columns >= 0]), ROLE_COLOR] = -1
        textures[:, count : 2 * count, ROLE_COLOR] = texture
        self._all.assign(textures)
        scene.array("shape_materials").assign(np.where(np.isin(columns, shapes), count + finishes, finishes))
        for name in ("material_roughness", "material_metallic"):
            values = scene.array(name).numpy()
            values[:, count : 2 * count] = values[:, :count]
            scene.array(name).assign(values)
        self._write()

    def have_textures(self) -> bool:
        """Return whether there are textures, shown now or not; reads them from the device."""
        return bool(self._all.numpy().max(initial=-1) >= 0)

    def show(self, config: Any, capturing: bool) -> None:
        """Bring the scene to these settings; what is so already costs nothing.

        Args:
            config: Newton's RenderConfig.
            capturing: Whether a capture is under way: nothing is written then before the graph is launched.
        """
        wanted = {name: bool(getattr(config, name)) for name in self._settings}
        changed = [name for name in wanted if wanted[name] != self._settings[name]]
        require_unchanged(changed, capturing)
        self._settings = wanted
        if "enable_textures" in changed:
            self._write()
        if "enable_ambient_lighting" in changed:
            self._write_sky()
        if "enable_shadows" in changed and self._light is not None:
            self._write_light()

    def _write(self) -> None:
        wp.copy(self._textures, self._all if self._settings["enable_textures"] else self._none)

    def _write_light(self) -> None:
        """One light, or two of its direction: one for what there is in the shadow of the other, too."""
        assert self._light is not None
        casts, direction, color = self._light
        scene, parted = self._scene, casts and self._settings["enable_shadows"]
        scene.array("light_directions").fill_(wp.normalize(wp.vec3(*direction)))
        for light, share in enumerate((1.0 - LEFT, LEFT) if parted else (1.0, 0.0)):
            scene.array("light_active")[:, light].fill_(share > 0.0)
            scene.array("light_casts_shadow")[:, light].fill_(parted and light == 0)
            for name in ("light_diffuse", "light_specular"):
                scene.array(name)[:, light].fill_(share * wp.vec3(*color))

    def _write_sky(self) -> None:
        terms = np.zeros((*self._scene.array("sky").shape, 3), np.float32)
        if self._settings["enable_ambient_lighting"]:
            terms[:, 0] = 0.5 * (self._sky + self._ground)
            terms[:, 1:4] = UP_SHARE * 0.5 * np.outer(self._up, self._sky - self._ground)
        self._scene.array("sky").assign(terms)


def default_direction(model: newton.Model) -> tuple[float, float, float]:
    """From behind, the left and above."""
    turn = newton.Axis.Z.quat_between_axes(newton.Axis.from_any(model.up_axis))
    x, y, z = (float(part) for part in wp.quat_rotate(turn, wp.vec3(*DOWN)))
    return x, y, z


def checkerboard(resolution: Any, checker_size: Any) -> np.ndarray:
    """An image of a checkerboard, (height, width, 3) uint8, so fine that its squares' edges are sharp."""
    for name, value in (("resolution", resolution), ("checker_size", checker_size)):
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
            raise WarpcamError(f"{name} must be a whole number of at least 1, got {value!r}")
    number = np.arange(resolution) // checker_size
    dark = (number[:, None] + number) % 2 == 0
    pixels = (
        np.where(dark, *GREYS).astype(np.uint8).repeat(-(-SHARP // resolution), 0).repeat(-(-SHARP // resolution), 1)
    )
    return np.ascontiguousarray(np.repeat(pixels[..., None], 3, axis=-1))


def check_shapes(shapes: Any, model: newton.Model) -> np.ndarray:
    """Indices of shapes, int64."""
    chosen = np.asarray(shapes)
    if chosen.size and not np.issubdtype(chosen.dtype, np.integer):
        raise WarpcamError(f"shape_indices must be whole numbers, got {chosen.dtype}")
    chosen = chosen.astype(np.int64).reshape(-1)
    beyond = chosen[(chosen < 0) | (chosen >= model.shape_count)]
    if len(beyond):
        raise WarpcamError(
            f"shape_indices contains an out-of-range shape index: {beyond[0]}; the model has {model.shape_count} shapes"
        )
    return chosen


def require_unchanged(changed: Sequence[str], capturing: bool) -> None:
    """Raise if settings are others than before, by their names, within a capture."""
    if changed and capturing:
        raise WarpcamError(
            f"render_config.{changed[0]}: a capture is under way, and it is another than before; call update once with "
            "it before the capture"
        )


def check_config(config: Any, samples: int) -> None:
    """Raise for settings that Newton's camera refuses, too.

    Args:
        config: Newton's RenderConfig.
        samples: Rays of each pixel.
    """
    anti_aliasing = getattr(config, "anti_aliasing", 0)
    if anti_aliasing not in (0, 1, 2):
        raise WarpcamError(
            f"Invalid anti_aliasing mode: {anti_aliasing!r}; allowed are NONE (0), SSAA (1) and MSAA (2)"
        )
    if samples > 1 and anti_aliasing == 0:
        raise WarpcamError("anti_aliasing must be SSAA or MSAA for camera_rays with more than one sample")
    if config.texture_projection_mode not in (0, 1):
        raise WarpcamError(
            f"Invalid texture_projection_mode: {config.texture_projection_mode!r}; allowed are CUBIC (0) and "
            "TRIPLANAR (1)"
        )


def splat_limits(config: Any) -> tuple[float, float]:
    """Below which share of the light that comes through splats are a surface, and how many of a cloud a ray blends.

    Args:
        config: Newton's RenderConfig.
    """
    if config.gaussians_mode not in (FAST, QUALITY):
        raise WarpcamError(f"Invalid gaussians_mode: {config.gaussians_mode!r}; allowed are FAST (0) and QUALITY (1)")
    least, most = getattr(config, "gaussians_min_transmittance", HALF_LOST), config.gaussians_max_num_hits
    for name, value in (("gaussians_min_transmittance", least), ("gaussians_max_num_hits", most)):
        if not isinstance(value, int | float | np.number) or isinstance(value, bool) or not value >= 0:
            raise WarpcamError(f"render_config.{name} must be a number and not negative, got {value!r}")
    below = float(np.nextafter(np.float32(least), np.float32(-1.0)))
    return below, math.inf if config.gaussians_mode == QUALITY else float(most)


def linear_color(packed: int) -> int:
    """Decode R | G << 8 | B << 16 | A << 24 in display values to linear, with A as it is."""
    color = int(packed) & 255 << 24
    for shift in (0, 8, 16):
        value = (int(packed) >> shift & 255) / 255.0
        color |= int(255.0 * srgb_to_linear(value)) << shift
    return color


def _triple(name: str, value: Any) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in value)
    except (TypeError, ValueError):
        raise WarpcamError(f"{name} must be three numbers, got {value!r}") from None
    return x, y, z
