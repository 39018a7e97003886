"""Newton's render settings: which are honoured, and how, and which are refused."""

from typing import Any

import newton
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.errors import WarpcamError

SKY, GROUND = (0.2, 0.2, 0.225), (0.05, 0.05, 0.06)  # what shines on what faces up and down unless told
HALF_LOST = 0.49  # of the light comes through: where splats are a surface to Newton, unless told
UP_SHARE = 1.5  # a surface takes two thirds of a sky's first order


class Looks:
    """Of a scene of ``from_newton``, what Newton's camera chooses: its light, its ambient light, whether textures show.

    Args:
        scene: Made with one light and no ambient light.
        model: What it was made of.
        physical: Whether surfaces gleam as their roughness and metalness say. False: matt, as Newton's camera has it.
    """

    def __init__(self, scene: wc.Scene, model: newton.Model, physical: bool):
        self._scene, self._up = scene, np.eye(3)[int(model.up_axis)]
        self._textures = scene.array("material_texture")
        self._all, self._none = wp.clone(self._textures), wp.full_like(self._textures, -1)
        source: Any = scene._source
        source.tints.choose(self._none)  # colours of triangles are no textures to Newton
        self._shown, self._ambient = True, True
        self._sky, self._ground = np.array(SKY), np.array(GROUND)
        self._write_sky()
        scene.array("light_active").fill_(False)
        if not physical:
            scene.array("material_reflectance").zero_()
            scene.array("material_metallic").zero_()

    def set_light(self, shadows: bool, direction: Any, color: Any) -> None:
        scene = self._scene
        scene.array("light_active").fill_(True)
        scene.array("light_casts_shadow").fill_(bool(shadows))
        if direction is not None:
            scene.array("light_directions").fill_(wp.normalize(wp.vec3(*_triple("direction", direction))))
        values = wp.vec3(1.0, 1.0, 1.0) if color is None else wp.vec3(*_triple("color", color))
        for name in ("light_diffuse", "light_specular"):
            scene.array(name).fill_(values)

    def set_ambient(self, sky: Any, ground: Any) -> None:
        self._sky = np.array(_triple("sky_color", sky))
        self._ground = self._sky if ground is None else np.array(_triple("ground_color", ground))
        if self._ambient:
            self._write_sky()

    def show(self, textures: bool, ambient: bool) -> None:
        """Bring the scene to these settings; what is so already costs nothing."""
        if textures != self._shown:
            self._shown = textures
            wp.copy(self._textures, self._all if textures else self._none)
        if ambient != self._ambient:
            self._ambient = ambient
            if ambient:
                self._write_sky()
            else:
                self._scene.array("sky").zero_()

    def _write_sky(self) -> None:
        terms = np.zeros((*self._scene.array("sky").shape, 3), np.float32)
        terms[:, 0] = 0.5 * (self._sky + self._ground)
        terms[:, 1:4] = UP_SHARE * 0.5 * np.outer(self._up, self._sky - self._ground)
        self._scene.array("sky").assign(terms)


def check_config(config: Any, model: newton.Model, *, meshes: bool, splats: bool, samples: int) -> None:
    """Raise for settings that are not offered, as far as they would change an image of the model.

    Args:
        config: Newton's RenderConfig.
        model: The model.
        meshes: Whether some of its shapes are meshes.
        splats: Whether some are Gaussian splats.
        samples: Rays of each pixel.
    """
    anti_aliasing = getattr(config, "anti_aliasing", 0)
    if anti_aliasing not in (0, 1, 2):
        raise WarpcamError(f"Invalid anti_aliasing mode: {anti_aliasing!r}")
    if samples > 1 and anti_aliasing == 0:
        raise WarpcamError("anti_aliasing must be SSAA or MSAA for camera_rays with more than one sample")
    if not config.enable_global_world:
        raise _refused("enable_global_world", False, "what belongs to no world is seen in all", True)
    if not config.enable_backface_culling and meshes:
        raise _refused("enable_backface_culling", False, "meshes are not seen from behind", True)
    if not config.enable_particles and model.particle_count:
        raise _refused("enable_particles", False, "particles are drawn", True)
    if config.texture_projection_mode != 0 and config.enable_textures:
        raise _refused("texture_projection_mode", config.texture_projection_mode, "no other is drawn", "CUBIC")
    if config.gaussians_mode != 0:
        raise _refused("gaussians_mode", config.gaussians_mode, "splats are blended one by one", "FAST")
    least = getattr(config, "gaussians_min_transmittance", HALF_LOST)
    if least != HALF_LOST and splats:
        why = "splats are a surface where half of the light is lost"
        raise _refused("gaussians_min_transmittance", least, why, HALF_LOST)


def _refused(name: str, value: Any, why: str, allowed: Any) -> WarpcamError:
    return WarpcamError(f"render_config.{name} is {value!r}: that is not offered, {why}; allowed is {allowed}")


def _triple(name: str, value: Any) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in value)
    except (TypeError, ValueError):
        raise WarpcamError(f"{name} must be three numbers, got {value!r}") from None
    return x, y, z
