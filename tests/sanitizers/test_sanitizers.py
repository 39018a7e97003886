"""What sanitizers find is told, with the scene and the place."""

from pathlib import Path

import pytest

from tests.sanitizers import coverage, cpu, gpu, includes, reports

# Kernels that read past the end of an array, overflow, and do neither.
PLANTED = """
import warp as wp
from tests.sanitizers import draw

@wp.func_native("return values.data[i + shift];")
def read(values: wp.array(dtype=wp.float32), i: wp.int32, shift: wp.int32) -> wp.float32: ...

@wp.func_native("return i + 2147483647;")
def overflow(i: wp.int32) -> wp.int32: ...

@wp.kernel(enable_backward=False)
def sum_up(values: wp.array(dtype=wp.float32), shift: wp.int32, out: wp.array(dtype=wp.float32)):
    out[wp.tid()] = read(values, wp.tid(), shift)

@wp.kernel(enable_backward=False)
def count(out: wp.array(dtype=wp.int32)):
    out[wp.tid()] = overflow(wp.tid())

def shifted(shift):
    def draw(device):
        out = wp.zeros(8, device=device)
        wp.launch(sum_up, 8, [wp.ones(8, device=device), shift], [out], device=device)
    return draw

def counted(device):
    wp.launch(count, 2, [], [wp.zeros(2, dtype=wp.int32, device=device)], device=device)

def failed(device):
    raise ValueError("no such thing")

scenes = {"well": shifted(0), "past": shifted(1), "overflow": counted, "failed": failed, "again": shifted(0)}
draw.main("cpu", list(scenes), scenes)
"""
# As compute-sanitizer writes it.
SAID = """
========= COMPUTE-SANITIZER
== scene box
== drawn 1.5
== scene ball
========= Invalid __global__ write of size 4 bytes
=========     at write_images_0d8028d7_cuda_kernel_forward+0x70 in wp_write_images.cu:5
=========     by thread (0,0,0) in block (0,0,0)
=========     Address 0x7f1c00000120 is out of bounds
=========
========= Error: Race reported between Write access at shadow+0x10 in /a/kernels/native/shadow/casters.h:7
=========     and Read access at shadow+0x90 in /a/kernels/native/shadow/casters.h:9 [16 hazards]
========= Error: Race reported between Write access at shadow+0x10 in /a/kernels/native/shadow/casters.h:7
== drawn 0.5
== scene cut
Fatal: gone
========= ERROR SUMMARY: 3 errors
"""


def test_faults_of_cpu_kernels_are_found(tmp_path: Path) -> None:
    if (reason := cpu.available()) is not None:
        pytest.skip(f"sanitizers: {reason}")
    program = tmp_path / "program.py"
    program.write_text(PLANTED)
    text = cpu.watched([str(program)], tmp_path)
    scenes = {scene["scene"]: scene for scene in reports.drawn(text)}
    assert list(scenes) == ["well", "past", "overflow", "failed", "again"], text
    found = {name: [finding["what"] for finding in scene["findings"]] for name, scene in scenes.items()}
    assert found["well"] == found["failed"] == found["again"] == []
    assert found["past"] == ["AddressSanitizer: heap-buffer-overflow"]
    assert found["overflow"] == ["signed integer overflow: 1 + 2147483647 cannot be represented in type 'int'"]
    assert {name for name, scene in scenes.items() if scene["seconds"] is None} == {"failed"}
    assert "no such thing" in scenes["failed"]["end"]


def test_what_compute_sanitizer_says_is_read() -> None:
    box, ball, cut = reports.drawn(SAID, "memcheck")
    assert box == {"tool": "memcheck", "scene": "box", "seconds": 1.5, "end": "", "findings": []}
    race, write = ball["findings"]
    assert write == {
        "what": "Invalid __global__ write of size 4 bytes",
        "place": "write_images_0d8028d7_cuda_kernel_forward+0x... in wp_write_images.cu:5",
        "count": 1,
    }
    assert race["count"] == 2 and race["what"].startswith("Error: Race reported") and "casters.h:7" in race["what"]
    assert cut["seconds"] is None and cut["findings"] == []


def test_headers_of_the_list_are_there() -> None:
    assert includes.all_headers() >= coverage.NOT_ON_CPU
    closure = includes.closure(["path/path_tracer.h"])
    assert {"path/trace_path.h", "core/platform.h"} <= closure <= includes.all_headers()
    assert coverage.missed({"core/vec3.h": {"reached": 0}, "core/conditional.h": {"reached": 0}}) == ["core/vec3.h"]


def test_a_machine_without_a_gpu_is_told_so(device: object) -> None:
    if str(device) == "cpu":
        assert gpu.available() in (None, "needs a GPU", "needs compute-sanitizer, which comes with CUDA's toolkit")
