"""Mutated files of every format: a result or a ``WarpcamError``, and that the fuzzer sees what is neither.

These are the first mutations of ``python -m tests.fuzz``, which does 10,000 of each format unless told.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pxr")
pytest.importorskip("trimesh")
pytest.importorskip("collada")
pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[2]
QUICK = ("gltf", "obj", "ply", "stl", "dae", "msh", "splats", "usd", "calibration", "recipes", "lidar")
FAULTY = """
import os, signal, time
from pathlib import Path
from tests.fuzz import children
from warpcam.core.errors import WarpcamError

def open_case(case):
    if case == 1: raise WarpcamError("ours")
    if case == 2: raise KeyError("theirs")
    if case == 3: os.kill(os.getpid(), signal.SIGSEGV)
    if case == 4: time.sleep(60.0)
    if case == 5: bytearray(3 << 30)

children.SECONDS = 0.5
outcomes = children.run(open_case, range(7), Path("FOLDER"), time.monotonic() + 60.0)
print(*(outcome.kind for outcome in outcomes), outcomes[3].what)
"""


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own: it forks, which processes with threads should not."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PXR_WORK_THREAD_LIMIT": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, env=env, capture_output=True, text=True, timeout=300)


def test_mutated_files_are_read_or_refused(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    ran = run("-m", "tests.fuzz", "--formats", *QUICK, "--mutations", "60", "--out", str(out))
    assert ran.returncode == 0, ran.stdout + ran.stderr
    reports = json.loads(out.read_text())["formats"]
    assert [report["format"] for report in reports] == list(QUICK)
    assert all(report["ok"] >= report["files"] // 2 and report["refused"] > 0 for report in reports)
    assert sum(report["files"] for report in reports) > 300


def test_faults_are_seen(tmp_path: Path) -> None:
    ran = run("-c", FAULTY.replace("FOLDER", str(tmp_path)))
    assert ran.stdout.split() == [
        "ok", "refused", "other", "signal", "hang", "other", "ok", signal.Signals.SIGSEGV.name,
    ], ran.stderr  # fmt: skip


def test_cases_follow_from_their_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever the process, which has hashes of its own."""
    from tests.fuzz import __main__ as fuzz

    asked = ["--formats", "msh", "--show", "77", "--folder"]
    assert fuzz.main([*asked, str(tmp_path / "a")]) == 0
    shown = capsys.readouterr().out, run("-m", "tests.fuzz", *asked, str(tmp_path / "b")).stdout
    first, second = (Path(path.strip()).read_bytes() for path in shown)
    assert first == second
