"""The folder of cached trees stays below its limit: what was not used for longest goes first."""

import os
from pathlib import Path

import numpy as np
import pytest
from bvh_checks import build_bvh4

import warpcam as wc
from warpcam.accel import tree_cache
from warpcam.tools import cli


def soup(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """3,000 triangles, which are enough for the cache."""
    points = np.random.default_rng(seed).uniform(-1, 1, (9000, 3)).astype(np.float32)
    return points, np.arange(9000, dtype=np.int32).reshape(-1, 3)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("WARPCAM_CACHE_DIR", str(tmp_path))
    monkeypatch.delenv("WARPCAM_CACHE_SIZE", raising=False)
    return tmp_path


def files(folder: Path) -> list[Path]:
    return sorted((folder / "bvh4").iterdir()) if (folder / "bvh4").exists() else []


def test_the_least_recently_used_goes_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build_bvh4(*soup(0))
    (first,) = files(folder)
    build_bvh4(*soup(1))
    (second,) = set(files(folder)) - {first}
    for age, path in ((2000, first), (1000, second)):
        os.utime(path, ns=(10**18 - age * 10**9, 10**18 - age * 10**9))
    build_bvh4(*soup(0))  # read: it is the latest now
    monkeypatch.setenv("WARPCAM_CACHE_SIZE", str(2 * first.stat().st_size + second.stat().st_size // 2))
    build_bvh4(*soup(2))
    assert first in files(folder) and second not in files(folder)
    assert len(files(folder)) == 2
    assert tree_cache.size(folder) <= tree_cache.limit()


def test_many_meshes_stay_below_the_limit(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build_bvh4(*soup(0))
    most = 3 * tree_cache.size(folder)
    monkeypatch.setenv("WARPCAM_CACHE_SIZE", str(most))
    for seed in range(1, 8):
        build_bvh4(*soup(seed))
        assert tree_cache.size(folder) <= most
    assert len(files(folder)) >= 2


def test_none_is_kept_where_there_is_no_room(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARPCAM_CACHE_SIZE", "0")
    build_bvh4(*soup(0))
    assert files(folder) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [("", 2 * 2**30), ("0", 0), ("123", 123), ("1.5 GB", 1_500_000_000), ("2GiB", 2**31), ("3 kib", 3072), ("7b", 7)],
)
def test_sizes(text: str, expected: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARPCAM_CACHE_SIZE", text)
    assert tree_cache.limit() == expected


@pytest.mark.parametrize("text", ["much", "-1", "2 GiBs", "nan"])
def test_what_is_no_size_is_told(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARPCAM_CACHE_SIZE", text)
    with pytest.raises(wc.WarpcamError, match=r"WARPCAM_CACHE_SIZE: .* came; allowed are sizes like 500MB, 2GiB"):
        tree_cache.limit()


def test_the_command_shows_and_empties_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    build_bvh4(*soup(0))
    used = tree_cache.size(folder)
    assert cli.main(["cache"]) == 0
    assert f"{used:,} of 2,147,483,648 bytes used in {folder}" in capsys.readouterr().out
    assert cli.main(["cache", "clear"]) == 0
    assert f"{used:,} bytes removed" in capsys.readouterr().out
    assert files(folder) == []
