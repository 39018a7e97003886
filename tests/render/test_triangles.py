"""``faces`` and ``barycentrics``: the triangle of a mesh that a pixel sees, and where on it."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc

# An octahedron that is turned and scaled beside shapes that have no triangles.
SCENE = """
<mujoco>
  <asset>
    <mesh name="octahedron" vertex="1 0 0  -1 0 0  0 1 0  0 -1 0  0 0 1  0 0 -1" scale="0.9 1 0.7"/>
    <hfield name="hills" nrow="3" ncol="3" elevation="0 1 0  1 0 1  0 1 0" size="1 1 0.4 0.1"/>
  </asset>
  <worldbody>
    <light pos="0 0 5"/>
    <geom type="plane" size="5 5 .1" pos="0 0 -1"/>
    <geom name="mesh" type="mesh" mesh="octahedron" euler="20 30 40"/>
    <geom type="sphere" size=".3" pos="-1.3 0.4 0"/>
    <geom type="hfield" hfield="hills" pos="-2 -2 0"/>
    <camera name="front" pos="2 2 2" xyaxes="-1 1 0 -1 -1 2"/>
    <camera name="below" pos="1 -2 -.5" xyaxes="1 .4 0 0 .2 1"/>
    <camera name="parallel" pos="2 2 2" xyaxes="-1 1 0 -1 -1 2" projection="orthographic" fovy="4"/>
  </worldbody>
</mujoco>
"""
OUTPUTS = ("faces", "barycentrics", "points", "segmentation")


def seen_by(camera: wc.Camera, device: wp.Device) -> tuple[Any, dict[str, np.ndarray], np.ndarray]:
    """Model, images of the first world, and corners of the mesh's triangles in the world frame."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = wc.Renderer(wc.from_mujoco(model, [data], device=device), [camera])
    images = {name: image[0].cpu().numpy() for name, image in renderer.render()[camera.name].items()}
    geom = model.geom("mesh").id
    rotation, position = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    return model, images, (model.mesh_vert @ rotation.T + position)[model.mesh_face]


@pytest.mark.parametrize(
    ("name", "lens"), [("front", None), ("below", None), ("parallel", None), ("front", wc.Fisheye(fovy=100.0))]
)
def test_corners_weighted_are_the_point_that_is_hit(name: str, lens: wc.Lens | None, device: wp.Device) -> None:
    camera = wc.Camera(name, width=64, height=48, outputs=OUTPUTS, lens=lens)
    model, images, corners = seen_by(camera, device)
    face, weights = images["faces"][..., 0], images["barycentrics"]
    mesh = images["segmentation"][..., 0] == model.geom("mesh").id
    assert mesh.sum() > 50
    np.testing.assert_array_equal(face >= 0, mesh)
    assert len(set(face[mesh].tolist())) > 1
    assert (weights[~mesh] == 0.0).all()
    assert (weights >= 0.0).all() and (weights.sum(axis=-1) <= 1.0 + 1e-6).all()
    first = 1.0 - weights[mesh].sum(axis=-1, keepdims=True)
    shares = np.concatenate((first, weights[mesh]), axis=-1)
    points = np.einsum("nk,nkd->nd", shares, corners[face[mesh]])
    np.testing.assert_allclose(points, images["points"][mesh], atol=2e-5)


def test_either_output_alone_is_the_same(device: wp.Device) -> None:
    both = seen_by(wc.Camera("front", width=32, height=24, outputs=("faces", "barycentrics")), device)[1]
    for name in both:
        alone = seen_by(wc.Camera("front", width=32, height=24, outputs=(name,)), device)[1]
        np.testing.assert_array_equal(alone[name], both[name])


def test_a_back_has_the_number_and_the_weights_of_its_front(device: wp.Device) -> None:
    """A sheet that is seen from both sides shows the same triangles, mirrored."""
    usd = pytest.importorskip("pxr.Usd")
    from usd_stages import add_square, metric

    stage = metric(usd.Stage.CreateInMemory())
    add_square(stage, "/sheet", doubleSided=True)
    poses = {"above": ((0.0, 0.0, 3.0), (1.0, 0.0, 0.0, 0.0)), "below": ((0.0, 0.0, -3.0), (0.0, 1.0, 0.0, 0.0))}
    cameras = [
        wc.Camera(
            name, width=16, height=16, outputs=("faces", "barycentrics"), lens=wc.Pinhole(fovy=60.0), position=position,
            rotation=rotation,
        )
        for name, (position, rotation) in poses.items()
    ]  # fmt: skip
    images = wc.Renderer(wc.from_usd(stage, device=device), cameras).render()
    above, below = ({key: image[0].cpu().numpy() for key, image in images[name].items()} for name in poses)
    assert set(above["faces"].ravel().tolist()) == {-1, 0, 1}
    np.testing.assert_array_equal(below["faces"], above["faces"][::-1])
    np.testing.assert_allclose(below["barycentrics"], above["barycentrics"][::-1], atol=1e-6)
