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
    assert "sky: pbr, pbr with rays, path; FLIP beside path 0." in capsys.readouterr().out
    picture = np.asarray(Image.open(tmp_path / "images" / "looks" / "sky.jpg"))
    assert picture.shape == (24, 3 * 34 - 2, 3)
    plain, rays, paths = (picture[:, left : left + 32].astype(int) for left in (0, 34, 68))
    assert min(each.std() for each in (plain, rays, paths)) > 5.0
    assert abs(rays - plain).max() > 30  # rays change what is drawn
    assert not (tmp_path / looks.PAGE).exists()


def test_the_page_has_every_scene_and_its_picture() -> None:
    page = (DOCS / looks.PAGE).read_text()
    for name, scene in look_scenes.SCENES.items():
        assert f"]({looks.PICTURES.as_posix()}/{name}.jpg)" in page and f"[{scene.title}](#{name})" in page
        assert (DOCS / looks.PICTURES / f"{name}.jpg").stat().st_size < 100_000
    flips = dict.fromkeys(look_scenes.SCENES, (0.25, 0.125))
    written = looks.page({"demo": "the demo, MJCF"}, flips, {"demo": ("mujoco", "pbr", looks.WITH_RAYS)}, "Small.")
    assert "| [the demo, MJCF](#demo) | 0.250 | 0.125 |" in written
    assert "The demo, MJCF: `mujoco`, `pbr`, `pbr` with rays." in written
