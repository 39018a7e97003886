"""The renderer: the same memory every frame, only the worlds asked for, eager as replayed."""

import threading
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp
from warpcam.kernels import resolve, shadow, visibility

import warpcam as wc
from warpcam.outputs import OUTPUTS

every_device = pytest.mark.parametrize("device", [device.alias for device in wp.get_devices()])
on_cuda = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")

MODEL = """
<mujoco>
  <worldbody>
    <camera name="top" pos="0 0 5" fovy="60"/>
    <camera name="side" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/>
    <light pos="1 -1 4" dir="-1 1 -4"/>
    <body name="ball" pos="0 0 1"><freejoint/><geom size=".6" rgba="1 0 0 1"/></body>
    <geom type="box" size="3 3 .1" pos="0 0 -.5"/>
  </worldbody>
</mujoco>
"""
NUM_WORLDS = 4
BALL = 1  # its geom: those of the world come first


class Simulation:
    """A ball over a slab, in each world at another place."""

    def __init__(self, device: str, num_worlds: int = NUM_WORLDS):
        self.mjm = mujoco.MjModel.from_xml_string(MODEL)
        self.mjd = mujoco.MjData(self.mjm)
        mujoco.mj_forward(self.mjm, self.mjd)
        with wp.ScopedDevice(device):
            self.m = mjw.put_model(self.mjm)
            self.d = mjw.put_data(self.mjm, self.mjd, nworld=num_worlds)
        self.scene = wc.from_mujoco_warp(self.mjm, self.m, self.d)
        self.place(0.2 * np.arange(num_worlds))

    def place(self, x: np.ndarray) -> None:
        """Move the balls, each to its world's x."""
        positions = self.d.geom_xpos.numpy()
        positions[:, BALL, 0] = x
        self.d.geom_xpos.assign(positions)

    def renderer(self, outputs: tuple[str, ...] = ("depth", "segmentation"), **options: Any) -> wc.Renderer:
        return wc.Renderer(self.scene, [wc.Camera("top", width=16, height=12, outputs=outputs)], **options)


def host(images: Any, camera: str = "top") -> dict[str, np.ndarray]:
    return {name: tensor.cpu().numpy().copy() for name, tensor in images[camera].items()}


def test_outputs_agree_with_the_kernel_that_makes_them() -> None:
    derived = {
        name: (output.dtype, output.channels) for name, output in OUTPUTS.items() if output.trace is output.label
    }
    assert derived == dict(resolve.OUTPUTS)


@every_device
def test_every_output_has_its_dtype_and_shape(device: str) -> None:
    images = Simulation(device).renderer(tuple(OUTPUTS)).render()["top"]
    for name, output in OUTPUTS.items():
        assert images[name].shape == (NUM_WORLDS, 12, 16, output.channels)
        assert images[name].dtype == wp.dtype_to_torch(output.dtype)
        assert wp.device_from_torch(images[name].device) == wp.get_device(device)


@every_device
def test_outputs_do_not_depend_on_each_other(device: str) -> None:
    simulation = Simulation(device)
    together = host(simulation.renderer(tuple(OUTPUTS)).render())
    for name in OUTPUTS:
        alone = host(simulation.renderer((name,)).render())[name]
        np.testing.assert_array_equal(alone, together[name], err_msg=name)


