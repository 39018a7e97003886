"""Pixels that a thread block draws: few worlds are cut into more blocks, as far as that pays. Images stay alike."""

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.flags import NO_SCENE_FLAGS, GeometryFlag, SceneFlag
from warpcam.kernels.plan import launches, trace
from warpcam.kernels.plan.launches import MANY, SceneTypes, in_order, region_size
from warpcam.kernels.runtime import cpu_pool
from warpcam.kernels.types import HEIGHT_FIELD, MESH, SPHERE

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


@pytest.mark.parametrize(
    ("scene", "worlds", "size", "expected"),
    [
        (tables(), 1024, (84, 84), (32, 96)),  # three of them for four
        (tables(), 1024, (96, 96), (32, 96)),
        (tables(), 1024, (128, 72), (64, 64)),
        (tables(), 1024, (224, 224), (64, 64)),
        (tables(), 1024, (160, 90), (32, 96)),
        (tables(), 1024, (128, 128), (64, 64)),
        (tables(), 1024, (100, 100), (64, 64)),
        (tables(), 1024, (640, 480), (64, 64)),
        (tables(), 64, (84, 84), (32, 16)),  # too few worlds
        (tables(MESH), 1024, (84, 84), (64, 32)),
    ],
)
def test_regions_are_fitted_to_images(
    scene: Any, worlds: int, size: tuple[int, int], expected: tuple[int, int]
) -> None:
    assert region_size(scene, worlds, *size, CARD, fitted=True) == expected
    cpu = SimpleNamespace(is_cuda=False)
    assert region_size(scene, worlds, *size, cpu, fitted=True) == region_size(scene, worlds, *size, cpu)


@pytest.mark.parametrize(("cores", "expected"), [(1, (64, 64)), (2, (64, 32)), (8, (32, 16))])
def test_a_cpu_draws_a_region_a_core(cores: int, expected: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launches, "cpu_threads", lambda: cores)
    assert region_size(tables(MESH, shapes=MANY + 1), 1, 64, 64, SimpleNamespace(is_cuda=False)) == expected


@pytest.mark.parametrize("scene", [tables(), tables(MESH), tables(MESH, shapes=MANY + 1)])
def test_more_worlds_never_have_smaller_regions(scene: Any) -> None:
    pixels = [width * height for width, height in (region_size(scene, n, 96, 80, CARD) for n in range(1, 3000, 7))]
    assert pixels == sorted(pixels)


SHAPES = """
  <geom type="plane" size="1.2 1.5 1" pos="0 0 -.4"/>
  <geom type="sphere" size=".2" pos="-.7 .3 0"/>
  <geom type="capsule" size=".1 .3" pos="-.3 .2 0" euler="20 30 0"/>
  <geom type="ellipsoid" size=".25 .1 .3" pos="0 -.3 .1" euler="0 40 0"/>
  <geom type="cylinder" size=".15 .2" pos=".3 .3 0" euler="60 0 10"/>
  <geom type="box" size=".2 .1 .25" pos=".7 0 .1" euler="10 20 30"/>
"""
LENSES = {
    "pinhole": wc.Pinhole(fovy=60.0),
    "orthographic": wc.Orthographic(height=1.8),
    "fisheye": wc.Fisheye(fovy=100.0),
}


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("size", [(64, 64), (72, 36), (50, 18)])
def test_images_do_not_depend_on_the_regions(
    size: tuple[int, int], lens: str, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    flows = ("flow", "flow_valid") if lens != "fisheye" else ()
    camera = scenes.own_camera(
        width=size[0],
        height=size[1],
        lens=LENSES[lens],
        outputs=("depth", "segmentation", "distance", "points", "normals", "bodies", *flows),
        position=(0.0, -2.0, 0.6),
        rotation=scenes.looking((0.0, -2.0, 0.6), (0.0, 0.0, 0.0)),
    )
    seen = []
    for region in ((16, 8), (32, 32), (64, 64)):  # a warp draws one tile at once, and two
        mjm = scenes.compile_xml(SHAPES)
        m, d = scenes.put(mjm, 2)
        monkeypatch.setattr(trace, "region_size", lambda *_, region=region, **__: region)
        renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera])
        renderer.render()
        scenes.write(d.geom_xpos, (1, slice(1, 4)), d.geom_xpos.numpy()[1, 1:4] + np.float32(0.05))
        seen.append(scenes.on_host(renderer.render()["eye"]))
    assert len(np.unique(seen[0]["segmentation"])) >= 6
    for other in seen[1:]:
        for name, image in seen[0].items():
            # Of one tile at once and of two the compiler rounds sums differently.
            close = np.isclose(other[name], image, rtol=1e-5, atol=1e-4 if name in ("flow", "normals") else 1e-6)
            assert close.all() if name != "flow_valid" else close.mean() > 0.999, name


