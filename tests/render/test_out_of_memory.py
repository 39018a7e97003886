"""No memory at any allocation: an error of our own, and what was there before goes on as it was."""

from collections.abc import Callable
from typing import Any

import mujoco
import pytest
import torch
import warp as wp

import warpcam as wc
from warpcam import sensors
from warpcam.core.memory_errors import memory_told

XML = """
<mujoco>
  <asset>
    <texture name="checks" type="2d" builtin="checker" width="8" height="8" rgb1="1 0 0" rgb2="0 0 1"/>
    <material name="checks" texture="checks"/>
    <mesh name="wedge" scale=".3 .3 .3" vertex="0 0 0  1 0 0  0 1 0  0 0 1  1 1 0"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 .1" material="checks"/>
    <body name="tool" pos="0 0 .5"><freejoint/><geom type="mesh" mesh="wedge"/></body>
    <camera name="eye" pos="0 -2 1.5" xyaxes="1 0 0 0 .6 .8"/>
  </worldbody>
</mujoco>
"""
OUTPUTS = ("rgb", "depth", "normals", "flow")


class Meagre:
    """Stands in for a Warp allocator, and has no memory for one allocation, the one after so many others."""

    def __init__(self, allocator: Any):
        self._allocator, self.count, self.last = allocator, 0, -1

    def __getattr__(self, name: str) -> Any:
        return getattr(self._allocator, name)

    def allocate(self, size: int) -> int:
        self.count += 1
        if self.count - 1 == self.last:
            raise RuntimeError(f"Failed to allocate {size} bytes on device 'cpu'")  # as Warp's own do
        return int(self._allocator.allocate(size))


@pytest.fixture
def meagre(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> Meagre:
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    allocator = Meagre(getattr(device, slot))
    monkeypatch.setattr(device, slot, allocator)
    return allocator


def scene_of(device: wp.Device) -> wc.Scene:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return wc.from_mujoco(model, data, device=device)


def renderer_of(scene: wc.Scene) -> wc.Renderer:
    return wc.Renderer(scene, [wc.Camera("eye", width=32, height=24, outputs=OUTPUTS, shadows=True)])


def rendered(device: wp.Device) -> torch.Tensor:
    return renderer_of(scene_of(device)).render()["eye"]["rgb"]


def measured(device: wp.Device) -> torch.Tensor:
    rig = sensors.Rig(renderer_of(scene_of(device)), {"eye": sensors.realsense_d435()}, seed=0)
    return rig.read()["eye"]["depth"]


def scanned(device: wp.Device) -> torch.Tensor:
    pattern = sensors.patterns.velodyne_vlp16()
    return sensors.Lidar(scene_of(device), pattern, position=(0.0, 0.0, 1.0), seed=0).read()["ranges"]


def labelled(device: wp.Device) -> torch.Tensor:
    camera = wc.Camera("eye", width=32, height=24, outputs=("bodies",))
    renderer = wc.Renderer(scene_of(device), [camera])
    renderer.render()
    return wc.labels(renderer).read()["eye"].visible_boxes


@pytest.mark.parametrize("make", [rendered, measured, scanned, labelled])
def test_an_allocation_that_fails(make: Callable[[wp.Device], torch.Tensor], device: wp.Device, meagre: Meagre) -> None:
    before = renderer_of(scene_of(device))
    image = before.render()["eye"]["rgb"].clone()
    right = make(device).clone()  # and all kernels are there
    start = meagre.count
    make(device)
    allocations = meagre.count - start
    assert allocations > 10
    for number in range(allocations):
        meagre.last = meagre.count + number
        with pytest.raises(
            wc.OutOfMemoryError, match=r"^\w+: out of memory on .* more bytes were asked for; ask for fewer"
        ):
            make(device)
        meagre.last = -1
        assert torch.equal(before.render()["eye"]["rgb"], image)
    assert torch.equal(make(device), right)


def test_torch_and_python_without_memory_are_told_alike() -> None:
    for error in (torch.OutOfMemoryError("CUDA out of memory"), MemoryError("Unable to allocate 4 GiB")):
        with pytest.raises(wc.OutOfMemoryError, match=r"^Rig: out of memory .*(CUDA|4 GiB)"), memory_told("Rig"):
            raise error
    with pytest.raises(RuntimeError, match="something else"), memory_told("Rig"):
        raise RuntimeError("something else")
