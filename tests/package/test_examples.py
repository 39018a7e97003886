"""Every example runs, as a user would run it: in a process of its own, in an empty folder; most of them quickly."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
QUICK = str(EXAMPLES.parent / "tests" / "helpers" / "fast_compile.py")


def run(*command: str, folder: Path) -> str:
    """Run Python with these arguments; returns what it printed. Only the CPU is shown to it."""
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_hello_saves_a_picture(tmp_path: Path) -> None:
    run(str(EXAMPLES / "hello.py"), folder=tmp_path)
    picture = np.asarray(Image.open(tmp_path / "hello.png"))
    assert picture.shape == (480, 640, 3)
    # The middle of the upper box, the ball and the floor in front have the hue of their geoms.
    orange, red, floor = picture[265, 250], picture[300, 430], picture[440, 320]
    assert orange[0] > orange[1] > orange[2]
    assert red[0] > red[2] > red[1]
    assert np.ptp(floor.astype(int)) < 40


def test_hello_is_short() -> None:
    assert len((EXAMPLES / "hello.py").read_text().splitlines()) <= 30


def test_torch_observations(tmp_path: Path) -> None:
    assert "20 frames of 64 worlds on cpu" in run(QUICK, str(EXAMPLES / "torch_observations.py"), folder=tmp_path)


def test_ci_on_cpu(tmp_path: Path) -> None:
    command = (QUICK, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", str(EXAMPLES / "ci_on_cpu.py"))
    printed = run(*command, folder=tmp_path)
    assert "3 passed" in printed


def test_randomize_saves_eight_worlds(tmp_path: Path) -> None:
    run(QUICK, str(EXAMPLES / "randomize.py"), folder=tmp_path)
    picture = np.asarray(Image.open(tmp_path / "randomize.png")).astype(int)
    assert picture.shape == (320, 640, 3)
    worlds = [half[:, first : first + 160] for half in (picture[:160], picture[160:]) for first in range(0, 640, 160)]
    differences = [np.abs(a - b).mean() for i, a in enumerate(worlds) for b in worlds[:i]]
    assert min(differences) > 5.0


def test_sensor_colors_saves_eight_cameras(tmp_path: Path) -> None:
    run(QUICK, str(EXAMPLES / "sensor_colors.py"), folder=tmp_path)
    made, kept = (
        np.asarray(Image.open(path)).astype(int)
        for path in (tmp_path / "sensor_colors.png", EXAMPLES.parent / "docs" / "images" / "sensors_color.png")
    )
    assert made.shape == kept.shape == (240, 640, 3)
    cameras = [half[:, first : first + 160] for half in (made[:120], made[120:]) for first in range(0, 640, 160)]
    differences = [np.abs(a - b).mean() for i, a in enumerate(cameras) for b in cameras[:i]]
    assert min(differences) > 1.0
    assert (np.abs(made - kept).max(axis=-1) > 40).mean() < 0.05  # edges may be drawn otherwise


def test_depth_cameras_measure_one_table(tmp_path: Path) -> None:
    printed = run(QUICK, str(EXAMPLES / "depth_cameras.py"), folder=tmp_path)
    assert np.asarray(Image.open(tmp_path / "depth_cameras.png")).shape == (360, 960, 3)
    assert len(re.findall(r"[\d.]+ % of the pixels are measured", printed)) == 7


def test_robot_sensors_show_one_robot(tmp_path: Path) -> None:
    printed = run(QUICK, str(EXAMPLES / "robot_sensors.py"), folder=tmp_path)
    made, kept = (
        np.asarray(Image.open(path)).astype(int)
        for path in (tmp_path / "robot_sensors.png", EXAMPLES.parent / "docs" / "images" / "robot_sensors.png")
    )
    assert made.shape == kept.shape == (400, 720, 3)
    parts = [made[top : top + 136, left : left + 240] for top in (0, 136) for left in (0, 240, 480)]
    parts += [made[272:336], made[336:]]
    assert all(len(np.unique(part.reshape(-1, 3), axis=0)) > 50 for part in parts)
    assert (np.abs(made - kept).max(axis=-1) > 40).mean() < 0.05  # edges may be drawn otherwise
    measured, points, returns = map(
        float, re.search(r"wrist: (.*) % of .* cloud: (.*) points\nlidar: (.*) % of", printed).groups()
    )
    assert 90.0 < measured < 100.0 and points == 4096 and 40.0 < returns < 60.0


def test_stereo_camera_with_and_without_a_projector(tmp_path: Path) -> None:
    printed = run(QUICK, str(EXAMPLES / "stereo_camera.py"), folder=tmp_path)
    assert np.asarray(Image.open(tmp_path / "stereo_camera.png")).shape == (720, 848, 3)
    active, passive = map(float, re.findall(r"([\d.]+) % of the pixels are measured", printed))
    assert active > 90.0 > 70.0 > passive


def test_labels_of_two_worlds(tmp_path: Path) -> None:
    printed = run(QUICK, str(EXAMPLES / "labels.py"), folder=tmp_path)
    assert np.asarray(Image.open(tmp_path / "labels.png")).shape == (240, 640, 3)
    shares = [int(share) for share in re.findall(r"(\d+) % of the", printed)]
    assert len(shares) == 4 and shares[1] == shares[3] == 100  # the ball stands in front
    assert 50 < shares[0] < 100


def test_every_gpu(tmp_path: Path) -> None:
    printed = run(QUICK, str(EXAMPLES / "every_gpu.py"), folder=tmp_path)
    assert printed.splitlines()[-2].startswith("cpu: ")
    assert "contexts on GPUs []" in printed


def test_gymnasium_cartpole(tmp_path: Path) -> None:
    pytest.importorskip("gymnasium", reason="pip install 'warpcam[gymnasium]'")
    printed = run(QUICK, str(EXAMPLES / "gymnasium_cartpole.py"), folder=tmp_path)
    assert "Box(0.0, inf, (1, 32, 32), float32)" in printed
    ended, lean = re.search(r"(\d+) episodes ended\nmean lean in their last images: (.*) rad", printed).groups()
    assert int(ended) > 5
    assert float(lean) > 0.3


def test_record_episodes(tmp_path: Path) -> None:
    for name in ("imageio_ffmpeg", "pandas", "pyarrow"):
        pytest.importorskip(name, reason="pip install 'warpcam[datasets]'")
    printed = run(QUICK, str(EXAMPLES / "record_episodes.py"), folder=tmp_path)
    count = int(re.search(r"(\d+) episodes of 16 worlds in cartpole-episodes", printed).group(1))
    info = json.loads((tmp_path / "cartpole-episodes/meta/info.json").read_text())
    assert count == info["total_episodes"] > 16
    assert info["features"]["observation.images.side"]["shape"] == [64, 64, 3]


def test_jax_cartpole(tmp_path: Path) -> None:
    for name in ("jax", "mujoco.mjx", "brax"):
        pytest.importorskip(name, reason="pip install 'warpcam[jax]' mujoco-mjx brax", exc_type=ImportError)
    options = ("--worlds", "8", "--steps", "128", "--evaluations", "2")
    printed = run(QUICK, str(EXAMPLES / "jax_cartpole.py"), *options, folder=tmp_path)
    assert len(re.findall(r"steps, .* mean return [\d.]+", printed)) == 2


def test_formats_are_rendered_as_the_readme_shows(tmp_path: Path) -> None:
    pytest.importorskip("pxr.Usd")
    pytest.importorskip("trimesh")
    run(QUICK, str(EXAMPLES / "formats.py"), folder=tmp_path)
    images = EXAMPLES.parent / "docs" / "images"
    code = (
        "import json, sys; from warpcam.tools.cli import main; sys.exit(any(list(map(main, json.loads(sys.argv[1])))))"
    )
    common = ("--worlds", "1", "--size", "320x240", "--outputs", "rgb", "--device", "cpu", "--out", ".")
    scenes = {
        "xml": ("overview", "--camera", "overview"),
        "usd": ("_World_Camera", "breakfast.usda", "--camera", "/World/Camera"),
        "urdf": ("free", "rover.urdf", "--out", "rover"),
        "glb": ("free", "vases.glb"),
    }
    commands = [["render", *common, *scene] for _, *scene in scenes.values()]
    run(QUICK, "-c", code, json.dumps(commands), folder=tmp_path)
    for kind, (camera, *_) in scenes.items():
        folder = tmp_path / "rover" if kind == "urdf" else tmp_path
        made, kept = (
            np.asarray(Image.open(path).convert("RGB")).astype(int)
            for path in (folder / f"{camera}-rgb.png", images / f"format-{kind}.png")
        )
        assert made.shape == kept.shape == (240, 320, 3)
        # What may be drawn otherwise are edges, and colours a little: `warpcam render` makes them anew.
        assert (np.abs(made - kept).max(axis=-1) > 40).mean() < 0.05, kind


def test_isaacgym_cameras(tmp_path: Path) -> None:
    pytest.importorskip("newton")
    printed = run(QUICK, str(EXAMPLES / "isaacgym_cameras.py"), folder=tmp_path)
    assert "colour (4, 480, 640, 4), depth (4, 480, 640) on cpu" in printed
    wrist, side = np.vsplit(np.asarray(Image.open(tmp_path / "isaacgym_cameras.png")), 2)
    assert wrist.shape == side.shape == (240, 1280, 3)
    red, green, blue = (side.astype(int)[..., i] for i in range(3))
    for first, second, third in ((red, green, blue), (green, red, blue), (blue, red, green)):
        assert (first > second + third + 40).sum() > 200  # its boxes


def test_every_example_is_run() -> None:
    tested = "".join(path.read_text() for path in (EXAMPLES.parent / "tests").rglob("test_*.py"))
    names = [path.name for path in EXAMPLES.glob("*.py")]
    assert names
    for name in names:
        assert f'"{name}"' in tested, name


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_example_is_shown_in_the_docs(path: Path) -> None:
    assert path.name in (EXAMPLES.parent / "docs" / "examples.md").read_text()