@pytest.mark.parametrize(
    ("shape_type", "threads", "card", "first"),
    [
        (MESH, 2**24, CARD, True),
        (HEIGHT_FIELD, 128, CARD, True),
        (MESH, 2**24 + 128, CARD, False),  # numbers of blocks begin anew in each row
        (SPHERE, 128, CARD, False),
        (MESH, 128, SimpleNamespace(is_cuda=False), False),
    ],
)
def test_the_middle_of_images_comes_first_in_launches_of_one_row(
    shape_type: int, threads: int, card: Any, first: bool
) -> None:
    types = SceneTypes(GeometryFlag(1 << shape_type), NO_SCENE_FLAGS)
    expected = SceneFlag.MIDDLE_FIRST if first else NO_SCENE_FLAGS
    assert in_order(types, threads, card) == SceneTypes(types.geometry, expected)


def test_a_launch_may_have_more_blocks_than_a_row_of_its_grid(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Warp puts 2^24 threads in a row; regions in the middle come first only in launches of one."""
    worlds = 15000 if device.is_cuda else 3  # a CPU knows no blocks
    mjm = scenes.compile_xml(
        '<geom type="hfield" hfield="hills" pos="0 0 -.5"/><geom type="sphere" size=".3"/>',
        assets='<hfield name="hills" nrow="2" ncol="2" elevation="0 1 1 0" size="1 1 .2 .1"/>',
    )
    m, d = scenes.put(mjm, worlds)
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: (16, 8))  # nine of them: 135,000 blocks
    camera = scenes.own_camera(width=48, height=24, outputs=("depth", "segmentation"), position=(0.0, 0.0, 3.0))
    images = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera]).render()["eye"]
    assert len(images["segmentation"][0].unique()) == 3
    for image in images.values():
        assert bool((image == image[:1]).all())


def test_images_do_not_depend_on_the_threads(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    if device.is_cuda:
        pytest.skip("launches are split on a CPU")
    woken = []
    wake = cpu_pool.submit_helpers
    monkeypatch.setattr(cpu_pool, "submit_helpers", lambda work, threads: woken.append(threads) or wake(work, threads))
    monkeypatch.setattr(launches, "cpu_threads", lambda: 1)  # the same regions
    mjm = scenes.compile_xml(SHAPES)
    m, d = scenes.put(mjm, 7)
    for world in range(7):
        scenes.write(d.geom_xpos, (world, slice(1, 7)), d.geom_xpos.numpy()[world, 1:7] + np.float32(0.03 * world))
    camera = scenes.own_camera(width=40, height=24, outputs=("rgb", "depth"), position=(0.0, 0.0, 3.0), shadows=True)
    seen = []
    for threads in (1, 3):
        monkeypatch.setattr(cpu_pool, "cpu_threads", lambda threads=threads: threads)
        seen.append(scenes.on_host(wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera]).render()["eye"]))
        assert set(woken) == ({2} if threads > 1 else set())  # beside the calling one
    for name, image in seen[0].items():
        assert (image == seen[1][name]).all(), name
    assert len(np.unique(np.nan_to_num(seen[0]["depth"], posinf=0.0).reshape(7, -1).sum(1))) == 7


def test_a_frame_does_not_wait_for_threads_that_do_not_come(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    if device.is_cuda:
        pytest.skip("launches are split on a CPU")
    monkeypatch.setattr(cpu_pool, "cpu_threads", lambda: 3)
    monkeypatch.setattr(cpu_pool, "MIN_SECONDS_PER_THREAD", 1e-12)
    mjm = scenes.compile_xml(SHAPES)
    m, d = scenes.put(mjm, 7)
    camera = scenes.own_camera(width=40, height=24, outputs=("depth",), position=(0.0, 0.0, 3.0))
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera])
    seen = renderer.render()["eye"]["depth"].clone()
    free = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        monkeypatch.setattr(cpu_pool, "_pool", lambda: pool)
        busy = pool.submit(free.wait, 10.0)
        wp.copy(d.geom_xpos, wp.array(d.geom_xpos.numpy() + np.float32(0.1), dtype=wp.vec3, device=device))
        moved = renderer.render()["eye"]["depth"].clone()
        assert not busy.done()
        free.set()
    assert bool(seen.isfinite().any()) and bool((moved != seen).any())
    assert bool((moved == renderer.render()["eye"]["depth"]).all())


def test_threads_that_came_before_one_could_not_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    with ThreadPoolExecutor(1) as pool:
        asked = iter((pool.submit, RuntimeError))

        def submit(work: Callable[[], float]) -> Future[float]:
            how = next(asked)
            if how is RuntimeError:
                raise RuntimeError("cannot schedule new futures after interpreter shutdown")
            return how(work)

        monkeypatch.setattr(cpu_pool, "_pool", lambda: SimpleNamespace(submit=submit))
        assert [other.result() for other in cpu_pool.submit_helpers(lambda: 1.0, 3)] == [1.0]
