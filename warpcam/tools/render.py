"""The command ``warpcam render``: pictures of a scene in many worlds."""

import argparse
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import warp as wp
from PIL import Image
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

import warpcam
from warpcam import visualize
from warpcam.camera.camera import ToneMapping
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.render.paths import PathOptions
from warpcam.sources.common import formats
from warpcam.sources.common.optional import import_source
from warpcam.sources.mujoco import batch_file
from warpcam.tools import denoised, scene_access, scene_options

ABOUT = "render a scene in many worlds and save pictures"
FREE_CAMERA = "free"
TIMING = 0.2  # how long frames are counted at most, after the first one [s]
SENSORS = (
    "realsense_d405",
    "realsense_d415",
    "realsense_d435",
    "realsense_d455",
    "azure_kinect",
    "zed_2",
    "oak_d",
    "kinect_v1",
    "vl53l5cx",
)  # of warpcam.sensors, which takes long to import


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.description = ABOUT
    scene_options.add(command, worlds=16, size="256x256")
    command.add_argument(
        "--camera",
        action="extend",
        nargs="+",
        metavar="NAME",
        help="cameras of the scene, by name or index (default: all, or a free one if there is none)",
    )
    command.add_argument("--outputs", default="rgb,depth", help="separated by commas (default: %(default)s)")
    command.add_argument(
        "--sensor",
        choices=SENSORS,
        metavar="NAME",
        help=f"measure depth as this camera does: {', '.join(SENSORS)} (default: the truth)",
    )
    scene_options.add_look(command)
    command.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help=f"paths of each pixel with --look path (default: {PathOptions.samples})",
    )
    command.add_argument(
        "--tone-mapping",
        choices=get_args(ToneMapping),
        default="clip",
        metavar="NAME",
        help=f"curve from light to colours of --look pbr and path: {', '.join(get_args(ToneMapping))} "
        "(default: %(default)s)",
    )
    command.add_argument(
        "--reflections",
        action="store_true",
        help="trace what smooth surfaces mirror and what is seen through clear ones, with --look pbr",
    )
    command.add_argument(
        "--ambient-occlusion",
        type=float,
        metavar="M",
        help="with --look pbr: shapes hide light from all around within this radius in metres, which may be inf",
    )
    command.add_argument("--soft-shadows", action="store_true", help="with --look pbr: shadows of lights of a size")
    command.add_argument("--indirect-light", action="store_true", help="with --look pbr: one bounce of light")
    command.add_argument(
        "--denoise", action="store_true", help="denoise light of --look path by Open Image Denoise, which is biased"
    )
    command.add_argument("--out", type=Path, default=Path("warpcam-out"), metavar="DIR", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    width, height, device = scene_options.check(options)
    _check_folder(options.out)
    splats = scene_options.splats_of(options)
    outputs = [name.strip() for name in options.outputs.split(",") if name.strip()]
    if options.sensor and "depth" not in outputs:
        raise WarpcamError(
            f"--sensor: {options.sensor} measures depth, which --outputs must have, got {options.outputs}"
        )
    if options.samples is not None and options.look != "path":
        raise WarpcamError("--samples: it is of --look path alone")
    if options.denoise:
        denoised.check(options.look, outputs, options.tone_mapping)
    paths = None if options.samples is None else PathOptions(samples=options.samples)
    screen = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as progress:
        steps = progress.add_task("reading the scene", total=4)
        path, host, still = options.scene or batch_file.DEMO, None, None
        if path.suffix.lower() in (*formats.USD, *formats.MESHES):
            scene = warpcam.load(path, options.worlds, device=device, **scene_access.options_of(options))
            progress.update(steps, description="building and compiling", advance=1)
        else:
            host, scene, still = _still_worlds(path, options, device, splats)
            progress.update(steps, description="building and compiling", advance=1)
        model = _sensor(options.sensor) if options.sensor else None
        drawn = outputs if model is None else tuple(dict.fromkeys((*outputs, *model.outputs)))
        if options.denoise:
            drawn = tuple(dict.fromkeys((*drawn, *denoised.NEEDED)))
        cameras = [
            warpcam.Camera(
                name,
                width=width,
                height=height,
                outputs=drawn,
                shadows=True,
                tone_mapping=options.tone_mapping,
                **pose,
            )
            for name, pose in _cameras(options.camera, scene, host, width / height).items()
        ]
        renderer = warpcam.Renderer(
            scene,
            cameras,
            look=options.look,
            path=paths,
            environments=scene_options.environments_of(options, scene),
            ambient_occlusion=options.ambient_occlusion,
            soft_shadows=options.soft_shadows,
            indirect_light=options.indirect_light,
            reflections=options.reflections,
        )
        look, images = _drawing(renderer, cameras, model, options)
        progress.update(steps, description="first frame", advance=1)
        look()
        if still is not None and any(name.startswith("flow") for name in outputs):  # something has to move
            still.positions[:] = batch_file.moved(host, still.positions, seed=options.seed + 1)
            look(forward=True)
        progress.update(steps, description="saving", advance=1, total=4 + len(cameras) * len(outputs))
        saved = []  # before frames are counted, which a sensor's numbers depend on
        for name, by_output in zip(_file_names(images), images.values(), strict=True):
            shown = denoised.denoised(by_output) if options.denoise else by_output
            for output in outputs:
                saved.append(_save(options.out, name, output, torch_interop.to_numpy(shown[output])))
                progress.advance(steps)
        progress.update(steps, description="rendering")
        rate = _frames_per_second(look, len(cameras) * options.worlds, device)
        progress.advance(steps)
    for path in saved:
        print(path)
    print(
        f"{options.worlds} worlds x {len(cameras)} cameras of {width}x{height} ({', '.join(outputs)}): "
        f"{rate:,.0f} frames/s on {_device_name(device)}"
    )
    return 0


def _check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be made or written, before all work."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise WarpcamError(f"--out: {str(folder)!r} cannot be written, as {str(there)!r} cannot; give another folder")


def _still_worlds(
    path: Path, options: argparse.Namespace, device: wp.Device, splats: Sequence[warpcam.Splats]
) -> tuple[Any, Any, Any]:
    """The model of a file, the scene of worlds with joints at random, and its source."""
    os.environ.setdefault("MUJOCO_GL", "disable")  # MuJoCo imports a library of windows otherwise, for nothing here
    access = FileAccess(path, **scene_access.options_of(options))
    host, state = batch_file.read(path, access=access)
    positions = batch_file.joint_positions(host, state.qpos, num_worlds=options.worlds, seed=options.seed)
    return host, *import_source("mujoco.still").load(host, state, positions, device, splats)


def _sensor(name: str) -> Any:
    from warpcam.sensors.depth_cameras import CAMERA_MODELS

    return CAMERA_MODELS[name]()


def _drawing(
    renderer: warpcam.Renderer, cameras: Sequence[warpcam.Camera], model: Any, options: argparse.Namespace
) -> tuple[Callable[..., Any], Mapping[str | int, Mapping[str, Any]]]:
    """What draws a frame, and where its images are: tensors, importing torch for seconds, where something needs them.

    Args:
        renderer: Of the cameras.
        cameras: Their names are the keys of the images.
        model: A sensor that measures what they see, or None.
        options: Of the command.
    """
    if model is not None:
        from warpcam.sensors import Rig

        rig = Rig(renderer, {camera.name: model for camera in cameras}, seed=options.seed)
        return rig.read, rig.images
    if options.denoise:
        return renderer.render, renderer.images
    arrays = {camera.name: {name: renderer.array(camera.name, name) for name in camera.outputs} for camera in cameras}
    return lambda forward=False: renderer.draw(None, forward, "render"), arrays


def _device_name(device: wp.Device) -> str:
    return f"{device.alias} ({device.name})"


def _cameras(names: list[str] | None, scene: Any, host: Any, aspect: float) -> dict[str | int, dict[str, Any]]:
    """The cameras to render, by key, with the arguments that place them where they are not the scene's own."""
    known = list(scene.cameras)
    if names is None and known:
        names = [str(index) if not name else name for index, name in enumerate(known)]
    if names is None:
        lower, upper = scene.bounds()
        return {FREE_CAMERA: batch_file.free_camera(host, lower, upper, aspect)}
    keys: dict[str | int, dict[str, Any]] = {}
    for name in names:
        if name in known:
            keys[name] = {}
        elif name.isdecimal() and int(name) < len(known):
            keys[int(name)] = {}
        else:
            has = ", ".join(map(repr, known)) or "none"
            raise WarpcamError(f"--camera: {name!r} came, the cameras of the scene are: {has}")
    return keys


def _frames_per_second(look: Callable[[], Any], frames: int, device: wp.Device) -> float:
    """Images per second once the first frame is done, the time of the device included."""
    wp.synchronize_device(device)
    start, count = time.perf_counter(), 0
    while time.perf_counter() - start < TIMING and count < 100:
        look()
        wp.synchronize_device(device)
        count += 1
    return frames * count / (time.perf_counter() - start)


def _file_names(cameras: Iterable[str | int]) -> list[str]:
    """Return a unique file name for each camera's pictures."""
    names: list[str] = []
    for camera in cameras:
        name = plain = re.sub(r"[^\w.-]+", "_", str(camera))
        count = 1
        while name in names:
            count += 1
            name = f"{plain}-{count}"
        names.append(name)
    return names


def _save(folder: Path, name: str, output: str, images: np.ndarray) -> Path:
    """Write all worlds' images of one output as one picture; returns its path."""
    path = folder / f"{name}-{output}.png"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        Image.fromarray(visualize.sheet(visualize.picture(output, images))).save(path)
    except OSError as error:
        raise WarpcamError(f"--out: {str(path)!r} cannot be written: {error.strerror}") from None
    return path
