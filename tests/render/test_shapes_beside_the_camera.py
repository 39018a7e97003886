"""Shapes of which a part is before the camera and a part behind it, against MuJoCo's rays."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

WEDGE = '<mesh name="wedge" scale=".4 .4 4" vertex="0 0 0  1 0 0  0 1 0  0 0 1  1 1 0"/>'
KINDS = {
    "box": 'type="box" size=".05 .08 2"',
    "capsule": 'type="capsule" size=".05 2"',
    "cylinder": 'type="cylinder" size=".07 2"',
    "ellipsoid": 'type="ellipsoid" size=".1 .06 2"',
    "mesh": 'type="mesh" mesh="wedge"',
}
SIZE, FOVY = 48, 110.0


def crowd(kind: str, seed: int) -> mujoco.MjModel:
    """Long shapes that pass the origin, where the camera is, on all sides."""
    random = np.random.default_rng(seed)
    shapes = ""
    for _ in range(40):
        away = random.normal(size=3)
        away *= random.uniform(0.8, 1.8) / np.linalg.norm(away)
        along = np.cross(away, random.normal(size=3))  # past the camera
        shapes += f'<geom {KINDS[kind]} pos="{away[0]} {away[1]} {away[2]}" zaxis="{along[0]} {along[1]} {along[2]}"/>'
    return scenes.compile_xml(shapes, assets=WEDGE if kind == "mesh" else "")


@pytest.mark.parametrize("kind", KINDS)
def test_pixels_show_what_their_rays_meet(device: wp.Device, kind: str) -> None:
    differ = straddling = 0
    for seed in range(4):
        mjm = crowd(kind, seed)
        mjd = scenes.forward(mjm)
        rotation = scenes.looking((0.0, 0.0, 0.0), np.random.default_rng(seed).normal(size=3))
        own = scenes.own_camera(
            width=SIZE,
            height=SIZE,
            outputs=("segmentation",),
            position=(0.0, 0.0, 0.0),
            rotation=rotation,
            lens=wc.Pinhole(fovy=FOVY),
        )
        seen = scenes.look(wc.from_mujoco(mjm, mjd, device=device), own)["segmentation"][0]
        axes = scenes.matrix(rotation)
        rays = scenes.pixel_rays(SIZE, SIZE, FOVY).reshape(-1, 3) @ axes.T
        expected = np.full(len(rays), -1, np.int32)
        for n, ray in enumerate(rays):
            met = np.array([-1], np.int32)
            mujoco.mj_ray(mjm, mjd, np.zeros(3), ray, None, 1, -1, met)
            expected[n] = met[0]
        differ += (seen.reshape(-1) != expected).sum()
        corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        for geom in np.unique(expected[expected >= 0]):
            box = mjm.geom_aabb[geom]
            depth = ((box[:3] + corners * box[3:]) @ mjd.geom_xmat[geom].reshape(3, 3).T + mjd.geom_xpos[geom]) @ -axes[
                :, 2
            ]
            straddling += depth.min() < 0.0 < depth.max()
    assert straddling >= 20
    assert differ <= 12  # of 9,216 pixels, at outlines
