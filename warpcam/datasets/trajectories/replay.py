"""Replays of demonstrations of robomimic and robosuite into images: ``dataset_states_to_obs``, in batches."""

import json
import re
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.datasets.trajectories.hdf5_storage import check_compression, compressed
from warpcam.datasets.trajectories.parts import Parts, on_disk, replace, write_bytes

try:
    import h5py
    import mujoco

    from warpcam.datasets.trajectories.hdf5_join import join
    from warpcam.datasets.trajectories.state_images import StateImages, threads
except ImportError as error:
    raise WarpcamError(
        f"{error.name} is not installed, and replays need it: pip install 'warpcam[datasets,mujoco]'"
    ) from error

ROBOSUITE = 1  # the number of its environments in ``env_args``
GROUPS = (0, 1, 2)
Images = dict[str, np.ndarray]  # by the name of an observation


def replay(
    source: str | Path,
    output: str | Path,
    *,
    cameras: Sequence[str],
    width: int = 84,
    height: int = 84,
    depth: bool = False,
    episodes: int | None = None,
    batch: int = 64,
    geom_groups: Sequence[int] | None = None,
    edit_model: Callable[[str], str] | None = None,
    device: Any = None,
    compression: int | None = None,
    append: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Render the states of demonstrations, and write a copy of their file with the images among the observations.

    Each demonstration's ``states`` (time, positions and velocities) are put into the model of its attribute
    ``model_file``. Images are ``obs/{camera}_image``, (step, height, width, 3) uint8, and ``obs/{camera}_depth``,
    (step, height, width, 1) float32 [m], each with the upper row first, as ``dataset_states_to_obs`` of robomimic has
    them. They equal those of ``warpcam.compat.mujoco.Renderer`` of each state bit for bit. All else of a demonstration,
    and ``mask``, is copied; actions are not played, so that there are no images in ``next_obs``.

    Finished demonstrations lie in ``{output}.parts`` until the file is made of them.

    Args:
        source: An HDF5 file with ``data/demo_{number}``.
        output: The file to write.
        cameras: Names of cameras of the model.
        width: Of each image [pixels].
        height: Of each image [pixels].
        depth: Whether there is depth beside colours.
        episodes: How many demonstrations, from the first; None is all.
        batch: States of one frame.
        geom_groups: Groups of geoms that are drawn. None is those of robosuite's ``render_collision_mesh`` and
            ``render_visual_mesh`` if ``env_args`` says that the environment is robosuite's, and else 0 to 2.
        edit_model: Changes the XML of a model before it is loaded, as ``env.edit_model_xml`` of robosuite does for
            files that lie elsewhere.
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
        compression: Level of gzip of the images, 0 to 9; None is none.
        append: Whether to go on with a replay that was interrupted.
        progress: Called with the number of demonstrations that are done, and of all.

    Returns:
        Number of demonstrations in the file.

    Raises:
        WarpcamError: An argument, the file or a model cannot be used, or the disk refuses.
    """
    source, output = Path(source), Path(output)
    for name, value in (("width", width), ("height", height), ("batch", batch), ("episodes", episodes)):
        if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
            raise WarpcamError(f"replay: {name} {value!r} came, a whole number of at least 1 is needed")
    if isinstance(cameras, str) or not cameras or len(set(cameras)) != len(cameras):
        raise WarpcamError(f"replay: cameras {cameras!r} came, different names of cameras are needed")
    check_compression("replay", compression)
    if output.exists():
        raise WarpcamError(f"replay: output {str(output)!r} exists")
    with on_disk(f"replay: {str(source)!r} cannot be read"), h5py.File(source, "r") as file:
        demos = _demos(file, source)[:episodes]
        arguments = _env_args(file)
        groups = _groups(arguments) if geom_groups is None else tuple(geom_groups)
        parts = Parts(output, suffix=".hdf5")
        done = dict(parts.all())
        if done and not append:
            raise WarpcamError(
                f"replay: {str(parts.folder)!r} has {len(done)} demonstrations of a replay that was interrupted; "
                "append=True goes on with it"
            )
        model: tuple[str, StateImages] | None = None
        with threads() as pool:
            for place, number in enumerate(demos):
                if number not in done:
                    demo = file[f"data/demo_{number}"]
                    xml = _xml(demo, edit_model)
                    if model is None or model[0] != xml:
                        loaded = _model(xml, demo.name)
                        made = StateImages(
                            loaded, batch, cameras, width, height, depth=depth, geom_groups=groups, device=device
                        )
                        model = xml, made
                    images = _images(demo, model[1], pool)
                    content = _content(file, demo, images, compression)
                    done[number] = parts.add(number, partial(write_bytes, content))
                if progress is not None:
                    progress(place + 1, len(demos))
        arguments = _with_cameras(arguments, cameras, width, height, depth)
        replace(
            output,
            lambda path: join(path, [done[number] for number in demos], partial(_complete, file, arguments)),
            f"replay: {str(output)!r} could not be written, its demonstrations are in {str(parts.folder)!r}",
        )
        parts.remove()
    return len(demos)


def _demos(file: Any, source: Path) -> list[int]:
    """Return the numbers of demonstrations, in order."""
    names = list(file["data"]) if "data" in file else []
    numbers = [re.fullmatch(r"demo_(\d+)", name) for name in names]
    if not names or None in numbers:
        raise WarpcamError(f"replay: {str(source)!r} has no groups data/demo_0, data/demo_1 and so on")
    return sorted(int(match[1]) for match in numbers if match is not None)


def _env_args(file: Any) -> dict[str, Any] | None:
    text = file["data"].attrs.get("env_args")
    return None if text is None else json.loads(text)


def _groups(arguments: dict[str, Any] | None) -> tuple[int, ...]:
    """Groups of geoms that the environment's own images show."""
    if not arguments or arguments.get("type") != ROBOSUITE:
        return GROUPS
    keywords = arguments.get("env_kwargs", {})
    shown = (keywords.get("render_collision_mesh", False), keywords.get("render_visual_mesh", True), True)
    return tuple(group for group, seen in zip(GROUPS, shown, strict=True) if seen)


def _with_cameras(
    arguments: dict[str, Any] | None, cameras: Sequence[str], width: int, height: int, depth: bool
) -> dict[str, Any] | None:
    """Return the environment's arguments with those that give the same images."""
    if not arguments or arguments.get("type") != ROBOSUITE:
        return arguments
    keywords = {
        **arguments.get("env_kwargs", {}), "use_camera_obs": True, "has_offscreen_renderer": True,
        "camera_names": list(cameras), "camera_widths": width, "camera_heights": height, "camera_depths": depth,
    }  # fmt: skip
    return {**arguments, "env_kwargs": keywords}


def _xml(demo: Any, edit_model: Callable[[str], str] | None) -> str:
    xml = demo.attrs.get("model_file")
    if xml is None:
        raise WarpcamError(f"replay: {demo.name} lacks the attribute model_file, the XML of its model")
    return str(xml) if edit_model is None else edit_model(str(xml))


def _model(xml: str, name: str) -> mujoco.MjModel:
    try:
        return mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise WarpcamError(
            f"replay: the model of {name} cannot be loaded: {error}. If its files lie elsewhere here, give edit_model"
        ) from error


def _images(demo: Any, drawn: StateImages, pool: ThreadPoolExecutor) -> Images:
    states = demo["states"][()] if "states" in demo else np.zeros((0, 0))
    if states.ndim != 2 or not len(states) or states.shape[1] != drawn.state_size:
        raise WarpcamError(
            f"replay: {demo.name}/states is {list(states.shape)}, its model needs [steps, {drawn.state_size}]: time, "
            "positions and velocities"
        )
    gathered: dict[str, list[np.ndarray]] = {}
    for start in range(0, len(states), drawn.count):
        for camera, images in drawn.draw(states[start : start + drawn.count], pool).items():
            for output, array in images.items():
                name = f"{camera}_{'image' if output == 'rgb' else output}"
                gathered.setdefault(name, []).append(array)
    return {name: np.concatenate(arrays) for name, arrays in gathered.items()}


def _content(file: Any, demo: Any, images: Images, compression: int | None) -> bytes:
    """Return the bytes of a file with a demonstration and its images."""
    with h5py.File(f"{demo.name[1:]}.hdf5".replace("/", "-"), "w", driver="core", backing_store=False) as part:
        group = part.require_group("data")
        file.copy(demo, group)
        obs = part.require_group(f"{demo.name}/obs")
        for name, array in images.items():
            if name in obs:
                del obs[name]
            obs.create_dataset(name, data=array, **compressed(array, compression))
        part[demo.name].attrs["num_samples"] = len(demo["states"])
        part.flush()
        return bytes(part.id.get_file_image())


def _complete(source: Any, arguments: dict[str, Any] | None, file: Any) -> None:
    """Copy what a file has beside demonstrations."""
    data = file["data"]
    for name, value in source["data"].attrs.items():
        if name != "total":
            data.attrs[name] = value
    if arguments is not None:
        data.attrs["env_args"] = json.dumps(arguments, indent=4)
    if "mask" in source:
        source.copy("mask", file)
