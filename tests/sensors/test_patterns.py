"""Patterns of lidars: their rays against the figures of their sources, and what they refuse."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warpcam.core.errors import WarpcamError
from warpcam.sensors import patterns


def angles(pattern: patterns.Pattern) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth, counter-clockwise from x, and elevation of each ray [degrees]."""
    x, y, z = np.moveaxis(pattern.directions.astype(np.float64), -1, 0)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(np.clip(z, -1.0, 1.0)))


def turns(azimuths: np.ndarray) -> np.ndarray:
    """Differences from column to column in (-180, 180] [degrees]."""
    return -((-np.diff(azimuths, axis=1) + 180.0) % 360.0 - 180.0)


@pytest.mark.parametrize(
    ("name", "fov", "near", "far"), [("os0", 90.0, 0.2, 35.0), ("os1", 45.0, 0.7, 90.0), ("os2", 22.5, 0.7, 200.0)]
)
@pytest.mark.parametrize("channels", [32, 64, 128])
def test_ouster(name: str, fov: float, near: float, far: float, channels: int) -> None:
    pattern = getattr(patterns, f"ouster_{name}")(channels, columns=512, rate=20)
    azimuth, elevation = angles(pattern)
    assert pattern.directions.shape == (channels, 512, 3) and pattern.origins is None
    np.testing.assert_allclose(elevation[:, 7], np.linspace(fov / 2, -fov / 2, channels), atol=1e-4)
    np.testing.assert_allclose(turns(azimuth), -360.0 / 512, atol=1e-3)  # clockwise
    np.testing.assert_allclose(np.abs(azimuth[:, 0]), 180.0, atol=1e-3)  # from the back on
    np.testing.assert_allclose(pattern.times, np.arange(512)[None] / (20 * 512) + np.zeros((channels, 1)), rtol=1e-5)
    assert (pattern.min_range, pattern.max_range, pattern.rate) == (near, far, 20.0)
    assert pattern.rings.tolist() == list(range(channels))


def test_vlp16() -> None:
    pattern = patterns.velodyne_vlp16()
    azimuth, elevation = angles(pattern)
    assert pattern.directions.shape == (16, 1808, 3)
    np.testing.assert_allclose(elevation[:, 5], np.arange(15, -16, -2), atol=1e-4)
    assert pattern.rings.tolist() == list(range(15, -1, -1))
    # Lasers fire in the order -15, 1, -13, 3, ...; the head turns on meanwhile.
    order = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]
    delays = {angle: 2.304e-6 * k for k, angle in enumerate(order)}
    times = np.array([delays[angle] for angle in range(15, -16, -2)])
    np.testing.assert_allclose(pattern.times[:, 0], times, rtol=1e-5)
    np.testing.assert_allclose(pattern.times[:, 100], times + 100 * 55.296e-6, rtol=1e-5)
    np.testing.assert_allclose(azimuth[:, 100], -3600.0 * pattern.times[:, 100], atol=2e-3)
    assert pattern.max_range == 100.0


