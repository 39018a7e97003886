"""The command ``warpcam dataset``: labelled images in bulk."""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import warp as wp
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate import Plan, Recipes, device_jpeg, generate, read_recipes
from warpcam.datasets.generate.run import Part
from warpcam.datasets.writers import WRITERS
from warpcam.sources.common import formats
from warpcam.sources.mujoco import batch_file
from warpcam.tools import scene_access
from warpcam.tools.image_size import image_size

ABOUT = "make labelled images in bulk: randomised worlds of a scene in a file format of computer vision"


class _Rate(ProgressColumn):
    """Samples per second."""

    def render(self, task: Any) -> Text:
        return Text("" if task.speed is None else f"{task.speed:,.1f} samples/s")


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.description = ABOUT
    kinds = ", ".join((*formats.MUJOCO, *formats.USD, *formats.MESHES))
    command.add_argument(
        "scene", nargs="?", type=Path, metavar="SCENE", help=f"a file: {kinds} (default: a demo scene)"
    )
    scene_access.add(command)
    command.add_argument("--writer", required=True, metavar="FORMAT", help=f"one of {', '.join(WRITERS)}")
    command.add_argument("--count", required=True, type=int, metavar="N", help="samples; each is seen by all cameras")
    command.add_argument(
        "--out", type=Path, default=Path("warpcam-dataset"), metavar="DIR", help="default: %(default)s"
    )
    command.add_argument("--seed", type=int, default=0, metavar="S", help="default: %(default)s")
    command.add_argument("--randomize", type=Path, metavar="FILE.yaml", help="how samples differ, and what is labelled")
    command.add_argument("--size", default="640x480", metavar="WxH", help="of one image (default: %(default)s)")
    command.add_argument("--camera", nargs="+", metavar="NAME", help="cameras (default: all, or a free one)")
    command.add_argument(
        "--shard-size", type=int, default=100, metavar="N", help="samples of a shard (default: %(default)s)"
    )
    command.add_argument("--worlds", type=int, default=16, metavar="N", help="drawn at once (default: %(default)s)")
    command.add_argument(
        "--workers", type=int, metavar="N", help="processes (default: 1, with --ray one for each GPU or processor)"
    )
    command.add_argument(
        "--ray",
        nargs="?",
        const="",
        metavar="ADDRESS",
        help="on a Ray cluster (default: one that runs here, or a new one)",
    )
    command.add_argument(
        "--shards",
        metavar="I/N",
        help="only every N-th shard from the I-th on (from 0); without it, complete the data set",
    )
    command.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: all GPUs in turns, or the CPU)")
    command.add_argument("--image-format", choices=("jpg", "png"), default="jpg", help="default: %(default)s")
    command.add_argument("--quality", type=int, default=92, metavar="Q", help="of .jpg, 1 to 95 (default: %(default)s)")
    command.add_argument(
        "--jpeg",
        choices=("pillow", "torchcodec"),
        help="what encodes .jpg (default: torchcodec, by nvJPEG, if it is there, a GPU draws, and no photographs are "
        "put behind images)",
    )
    command.add_argument(
        "--antialiasing", type=int, default=4, metavar="N", help="samples of an edge (default: %(default)s)"
    )
    command.add_argument(
        "--validation", type=float, default=0.0, metavar="SHARE", help="of the samples (default: %(default)s)"
    )
    command.add_argument(
        "--option", action="append", default=[], metavar="NAME=VALUE", help="of the writer, see the documentation"
    )


def run(options: argparse.Namespace) -> int:
    """Make the data set; returns the exit code."""
    width, height = image_size(options.size)
    recipes = read_recipes(options.randomize)
    plan = Plan(
        scene=str(options.scene or batch_file.DEMO),
        out=str(options.out),
        writer=options.writer,
        count=options.count,
        seed=options.seed,
        width=width,
        height=height,
        cameras=tuple(options.camera) if options.camera else None,
        recipes=recipes,
        shard_size=options.shard_size,
        worlds=options.worlds,
        device=options.device,
        image_format=options.image_format,
        quality=options.quality,
        jpeg=options.jpeg or _encoder(options, recipes),
        antialiasing=options.antialiasing,
        validation=options.validation,
        options=tuple(map(_option, options.option)),
        trusted=options.trusted,
        search_paths=tuple(map(str, options.search_path)),
    )
    screen = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), _Rate(), TimeRemainingColumn())
    begun = time.perf_counter()
    with Progress(*columns, console=screen, disable=not screen.is_terminal) as progress:
        samples, known = progress.add_task("samples", total=plan.count), -1

        def advance(done: int) -> None:
            nonlocal known
            if known < 0:  # those of earlier runs, which are no part of the rate
                known = done
                progress.reset(samples, completed=done)
            else:
                progress.advance(samples, done)

        try:
            _generate(plan, options, advance)
        except KeyboardInterrupt:
            raise WarpcamError("dataset: interrupted; run the same command again to go on") from None
    if options.shards is not None:
        print(
            f"shards {options.shards} are in {plan.out}; once all are, the same command without --shards completes it"
        )
        return 0
    made, seconds = plan.count - known, time.perf_counter() - begun
    print(
        f"{plan.count:,} samples in {plan.out}, {made:,} of them made now in {seconds:.1f} s ({made / seconds:,.1f} a "
        "second); look at contact_sheet.png and statistics.html"
    )
    return 0


def _encoder(options: argparse.Namespace, recipes: Recipes) -> str:
    """What encodes .jpg if nobody says it."""
    on_gpu = wp.is_cuda_available() if options.device is None else resolve(options.device).is_cuda
    fits = options.image_format == "jpg" and recipes.backgrounds is None
    return "torchcodec" if on_gpu and fits and device_jpeg.is_installed() else "pillow"


def _generate(plan: Plan, options: argparse.Namespace, advance: Callable[[int], None]) -> None:
    part = None if options.shards is None else _part(options.shards)
    if options.ray is None:
        generate(plan, 1 if options.workers is None else options.workers, advance, part)
        return
    from warpcam.datasets.generate.cluster import generate_on_ray

    generate_on_ray(plan, options.ray or None, options.workers, advance, part)


def _part(text: str) -> Part:
    first, sign, count = text.partition("/")
    if not (sign and first.isdecimal() and count.isdecimal()):
        raise WarpcamError(f"--shards: {text!r} came, I/N is needed, such as 0/8")
    return int(first), int(count)


def _option(text: str) -> tuple[str, Any]:
    name, sign, value = text.partition("=")
    if not sign:
        raise WarpcamError(f"--option: {text!r} came, NAME=VALUE is needed")
    if value in ("true", "false"):
        return name, value == "true"
    for kind in (int, float):
        try:
            return name, kind(value)
        except ValueError:
            continue
    raise WarpcamError(f"--option: {text!r} came, a number, true or false is needed")
