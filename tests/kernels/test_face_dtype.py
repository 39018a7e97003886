"""Faces are kept in 16 bits where all of them, and what stands for a height field's sides and base, have room."""

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

ASSETS = """
  <texture name="checks" type="2d" builtin="checker" width="64" height="64" rgb1=".1 .2 .3" rgb2=".9 .8 .3"/>
  <material name="checks" texture="checks" texrepeat="3 2"/>
  <material name="mirror" reflectance=".5"/>
  <hfield name="hills" nrow="4" ncol="5" size="1 .8 .4 .2" elevation="0 3 1 2 0  2 0 1 3 1  0 1 2 0 3  1 2 0 1 0"/>
"""
WORLD = """
  <light pos="1 1 4" dir="-1 -1 -4"/>
  <geom type="hfield" hfield="hills" material="checks"/>
  <geom type="plane" size="3 3 1" pos="0 0 -.4" material="mirror"/>
  <geom type="mesh" mesh="mesh" pos="1 .6 .4" material="checks"/>
"""
EYES = {"above": (0.3, -1.5, 1.5), "beside": (2.0, -1.0, 0.05), "below": (0.4, -1.2, -0.3)}


@pytest.mark.parametrize("antialiasing", [1, 4])
@pytest.mark.parametrize("eye", EYES)
def test_images_do_not_depend_on_how_faces_are_kept(
    eye: str, antialiasing: int, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    mjm = scenes.compile_xml(WORLD, assets=scenes.ASSETS + ASSETS)
    camera = scenes.own_camera(
        width=43,
        height=30,
        outputs=("rgb", "normals", "albedo", "segmentation"),
        position=EYES[eye],
        rotation=scenes.looking(EYES[eye], (0.0, 0.0, 0.0)),
        shadows=True,
        antialiasing=antialiasing,
    )
    seen = []
    for faces in (None, 2**16):
        if faces is not None:
            monkeypatch.setattr("warpcam.scene.scene.num_faces", lambda _, faces=faces: faces)
        scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 2), reflections=True)
        assert (scene.tables().num_faces < 2**16) == (faces is None)
        seen.append(scenes.look(scene, camera))
    assert (seen[0]["segmentation"] == 0).mean() > 0.05
    for name, image in seen[0].items():
        np.testing.assert_array_equal(image, seen[1][name], err_msg=name)
