"""``warpcam doctor``: what is where on this machine, and whether every device of it renders what the CPU renders."""

import argparse
import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import torch
import warp as wp
from rich.console import Console

from warpcam.accel import tree_cache
from warpcam.core import device as device_rule
from warpcam.kernels.runtime.cpu_pool import cpu_threads, parse_positive_int
from warpcam.tools import self_test, startup
from warpcam.tools.doctor_report import Card, Render, Report, Variable, screen_of

ABOUT = "print what is where on this machine, and render a small scene on every device; 1 if one fails"
PACKAGES = ("warpcam", "warp-lang", "torch", "numpy", "pillow", "rich")
SIMULATORS = (
    "mujoco",
    "mujoco-warp",
    "newton",
    "usd-core",
    "trimesh",
    "mjlab",
    "isaaclab",
    "robosuite",
    "gymnasium",
    "dm-control",
    "viser",
)

_IGNORED = "chooses a GPU for OpenGL; ignored here"
_NO_OPENGL = "chooses the OpenGL of MuJoCo's own renderer; ignored here"
VARIABLES: Mapping[str, str | Callable[[], str]] = {
    device_rule.VISIBLE: device_rule.meaning,
    "CUDA_DEVICE_ORDER": "PCI_BUS_ID numbers GPUs as nvidia-smi does, else the fastest is CUDA's first",
    "NVIDIA_VISIBLE_DEVICES": "the GPUs that a container is given; CUDA numbers those from 0",
    **dict.fromkeys(device_rule.GRAPHICS_VARIABLES, _IGNORED),
    "MUJOCO_GL": _NO_OPENGL,
    "PYOPENGL_PLATFORM": _NO_OPENGL,
    "LOCAL_RANK": "of torchrun; nothing here reads it: device=int(os.environ['LOCAL_RANK']) does",
    "CUDA_LAUNCH_BLOCKING": "1 waits for every kernel: slow, and for debugging only",
    "WARP_CACHE_PATH": "where Warp keeps compiled kernels",
    "WARPCAM_CACHE_DIR": "where trees of large meshes are kept",
    "WARPCAM_CACHE_SIZE": "how large their folder may be, 2 GiB unless set",
    "WARPCAM_CPU_THREADS": lambda: f"a frame on the CPU is split over {cpu_threads()} threads",
}


def examine(devices: Sequence[wp.Device], said: Callable[[str], None] = lambda _: None, deep: bool = False) -> Report:
    """Look at everything and render on every device.

    Args:
        devices: The CPU first.
        said: Is told what is going on.
        deep: Compare every output, lenses and sensors of each GPU with the CPU's.
    """
    environment = read_environment()
    renders: list[Render] = []
    judge: dict[str, Any] | None = None
    for device in devices:
        said(f"rendering on {device.alias}")
        render, images = _render(device, judge)
        renders.append(render)
        judge = images if device.is_cpu else judge
    problems = [f"{render.device}: {render.problem}" for render in renders if not render.passed]
    compared = _compared(devices, said) if deep else []
    problems += [
        f"{each.device}: {each.check}, {each.output}: {each.different:.1%} of the pixels are not the CPU's"
        for each in compared
        if not each.passed
    ]
    gpus, torchs = sum(not device.is_cpu for device in devices), torch.cuda.device_count()
    if gpus != torchs:
        problems.append(f"Warp sees {gpus} GPUs, torch {torchs}: {_why_torch_differs(gpus, torchs)}")
    return Report(
        python=platform.python_version(),
        platform=platform.platform(),
        packages={package: _version(package) for package in PACKAGES},
        simulators={package: _version(package) for package in SIMULATORS},
        cuda={
            "driver": _dotted(wp.get_cuda_driver_version()),
            "warp": _dotted(wp.get_cuda_toolkit_version()),
            "torch": torch.version.cuda,
            "torch_gpus": torchs,
        },
        caches={"kernels": str(wp.config.kernel_cache_dir), "trees": _trees()},
        devices=[_card(device) for device in devices],
        environment=environment,
        renders=renders,
        compared=compared,
        problems=problems,
        remarks=_remarks(environment)
        + (["--deep compares GPUs with the CPU, and there is none"] if deep and not gpus else []),
    )


def read_environment() -> list[Variable]:
    """The variables that are set, and ``CUDA_VISIBLE_DEVICES`` whether it is or not."""
    found = []
    for name, meaning in VARIABLES.items():
        value = os.environ.get(name)
        if value is not None or name == device_rule.VISIBLE:
            found.append(Variable(name, value, meaning if isinstance(meaning, str) else meaning()))
    return found


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.description = ABOUT
    command.add_argument("--json", action="store_true", help="print it for programs")
    command.add_argument("--plan", action="store_true", help="print the kernels of the self test, too")
    command.add_argument(
        "--deep",
        action="store_true",
        help="compare every output, lenses and sensors of each GPU with the CPU's: minutes",
    )


