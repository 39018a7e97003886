"""Features of a MuJoCo model that need more than one layer: mirrors, transparent geoms, haze."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.types import PLANE
from warpcam.scene.layers import Layers, Transparency, find_mirrors, find_transparent
from warpcam.scene.source import SceneDescription
from warpcam.sources.mujoco.mjv_geoms import MjvGeomClass
from warpcam.sources.mujoco.visual_geoms import VisualGeoms

PLAIN = (0.5, 0.5, 0.5, 1.0)  # a geom's colour that lets its material's count
SKYBOX = 0.7  # its distance as a part of how far MuJoCo's camera sees


def with_layers(
    parts: SceneDescription,
    mjm: mujoco.MjModel,
    extras: VisualGeoms | None,
    reflections: bool | None,
    transparency: Transparency,
    colors: np.ndarray | None = None,
    materials: np.ndarray | None = None,
    material_colors: np.ndarray | None = None,
    decor: Sequence[MjvGeomClass] = (),
    planes_from_behind: bool = False,
) -> SceneDescription:
    """The scene's parts with what of them needs more than one layer.

    Args:
        parts: Of what is drawn, geoms first.
        mjm: The host's model.
        extras: What is drawn beside geoms.
        reflections: Whether planes and boxes reflect; None looks for materials with reflectance.
        transparency: Whether shapes are transparent; None looks for colours that are, "backs" adds planes from behind.
        colors: (n, geom, 4), where worlds have their own; None is the model's.
        materials: (n, geom), likewise.
        material_colors: (n, material, 4), likewise.
        decor: What may stand beside the model.
        planes_from_behind: Whether outputs that are not lit see planes from behind.
    """
    colors = mjm.geom_rgba[None] if colors is None else colors
    materials = mjm.geom_matid[None] if materials is None else materials
    material_colors = mjm.mat_rgba[None] if material_colors is None else material_colors
    types, drawn, reach = parts.shape_types, parts.drawn, mjm.geom_rbound
    reflectance = np.r_[mjm.mat_reflectance, [kind.reflectance for kind in decor]].astype(np.float32)
    if decor:  # their columns' own colours tell what is seen through
        more = np.broadcast_to(np.asarray(PLAIN), (len(material_colors), len(decor), 4))
        material_colors = np.concatenate((material_colors, more), axis=1)
    if extras is not None:
        colors, materials = _extended(colors, extras.colors), _extended(materials, extras.materials)
        reach = np.r_[reach, np.full(len(types) - mjm.ngeom, -1.0)]
    haze = [g for g in drawn if g < mjm.ngeom and types[g] == PLANE and (mjm.geom_size[g, :2] == 0.0).all()]
    red, green, blue = mjm.vis.rgba.haze[:3]
    opacity = _opacity(colors, materials, material_colors, parts.num_worlds)
    layers = Layers(
        mirrors=find_mirrors(types, drawn, materials, reflectance, reflections),
        reflectance=reflectance,
        transparent_shapes=find_transparent(types, drawn, opacity, transparency),
        reach=np.where(types == PLANE, np.inf, reach).astype(np.float32),
        haze_plane=haze[0] if haze else -1,
        haze_color=(float(red), float(green), float(blue)),
        haze_width=float(mjm.vis.map.haze),
        haze_radius=float(SKYBOX * mjm.vis.map.zfar * mjm.stat.extent),
    )
    flags = parts.flags | SceneFlag.PLANES_FROM_BEHIND if planes_from_behind else parts.flags
    return replace(parts, layers=layers, flags=flags)


def _extended(geoms: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(n, column, ...): the geoms' own values, and those of the columns beside them."""
    more = np.broadcast_to(columns[geoms.shape[1] :], (len(geoms), *columns[geoms.shape[1] :].shape))
    return np.concatenate((geoms, more), axis=1)


def _opacity(colors: np.ndarray, materials: np.ndarray, material_colors: np.ndarray, num_worlds: int) -> np.ndarray:
    """(n, geom): of the colour that counts, in as many worlds as there are different ones."""
    count = int(np.lcm.reduce([len(colors), len(materials), max(len(material_colors), 1)]))
    worlds = np.arange(min(count, num_worlds))
    color = np.array(colors[worlds % len(colors)])
    if material_colors.shape[1] == 0:
        return color[..., 3]
    material = materials[worlds % len(materials)]
    row = np.clip(material, 0, material_colors.shape[1] - 1)  # what is out of range the scene tells
    given = material_colors[worlds % len(material_colors)][worlds[:, None], row, 3]
    plain = (color == np.asarray(PLAIN, np.float32)).all(axis=-1) & (material >= 0)
    return np.where(plain, given, color[..., 3])
