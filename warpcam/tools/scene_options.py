"""Arguments that say what is rendered, in how many worlds, and where."""

import argparse
from pathlib import Path
from typing import Any, get_args

import numpy as np
import warp as wp

from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.render.looks import LookName, looks_of
from warpcam.scene.environments import Environments
from warpcam.scene.scene import Scene
from warpcam.sources.common import formats
from warpcam.sources.common.splats import Splats
from warpcam.sources.mujoco import batch_file
from warpcam.tools import scene_access
from warpcam.tools.image_size import image_size


def add(command: argparse.ArgumentParser, worlds: int, size: str) -> None:
    """Add the arguments that say what is rendered, in how many worlds, and where."""
    command.add_argument(
        "scene",
        nargs="?",
        type=Path,
        metavar="SCENE",
        help=f"a file: {', '.join((*formats.MUJOCO, *formats.USD, *formats.MESHES))} (default: a demo scene)",
    )
    scene_access.add(command)
    command.add_argument(
        "--splats",
        nargs="+",
        default=[],
        type=Path,
        metavar="PLY",
        help="Gaussian splats in the worlds of an .xml, .mjb or .urdf file, each world the next of these files in turn",
    )
    command.add_argument("--worlds", type=int, default=worlds, metavar="N", help="default: %(default)s")
    command.add_argument("--size", default=size, metavar="WxH", help="of one image (default: %(default)s)")
    command.add_argument("--device", metavar="D", help="cpu, cuda:0, ... (default: the first GPU, or the CPU)")
    command.add_argument("--seed", type=int, default=0, help="of the random joint positions (default: %(default)s)")


def add_look(command: argparse.ArgumentParser) -> None:
    """Add the arguments that say how colours are lit."""
    command.add_argument(
        "--look", choices=get_args(LookName), metavar="NAME", help="mujoco, pbr or path (default: the scene's own)"
    )
    command.add_argument(
        "--environment",
        type=Path,
        metavar="FILE",
        help="light from all around with --look pbr and path, a .hdr or .exr image by longitude and latitude",
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
        "--reflections",
        action="store_true",
        help="trace what smooth surfaces mirror and what is seen through clear ones, with --look pbr",
    )


def environments_of(options: argparse.Namespace, scene: Scene) -> Environments | None:
    """The argument ``environments`` of ``Renderer``."""
    if options.environment is None:
        return None
    if (options.look or looks_of(scene)[0]) == "mujoco":
        own = "that of --look" if options.look else "the scene's own"
        raise WarpcamError(
            f"--environment: it lights --look pbr and --look path, and the look is 'mujoco', {own}; add --look pbr"
        )
    return Environments(scene, options.environment)


def rays_of(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments of ``Renderer`` and ``Viewer`` for rays of the look "pbr"."""
    return {
        name: getattr(options, name) for name in ("ambient_occlusion", "soft_shadows", "indirect_light", "reflections")
    }


def splats_of(options: argparse.Namespace) -> list[Splats]:
    """The argument ``splats`` of ``warpcam.load``."""
    if not options.splats:
        return []
    kind = (options.scene or batch_file.DEMO).suffix.lower()
    if kind not in formats.MUJOCO:
        raise WarpcamError(f"--splats: it is for {', '.join(formats.MUJOCO)} files, not for {kind} files")
    return [Splats(options.splats, choice=np.arange(options.worlds) % len(options.splats))]


def check(options: argparse.Namespace) -> tuple[int, int, wp.Device]:
    """Width and height of an image, and the device."""
    size = image_size(options.size)
    if options.worlds < 1:
        raise WarpcamError(f"--worlds: {options.worlds} came, at least 1 is needed")
    if options.seed < 0:
        raise WarpcamError(f"--seed: {options.seed} came, 0 or more is needed")
    if options.scene is not None and not options.scene.is_file():
        raise WarpcamError(f"scene: there is no file {str(options.scene)!r}")
    return *size, resolve(options.device)
