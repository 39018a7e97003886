"""The command that draws a folder's models by MuJoCo's renderer and by ours."""

import csv
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
from mujoco_reference import reference_renderer

from warpcam.benchmarks import compare_folders, image_metrics
from warpcam.core.errors import WarpcamError

BALLS = """<mujoco>
  <statistic center="0 0 .3" extent="1.5"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 .1" rgba=".3 .4 .3 1"/>
    <body pos="0 0 .3"><joint type="slide"/><geom size=".3" rgba=".9 .2 .1 1"/></body>
    <camera name="front" pos="0 -3 .6" xyaxes="1 0 0 0 .1 1"/><camera pos="0 0 4"/>
  </worldbody>
  <keyframe><key qpos=".4"/></keyframe>
</mujoco>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two models, of which one begins at a keyframe, and a file that is no model by itself."""
    reference_renderer(scenes.compile_xml(""), 8, 8).close()
    models = tmp_path / "models"
    (models / "more").mkdir(parents=True)
    (models / "balls.xml").write_text(BALLS)
    (models / "more" / "bare.xml").write_text(BALLS.replace("<camera", "<site").replace('xyaxes="1 0 0 0 .1 1"', ""))
    (models / "part.xml").write_text("<mujocoinclude><body/></mujocoinclude>")
    return models


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_pictures_are_compared_and_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn: list[list[np.ndarray]] = []
    draw = compare_folders.draw

    def watched(*arguments: Any) -> list[np.ndarray]:
        drawn.append(draw(*arguments))
        return drawn[-1]

    monkeypatch.setattr(compare_folders, "draw", watched)
    out = folder / "out.csv"
    assert compare_folders.main([str(folder), "--cameras", "1", "--size", "64", "48", "--out", str(out)]) == 0
    rows = read(out)
    assert [(row["file"], row["camera"]) for row in rows] == [
        ("models/balls.xml", "-1"), ("models/balls.xml", "0"), ("models/more/bare.xml", "-1")
    ]  # fmt: skip
    for row, theirs, ours in zip(rows, drawn[::2], drawn[1::2], strict=True):
        assert [image.shape for image in theirs] == [(48, 64, 3), (48, 64), (48, 64, 2)]
        assert float(row["psnr"]) == pytest.approx(image_metrics.psnr(theirs[0], ours[0]), abs=0.01)
        assert float(row["psnr"]) > 30.0 and float(row["ids"]) < 0.01 and float(row["depth"]) < 0.01
        assert len(np.unique(theirs[2][..., 0])) > 2
    told = capsys.readouterr().out.splitlines()[-1]
    assert "2 models, 3 pictures, 0 missing" in told
    # A ball that is elsewhere, as without the keyframe, is told of.
    monkeypatch.setattr(compare_folders, "Renderer", Elsewhere)
    assert compare_folders.main([str(folder), "--cameras", "0", "--size", "64", "48", "--out", str(out)]) == 0
    assert all(float(row["ids"]) > 0.02 and float(row["depth"]) > 0.02 for row in read(out))


class Elsewhere(compare_folders.Renderer):  # type: ignore[misc]
    def update_scene(self, data: mujoco.MjData, *arguments: Any, **more: Any) -> None:
        other = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, other)
        super().update_scene(other, *arguments, **more)


def test_what_ours_does_not_draw_is_told(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Refuses(compare_folders.Renderer):  # type: ignore[misc]
        def update_scene(self, *_: Any, **__: Any) -> None:
            raise WarpcamError("geoms: too many")

    monkeypatch.setattr(compare_folders, "Renderer", Refuses)
    out = folder / "out.csv"
    assert compare_folders.main([str(folder), "--cameras", "0", "--size", "16", "16", "--out", str(out)]) == 1
    assert [row["error"] for row in read(out)] == ["geoms: too many"] * 2
    assert "geoms: too many" in capsys.readouterr().out
