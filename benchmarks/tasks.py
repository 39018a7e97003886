"""Measurements that a command asks for: cases with the settings and outputs to measure them in."""

import argparse
import importlib.util
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import warp as wp

from warpcam.benchmarks import cases, own_scene, peers, suite, sweeps
from warpcam.benchmarks.cases import Case, Setting, Wanted
from warpcam.benchmarks.options import SUITE_OUTPUTS, SUITE_SETTINGS
from warpcam.core.errors import WarpcamError


@dataclass(frozen=True)
class Task:
    """A case in settings of as many worlds each.

    Attributes:
        marks: What marks its results.
    """

    case: Case
    settings: tuple[Setting, ...]
    wanted: tuple[Wanted, ...]
    marks: Mapping[str, Any] = field(default_factory=dict)


def tasks(options: argparse.Namespace, device: wp.Device) -> list[Task]:
    if options.sweep:
        return [
            Task(case, (setting,), tuple(wanted), marks) for (case, setting, wanted), marks in sweeps.points(options)
        ]
    if options.suite:
        return by_worlds(part(suite.cases(options.suite), options.part), options, device, SUITE_SETTINGS, SUITE_OUTPUTS)
    if options.scene:
        case = own_scene.case_of(options.scene, options.camera)
        return by_worlds([case], options, device, SUITE_SETTINGS, SUITE_OUTPUTS)
    known = cases.CASES
    found = chosen("--case", options.case, known) if options.case else [c for c in known.values() if available(c)]
    return [
        Task(case, (setting,), tuple(wanted_of(options, tuple(cases.COMMON))))
        for setting in settings_of(options, device, ("8192x64",))
        for case in found
    ]


def by_worlds(
    found: Sequence[Case],
    options: argparse.Namespace,
    device: wp.Device,
    settings: tuple[str, ...],
    outputs: tuple[str, ...],
) -> list[Task]:
    """Tasks case by case, so that a case is built once for all settings of as many worlds, and its kernels are."""
    groups: dict[int | None, list[Setting]] = {}
    for setting in settings_of(options, device, settings):
        groups.setdefault(setting.worlds, []).append(setting)
    wanted = tuple(wanted_of(options, outputs))
    return [Task(case, tuple(group), wanted) for case in found for group in groups.values()]


def settings_of(options: argparse.Namespace, device: wp.Device, default: tuple[str, ...]) -> list[Setting]:
    names = options.setting or (default if device.is_cuda else ("cpu",))
    return [
        cases.resized(setting, options.worlds, options.size) for setting in chosen("--setting", names, cases.SETTINGS)
    ]


def wanted_of(options: argparse.Namespace, default: tuple[str, ...]) -> list[Wanted]:
    names: list[str] = []
    for name in options.outputs or default:
        names += cases.EXTRAS if name == "extras" else [name]
    return chosen("--outputs", names, cases.WANTED)


def part(found: Sequence[Case], asked: str | None) -> list[Case]:
    """Every N-th case from the K-th on, of "K/N"."""
    if asked is None:
        return list(found)
    match = re.fullmatch(r"([1-9]\d?)/([1-9]\d?)", asked)
    if match is None or int(match[1]) > int(match[2]):
        raise WarpcamError(f"--part: {asked!r} came, one of so many parts like 1/4 is needed")
    return list(found[int(match[1]) - 1 :: int(match[2])])


def not_asked(found: Sequence[Task], renderers: Sequence[str]) -> list[str]:
    """Renderers that no task is asked of for the number of worlds and pixels."""
    return [
        name
        for name in renderers
        if name == "mujoco"
        and not any(
            peers.draws(name, one, setting.worlds_of(task.case), setting)
            for task in found
            for setting in task.settings
            for one in task.wanted
        )
    ]


def available(case: Case) -> bool:
    packages = (case.package, "newton" if case.newton else None)
    return all(package is None or importlib.util.find_spec(package) is not None for package in packages)


def left_out(options: argparse.Namespace) -> dict[str, str]:
    """Return the renderers and cases that a run leaves out for lack of packages, and the packages' names for pip."""
    lacking: dict[str, str] = {}
    if not options.peer and not options.sweep:
        lacking = {name: peers.INSTALL[name] for name in peers.PEERS if name not in peers.installed()}
    if not (options.case or options.sweep or options.suite or options.scene):
        for case in cases.CASES.values():
            if not available(case):
                lacking[f"case {case.name}"] = "newton" if case.newton else str(case.package).replace("_", "-")
    return lacking


def chosen(option: str, names: Sequence[str], known: Mapping[str, Any]) -> list[Any]:
    for name in names:
        if name not in known:
            raise WarpcamError(f"{option}: {name!r} came, known are: {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)]
