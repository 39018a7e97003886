"""The table of the look "pbr" beside "path"."""

import numpy as np
import pytest

pytest.importorskip("pxr.Usd")
pytest.importorskip("mujoco_warp")
pytest.importorskip("flip_evaluator", reason="needs flip-evaluator: pip install flip-evaluator")
import judged_scenes as judged

from tests.path import compare_looks


def test_the_table(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A matt ball in the sun alone is the same in both; a room is lit by its walls in one."""
    ball = judged.Judged((judged.Ball((0.0, 0.0, -3.0), 0.8),), (judged.Sun((0.0, 0.0, 1.0), 1.5),))
    name = "a mesh that shines in a room"
    monkeypatch.setattr(judged, "SIZE", 48)
    monkeypatch.setattr(judged, "SCENES", {"a ball in the sun": ball, name: judged.SCENES[name]})
    compare_looks.main(["--samples", "16", "--device", "cpu"])
    lines = capsys.readouterr().out.splitlines()
    cells = [[cell.strip() for cell in line.split("|")] for line in lines if line.startswith("| ")][1:]
    rows = {row[1]: [float(cell) for cell in row[2:] if cell] for row in cells}
    ways = len(compare_looks.WAYS)
    assert list(rows) == ["a ball in the sun", name, "mean"]
    assert max(rows["a ball in the sun"][:ways]) < 0.05
    assert rows["a ball in the sun"][ways:] == pytest.approx(ways * [1.0], abs=0.06)
    assert rows[name][0] > 0.3
    expected = np.mean([rows["a ball in the sun"][:ways], rows[name][:ways]], axis=0)
    assert rows["mean"] == pytest.approx(expected, abs=1e-3)
