"""States whose kinematics never ran: such worlds are faulty, and the first frame says what to do."""

import logging

import mujoco
import mujoco_warp as mjw
import pytest
import warp as wp

import warpcam as wc

XML = """<mujoco><worldbody><geom type="plane" size="2 2 .1"/><camera name="c" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>
<body pos="0 0 .5"><freejoint/><geom type="box" size=".2 .2 .2"/></body></worldbody></mujoco>"""
TOLD = "worlds made no image or miss a shape, see Renderer.faulty"


def renderer_of(scene: wc.Scene) -> wc.Renderer:
    return wc.Renderer(scene, [wc.Camera("c", width=16, height=16, outputs=("depth",))])


def test_a_state_that_was_never_forwarded(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    with wp.ScopedDevice(device), caplog.at_level(logging.WARNING, "warpcam"):
        renderer = renderer_of(wc.from_mujoco_warp(model, mjw.put_model(model), mjw.make_data(model, nworld=2)))
        for _ in range(2):
            depth = renderer.render()["c"]["depth"]
        assert renderer.faulty.tolist() == [1, 1]
        assert not depth.isfinite().any()
        assert caplog.text.count(TOLD) == 1 and "render: 2 of 2 worlds" in caplog.text and "mj_forward" in caplog.text
        assert renderer.render(forward=True)["c"]["depth"].isfinite().any()
        assert renderer.faulty.tolist() == [0, 0]


def test_classic_mujoco(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    renderer = renderer_of(wc.from_mujoco(model, [data, data], device=device))
    renderer.render()
    assert renderer.faulty.tolist() == [1, 1] and TOLD in caplog.text
    mujoco.mj_forward(model, data)
    renderer.render()
    assert renderer.faulty.tolist() == [0, 0]


def test_a_rotation_of_zeros_in_one_world(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with wp.ScopedDevice(device):
        worlds = mjw.put_data(model, data, nworld=3)
        renderer = renderer_of(wc.from_mujoco_warp(model, mjw.put_model(model), worlds))
        renderer.render()
        assert renderer.faulty.tolist() == [0, 0, 0] and TOLD not in caplog.text
        wp.to_torch(worlds.cam_xmat)[1] = 0.0
        depth = renderer.render()["c"]["depth"]
    assert renderer.faulty.tolist() == [0, 1, 0]
    assert depth.isfinite().flatten(1).any(dim=1).tolist() == [True, False, True]
