"""The renderer: the same memory every frame, only the worlds asked for, eager as replayed."""

import mujoco
import numpy as np
import pytest
import torch
import warp as wp
from sphere_scenes import BALL, MODEL, NUM_WORLDS, Simulation, every_device, host

import warpcam as wc
from warpcam.kernels.plan import shading, shadow, trace
from warpcam.kernels.plan.passes import PASSES
from warpcam.outputs import OUTPUTS


def test_outputs_agree_with_the_passes_that_make_them() -> None:
    derived = [name for name, output in OUTPUTS.items() if output.trace is None]
    assert sorted(derived) == sorted(name for one in PASSES.values() for name in one.writes)


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
    for module in (trace, shadow, shading):
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
    camera = wc.Camera("top", width=160, height=120, outputs=("segmentation", "semantics"))
    scene = wc.from_mujoco(mjm, mjd, device=device)
    numbers = np.arange(mjm.ngeom)[None] * 3 + 1
    scene._labels["semantics"].assign(numbers)
    images = host(wc.Renderer(scene, [camera]).render())
    seen = images["segmentation"]
    assert len(np.unique(seen)) > 250
    np.testing.assert_array_equal(images["semantics"], np.where(seen < 0, 0, numbers[0, seen]))
