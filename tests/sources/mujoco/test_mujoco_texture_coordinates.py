"""Meshes of which some corners have no texture coordinates."""

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc

XML = """<mujoco><asset><texture name="c" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 1 0" width="16" height="16"/>
<material name="m" texture="c"/><mesh name="it" vertex="1 1 1  1 -1 -1  -1 1 -1  -1 -1 1"
texcoord=".125 .125 .125 .125 .125 .125 .75 .75"/></asset>
<worldbody><geom type="mesh" mesh="it" material="m"/></worldbody></mujoco>"""


TURN = (0.5**0.5, 0.5**0.5, 0.0, 0.0)  # along +y, z up


def albedo(model: mujoco.MjModel, device: wp.Device) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = wc.Camera(
        "c", width=32, height=32, lens=wc.Pinhole(fovy=45.0), position=(0, -4, 0), rotation=TURN, outputs=("albedo",)
    )
    image = wc.Renderer(wc.from_mujoco(model, data, device=device), [camera]).render()["c"]["albedo"]
    return image[0].cpu().numpy()


@pytest.mark.parametrize("corner", [0, 1, 2])
def test_faces_without_coordinates_are_projected(corner: int, device: wp.Device) -> None:
    """The way of mujoco_warp's renderer, and of meshes without any coordinates."""
    model = mujoco.MjModel.from_xml_string(XML)
    model.mesh_facetexcoord[:, corner] = -1
    missing = albedo(model, device)
    model.mesh_texcoordadr[0] = -1
    np.testing.assert_array_equal(missing, albedo(model, device))


def test_one_face_without_coordinates(device: wp.Device) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    before = wc.from_mujoco(model, mujoco.MjData(model), device=device)._parts.meshes[0].uvs
    model.mesh_facetexcoord[2, 1] = -1
    after = wc.from_mujoco(model, mujoco.MjData(model), device=device)._parts.meshes[0].uvs
    assert (after != before).any(axis=(1, 2)).tolist() == [False, False, True, False]
    assert np.abs(after).max() <= 2.0


def test_other_numbers_are_refused(device: wp.Device) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    for wrong in (-2, 4):
        model.mesh_facetexcoord[1, 1] = wrong
        with pytest.raises(wc.WarpcamError, match=rf"mesh_facetexcoord must be indices from -1 to 3, got .*{wrong}"):
            wc.from_mujoco(model, mujoco.MjData(model), device=device)
