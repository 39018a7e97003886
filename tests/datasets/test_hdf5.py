"""Files of demonstrations, as robomimic and Isaac Lab read them: what is read back is what was recorded."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recorded_steps as steps
import torch
import warp as wp
from disk_limits import files_of_at_most

h5py = pytest.importorskip("h5py", reason="pip install 'warpcam[datasets]'")

from warpcam.datasets import Writer  # noqa: E402
from warpcam.datasets.trajectories.hdf5_join import as_os_error  # noqa: E402
from warpcam.datasets.trajectories.parts import Parts  # noqa: E402
from warpcam.errors import WarpcamError  # noqa: E402

LENGTHS = (4, 3, 70)  # the last one is longer than a buffer is at first


def record(path: Path, device: wp.Device, count: int, format: Any = "robomimic", **options: Any) -> Writer:
    """Record that many steps of the worlds, and close the file."""
    worlds = steps.Worlds(LENGTHS, device)
    with Writer(path, format=format, **options) as writer:
        for _ in range(count):
            writer.observe(worlds.observations())
            writer.step(**worlds.ends())
    return writer


def check_demo(demo: Any, world: int, episode: int, rows: int) -> None:
    obs, made = demo["obs"], range(rows)
    assert demo.attrs["num_samples"] == rows
    assert obs["front_rgb"].dtype == np.uint8
    np.testing.assert_array_equal(obs["front_rgb"], [steps.image(world, episode, row) for row in made])
    np.testing.assert_array_equal(obs["front_depth"], [steps.depth(world, episode, row) for row in made])
    np.testing.assert_array_equal(obs["state"], [steps.state(world, episode, row) for row in made])
    np.testing.assert_array_equal(demo["actions"], [steps.action(world, episode, row) for row in made])
    np.testing.assert_array_equal(demo["rewards"], np.arange(rows, dtype=np.float32))
    np.testing.assert_array_equal(demo["dones"], np.arange(rows) == rows - 1)
    assert demo.attrs["success"] == (episode % 2 == 0)


def test_episodes_are_read_back(device: wp.Device, tmp_path: Path) -> None:
    """Of worlds that end at their own times, the long one's among them; what has not ended is left out."""
    path, count = tmp_path / "new" / "demos.hdf5", 71
    arguments = {"env_name": "Lift", "type": 1, "env_kwargs": {}}
    writer = record(path, device, count, env_args=arguments, attributes={"model_file": "<mujoco/>"})
    order = list(steps.finished(LENGTHS, count))
    assert (2, 0) in order and len(order) == 17 + 23 + 1
    assert writer.episodes == writer.written == len(order)
    with h5py.File(path) as file:
        data = file["data"]
        assert data.attrs["total"] == sum(LENGTHS[world] for world, _ in order)
        assert json.loads(data.attrs["env_args"]) == arguments
        assert len(data) == len(order)
        for number, (world, episode) in enumerate(order):
            check_demo(data[f"demo_{number}"], world, episode, LENGTHS[world])
            assert data[f"demo_{number}"].attrs["model_file"] == "<mujoco/>"
    assert [path.name for path in path.parent.iterdir()] == ["demos.hdf5"]


@pytest.mark.filterwarnings("ignore")  # of what robomimic imports
def test_robomimic_reads_it(device: wp.Device, tmp_path: Path) -> None:
    reason = "pip install --no-deps robomimic==0.3.0, and termcolor, tqdm"
    pytest.importorskip("robomimic.utils.dataset", reason=reason, exc_type=ImportError)
    from robomimic.utils import obs_utils
    from robomimic.utils.dataset import SequenceDataset

    record(tmp_path / "demos.hdf5", device, 12)
    obs_utils.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": ["state"], "rgb": ["front_rgb"]}})
    read = SequenceDataset(
        str(tmp_path / "demos.hdf5"), obs_keys=("state", "front_rgb"), dataset_keys=("actions", "rewards", "dones"),
        seq_length=1, hdf5_cache_mode=None, load_next_obs=False,
    )  # fmt: skip
    order = list(steps.finished(LENGTHS, 12))
    assert read.n_demos == len(order)
    places = [(world, episode, row) for world, episode in order for row in range(LENGTHS[world])]
    assert len(read) == len(places)
    for number, place in enumerate(places):
        item = read[number]
        np.testing.assert_array_equal(item["obs"]["state"][0], steps.state(*place))
        np.testing.assert_array_equal(item["obs"]["front_rgb"][0], steps.image(*place))
        np.testing.assert_array_equal(item["actions"][0], steps.action(*place))


