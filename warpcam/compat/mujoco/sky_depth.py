"""Depth of MuJoCo's skybox and haze, which MuJoCo's buffer of depth holds after a picture of colours.

The skybox is an upright prism around the camera, as high above and below the camera as it is wide. The haze over an
endless plane is a cone between the plane and the camera's height, where the cone meets the skybox.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from warpcam.compat.mujoco.gl_camera import GlCamera
from warpcam.sources.mujoco.layers import SKYBOX

PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)


@dataclass(frozen=True)
class _Sky:
    """Sky of a view; equal skies have equal depth.

    Attributes:
        size: Width and height of the image [pixels].
        rotation: Of the camera, w x y z.
        edges: Of the image on the near plane [m]: left, right, bottom, top.
        near: Distance of the near plane [m].
        radius: Of the skybox [m].
        orthographic: Whether rays are parallel.
        slices: Sides of the prism.
        plane: (9,) rotation of the plane that the haze stands on, row by row; empty if there is no haze.
        above: Height of the camera over that plane [m].
        haze: How much narrower the cone is at the plane, as a part of its radius.
    """

    size: tuple[int, int]
    rotation: tuple[float, ...]
    edges: tuple[float, float, float, float]
    near: float
    radius: float
    orthographic: bool
    slices: int
    plane: tuple[float, ...] = ()
    above: float = 0.0
    haze: float = 0.0


def sky_depth(
    model: mujoco.MjModel, state: mujoco.MjData, view: GlCamera, groups: Sequence[int], width: int, height: int
) -> np.ndarray | None:
    """Return the planar depth of the sky, (height, width) float32 [m]; None if the model has no skybox.

    Args:
        model: The model.
        state: Poses of its geoms.
        view: Where the camera is and how it looks.
        groups: Groups of geoms that are drawn.
        width: Of the image [pixels].
        height: Of the image [pixels].
    """
    if not (model.tex_type == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)).any():
        return None
    edges = (view.left, view.right, view.bottom, view.top)
    plane, above = _haze_plane(model, state, view, groups)
    return _depth(
        _Sky(
            size=(width, height), rotation=tuple(view.rotation.tolist()), edges=edges, near=view.near,
            radius=SKYBOX * view.far, orthographic=view.orthographic, slices=max(int(model.vis.quality.numslices), 3),
            plane=plane, above=above, haze=float(model.vis.map.haze),
        )
    )  # fmt: skip


def _haze_plane(
    model: mujoco.MjModel, state: mujoco.MjData, view: GlCamera, groups: Sequence[int]
) -> tuple[tuple[float, ...], float]:
    """Return the rotation of the first endless plane, and the height of the camera over it [m]."""
    endless = (model.geom_type == PLANE) & (model.geom_size[:, :2] <= 0.0).all(axis=1)
    drawn = np.flatnonzero(endless & np.isin(model.geom_group, groups) & (model.geom_rgba[:, 3] > 0.0))
    if len(drawn) == 0:
        return (), 0.0
    turn = state.geom_xmat[drawn[0]]
    above = float((view.position - state.geom_xpos[drawn[0]]) @ turn[2::3])
    return (tuple(turn.tolist()), above) if above > 0.0 else ((), 0.0)


@lru_cache(maxsize=8)
def _depth(sky: _Sky) -> np.ndarray:
    starts, rays = _rays(sky)
    angles = 2.0 * np.pi / sky.slices * np.arange(sky.slices + 1)
    rim = np.stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))), axis=1)
    sides = 0.5 * (rim[1:] + rim[:-1])
    apothem = sky.radius * float(np.linalg.norm(sides[0]))
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    depth = np.full(len(rays), np.inf)
    for normal in sides:
        depth = np.minimum(depth, _leave(starts, rays, normal, apothem))
    for end in (-1.0, 1.0):
        depth = np.minimum(depth, _leave(starts, rays, np.array((0.0, 0.0, end)), sky.radius))
    if sky.plane:
        turn = np.array(sky.plane).reshape(3, 3)
        starts, rays = starts @ turn, rays @ turn  # in the plane's frame
        cone = np.full(len(rays), np.inf)
        for normal in sides - np.array((0.0, 0.0, apothem * sky.haze / sky.above)):
            cone = np.minimum(cone, _leave(starts, rays, normal, apothem))
        with np.errstate(invalid="ignore"):
            up = starts[:, 2] + cone * rays[:, 2]
        depth = np.where((up <= 0.0) & (up >= -sky.above), np.minimum(depth, cone), depth)
    image = depth.astype(np.float32).reshape(sky.size[1], sky.size[0])
    image.setflags(write=False)
    return image


def _leave(starts: np.ndarray, rays: np.ndarray, normal: np.ndarray, along: float) -> np.ndarray:
    """Return the depth at which rays pass the plane normal . p = along from within, infinite where they do not."""
    rate = rays @ normal
    return np.where(rate > 0.0, (along - starts @ normal) / np.where(rate > 0.0, rate, 1.0), np.inf)


def _rays(sky: _Sky) -> tuple[np.ndarray, np.ndarray]:
    """Return where rays begin, relative to the camera, and their directions per metre of depth, world frame [m]."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, np.array(sky.rotation))
    (width, height), (left, right, bottom, top) = sky.size, sky.edges
    x = left + (right - left) * (np.arange(width) + 0.5) / width
    y = top - (top - bottom) * (np.arange(height) + 0.5) / height
    across = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 0.0), axis=-1).reshape(-1, 3)
    forward, to_world = np.array((0.0, 0.0, -1.0)), turn.reshape(3, 3).T
    if sky.orthographic:
        return across @ to_world, np.broadcast_to(forward @ to_world, across.shape)
    return np.zeros((len(across), 3)), (across / sky.near + forward) @ to_world
