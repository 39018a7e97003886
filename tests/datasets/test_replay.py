"""Replays of demonstrations: images equal those of each state by itself, and all else of the file is there again."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from disk_limits import files_of_at_most

h5py = pytest.importorskip("h5py", reason="pip install 'warpcam[datasets]'")
mujoco = pytest.importorskip("mujoco", reason="pip install 'warpcam[mujoco]'")

from warpcam.compat.mujoco import Renderer  # noqa: E402
from warpcam.compat.robosuite import OffscreenContext  # noqa: E402
from warpcam.datasets import replay  # noqa: E402
from warpcam.datasets.trajectories.parts import Parts  # noqa: E402
from warpcam.errors import WarpcamError  # noqa: E402
from warpcam.tools.cli import main  # noqa: E402

# The camera "diver" goes below the floor; group 0 is what robosuite hides; the lens is partly transparent.
XML = """
<mujoco>
  <visual><map znear="0.01" zfar="20"/><global offwidth="640" offheight="480"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.3 0.5 0.7" rgb2="0 0 0" width="16" height="16"/>
  </asset>
  <worldbody>
    <light pos="0.5 -0.5 2" dir="-0.2 0.2 -1"/>
    <geom type="plane" size="2 2 0.1" rgba="0.5 0.6 0.4 1" group="1"/>
    <camera name="front" pos="0 -1.5 0.6" xyaxes="1 0 0 0 0.4 1"/>
    <body pos="0 0 0.5">
      <freejoint/>
      <geom type="box" size="0.1 0.15 0.1" rgba="{color}" group="1"/>
      <geom type="sphere" size="0.25" rgba="0.2 0.9 0.2 1" group="0"/>
    </body>
    <body pos="0.3 0 0.3">
      <joint name="slide" type="slide" axis="0 0 1" damping="0"/>
      <geom type="sphere" size="0.1" rgba="0.2 0.3 0.9 0.5" mass="1" group="1" contype="0" conaffinity="0"/>
      <camera name="diver" pos="-0.3 -1.2 0.1" xyaxes="1 0 0 0 0.2 1"/>
    </body>
  </worldbody>
</mujoco>
"""
CAMERAS, WIDTH, HEIGHT = ("front", "diver"), 48, 32
LENGTHS = {0: 7, 1: 3, 10: 5}  # of demonstrations by number; one frame has 3 states
COLORS = {0: "0.9 0.2 0.1 1", 1: "0.9 0.2 0.1 1", 10: "0.8 0.8 0.1 1"}
ROBOSUITE = {"env_name": "Lift", "type": 1, "env_version": "1.5.2", "env_kwargs": {"robots": ["Panda"]}}


def states_of(model: Any, count: int, seed: int) -> np.ndarray:
    """States of a body that turns and of a camera that falls through the floor."""
    random, data, states = np.random.default_rng(seed), mujoco.MjData(model), []
    data.qvel[:6] = random.normal(size=6)
    for _ in range(count):
        states.append(np.concatenate(([data.time], data.qpos, data.qvel)))
        mujoco.mj_step(model, data, nstep=40)
    return np.stack(states)


@pytest.fixture
def demos(tmp_path: Path) -> Path:
    path = tmp_path / "demos.hdf5"
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps(ROBOSUITE)
        data.attrs["total"] = sum(LENGTHS.values())
        for number, length in LENGTHS.items():
            xml = XML.format(color=COLORS[number])
            demo = data.create_group(f"demo_{number}")
            demo.attrs["model_file"], demo.attrs["num_samples"] = xml, length
            demo["states"] = states_of(mujoco.MjModel.from_xml_string(xml), length, number)
            demo["actions"] = np.random.default_rng(number).normal(size=(length, 4))
            demo["obs/joints"] = np.full((length, 2), number)
            demo["obs/front_image"] = np.zeros((length, 8, 8, 3), np.uint8)  # of an older replay
        file["mask/train"] = np.array([b"demo_0", b"demo_10"])
    return path


def alone(xml: str, state: np.ndarray, camera: str, device: wp.Device) -> tuple[np.ndarray, np.ndarray]:
    """Colours and depth of a state, by the front end that draws one at a time."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, option = mujoco.MjData(model), mujoco.MjvOption()
    option.geomgroup[0] = 0
    data.time = state[0]
    data.qpos[:], data.qvel[:] = np.split(state[1:], [model.nq])
    mujoco.mj_forward(model, data)
    with Renderer(model, height=HEIGHT, width=WIDTH, device=device) as renderer:
        renderer.update_scene(data, camera=camera, scene_option=option)
        colors = renderer.render().copy()
        renderer.enable_depth_rendering()
        renderer.update_scene(data, camera=camera, scene_option=option)
        return colors, renderer.render()[..., None].copy()


