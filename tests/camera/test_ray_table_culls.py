"""Shapes that tiles and regions of a table of rays leave out, against each ray tested against each shape."""

from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

COUNT = 160  # shapes: more than are looked at one by one
WIDTH, HEIGHT = 150, 70  # pixels: several regions, and parts of tiles at the edges


def spheres(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles and radii of spheres all around the origin, near and far, large and small."""
    random = np.random.default_rng(seed)
    towards = random.normal(size=(COUNT, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    away = random.uniform(0.6, 6.0, COUNT)
    return away[:, None] * towards, random.uniform(0.02, 0.5, COUNT) * np.minimum(away, 2.0) * 0.5


def random_rays(seed: int, spread: float) -> wc.Rays:
    """Rays about directions that turn from row to row, so far apart within a tile; some see nothing."""
    random = np.random.default_rng(seed)
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    azimuth, height = 0.04 * column + 0.3 * row, np.sin(0.09 * row)
    level = np.sqrt(1.0 - height**2)
    rays = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=-1)
    rays += spread * random.normal(size=rays.shape)
    rays[random.random(rays.shape[:2]) < 0.02] = 0.0
    return wc.Rays(rays)


LENSES: dict[str, Any] = {
    "narrow": lambda: wc.Distorted(fx=300.0, fy=300.0, cx=75.0, cy=35.0, coefficients=(-0.1, 0.0, 0.0, 0.0)),
    "wide": lambda: wc.Fisheye(fx=30.0, fy=30.0, cx=75.0, cy=35.0),
    "all around": lambda: wc.Equirectangular(),
    "turning": lambda: random_rays(0, 0.01),
    "scattered": lambda: random_rays(1, 1.0),
}


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("seed", [0, 1])
def test_no_shape_is_left_out_that_a_ray_meets(lens: str, seed: int, device: wp.Device) -> None:
    made = LENSES[lens]()
    middles, radii = spheres(seed)
    xml = "".join(
        f'<geom size="{radius}" pos="{" ".join(map(str, middle))}"/>'
        for middle, radius in zip(middles, radii, strict=True)
    )
    mjm = scenes.compile_xml(xml)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    asked = scenes.own_camera(
        width=WIDTH, height=HEIGHT, lens=made, outputs=("distance", "segmentation"), rotation=(0.8, 0.2, -0.5, 0.3)
    )
    seen = scenes.look(scene, asked)
    turn = scenes.matrix((0.8, 0.2, -0.5, 0.3))
    rays = made.rays(WIDTH, HEIGHT, 1, "")[0]
    lengths = np.linalg.norm(rays, axis=-1, keepdims=True)
    rays = np.divide(rays, lengths, out=np.zeros_like(rays), where=lengths > 0.0) @ turn.T
    along = np.einsum("ijc,nc->ijn", rays, middles)
    square = radii**2 - (middles**2).sum(axis=1) + along**2  # of half the way within a sphere
    distance = np.where((square > 0.0) & (along > 0.0), along - np.sqrt(np.maximum(square, 0.0)), np.inf)
    clear = (np.abs(square) > 1e-4).all(axis=-1)  # rays that graze nothing
    nearest = distance.min(axis=-1)
    first = np.where(np.isfinite(nearest), distance.argmin(axis=-1), -1)
    np.testing.assert_array_equal(seen["segmentation"][0][clear], first[clear])
    hit = clear & np.isfinite(nearest)
    assert hit.mean() > 0.05
    np.testing.assert_allclose(seen["distance"][0][hit], nearest[hit], rtol=1e-4)
