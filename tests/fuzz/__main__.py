"""``python -m tests.fuzz``: mutated files of every format through the public functions, in child processes.

What each case holds follows from ``--seed``, the format and the case's number alone.
"""

import argparse
import json
import random
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from tests.fuzz import children, doors, mutate, seeds

SECONDS = 10.0**9
MOST = 40  # distinct faults of a format that a report names


class Format:
    """Cases of one format: seeds unchanged first, mutations of them in turn after those."""

    def __init__(self, kind: str, folder: Path, seed: int):
        self.kind, self.seed, self.seeds = kind, seed, list(seeds.SEEDS[kind]())
        self.folder = folder / kind
        self.folder.mkdir(parents=True, exist_ok=True)

    def files(self, case: int) -> tuple[str, dict[str, bytes]]:
        seed = self.seeds[case % len(self.seeds)]
        if case < len(self.seeds):
            return seed.main, seed.files
        rng = random.Random(f"{self.seed} {self.kind} {case}")
        return seed.main, mutate.mutated(seed.files, seed.main, rng)

    def written(self, case: int, root: Path) -> Path:
        """The file of a case that is to be opened, below an emptied folder."""
        shutil.rmtree(root, ignore_errors=True)
        main, files = self.files(case)
        for name, data in files.items():
            path = root / "scene" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return root / "scene" / main

    def open(self, case: int) -> None:
        doors.DOORS[self.kind](self.written(case, self.folder / "case"))

    def report(self, first: int, mutations: int, until: float) -> dict[str, Any]:
        cases = range(first, len(self.seeds) + mutations)
        began = time.monotonic()
        outcomes = children.run(self.open, cases, self.folder, until)
        counts = Counter(outcome.kind for outcome in outcomes)
        faults: dict[tuple[str, ...], dict[str, Any]] = {}
        for outcome in outcomes:
            if outcome.kind in ("other", "signal", "hang"):
                key = (outcome.kind, outcome.place or outcome.what)
                fault = faults.setdefault(
                    key, {"kind": outcome.kind, "what": outcome.what, "place": outcome.place, "cases": []}
                )
                fault["cases"].append(outcome.case)
        return {
            "format": self.kind,
            "files": len(self.seeds),
            "mutations": len(outcomes) - min(len(outcomes), max(len(self.seeds) - first, 0)),
            **{kind: counts[kind] for kind in ("ok", "refused", "other", "signal", "hang")},
            "seconds": round(time.monotonic() - began, 1),
            "slowest": round(max((outcome.seconds for outcome in outcomes), default=0.0), 2),
            "faults": [
                {**fault, "count": len(fault["cases"]), "cases": fault["cases"][:3]}
                for fault in sorted(faults.values(), key=lambda fault: -len(fault["cases"]))[:MOST]
            ],
        }


def main(arguments: list[str] | None = None) -> int:
    """Run, print a table, and write JSON; 1 if a format had other exceptions, signals or hangs."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--formats", nargs="+", choices=sorted(doors.DOORS), default=list(doors.DOORS))
    parser.add_argument("--mutations", type=int, default=10_000, help="of each format (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each format at most")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    parser.add_argument("--show", type=int, metavar="CASE", help="write the case's files to --folder, open nothing")
    parser.add_argument("--folder", type=Path, help="for the cases (default: a temporary one)")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    reports = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        for kind in options.formats:
            cases = Format(kind, folder, options.seed)
            if options.show is not None:
                print(cases.written(options.show, folder / kind / "case"))
                continue
            report = cases.report(options.first, options.mutations, time.monotonic() + options.seconds)
            reports.append(report)
            print({key: value for key, value in report.items() if key != "faults"}, flush=True)
            for fault in report["faults"]:
                print("   ", fault["count"], fault["kind"], fault["what"][:120], "|", fault["place"], fault["cases"])
            if options.out is not None:
                options.out.write_text(json.dumps({"seed": options.seed, "formats": reports}, indent=1) + "\n")
    return int(any(report[kind] for report in reports for kind in ("other", "signal", "hang")))


if __name__ == "__main__":
    sys.exit(main())
