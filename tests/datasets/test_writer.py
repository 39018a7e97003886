"""Rows of batched worlds become episodes: which rows, of which worlds, and what is refused."""

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recorded_steps as steps
import torch
import warp as wp

h5py = pytest.importorskip("h5py", reason="pip install 'warpcam[datasets]'")

from warpcam.datasets import Writer  # noqa: E402
from warpcam.datasets.trajectories.hdf5 import RobomimicFile  # noqa: E402
from warpcam.errors import WarpcamError  # noqa: E402


def lengths(path: Path) -> list[int]:
    with h5py.File(path) as file:
        return [int(file[f"data/demo_{number}"].attrs["num_samples"]) for number in range(len(file["data"]))]


def row(**more: Any) -> dict[str, Any]:
    """What a step of two worlds is given."""
    return {"observations": np.zeros((2, 3), np.float32), "actions": np.zeros((2, 2), np.float32), **more}


def test_worlds_without_a_row(device: wp.Device, tmp_path: Path) -> None:
    """A mask on the device leaves out rows, such as those of the step in which an env resets."""
    path, there = tmp_path / "demos.hdf5", np.array([(1, 1), (0, 1), (1, 0), (1, 1), (1, 1)], bool)
    with Writer(path, format="robomimic") as writer:
        for step, mask in enumerate(there):
            ended = wp.array([step == 4, step in (1, 2)], dtype=wp.bool)
            observed = wp.array(np.full((2, 3), step, np.float32))
            writer.step(
                observations=observed, actions=wp.zeros((2, 2)), truncated=ended, worlds=wp.array(mask, dtype=wp.bool)
            )
    with h5py.File(path) as file:
        seen = [file[f"data/demo_{number}/obs/state"][:, 0].tolist() for number in range(len(file["data"]))]
    assert seen == [[0, 1], [0, 2, 3, 4]]


def test_only_successful_episodes(device: wp.Device, tmp_path: Path) -> None:
    path, worlds = tmp_path / "demos.hdf5", steps.Worlds((2,), device)
    with Writer(path, format="robomimic", only_success=True) as writer:
        for _ in range(8):
            writer.step(observations=worlds.observations(), **worlds.ends())
    with h5py.File(path) as file:
        assert [file[f"data/demo_{number}/obs/state"][0, 1] for number in range(len(file["data"]))] == [0, 2]


@pytest.mark.parametrize("kept", [False, True])
def test_episodes_that_have_not_ended(tmp_path: Path, kept: bool) -> None:
    path = tmp_path / "demos.hdf5"
    with Writer(path, format="robomimic", keep_unfinished=kept) as writer:
        for step in range(3):
            writer.step(**row(truncated=np.array([step == 1, False])))
    assert lengths(path) == ([2, 1, 3] if kept else [2])


def test_an_error_in_the_loop_leaves_what_had_finished(tmp_path: Path) -> None:
    path = tmp_path / "demos.hdf5"

    def loop() -> None:
        with Writer(path, format="robomimic", keep_unfinished=True) as writer:
            for step in range(3):
                writer.step(**row(truncated=np.array([step == 1, False])))
            raise KeyError("the env's")

    with pytest.raises(KeyError, match="the env's"):
        loop()
    assert lengths(path) == [2]


