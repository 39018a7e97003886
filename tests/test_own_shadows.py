"""Which dark sides lose the ambient part of a light that casts shadows, beside ``mujoco.Renderer``: one shape each.

Those that lie behind what the light falls on, as far as the light's map reaches: shapes stand in it, across its
edge, and outside.
"""

import colour_reference
import numpy as np
import pytest
import scenes
import warp as wp
from golden_scenes import SHEET, compiled

DARK = '<visual><headlight active="0"/></visual>'
COLOURS = 'ambient=".5 .4 .3" diffuse=".5 .5 .5" specular="0 0 0"'
LIGHTS = {  # their maps end near x = 1 at the shapes' height
    "directional": f'<light type="directional" pos="0 .1 2" dir="0 0 -1" {COLOURS}/>',
    "slanted": f'<light type="directional" pos="-1 .6 2" dir=".5 -.3 -1" {COLOURS}/>',
    "spot": f'<light type="spot" pos="0 .1 2" dir="0 0 -1" cutoff="60" exponent="0" {COLOURS}/>',
    "turned spot": f'<light type="spot" pos="-.2 .5 2" dir=".1 -.25 -1" cutoff="60" exponent="1" {COLOURS}/>',
}
CLOSED = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "hfield")
FROM_BELOW = '<camera pos="{} -1 -1.6" xyaxes="1 0 0 0 -1.6 1"/>'
PLACES = {"inside": 0.0, "across": 1.0, "outside": 1.9}


def drawn(light: str, geom: str, place: str, device: wp.Device, assets: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Our image of it, which must be MuJoCo's, and which of its pixels show the shape."""
    world = LIGHTS[light] + geom.replace("/>", ' rgba=".9 .9 .9 1"/>') + FROM_BELOW.format(PLACES[place])
    mjm = compiled(world, assets, DARK)
    mjm.stat.extent, mjm.vis.map.shadowclip, mjm.vis.map.zfar = 1.0, 1.0, 50.0
    mjm.vis.map.shadowscale = 0.45
    seen = colour_reference.check(mjm, device, differs=False, most=0.005)
    mjm.light_castshadow[:] = False
    whole = colour_reference.ours(mjm, scenes.forward(mjm), device)
    return seen.max(axis=-1), whole.max(axis=-1) > 0


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("kind", CLOSED)
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
