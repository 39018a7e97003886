"""A test of your own cameras that any CI machine can run, without a GPU: ``pytest examples/ci_on_cpu.py``.

It asks what a mistake in a scene or a camera would break: is the thing in view, where, and how far away?
"""

import mujoco
import numpy as np
import pytest

import warpcam as wc

SCENE = """
<mujoco>
  <worldbody>
    <camera name="top" pos="0 0 2" fovy="60"/>
    <geom name="table" type="box" size="0.8 0.8 0.1" pos="0 0 -0.1"/>
    <body name="cube" pos="0.3 0.2 0.05">
      <freejoint/>
      <geom name="cube" type="box" size="0.05 0.05 0.05"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def seen() -> dict[str, np.ndarray]:
    """Render what the camera "top" sees of the scene: one image an output."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = wc.Camera("top", width=128, height=128, outputs=("rgb", "depth", "segmentation"))
    scene = wc.from_mujoco(model, data, device="cpu")
    images = wc.Renderer(scene, [camera]).render()["top"]
    return {output: image[0].numpy() for output, image in images.items()} | {"cube": model.geom("cube").id}


def test_cube_is_where_it_was_put(seen: dict[str, np.ndarray]) -> None:
    """The cube is right of the middle and above it, as +x and +y are."""
    rows, columns = np.nonzero(seen["segmentation"][..., 0] == seen["cube"])
    assert len(rows) > 10, "the cube is not in view"
    assert columns.mean() > 64
    assert rows.mean() < 64


def test_depth_is_in_metres(seen: dict[str, np.ndarray]) -> None:
    """Depth is planar: the whole table is 2.0 m below the camera, the cube's top 1.9 m."""
    depth, shapes = seen["depth"][..., 0], seen["segmentation"][..., 0]
    assert depth[shapes == seen["cube"]].min() == pytest.approx(1.9, abs=1e-5)
    np.testing.assert_allclose(depth[shapes == 0], 2.0, atol=1e-5)
    assert np.isinf(depth[shapes == -1]).all()


def test_image_is_not_blank(seen: dict[str, np.ndarray]) -> None:
    """A black image is how most broken set-ups look."""
    assert seen["rgb"].std() > 5.0
