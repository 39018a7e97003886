"""Work that only colours and normals of moving meshes need is left out of frames without them."""

import numpy as np
import pytest
import warp as wp

import warpcam as wc

mujoco = pytest.importorskip("mujoco")
mjw = pytest.importorskip("mujoco_warp")

CLOTH = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <worldbody>
    <light directional="true" pos="0 0 5" dir="0 0 -1" diffuse="1 1 1" ambient="0 0 0" specular="0 0 0"/>
    <camera name="top" pos="0 0 3"/>
    <flexcomp name="cloth" type="grid" count="5 5 1" spacing=".2 .2 .2" dim="2" radius=".01" mass="1" rgba="1 1 1 1"/>
  </worldbody>
</mujoco>
"""


def test_a_cloth_is_shaded_as_it_lies_after_frames_of_depth_alone(device):
    model = mujoco.MjModel.from_xml_string(CLOTH)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(model), mjw.put_data(model, data, nworld=2)
        scene = wc.from_mujoco_warp(model, m, d)
        plain, lit = (
            wc.Renderer(scene, [wc.Camera("top", width=32, height=32, outputs=outputs)])
            for outputs in (("depth", "segmentation"), ("depth", "rgb"))
        )
        assert not any(stage.for_shading_only for stage in plain._recording().frames[True].stages)
        plain.render()
        flat = lit.render()["top"]["rgb"].float().cpu().numpy()[:, 16, 16].mean()
        vertices = d.flexvert_xpos.numpy()
        vertices[..., 2] = 1.7 * vertices[..., 0]  # 60 degrees
        d.flexvert_xpos.assign(vertices)
        depth = plain.render()["top"]["depth"].cpu().numpy().copy()
        images = {name: image.cpu().numpy() for name, image in lit.render()["top"].items()}
    assert np.array_equal(depth, images["depth"])
    steep = images["rgb"][:, 16, 16].mean()
    assert flat > 100.0
    assert steep == pytest.approx(0.507 * flat, rel=0.1)
