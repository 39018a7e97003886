"""Isaac Lab's simple shading: what RTX shows in its mode "Minimal", where that can be known.

NVIDIA documents the mode: of lights only the first DistantLight of the stage counts, with hard shadows, or one at the
camera if there is none; light from everywhere is added, and nothing is reflected twice. How bright these are, and the
curve that brings light to a display, are not documented: the numbers here are those with which the reference pictures
of RTX that Isaac Lab 3.0 comes with are met.
"""

from collections.abc import Collection, Mapping
from typing import Any, Literal

import numpy as np
import warp as wp

import warpcam as wc
from warpcam.core.color import encoded_beyond, srgb_to_linear
from warpcam.core.errors import WarpcamError
from warpcam.sources.newton.options import NewtonOptions
from warpcam.sources.newton.source import load

Level = Literal["constant", "diffuse", "full"]
LEVELS: Mapping[str, Level] = {
    "simple_shading_constant_diffuse": "constant",
    "simple_shading_diffuse_mdl": "diffuse",
    "simple_shading_full_mdl": "full",
}
# What cannot be had of the same camera: it is lit otherwise.
COLORS = ("rgb", "rgba", "rgb_hdr", "albedo")
# What a white surface sends, 1 being what the curve takes for it: of light from everywhere, of light at the camera.
AMBIENT, CAMERA_LIGHT = 0.2267, 0.837
EXPOSURE = 41.24  # of a DistantLight's irradiance over pi
GRAY = 0.2  # the one colour, linear
CURVE = (2.51, 0.03, 2.43, 0.59, 0.14)  # as warpcam/compat/isaaclab/tonemap.py has it


def chosen_from(kinds: Collection[str]) -> str | None:
    """The one data type of simple shading among ``kinds``, None if there is none."""
    wanted = [kind for kind in LEVELS if kind in kinds]
    beside = [kind for kind in COLORS if kind in kinds]
    if len(wanted) > 1 or (wanted and beside):
        raise WarpcamError(
            f"CameraCfg.data_types: {', '.join((*wanted, *beside))} came for one camera; allowed is one data type of "
            f"simple_shading_* without {', '.join(COLORS)}: ask for the others from another camera"
        )
    return wanted[0] if wanted else None


def shaded_scene(model: Any, state: Any, stage: Any, kind: str, choice: NewtonOptions) -> wc.Scene:
    """The scene as that data type shows it.

    Args:
        model: Of Newton.
        state: What is looked at.
        stage: Isaac Lab's, or None: without lights.
        kind: One of ``LEVELS``.
        choice: Of ``load``.
    """
    lights = () if stage is None else distant_light(stage)
    scene = load(model, state, lights, (AMBIENT,) * 3, None, None, choice=choice)
    if not lights:
        head = scene.array("headlight").numpy()
        head[1:] = CAMERA_LIGHT
        scene.array("headlight").assign(head)
    level = LEVELS[kind]
    if level == "constant":
        scene.array("material_texture").fill_(-1)
    if level != "full":
        scene.array("material_metallic").zero_()
        scene.array("material_reflectance").zero_()
    if level == "constant":
        colors = wp.from_torch(scene.vary("shape_colors"))
        host = colors.numpy().copy()
        host[..., :3] = encoded_beyond(np.float64(GRAY))
        colors.assign(host)
    return scene


def distant_light(stage: Any) -> tuple[wc.Light, ...]:
    """The first DistantLight of the stage that is visible, as it is now; none if there is none."""
    from pxr import Usd, UsdGeom

    from warpcam.sources.common.warnings import WarningCollector
    from warpcam.sources.usd.attributes import AttributeReader
    from warpcam.sources.usd.light import read_light

    for prim in stage.Traverse():
        if prim.GetTypeName() != "DistantLight":
            continue
        if UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible:
            continue
        path, now = str(prim.GetPath()), Usd.TimeCode.Default()
        collector = WarningCollector(path)
        lamp = read_light(
            prim,
            0,
            path,
            time=now,
            scale=1.0,
            attributes=AttributeReader(collector),
            collector=collector,
            mean_of=lambda *_: None,
            sky_of=lambda *_: None,
        )
        collector.say()
        frame = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(now))
        color = EXPOSURE * np.array(lamp.strength)
        return (wc.Light(direction=-frame[2, :3], color=color, shadows=lamp.casts_shadow),)
    return ()


def background_of(color: tuple[float, float, float]) -> np.ndarray:
    """The display colour, beyond 1 if need be, that the curve turns into ``color``."""
    a, b, c, d, e = CURVE
    linear = srgb_to_linear(color)
    p, q, r = a - c * linear, b - d * linear, -e * linear
    return encoded_beyond((np.sqrt(q * q - 4.0 * p * r) - q) / (2.0 * p)).astype(np.float32)
