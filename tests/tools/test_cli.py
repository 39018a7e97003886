"""The command line: pictures it makes, what it says, and how it refuses."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import warpcam as wc
from warpcam import visualize
from warpcam.sources.mujoco import batch_file
from warpcam.tools import cli

TINY = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    {camera}
    <light pos="0 0 3"/>
    <geom type="plane" size="0 0 1"/>
    <body pos="0 0 0.5">
      <joint name="h" axis="0 1 0" range="-1 1" limited="true"/>
      <geom type="box" size="0.1 0.2 0.3" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A scene with one camera."""
    path = tmp_path / "tiny.xml"
    path.write_text(TINY.format(camera='<camera name="front" pos="0 -2 0.5" xyaxes="1 0 0 0 0 1"/>'))
    return path


def render(*arguments: str | Path) -> int:
    """Run ``warpcam render`` on the CPU; returns the exit code."""
    return cli.main(["render", "--device", "cpu", *map(str, arguments)])


def test_the_package_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "warpcam", "--version"], capture_output=True, text=True, timeout=120)
    assert done.stdout == f"warpcam {wc.__version__}\n", done.stderr


def test_render_traces_paths(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """More samples are less noise: of a floor that is lit evenly."""

    def noise(samples: int) -> float:
        out = tmp_path / str(samples)
        how = ("--look", "path", "--samples", str(samples), "--worlds", "1", "--size", "32x24", "--outputs", "rgb")
        assert render(scene, *how, "--out", out) == 0
        rows = np.asarray(Image.open(out / "front-rgb.png"))[-4:].astype(float)
        return float(np.abs(np.diff(rows, axis=1)).mean())

    assert noise(64) < 0.5 * noise(1)
    assert render(scene, "--samples", "4", "--out", tmp_path) == 2
    assert "--samples: it is of --look path alone" in capsys.readouterr().err
    assert render(scene, "--look", "path", "--samples", "0", "--out", tmp_path) == 2
    assert "samples must be a whole number from 1" in capsys.readouterr().err


def test_render_maps_tones(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = []
    for curve in ("clip", "reinhard"):
        how = ("--look", "pbr", "--tone-mapping", curve, "--worlds", "1", "--size", "32x24", "--outputs", "rgb")
        assert render(scene, *how, "--out", tmp_path / curve) == 0
        pictures.append(np.asarray(Image.open(tmp_path / curve / "front-rgb.png")).astype(int))
    assert (pictures[1] <= pictures[0]).all() and (pictures[1] < pictures[0]).any()
    assert render(scene, "--tone-mapping", "reinhard", "--out", tmp_path) == 2
    assert "tone_mapping is 'reinhard', and the look is 'mujoco'" in capsys.readouterr().err


@pytest.mark.usefixtures("small_maps")
def test_render_lights_by_an_environment(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A red one turns the background red; what is no such file is told."""
    oiio: Any = pytest.importorskip("OpenImageIO")
    output = oiio.ImageOutput.create(str(tmp_path / "red.exr"))
    assert output.open(str(tmp_path / "red.exr"), oiio.ImageSpec(16, 8, 3, "float"))
    assert output.write_image(np.full((8, 16, 3), (0.5, 0.0, 0.0), np.float32))
    output.close()
    how = ("--look", "pbr", "--worlds", "1", "--size", "32x24", "--outputs", "rgb", "--out", tmp_path)
    assert render(scene, *how, "--environment", tmp_path / "red.exr") == 0
    image = np.asarray(Image.open(tmp_path / "front-rgb.png")).astype(int)
    assert (image[0, 0] == (188, 0, 0)).all()
    assert render(scene, *how, "--environment", tmp_path / "none.hdr") == 2
    assert "there is no file" in capsys.readouterr().err
    assert render(scene, "--environment", tmp_path / "red.exr", "--out", tmp_path) == 2
    says = "--environment: it lights --look pbr and --look path, and the look is 'mujoco', the scene's own"
    assert says in capsys.readouterr().err


def test_render_reflects(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is no mirror is as before, and the scene's own look has none."""
    how = ("--look", "pbr", "--worlds", "1", "--size", "32x24", "--outputs", "rgb", "--out", tmp_path)
    assert render(scene, *how, "--reflections") == 0
    assert (tmp_path / "front-rgb.png").exists()
    assert render(scene, "--reflections", "--out", tmp_path) == 2
    assert "reflections is True, which is of look='pbr' alone; the look is 'mujoco'" in capsys.readouterr().err


def test_render_exposes_by_itself(scene: Path, tmp_path: Path) -> None:
    """Each picture is that of a camera with the options: of the same scene, in the same state."""
    how = ("--look", "pbr", "--worlds", "1", "--size", "32x24", "--outputs", "rgb")
    world = wc.load(scene, 1, device="cpu")
    for number, (flags, film) in enumerate(
        [
            (("--auto-exposure",), {"auto_exposure": wc.AutoExposure()}),
            (("--bloom", "0.5"), {"bloom": wc.Bloom(strength=0.5)}),
            (
                ("--auto-exposure", "--bloom", "0.5"),
                {"auto_exposure": wc.AutoExposure(), "bloom": wc.Bloom(strength=0.5)},
            ),
        ]
    ):
        assert render(scene, *how, *flags, "--out", tmp_path / str(number)) == 0
        picture = np.asarray(Image.open(tmp_path / str(number) / "front-rgb.png"))
        pair = [wc.Camera("front", width=32, height=24, outputs=("rgb",), shadows=True, **more) for more in (film, {})]
        expected, plain = (wc.Renderer(world, [each], look="pbr").render()["front"]["rgb"][0].numpy() for each in pair)
        np.testing.assert_array_equal(picture, expected)
        assert np.abs(picture.astype(int) - plain).max() > 20


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--auto-exposure",), "auto_exposure is AutoExposure(key=0.18"),
        (("--bloom", "0.1"), "bloom is Bloom(strength=0.1, radius=0.05), and the look is 'mujoco'"),
        (("--look", "pbr", "--bloom", "1.5"), "--bloom: Bloom: strength must be a number in [0, 1], got 1.5"),
        (("--look", "pbr", "--bloom", "nan"), "--bloom: Bloom: strength must be a number in [0, 1], got nan"),
    ],
)
def test_render_tells_what_is_wrong_with_exposure_and_bloom(
    arguments: tuple[str, ...], told: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert render(scene, *arguments, "--out", tmp_path) == 2
    assert told in capsys.readouterr().err


def test_render_saves_a_sheet_per_output(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "folder"
    outputs = ("rgb", "depth", "normals", "points", "segmentation")
    assert render(scene, "--worlds", "6", "--size", "32x24", "--outputs", ",".join(outputs), "--out", out) == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(f"front-{output}.png" for output in outputs)
    for path in out.iterdir():
        sheet = np.asarray(Image.open(path))
        assert sheet.shape == (3 * 26 - 2, 2 * 34 - 2, 3)
        assert sheet[:24, :32].std() > 1.0
    last = capsys.readouterr().out.splitlines()[-1]
    assert "6 worlds x 1 cameras of 32x24" in last
    assert "frames/s on cpu" in last


def test_worlds_differ_and_the_seed_repeats_them(scene: Path, tmp_path: Path) -> None:
    sheets = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        arguments = ("--worlds", "3", "--size", "24x24", "--outputs", "segmentation", "--seed", str(seed))
        assert render(scene, *arguments, "--out", tmp_path / name) == 0
        sheets.append(np.asarray(Image.open(tmp_path / name / "front-segmentation.png")))
    first, again, other = sheets
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert first[26:].any()  # the third world
    assert (first[:24, :24] != first[26:, :24]).any()


def test_scene_without_cameras_is_seen_whole(tmp_path: Path) -> None:
    path = tmp_path / "blind.xml"
    path.write_text(TINY.format(camera=""))
    assert render(path, "--worlds", "1", "--size", "64x32", "--outputs", "segmentation", "--out", tmp_path) == 0
    image = np.asarray(Image.open(tmp_path / "free-segmentation.png"))
    colors, counts = np.unique(image.reshape(-1, 3), axis=0, return_counts=True)
    assert len(colors) == 2  # the box and the floor
    box = (image == colors[counts.argmin()]).all(axis=-1)
    assert box.sum() > 30
    assert not box[[0, -1]].any()
    assert not box[:, [0, -1]].any()


def test_render_without_a_scene_shows_the_demo(tmp_path: Path) -> None:
    assert render("--worlds", "1", "--size", "48x48", "--camera", "overview", "--out", tmp_path) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["overview-depth.png", "overview-rgb.png"]


def test_several_cameras(tmp_path: Path) -> None:
    size = ("--worlds", "1", "--size", "8x8", "--outputs", "depth", "--out", tmp_path)
    assert render(*size, "--camera", "overview", "wrist") == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["overview-depth.png", "wrist-depth.png"]


def test_cameras_of_like_names_have_pictures_of_their_own(tmp_path: Path) -> None:
    cameras = '<camera name="a/b" pos="0 0 5"/><camera name="a b" pos="0 0 6"/><camera name="a.b" pos="0 0 7"/>'
    path = tmp_path / "scene.xml"
    path.write_text(TINY.format(camera=cameras))
    out = tmp_path / "out"
    assert render(path, "--worlds", 1, "--size", "4x4", "--outputs", "rgb", "--out", out) == 0
    assert {file.name for file in out.iterdir()} == {"a_b-rgb.png", "a_b-2-rgb.png", "a.b-rgb.png"}


def test_a_sensor_measures_depth(scene: Path, tmp_path: Path) -> None:
    pictures = {}
    for name, more in (("truth", ()), ("measured", ("--sensor", "kinect_v1")), ("again", ("--sensor", "kinect_v1"))):
        out = tmp_path / name
        assert render(scene, "--worlds", "1", "--size", "32x24", "--out", out, *more) == 0
        pictures[name] = [(out / f"front-{output}.png").read_bytes() for output in ("rgb", "depth")]
    assert pictures["measured"] == pictures["again"]
    assert pictures["measured"][0] == pictures["truth"][0]
    assert pictures["measured"][1] != pictures["truth"][1]


def test_camera_by_index(scene: Path, tmp_path: Path) -> None:
    assert render(scene, "--worlds", "1", "--size", "8x8", "--camera", "0", "--out", tmp_path) == 0
    assert (tmp_path / "0-rgb.png").is_file()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.xml"], "scene: there is no file 'nowhere.xml'"),
        (["--size", "256"], "--size: '256' came"),
        (["--size", "0x4"], "--size: '0x4' came"),
        (["--size", "-4x4"], "--size"),
        (["--worlds", "0"], "--worlds: 0 came"),
        (["--worlds", "many"], "argument --worlds: invalid int value: 'many'"),
        (["--camera", "nose"], "--camera: 'nose' came, the cameras of the scene are: 'overview', 'wrist'"),
        (["--camera", "7"], "--camera: '7' came"),
        (["--outputs", "rgb,smell"], "smell"),
        (["--sensor", "eye"], "argument --sensor: invalid choice: 'eye'"),
        (
            ["--sensor", "zed_2", "--outputs", "rgb,distance"],
            "--sensor: zed_2 measures depth, which --outputs must have, got rgb,distance",
        ),
        (["--device", "abacus"], "device: 'abacus' came, this process sees cpu"),
        (["--shape", "round"], "unrecognized arguments: --shape"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_mistakes_get_one_line_and_code_2(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    try:
        code = cli.main(["render", *arguments, "--out", str(tmp_path / "out")])
    except SystemExit as stop:
        code = stop.code
    printed = capsys.readouterr()
    assert code == 2
    assert printed.out == ""
    assert said in printed.err
    assert printed.err.startswith("warpcam: ")
    assert len(printed.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_broken_scene_gets_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "broken.xml"
    path.write_text("<mujoco><worldbody><geom type='blob'/></worldbody></mujoco>")
    assert render(path) == 2
    error = capsys.readouterr().err
    assert "MuJoCo cannot read" in error
    assert len(error.splitlines()) == 1


def test_out_that_cannot_be_written(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert render(scene, "--worlds", "1", "--size", "8x8", "--out", tmp_path / "file" / "folder") == 2
    assert "--out: " in capsys.readouterr().err


def test_joint_positions_stay_within_ranges() -> None:
    import mujoco

    host = mujoco.MjModel.from_xml_path(str(batch_file.DEMO))
    positions = batch_file.joint_positions(host, host.qpos0, num_worlds=64, seed=3)
    np.testing.assert_array_equal(positions[0], host.qpos0.astype(np.float32))
    limited = host.jnt_limited.astype(bool)
    values = positions[1:, host.jnt_qposadr[limited]]
    assert (values >= host.jnt_range[limited, 0] - 1e-6).all()
    assert (values <= host.jnt_range[limited, 1] + 1e-6).all()
    assert (values.std(axis=0) > 0.0).all()
    for kind, address in zip(host.jnt_type, host.jnt_qposadr, strict=True):
        if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            start = address + (3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0)
            np.testing.assert_allclose(np.linalg.norm(positions[:, start : start + 4], axis=1), 1.0, atol=1e-6)


def test_pictures_of_every_output() -> None:
    from warpcam.outputs import OUTPUTS

    assert {output.picture for output in OUTPUTS.values()} == set(visualize.PICTURES)


def test_lengths_are_bright_when_near_and_black_when_missing() -> None:
    depth = np.array([1.0, 2.0, 4.0, np.inf], dtype=np.float32).reshape(1, 1, 4, 1)
    near, middle, far, missing = visualize.picture("depth", depth)[0, 0].astype(int).sum(axis=-1)
    assert near > middle > far > missing == 0


def test_normals_are_mapped_to_colors() -> None:
    normals = np.array([[0, 0, 1], [-1, 0, 0], [0, 0, 0]], dtype=np.float32).reshape(1, 1, 3, 3)
    np.testing.assert_array_equal(
        visualize.picture("normals", normals)[0, 0], [[128, 128, 255], [0, 128, 128], [0] * 3]
    )


def test_flow_is_a_wheel() -> None:
    flow = np.array([[0, 0], [2, 0], [0, 2], [-2, 0], [0, -2], [-1, 0]], np.float32).reshape(1, 1, 6, 2)
    still, right, down, left, up, half = visualize.picture("flow", flow)[0, 0].astype(int)
    assert (still == 255).all()
    np.testing.assert_allclose(right, (255, 0, 0), atol=10)
    np.testing.assert_allclose(left, (0, 255, 255), atol=10)
    np.testing.assert_allclose(half, (128, 255, 255), atol=10)
    assert down.argmax() == 1 and up.argmax() == 2
    assert (visualize.picture("flow", np.zeros((1, 2, 2, 2), np.float32)) == 255).all()


def test_ids_keep_their_color() -> None:
    one = visualize.picture("segmentation", np.array([[[[3]], [[-1]]]], dtype=np.int32))
    other = visualize.picture("segmentation", np.array([[[[900]], [[3]]]], dtype=np.int32))
    np.testing.assert_array_equal(one[0, 0], other[0, 1])
    assert (one[0, 1] == 0).all()
    assert (other[0, 0] != one[0, 0]).any()


def test_what_has_no_label_is_black() -> None:
    numbers = np.array([[[[0], [2], [0], [1]]]], dtype=np.int32)
    none, two, again, one = visualize.picture("semantics", numbers)[0, 0]
    assert (none == 0).all() and (again == 0).all()
    assert two.any() and one.any() and (one != two).any()
