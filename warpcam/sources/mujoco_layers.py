"""What of a MuJoCo model needs more than one layer: mirrors, transparent geoms, haze."""

from collections.abc import Sequence

import mujoco
import numpy as np

from warpcam.kernels.types import PLANE
from warpcam.layers import Layers, find_mirrors, find_veils

PLAIN = (0.5, 0.5, 0.5, 1.0)  # a geom's colour that lets its material's count
SKYBOX = 0.7  # its distance as a part of how far MuJoCo's camera sees


def read_layers(
    mjm: mujoco.MjModel,
    types: np.ndarray,
    drawn: Sequence[int],
    reflections: bool | None,
    transparency: bool | None,
    colors: np.ndarray | None = None,
    materials: np.ndarray | None = None,
    material_colors: np.ndarray | None = None,
) -> Layers:
    """Find them.

    Args:
        mjm: The host's model.
        types: (geom,) shape types.
        drawn: ids of the geoms that are drawn.
        reflections: Whether planes and boxes reflect; None looks for materials with reflectance.
        transparency: Whether geoms are transparent; None looks for colours that are.
        colors: (n, geom, 4), where worlds have their own; None is the model's.
        materials: (n, geom), likewise.
        material_colors: (n, material, 4), likewise.
    """
    colors = mjm.geom_rgba[None] if colors is None else colors
    materials = mjm.geom_matid[None] if materials is None else materials
    material_colors = mjm.mat_rgba[None] if material_colors is None else material_colors
    haze = [g for g in drawn if types[g] == PLANE and mjm.geom_size[g, 0] == 0.0 == mjm.geom_size[g, 1]]
    reach = np.where(types == PLANE, np.inf, mjm.geom_rbound).astype(np.float32)
    return Layers(
        mirrors=find_mirrors(types, drawn, materials, mjm.mat_reflectance, reflections),
        reflectance=mjm.mat_reflectance.astype(np.float32),
        veils=find_veils(types, drawn, _opacity(colors, materials, material_colors), transparency, "scene"),
        reach=reach,
        haze_plane=haze[0] if haze else -1,
        haze_color=tuple(float(channel) for channel in mjm.vis.rgba.haze[:3]),
        haze_width=float(mjm.vis.map.haze),
        haze_radius=float(SKYBOX * mjm.vis.map.zfar * mjm.stat.extent),
    )


def _opacity(colors: np.ndarray, materials: np.ndarray, material_colors: np.ndarray) -> np.ndarray:
    """(n, geom): of the colour that counts."""
    count = int(np.lcm.reduce([len(colors), len(materials), max(len(material_colors), 1)]))
    count = min(count, max(len(colors), len(materials), len(material_colors)))
    worlds = np.arange(count)
    color = np.array(colors[worlds % len(colors)])
    if material_colors.shape[1] == 0:
        return color[..., 3]
    material = materials[worlds % len(materials)]
    given = material_colors[worlds % len(material_colors)][worlds[:, None], np.maximum(material, 0), 3]
    plain = (color == np.float32(PLAIN)).all(axis=-1) & (material >= 0)
    return np.where(plain, given, color[..., 3])
