"""Rays of the real-time look in a browser: which pictures have them, and where they are refused."""

import contextlib
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

pytest.importorskip("viser", reason="needs viser: pip install warpcam[view]")

from viser import transforms

from warpcam.viewer import FREE, ClientCamera, Viewer, ViewSelection

RAYS: dict[str, Any] = {"ambient_occlusion": 0.5, "soft_shadows": True, "reflections": True}
PLACE, ASPECT, FOVY = (0.0, -2.0, 0.5), 1.5, 50.0
THINGS = """
<light pos="0 0 3" bulbradius="0.3"/>
<geom type="plane" size="0 0 1" rgba="0.4 0.5 0.4 1"/>
<geom size="0.2" pos="0 0 0.2" rgba="0.9 0.1 0.1 1"/>
<geom type="box" size="0.1 0.15 0.2" pos="0.35 0 0.2"/>
"""


@pytest.fixture
def scene(device: wp.Device) -> wc.Scene:
    mjm = scenes.compile_xml(THINGS)
    return wc.from_mujoco(mjm, scenes.forward(mjm), device=device)


def drawn(scene: wc.Scene, output: str, look: Any, **rays: Any) -> np.ndarray:
    """What a camera at PLACE that looks along +Y sees, of the display colours of an output."""
    camera = wc.Camera(
        "own",
        width=48,
        height=32,
        outputs=(output,),
        lens=wc.Pinhole(fovy=FOVY),
        position=PLACE,
        rotation=scenes.looking(PLACE, (0.0, 0.0, 0.5)),
        shadows=True,
        antialiasing=4,
    )
    return wc.Renderer(scene, [camera], look=look, **rays).render()["own"][output][0].cpu().numpy()


def test_pictures_of_the_real_time_look_alone_have_rays(scene: wc.Scene) -> None:
    turn = transforms.SO3.from_matrix(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]))
    eye = ClientCamera(PLACE, tuple(turn.wxyz), float(np.radians(FOVY)), ASPECT)
    with contextlib.closing(Viewer(scene, width=48, height=32, port=8310, look="pbr", **RAYS)) as viewer:
        depth = viewer.picture(ViewSelection("depth", FREE, 0, look="pbr"), eye)
        assert len(np.unique(depth)) > 10  # which has no rays, and is drawn
        for look, rays in (("pbr", RAYS), ("mujoco", {})):
            picture = viewer.picture(ViewSelection("rgb", FREE, 0, look=look), eye)
            wrong = np.abs(picture.astype(int) - drawn(scene, "rgb", look, **rays)).max(-1) > 2
            assert wrong.mean() < 0.01, look
    plain, rays = (drawn(scene, "rgb", "pbr", **each).astype(int) for each in ({}, RAYS))
    assert (np.abs(plain - rays).max(-1) > 2).mean() > 0.05


@pytest.mark.parametrize("look", [None, "path"])
@pytest.mark.parametrize("name", [*RAYS, "indirect_light"])
def test_rays_are_refused_where_the_page_begins_with_another_look(name: str, look: Any, scene: wc.Scene) -> None:
    value = RAYS.get(name, True)
    told = f"Viewer: {name} is {value}, which is of look='pbr', and the look is {(look or 'mujoco')!r}"
    with pytest.raises(wc.WarpcamError, match=told):
        Viewer(scene, look=look, **{name: value})
