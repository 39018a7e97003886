"""Seconds of a soak: images stay as a new renderer draws them, and what is wrong is seen."""

import time

import pytest
import torch
import warp as wp

pytest.importorskip("mujoco_warp")
from tests.soak import memory, soak

SHORT = {"seconds": 120.0, "check_every": 40, "renew_every": 25, "worlds": 3, "size": 24}


def test_frames_stay_as_a_new_renderer_draws_them(device: wp.Device) -> None:
    result = soak.run(device, frames=50, threads=1, **{**SHORT, "check_every": 24, "renew_every": 15})
    assert result.differences == []
    assert (result.frames, result.checks, result.renderers) == (50, 2, 3)
    assert result.resets > 5 and result.randomizations > 8 and result.thread_frames > 0
    assert len(result.samples) >= 2 and result.samples[-1]["host"] > 0


def test_an_image_that_changed_is_seen(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    render = soak.Worlds.differences

    def spoiled(worlds: soak.Worlds, frame: int) -> list[str]:
        worlds.renderer.images["side"]["depth"][-1, -1, -1] += 1e-6
        worlds.renderer.images["top"]["flow"][0, 0, 0] += 1e-6
        return render(worlds, frame)

    monkeypatch.setattr(soak.Worlds, "differences", spoiled)
    result = soak.run(device, frames=8, threads=0, **{**SHORT, "check_every": 8})
    assert result.differences == ["frame 8: top flow", "frame 8: side depth"]


def test_what_fails_in_a_thread_is_told(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    def wait(_: soak.Worlds, result: soak.Result, *__: int) -> None:
        time.sleep(0.01)
        result.frames = len(result.differences)

    monkeypatch.setattr(torch, "equal", lambda *_: False)
    monkeypatch.setattr(soak, "_frame", wait)
    result = soak.run(device, frames=1, threads=1, **SHORT)
    assert result.differences == ["thread 0: top rgb"]


def test_growth_is_that_after_the_first_quarter() -> None:
    samples = [{"host": 1000.0 * min(k, 4) + 3.0 * k} for k in range(16)]
    assert memory.growth(samples, "host") == pytest.approx(27, abs=3)
    assert memory.growth(samples, "held") == 0
