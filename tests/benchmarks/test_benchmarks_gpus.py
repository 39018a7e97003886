"""``warpcam bench --gpus``: every GPU alone and beside others, in one process and in several."""

import json
import multiprocessing
import os
import threading
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("mujoco_warp")

from warpcam.benchmarks import cases, gpus
from warpcam.core.device import contexts
from warpcam.tools import cli

ROOT = Path(__file__).resolve().parents[2]


def bench(*arguments: Any) -> int:
    return cli.main(["bench", *map(str, arguments)])


def test_every_gpu_works_alone_and_beside_others() -> None:
    assert list(gpus.ways(["cuda:0", "cuda:1"])) == [
        ("alone", [["cuda:0"]]),
        ("alone", [["cuda:1"]]),
        ("all in one process", [["cuda:0", "cuda:1"]]),
        ("a process each", [["cuda:0"], ["cuda:1"]]),
    ]
    assert [way for way, _ in gpus.ways(["cuda:0"])] == ["alone"]


def test_gpus_are_measured_where_there_are_some(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gpus, "ways", lambda _: pytest.fail("nothing is to be measured"))
    monkeypatch.setattr(gpus, "wp", SimpleNamespace(get_cuda_devices=list))
    assert bench("--gpus", "--case", "humanoid", "--out", tmp_path / "gpus.json") == 2
    assert "--gpus: this process sees no GPU" in capsys.readouterr().err
    assert bench("--gpus", "--worlds", "0") == 2
    assert "--worlds: 0 came, at least 1 is needed" in capsys.readouterr().err


def test_what_was_measured_on_gpus_is_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    kept = json.loads((ROOT / "benchmarks" / "results" / "nvidia-h100-x2.json").read_text())["results"]
    monkeypatch.setattr(gpus, "rows", lambda _, worlds, frames: [{**row, "asked": [worlds, frames]} for row in kept])
    out = tmp_path / "gpus.json"
    assert bench("--gpus", "--case", "humanoid", "--worlds", "5", "--replays", "7", "--out", out) == 0
    written = json.loads(out.read_text())
    assert written["kind"] == "gpus" and len(written["results"]) == len(kept)
    assert written["results"][0] == {**kept[0], "asked": [5, 7]}


class InAThread(threading.Thread):
    """Stands in for a process that is spawned: its end of the pipe is its own."""

    def __init__(self, target: Any, args: tuple[Any, ...], daemon: bool):
        mine = Connection(os.dup(args[0].fileno()))
        super().__init__(target=target, args=(mine, *args[1:]), daemon=daemon)


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of processes, as kernels are compiled already."""
    spawn = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=InAThread)
    monkeypatch.setattr(gpus, "multiprocessing", SimpleNamespace(get_context=lambda _: spawn))


@pytest.mark.usefixtures("threads")
def test_processes_render_at_the_same_time(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    used = iter([{"GPU-a": 5, "GPU-b": 3}, {"GPU-a": 11, "GPU-b": 3}] * 3)
    monkeypatch.setattr(gpus, "memory_used", lambda: next(used))
    monkeypatch.setattr(gpus, "ways", lambda _: [("alone", [["cpu"]]), ("a process each", [["cpu"], ["cpu"]])])
    rows = list(gpus.measured(cases.CASES["humanoid"], gpus.WANTED[0], 2, 3, ["cpu"]))
    assert [row["way"] for row in rows] == ["alone", "a process each", "a process each"]
    for row in rows:
        assert row["ms"]["mean"] > 0.0 and row["frames"] == 3 and row["contexts"] == contexts()
        assert row["memory_mib"] == {"GPU-a": 6, "GPU-b": 0}
    gpus.show({"results": rows})
    assert capsys.readouterr().out.count("6, 0") == 3


@pytest.mark.usefixtures("threads")
def test_a_process_that_ends_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpus, "work", lambda *_: None)
    with pytest.raises(RuntimeError, match="a process that renders has ended"):
        list(gpus.measured(cases.CASES["humanoid"], gpus.WANTED[0], 2, 3, ["cpu"]))
