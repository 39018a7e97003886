"""A renderer on every GPU, each at its own full speed: all in one process, or each in a process of its own.

python examples/every_gpu.py
torchrun --nproc-per-node 2 examples/every_gpu.py

Prints the worlds that each card renders a second, alone and while all others render too, and the cards on which this
process has a context: with torchrun, its own and no other.
"""

import os
import time

import mujoco
import mujoco_warp as mjw
import torch
import warp as wp

import warpcam as wc
from warpcam.core.device import contexts

FRAMES = 200

SCENE = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -3 1.5" xyaxes="1 0 0 0 0.4 0.9"/>
    <geom type="plane" size="0 0 1"/>
    <replicate count="12" euler="0 0 30">
      <geom type="capsule" fromto="0.5 0 0.1 1 0 0.6" size="0.1" rgba="0.9 0.5 0.1 1"/>
    </replicate>
  </worldbody>
</mujoco>
"""


def renderer_on(device: str, worlds: int) -> wc.Renderer:
    """A renderer whose simulation, images and kernels are all on one device."""
    host = mujoco.MjModel.from_xml_string(SCENE)
    state = mujoco.MjData(host)
    mujoco.mj_forward(host, state)
    with wp.ScopedDevice(device):
        model, data = mjw.put_model(host), mjw.put_data(host, state, nworld=worlds)
    scene = wc.from_mujoco_warp(host, model, data)
    return wc.Renderer(scene, [wc.Camera("front", width=64, height=64, outputs=("rgb", "depth"))])


def rate(renderers: list[wc.Renderer], worlds: int, frames: int) -> float:
    """Worlds a second that each of them renders while all do."""
    for renderer in renderers:
        renderer.render()
    wait(renderers)
    start = time.perf_counter()
    for _ in range(frames):
        for renderer in renderers:
            renderer.render()  # returns at once: the cards work at the same time
    wait(renderers)
    return worlds * frames / (time.perf_counter() - start)


def wait(renderers: list[wc.Renderer]) -> None:
    for renderer in renderers:
        if renderer.faulty.is_cuda:
            torch.cuda.synchronize(renderer.faulty.device)


def main() -> None:
    rank = os.environ.get("LOCAL_RANK")
    devices = [device.alias for device in wp.get_cuda_devices()]
    if rank is not None and devices:
        devices = [f"cuda:{rank}"]
    worlds, frames = (8192, FRAMES) if devices else (16, 4)
    renderers = {device: renderer_on(device, worlds) for device in devices or ["cpu"]}
    alone = {device: rate([renderer], worlds, frames) for device, renderer in renderers.items()}
    together = rate(list(renderers.values()), worlds, frames)
    for device, renderer in renderers.items():
        print(
            f"{device}: {alone[device]:,.0f} worlds/s alone, {together:,.0f} with all, "
            f"{renderer.memory.total / 1e6:,.0f} MB"
        )
    print(f"contexts on GPUs {contexts()}")


if __name__ == "__main__":
    main()
