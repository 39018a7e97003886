"""Images as torch sees them: the same memory in every frame, in order with torch's own work."""

import contextlib
import gc
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import scenes
import torch
import warp as wp

import warpcam as wc
from warpcam.core import torch_interop
from warpcam.outputs import OUTPUTS

# Without "rgb": its light would only lengthen the compilation.
NAMES = ("depth", "segmentation", "bodies", "distance")
SIZE = 16
MODEL = '<body name="wall"><freejoint/><geom type="box" size="5000 5000 0.5"/></body>'


@pytest.fixture
def walls(device: wp.Device) -> Iterator[tuple[wp.array, wc.Scene]]:
    """A wall under the camera in each of four worlds; its position is to be written."""
    mjm = scenes.compile_xml(MODEL)
    m, d = scenes.put(mjm, 4)
    yield d.geom_xpos, wc.from_mujoco_warp(mjm, m, d)
    wp.synchronize_device(device)


def eye(names: tuple[str, ...] = NAMES) -> wc.Camera:
    return scenes.own_camera(width=SIZE, height=SIZE, outputs=names, position=(0, 0, 0))


def heights(positions: wp.array) -> torch.Tensor:
    """z of the wall, (world, 1): the live memory. Its face is half a metre above."""
    return wp.to_torch(positions)[..., 2]


def test_dtypes_and_shapes(device: wp.Device) -> None:
    mjm = scenes.compile_xml(MODEL + "<light/>")
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 3))
    images = wc.Renderer(scene, [scenes.own_camera(width=6, height=4, outputs=tuple(OUTPUTS))]).render()["eye"]
    assert list(images) == list(OUTPUTS)
    channels = {"rgb": 3, "rgba": 4, "hdr": 3, "normals": 3, "points": 3, "albedo": 3, "flow": 2}
    channels["barycentrics"] = 2
    dtypes = dict.fromkeys(("rgb", "rgba", "albedo", "flow_valid"), torch.uint8) | dict.fromkeys(
        ("segmentation", "bodies", "instances", "semantics", "faces"), torch.int32
    )
    for name, image in images.items():
        assert image.shape == (3, 4, 6, channels.get(name, 1)), name
        assert image.dtype == dtypes.get(name, torch.float32), name
        assert image.device == torch.device(wp.device_to_torch(device)), name
        assert image.is_contiguous(), name


def test_same_memory_every_frame(walls: tuple[wp.array, wc.Scene]) -> None:
    positions, scene = walls
    renderer = wc.Renderer(scene, [eye()])
    first = renderer.render()["eye"]
    pointers = {name: image.data_ptr() for name, image in first.items()}
    for frame in range(1, 1000):
        heights(positions).fill_(-1.5 - frame)
        again = renderer.render()["eye"]
        assert all(again[name] is first[name] for name in NAMES)
    assert {name: image.data_ptr() for name, image in renderer.images["eye"].items()} == pointers
    assert {name: renderer.array("eye", name).ptr for name in NAMES} == pointers
    assert (first["depth"] == 1000.0).all()


def test_tensors_outlive_the_renderer(walls: tuple[wp.array, wc.Scene], device: wp.Device) -> None:
    positions, scene = walls
    heights(positions).fill_(-3.5)
    kept = dict(wc.Renderer(scene, [eye()]).render()["eye"])
    del scene
    gc.collect()
    clutter = [wp.full(4 * SIZE * SIZE, -7.0, dtype=wp.float32, device=device) for _ in range(64)]
    assert (kept["depth"] == 3.0).all()
    assert (kept["segmentation"] == 0).all()
    del clutter


class Asked:
    """Stands in for a Warp allocator and counts what it is asked for."""

    def __init__(self, allocator: Any):
        self._allocator = allocator
        self.count = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._allocator, name)

    def allocate(self, size: int) -> int:
        self.count += 1
        return int(self._allocator.allocate(size))