def test_images_equal_those_of_each_state(device: wp.Device, demos: Path, tmp_path: Path) -> None:
    """Bit for bit, among them frames that only some states see from below the floor; and all else is copied."""
    output = tmp_path / "images.hdf5"
    done: list[tuple[int, int]] = []
    count = replay(
        demos, output, cameras=CAMERAS, width=WIDTH, height=HEIGHT, depth=True, batch=3, device=device, compression=4,
        progress=lambda *told: done.append(told),
    )  # fmt: skip
    assert count == len(LENGTHS) and done == [(1, 3), (2, 3), (3, 3)]
    below = 0
    with h5py.File(demos) as source, h5py.File(output) as file:
        assert list(file["data"]) == list(source["data"]) and file["data"].attrs["total"] == sum(LENGTHS.values())
        np.testing.assert_array_equal(file["mask/train"], source["mask/train"])
        keywords = json.loads(file["data"].attrs["env_args"])["env_kwargs"]
        assert keywords["robots"] == ["Panda"] and keywords["camera_names"] == list(CAMERAS)
        assert (keywords["camera_widths"], keywords["camera_depths"]) == (WIDTH, True)
        for name, demo in file["data"].items():
            before = source["data"][name]
            assert dict(demo.attrs) == dict(before.attrs)
            for other in ("states", "actions", "obs/joints"):
                np.testing.assert_array_equal(demo[other], before[other])
            for camera in CAMERAS:
                colors, depths = demo[f"obs/{camera}_image"], demo[f"obs/{camera}_depth"]
                assert (colors.dtype, depths.dtype) == (np.uint8, np.float32)
                assert colors.chunks == (1, HEIGHT, WIDTH, 3)
                for row, state in enumerate(before["states"]):
                    expected, depth = alone(before.attrs["model_file"], state, camera, device)
                    np.testing.assert_array_equal(colors[row], expected)
                    np.testing.assert_array_equal(depths[row], depth)
                    assert expected.std() > 5.0
            below += int((before["states"][:, 8] < -0.4).sum())
        assert 0 < below < sum(LENGTHS.values())
    assert not Parts(output).all()


def test_rows_are_as_robomimic_turns_robosuite_s(device: wp.Device, demos: Path, tmp_path: Path) -> None:
    """Our context for robosuite gives the bottom row first, as OpenGL does; robomimic turns images round."""
    output = tmp_path / "images.hdf5"
    replay(demos, output, cameras=("front",), width=WIDTH, height=HEIGHT, episodes=1, device=device)
    with h5py.File(output) as file:
        state, xml = file["data/demo_0/states"][4], file["data/demo_0"].attrs["model_file"]
        image = file["data/demo_0/obs/front_image"][4]
        assert list(file["data"]) == ["demo_0"]
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.time = state[0]
    data.qpos[:], data.qvel[:] = np.split(state[1:], [model.nq])
    sim = SimpleNamespace(
        model=SimpleNamespace(_model=model, vis=model.vis), data=SimpleNamespace(_data=data),
        forward=lambda: mujoco.mj_forward(model, data), add_render_context=lambda context: None,
    )  # fmt: skip
    context = OffscreenContext(sim, device_id=device.ordinal if device.is_cuda else -1)
    context.vopt.geomgroup[0] = 0
    context.render(WIDTH, HEIGHT, camera_id=0)
    np.testing.assert_array_equal(image, context.read_pixels(WIDTH, HEIGHT)[::-1])


def test_groups_that_are_drawn(device: wp.Device, demos: Path, tmp_path: Path) -> None:
    """Robosuite's collision geoms are hidden unless its environment, or the caller, shows them."""
    seen = {}
    for name, groups in (("own", None), ("all", (0, 1, 2)), ("visual", [1, 2])):
        output = tmp_path / f"{name}.hdf5"
        replay(
            demos, output, cameras=("front",), width=WIDTH, height=HEIGHT, episodes=1, geom_groups=groups, device=device
        )
        with h5py.File(output) as file:
            seen[name] = file["data/demo_0/obs/front_image"][0]
    np.testing.assert_array_equal(seen["own"], seen["visual"])
    assert (seen["all"] != seen["own"]).any()


