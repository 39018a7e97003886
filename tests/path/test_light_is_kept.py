"""The white furnace: in an even white sky a white surface is lost, whatever it is made of and however it is curved."""

import numpy as np
import pytest
import warp as wp
from path_scenes import inside, traced

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pbr_scenes import FOVY, SIZE, add_ball, ball_normals, bind
from pxr import Gf, Usd, UsdGeom, UsdLux
from usd_stages import add_mesh

CAMERA = wc.Camera("c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=(0.0, 0.0, 0.0), outputs=("hdr",))


@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
def test_a_white_ball(stage: Usd.Stage, roughness: float, metallic: float, device: wp.Device) -> None:
    add_ball(stage, diffuseColor=(1.0, 1.0, 1.0), roughness=roughness, metallic=metallic)
    UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.7)
    seen = traced(wc.from_usd(stage, device=device, exposure=0.0), CAMERA, 32)["hdr"]
    assert seen[inside(ball_normals()[0])].mean() == pytest.approx(0.7, rel=5e-3)


def test_a_white_corner(stage: Usd.Stage, device: wp.Device) -> None:
    """Paths go on from wall to wall and end by chance, and nothing is lost by that: three walls that see each other."""
    walls = {
        "back": [(-2, -2, -5), (2, -2, -5), (2, 2, -5), (-2, 2, -5)],
        "left": [(-2, -2, -1), (-2, -2, -5), (-2, 2, -5), (-2, 2, -1)],
        "floor": [(-2, -2, -1), (2, -2, -1), (2, -2, -5), (-2, -2, -5)],
    }
    for name, corners in walls.items():
        bind(add_mesh(stage, f"/{name}", corners, [(0, 1, 2, 3)]), stage, diffuseColor=(1.0, 1.0, 1.0), ior=1.0)
    UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.7)
    seen = traced(wc.from_usd(stage, device=device, exposure=0.0), CAMERA, 64)["hdr"]
    middle = seen[SIZE // 4 : -SIZE // 4, SIZE // 4 : -SIZE // 4]
    assert middle.mean() == pytest.approx(0.7, rel=1e-2)


def test_a_grey_one_shows_its_albedo(stage: Usd.Stage, device: wp.Device) -> None:
    """A convex matt surface reflects its share once."""
    color = np.array((0.8, 0.4, 0.1))
    ball = UsdGeom.Sphere.Define(stage, "/ball")
    UsdGeom.Xformable(ball).AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, -4.0))
    bind(ball, stage, diffuseColor=tuple(color), ior=1.0)
    UsdLux.DomeLight.Define(stage, "/sky").CreateIntensityAttr(0.7)
    seen = traced(wc.from_usd(stage, device=device, exposure=0.0), CAMERA, 64)["hdr"]
    np.testing.assert_allclose(seen[inside(ball_normals()[0])].mean(axis=0), 0.7 * color, rtol=5e-3)