def test_nothing_is_allocated(
    walls: tuple[wp.array, wc.Scene], device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    positions, scene = walls
    renderer = wc.Renderer(scene, [eye()])
    worlds = torch.tensor([True, False, True, True], device=wp.device_to_torch(device))

    def frame(number: int) -> None:
        heights(positions).fill_(-1.5 - number)
        renderer.render()
        renderer.render(worlds=worlds)

    for number in range(3):
        frame(number)
    wp.synchronize_device(device)
    if not device.is_cuda:
        pointers = [image.data_ptr() for image in renderer.images["eye"].values()]
        asked = Asked(device.default_allocator)
        monkeypatch.setattr(device, "default_allocator", asked)
        for number in range(3, 10):
            frame(number)
            renderer.render(worlds=[0, 2], forward=True)
        assert asked.count == 0
        assert pointers == [image.data_ptr() for image in renderer.images["eye"].values()]
        wp.zeros(1, device=device)
        assert asked.count == 1  # or nothing would be seen
        return
    torch.cuda.synchronize()
    used, warps = torch.cuda.memory_allocated(device.ordinal), wp.get_mempool_used_mem_current(device)
    for number in range(1000):
        frame(number)
    torch.cuda.synchronize()
    assert torch.cuda.memory_allocated(device.ordinal) == used
    assert wp.get_mempool_used_mem_current(device) == warps


def test_no_stale_frame(walls: tuple[wp.array, wc.Scene], device: wp.Device) -> None:
    """Torch writes the state, renders and reads, all on a stream of its own and with no wait in between."""
    positions, scene = walls
    renderer = wc.Renderer(scene, [eye(("depth",))])
    frames = 10_000 if device.is_cuda else 500
    torch_device = wp.device_to_torch(device)
    wanted = 1.0 + torch.arange(frames, dtype=torch.float32, device=torch_device) % 997  # no two near frames alike
    shown = torch.zeros((frames, 4), device=torch_device)
    wp.synchronize_device(device)

    def run() -> None:
        for frame in range(frames):
            heights(positions).copy_((-0.5 - wanted[frame]).expand(4, 1))
            depth = renderer.render()["eye"]["depth"]
            torch.mean(depth, dim=(1, 2, 3), out=shown[frame])

    if device.is_cuda:
        stream = torch.cuda.Stream(torch_device)
        stream.wait_stream(torch.cuda.current_stream(torch_device))
        with torch.cuda.stream(stream):
            run()
        stream.synchronize()
    else:
        run()
    assert torch.allclose(shown, wanted[:, None].expand(-1, 4), rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("whose", ["torch", "warp"])
def test_inside_a_capture(walls: tuple[wp.array, wc.Scene], device: wp.Device, whose: str) -> None:
    """The user's own graph: the state changes, the graph is replayed, the images follow."""
    if not device.is_cuda:
        pytest.skip("a CPU has no graphs")
    positions, scene = walls
    renderer = wc.Renderer(scene, [eye()])
    renderer.render()
    torch.cuda.synchronize()
    depth = renderer.images["eye"]["depth"]
    total = torch.zeros(4, device=depth.device)
    if whose == "torch":
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            renderer.render()
            torch.mean(depth, dim=(1, 2, 3), out=total)
    else:
        with wp.ScopedCapture(device) as capture:
            renderer.render()
    for frame in range(1, 100):
        heights(positions).fill_(-0.5 - frame)
        torch.cuda.synchronize()
        if whose == "torch":
            graph.replay()
        else:
            wp.capture_launch(capture.graph)
            wp.synchronize_device(device)
            total = depth.mean(dim=(1, 2, 3))
        torch.cuda.synchronize()
        assert total.tolist() == pytest.approx([frame] * 4, rel=1e-6)
    heights(positions).fill_(-2.5)
    assert renderer.render()["eye"]["depth"].mean().item() == pytest.approx(2.0, abs=1e-6)


def test_a_capture_of_a_host_scene_is_refused(device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("a CPU has no graphs")
    mjm = scenes.compile_xml(MODEL)
    renderer = wc.Renderer(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), [eye()])
    renderer.render()
    with pytest.raises(wc.WarpcamError, match="capture"), wp.ScopedCapture(device):
        renderer.render()


class _Stream:
    """Stream with Warp's methods that records who waits for whom."""

    is_capturing = False

    def __init__(self, name: Any, waits: list[tuple[Any, Any]], is_blocking: bool = True) -> None:
        self.cuda_stream, self.waits, self.is_blocking = name, waits, is_blocking

    def wait_stream(self, other: "_Stream") -> None:
        self.waits.append((self.cuda_stream, other.cuda_stream))


def test_streams_are_in_order_after_an_error() -> None:
    """Work that was queued before the error is waited for."""
    waits: list[tuple[Any, Any]] = []
    with pytest.raises(KeyError), torch_interop._between(_Stream("Warp's", waits), _Stream("torch's", waits)):
        raise KeyError
    assert waits == [("Warp's", "torch's"), ("torch's", "Warp's")]


@pytest.mark.parametrize("is_blocking", [True, False])
@pytest.mark.parametrize("theirs", [0, 7])
def test_streams_wait_where_cuda_does_not_see_to_it(
    theirs: int, is_blocking: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[Any] = []
    device: Any = SimpleNamespace(stream=_Stream(5, waits, is_blocking), ordinal=0, is_cuda=True, is_capturing=False)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda ordinal: _Stream(theirs, waits))
    monkeypatch.setattr(torch_interop, "_stream", lambda ordinal, handle: _Stream(handle, waits))
    monkeypatch.setattr(wp, "ScopedDevice", lambda _: contextlib.nullcontext())
    with torch_interop.in_order(device) as capturing:
        waits.append("work")
        assert not capturing
    assert waits == (["work"] if theirs == 0 and is_blocking else [(5, theirs), "work", (theirs, 5)])
