"""Isaac Gym's ``gymutil``: command lines, simulation parameters from tables, random properties, lines for viewers.

Lines may be made and moved; that there is no window to draw them in is said where they are drawn.
"""

import argparse
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp

from warpcam.compat.isaacgym import gymapi
from warpcam.compat.isaacgym.api.line_geometry import (
    AxesGeometry,
    LineGeometry,
    WireframeBBoxGeometry,
    WireframeBoxGeometry,
    WireframeSphereGeometry,
)
from warpcam.compat.isaacgym.api.randomization import (
    apply_random_samples,
    check_buckets,
    generate_random_samples,
    get_default_setter_args,
    get_property_getter_map,
    get_property_setter_map,
)
from warpcam.core.errors import WarpcamError

__all__ = [
    "AxesGeometry",
    "LineGeometry",
    "WireframeBBoxGeometry",
    "WireframeBoxGeometry",
    "WireframeSphereGeometry",
    "apply_random_samples",
    "check_buckets",
    "draw_line",
    "draw_lines",
    "generate_random_samples",
    "get_default_setter_args",
    "get_property_getter_map",
    "get_property_setter_map",
    "parse_arguments",
    "parse_bool",
    "parse_device_str",
    "parse_flex_config",
    "parse_physx_config",
    "parse_sim_config",
]

WORDS = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
CUSTOM = ("name", "type", "default", "action", "help", "nargs", "choices", "required", "dest")


def draw_lines(geom: LineGeometry, gym: gymapi.Gym, viewer: Any, env: gymapi.Env, pose: Any) -> None:
    """Hand lines at a pose to ``add_lines``, which says that there is no window."""
    gym.add_lines(viewer, env, geom.num_lines(), geom.instance_verts(pose), geom.colors())


def draw_line(
    p1: gymapi.Vec3, p2: gymapi.Vec3, color: gymapi.Vec3, gym: gymapi.Gym, viewer: Any, env: gymapi.Env
) -> None:
    """Draw one line."""
    ends = np.array([[tuple(p1), tuple(p2)]], gymapi.Vec3.dtype)
    gym.add_lines(viewer, env, 1, ends, np.array([tuple(color)], gymapi.Vec3.dtype))


def parse_bool(arg: str) -> bool:
    """Parse "true", "yes", "on", "1" and their opposites."""
    if str(arg).lower() not in WORDS:
        raise WarpcamError(f"parse_bool: {arg!r} came; allowed are {', '.join(WORDS)}")
    return WORDS[str(arg).lower()]


def parse_device_str(device_str: str) -> tuple[str, int]:
    """Kind and number of a device as torch writes them: "cpu", "cuda", "cuda:1"."""
    kind, colon, number = str(device_str).partition(":")
    if kind not in ("cpu", "cuda") or (colon and not (kind == "cuda" and number.isdecimal())):
        raise WarpcamError(f'parse_device_str: {device_str!r} came; allowed are "cpu", "cuda" and "cuda:<number>"')
    return kind, int(number or 0)


