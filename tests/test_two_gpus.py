"""Two GPUs: a renderer on each, and nothing of one on the other's card."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

sys.path.append(str(Path(__file__).resolve().parents[1] / "examples"))
import every_gpu

pytestmark = pytest.mark.skipif(wp.get_cuda_device_count() < 2, reason="needs two GPUs")

# What a process that is told to use one of two visible cards does: it prints the cards that know of it.
CHILD = """
import json, sys
sys.path.append(sys.argv[2])
import every_gpu, torch
renderer = every_gpu.renderer_on(sys.argv[1], 64)
for _ in range(3):
    images = renderer.render()["front"]
with torch.cuda.stream(torch.cuda.Stream(device=images["rgb"].device)):
    renderer.render()
every_gpu.wait([renderer])
print("DONE " + json.dumps([every_gpu.cards_in_use(), int(images["rgb"].sum())]))
"""


def in_a_process(device: str) -> tuple[list[int], int]:
    """Render there; returns the cards on which the process has a context, and the sum of its image."""
    folder = str(Path(every_gpu.__file__).parent)
    done = subprocess.run([sys.executable, "-c", CHILD, device, folder], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    cards, total = json.loads(done.stdout.split("DONE ")[1])
    return cards, total


def test_a_process_leaves_the_other_card_alone() -> None:
    first, second = in_a_process("cuda:0"), in_a_process("cuda:1")
    assert first[0] == [0]
    assert second[0] == [1]
    assert first[1] == second[1] > 0


def test_each_renderer_takes_its_memory_from_its_own_card() -> None:
    devices = [wp.get_device("cuda:0"), wp.get_device("cuda:1")]
    renderers = [every_gpu.renderer_on(device.alias, 64) for device in devices]
    expected = [renderer.render()["front"]["depth"].clone() for renderer in renderers]
    assert [tensor.device.index for tensor in expected] == [0, 1]
    for owner, other in ((0, 1), (1, 0)):
        before = wp.get_mempool_used_mem_current(devices[other])
        extra = every_gpu.renderer_on(devices[owner].alias, 64)
        extra.render()
        assert wp.get_mempool_used_mem_current(devices[other]) == before
        del extra
    for _ in range(20):
        for renderer in renderers:
            renderer.render()
    every_gpu.wait(renderers)
    for renderer, image in zip(renderers, expected, strict=True):
        assert torch.equal(renderer.images["front"]["depth"], image)
    np.testing.assert_array_equal(expected[0].cpu().numpy(), expected[1].cpu().numpy())


def test_the_current_devices_stay_as_they_were() -> None:
    with wp.ScopedDevice("cuda:0"), torch.cuda.device(0):
        every_gpu.renderer_on("cuda:1", 4).render()
        assert wp.get_device().alias == "cuda:0"
        assert torch.cuda.current_device() == 0
