"""Scenes: what both sources read from a model, and the box around it."""

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.kernels import types
from warpcam.scene.source import LIVE_ARRAYS

every_device = pytest.mark.parametrize("device", [device.alias for device in wp.get_devices()])

MODEL = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1=".1 .2 .3" width="4" height="4"/>
    <texture name="check" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="8" height="8"/>
    <material name="checked" texture="check" rgba="1 1 1 1" emission=".25"/>
    <mesh name="corner" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>
    <hfield name="hill" nrow="3" ncol="4" elevation="0 0 0 0 0 1 .5 0 0 0 0 0" size="2 1 .5 .1"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0 0 3" dir="0 0 -1" castshadow="false"/>
    <light name="sun" type="directional" dir="0 1 -1"/>
    <camera name="front" pos="0 -3 1" xyaxes="1 0 0 0 0 1" fovy="40"/>
    <camera pos="0 0 5" fovy="2" projection="orthographic"/>
    <geom name="floor" type="plane" size="0 0 1" material="checked"/>
    <geom name="ground" type="hfield" hfield="hill" pos="0 0 .2"/>
    <body name="ball" pos="0 0 2">
      <freejoint/>
      <geom type="sphere" size=".5" rgba="1 0 0 .5"/>
      <geom type="mesh" mesh="corner" pos="1 0 0"/>
      <geom type="box" size="9 9 9" group="3"/>
    </body>
  </worldbody>
