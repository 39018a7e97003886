"""Dark sides that lose the ambient part of a light that casts shadows, beside ``mujoco.Renderer``: one shape each.

Those that lie behind what the light falls on, as far as the light's map reaches: shapes stand in it, across its
edge, and outside.
"""

import color_reference
import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from golden_scenes import SHEET, compiled

import warpcam as wc

DARK = '<visual><headlight active="0"/></visual>'
COLOURS = 'ambient=".5 .4 .3" diffuse=".5 .5 .5" specular="0 0 0"'
LIGHTS = {  # their maps end near x = 1 at the shapes' height
    "directional": f'<light type="directional" pos="0 .1 2" dir="0 0 -1" {COLOURS}/>',
    "slanted": f'<light type="directional" pos="-1 .6 2" dir=".5 -.3 -1" {COLOURS}/>',
    "spot": f'<light type="spot" pos="0 .1 2" dir="0 0 -1" cutoff="60" exponent="0" {COLOURS}/>',
    "turned spot": f'<light type="spot" pos="-.2 .5 2" dir=".1 -.25 -1" cutoff="60" exponent="1" {COLOURS}/>',
}
CLOSED = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "hfield")
FROM_BELOW = '<camera pos="{} -1 -1.6" xyaxes=".866 -.424 .265 -.5 -.734 .459"/>'
PLACES = {"inside": 0.0, "across": 1.0, "outside": 1.9}


def mapped(world: str, assets: str = "") -> mujoco.MjModel:
    mjm = compiled(world, assets, DARK)
    mjm.stat.extent, mjm.vis.map.shadowclip, mjm.vis.map.zfar = 1.0, 1.0, 50.0
    mjm.vis.map.shadowscale = 0.45
    return mjm


def drawn(light: str, geom: str, place: str, device: wp.Device, assets: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Our image of it, which must be MuJoCo's, and which of its pixels show the shape."""
    world = LIGHTS[light] + geom.replace("/>", ' rgba=".9 .9 .9 1"/>') + FROM_BELOW.format(PLACES[place])
    mjm = mapped(world, assets)
    seen = color_reference.check(mjm, device, differs=False, most=0.005)
    mjm.light_castshadow[:] = False
    whole = color_reference.ours(mjm, scenes.forward(mjm), device)
    return seen.max(axis=-1), whole.max(axis=-1) > 0


@pytest.mark.parametrize(
    ("kind", "light", "place"),  # each kind with each light, and all places with each of either
    [(kind, light, list(PLACES)[(i + j) % 3]) for i, kind in enumerate(CLOSED) for j, light in enumerate(LIGHTS)],
)
def test_closed_shapes(device: wp.Device, kind: str, light: str, place: str) -> None:
    geom = scenes.geom_xml(kind, more=f'pos="{PLACES[place]} 0 0" euler="10 -5 20"')
    seen, shown = drawn(light, geom, place, device)
    dark = ((seen == 0) & shown).sum() / shown.sum()
    assert {"inside": dark > 0.5, "across": 0.05 < dark < 0.95, "outside": dark < 0.05}[place], dark


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("kind", ["plane", "sheet"])
def test_what_is_open_keeps_it(device: wp.Device, kind: str, light: str) -> None:
    """Nothing lies before its dark side."""
    geom = '<geom type="plane" size=".6 .5 .1" euler="175 5 0"/>'
    if kind == "sheet":
        geom = '<geom type="mesh" mesh="s" euler="5 5 0"/>'
    seen, shown = drawn(light, geom, "inside", device, SHEET.format("1 0 4 2 1 4 3 2 4 0 3 4"))
    assert shown.mean() > 0.1
    assert ((seen == 0) & shown).sum() == 0


@pytest.mark.parametrize("lens", [wc.Orthographic(height=4.0), wc.Fisheye(fovy=140.0)])
@pytest.mark.parametrize("light", ["directional", "spot"])
def test_other_lenses(device: wp.Device, light: str, lens: wc.Lens) -> None:
    """From below a wide box is dark as far as the map reaches, and shows the ambient part outside."""
    mjm = mapped(LIGHTS[light] + '<geom type="box" size="2 2 .2" rgba="1 1 1 1"/>')
    half = (1.0, 2.2 * np.tan(np.radians(27.0)))[light == "spot"]  # of the map, at the height of the dark side
    turned = scenes.looking((0, 0, -1.2), (0.3, -0.6, 0), (0.6, 0.8, 0))
    camera = scenes.own_camera(
        outputs=("hdr", "points", "segmentation"),
        shadows=True,
        position=(0.0, 0.0, -1.2),
        rotation=turned,
        lens=lens,
        width=64,
        height=64,
    )
    images = {
        name: image[0]
        for name, image in scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera).items()
    }
    shown = images["segmentation"] == 0
    points, light_left = images["points"][shown], images["hdr"][shown]
    beyond = np.maximum(np.abs(points[:, 0]), np.abs(points[:, 1] - 0.1)) - half
    assert (beyond < -0.02).sum() > 200 and (beyond > 0.02).sum() > 200
    assert (light_left[beyond < -0.02] == 0.0).all()
    np.testing.assert_allclose(
        light_left[beyond > 0.02], np.tile((0.5, 0.4, 0.3), ((beyond > 0.02).sum(), 1)), atol=1e-6
    )
