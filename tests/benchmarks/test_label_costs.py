"""The benchmark of labels writes what they cost."""

import json
from pathlib import Path

import pytest

pytest.importorskip("mujoco_warp")
from warpcam.benchmarks import labels


def test_costs_of_labels_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(labels.measure, "CPU_BUDGET", 0.0)
    out = tmp_path / "labels.json"
    labels.main(["--device", "cpu", "--worlds", "2", "--size", "16", "--case", "humanoid", "--out", str(out)])
    report = json.loads(out.read_text())
    assert report["worlds"] == 2 and report["size"] == 16 and "cpu" in report["machine"]
    assert [row["labels"] for row in report["results"]] == list(labels.VARIANTS)
    for row in report["results"]:
        assert row["case"] == "humanoid" and row["instances"] > 10 and row["ids_ms"] > 0.0
        assert row["ratio_to_ids"] == pytest.approx(row["labels_ms"] / row["ids_ms"])
