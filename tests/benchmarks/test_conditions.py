"""The benchmark of conditions compares each with its base."""

import json
from pathlib import Path

import pytest

pytest.importorskip("mujoco_warp")
from warpcam.benchmarks import conditions


def test_conditions_are_compared_with_their_base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conditions.measure, "CPU_BUDGET", 0.0)
    out = tmp_path / "conditions.json"
    options = ["--device", "cpu", "--worlds", "2", "--size", "16x16", "--out", str(out)]
    conditions.main([*options, "--outputs", "rgb-shadows", "--only", "4 lights", "84x84", "300 shapes"])
    lights, size, shapes = json.loads(out.read_text())["results"]
    assert (lights["base"], size["base"], shapes["base"]) == ("base", "base", "120 shapes")
    assert size["size"] == [84, 84]
    assert size["ns_per_pixel"] == pytest.approx(1e6 * size["ms"] / (2 * 84 * 84))
    for row, times in ((lights, 4.0), (size, 1.0), (shapes, 2.5)):
        usual = 0.5e6 * sum(row["base_ms"]) / (2 * 16 * 16)
        assert row["ratio"] == pytest.approx(row["ns_per_pixel"] / usual) == pytest.approx(times * row["share"])


def test_each_condition_changes_what_it_is_named_for() -> None:
    model = {name: conditions.problem.compile_case(each.case()) for name, each in conditions.CONDITIONS.items()}
    assert model["base"].nlight == 1 and model["8 lights"].nlight == 8
    assert len(set(model["base"].light_diffuse[0])) == 1 and len(set(model["coloured light"].light_diffuse[0])) == 3
    assert model["coloured floor"].mat("grid").rgba[0] != model["coloured floor"].mat("grid").rgba[1]
    assert model["floor without texture"].geom("floor").matid[0] < 0 <= model["base"].geom("floor").matid[0]
    assert not model["base"].geom("floor").size[0] and model["finite plane"].geom("floor").size[0] > 0.0
    assert model["four planes, three finite"].ngeom == model["base"].ngeom + 3
    assert model["transparency"].geom("torso").rgba[3] < 1.0