def test_vlp32c() -> None:
    pattern = patterns.velodyne_vlp32c(rate=20.0)
    azimuth, elevation = angles(pattern)
    assert pattern.directions.shape == (32, 904, 3)
    highest = [15.0, 10.333, 7.0, 4.667, 3.333, 2.333, 1.667, 1.333, 1.0, 0.667, 0.333, 0.0]
    np.testing.assert_allclose(elevation[:12, 0], highest, atol=1e-4)
    np.testing.assert_allclose(elevation[-4:, 0], [-8.843, -11.31, -15.639, -25.0], atol=1e-4)
    assert len(np.unique(elevation[:, 0].round(3))) == 32 and (np.diff(elevation[:, 0]) < 0.0).all()
    offsets = azimuth[:, 0] + 7200.0 * pattern.times[:, 0]
    assert set(np.round(offsets, 2)) == {-4.2, -1.4, 1.4, 4.2}
    np.testing.assert_allclose(offsets[[0, 1, -1]], [1.4, -1.4, -1.4], atol=1e-3)  # lasers 29, 30 and 0
    assert sorted(np.round(pattern.times[:, 0] / 2.304e-6)) == sorted(np.arange(32) // 2)


def test_hdl64e() -> None:
    pattern = patterns.velodyne_hdl64e()
    _, elevation = angles(pattern)
    assert pattern.directions.shape == (64, 2083, 3)
    np.testing.assert_allclose(elevation[[0, 31, 32, 63], 0], [2.0, -8.3333, -8.83, -24.33], atol=1e-3)
    np.testing.assert_allclose(np.diff(elevation[:32, 0]), -1.0 / 3.0, atol=1e-3)
    np.testing.assert_allclose(np.diff(elevation[32:, 0]), -0.5, atol=1e-3)


def test_hesai() -> None:
    azimuth, elevation = angles(patterns.hesai_xt32())
    assert azimuth.shape == (32, 2000)
    np.testing.assert_allclose(elevation[:, 0], np.arange(15, -17, -1), atol=1e-4)
    np.testing.assert_allclose(patterns.hesai_xt32().times[31, 1], 50e-6 + 0.368e-6 + 31 * 1.512e-6, rtol=1e-5)

    pattern = patterns.hesai_qt128(columns=600)
    azimuth, elevation = angles(pattern)
    assert azimuth.shape == (128, 600)
    np.testing.assert_allclose(elevation[[0, -1], 0], [52.63, -52.63], atol=1e-2)
    by_laser = dict(zip(pattern.rings.tolist(), zip(elevation[:, 0], azimuth[:, 0], strict=True), strict=True))
    for laser, mirror in ((0, 127), (31, 96)):
        np.testing.assert_allclose(by_laser[laser], -np.array(by_laser[mirror]), atol=1e-4)
    np.testing.assert_allclose(by_laser[0], (-52.63, -10.11), atol=1e-2)
    np.testing.assert_allclose(by_laser[32], (-18.33, 6.22), atol=1e-2)
    np.testing.assert_allclose(by_laser[95], (35.55, -7.33), atol=1e-2)

    azimuth, elevation = angles(patterns.hesai_at128())
    assert azimuth.shape == (128, 1200)
    np.testing.assert_allclose(elevation[[0, 63, 64, 127], 0], [12.93, 0.33, 0.13, -12.47], atol=1e-3)
    np.testing.assert_allclose(azimuth[[0, 1, 16, 17], 0], [57.6, 60.65, 62.4, 59.35], atol=1e-3)
    np.testing.assert_allclose(azimuth[0, 0] - azimuth[0, -1], 119.9, atol=1e-3)


def test_bpearl() -> None:
    pattern = patterns.robosense_bpearl()
    _, elevation = angles(pattern)
    assert pattern.directions.shape == (32, 1801, 3)
    np.testing.assert_allclose(elevation[[0, 1, 24, 31], 3], [89.5, 86.6875, 22.0, 2.3125], atol=1e-3)
    assert patterns.robosense_bpearl(columns=36).columns == 36


def test_grid() -> None:
    pattern = patterns.grid((1.6, 1.0), 0.1)
    assert pattern.directions.shape == (11, 17, 3)
    assert (pattern.directions == (0.0, 0.0, -1.0)).all()
    np.testing.assert_allclose(pattern.origins[3, :, 0], np.linspace(-0.8, 0.8, 17), atol=1e-6)
    np.testing.assert_allclose(pattern.origins[:, 5, 1], np.linspace(-0.5, 0.5, 11), atol=1e-6)
    other = patterns.grid((1.6, 1.0), 0.1, ordering="yx", direction=(1.0, 0.0, -1.0), max_range=3.0)
    np.testing.assert_array_equal(other.origins, pattern.origins.transpose(1, 0, 2))
    np.testing.assert_allclose(other.directions[0, 0], (0.5**0.5, 0.0, -(0.5**0.5)), rtol=1e-6)
    assert patterns.grid((0.0, 0.0), 1.0).directions.shape == (1, 1, 3)


def test_any_rays() -> None:
    directions = np.array([[(0.0, 0.0, 5.0), (3.0, 0.0, 4.0)], [(0.0, 0.0, 0.0), (0.0, -1.0, 0.0)]])
    pattern = patterns.rays(directions, times=[[0.0, 0.1], [0.2, 0.3]], rate=2.0, max_range=7.0)
    np.testing.assert_allclose(pattern.directions, [[(0, 0, 1), (0.6, 0, 0.8)], [(0, 0, 0), (0, -1, 0)]], rtol=1e-6)
    assert replace(pattern, max_range=3.0).max_range == 3.0 and pattern.rows == pattern.columns == 2


def livox_file(path: Path, rays: int) -> Path:
    lines = [f"{k},{(37.0 * k) % 360.0},{40.0 + k % 50}" for k in range(rays)]
    path.write_text("Time/s,Azimuth/deg,Zenith/deg\n" + "\n".join(lines) + "\n")
    return path


def test_livox(tmp_path: Path) -> None:
    pattern = patterns.livox_csv(livox_file(tmp_path / "some.csv", 60), samples=24, rate=10.0)
    assert pattern.directions.shape == (4, 6, 3) and pattern.table.shape == (60, 3)
    azimuth, elevation = angles(pattern)
    k = np.arange(24).reshape(6, 4).T
    np.testing.assert_allclose(azimuth % 360.0, (37.0 * k) % 360.0, atol=1e-4)
    np.testing.assert_allclose(elevation, 50.0 - k % 50, atol=1e-4)
    np.testing.assert_allclose(pattern.times, k / 240.0, rtol=1e-5)


def test_ouster_metadata(tmp_path: Path) -> None:
    path = tmp_path / "sensor.json"
    beams = {
        "beam_altitude_angles": [20.0, 1.0, -19.0],
        "beam_azimuth_angles": [4.2, -1.4, 0.0],
        "lidar_origin_to_beam_origin_mm": 15.806,
    }
    path.write_text(json.dumps({"config_params": {"lidar_mode": "512x20"}, "beam_intrinsics": beams}))
    pattern = patterns.ouster_metadata(path, max_range=50.0)
    azimuth, elevation = angles(pattern)
    assert azimuth.shape == (3, 512) and pattern.rate == 20.0 and pattern.max_range == 50.0
    np.testing.assert_allclose(elevation[:, 0], [20.0, 1.0, -19.0], atol=1e-4)
    stack = 180.0 - 360.0 * 128 / 512
    np.testing.assert_allclose(azimuth[:, 128], [stack - 4.2, stack + 1.4, stack], atol=1e-3)
    np.testing.assert_allclose(pattern.origins[1, 128], (0.0, 0.015806, 0.0), atol=1e-6)
    path.write_text(json.dumps({"beam_altitude_angles": [1.0]}))
    with pytest.raises(WarpcamError, match="there is no beam_azimuth_angles, lidar_mode"):
        patterns.ouster_metadata(path)
    path.write_text("no json")
    with pytest.raises(WarpcamError, match=r"ouster_metadata: .*cannot be read"):
        patterns.ouster_metadata(path)


ONE = np.array([[(1.0, 0.0, 0.0)]])


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: patterns.rays(np.zeros((2, 3))), r"directions must have shape \(rows, columns, 3\), got \(2, 3\)"),
        (lambda: patterns.rays(np.zeros((2, 2, 3))), "directions are all 0"),
        (lambda: patterns.rays(np.full((1, 1, 3), np.nan)), "directions must be finite, got nan"),
        (lambda: patterns.rays("ahead"), "directions must be numbers, got 'ahead'"),
        (lambda: patterns.rays(ONE, origins=[0.0]), r"origins must have shape \(1, 1, 3\), got \(1,\)"),
        (lambda: patterns.rays(ONE, times=[[[0.0]]]), r"times must have shape \(1, 1\)"),
        (lambda: patterns.rays(ONE, rings=[1, 2]), r"rings must have shape \(1,\)"),
        (lambda: patterns.rays(ONE, rings=[0.5]), "rings must be whole numbers of 32 bits, got 0.5"),
        (lambda: patterns.rays(ONE, rings=[2**31]), "rings must be whole numbers of 32 bits, got 2147483648"),
        (lambda: patterns.rays(ONE, rate=0.0), "rate must be a positive number, got 0.0"),
        (lambda: patterns.rays(ONE, min_range=-1.0), "min_range must be at least 0 and max_range beyond it"),
        (lambda: patterns.rays(ONE, max_range=0.0), "min_range must be at least 0 and max_range beyond it"),
        (lambda: patterns.rays(ONE, max_range=math.nan), "max_range must be a number"),
        (lambda: patterns.Pattern(ONE, table=np.zeros((3, 2))), r"table must have shape \(n, 3\)"),
        (lambda: patterns.Pattern(ONE, table=ONE[0], origins=ONE), "table and origins came"),
        (lambda: patterns.rays(np.ones((1, 2**15, 3))), "at most 32767 rows and columns"),
        (lambda: patterns.ouster_os1(16), "ouster_os1: channels must be 32, 64 or 128, got 16"),
        (lambda: patterns.ouster_os2(columns=2048, rate=20), "columns x rate must be one of .*, got 2048 x 20"),
        (lambda: patterns.spinning([91.0], columns=3), r"elevations must be \(rows,\) in \[-90, 90\]"),
        (lambda: patterns.spinning([0.0], columns=0), "columns must be a whole number of at least 1, got 0"),
        (lambda: patterns.spinning([0.0], columns=4, azimuths=[1, 2]), r"azimuths must be a finite number or \(1,\)"),
        (lambda: patterns.spinning([0.0], columns=10**12), "columns must be at most 32767, got 1000000000000"),
        (lambda: patterns.spinning([0.0], columns=4, start=[1, 2]), r"start must be a finite number, got \[1, 2\]"),
        (lambda: patterns.spinning([0.0], columns=4, start=math.nan), "start must be a finite number, got nan"),
        (lambda: patterns.spinning([0.0], columns=4, radius=[1, 2]), r"radius must be a finite number, got \[1, 2\]"),
        (lambda: patterns.spinning([0.0], columns=4, radius=math.inf), "radius must be a finite number, got inf"),
        (lambda: patterns.spinning([0.0], columns=4, rate=1e-300), "times must be finite in float32"),
        (lambda: patterns.rays(ONE, origins=1e300 * ONE), "origins must be finite in float32"),
        (lambda: patterns.ouster_os1(32.0), "ouster_os1: channels must be 32, 64 or 128, got 32.0"),
        (lambda: patterns.ouster_os1(np.array([32, 64])), "ouster_os1: channels must be 32, 64 or 128"),
        (lambda: patterns.ouster_metadata(None), "ouster_metadata: None: cannot be read"),
        (lambda: patterns.grid((1e9, 1.0), 0.1), "grid: places along an axis must be at most 32767, got 10000000001"),
        (lambda: patterns.grid((1, 1), 0.1, ordering=np.array(["xy", "yx"])), 'ordering must be "xy" or "yx"'),
        (lambda: patterns.velodyne_vlp16(rate=-1), "rate must be a positive number, got -1"),
        (lambda: patterns.grid(1.0, 0.1), "size must be two lengths"),
        (lambda: patterns.grid((1, 1), 0.0), "resolution must be a positive number"),
        (lambda: patterns.grid((1, 1), 0.1, direction=(0, 0, 0)), "direction must be"),
        (lambda: patterns.grid((1, 1), 0.1, ordering="x"), 'ordering must be "xy" or "yx"'),
        (lambda: patterns.livox_csv("nowhere.csv", samples=4), "livox_csv: nowhere.csv: cannot be read"),
        (lambda: patterns.livox_csv("nowhere.csv", samples=6), "rows must divide samples, got 4 and 6"),
    ],
)
def test_refused(make: Any, text: str) -> None:
    with pytest.raises(WarpcamError, match=text):
        make()


