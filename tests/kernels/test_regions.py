"""How many pixels a thread block draws: few worlds are cut into more blocks, as far as that pays."""

from types import SimpleNamespace
from typing import Any

import pytest
from warpcam.kernels import visibility
from warpcam.kernels.types import HEIGHT_FIELD, MESH, SPHERE
from warpcam.kernels.visibility import MANY, region_size

CARD: Any = SimpleNamespace(is_cuda=True, sm_count=132)


def tables(*types: int, shapes: int = 20) -> Any:
    return SimpleNamespace(shape_types={SPHERE, *types}, num_drawn=shapes)


@pytest.mark.parametrize(
    ("scene", "worlds", "size", "quick", "expected"),
    [
        (tables(), 8192, (64, 64), None, (64, 64)),
        (tables(), 1024, (64, 64), None, (64, 32)),
        (tables(), 1, (640, 480), None, (32, 16)),
        (tables(), 64, (64, 64), None, (32, 16)),
        (tables(), 1, (64, 64), None, (16, 8)),
        (tables(MESH), 1, (640, 480), None, (16, 8)),
        (tables(HEIGHT_FIELD), 1, (640, 480), None, (16, 8)),
        (tables(MESH), 1, (640, 480), True, (32, 16)),
        (tables(MESH), 8192, (64, 64), None, (64, 64)),
        (tables(MESH), 1024, (256, 256), None, (64, 32)),
        (tables(MESH, shapes=MANY + 1), 8192, (64, 64), None, (32, 32)),
    ],
)
def test_regions_leave_enough_blocks(
    scene: Any, worlds: int, size: tuple[int, int], quick: bool | None, expected: tuple[int, int]
) -> None:
    assert region_size(scene, worlds, *size, CARD, quick) == expected


@pytest.mark.parametrize(("cores", "expected"), [(1, (64, 64)), (2, (64, 32)), (8, (32, 16))])
def test_a_cpu_draws_a_region_a_core(cores: int, expected: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(visibility, "cpu_threads", lambda: cores)
    assert region_size(tables(MESH, shapes=MANY + 1), 1, 64, 64, SimpleNamespace(is_cuda=False)) == expected


@pytest.mark.parametrize("scene", [tables(), tables(MESH), tables(MESH, shapes=MANY + 1)])
def test_more_worlds_never_have_smaller_regions(scene: Any) -> None:
    pixels = [width * height for width, height in (region_size(scene, n, 96, 80, CARD) for n in range(1, 3000, 7))]
    assert pixels == sorted(pixels)
