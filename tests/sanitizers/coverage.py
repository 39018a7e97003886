"""Which functions of kernels/native a run has reached, by clang's counters."""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

from tests.sanitizers import clang, includes

NATIVE = includes.NATIVE


def measure(counts: Sequence[Path], libraries: Sequence[str], folder: Path) -> dict[str, dict[str, int]]:
    """Functions and lines of each header, and those of them that were reached.

    Args:
        counts: Files that the libraries wrote.
        libraries: Those that were loaded.
        folder: For what is put together.
    """
    merged = folder / "counts.profdata"
    inputs = folder / "counts.txt"
    inputs.write_text("".join(f"1,{path}\n" for path in counts))
    command = [str(clang.tool("llvm-profdata")), "merge", f"-input-files={inputs}", "-o", str(merged)]
    subprocess.run(command, check=True, capture_output=True)
    first, *others = libraries
    objects = [word for path in others for word in ("-object", path)]
    command = [str(clang.tool("llvm-cov")), "export", "-summary-only", f"-instr-profile={merged}", first, *objects]
    exported = subprocess.run(command, check=True, capture_output=True, text=True)
    files = json.loads(exported.stdout)["data"][0]["files"]
    reached = {Path(file["filename"]): file["summary"] for file in files}
    return {str(header.relative_to(NATIVE)): _counts(reached.get(header)) for header in sorted(NATIVE.rglob("*.h"))}


def _counts(summary: dict[str, dict[str, int]] | None) -> dict[str, int]:
    functions, lines = (summary or {}).get("functions", {}), (summary or {}).get("lines", {})
    return {
        "functions": functions.get("count", 0),
        "reached": functions.get("covered", 0),
        "lines": lines.get("count", 0),
        "lines_reached": lines.get("covered", 0),
    }
