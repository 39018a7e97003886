"""Learning on several GPUs: ``python -m warpcam.benchmarks.training_gpus``.

    python -m warpcam.benchmarks.training_gpus --processes 1 2 4 --worlds 2048 --iterations 120 --out gpus.json

Each run is ``torchrun --standalone --nproc-per-node N -m warpcam.train TASK``. While it goes on, nvidia-smi tells the
memory that each process has on each card. Besides, one process alone learns from as many worlds as N processes have
together: its curve is what theirs is compared with. The file is written after each run.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import warp as wp
from rich.table import Table

from warpcam.benchmarks import machine
from warpcam.benchmarks.report import console
from warpcam.benchmarks.training import summary, write
from warpcam.core.errors import WarpcamError
from warpcam.train.options import ENCODERS, TASKS

EVERY = 0.5  # seconds between two looks at the cards
Row = dict[str, Any]


def main(arguments: list[str] | None = None) -> int:
    options = parsed(arguments)
    if min(*options.processes, options.worlds, options.iterations) < 1:
        raise WarpcamError("--processes, --worlds and --iterations: at least 1 is needed")
    report: dict[str, Any] = {
        "about": f"python -m warpcam.benchmarks.training_gpus {' '.join(arguments or sys.argv[1:])}",
        "machine": machine.describe(wp.get_preferred_device()),
        "cards": [line.split(", ") for line in smi("gpu", "index,uuid,name")],
        "results": [],
    }
    together = [(count, options.worlds) for count in options.processes]
    alone = [(1, count * options.worlds) for count in options.processes if count > 1]
    for seed in options.seeds:
        for count, worlds in (*together, *(alone if options.alone else ())):
            row = learn(count, worlds, seed, options)
            report["results"].append(row)
            write(report, options.out)
            print(f"{count} x {worlds} worlds, seed {seed}: {row['steps_per_second']:,.0f} steps/s", flush=True)
    show(report["results"])
    return 0


def parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=tuple(TASKS), default="cartpole", help="default: %(default)s")
    parser.add_argument("--processes", nargs="+", type=int, default=[1, 2, 4], metavar="N", help="default: 1 2 4")
    parser.add_argument("--worlds", type=int, default=2048, help="of each process (default: %(default)s)")
    parser.add_argument("--iterations", type=int, default=120, help="default: %(default)s")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    parser.add_argument("--size", default="64x64", metavar="WxH", help="default: %(default)s")
    parser.add_argument("--encoder", choices=tuple(ENCODERS), default="task", help="default: %(default)s")
    parser.add_argument("--device", metavar="D", help="cpu, or a GPU for each process (default)")
    parser.add_argument(
        "--alone",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="also learn from the worlds of all processes in one (default: on)",
    )
    parser.add_argument("--out", type=Path, default=Path("training-gpus.json"), help="default: %(default)s")
    return parser.parse_args(arguments)


def learn(count: int, worlds: int, seed: int, options: argparse.Namespace) -> Row:
    """Have some processes learn together, and see what they have on the cards meanwhile."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(count)]
        command += [
            "-m",
            "warpcam.train",
            options.task,
            "--worlds",
            str(worlds),
            "--iterations",
            str(options.iterations),
        ]
        command += ["--seed", str(seed), "--size", options.size, "--out", folder]
        command += ["--device", options.device] if options.device else []
        command += ["--encoder", options.encoder]
        memory: dict[str, dict[str, int]] = {}
        log = Path(folder, "log")
        with log.open("w") as written:
            process = subprocess.Popen(command, stdout=written, stderr=subprocess.STDOUT)
            try:
                while process.poll() is None:
                    look(memory)
                    time.sleep(EVERY)
            finally:
                process.kill()
        if process.returncode:
            raise WarpcamError(f"{' '.join(command[1:])} has failed:\n{log.read_text()[-4000:]}")
        told = json.loads(Path(folder, "returns.json").read_text())
    row = {"processes": count, "worlds": worlds, "seed": seed, "iterations": options.iterations, "task": options.task}
    row["encoder"] = options.encoder
    row |= {name: told[name] for name in ("device", "random", "trained", "success", "most", "seconds")}
    return row | summary(told["curve"], told["most"]) | {"memory_mib": memory, "curve": told["curve"]}


def look(memory: dict[str, dict[str, int]]) -> None:
    """Note the most memory [MiB] that each rank has had on each card, by its UUID."""
    for line in smi("compute-apps", "pid,gpu_uuid,used_memory"):
        pid, card, used = line.split(", ")
        rank = rank_of(int(pid))
        if rank is not None and used.isdigit():
            cards = memory.setdefault(f"rank {rank}", {})
            cards[card] = max(cards.get(card, 0), int(used))
    for line in smi("gpu", "uuid,memory.used"):
        card, used = line.split(", ")
        cards = memory.setdefault("all", {})
        cards[card] = max(cards.get(card, 0), int(used))


def rank_of(pid: int) -> str | None:
    """Return the rank that torchrun gave a process of this machine."""
    try:
        entries = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:  # it has ended
        return None
    return next((entry[5:].decode() for entry in entries if entry.startswith(b"RANK=")), None)


def smi(what: str, fields: str) -> list[str]:
    """Lines of nvidia-smi; none without it."""
    if shutil.which("nvidia-smi") is None:
        return []
    command = ["nvidia-smi", f"--query-{what}={fields}", "--format=csv,noheader,nounits"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()


def show(rows: list[Row]) -> None:
    table = Table(
        "processes", "worlds of each", "seed", "steps/s", "of one", "90 % (s)", "return", "cards of each rank"
    )
    one = {row["seed"]: row["steps_per_second"] for row in reversed(rows) if row["processes"] == 1}
    for row in rows:
        reached = row["seconds_to_90"]
        cards = [str(len(cards)) for rank, cards in sorted(row["memory_mib"].items()) if rank != "all"]
        table.add_row(
            str(row["processes"]),
            str(row["worlds"]),
            str(row["seed"]),
            f"{row['steps_per_second']:,.0f}",
            f"{row['steps_per_second'] / one[row['seed']]:.2f}" if row["seed"] in one else "-",
            "-" if reached is None else f"{reached:.1f}",
            f"{row['trained']:.1f}",
            ", ".join(cards),
        )
    console().print(table)


if __name__ == "__main__":
    sys.exit(main())
