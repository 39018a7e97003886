"""Warp's own quaternions have w last, ours first: they are refused, not read the wrong way round."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

WORLDS = 2
STAGE = """#usda 1.0
(metersPerUnit = 1.0
 upAxis = "Z")
def Cube "Box" {
}
"""


@pytest.fixture
def scene(tmp_path: Path) -> wc.DrivenScene:
    pytest.importorskip("pxr")
    (tmp_path / "stage.usda").write_text(STAGE)
    return wc.from_usd(tmp_path / "stage.usda", WORLDS, device="cpu")


def test_a_cameras_rotation(scene: wc.DrivenScene) -> None:
    turns = wp.array(np.tile((0.0, 0.0, 0.0, 1.0), (WORLDS, 1)), dtype=wp.quat, device="cpu")
    camera = wc.Camera("mine", width=4, height=4, lens=wc.Pinhole(fovy=60.0), rotation=turns)
    with pytest.raises(wc.WarpcamError, match=r"rotation must be numbers with quaternions w x y z, got .* quatf"):
        wc.Renderer(scene, [camera])


@pytest.mark.parametrize("one", [wp.quat(0.0, 0.0, 0.0, 1.0), wp.quatd(0.0, 0.0, 0.0, 1.0)])
@pytest.mark.parametrize("in_each_world", [False, True])
def test_a_cameras_rotation_that_is_no_array(one: Any, in_each_world: bool, scene: wc.DrivenScene) -> None:
    turn = [one] * WORLDS if in_each_world else one
    camera = wc.Camera("mine", width=4, height=4, lens=wc.Pinhole(fovy=60.0), rotation=turn)
    with pytest.raises(
        wc.WarpcamError, match=r"rotation must be numbers with quaternions w x y z, got Warp's own wp.quat"
    ):
        wc.Renderer(scene, [camera])


def test_poses_of_things(scene: wc.DrivenScene) -> None:
    poses = wp.zeros((WORLDS, 1), dtype=wp.transform, device="cpu")
    with pytest.raises(wc.WarpcamError, match=r"poses must be numbers with quaternions w x y z, got .* transformf"):
        scene.set_poses(["/Box"], poses)
    with pytest.raises(
        wc.WarpcamError, match=r"poses must be numbers with quaternions w x y z, got Warp's own wp.transform"
    ):
        scene.set_poses(["/Box"], [[wp.transform_identity()]] * WORLDS)