def test_isaac_lab_s_layout(device: wp.Device, tmp_path: Path) -> None:
    """States by name, those of the beginning once, and where the package is there, its own handler reads them."""
    path, count = tmp_path / "demos.hdf5", 3
    with Writer(path, format="isaaclab", env_args={"env_name": "Isaac-Lift"}) as writer:
        for row in range(count):
            poses = np.arange(14, dtype=np.float32).reshape(2, 7) + 100 * row
            states = {"rigid_object": {"cube": {"root_pose": poses}}}
            ended = np.full(2, row == count - 1)
            writer.step(
                observations={"policy": np.full((2, 5), row, np.float32)}, actions=np.ones((2, 6), np.float32),
                states=states, initial_states=states, terminated=ended, success=ended,
            )  # fmt: skip
    with h5py.File(path) as file:
        assert file.attrs["format_version"] == 1
        assert json.loads(file["data"].attrs["env_args"]) == {"env_name": "Isaac-Lift", "type": 2}
        assert file["data"].attrs["total"] == 2 * count
        demo = file["data/demo_1"]
        assert demo.attrs["success"] and demo.attrs["num_samples"] == count
        pose = demo["states/rigid_object/cube/root_pose"]
        assert (pose.compression, pose.compression_opts) == ("gzip", 2)
        np.testing.assert_array_equal(pose[:, 0], (7, 107, 207))
        np.testing.assert_array_equal(demo["initial_state/rigid_object/cube/root_pose"], [np.arange(7, 14)])
        np.testing.assert_array_equal(demo["obs/policy"][:, 0], range(count))


@pytest.mark.filterwarnings("ignore")  # of what Isaac Lab imports
def test_isaac_lab_reads_it(device: wp.Device, tmp_path: Path) -> None:
    datasets = pytest.importorskip(
        "isaaclab.utils.datasets", reason="needs an environment of its own: see .ci/run", exc_type=ImportError
    )
    path = tmp_path / "demos.hdf5"
    record(path, device, 8, "isaaclab", env_args={"env_name": "Isaac-Lift"})
    handler = datasets.HDF5DatasetFileHandler()
    handler.open(str(path))
    order = list(steps.finished(LENGTHS, 8))
    assert handler.get_num_episodes() == len(order) and handler.get_env_name() == "Isaac-Lift"
    assert not handler.is_legacy_quaternion_format()
    for number, (world, number_of_world) in enumerate(order):
        episode = handler.load_episode(f"demo_{number}", "cpu")
        assert episode.success == (number_of_world % 2 == 0)
        for row in range(LENGTHS[world]):
            action = episode.get_next_action().numpy()
            np.testing.assert_array_equal(action, steps.action(world, number_of_world, row))
            seen = episode.data["obs"]["front_rgb"][row].numpy()
            np.testing.assert_array_equal(seen, steps.image(world, number_of_world, row))
        assert episode.get_next_action() is None
    handler.close()


def test_episodes_are_appended(device: wp.Device, tmp_path: Path) -> None:
    path = tmp_path / "demos.hdf5"
    record(path, device, 4)
    with h5py.File(path, "a") as file:
        file["data"].attrs["env_args"] = json.dumps({"env_name": "Lift"})
    with pytest.raises(WarpcamError, match=r"demos\.hdf5' exists; append=True adds"):
        Writer(path, format="robomimic")
    writer = record(path, device, 4, append=True)
    assert (writer.written, writer.episodes) == (2, 4)
    with h5py.File(path) as file:
        assert file["data"].attrs["total"] == 14
        assert json.loads(file["data"].attrs["env_args"]) == {"env_name": "Lift"}
        for number, (world, length) in enumerate(((1, 3), (0, 4), (1, 3), (0, 4))):
            check_demo(file[f"data/demo_{number}"], world, 0, length)


def test_other_features_are_not_appended(device: wp.Device, tmp_path: Path) -> None:
    path = tmp_path / "demos.hdf5"
    record(path, device, 4)
    before = path.read_bytes()
    worlds = steps.Worlds(LENGTHS, device)
    with Writer(path, format="robomimic", append=True) as writer:
        row = {"observations": worlds.observations(), **worlds.ends(), "actions": torch.zeros(3, 3)}
        with pytest.raises(WarpcamError, match=r"actions is float32\[3\] here, float32\[2\] in the episodes of"):
            writer.step(**row)
    assert path.read_bytes() == before


def test_a_recording_that_was_not_closed(device: wp.Device, tmp_path: Path) -> None:
    """A process that is killed leaves its finished episodes, and half of one that is thrown away."""
    path, worlds = tmp_path / "demos.hdf5", steps.Worlds(LENGTHS, device)
    writer = Writer(path, format="robomimic")
    for _ in range(5):
        writer.step(observations=worlds.observations(), **worlds.ends())
    writer._steps.put(None)
    assert writer._thread is not None
    writer._thread.join()
    del writer
    (tmp_path / "demos.hdf5.parts" / "00000002.hdf5.unfinished").write_bytes(b"half")
    assert not path.exists()
    with pytest.raises(WarpcamError, match="has 2 finished episodes of a recording that was not closed; append=True"):
        Writer(path, format="robomimic")
    record(path, device, 3, append=True)
    with h5py.File(path) as file:
        for number, (world, length) in enumerate(((1, 3), (0, 4), (1, 3))):
            check_demo(file[f"data/demo_{number}"], world, 0, length)
        assert len(file["data"]) == 3
    assert not Parts(path).all()


