"""Lights as paths meet them, against the closed forms of the real-time look where these are exact."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from path_scenes import blocks, traced

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pbr_scenes import bind
from pxr import Gf, Usd, UsdGeom, UsdLux
from usd_stages import add_mesh

CAMERA = wc.Camera(
    "c", width=32, height=32, lens=wc.Pinhole(fovy=40.0), position=(0.0, 0.0, 4.0), outputs=("hdr",), shadows=True
)
LAMPS: dict[str, tuple[str, dict[str, Any], tuple[float, float, float]]] = {
    "point": ("SphereLight", {"Radius": 0.3, "TreatAsPoint": True}, (0.0, 0.0, 0.0)),
    "ball": ("SphereLight", {"Radius": 0.3}, (0.0, 0.0, 0.0)),
    "rectangle": ("RectLight", {"Width": 0.8, "Height": 0.4}, (0.0, 10.0, 20.0)),
    "rod": ("CylinderLight", {"Radius": 0.01, "Length": 0.8}, (0.0, 0.0, 30.0)),
    "sun": ("DistantLight", {"Angle": 10.0}, (20.0, 0.0, 0.0)),
    "sharp sun": ("DistantLight", {"Angle": 0.0, "Normalize": True}, (20.0, 0.0, 0.0)),
}


def lit_floor(stage: Usd.Stage, name: str, **material: Any) -> None:
    """A white floor of 4 m under a light 1 m above it."""
    kind, values, turn = LAMPS[name]
    floor = add_mesh(stage, "/floor", [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [(0, 1, 2, 3)])
    bind(floor, stage, **{"diffuseColor": (1.0, 1.0, 1.0), "ior": 1.0, **material})
    lamp = getattr(UsdLux, kind).Define(stage, "/lamp")
    for attribute, value in values.items():
        getattr(lamp, f"Create{attribute}Attr")(value)
    lamp.CreateIntensityAttr(3.0)
    place = UsdGeom.Xformable(lamp)
    place.AddTranslateOp().Set(Gf.Vec3d(0.3, 0.2, 1.0))
    place.AddRotateXYZOp().Set(Gf.Vec3f(*turn))


@pytest.mark.parametrize("name", LAMPS)
def test_what_arrives_at_a_matt_floor(stage: Usd.Stage, name: str, device: wp.Device) -> None:
    lit_floor(stage, name)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    wanted = blocks(wc.Renderer(scene, [CAMERA]).render()["c"]["hdr"][0].cpu().numpy())
    seen = blocks(traced(scene, CAMERA, 256, bounces=1)["hdr"])
    np.testing.assert_allclose(seen, wanted, rtol=0.02, atol=5e-3 * wanted.max())


def test_a_shadow_is_as_soft_as_its_light_is_wide(stage: Usd.Stage, device: wp.Device) -> None:
    """Half of a sun stands behind a wall's edge: below the edge's line of sight the light is half of what it is."""
    lit_floor(stage, "sun")
    wall = add_mesh(stage, "/wall", [(0, -2, 0.5), (2, -2, 0.5), (2, 2, 0.5), (0, 2, 0.5)], [(0, 1, 2, 3)])
    wall.CreateDoubleSidedAttr(True)
    lamp = UsdGeom.Xformable.Get(stage, "/lamp")
    lamp.GetOrderedXformOps()[1].Set(Gf.Vec3f(0.0, 0.0, 0.0))  # from straight above
    camera = wc.Camera(
        "c", width=64, height=4, lens=wc.Orthographic(height=0.025), position=(0.0, 0.0, 0.4), outputs=("hdr",)
    )
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    across = traced(scene, camera, 512, bounces=1)["hdr"][..., 0].mean(axis=0)
    across /= across[:4].mean()
    x = (np.arange(64) + 0.5 - 32.0) / 64.0 * 0.4
    half = 0.5 * np.tan(np.radians(5.0))  # of the penumbra [m]
    u = np.clip(-x / half, -1.0, 1.0)
    wanted = 0.5 + (u * np.sqrt(1.0 - u**2) + np.arcsin(u)) / np.pi  # of a disk cut by a line
    np.testing.assert_allclose(across, wanted, atol=0.02)
