"""The gallery of looks: its scenes, its page and its pictures."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from PIL import Image

pytest.importorskip("mujoco_warp")
pytest.importorskip("pxr.Usd")
pytest.importorskip("trimesh")
pytest.importorskip("flip_evaluator", reason="needs flip-evaluator: pip install flip-evaluator")
from warpcam.benchmarks import look_scenes, looks

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.parametrize("name", look_scenes.SCENES)
def test_scenes_open(name: str, device: wp.Device) -> None:
    scene = looks.opened(look_scenes.SCENES[name], device)
    assert scene.num_worlds == 1
    assert np.isfinite(scene.bounds()).all()
    if name == "glass":
        assert sorted(scene.array("material_transmission").numpy().ravel()) == [0.0, 0.0, 1.0, 1.0]


def test_the_command_draws_a_scene_in_its_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(looks, "WIDTH", 32)
    monkeypatch.setattr(looks, "HEIGHT", 24)
    looks.main(["--out", str(tmp_path), "--scene", "sky", "--samples", "4", "--device", "cpu"])
    assert "sky: pbr, path; FLIP of pbr beside path 0." in capsys.readouterr().out
    picture = np.asarray(Image.open(tmp_path / "images" / "looks" / "sky.jpg"))
    assert picture.shape == (24, 2 * 32 + 2, 3)
    assert picture[:, :32].std() > 5.0 and picture[:, 34:].std() > 5.0
    assert not (tmp_path / looks.PAGE).exists()


def test_the_page_has_every_scene_and_its_picture() -> None:
    page = (DOCS / looks.PAGE).read_text()
    for name, scene in look_scenes.SCENES.items():
        assert f"]({looks.PICTURES.as_posix()}/{name}.jpg)" in page and f"[{scene.title}](#{name})" in page
        assert (DOCS / looks.PICTURES / f"{name}.jpg").stat().st_size < 100_000
    flips = dict.fromkeys(look_scenes.SCENES, 0.25)
    written = looks.page({"demo": "the demo, MJCF"}, flips, {"demo": ("mujoco", "pbr")}, "Small.")
    assert "| [the demo, MJCF](#demo) | 0.250 |" in written and "The demo, MJCF: `mujoco`, `pbr`." in written