def parse_arguments(
    description: str = "Isaac Gym Example",
    headless: bool = False,
    no_graphics: bool = False,
    custom_parameters: Sequence[Mapping[str, Any]] = (),
) -> argparse.Namespace:
    """Parse the command line: devices, and a program's own parameters.

    Args:
        description: Shown by ``--help``.
        headless: Whether there is ``--headless``.
        no_graphics: Whether there is ``--nographics``, which means ``--headless``, too.
        custom_parameters: Of the program: "name", and what argparse takes: "type" or "action", "default", "help" ...

    Returns:
        With ``sim_device`` ("cuda:0", without a GPU "cpu"), ``sim_device_type``, ``compute_device_id``,
        ``graphics_device_id``, ``pipeline``, ``use_gpu_pipeline``, ``use_gpu``, ``physics_engine``, ``num_threads``,
        ``subscenes`` and ``slices``.
    """
    parser = argparse.ArgumentParser(description=description)
    if headless:
        parser.add_argument("--headless", action="store_true", help="no window")
    if no_graphics:
        parser.add_argument("--nographics", action="store_true", help="no window, and no images")
    first = "cuda:0" if wp.is_cuda_available() else "cpu"
    parser.add_argument("--sim_device", default=first, help="where to simulate, as torch writes it")
    parser.add_argument("--pipeline", default="gpu", help="where state tensors are: cpu or gpu")
    parser.add_argument("--graphics_device_id", type=int, default=0, help="as sim_device's number, or -1")
    engine = parser.add_mutually_exclusive_group()
    engine.add_argument("--flex", action="store_true", help="held: Newton simulates")
    engine.add_argument("--physx", action="store_true", help="held: Newton simulates")
    parser.add_argument("--num_threads", type=int, default=0, help="held")
    parser.add_argument("--subscenes", type=int, default=0, help="held")
    parser.add_argument("--slices", type=int, help="held; subscenes, if not given")
    for parameter in custom_parameters:
        _add(parser, parameter)
    args = parser.parse_args()

    if args.pipeline.lower() not in ("cpu", "gpu", "cuda"):
        raise WarpcamError(f"--pipeline {args.pipeline!r} came; allowed are cpu and gpu")
    args.sim_device_type, args.compute_device_id = parse_device_str(args.sim_device)
    args.use_gpu = args.sim_device_type == "cuda"
    if not args.use_gpu and args.pipeline.lower() != "cpu":
        print("The simulation is on the CPU, and so are its tensors: --pipeline becomes cpu.")
        args.pipeline = "CPU"
    args.use_gpu_pipeline = args.pipeline.lower() != "cpu"
    args.physics_engine = gymapi.SIM_FLEX if args.flex else gymapi.SIM_PHYSX
    if no_graphics and args.nographics:
        args.headless = True
    if args.slices is None:
        args.slices = args.subscenes
    return args


def parse_sim_config(config: Mapping[str, Any], sim_params: gymapi.SimParams) -> None:
    """Set simulation parameters from a table.

    Args:
        config: By name, as ``SimParams`` has them: ``gravity`` of three numbers, ``up_axis`` 0 for y and 1 for z, and
            tables of ``physx`` and ``flex``.
        sim_params: To be changed.
    """
    _set(sim_params, {name: value for name, value in config.items() if name not in ("physx", "flex")})
    if "physx" in config:
        parse_physx_config(config["physx"], sim_params)
    if "flex" in config:
        parse_flex_config(config["flex"], sim_params)


def parse_physx_config(config: Mapping[str, Any], sim_params: gymapi.SimParams) -> None:
    """Set those of ``physx``."""
    _set(sim_params.physx, config)


def parse_flex_config(config: Mapping[str, Any], sim_params: gymapi.SimParams) -> None:
    """Set those of ``flex``."""
    _set(sim_params.flex, config)


def _indent_xml(elem: ElementTree.Element, level: int = 0) -> None:
    """Break and indent the lines of an XML file, for programs that write their assets themselves."""
    ElementTree.indent(elem, level=level)


def _set(params: Any, config: Mapping[str, Any]) -> None:
    """Each as what it is there: a number, a vector, a member of a closed set."""
    for name, value in config.items():
        before = getattr(params, name, None)
        try:
            like = _like(before, value)
        except (TypeError, ValueError):
            raise WarpcamError(
                f"{name} of {type(params).__name__} must be as {before!r} is, a {type(before).__name__}, got {value!r}"
            ) from None
        setattr(params, name, like)


def _like(before: Any, value: Any) -> Any:
    if isinstance(before, gymapi.Vec3):
        x, y, z = value
        return gymapi.Vec3(x, y, z)
    if not isinstance(before, IntEnum | bool | int | float):
        return value
    number = float(value)
    like = type(before)(number) if isinstance(before, float) else type(before)(int(number))
    if like != number:
        raise ValueError(value)  # a part of it would be lost
    return like


def _add(parser: argparse.ArgumentParser, parameter: Mapping[str, Any]) -> None:
    """One of the program's own; where it has a type, an action counts for nothing."""
    unknown = set(parameter) - set(CUSTOM)
    if "name" not in parameter or not {"type", "action"} & set(parameter) or unknown:
        raise WarpcamError(
            f"parse_arguments: a custom parameter has a name, a type or an action, and of {', '.join(CUSTOM)} what is "
            f"needed; got {dict(parameter)}"
        )
    more = {name: value for name, value in parameter.items() if name != "name"}
    if "type" in more:
        more.pop("action", None)
    parser.add_argument(parameter["name"], **more)