@pytest.mark.parametrize("name", ["hesai_xt32", "velodyne_vlp16", "velodyne_vlp32c", "robosense_bpearl"])
def test_rates_of_which_columns_follow(name: str) -> None:
    make = getattr(patterns, name)
    for rate in (0, -1.0, math.nan, math.inf, "a", None, [10.0], True):
        with pytest.raises(WarpcamError, match=f"{name}: rate must be a positive number, got"):
            make(rate=rate)
    for rate in (1e-9, 1e9):
        with pytest.raises(WarpcamError, match=rf"{name}: rate must be from \d\.\d+ to \d+\.?\d* Hz, got {rate!r}"):
            make(rate=rate)


def test_metadata_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "metadata.json"
    mode = '"lidar_mode": "512x10", "beam_altitude_angles": [0], "beam_azimuth_angles": [0]'
    for value in ('"x"', "[1, 2]", "{}"):
        path.write_text(f'{{{mode}, "lidar_origin_to_beam_origin_mm": {value}}}')
        with pytest.raises(WarpcamError, match="lidar_origin_to_beam_origin_mm must be a finite number, got"):
            patterns.ouster_metadata(path)
    path.write_text('{"a":' * 100_000)
    with pytest.raises(WarpcamError, match=r"metadata\.json: cannot be read"):
        patterns.ouster_metadata(path)


def test_livox_tables_that_are_none(tmp_path: Path) -> None:
    few = livox_file(tmp_path / "few.csv", 10)
    with pytest.raises(WarpcamError, match="at least 12 lines are needed"):
        patterns.livox_csv(few, samples=12)
    few.write_text("a,b,c\n")
    with pytest.raises(WarpcamError, match="at least 4 lines are needed"):
        patterns.livox_csv(few, samples=4)
    few.write_text("a,b\n1,2\n")
    with pytest.raises(WarpcamError, match="three columns"):
        patterns.livox_csv(few, samples=4)