def test_an_interrupted_replay_goes_on(device: wp.Device, demos: Path, tmp_path: Path) -> None:
    output, calls = tmp_path / "images.hdf5", []

    def interrupted(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    options: dict[str, Any] = {"cameras": ("front",), "width": WIDTH, "height": HEIGHT, "device": device}
    with pytest.raises(KeyboardInterrupt):
        replay(demos, output, progress=interrupted, **options)
    assert [number for number, _ in Parts(output, ".hdf5").all()] == [0, 1]
    with pytest.raises(WarpcamError, match="has 2 demonstrations of a replay that was interrupted; append=True"):
        replay(demos, output, **options)
    replay(demos, output, append=True, edit_model=lambda xml: calls.append(xml) or xml, **options)
    assert len(calls) == 1
    with h5py.File(output) as file:
        assert [len(demo["obs/front_image"]) for demo in file["data"].values()] == [7, 3, 5]


@pytest.mark.skipif(sys.platform == "win32", reason="there are no limits of files' sizes")
def test_a_disk_that_is_full_at_the_end(device: wp.Device, demos: Path, tmp_path: Path) -> None:
    """Demonstrations that were finished stay, and are the file when there is room again."""
    output = tmp_path / "images.hdf5"
    options: dict[str, Any] = {"cameras": ("front",), "width": WIDTH, "height": HEIGHT, "device": device}
    message = r"replay: '.*images\.hdf5' could not be written, its demonstrations are in .*: File too large"
    with files_of_at_most(90_000), pytest.raises(WarpcamError, match=message):
        replay(demos, output, **options)
    assert len(Parts(output, ".hdf5").all()) == 3 and not output.exists()
    replay(demos, output, append=True, **options)
    with h5py.File(output) as file:
        assert file["data"].attrs["total"] == 15 == sum(len(demo["obs/front_image"]) for demo in file["data"].values())


def test_the_command(demos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(demos, "a") as file:
        for demo in file["data"].values():
            demo.attrs["model_file"] = demo.attrs["model_file"].replace('rgba="0.9', 'rgba="old')
    output = tmp_path / "images.hdf5"
    arguments = ["replay", str(demos), "--output", str(output), "--size", "48x32", "--device", "cpu"]
    assert main([*arguments, "--cameras", "front", "--episodes", "1", "--replace-path", "old=0.9"]) == 0
    assert capsys.readouterr().out == f"1 demonstrations in {output}\n"
    with h5py.File(output) as file:
        assert file["data/demo_0/obs/front_image"].shape == (7, HEIGHT, WIDTH, 3)
    for more, message in (
        (["--cameras", "front"], "output .* exists"),
        (["--cameras", "front", "--size", "48"], "--size must be WxH"),
        (["--cameras", "front", "--replace-path", "old"], "--replace-path must be OLD=NEW"),
    ):
        assert main([*arguments, *more]) == 2
        assert re.search(message, capsys.readouterr().err)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cameras": ("back",)}, "cameras has 'back', the model has front, diver"),
        ({"cameras": "front"}, "cameras 'front' came, different names of cameras"),
        ({"width": 0}, "width 0 came, a whole number of at least 1"),
        ({"compression": 10}, "compression 10 came"),
        ({"edit_model": lambda xml: "<mujoco"}, "the model of /data/demo_0 cannot be loaded: XML"),
    ],
)
def test_what_cannot_be_replayed(demos: Path, tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(WarpcamError, match=message):
        replay(demos, tmp_path / "images.hdf5", **{"cameras": ("front",), "device": "cpu", **options})
    assert not (tmp_path / "images.hdf5").exists()


def test_files_that_are_no_demonstrations(demos: Path, tmp_path: Path) -> None:
    output, options = tmp_path / "images.hdf5", {"cameras": ("front",), "device": "cpu"}
    with pytest.raises(WarpcamError, match=r"none\.hdf5' cannot be read: "):
        replay(tmp_path / "none.hdf5", output, **options)  # type: ignore[arg-type]
    with h5py.File(demos, "a") as file:
        del file["data/demo_0/states"]
        file["data/demo_0/states"] = np.zeros((4, 3))
        del file["data/demo_1"].attrs["model_file"]
        file.create_group("empty")
    with pytest.raises(WarpcamError, match=r"data/demo_0/states is \[4, 3\], its model needs \[steps, 16\]"):
        replay(demos, output, **options)  # type: ignore[arg-type]
    with h5py.File(demos, "a") as file:
        del file["data/demo_0"]
    with pytest.raises(WarpcamError, match="/data/demo_1 lacks the attribute model_file"):
        replay(demos, output, **options)  # type: ignore[arg-type]
    with h5py.File(demos, "a") as file:
        del file["data"]
    with pytest.raises(WarpcamError, match="has no groups data/demo_0, data/demo_1"):
        replay(demos, output, **options)  # type: ignore[arg-type]