def run(options: Any) -> int:
    """Print the report; 1 if there is a problem."""
    try:
        startup.init_quietly()
    except Exception as error:  # whatever a broken installation raises; mostly a folder that cannot be written
        problem = f"Warp does not start: {error}. WARP_CACHE_PATH says where it keeps compiled kernels, else the home"
        print(json.dumps({"ok": False, "problems": [problem]}) if options.json else f"PROBLEM {problem}")
        return 1
    screen = Console(stderr=True)
    with screen.status("looking around") as status:
        report = examine(wp.get_devices(), lambda text: status.update(text), options.deep)
    if options.json:
        json.dump({"ok": not report.problems, **asdict(report)}, sys.stdout, indent=2)
        print()
    else:
        console = Console(highlight=False)
        if not console.is_terminal:
            console.width = 200  # a log does not care, and lines that are whole can be searched
        console.print(screen_of(report, plans=options.plan))
    return int(bool(report.problems))


def _compared(devices: Sequence[wp.Device], said: Callable[[str], None]) -> list[self_test.Comparison]:
    from warpcam.tools import deep_test  # which imports all that it tests

    return [each for device in devices if not device.is_cpu for each in deep_test.compare(device, said)]


def _render(device: wp.Device, judge: Mapping[str, Any] | None) -> tuple[Render, dict[str, Any] | None]:
    """The self test there, and its images if there are any."""
    try:
        shot = self_test.shoot(device)
    except Exception as error:  # whatever a broken installation raises: it is told, and the next device has its turn
        return Render(device.alias, False, f"no images: {type(error).__name__}: {error}"), None
    problem, share = self_test.fault(shot.images), None
    if judge is not None and not device.is_cpu:
        share, differs = self_test.difference(shot.images, dict(judge))
        problem = problem or differs
    return Render(
        device.alias,
        passed=problem is None,
        problem=problem,
        first=shot.first,
        frame=shot.frame,
        different=share,
        plan=shot.plan,
    ), shot.images


def _remarks(environment: Sequence[Variable]) -> list[str]:
    remarks = [
        f"{each.name}={each.value!r} has spaces; programs that compare or convert its text read something else"
        for each in environment
        if each.value is not None and each.value.strip() and any(map(str.isspace, each.value))
    ]
    remarks += [
        f"{each.name} is not set in this process; `export {each.name} = 0`, with spaces, sets nothing"
        for each in environment
        if each.name == device_rule.VISIBLE and each.value is None and wp.get_cuda_device_count() > 1
    ]
    remarks += [
        f"{each.name}={each.value!r}: {each.meaning}"
        for each in environment
        if each.name == device_rule.VISIBLE and each.meaning.startswith("it names")
    ]
    remarks += [
        f"{each.name}={each.value!r} names GPUs, but there is no CUDA driver: nothing but the CPU is seen"
        for each in environment
        if each.name == device_rule.VISIBLE
        and any(_names_gpu(entry.strip()) for entry in (each.value or "").split(","))
        and each.meaning == "there is no CUDA driver"
    ]
    remarks += [
        f"{each.name}={each.value!r} is no whole number above 0, and counts for nothing"
        for each in environment
        if each.name == "WARPCAM_CPU_THREADS"
        and (each.value or "").strip()
        and not parse_positive_int(each.value or "")
    ]
    if why := _why_no_trees():
        remarks.append(
            f"trees of large meshes are built anew in each program: {why}. WARPCAM_CACHE_DIR says where they go"
        )
    return remarks


def _trees() -> str:
    """The folder of trees, what lies in it and what may."""
    folder = tree_cache.folder()
    if folder is None or not tree_cache.limit():
        return "none"
    used, most = tree_cache.size(folder) / 2**20, tree_cache.limit() / 2**20
    return f"{folder}, {used:,.1f} of {most:,.1f} MiB"


def _why_no_trees() -> str | None:
    """Why nothing can be kept in the folder of trees; None if it can."""
    folder = tree_cache.folder()
    if folder is None:
        return "there is no home folder"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return str(error)


def _names_gpu(entry: str) -> bool:
    """Return whether an entry of ``CUDA_VISIBLE_DEVICES`` names a GPU; schedulers may also write that there is none."""
    return entry.isdigit() or entry.startswith(("GPU-", "MIG-"))


def _why_torch_differs(gpus: int, torchs: int) -> str:
    if torchs < gpus and torch.version.cuda is None:
        return "this torch was built without CUDA, and images on a GPU are torch tensors; install one that has it"
    if torchs < gpus:
        return "torch cannot use the driver, and images on a GPU are torch tensors; install one that fits it"
    return "nothing can be rendered on the others; install a Warp that fits the driver"


def _card(device: wp.Device) -> Card:
    if device.is_cpu:
        return Card(device.alias, str(device.name), uuid=None, pci=None, arch=None, memory=None, free=None)
    return Card(
        device.alias,
        str(device.name),
        uuid=device.uuid,
        pci=device.pci_bus_id,
        arch=int(device.arch),
        memory=int(device.total_memory),
        free=int(device.free_memory),
    )


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _dotted(numbers: tuple[int, int] | None) -> str | None:
    return None if numbers is None else ".".join(map(str, numbers))
