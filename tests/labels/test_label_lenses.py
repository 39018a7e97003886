"""Labels through every lens: against images of each instance alone, and against the lenses' own projections."""

from typing import Any

import label_reference
import lens_samples
import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from custom_ray_tables import HEIGHT, WIDTH
from ray_table_scenes import ASSETS, SCENE, camera

import warpcam as wc

PROJECTION = 0.06  # pixels between a lens's formula and rays that are linear between pixels


@pytest.fixture(scope="module")
def model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = scenes.compile_xml(SCENE, assets=ASSETS)
    return mjm, scenes.forward(mjm)


@pytest.mark.parametrize("name", lens_samples.LENSES)
def test_labels_of_each_shape(model: tuple[Any, Any], name: str, device: wp.Device) -> None:
    lens = lens_samples.LENSES[name]()
    scene = wc.from_mujoco(*model, device=device)
    alone = label_reference.AloneImages(scene)
    renderer = wc.Renderer(scene, [camera(lens, outputs=("segmentation", "distance"), near=0.2)])
    image = renderer.render()["own"]["segmentation"][..., 0].cpu().numpy().copy()
    labels = wc.labels(renderer, by="shape")
    found = label_reference.on_host(labels.read()["own"])
    ids = labels.ids[0].tolist()
    assert ids == list(range(model[0].ngeom))
    masks = alone.masks(renderer, [[shape] for shape in ids], "segmentation")["own"]
    slack = 0 if device.is_cpu else 1  # where a ray grazes an edge
    for kind, expected in (("amodal", masks), ("visible", np.stack([image == shape for shape in ids]))):
        boxes, pixels = (numbers[:, 0] for numbers in label_reference.extents(expected))
        assert np.abs(found[f"{kind}_pixels"][0] - pixels).max() <= slack, kind
        assert np.abs(found[f"{kind}_boxes"][0] - boxes).max() <= slack, kind
        assert (pixels > 0).sum() >= 4
    whole, seen = found["amodal_pixels"][0], found["visible_pixels"][0]
    np.testing.assert_allclose(found["visibility"][0], np.where(whole > 0, seen / np.maximum(whole, 1), 0.0), rtol=1e-6)
    assert (seen < whole).any()
    edges = masks[:, 0, [0, -1]].any(axis=(1, 2)) | masks[:, 0, :, [0, -1]].any(axis=(0, 2))
    np.testing.assert_array_equal(found["truncated"][0], edges)

    points = label_reference.box_points(found)[0]
    for pixels, places in ((found["corners"][0], points), (found["centers"][0], points.mean(axis=-2))):
        expected = lens.project(torch.tensor(places), width=WIDTH, height=HEIGHT).numpy()
        inside = ((expected >= 0.5) & (expected <= (WIDTH - 0.5, HEIGHT - 0.5))).all(axis=-1)
        outside = ((expected < -0.1) | (expected > (WIDTH + 0.1, HEIGHT + 0.1)) | np.isnan(expected)).any(axis=-1)
        assert inside.sum() >= 4
        if lens.projection in ("pinhole", "orthographic"):
            np.testing.assert_allclose(pixels, expected, rtol=2e-4, atol=2e-3)
        else:
            np.testing.assert_allclose(pixels[inside], expected[inside], atol=PROJECTION)
            assert np.isnan(pixels[outside]).all()
    np.testing.assert_allclose(found["depths"][0][1:], -points.mean(axis=-2)[1:, 2], atol=1e-5)
