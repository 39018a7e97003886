"""From materials and lights as files give them to those that the kernels have: the one place where they meet.

Colours and light of files are linear. Shapes' colours are kept as display colours, as those that a user sets are, and
the kernels decode them. Lights, in physical units, are scaled together until the middle of the scene is exposed as a
white surface would be; what materials emit is left as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from warpcam.accel.meshes import Mesh
from warpcam.core.color import linear_to_srgb
from warpcam.kernels import types
from warpcam.sources.common.scene_graph import LightNode, Material

UNSET = (0.5, 0.5, 0.5, 1.0)  # a material's colour: shapes carry their own, but for this one which is read from here
BARE = (0.18, 0.18, 0.18)  # of a shape that says nothing of its colour, linear
WHITE = (1.0, 1.0, 1.0)
# In a scene without lights: from everywhere; from the camera, on matt surfaces and in highlights.
HEADLIGHT = ((0.2, 0.2, 0.2), (0.8, 0.8, 0.8), (0.8, 0.8, 0.8))
FORMS = {
    "point": types.FORM_POINT,
    "sphere": types.FORM_SPHERE,
    "disk": types.FORM_DISK,
    "rectangle": types.FORM_RECTANGLE,
    "cylinder": types.FORM_CYLINDER,
}
# opacity from which a surface is seen; least of a cut-out: native/accel/alpha_test.h
SEEN, MIN_CUT = 0.5 / 255.0, 1.5 / 255.0


@dataclass(frozen=True)
class MaterialRow:
    """One row of the kernels' materials."""

    roughness: float
    metallic: float
    reflectance: float
    transmission: float
    emissive: tuple[float, float, float]
    textures: tuple[int, ...]  # by their roles


def material_of(look: Material) -> MaterialRow:
    textures = [-1] * types.NUM_ROLES
    textures[types.ROLE_COLOR], textures[types.ROLE_NORMAL] = look.texture, look.normals
    textures[types.ROLE_PACKED], textures[types.ROLE_EMISSION] = look.packed, look.emission_texture
    if look.cutoff <= 0.0:  # what is cut out is no matter of shading
        textures[types.ROLE_OPACITY] = look.opacity_map
    roughness, metallic, reflectance, transmission = (
        float(np.clip(value, 0.0, 1.0))
        for value in (look.roughness, look.metallic, look.reflectance, look.transmission)
    )
    red, green, blue = (max(float(value), 0.0) for value in look.emission)
    reflectance = types.UNLIT if look.unlit else reflectance
    return MaterialRow(roughness, metallic, reflectance, transmission, (red, green, blue), tuple(textures))


def color_of(
    look: Material | None, color: tuple[float, float, float, float] | None
) -> tuple[float, float, float, float]:
    """Display colour of a shape."""
    if look is not None and color is None:
        color = (*look.color, look.opacity)
    red, green, blue, alpha = color if color is not None else (*BARE, 1.0)
    red, green, blue = (float(channel) for channel in linear_to_srgb((red, green, blue)))
    return red, green, blue, float(alpha)


def opacity(look: Material | None, color: tuple[float, float, float, float] | None) -> float:
    """Return the opacity of a whole shape; an opacity map gives values between."""
    alpha = color_of(look, color)[3]
    return 0.5 if look is not None and look.opacity_map >= 0 and look.cutoff <= 0.0 and alpha > 0.0 else alpha


def masked(mesh: Mesh, look: Material | None) -> Mesh:
    """A mesh that is only there where the map of its opacity says so."""
    if look is None or look.opacity_map < 0 or mesh.uvs is None:
        return mesh
    return replace(mesh, mask=look.opacity_map, least=max(look.cutoff, MIN_CUT) if look.cutoff > 0.0 else SEEN)


def irradiance_at(lamp: LightNode, place: np.ndarray, middle: np.ndarray) -> float:
    """Return the light at the middle of a scene from a light at ``place``, if it faces the middle; (3,) each [m]."""
    if not lamp.active:
        return 0.0
    square = float(((place - middle) ** 2).sum()) + lamp.near if lamp.kind == "local" else 1.0
    light = max(lamp.strength) / max(square, 1e-12)
    return light if 0.0 < light < np.inf else 0.0


def light_rows(lamps: Sequence[LightNode], gain: float) -> dict[str, np.ndarray]:
    """Rows of the kernels' lights by field, domes among them dark; all light is multiplied by ``gain``."""
    strengths = gain * np.array([lamp.strength for lamp in lamps], np.float64).reshape(-1, 3)
    on = np.array([lamp.active and lamp.kind != "dome" for lamp in lamps], bool)
    local = np.array([lamp.kind == "local" for lamp in lamps], bool)
    # What arrives 1 m away to radiance: by the area that is seen, over pi.
    areas = np.array([lamp.seen if lamp.form != "point" else np.pi for lamp in lamps], np.float64)
    light = strengths * (np.pi / areas)[:, None]
    return {
        "types": np.where(local, types.LIGHT_SPOT, types.LIGHT_DIRECTIONAL).astype(np.int32),
        "active": on & (strengths.max(axis=1, initial=0.0) > 0.0),
        "casts_shadow": np.array([lamp.casts_shadow for lamp in lamps], bool),
        "attenuation": np.tile((0.0, 0.0, 1.0), (len(lamps), 1)),
        "cutoff": np.array([min(lamp.cone, 90.0) if lamp.one_sided else lamp.cone for lamp in lamps], np.float32),
        "exponent": np.zeros(len(lamps), np.float32),
        "ambient": np.zeros((len(lamps), 3)),
        "diffuse": light * np.array([lamp.diffuse for lamp in lamps]).reshape(-1, 1),
        "specular": light * np.array([lamp.specular for lamp in lamps]).reshape(-1, 1),
        "forms": np.array([FORMS[lamp.form] for lamp in lamps], np.int32),
        "sizes": np.array([lamp.size for lamp in lamps], np.float64).reshape(-1, 3),
    }


def sky_rows(lamps: Sequence[LightNode], gain: float) -> np.ndarray:
    """All domes together, (SKY_TERMS + 1, 3): see native/shading/environment.h."""
    rows = np.zeros((types.SKY_TERMS + 1, 3))
    for lamp in lamps:
        if lamp.kind == "dome" and lamp.active:
            terms = np.nan_to_num(np.asarray(lamp.terms), posinf=0.0, neginf=0.0)
            rows[: types.SKY_TERMS] += gain * terms
            if not rows[-1].any():  # the first one's image is what is seen
                rows[-1] = gain * np.asarray(lamp.image_gain)
    return rows


def even_sky(radiance: Sequence[float]) -> np.ndarray:
    """Terms of a sky that is alike all over, (SKY_TERMS, 3)."""
    return np.array([tuple(radiance), *[(0.0, 0.0, 0.0)] * (types.SKY_TERMS - 1)], np.float64)
