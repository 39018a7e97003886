"""Frames in CUDA graphs, in captures of a user's own, on streams, and in threads."""

import threading

import numpy as np
import pytest
import torch
import warp as wp
from sphere_scenes import BALL, NUM_WORLDS, Simulation, every_device, host, on_cuda

import warpcam as wc
from warpcam.kernels.runtime.streams import nonblocking_stream
from warpcam.outputs import OUTPUTS


@on_cuda
def test_replayed_frames_equal_eager_ones() -> None:
    simulation = Simulation("cuda:0")
    replayed, eager = simulation.renderer(tuple(OUTPUTS)), simulation.renderer(tuple(OUTPUTS), graph=False)
    for step in range(20):
        simulation.place(np.full(NUM_WORLDS, 0.1 * step))
        worlds = None if step % 3 else [step % NUM_WORLDS, 0]
        one, other = host(replayed.render(worlds=worlds)), host(eager.render(worlds=worlds))
        for name in one:
            np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize(
    ("device", "whose"),
    [("cpu", "warp"), *(pytest.param("cuda:0", whose, marks=on_cuda) for whose in ("warp", "torch"))],
)
def test_render_inside_a_users_capture(device: str, whose: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer(("rgb", "depth"))
    mask = torch.ones(NUM_WORLDS, dtype=torch.bool, device=device)
    if whose == "warp":
        with wp.ScopedCapture(device) as capture:
            renderer.render()
            renderer.render(worlds=mask)
        replay = lambda: wp.capture_launch(capture.graph)  # noqa: E731
    else:
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            renderer.render()
            renderer.render(worlds=mask)
        replay = graph.replay
    for x in (0.0, 0.8):
        simulation.place(np.full(NUM_WORLDS, x))
        wp.synchronize()
        replay()
        wp.synchronize()
        captured = host(renderer.images)
        fresh = host(simulation.renderer(("rgb", "depth"), graph=False).render())
        for name in captured:
            np.testing.assert_array_equal(captured[name], fresh[name])


@on_cuda
def test_frames_are_in_order_with_torch_streams() -> None:
    simulation = Simulation("cuda:0", num_worlds=64)
    renderer = simulation.renderer(("depth",))
    positions = wp.to_torch(simulation.d.geom_xpos)
    expected = {}
    for x in (0.0, 1.0):
        positions[:, BALL, 0] = x
        expected[x] = renderer.render()["top"]["depth"].clone()
    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())  # which has yet to make what is expected
    with torch.cuda.stream(stream):
        for step in range(200):
            positions[:, BALL, 0] = float(step % 2)
            assert torch.equal(renderer.render()["top"]["depth"], expected[float(step % 2)])


@on_cuda
@pytest.mark.parametrize("blocking", [True, False])
def test_frames_are_in_order_with_what_takes_long(blocking: bool) -> None:
    """On torch's default stream, for which only Warp's streams that are blocking wait by themselves."""
    simulation = Simulation("cuda:0", num_worlds=4096)
    renderer = simulation.renderer(("depth",))
    positions = wp.to_torch(simulation.d.geom_xpos)
    expected = {}
    for x in (0.0, 1.0):
        positions[:, BALL, 0] = x
        expected[x] = renderer.render()["top"]["depth"].clone()
        torch.cuda.synchronize()
    device = wp.get_device("cuda:0")
    stream = wp.Stream(device) if blocking else nonblocking_stream(device)
    assert stream.is_blocking is blocking
    depth = renderer.images["top"]["depth"]
    with wp.ScopedStream(stream):
        for step in range(20):
            torch.cuda._sleep(20_000_000)  # cycles, 10 ms
            positions[:, BALL, 0] = float(step % 2)
            renderer.render()
            found = depth.clone()
            depth.zero_()
            assert torch.equal(found, expected[float(step % 2)]), step


@on_cuda
def test_recording_does_not_disturb_other_threads() -> None:
    """Torch's copies to the host go by the default stream, which must not meet a capture."""
    stop, wrong = threading.Event(), []
    tensor = torch.zeros(1 << 16, device="cuda:0")

    def copy() -> None:
        try:
            while not stop.is_set():
                tensor.cpu()
        except RuntimeError as error:
            wrong.append(error)

    thread = threading.Thread(target=copy)
    thread.start()
    try:
        simulation = Simulation("cuda:0")
        for _ in range(30):
            renderer = simulation.renderer(("rgb", "depth"))
            renderer.render()
            renderer.render(worlds=[1])
    finally:
        stop.set()
        thread.join()
    assert not wrong


@wp.kernel
def count_up(counter: wp.array(dtype=wp.int32)):
    counter[0] = counter[0] + 1


@on_cuda
def test_what_other_threads_launch_is_not_recorded() -> None:
    stop, launches = threading.Event(), []
    counter = wp.zeros(1, dtype=wp.int32, device="cuda:0")
    wp.launch(count_up, 1, inputs=[counter], device="cuda:0")

    def launch() -> None:
        while not stop.is_set():
            wp.launch(count_up, 1, inputs=[counter], device="cuda:0")
            launches.append(1)

    thread = threading.Thread(target=launch)
    simulation, renderers = Simulation("cuda:0"), []
    thread.start()
    try:
        for _ in range(30):
            renderers.append(simulation.renderer(("rgb", "depth")))
            renderers[-1].render()
    finally:
        stop.set()
        thread.join()
    for renderer in renderers:
        renderer.render()
    assert counter.numpy()[0] == 1 + len(launches)


@every_device
def test_threads_do_not_disturb_each_other(device: str) -> None:
    simulations = [Simulation(device) for _ in range(4)]
    renderers = [simulation.renderer(("depth", "normals")) for simulation in simulations]
    expected = host(renderers[0].render())
    wrong: list[str] = []

    def work(renderer: wc.Renderer) -> None:
        for _ in range(20):
            images = host(renderer.render())
            wrong.extend(name for name in images if not np.array_equal(images[name], expected[name]))

    threads = [threading.Thread(target=work, args=(renderer,)) for renderer in renderers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
