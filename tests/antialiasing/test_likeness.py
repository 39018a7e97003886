"""Smooth edges beside those of MuJoCo's own renderer, which has four samples, too."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from edge_scenes import LIT
from mujoco_reference import reference_renderer

import warpcam as wc

SIZE = 96
COUNT = 40


def heap(least: float) -> mujoco.MjModel:
    """Boxes of random sizes, turns and colours in a cube of 1 m, evenly lit; ``least`` is half of a side [m]."""
    random = np.random.default_rng(0)
    geoms = ""
    for _ in range(COUNT):
        position, turn = random.uniform(-0.5, 0.5, 3), random.uniform(0.0, 180.0, 3)
        half, color = random.uniform(least, 0.15, 3), random.uniform(0.0, 1.0, 3)
        words = [" ".join(map(str, values)) for values in (position, turn, half, color)]
        geoms += '<geom type="box" pos="{}" euler="{}" size="{}" rgba="{} 1"/>'.format(*words)
    eye = '<camera name="eye" pos="0 -2.2 0" xyaxes="1 0 0 0 0 1" fovy="35"/>'
    return scenes.compile_xml(geoms + eye, more=LIT)


@pytest.mark.parametrize("least", [0.02, 0.004])  # a pixel is 15 mm
def test_coverage_is_that_of_mujocos_samples(least: float, device: wp.Device) -> None:
    """MuJoCo's picture of four samples is met better by far than by its own picture with 64.

    Without light and shade its samples have a triangle's own colour, so that only where they lie is compared.
    """
    mjm = heap(least)
    mjd = scenes.forward(mjm)
    camera = wc.Camera("eye", width=SIZE, height=SIZE, outputs=("rgb",), antialiasing=4)
    ours = scenes.look(wc.from_mujoco(mjm, mjd, device=device), camera)["rgb"][0]
    pictures = []
    for pixels in (SIZE, 4 * SIZE):
        with reference_renderer(mjm, pixels, pixels) as renderer:
            renderer.update_scene(mjd, camera="eye")
            pictures.append(renderer.render().astype(np.float64))
    judge = pictures[0]
    finer = pictures[1].reshape(SIZE, 4, SIZE, 4, 3).mean(axis=(1, 3))

    def psnr(picture: np.ndarray) -> float:
        return float(10.0 * np.log10(255.0**2 / np.square(judge - picture).mean()))

    assert psnr(ours) > max(40.0, psnr(finer) + 5.0), (psnr(ours), psnr(finer))
