"""Cameras that do not see some bodies."""

from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.core.errors import WarpcamError
from warpcam.outputs import OUTPUTS

BODIES = {
    "floor": scenes.geom_xml("plane", size=(3.0, 3.0, 0.1), more='rgba=".5 .4 .3 1"'),
    "ball": scenes.geom_xml("sphere", more='rgba=".2 .6 .9 1"'),
    "crate": scenes.geom_xml("box", more='rgba=".9 .6 .2 1"') + scenes.geom_xml("mesh", more='pos=".9 .3 .2"'),
    "hills": scenes.geom_xml("hfield"),
}
PLACES = {"floor": (0, 0, -0.6), "ball": (0.2, 0.1, 0.8), "crate": (0.0, 0.0, 0.0), "hills": (-1.0, 0.9, -0.3)}
EYE = {"position": (0.3, -3.0, 1.2), "rotation": scenes.looking((0.3, -3.0, 1.2), (0.0, 0.0, 0.1)), "width": 48}
COLORS = {"albedo", "hdr", "rgb", "rgba"}


def model() -> mujoco.MjModel:
    world = '<light pos=".5 .2 3" castshadow="true"/><light pos="-1 -1 2"/>'
    for name, geoms in BODIES.items():
        world += f'<body name="{name}" pos="{" ".join(map(str, PLACES[name]))}">{geoms}</body>'
    return scenes.compile_xml(world, assets=scenes.ASSETS)


def rendered(device: wp.Device, excluded: Any = (), hidden: Any = (), **settings: Any) -> dict[str, np.ndarray]:
    mjm = model()
    for name in hidden:
        mjm.geom_rgba[mjm.geom_bodyid == mjm.body(name).id, 3] = 0.0
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    return scenes.look(scene, scenes.own_camera(exclude_bodies=excluded, **EYE, **settings))


@pytest.mark.parametrize("excluded", ["floor", "ball", ("crate",), ("hills", "ball"), tuple(BODIES)], ids=str)
@pytest.mark.parametrize("lens", ["pinhole", "table"])
def test_images_are_those_without_the_bodies(device: wp.Device, excluded: Any, lens: str) -> None:
    outputs = tuple(name for name in OUTPUTS if lens == "pinhole" or not name.startswith("flow"))
    settings = {"outputs": outputs, "lens": wc.Pinhole(fovy=60.0) if lens == "pinhole" else wc.Fisheye(fovy=90.0)}
    hidden = (excluded,) if isinstance(excluded, str) else excluded
    seen, expected = rendered(device, excluded, **settings), rendered(device, hidden=hidden, **settings)
    plain = rendered(device, **settings)
    assert (plain["segmentation"] != seen["segmentation"]).mean() > 0.01
    for name in outputs:
        np.testing.assert_array_equal(seen[name], expected[name], err_msg=name)


def test_bodies_cast_shadows_nevertheless(device: wp.Device) -> None:
    settings = {"outputs": ("rgb", "segmentation"), "shadows": True}
    seen, plain = rendered(device, "ball", **settings), rendered(device, **settings)
    hidden = rendered(device, hidden=("ball",), **settings)
    same = plain["segmentation"] == seen["segmentation"]
    assert 0.5 < same.mean() < 1.0
    np.testing.assert_array_equal(seen["rgb"][same], plain["rgb"][same])
    assert (hidden["rgb"] != seen["rgb"]).any()


def test_other_cameras_see_all(device: wp.Device) -> None:
    mjm = model()
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    some = wc.Camera("some", height=32, lens=wc.Pinhole(fovy=60.0), outputs=("segmentation",), exclude_bodies=1, **EYE)
    images = wc.Renderer(scene, [some, scenes.own_camera(**EYE)]).render()
    np.testing.assert_array_equal(images["eye"]["segmentation"].cpu().numpy()[..., 0], rendered(device)["segmentation"])
    assert mjm.geom("plane").id in images["eye"]["segmentation"]
    assert mjm.geom("plane").id not in images["some"]["segmentation"]


@pytest.mark.parametrize(
    ("bodies", "text"),
    [
        (True, "exclude_bodies must be a body's name or index, or a sequence of these, got True"),
        (None, "exclude_bodies must be a body's name or index, or a sequence of these, got None"),
        ([1.5], "exclude_bodies must be a body's name or index"),
        ("bal", "exclude_bodies: the scene has no body 'bal'"),
        (99, "exclude_bodies: the scene has no body 99"),
    ],
)
def test_bodies_that_are_not_there(bodies: Any, text: str) -> None:
    with pytest.raises(WarpcamError, match=text):
        rendered(wp.get_device("cpu"), bodies)