@every_device
def test_images_do_not_depend_on_regions(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels that one block draws: fewer of them draw the same."""
    simulation = Simulation(device)
    camera = wc.Camera("side", width=21, height=13, outputs=("rgb", "depth", "segmentation"), shadows=True)
    expected = host(wc.Renderer(simulation.scene, [camera]).render(), "side")
    for module in (visibility, shadow, resolve):
        monkeypatch.setattr(module, "region_size", lambda *_, **__: (16, 8))
    for name, image in host(wc.Renderer(simulation.scene, [camera]).render(), "side").items():
        np.testing.assert_array_equal(image, expected[name], err_msg=name)


@every_device
def test_images_are_the_same_memory_in_every_frame(device: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer()
    first = renderer.render()
    tensor, pointer = first["top"]["depth"], first["top"]["depth"].data_ptr()
    before = host(first)["depth"]
    simulation.place(np.full(NUM_WORLDS, -1.0))
    again = renderer.render()
    assert again is first
    assert again["top"]["depth"] is tensor
    assert tensor.data_ptr() == pointer == renderer.array("top", "depth").ptr
    assert (host(again)["depth"] != before).any()


@every_device
def test_a_frame_equals_a_fresh_renderers(device: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer(("rgb", "depth", "segmentation"))
    for x in (0.0, 0.7, -0.7):
        simulation.place(np.linspace(0.0, x, NUM_WORLDS))
        kept, fresh = host(renderer.render()), host(simulation.renderer(("rgb", "depth", "segmentation")).render())
        for name in kept:
            np.testing.assert_array_equal(kept[name], fresh[name])


@every_device
def test_images_outlive_the_renderer(device: str) -> None:
    renderer = Simulation(device).renderer()
    tensor = renderer.render()["top"]["depth"]
    before = tensor.cpu().numpy().copy()
    del renderer
    torch.zeros(1 << 20, device=tensor.device)
    np.testing.assert_array_equal(tensor.cpu().numpy(), before)


SELECTIONS = {
    "list": lambda device: [1, 3],
    "numpy": lambda device: np.array([3, 1, 1], np.int16),
    "host mask": lambda device: [False, True, False, True],
    "int64": lambda device: torch.tensor([1, 3], device=device),
    "int32": lambda device: torch.tensor([3, 1], dtype=torch.int32, device=device),
    "bool": lambda device: torch.tensor([0, 1, 0, 1], dtype=torch.bool, device=device),
    "uint8": lambda device: torch.tensor([0, 1, 0, 255], dtype=torch.uint8, device=device),
    "warp ids": lambda device: wp.array([1, 3], dtype=wp.int32, device=device),
    "torch on the host": lambda device: torch.tensor([1, 3]),
}


@every_device
@pytest.mark.parametrize("how", SELECTIONS)
def test_only_the_worlds_asked_for_are_rendered(how: str, device: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer(("rgb", "depth", "segmentation"))
    before = host(renderer.render())
    simulation.place(np.full(NUM_WORLDS, -1.0))
    worlds = SELECTIONS[how](wp.device_to_torch(wp.get_device(device)))
    some = host(renderer.render(worlds=worlds))
    everything = host(renderer.render())
    for name, image in some.items():
        np.testing.assert_array_equal(image[[0, 2]], before[name][[0, 2]])
        np.testing.assert_array_equal(image[[1, 3]], everything[name][[1, 3]])
        assert (everything[name][0] != before[name][0]).any()


@every_device
def test_no_worlds_leave_every_image_alone(device: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer()
    before = host(renderer.render())
    simulation.place(np.full(NUM_WORLDS, -1.0))
    for none in ([], np.zeros(NUM_WORLDS, bool), torch.zeros(0, dtype=torch.int64)):
        after = host(renderer.render(worlds=none))
        np.testing.assert_array_equal(after["depth"], before["depth"])


@every_device
def test_worlds_are_those_of_single_scenes(device: str) -> None:
    images = host(Simulation(device).renderer(("rgb", "depth")).render())
    for world in range(NUM_WORLDS):
        single = Simulation(device, num_worlds=1)
        single.place(np.float32([0.2 * world]))
        alone = host(single.renderer(("rgb", "depth")).render())
        for name in images:
            np.testing.assert_array_equal(images[name][world], alone[name][0])


@every_device
def test_colors_are_live_for_each_world(device: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer(("albedo", "segmentation"))
    renderer.render()
    colors = np.tile(simulation.m.geom_rgba.numpy(), (NUM_WORLDS, 1, 1))
    colors[1, BALL], colors[2, BALL, 3] = (0, 1, 0, 1), 0.0
    simulation.m.geom_rgba = wp.array(colors, dtype=wp.vec4, device=device)
    images = host(renderer.render())
    assert images["albedo"][0, 6, 8].tolist() == [255, 0, 0]
    assert images["albedo"][1, 6, 8].tolist() == [0, 255, 0]
    assert (images["segmentation"][0] == BALL).any()
    assert not (images["segmentation"][2] == BALL).any()  # transparent there: the slab shows


@every_device
def test_a_pose_that_is_not_a_number_costs_its_own_world(device: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer()
    before = host(renderer.render())
    simulation.place(np.array([0.0, np.nan, 0.4, 0.6]))
    after = host(renderer.render())
    assert renderer.faulty.tolist() == [0, 1, 0, 0]
    assert np.isinf(after["depth"][1]).all()
    assert (after["segmentation"][1] == -1).all()
    np.testing.assert_array_equal(after["depth"][2:], before["depth"][2:])


@every_device
def test_forward_brings_poses_up_to_the_state(device: str) -> None:
    simulation = Simulation(device)
    renderer = simulation.renderer()
    before = host(renderer.render(forward=True))
    simulation.d.qpos.assign(np.tile([0, 0, 3.0, 1, 0, 0, 0], (NUM_WORLDS, 1)))
    np.testing.assert_array_equal(host(renderer.render())["depth"], before["depth"])
    nearest = host(renderer.render(forward=True))["depth"].min()
    assert nearest == pytest.approx(5.0 - 3.6, abs=0.02)


def test_classic_mujoco_is_read_anew_each_frame() -> None:
    mjm = mujoco.MjModel.from_xml_string(MODEL)
    mjds = [mujoco.MjData(mjm) for _ in range(2)]
    for mjd in mjds:
        mujoco.mj_forward(mjm, mjd)
    camera = wc.Camera("top", width=16, height=12, outputs=("depth", "albedo"))
    renderer = wc.Renderer(wc.from_mujoco(mjm, mjds, device="cpu"), [camera])
    before = host(renderer.render())
    mjds[1].qpos[2] = 3.0
    np.testing.assert_array_equal(host(renderer.render())["depth"], before["depth"])
    after = host(renderer.render(forward=True))
    np.testing.assert_array_equal(after["depth"][0], before["depth"][0])
    assert after["depth"][1].min() == pytest.approx(1.4, abs=0.02)
    mjm.geom_rgba[BALL] = (0, 0, 1, 1)
    assert host(renderer.render())["albedo"][1, 6, 8].tolist() == [0, 0, 255]


@every_device
def test_background_color_takes_the_place_of_the_skybox(device: str) -> None:
    simulation = Simulation(device)
    up = {"lens": wc.Pinhole(fovy=30.0), "position": (0, 0, 9), "rotation": (0, 1, 0, 0)}
    cameras = [
        wc.Camera("plain", width=4, height=4, **up),
        wc.Camera("blue", width=4, height=4, background=(0, 0.2, 1), **up),
    ]
    images = wc.Renderer(simulation.scene, cameras).render()
    assert images["plain"]["rgb"].unique().tolist() == [0]
    assert images["blue"]["rgb"][0, 0, 0].tolist() == [0, 51, 255]


def test_no_cameras_render_nothing() -> None:
    assert wc.Renderer(Simulation("cpu").scene, []).render() == {}


@every_device
def test_many_shapes_are_drawn_in_passes(device: str) -> None:
    balls = "".join(f'<geom size=".05" pos="{i % 20 * 0.2 - 1.9} {i // 20 * 0.2 - 1.4} 0"/>' for i in range(300))
    mjm = mujoco.MjModel.from_xml_string(MODEL.replace("</worldbody>", balls + "</worldbody>"))
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    camera = wc.Camera("top", width=160, height=120, outputs=("segmentation",))
    images = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device), [camera]).render()
    assert len(images["top"]["segmentation"].unique()) > 250


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
