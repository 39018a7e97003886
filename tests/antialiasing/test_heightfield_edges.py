"""Smooth edges before height fields."""

import numpy as np
import pytest
import scenes
import warp as wp
from edge_scenes import LIT, camera

import warpcam as wc
from warpcam.kernels.passes.antialiasing import SAMPLES

FIELD = '<hfield name="wide" nrow="3" ncol="3" size="3 3 0.02 0.2" elevation="0 1 0  1 0 1  0 1 0"/>'


SLAB = '<hfield name="slab" nrow="3" ncol="3" size="0.9 0.7 0.01 0.6" elevation="0 0 0  0 1 0  0 0 0"/>'
SUN = """<visual><headlight ambient="0.2 0.2 0.2" diffuse="0 0 0" specular="0 0 0"/></visual>"""


def off_by(things: str, device: wp.Device, more: str = LIT) -> tuple[np.ndarray, np.ndarray]:
    """The mean of what four samples of each pixel hit, and by how many levels a picture with smooth edges is off it."""
    mjm = scenes.compile_xml(things, assets=scenes.ASSETS + FIELD + SLAB, more=more)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)

    def look(right: float, down: float, samples: int) -> np.ndarray:
        lens = wc.Pinhole(fx=28.0, cx=16.0 - right, cy=16.0 - down)
        return scenes.look(scene, camera(samples, lens=lens, position=(0.0, 0.0, 3.5)))["rgb"][0].astype(int)

    expected = np.mean([look(*offset, 1) for offset in SAMPLES[4]], axis=0)
    return expected, np.abs(look(0.0, 0.0, 4) - expected).max(-1)


@pytest.mark.parametrize("gap", [-0.7, 0.02, 0.5])
@pytest.mark.parametrize("kind", ["sphere", "mesh"])
def test_ground_is_seen_where_nothing_else_is(device: wp.Device, kind: str, gap: float) -> None:
    """Far behind all else it is not looked for, else it is: a pixel is the mean of what its samples hit."""
    thing = scenes.geom_xml(kind, more=f'pos="0.1 0.05 {gap + 0.5}" rgba="1 0 0 1"')
    expected, off = off_by(thing + '<geom type="hfield" hfield="wide" rgba="0 1 0 1"/>', device)
    mixed = (expected[..., 0] > 0) & (expected[..., 1] > 0)
    assert mixed.sum() > 10
    assert (off > 1.0).sum() <= 0.05 * mixed.sum()


def test_of_two_grounds_the_one_behind_is_seen(device: wp.Device) -> None:
    """Also where they meet behind something thin."""
    things = "".join(
        f'<geom type="capsule" fromto="-1 {y} 1 1 {y + 0.3} 1" size="0.05" rgba="1 0 0 1"/>'
        for y in np.arange(-1.0, 1.0, 0.25)
    )
    grounds = "".join(
        f'<geom type="hfield" hfield="wide" pos="{x} 0 0" rgba="{rgba}"/>'
        for x, rgba in ((-2.93, "0 1 0 1"), (3.07, "0 0 1 1"))
    )
    _, off = off_by(things + grounds, device)
    assert (off > 20.0).sum() <= 5


@pytest.mark.parametrize("beside", ["", scenes.geom_xml("mesh", more='pos="-1.3 1.2 1"')], ids=["alone", "with a mesh"])
@pytest.mark.parametrize("turn", ["50 25 10", "-40 35 80", "140 20 30"])
def test_the_ground_meets_its_sides_and_its_base(device: wp.Device, turn: str, beside: str) -> None:
    """A sample shows its own part: next to an edge between two of them the nearest pixel often shows the other."""
    sun = '<light directional="true" dir="0.5 0.8 -0.9" diffuse="0.8 0.8 0.8" specular="0 0 0"/>'
    slab = f'<geom type="hfield" hfield="slab" euler="{turn}" pos="0.1 0 1" rgba="0.9 0.9 0.9 1"/>'
    expected, off = off_by(sun + slab + beside, device, SUN)
    shown = np.unique(expected[..., 0].round(), return_counts=True)[1]
    assert (shown > 20).sum() >= 3  # two parts at least, and what is behind
    assert (off > 12.0).sum() <= 3
