"""The command ``warpcam``: render, dataset, replay, view, train, bench, doctor and cache."""

import argparse
import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn, get_args

import numpy as np
import warp as wp
from PIL import Image
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

import warpcam
from warpcam import sensors, visualize
from warpcam.accel import tree_cache
from warpcam.benchmarks import options as benchmarks
from warpcam.benchmarks import run
from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.datasets.trajectories import replay_options as replays
from warpcam.render.looks import LookName
from warpcam.render.paths import PathOptions
from warpcam.sensors.depth_cameras import CAMERA_MODELS
from warpcam.sources.common import formats
from warpcam.sources.mujoco import batch_file
from warpcam.tools import dataset, doctor
from warpcam.tools.demo_simulation import Simulation
from warpcam.tools.image_size import image_size
from warpcam.train import options as training
from warpcam.train import run as train

FREE_CAMERA = "free"
TIMING = 1.0  # how long frames are counted at most, after the first one [s]
PERIOD = 1.0 / 30.0  # of pictures in a browser [s]
SLOWEST = 0.1  # what is simulated between two of them at most [s]


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything here does."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"warpcam: {message}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns its exit code: 0, 1 (the self test failed) or 2 (the user's mistake)."""
    options = _parser().parse_args(arguments)
    wp.config.log_level = wp.LOG_WARNING
    try:
        code: int = options.command(options)
    except WarpcamError as error:
        print(f"warpcam: {error}", file=sys.stderr)
        return 2
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="warpcam", description="Cameras for thousands of simulated robot worlds at once.")
    parser.add_argument("--version", action="version", version=f"warpcam {warpcam.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)

    render = commands.add_parser("render", help="render a scene in many worlds and save pictures")
    render.set_defaults(command=_render)
    _add_scene(render, worlds=16, size="256x256")
    render.add_argument(
        "--camera",
        action="extend",
        nargs="+",
        metavar="NAME",
        help="cameras of the scene, by name or index (default: all, or a free one if there is none)",
    )
    render.add_argument("--outputs", default="rgb,depth", help="separated by commas (default: %(default)s)")
    render.add_argument(
        "--sensor",
        choices=tuple(CAMERA_MODELS),
        metavar="NAME",
        help=f"measure depth as this camera does: {', '.join(CAMERA_MODELS)} (default: the truth)",
    )
    render.add_argument(
        "--look", choices=get_args(LookName), metavar="NAME", help="mujoco, pbr or path (default: the scene's own)"
    )
    render.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help=f"paths of each pixel with --look path (default: {PathOptions.samples})",
    )
    render.add_argument("--out", type=Path, default=Path("warpcam-out"), metavar="DIR", help="default: %(default)s")

    bulk = commands.add_parser("dataset", help=dataset.ABOUT, description=dataset.ABOUT)
    bulk.set_defaults(command=dataset.run)
    dataset.add(bulk)

    about = "look around in a scene, in a browser; MuJoCo simulates what it has read"
    view = commands.add_parser("view", help=about, description=about)
    view.set_defaults(command=_view)
    _add_scene(view, worlds=1, size="960x540")
    view.add_argument("--host", default="127.0.0.1", metavar="A", help="address to listen at (default: %(default)s)")
    view.add_argument("--port", type=int, default=8080, metavar="P", help="there (default: %(default)s, or the next)")

    bench = commands.add_parser("bench", help=benchmarks.ABOUT)
    bench.set_defaults(command=run.run)
    benchmarks.add(bench)

    learn = commands.add_parser("train", help=training.ABOUT)
    learn.set_defaults(command=train.run)
    training.add(learn)

    replayed = commands.add_parser("replay", help=replays.ABOUT)
    replayed.set_defaults(command=replays.run)
    replays.add(replayed)

    about = "print what is where on this machine, and render a small scene on every device; 1 if one fails"
    examined = commands.add_parser("doctor", help=about, description=about)
    examined.set_defaults(command=doctor.run)
    examined.add_argument("--json", action="store_true", help="print it for programs")
    examined.add_argument("--plan", action="store_true", help="print the kernels of the self test, too")

    about = "show or empty the folder of cached trees; WARPCAM_CACHE_DIR says where it is, WARPCAM_CACHE_SIZE its limit"
    cache = commands.add_parser("cache", help="show or empty the folder of cached trees", description=about)
    cache.set_defaults(command=_cache)
    cache.add_argument("action", choices=("show", "clear"), nargs="?", default="show", help="default: %(default)s")
    return parser


def _cache(options: argparse.Namespace) -> int:
    folder = tree_cache.folder()
    if folder is None:
        print("there is no folder of cached trees")
    elif options.action == "clear":
        print(f"{tree_cache.trim(folder, 0):,} bytes removed from {folder}")
    else:
        print(f"{tree_cache.size(folder):,} of {tree_cache.limit():,} bytes used in {folder}")
    return 0


