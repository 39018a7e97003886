"""Renderers that are made in several threads at once, before any of their kernels is loaded."""

import subprocess
import sys
from pathlib import Path

import fast_compile
import warp as wp

PROGRAM = """
import sys, threading
from warpcam.core import device
from warpcam.tools import self_test

start, totals = threading.Barrier(4), []

def shoot():
    start.wait()
    totals.append(int(self_test.shoot(device.resolve(sys.argv[1])).images["rgb"].sum()))

threads = [threading.Thread(target=shoot) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print("DONE", *totals)
"""


def test_each_kernel_is_loaded_once(device: wp.Device, tmp_path: Path) -> None:
    """Loaded a second time, Warp's would be freed while the first thread is in them."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    command = [sys.executable, fast_compile.__file__, str(program), device.alias]
    for _ in range(3):  # from the second time on nothing is compiled, and they load together
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=tmp_path, check=False)
        assert done.returncode == 0, f"{done.returncode} {done.stderr[-2000:]}"
        totals = done.stdout.split("DONE")[1].split()
        assert len(totals) == 4 and len(set(totals)) == 1, done.stderr[-4000:]
