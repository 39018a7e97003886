"""Ray tables that lenses write: their numbers, without a scene."""

import numpy as np
import pytest
from custom_ray_tables import HEIGHT, WIDTH, curled_rays, random_rays

import warpcam as wc
from warpcam.accel import offset_ray_tables, ray_tables


def test_cones_hold_their_rays() -> None:
    """Whatever a tile's rays are, they lie in its cone; and all are in the table."""
    for rays in (random_rays(7), curled_rays(), -np.abs(random_rays(8)), np.tile(random_rays(9)[:1, :1], (6, 5, 1))):
        unit = ray_tables.unit(rays[None])
        height, width = rays.shape[:2]
        packed = ray_tables.pack_rays(rays[None])
        tiles = -(-width // 8) * -(-height // 4)
        cones = packed[0, : 4 * tiles].reshape(-(-height // 4), -(-width // 8), 4).repeat(4, axis=0).repeat(8, axis=1)
        cones = cones[:height, :width]
        along = (cones[..., :3] * unit[0]).sum(axis=-1)
        assert (along >= cones[..., 3] - 1e-6).all()
        x, y = np.moveaxis(packed[0, 4 * tiles : 4 * tiles + 2 * height * width].reshape(height, width, 2), -1, 0)
        x, y = x.astype(np.float64), y.astype(np.float64)
        rate = 2.0 / (1.0 + x * x + y * y)
        back = np.stack([rate * x, rate * y, 1.0 - rate], axis=-1)
        assert np.abs(back - unit[0]).max() < 3e-7
    narrow = ray_tables.tile_cones(ray_tables.unit(wc.Fisheye(fovy=90.0).rays(64, 64, 1, "lens")))[0]
    assert (np.degrees(np.arccos(narrow[:, 3])) < 8.0).all()  # or tiles would see what they need not


def test_directions_straight_back() -> None:
    points = ray_tables.flattened(
        ray_tables.unit(np.array([[0.0, 0.0, 1.0], [1e-9, 0.0, 1.0], [1e-3, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    )
    assert np.isfinite(points).all()
    rate = 2.0 / (1.0 + (points[:3] ** 2).sum(axis=-1))
    np.testing.assert_allclose(rate * points[:3, 0], [0.0, 0.0, 1e-3], atol=1e-6)
    assert points[3, 0] >= 1e18  # sees nothing


def test_fisheyes_numbers() -> None:
    k = (0.05, -0.01, 0.002, -0.0003)
    rays = ray_tables.unit(wc.Fisheye(fx=20.0, fy=21.0, cx=22.0, cy=14.0, k=k).rays(WIDTH, HEIGHT, 1, "lens")[0])
    angle = np.arccos(-rays[..., 2])
    bent = angle * (1 + sum(one * angle ** (2 * power + 2) for power, one in enumerate(k)))
    length = np.hypot(rays[..., 0], rays[..., 1])
    column, row = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    np.testing.assert_allclose(20.0 * bent * rays[..., 0] / length + 22.0, column, atol=1e-9)
    np.testing.assert_allclose(14.0 - 21.0 * bent * rays[..., 1] / length, row, atol=1e-9)
    edge = wc.Fisheye(fovy=220.0, k=(0.02, 0.0, 0.0, 0.0)).rays(1, 2001, 1, "lens")[0, :, 0]
    assert np.degrees(np.arccos(-ray_tables.unit(edge)[0, 2])) == pytest.approx(110.0, abs=0.2)
    folds = wc.Fisheye(fx=10.0, k=(-0.2, 0.0, 0.0, 0.0)).rays(64, 64, 1, "lens")
    greatest = np.degrees(np.arccos(-ray_tables.unit(folds)[folds.any(axis=-1)][:, 2]).max())
    assert greatest < np.degrees(np.sqrt(1 / 0.6)) and not folds[0, 0, 0].any()


def test_distortion_is_opencvs() -> None:
    """The rays, distorted as OpenCV's manual says, come to the pixels' centres."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = numbers = (
        -0.28, 0.07, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001, 0.002, -0.001, 0.001, 0.0005,
    )  # fmt: skip
    lens = wc.Distorted(fx=40.0, fy=41.0, cx=23.0, cy=13.0, coefficients=numbers)
    rays = lens.rays(WIDTH, HEIGHT, 1, "lens")[0]
    assert rays.any(axis=-1).all()
    x, y = -rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]
    r = x * x + y * y
    radial = (1 + k1 * r + k2 * r**2 + k3 * r**3) / (1 + k4 * r + k5 * r**2 + k6 * r**3)
    u = x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x) + s1 * r + s2 * r * r
    v = y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y + s3 * r + s4 * r * r
    column, row = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    np.testing.assert_allclose(40.0 * u + 23.0, column, atol=1e-3)
    np.testing.assert_allclose(41.0 * v + 13.0, row, atol=1e-3)
    folded = wc.Distorted(fx=10.0, coefficients=(-0.4, 0.0, 0.0, 0.0)).rays(WIDTH, HEIGHT, 1, "lens")[0]
    assert folded[13, 22].any() and not folded[0, 0].any()  # no ray comes to the corner


def test_balls_hold_where_rays_begin() -> None:
    """And cones the rays, of each tile; pixels have theirs to the last digit of float32."""
    random = np.random.default_rng(4)
    rays, places = random_rays(5), random.normal(size=(HEIGHT, WIDTH, 3)) * (1.0, 20.0, 0.01)
    rays[:9, :17] = 0.0  # whole tiles see nothing
    packed = offset_ray_tables.pack_offset_rays(rays[None], places[None])[0]
    assert len(packed) == offset_ray_tables.offset_table_floats(WIDTH, HEIGHT)
    seeing, tiles = rays.any(axis=-1), (-(-HEIGHT // 4), -(-WIDTH // 8))
    whole, by_tile, pixels = np.split(packed, [4, 4 + 8 * tiles[0] * tiles[1]])
    assert (np.linalg.norm(places - whole[:3], axis=-1)[seeing] <= whole[3]).all()
    by_tile = by_tile.reshape(*tiles, 8).repeat(4, axis=0).repeat(8, axis=1)[:HEIGHT, :WIDTH]
    cones, balls = by_tile[..., :4], by_tile[..., 4:]
    unit = ray_tables.unit(rays)
    assert ((cones[..., :3] * unit).sum(axis=-1) >= cones[..., 3] - 1e-6)[seeing].all()
    off = np.linalg.norm(places.astype(np.float32) - balls[..., :3], axis=-1)
    assert (off <= balls[..., 3] * (1 + 1e-6))[seeing].all()
    assert (balls[:8, :16, 3] == 0.0).all() and balls[..., 3].max() < whole[3]
    pixels = pixels.reshape(HEIGHT, WIDTH, 8)
    assert (pixels[seeing][:, :3] == places.astype(np.float32)[seeing]).all()
    assert np.abs(pixels[seeing][:, 4:7] - unit[seeing]).max() < 1e-7
    assert (pixels[..., 7].view(np.int32) == WIDTH).all()
    assert ((pixels[..., 3].view(np.int32) == offset_ray_tables.BLIND) == ~seeing).all()


def test_pixels_that_go_on_into_each_other() -> None:
    """Not into what sees nothing, nor over a seam where rays jump or begin elsewhere."""
    column, row = np.meshgrid(np.linspace(-0.5, 0.5, 12), np.linspace(-0.5, 0.5, 9))
    rays = np.stack([column, row, -np.ones_like(row)], axis=-1)
    places = 0.1 * np.stack([column, row, row], axis=-1)
    places[:, 5:] += 0.3  # begins elsewhere
    rays[4:] += (0.0, 0.4, 0.0)  # jumps
    rays[0, 2] = 0.0
    seeing = rays.any(axis=-1)
    bits = offset_ray_tables.bits_of(ray_tables.unit(rays)[None], places[None].astype(np.float32), seeing[None])[0]
    every = offset_ray_tables.LEFT | offset_ray_tables.RIGHT | offset_ray_tables.UP | offset_ray_tables.DOWN
    assert bits[2, 2] == every and bits[2, 8] == every
    assert bits[2, 4] == every & ~offset_ray_tables.RIGHT and bits[2, 5] == every & ~offset_ray_tables.LEFT
    assert bits[3, 2] == every & ~offset_ray_tables.DOWN and bits[4, 2] == every & ~offset_ray_tables.UP
    assert bits[0, 2] == offset_ray_tables.BLIND and bits[1, 2] == every & ~offset_ray_tables.UP
    assert (
        bits[0, 0] == offset_ray_tables.RIGHT | offset_ray_tables.DOWN
        and bits[8, 11] == offset_ray_tables.LEFT | offset_ray_tables.UP
    )
    assert (
        offset_ray_tables.bits_of(rays[None], np.zeros_like(places)[None], seeing[None])[0, 2] & offset_ray_tables.LEFT
    )[1:].all()
