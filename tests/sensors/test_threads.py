"""Sensors of one renderer in several threads: each measures what it has rendered itself."""

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors

PATIENCE = 0.2  # for another thread to get in between [s]


def rigs_of(device: wp.Device) -> tuple[sensors.Rig, sensors.Rig]:
    renderer = wc.Renderer(scene_of(device, 3), [camera(outputs=("depth", "points", "flow"))])
    first, other = (sensors.Rig(renderer, {"top": [sensors.DepthBias(0.5)]}, seed=seed) for seed in (0, 1))
    first.read()
    other.read()
    return first, other


def interrupt(monkeypatch: pytest.MonkeyPatch, of: Any, name: str, act: Callable[[], Any]) -> Callable[[], None]:
    """Have another thread try to ``act`` right after each call of that method; gives what waits for the last."""
    threads: list[threading.Thread] = []
    method = getattr(of, name)

    def interrupted(*args: Any, **options: Any) -> Any:
        result = method(*args, **options)
        if threading.current_thread() is threading.main_thread():
            threads.append(threading.Thread(target=act))
            threads[-1].start()
            threads[-1].join(PATIENCE)
        return result

    monkeypatch.setattr(of, name, interrupted)
    return lambda: threads[-1].join()


@pytest.mark.parametrize("other", ["rig", "renderer"])
def test_a_read_measures_the_worlds_that_it_has_rendered(
    device: wp.Device, other: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = rigs_of(device)
    draw = second.read if other == "rig" else second.renderer.render
    finish = interrupt(monkeypatch, first.renderer, "draw", lambda: draw(worlds=[2]))
    first.read(worlds=[0])
    finish()
    assert first.frames.tolist() == [2, 1, 1]
    assert second.frames.tolist() == [1, 1, 2 if other == "rig" else 1]


def test_a_reset_is_whole(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = rigs_of(device)
    between: list[str] = []
    finish = interrupt(monkeypatch, first.renderer, "reset", lambda: between.append(str(second.read(worlds=[2]))))
    monkeypatch.setattr(first, "_forget", [Note(between)])
    first.reset([0])
    finish()
    assert between[0] == "forgotten" and len(between) == 2


class Note:
    """A stage that says when it is launched."""

    def __init__(self, notes: list[str]):
        self._notes = notes

    def launch(self) -> None:
        self._notes.append("forgotten")


@pytest.mark.parametrize("kind", ["renderer", "rig", "lidar"])
def test_one_lock_is_held_by_all_that_use_a_renderer(device: wp.Device, kind: str) -> None:
    """While a thread holds it, others neither draw nor measure nor reset; the thread itself does all of it."""
    rig, _ = rigs_of(device)
    lidar = sensors.Lidar(rig.renderer.scene, sensors.patterns.spinning([0.0], columns=8))
    clouds = sensors.PointClouds(rig if kind == "rig" else rig.renderer, num_points=8)
    lock, calls = {
        "renderer": (rig.renderer.lock, [rig.renderer.render, rig.renderer.reset, clouds.read, clouds.reset]),
        "rig": (rig.renderer.lock, [rig.read, rig.reset, clouds.read, clouds.reset]),
        "lidar": (lidar.renderer.lock, [lidar.read, lidar.reset]),
    }[kind]
    for call in calls:
        done = threading.Event()
        thread = threading.Thread(target=lambda call=call, done=done: (call(), done.set()))
        with lock:
            call()
            thread.start()
            assert not done.wait(PATIENCE)
        thread.join()
        assert done.is_set()


def test_threads_with_rigs_of_one_renderer_measure_what_one_thread_does(device: wp.Device) -> None:
    first, second = rigs_of(device)
    truth = first.renderer.images["top"]["depth"].cpu().numpy().copy()

    def work(rig: sensors.Rig, world: int) -> None:
        for _ in range(20):
            rig.read(worlds=[world])

    threads = [threading.Thread(target=work, args=pair) for pair in ((first, 0), (second, 1))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert first.frames.tolist() == [21, 1, 1] and second.frames.tolist() == [1, 21, 1]
    for rig in (first, second):
        np.testing.assert_allclose(rig.images["top"]["depth"].cpu().numpy(), truth + 0.5, rtol=1e-6)
