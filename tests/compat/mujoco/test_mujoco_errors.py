"""Errors of bad input: ``mujoco.Renderer`` and ours raise the same kind."""

import mujoco
import numpy as np
import pytest

from warpcam.compat.mujoco import Renderer
from warpcam.core.errors import WarpcamError

XML = '<mujoco><worldbody><geom size=".1"/><camera name="eye" pos="0 0 1"/></worldbody></mujoco>'


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


@pytest.mark.parametrize("size", [(8.0, 8), (8, 8.5), ("8", 8), (None, 8), (np.float32(8), 8)], ids=repr)
def test_sizes_are_whole_numbers(model: mujoco.MjModel, size: tuple[object, object]) -> None:
    with pytest.raises(TypeError, match="must be a whole number, got"):
        Renderer(model, *size, device="cpu")
    assert Renderer(model, np.int64(8), 9, device="cpu").height == 8


def test_an_option_that_is_refused_leaves_the_one_before(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Renderer(model, 8, 8, device="cpu") as renderer:
        renderer.enable_depth_rendering()
        renderer.update_scene(data, "eye")
        before = renderer.render()
        for wrong in (0, 5, {"geomgroup": 1}, mujoco.MjvOption):
            with pytest.raises(TypeError, match=r"scene_option must be a mujoco\.MjvOption or None, got"):
                renderer.update_scene(data, "eye", wrong)
        labelled = mujoco.MjvOption()
        labelled.label = int(mujoco.mjtLabel.mjLABEL_BODY)
        with pytest.raises(WarpcamError, match=r"scene_option\.label"):
            renderer.update_scene(data, "eye", labelled)
        assert (renderer.render() == before).all()