</mujoco>
"""


def compile_model(xml: str = MODEL) -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = mujoco.MjModel.from_xml_string(xml)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd


def make(kind: str, mjm: mujoco.MjModel, mjd: mujoco.MjData, device: str, num_worlds: int = 1) -> wc.Scene:
    if kind == "mujoco":
        return wc.from_mujoco(mjm, [mjd] * num_worlds, device=device)
    with wp.ScopedDevice(device):
        return wc.from_mujoco_warp(mjm, mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=num_worlds))


every_source = pytest.mark.parametrize("kind", ["mujoco", "mujoco_warp"])


@every_device
@every_source
def test_names_and_sizes(kind: str, device: str) -> None:
    scene = make(kind, *compile_model(), device, num_worlds=3)
    assert scene.cameras == ("front", "")
    assert scene.num_worlds == 3
    assert scene.device == wp.get_device(device)
    assert scene.camera_kind(1).projection == "orthographic"


@every_device
@every_source
def test_tables_hold_the_model(kind: str, device: str) -> None:
    mjm, mjd = compile_model()
    tables = make(kind, mjm, mjd, device).tables()
    assert tables.num_drawn == 4
    assert tables.shapes.drawn.numpy().tolist() == [0, 1, 2, 3]  # the box is of group 3
    assert tables.shape_types == {types.PLANE, types.HEIGHT_FIELD, types.SPHERE, types.MESH}
    assert tables.has_textures
    assert tables.has_skybox
    assert tables.background.skybox == 0
    assert tables.num_lights == 2
    assert tables.lights.types.numpy().tolist() == [[types.LIGHT_SPOT, types.LIGHT_DIRECTIONAL]]
    assert not tables.lights.casts_shadow.numpy()[0, 0]
    assert tables.lights.headlight.numpy().max() == 0.0
    assert tables.lights.global_ambient == pytest.approx(0.3)  # for worlds whose lights are all off
    np.testing.assert_allclose(tables.shapes.positions.numpy()[0], mjd.geom_xpos, atol=1e-6)
    np.testing.assert_allclose(tables.shapes.rotations.numpy()[0].reshape(-1, 9), mjd.geom_xmat, atol=1e-6)
    np.testing.assert_allclose(tables.materials.emission.numpy(), [[0.25]])
    np.testing.assert_allclose(tables.shapes.colors.numpy()[0, 2], (1, 0, 0, 0.5))


def test_both_sources_read_the_same() -> None:
    mjm, mjd = compile_model()
    classic, live = (make(kind, mjm, mjd, "cpu", num_worlds=2) for kind in ("mujoco", "mujoco_warp"))
    for name in LIVE_ARRAYS:
        assert classic.array(name).dtype is live.array(name).dtype
        np.testing.assert_allclose(classic.array(name).numpy(), live.array(name).numpy(), atol=1e-6, err_msg=name)


@every_device
def test_mujoco_warp_arrays_are_the_simulators_own(device: str) -> None:
    mjm, mjd = compile_model()
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=2)
    shapes = wc.from_mujoco_warp(mjm, m, d).tables().shapes
    assert shapes.positions.ptr == d.geom_xpos.ptr
    assert shapes.colors.ptr == m.geom_rgba.ptr


def test_tables_follow_a_replaced_array() -> None:
    mjm, mjd = compile_model()
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=2)
    scene = wc.from_mujoco_warp(mjm, m, d)
    before = scene.tables()
    assert scene.tables() is before
    m.geom_rgba = wp.array(np.tile(m.geom_rgba.numpy(), (2, 1, 1)), dtype=wp.vec4, device="cpu")
    after = scene.tables()
    assert after is not before
    assert after.shapes.colors.shape == (2, mjm.ngeom)


@every_source
def test_groups_choose_what_is_drawn(kind: str) -> None:
    mjm, mjd = compile_model()
    scene = wc.from_mujoco(mjm, mjd, groups=(3,), device="cpu")
    if kind == "mujoco_warp":
        scene = wc.from_mujoco_warp(mjm, mjw.put_model(mjm), mjw.put_data(mjm, mjd), groups=[3])
    assert scene.tables().shapes.drawn.numpy().tolist() == [4]
    assert scene.tables().shape_types == {types.BOX}


@every_device
@every_source
def test_bounds_leave_out_infinite_planes_and_what_is_transparent(kind: str, device: str) -> None:
    mjm, mjd = compile_model()
    low, high = make(kind, mjm, mjd, device).bounds()
    np.testing.assert_allclose(low, (-2, -1, 0.1), atol=1e-5)
    np.testing.assert_allclose(high, (2, 1, 3), atol=1e-5)
    mjm.geom_rgba[3, 3] = 0.0
    mjm.geom_rgba[2, 3] = 0.0
    low, high = make(kind, mjm, mjd, device).bounds()
    np.testing.assert_allclose(high, (2, 1, 0.7), atol=1e-5)


@pytest.mark.parametrize(
    ("shape", "high"),
    [
        ('type="capsule" size=".2 .5"', (0.2, 0.2, 0.7)),
        ('type="cylinder" size=".2 .5"', (0.2, 0.2, 0.5)),
        ('type="ellipsoid" size=".2 .3 .5"', (0.2, 0.3, 0.5)),
    ],
)
def test_bounds_hold_whole_solids(shape: str, high: tuple[float, ...]) -> None:
    found = make("mujoco", *compile_model(f"<mujoco><worldbody><geom {shape}/></worldbody></mujoco>"), "cpu").bounds()
    np.testing.assert_allclose(found, (np.negative(high), high), atol=1e-6)


@every_source
def test_a_scene_of_nothing_has_bounds(kind: str) -> None:
    low, high = make(kind, *compile_model("<mujoco/>"), "cpu").bounds()
    assert low.tolist() == high.tolist() == [0, 0, 0]


def test_mesh_normals_follow_mujocos_rule() -> None:
    scene = make("mujoco", *compile_model(), "cpu")
    meshes = scene.tables().meshes
    faces = meshes.faces.numpy().reshape(-1, 3, 4)
    given = faces[:, 0, 3].copy().view(np.int32)
    normals = meshes.normals.numpy().reshape(-1, 3, 3)[given]
    flat = np.cross(faces[:, 1, :3] - faces[:, 0, :3], faces[:, 2, :3] - faces[:, 0, :3])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    # a tetrahedron's vertex normals are all far from its faces': every corner falls back, or is near
    assert (np.einsum("fkc,fc->fk", normals, flat) >= 0.8).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)


def test_equal_meshes_share_their_tree() -> None:
    xml = MODEL.replace("<hfield", '<mesh name="twin" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/><hfield', 1)
    meshes = make("mujoco", *compile_model(xml), "cpu").tables().meshes
    assert meshes.node_start.numpy().tolist() == [0, 0]
    assert meshes.corner_start.numpy().tolist() == [0, 4]


def test_height_fields_are_in_metres() -> None:
    fields = make("mujoco", *compile_model(), "cpu").tables().height_fields
    assert fields.heights.numpy().max() == pytest.approx(0.5)
    np.testing.assert_allclose(fields.size.numpy(), [(2, 1, 0.5, 0.1)])
    assert (fields.rows.numpy()[0], fields.columns.numpy()[0]) == (3, 4)


def test_boxes_in_other_quads_are_told(caplog: pytest.LogCaptureFixture) -> None:
    for quads, shape, told in ((4, "box", 0), (8, "sphere", 0), (8, "box", 1)):
        xml = f"""<mujoco><visual><quality numquads="{quads}"/></visual>
        <worldbody><geom type="{shape}" size="1 1 1"/></worldbody></mujoco>"""
        caplog.clear()
        make("mujoco", *compile_model(xml), "cpu")
        assert len(caplog.messages) == told
    assert caplog.messages == ["numquads is 8 in visual/quality; boxes are lit at the corners of 4 quads a side"]
