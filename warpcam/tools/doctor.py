"""``warpcam doctor``: what is where on this machine, and whether every device of it renders what the CPU renders."""

import argparse
import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import torch
import warp as wp
from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from warpcam.accel import tree_cache
from warpcam.core import device as device_rule
from warpcam.kernels.runtime.cpu_pool import cpu_threads, parse_positive_int
from warpcam.tools import self_test, startup

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


@dataclass(frozen=True)
class Card:
    """A device, as Warp knows it. A CPU has no UUID, address, architecture and memory of its own."""

    alias: str
    name: str
    uuid: str | None
    pci: str | None
    arch: int | None
    memory: int | None  # [bytes]
    free: int | None  # [bytes]


@dataclass(frozen=True)
class Variable:
    """An environment variable that bears on devices: its value as it stands, None if it is not set."""

    name: str
    value: str | None
    meaning: str


@dataclass(frozen=True)
class Render:
    """The self test on one device.

    Attributes:
        device: Its alias.
        passed: Whether the images are what they must be.
        problem: What is wrong with them, or why there are none.
        first: Until the first frame, compilation included [s].
        frame: Of a later frame of four small worlds [s].
        different: Share of pixels that are not the CPU's; None for the CPU itself, and without images.
        plan: The kernels that made them, a line each; None without images.
    """

    device: str
    passed: bool
    problem: str | None = None
    first: float | None = None
    frame: float | None = None
    different: float | None = None
    plan: str | None = None


@dataclass(frozen=True)
class Report:
    """All of it. ``problems`` make the exit status 1, ``remarks`` do not."""

    python: str
    platform: str
    packages: dict[str, str | None]
    simulators: dict[str, str | None]
    cuda: dict[str, str | int | None]
    caches: dict[str, str]
    devices: list[Card]
    environment: list[Variable]
    renders: list[Render]
    problems: list[str]
    remarks: list[str]


def examine(devices: Sequence[wp.Device], said: Callable[[str], None] = lambda _: None) -> Report:
    """Look at everything and render on every device.

    Args:
        devices: The CPU first.
        said: Is told what is going on.
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
        problems=problems,
        remarks=_remarks(environment),
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
        report = examine(wp.get_devices(), lambda text: status.update(text))
    if options.json:
        json.dump({"ok": not report.problems, **asdict(report)}, sys.stdout, indent=2)
        print()
    else:
        console = Console(highlight=False)
        if not console.is_terminal:
            console.width = 200  # a log does not care, and lines that are whole can be searched
        console.print(screen_of(report, plans=options.plan))
    return int(bool(report.problems))


def screen_of(report: Report, plans: bool = False) -> Group:
    """The report for people."""
    parts: list[Any] = []

    def section(title: str, rows: list[tuple[str, ...]]) -> None:
        table = Table.grid(padding=(0, 2))
        for row in rows:
            table.add_row(*map(Text, row))
        parts.extend((Text(title, style="bold"), Padding(table, (0, 0, 0, 2))))

    def versions(packages: Mapping[str, str | None]) -> list[tuple[str, ...]]:
        return [(name, found or "not installed") for name, found in packages.items()]

    section("Software", [("python", f"{report.python} on {report.platform}"), *versions(report.packages)])
    section("Simulators and the like", versions(report.simulators))
    section(
        "CUDA",
        [
            ("driver", f"for CUDA {report.cuda['driver']}" if report.cuda["driver"] else "none"),
            ("warp", f"built with CUDA {report.cuda['warp']}" if report.cuda["warp"] else "built without CUDA"),
            (
                "torch",
                f"built with CUDA {report.cuda['torch']}, sees {report.cuda['torch_gpus']} GPUs"
                if report.cuda["torch"]
                else "built without CUDA",
            ),
        ],
    )
    section("Caches", list(report.caches.items()))
    section("Devices", [_row(card) for card in report.devices])
    section(
        "Environment",
        [
            (each.name, "not set" if each.value is None else repr(each.value), each.meaning)
            for each in report.environment
        ],
    )
    section("Self test", [_result(render) for render in report.renders])
    for render in report.renders if plans else ():
        section(f"Kernels on {render.device}", [(line,) for line in (render.plan or "none").splitlines()])
    parts.extend(Text(f"! {text}", style="yellow") for text in report.remarks)
    parts.extend(Text(f"PROBLEM {text}", style="bold red") for text in report.problems)
    parts.append(Text("all is well" if not report.problems else f"problems: {len(report.problems)}", style="bold"))
    return Group(*parts)


def _row(card: Card) -> tuple[str, ...]:
    if card.memory is None or card.free is None:
        return card.alias, card.name
    memory = f"{card.free / 2**30:.1f} of {card.memory / 2**30:.1f} GiB free"
    return card.alias, card.name, memory, f"sm_{card.arch}", str(card.uuid), f"PCI {card.pci}"


def _result(render: Render) -> tuple[str, ...]:
    if render.first is None or render.frame is None:
        return render.device, "FAILED", str(render.problem)
    times = f"first frame after {render.first:.1f} s, then {1e3 * render.frame:.2f} ms"
    judged = "against the shapes' equations"
    if render.different is not None:
        judged += f" and the CPU: {render.different:.2%} of the pixels differ"
    return render.device, "passed" if render.passed else "FAILED", times, render.problem or judged


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
