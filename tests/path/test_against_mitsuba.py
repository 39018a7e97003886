"""Images of Mitsuba 3, an independent path tracer: stored by references/make_references.py.

Compared are the means of blocks of pixels, without pixels at edges, as the two draw different places within a pixel.
"""

import os
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from path_scenes import BLOCK

pytest.importorskip("pxr.Usd")
import judged_scenes as judged
from judged_stages import CAMERA, judged_pixels, scene_of
from path_scenes import traced
from pxr import Usd

REFERENCES = Path(__file__).parent / "references"
# With the kernels that users have there is time for as many paths as the promise is of; else noise is most of an error.
OPTIMIZED = os.environ.get("WARPCAM_TESTS") == "optimized"
SAMPLES, MEAN, BLOCKS = (4096, 0.005, 0.01) if OPTIMIZED else (16, 0.03, 0.06)


def block_means(image: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Means of the chosen pixels of each block that has a quarter of its own among them, (block, channel)."""
    parts = chosen.shape[0] // BLOCK
    sums = np.where(chosen[..., None], image, 0.0).reshape(parts, BLOCK, parts, BLOCK, -1).sum(axis=(1, 3))
    counts = chosen.reshape(parts, BLOCK, parts, BLOCK).sum(axis=(1, 3))
    enough = counts >= BLOCK * BLOCK // 4
    return sums[enough] / counts[enough][:, None]


@pytest.mark.parametrize("name", judged.SCENES)
def test_images_are_mitsubas(stage: Usd.Stage, name: str, device: wp.Device) -> None:
    wanted = np.load(REFERENCES / judged.file_name(name)).astype(np.float64)
    images = traced(scene_of(stage, judged.SCENES[name], device), CAMERA, SAMPLES)
    chosen = judged_pixels(images)
    assert chosen.sum() > 1000
    seen, wanted = block_means(images["hdr"], chosen), block_means(wanted, chosen)
    assert seen.mean() == pytest.approx(wanted.mean(), rel=MEAN)
    assert np.abs(seen - wanted).mean() / wanted.mean() < BLOCKS
