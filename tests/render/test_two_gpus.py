"""Two GPUs: a renderer on each, and nothing of one on the other's card."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc
from warpcam.core import device as device_rule

sys.path.append(str(Path(__file__).resolve().parents[2] / "examples"))
import every_gpu

pytestmark = pytest.mark.skipif(wp.get_cuda_device_count() < 2, reason="needs two GPUs")

# What a process that is told to use one of two visible cards does: it prints the cards that know of it.
CHILD = """
import json, sys
sys.path.append(sys.argv[2])
import every_gpu, torch
from warpcam.device import contexts
renderer = every_gpu.renderer_on(sys.argv[1], 64)
for _ in range(3):
    images = renderer.render()["front"]
with torch.cuda.stream(torch.cuda.Stream(device=images["rgb"].device)):
    renderer.render()
every_gpu.wait([renderer])
print("DONE " + json.dumps([contexts(), int(images["rgb"].sum())]))
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


# Renders in one way on the device it is told, says so, and keeps everything until it is told to go.
HOLDING = """
import sys
sys.path.append(sys.argv[3])
import every_gpu, mujoco, warp as wp, warpcam as wc
from warpcam.device import contexts
device, way = sys.argv[1], sys.argv[2]
host = mujoco.MjModel.from_xml_string(every_gpu.SCENE)
state = mujoco.MjData(host)
mujoco.mj_forward(host, state)
if way == "mujoco_warp":
    renderer = every_gpu.renderer_on(device, 512)
elif way == "mujoco":
    scene = wc.from_mujoco(host, [state] * 64, device=device)
    renderer = wc.Renderer(scene, [wc.Camera("front", width=256, height=256, outputs=("rgb", "depth"))])
else:
    import newton
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.5)
    model = builder.finalize(device=device)
    camera = wc.Camera("eye", width=2048, height=2048, outputs=("depth",), lens=wc.Pinhole(fovy=45.0),
                       position=(0.0, 0.0, 3.0))
    renderer = wc.Renderer(wc.from_newton(model, model.state()), [camera])
for _ in range(3):
    renderer.render(worlds=[0])
    renderer.render()
every_gpu.wait([renderer])
print("READY", *contexts(), flush=True)
sys.stdin.read()
"""


def memory_used() -> list[int]:
    """Memory in use on each card [MiB], whoever uses it, in the order of their UUIDs as Warp has them."""
    command = [shutil.which("nvidia-smi"), "--query-gpu=uuid,memory.used", "--format=csv,noheader,nounits"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.splitlines()
    used = {uuid: int(count) for uuid, count in (line.split(", ") for line in lines)}
    return [used[device.uuid] for device in wp.get_cuda_devices()[:2]]


@pytest.mark.skipif(shutil.which("nvidia-smi") is None, reason="needs nvidia-smi")
@pytest.mark.parametrize("way", ["mujoco_warp", "mujoco", "newton"])
@pytest.mark.parametrize("card", [0, 1])
def test_the_other_card_has_no_byte_of_it(card: int, way: str) -> None:
    """Bytes are counted by the driver while the process lives."""
    if way == "newton":
        pytest.importorskip("newton")
    folder = str(Path(every_gpu.__file__).parent)
    for device in wp.get_cuda_devices()[:2]:
        torch.zeros(1, device=wp.device_to_torch(device))  # this process's own contexts are counted before
    before = memory_used()
    command = [sys.executable, "-c", HOLDING, f"cuda:{card}", way, folder]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        said = next((line for line in child.stdout if line.startswith("READY")), "ended")
        during = memory_used()
        child.communicate("")
    assert said.split() == ["READY", str(card)]
    assert child.returncode == 0
    assert during[card] > before[card] + 50
    assert during[1 - card] <= before[1 - card]


# Prints what the rule makes of the environment: UUIDs behind the ordinals, and what it says where there is no GPU.
RULE = """
import json, sys
import warp as wp, warpcam as wc
from warpcam import device
uuids = [device.resolve(ordinal).uuid for ordinal in range(wp.get_cuda_device_count())]
try:
    said = device.resolve(9).alias
except wc.WarpcamError as error:
    said = str(error)
print("DONE " + json.dumps([uuids, said]))
"""


@pytest.mark.skipif("CUDA_VISIBLE_DEVICES" in os.environ, reason="CUDA_VISIBLE_DEVICES numbers the cards anew already")
@pytest.mark.parametrize("setting", ["", "0", "1", "1,0", " 1", "1 ,0 ", "UUID 1", "1,99", "0,0", "-1"])
def test_ordinals_are_those_that_are_visible(setting: str) -> None:
    """Descriptions of ``CUDA_VISIBLE_DEVICES`` are what CUDA itself does with it, whatever that is."""
    cards = [device.uuid for device in wp.get_cuda_devices()]
    setting = cards[1] if setting == "UUID 1" else setting
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": setting, "MUJOCO_EGL_DEVICE_ID": "0"}
    done = subprocess.run([sys.executable, "-c", RULE], env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    uuids, said = json.loads(done.stdout.split("DONE ")[1])
    print(repr(setting), [cards.index(uuid) for uuid in uuids])
    assert f"CUDA_VISIBLE_DEVICES={setting!r}" in said
    entries = [entry.strip() for entry in setting.split(",")] if setting else []
    if len(entries) == len(uuids):
        for ordinal, (entry, uuid) in enumerate(zip(entries, uuids, strict=True)):
            assert uuid == (entry if entry in cards else cards[int(entry)])
            assert f"cuda:{ordinal} is {'' if entry in cards else 'GPU '}{entry}" in said
    else:
        assert f"it names {len(entries)}, and CUDA shows {len(uuids)}" in said
    if setting in ("0", "1", "1,0", cards[1]):
        assert len(uuids) == len(entries)


def test_what_lies_on_two_cards_is_refused_by_both_names() -> None:
    renderer = every_gpu.renderer_on("cuda:0", 4)
    mask = torch.ones(4, dtype=torch.bool, device="cuda:1")
    message = "device: render: worlds is on cuda:1, but the scene is on cuda:0; both must be on one"
    with pytest.raises(wc.WarpcamError, match=message):
        renderer.render(worlds=mask)
    with pytest.raises(wc.WarpcamError, match="device: 'cuda:99' came, this process sees cpu, cuda:0, cuda:1"):
        device_rule.resolve("cuda:99")
