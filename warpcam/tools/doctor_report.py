"""What ``warpcam doctor`` has found, and how people see it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from warpcam.tools import self_test


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
    compared: list[self_test.Comparison]  # of ``--deep``
    problems: list[str]
    remarks: list[str]


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
    if report.compared:
        section("Compared with the CPU", [_comparison(each) for each in report.compared])
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


def _comparison(each: self_test.Comparison) -> tuple[str, ...]:
    verdict = "passed" if each.passed else "FAILED"
    return each.device, each.check, each.output, verdict, f"{each.different:.2%} of the pixels differ"


def _result(render: Render) -> tuple[str, ...]:
    if render.first is None or render.frame is None:
        return render.device, "FAILED", str(render.problem)
    times = f"first frame after {render.first:.1f} s, then {1e3 * render.frame:.2f} ms"
    judged = "against the shapes' equations"
    if render.different is not None:
        judged += f" and the CPU: {render.different:.2%} of the pixels differ"
    return render.device, "passed" if render.passed else "FAILED", times, render.problem or judged