def _add_scene(command: argparse.ArgumentParser, worlds: int, size: str) -> None:
    """Add the arguments that say what is rendered, in how many worlds, and where."""
    command.add_argument(
        "scene",
        nargs="?",
        type=Path,
        metavar="SCENE",
        help=f"a file: {', '.join((*formats.MUJOCO, *formats.USD, *formats.MESHES))} (default: a demo scene)",
    )
    command.add_argument("--worlds", type=int, default=worlds, metavar="N", help="default: %(default)s")
    command.add_argument("--size", default=size, metavar="WxH", help="of one image (default: %(default)s)")
    command.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")
    command.add_argument("--seed", type=int, default=0, help="of the random joint positions (default: %(default)s)")


def _checked_scene(options: argparse.Namespace) -> tuple[int, int, wp.Device]:
    """Width and height of an image, and the device."""
    size = image_size(options.size)
    if options.worlds < 1:
        raise WarpcamError(f"--worlds: {options.worlds} came, at least 1 is needed")
    if options.seed < 0:
        raise WarpcamError(f"--seed: {options.seed} came, 0 or more is needed")
    if options.scene is not None and not options.scene.is_file():
        raise WarpcamError(f"scene: there is no file {str(options.scene)!r}")
    return *size, resolve(options.device)


def _view(options: argparse.Namespace) -> int:
    from warpcam.viewer import Viewer

    width, height, device = _checked_scene(options)
    path, simulation = options.scene or batch_file.DEMO, None
    if path.suffix.lower() in (*formats.USD, *formats.MESHES):
        scene = warpcam.load(path, options.worlds, device=device)
    else:
        simulation = Simulation(path, options.worlds, options.seed)
        scene = warpcam.from_mujoco(simulation.host, simulation.states, device=device)
    viewer = Viewer(scene, width=width, height=height, host=options.host, port=options.port)
    print(f"{viewer.url} (Ctrl-C ends it)", flush=True)
    try:
        _look(viewer, simulation)
    except KeyboardInterrupt:
        return 0
    finally:
        viewer.close()


def _look(viewer: Any, simulation: Simulation | None) -> NoReturn:
    """Simulate in real time, and draw what is seen, until interrupted."""
    if simulation is not None:
        simulation.add_controls(viewer.server.gui)
    last = time.perf_counter()
    while True:
        begun = time.perf_counter()
        moved = simulation is not None and simulation.advance(min(begun - last, SLOWEST))
        last = begun
        viewer.update(moved)
        time.sleep(max(0.0, PERIOD - (time.perf_counter() - begun)))


def _render(options: argparse.Namespace) -> int:
    width, height, device = _checked_scene(options)
    outputs = [name.strip() for name in options.outputs.split(",") if name.strip()]
    if options.sensor and "depth" not in outputs:
        raise WarpcamError(
            f"--sensor: {options.sensor} measures depth, which --outputs must have, got {options.outputs}"
        )
    if options.samples is not None and options.look != "path":
        raise WarpcamError("--samples: it is of --look path alone")
    paths = None if options.samples is None else PathOptions(samples=options.samples)
    screen = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as progress:
        steps = progress.add_task("reading the scene", total=4)
        file, host, put = options.scene or batch_file.DEMO, None, None
        if file.suffix.lower() in (*formats.USD, *formats.MESHES):
            scene = warpcam.load(file, options.worlds, device=device)
            progress.update(steps, description="building and compiling", advance=1)
        else:
            put = batch_file.load(file, num_worlds=options.worlds, seed=options.seed, device=device)
            progress.update(steps, description="building and compiling", advance=1)
            scene, host = warpcam.from_mujoco_warp(put.host, put.model, put.data), put.host
        model = CAMERA_MODELS[options.sensor]() if options.sensor else None
        drawn = outputs if model is None else tuple(dict.fromkeys((*outputs, *model.outputs)))
        cameras = [
            warpcam.Camera(name, width=width, height=height, outputs=drawn, shadows=True, **pose)
            for name, pose in _cameras(options.camera, scene, host, width / height).items()
        ]
        renderer = warpcam.Renderer(scene, cameras, look=options.look, path=paths)
        rig = (
            None
            if model is None
            else sensors.Rig(renderer, {camera.name: model for camera in cameras}, seed=options.seed)
        )
        look = renderer.render if rig is None else rig.read
        progress.update(steps, description="first frame", advance=1)
        images = look()
        wp.synchronize_device(device)
        progress.update(steps, description="rendering", advance=1)
        rate = _frames_per_second(look, len(cameras) * options.worlds, device)
        if put is not None and any(name.startswith("flow") for name in outputs):  # something has to move
            batch_file.move(put, seed=options.seed + 1)
            look()
        progress.update(steps, description="saving", advance=1, total=4 + len(cameras) * len(outputs))
        saved = []
        for name, by_output in zip(_file_names(images), images.values(), strict=True):
            for output in outputs:
                saved.append(_save(options.out, name, output, by_output[output].cpu().numpy()))
                progress.advance(steps)
    for path in saved:
        print(path)
    print(
        f"{options.worlds} worlds x {len(cameras)} cameras of {width}x{height} ({', '.join(outputs)}): "
        f"{rate:,.0f} frames/s on {_device_name(device)}"
    )
    return 0


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
        Image.fromarray(visualize.sheet(visualize.picture(output, images))).save(path, optimize=True)
    except OSError as error:
        raise WarpcamError(f"--out: {str(path)!r} cannot be written: {error.strerror}") from None
    return path


if __name__ == "__main__":
    sys.exit(main())