def test_the_loop_waits_for_memory_and_leaves_out_nothing(
    device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the disk is slow, the loop fills what is pending, and goes on when there is room."""
    go, begun, write = threading.Event(), threading.Event(), RobomimicFile.write

    def slow(*args: Any) -> None:
        begun.set()
        assert go.wait(60.0)
        write(*args)

    monkeypatch.setattr(RobomimicFile, "write", slow)
    path, worlds, put = tmp_path / "demos.hdf5", steps.Worlds((1,), device), []
    with Writer(path, format="robomimic", pending=3) as writer:

        def loop() -> None:
            for step in range(9):
                writer.step(observations=worlds.observations(), **worlds.ends())
                put.append(step)

        thread = threading.Thread(target=loop)
        thread.start()
        assert begun.wait(60.0)
        thread.join(0.3)
        assert len(put) == 3
        go.set()
        thread.join()
    with h5py.File(path) as file:
        for number in range(9):
            np.testing.assert_array_equal(file[f"data/demo_{number}/obs/front_rgb"], [steps.image(0, number, 0)])


def test_an_error_of_the_thread_ends_a_loop_that_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_: Any) -> None:
        raise RuntimeError("as planted")

    monkeypatch.setattr(RobomimicFile, "write", failing)
    writer = Writer(tmp_path / "demos.hdf5", format="robomimic", pending=1)

    def loop() -> None:
        for _ in range(50):
            writer.step(**row(truncated=np.ones(2, bool)))

    with pytest.raises(WarpcamError, match="Writer: as planted") as raised:
        loop()
    assert isinstance(raised.value.__cause__, RuntimeError)
    with pytest.raises(WarpcamError, match="as planted"):
        writer.close()
    assert lengths(tmp_path / "demos.hdf5") == []


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (row(actions=np.zeros(2)), r"actions must be one array \(world, number\)"),
        (row(actions={"arm": np.zeros((2, 3))}), r"actions must be one array \(world, number\)"),
        (row(rewards=np.zeros((2, 1))), r"rewards must be \(world,\), got \(2, 1\)"),
        (row(rewards=np.zeros(3)), "rewards has 3 worlds, actions have 2"),
        (row(terminated=np.zeros(2)), r"terminated must be \(world,\) bool, got float64\[2\]"),
        (row(worlds=np.array([0, 1])), r"worlds must be \(world,\) bool, got int64\[2\]"),
        (row(observations=None), "observations are missing"),
        (row(observations={"/a": np.zeros((2, 1))}), "observations has the key '/a'"),
        (row(observations=torch.zeros(2, 3, dtype=torch.bfloat16)), r"observations/state has dtype torch\.bfloat16"),
        (row(observations="a"), r"observations/state must be an array \(world, \.\.\.\), got str"),
        (row(observations=1.0), "observations/state must have a first dimension of worlds"),
    ],
)
def test_first_steps_are_checked(tmp_path: Path, given: dict[str, Any], message: str) -> None:
    with Writer(tmp_path / "demos.hdf5", format="robomimic") as writer:
        with pytest.raises(WarpcamError, match=message):
            writer.step(**given)
        writer.step(**row(truncated=np.ones(2, bool)))
    assert lengths(tmp_path / "demos.hdf5") == [1, 1]


def test_later_steps_are_as_the_first(tmp_path: Path) -> None:
    with Writer(tmp_path / "demos.hdf5", format="robomimic") as writer:
        writer.step(**row(rewards=np.zeros(2)))
        with pytest.raises(WarpcamError, match=r"actions is float64\[2, 2\], in the first step it was float32\[2, 2\]"):
            writer.step(**row(actions=np.zeros((2, 2)), rewards=np.zeros(2)))
        with pytest.raises(WarpcamError, match=r"rewards is absent, in the first step it was float64\[2\]"):
            writer.step(**row())
        with pytest.raises(WarpcamError, match="observations/state is absent"):
            writer.step(actions=np.zeros((2, 2), np.float32), rewards=np.zeros(2))
        with pytest.raises(WarpcamError, match=r"observations/state is float32\[2, 4\]"):
            writer.observe(np.zeros((2, 4), np.float32))
        writer.observe(np.zeros((2, 3), np.float32))
        with pytest.raises(WarpcamError, match="observe came twice"):
            writer.observe(np.zeros((2, 3), np.float32))
        with pytest.raises(WarpcamError, match="observations came both to observe and to step"):
            writer.step(**row(rewards=np.zeros(2)))
        writer.step(actions=np.zeros((2, 2), np.float32), rewards=np.zeros(2))
    with pytest.raises(WarpcamError, match="is closed"):
        writer.step(**row())


def test_success_is_needed_to_choose_by_it(tmp_path: Path) -> None:
    with (
        Writer(tmp_path / "demos.hdf5", format="robomimic", only_success=True) as writer,
        pytest.raises(WarpcamError, match="only_success needs success"),
    ):
        writer.step(**row())
