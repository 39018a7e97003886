"""Solids shade what they stand on, however near it is, beside ``mujoco.Renderer``: the far side is what its map has."""

import color_reference
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

DARK = '<visual><headlight active="0"/><quality shadowsize="256"/><map znear="0.001" zfar="20"/></visual>'
COLOURS = 'ambient="0 0 0" diffuse=".8 .8 .8" specular="0 0 0"'
LIGHTS = {  # a quarter of a texel: 20 and 6 mm
    "directional": f'<light type="directional" pos="0 0 4" dir=".04 .05 -1" {COLOURS}/>',
    "spot": f'<light type="spot" pos="-.16 -.2 4" dir=".04 .05 -1" cutoff="60" exponent="0" {COLOURS}/>',
}
TURN = np.radians(12.0)
ROUND = {  # lying on the floor
    "sphere": '<geom size=".15" pos="0 0 {}"/>',
    "capsule": '<geom type="capsule" size=".15 .1" pos="0 0 {}" euler="0 90 0"/>',
    "ellipsoid": '<geom type="ellipsoid" size=".25 .15 .1" pos="0 0 {}"/>',
    "cylinder": '<geom type="cylinder" size=".15 .1" pos="0 0 {}" euler="0 90 0"/>',
}
TILTED = {  # on an edge, open towards the camera
    "box": '<geom type="box" size=".1 .15 .1" pos="0 0 {}" euler="-12 0 0"/>',
    "standing cylinder": '<geom type="cylinder" size=".15 .1" pos="0 0 {}" euler="-12 0 0"/>',
}


def places(kind: str) -> tuple[str, float, float]:
    """The shape 0.2 mm over the floor, and from where to where along y it is very near to that."""
    if kind in ROUND:
        return ROUND[kind].format(0.1002 if kind == "ellipsoid" else 0.1502), -0.03, 0.0
    edge = 0.15 * np.cos(TURN) - 0.1 * np.sin(TURN)
    return TILTED[kind].format(0.0002 + 0.15 * np.sin(TURN) + 0.1 * np.cos(TURN)), edge - 0.02, edge - 0.002


@pytest.mark.parametrize("crowd", [0, 400])
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("kind", [*ROUND, *TILTED])
def test_solids_shade_what_they_stand_on(device: wp.Device, kind: str, light: str, crowd: int) -> None:
    geom, first, last = places(kind)
    far = "".join(f'<geom size="0.01" pos="0 {-60 - 0.1 * i} 0"/>' for i in range(crowd))
    turned = scenes.looking((0, -0.6, 0.1), (0, 0.5 * (first + last), 0))
    floor, eye = '<geom type="plane" size="3 3 .5"/>', '<camera pos="0 -.6 .1" quat="{} {} {} {}" fovy="4"/>'
    mjm = scenes.compile_xml(LIGHTS[light] + floor + geom + far + eye.format(*turned), more=DARK)
    mjm.stat.extent = 10.0
    mjd = scenes.forward(mjm)
    camera = wc.Camera(0, width=color_reference.SIZE, height=color_reference.SIZE, outputs=("points", "segmentation"))
    seen = scenes.look(wc.from_mujoco(mjm, mjd, device=device), camera)
    y = seen["points"][0][..., 1]
    near = (seen["segmentation"][0] == 0) & (first < y) & (y < last)
    assert near.sum() > 300
    for image in (color_reference.paint(mjm, mjd), color_reference.ours(mjm, mjd, device)):
        assert (image[near].max(axis=-1) == 0).mean() > 0.98
    mjm.light_castshadow[:] = False
    assert color_reference.ours(mjm, mjd, device)[near].min() > 20
