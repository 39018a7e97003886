"""Where the time of training goes."""

import json
import time
from pathlib import Path

import pytest
import torch

pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")

from warpcam.tools import cli
from warpcam.train.sections import OUTSIDE, Sections


def test_time_of_an_inner_part_is_none_of_the_outer_one() -> None:
    class Work:
        def outer(self) -> str:
            time.sleep(0.02)
            self.inner()
            return "done"

        def inner(self) -> None:
            time.sleep(0.05)

    work, sections = Work(), Sections(torch.device("cpu"))
    sections.watch(work, "outer", "outer")
    sections.watch(work, "inner", "inner")
    begun = time.perf_counter()
    sections.begin()
    assert work.outer() == "done"
    time.sleep(0.01)
    spent = sections.end()
    assert spent["inner"][0] >= 0.05 and spent["outer"][0] >= 0.02 and spent[OUTSIDE][0] >= 0.01
    assert sum(device for device, _ in spent.values()) <= time.perf_counter() - begun
    sections.release()
    assert not vars(work)


def test_a_profile_names_all_parts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = "train cartpole --worlds 4 --size 16x16 --iterations 1 --device cpu --profile --out"
    assert cli.main([*command.split(), str(tmp_path)]) == 0
    told = json.loads((tmp_path / "profile.json").read_text())
    assert [run["captured"] for run in told["runs"]] == [False]
    parts = told["runs"][0]["parts"]
    names = ("simulation", "render", "rewards, resets, observations", "policy", "learning", "host gaps")
    assert tuple(parts) == names
    assert sum(part["share"] for part in parts.values()) == pytest.approx(1.0, abs=0.001)
    assert all(part["host_ms"] > 0.0 for part in parts.values())
    printed = capsys.readouterr().out
    assert all(name in printed for name in names) and "device, ms" in printed