def test_a_crash_when_the_file_is_made(device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts that were left over are in the file already: they are not added again."""
    path = tmp_path / "demos.hdf5"
    with monkeypatch.context() as crash:
        crash.setattr(Parts, "remove", lambda parts: None)
        record(path, device, 4)
    assert len(Parts(path, ".hdf5").all()) == 2
    writer = record(path, device, 3, append=True)
    assert (writer.written, writer.episodes) == (1, 3)
    with h5py.File(path) as file:
        assert len(file["data"]) == 3 and file["data"].attrs["total"] == 3 + 4 + 3


@pytest.mark.skipif(sys.platform == "win32", reason="there are no limits of files' sizes")
def test_a_full_disk(device: wp.Device, tmp_path: Path) -> None:
    """The next call says so; what had finished is whole, and is a dataset when there is room again."""
    path, worlds = tmp_path / "demos.hdf5", steps.Worlds((2, 9), device)
    writer = Writer(path, format="robomimic", pending=1)

    def loop() -> None:
        with files_of_at_most(20_000):  # the second world's episode is larger
            for _ in range(20):
                writer.step(observations=worlds.observations(), **worlds.ends())

    with pytest.raises(WarpcamError, match=r"Writer: episode 4 could not be written to .*: File too large") as raised:
        loop()
    assert isinstance(raised.value.__cause__, WarpcamError)
    with pytest.raises(WarpcamError, match="episode 4 could not be written"):
        writer.close()
    with h5py.File(path) as file:
        assert len(file["data"]) == 4
        for number in range(4):
            check_demo(file[f"data/demo_{number}"], 0, number, 2)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no limits of files' sizes")
def test_a_disk_that_is_full_at_the_end(device: wp.Device, tmp_path: Path) -> None:
    path, worlds = tmp_path / "demos.hdf5", steps.Worlds((2, 3), device)
    writer = Writer(path, format="robomimic")
    for _ in range(12):
        writer.step(observations=worlds.observations(), **worlds.ends())
    message = r"could not be written, its episodes are in '.*demos\.hdf5\.parts': File too large"
    with files_of_at_most(30_000), pytest.raises(WarpcamError, match=message):
        writer.close()
    assert [entry.name for entry in tmp_path.iterdir()] == ["demos.hdf5.parts"]
    Writer(path, format="robomimic", append=True).close()
    with h5py.File(path) as file:
        assert len(file["data"]) == 10


def test_errors_of_hdf5_are_the_system_s() -> None:
    told = as_os_error(
        RuntimeError("file write failed: errno = 28, error message = 'No space left on device', buf = 0")
    )
    assert (told.errno, told.strerror) == (28, "No space left on device")
    assert str(as_os_error(RuntimeError("no such filter"))) == "no such filter"


def test_an_unwritable_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(WarpcamError, match=r"demos\.hdf5' cannot be made: Not a directory"):
        Writer(tmp_path / "file" / "demos.hdf5", format="robomimic")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"path": "demos.txt"}, r"path '.*demos\.txt' came, a file that ends in \.hdf5 or \.h5"),
        ({"compression": 11}, "compression 11 came, 0 to 9 is allowed"),
        ({"fps": 30}, "fps 30 came, the format 'robomimic' has env_args, attributes, compression"),
        ({"format": "rlds"}, "format 'rlds' came, allowed are lerobot, robomimic, isaaclab"),
        ({"pending": 0}, "pending 0 came, a whole number of at least 1"),
    ],
)
def test_options_are_checked(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    path = tmp_path / options.pop("path", "demos.hdf5")
    with pytest.raises(WarpcamError, match=message):
        Writer(path, **{"format": "robomimic", **options})
    assert not list(tmp_path.iterdir())


def test_what_a_format_has_no_place_for(tmp_path: Path) -> None:
    row = {"observations": np.zeros((1, 2)), "actions": np.zeros((1, 2))}
    for format, more, message in (
        ("robomimic", {"initial_states": {"a": np.zeros((1, 2))}}, "no place for initial_states"),
        ("robomimic", {"states": {"a": np.zeros((1, 2))}}, "states must be one array"),
        ("isaaclab", {"next_observations": np.zeros((1, 2))}, "no place for next_observations"),
    ):
        writer = Writer(tmp_path / "demos.hdf5", format=format)  # type: ignore[arg-type]
        with pytest.raises(WarpcamError, match=message):
            writer.step(**row, **more)
