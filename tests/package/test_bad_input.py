"""Mistakes: each error names the argument, what came and what is allowed."""

import re
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc
from warpcam.accel.heightfields import HeightField, pack_height_fields
from warpcam.accel.meshes import Mesh, pack_meshes
from warpcam.core.torch_interop import to_numpy

MODEL = """
<mujoco>
  <asset>
    <mesh name="corner" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>
    <hfield name="hill" nrow="2" ncol="2" size="1 1 1 1"/>
    <material name="paint"/>
  </asset>
  <worldbody>
    <light/>
    <camera name="front"/>
    <camera/>
    <body name="arm"><joint/><geom name="tip" size=".1"/><geom type="mesh" mesh="corner"/></body>
    <geom type="hfield" hfield="hill"/>
  </worldbody>
</mujoco>
"""
PINHOLE = wc.Pinhole(fovy=60.0)


def compile_model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = mujoco.MjModel.from_xml_string(MODEL)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd


@pytest.fixture(scope="module")
def scene() -> wc.Scene:
    mjm, mjd = compile_model()
    return wc.from_mujoco(mjm, [mjd, mjd], device="cpu")


def camera(name: Any = "front", **values: Any) -> wc.Camera:
    return wc.Camera(name, **{"width": 4, "height": 4, "outputs": ("depth",), **values})


def says(text: str) -> Any:
    return pytest.raises(wc.WarpcamError, match=re.escape(text))


def test_the_error_is_a_value_error() -> None:
    assert issubclass(wc.WarpcamError, ValueError)


OUTPUT_NAMES = "rgb, rgba, hdr, depth, distance, normals, points, segmentation, bodies, instances, semantics, "
OUTPUT_NAMES += "flow, flow_valid, albedo"

CAMERAS = {
    "Camera: name must be a camera's name or index, got True": {"name": True},
    "Camera: name must be a camera's name or index, got ''": {"name": ""},
    "Camera: name must be a camera's name or index, got 1.5": {"name": 1.5},
    "Camera('front'): width must be a whole number of pixels, at least 1, got 0": {"width": 0},
    "Camera('front'): width must be a whole number of pixels, at least 1, got -4": {"width": -4},
    "Camera('front'): height must be a whole number of pixels, at least 1, got 2.5": {"height": 2.5},
    "Camera('front'): height must be a whole number of pixels, at least 1, got '4'": {"height": "4"},
    f"Camera('front'): outputs has 'color'; allowed are {OUTPUT_NAMES}": {"outputs": ("depth", "color")},
    f"Camera('front'): outputs has 'optical_flow'; allowed are {OUTPUT_NAMES}": {"outputs": ("optical_flow",)},
    f"Camera('front'): outputs has 'labels'; allowed are {OUTPUT_NAMES}": {"outputs": ["labels"]},
    f"Camera('front'): outputs has None; allowed are {OUTPUT_NAMES}": {"outputs": [None]},
    f"Camera('front'): outputs is empty; allowed are {OUTPUT_NAMES}": {"outputs": ()},
    "Camera('front'): outputs must be a sequence of names like (\"rgb\", \"depth\"), got 'depth'": {"outputs": "depth"},
    "Camera('front'): outputs names something twice: ['rgb', 'rgb']": {"outputs": ("rgb", "rgb")},
    "Camera('front'): lens must be a lens, such as Pinhole or Fisheye, or None, got 58.0": {"lens": 58.0},
    "Camera('front'): position, rotation or parent make it a camera of your own, which needs a lens": {"parent": "arm"},
    "Camera('front'): depth_clipping is 'far'; allowed are 'none', 'max', 'zero'": {"depth_clipping": "far"},
    "Camera('front'): shadows must be True or False, got 3": {"shadows": 3},
    "Camera('front'): background must be red, green and blue in [0, 1], or None, got (0, 0, 255)": {
        "background": (0, 0, 255)
    },
    "Camera('front'): background must be red, green and blue in [0, 1], or None, got 'black'": {"background": "black"},
    "Camera('front'): background must be red, green and blue in [0, 1], or None, got 0.5": {"background": 0.5},
}


@pytest.mark.parametrize("text", CAMERAS)
def test_camera(text: str) -> None:
    with says(text):
        camera(**CAMERAS[text])


LENSES = {
    "Pinhole: nothing came; either fovy [degrees] or fx [pixels] is needed": {},
    "Pinhole: fy, cx came; either fovy [degrees] or fx [pixels] is needed": {"fy": 1.0, "cx": 1.0},
    "Pinhole: fovy came together with fx; give either fovy [degrees], or fx, fy, cx, cy [pixels]": {
        "fovy": 60.0,
        "fx": 1.0,
    },
}


@pytest.mark.parametrize("text", LENSES)
def test_lens(text: str) -> None:
    with says(text):
        wc.Pinhole(**LENSES[text])


NAN = float("nan")
OWN = {"lens": PINHOLE, "position": (0, 0, 0)}

# What only shows when a camera meets its scene, of two worlds.
MOUNTED = {
    "Renderer: cameras: the scene has no camera 'back'; it has: 'front', 1": {"name": "back"},
    "Renderer: cameras: the scene has no camera 2; it has: 'front', 1": {"name": 2},
    "Renderer: cameras: the scene has no camera -1; it has: 'front', 1": {"name": -1},
    "Camera('front'): parent: the scene has no body 'leg'; it has: 'world', 'arm'": {"lens": PINHOLE, "parent": "leg"},
    "Camera('front'): parent: the scene has no body 9; it has: 'world', 'arm'": {"lens": PINHOLE, "parent": 9},
    "Camera('front'): position must have shape (3,) or (2, 3), got (2,)": {**OWN, "position": (0, 0)},
    "Camera('front'): position must have shape (3,) or (2, 3), got (5, 3)": {**OWN, "position": np.zeros((5, 3))},
    "Camera('front'): position must be finite, got nan": {**OWN, "position": (0, NAN, 0)},
    "Camera('front'): position must be numbers, (3,) or (2, 3), got 'here'": {**OWN, "position": "here"},
    "Camera('front'): position must be numbers, (3,) or (2, 3), got [[0, 0, 0], [0]]": {
        **OWN,
        "position": [[0, 0, 0], [0]],
    },
    "Camera('front'): rotation must have shape (4,) or (2, 4), got (3, 3)": {**OWN, "rotation": np.eye(3)},
    "Camera('front'): rotation must not be of length 0, got (0, 0, 0, 0)": {**OWN, "rotation": (0, 0, 0, 0)},
    "Camera('front'): near must be at least 0, got -1.0": {"near": -1.0},
    "Camera('front'): near must have shape a number or (2,), got (3,)": {"near": np.zeros(3)},
    "Camera('front'): far must be beyond near, got near 2.0 and far 1.0": {"near": 2.0, "far": 1.0},
    "Camera('front'): far must be beyond near, got near 0.0 and far 0.0": {"far": torch.tensor([1.0, 0.0])},
    "Camera('front'): far must be finite, got nan": {"far": NAN},
    "Camera('front'): depth_clipping=\"max\" needs a finite far, got inf": {"depth_clipping": "max"},
    "Camera('front'): lens Pinhole: fovy must be in (0, 180) degrees, got 180.0": {"lens": wc.Pinhole(fovy=180.0)},
    "Camera('front'): lens Pinhole: fovy must be in (0, 180) degrees, got -5.0": {"lens": wc.Pinhole(fovy=[60, -5])},
    "Camera('front'): lens Pinhole: fx must be positive, got 0.0": {"lens": wc.Pinhole(fx=0.0)},
    "Camera('front'): lens Pinhole: fy must be positive, got -2.0": {"lens": wc.Pinhole(fx=1.0, fy=-2.0)},
    "Camera('front'): lens Pinhole: cx must be finite, got inf": {"lens": wc.Pinhole(fx=1.0, cx=np.inf)},
    "Camera('front'): lens Orthographic: height must be positive, got 0.0": {"lens": wc.Orthographic(0.0)},
    "Camera('front'): lens Orthographic: height must have shape a number or (2,), got (3,)": {
        "lens": wc.Orthographic(np.ones(3))
    },
    "Camera('front'): 2 worlds of 46341 x 46341 pixels are 2^31 pixels or more; fewer are allowed in one camera": {
        "width": 46341,
        "height": 46341,
    },
}


@pytest.mark.parametrize("text", MOUNTED)
def test_camera_in_its_scene(text: str, scene: wc.Scene) -> None:
    with says(text):
        wc.Renderer(scene, [camera(**MOUNTED[text])])


def test_renderer(scene: wc.Scene) -> None:
    with says("Renderer: scene must be made by from_mujoco_warp or the like, got str"):
        wc.Renderer("scene.xml", [])
    with says("Renderer: cameras must be a sequence of Camera, got Camera("):
        wc.Renderer(scene, camera())
    with says("Renderer: cameras must be a sequence of Camera, got ['front']"):
        wc.Renderer(scene, ["front"])
    with says("Renderer: cameras has two called 'front'; each needs a name of its own"):
        wc.Renderer(scene, [camera(), camera(width=8)])
    renderer = wc.Renderer(scene, [camera()])
    with says("Renderer: camera 'back' came, it renders 'front'"):
        renderer.array("back", "depth")
    with says("Renderer: camera 1 came, it renders 'front'"):
        renderer.camera(1)
    with says("Renderer.array: output 'rgb' came, 'front' renders depth"):
        renderer.array("front", "rgb")


WORLDS = {
    "render: worlds has id 2; allowed are 0 to 1": [0, 2],
    "render: worlds has id -1; allowed are 0 to 1": np.array([-1]),
    "render: worlds has id 5; allowed are 0 to 1": torch.tensor([5]),
    "render: worlds has id 7; allowed are 0 to 1": wp.array([7], dtype=wp.int64, device="cpu"),
    "render: worlds as a mask must have shape (2,), got (3,)": [True, False, True],
    "render: worlds as a mask must have shape (2,), got (1,)": torch.ones(1, dtype=torch.bool),
    "render: worlds must be ids (n,), or a mask (2,) of bool or uint8, got [True, 1]": [True, 1],
    "render: worlds must be ids (n,), or a mask (2,) of bool or uint8, got 'all'": "all",
    "render: worlds must be ids (n,), or a mask (2,) of bool or uint8, got 1": 1,
    "render: worlds must be ids (n,), or a mask (2,) of bool or uint8, got tensor(1)": torch.tensor(1),
    "render: worlds must be ids (n,), or a mask (2,) of bool or uint8, got [0.5]": [0.5],
    "render: worlds must be ids (n,), or a mask (2,) of bool or uint8, got [[0], [0, 1]]": [[0], [0, 1]],
    "render: worlds must be ids (n,) of int32 or int64, or a mask (2,) of bool or uint8, got float32 (2,)": torch.ones(
        2
    ),
    "render: worlds must be ids (n,) of int32 or int64, or a mask (2,) of bool or uint8, got int64 (1, 2)": torch.ones(
        (1, 2), dtype=torch.int64
    ),
}


@pytest.mark.parametrize("text", WORLDS)
def test_worlds(text: str, scene: wc.Scene) -> None:
    renderer = wc.Renderer(scene, [camera()])
    before = to_numpy(renderer.render()["front"]["depth"]).copy()
    with says(text):
        renderer.render(worlds=WORLDS[text])
    np.testing.assert_array_equal(to_numpy(renderer.render()["front"]["depth"]), before)


def test_from_mujoco() -> None:
    mjm, mjd = compile_model()
    other = mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
    with says("mjm must be a mujoco.MjModel, got str"):
        wc.from_mujoco("scene.xml", mjd)
    with says("mjd must be a mujoco.MjData, got MjModel"):
        wc.from_mujoco(mjm, mjm)
    with says("mjd[1] must be a mujoco.MjData, got NoneType"):
        wc.from_mujoco(mjm, [mjd, None])
    with says("mjd is an empty list; one MjData, or one for each world, is needed"):
        wc.from_mujoco(mjm, [])
    with says("mjd[1] was made from another model than mjm: it has 0 geoms and 1 bodies, mjm has 3 and 2"):
        wc.from_mujoco(mjm, [mjd, other])
    for groups in ([0, 6], [-1], "012", 3, [True], [1.5], [np.bool_(True)], ["1"]):
        with says(f"groups must be geom groups, numbers from 0 to 5, got {groups!r}"):
            wc.from_mujoco(mjm, mjd, groups=groups)
    assert wc.from_mujoco(mjm, mjd, groups=iter((0, np.int64(1)))).num_worlds == 1


def test_from_mujoco_warp() -> None:
    mjm, mjd = compile_model()
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=2)
        other = mujoco.MjModel.from_xml_string("<mujoco/>")
        with says("mjm must be a mujoco.MjModel, got Model"):
            wc.from_mujoco_warp(m, m, d)
        with says("m must be a mujoco_warp.Model, got MjModel"):
            wc.from_mujoco_warp(mjm, mjm, d)
        with says("d must be a mujoco_warp.Data, got MjData"):
            wc.from_mujoco_warp(mjm, m, mjd)
        with says("m was made from another model than mjm: ngeom is 3 there, 0 in mjm"):
            wc.from_mujoco_warp(other, m, d)
        with says("d.geom_xpos: expected vec3f of shape (1, 3), got vec3f of (1, 0)"):
            wc.from_mujoco_warp(mjm, m, mjw.make_data(other))


def test_an_array_replaced_by_one_that_does_not_fit_is_named() -> None:
    mjm, mjd = compile_model()
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=2)
        renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera()])
        good = m.geom_rgba
        m.geom_rgba = wp.zeros((2, 7), dtype=wp.vec4)
        with says("m.geom_rgba: expected vec4f of shape (1 or more, 3), got vec4f of (2, 7)"):
            renderer.render()
        m.geom_rgba = wp.zeros((2, 3), dtype=wp.vec3)
        with says("m.geom_rgba: expected vec4f of shape (1 or more, 3), got vec3f of (2, 3)"):
            renderer.render()
        m.geom_rgba = None
        with says("m.geom_rgba: a Warp array is needed, got NoneType"):
            renderer.render()
        m.geom_rgba = good
        renderer.render()


@pytest.mark.parametrize(
    ("array", "value", "text"),
    [
        ("geom_matid", 4, "m.geom_matid: has 4; allowed are -1 for none and 0 to 0"),
        ("geom_dataid", 3, "m.geom_dataid: has 3; allowed are -1 for none and 0 to 0"),
        ("mat_texid", -7, "m.mat_texid: has -7; allowed are -1 for none and 0 to -1"),
    ],
)
def test_indices_out_of_range(array: str, value: int, text: str) -> None:
    mjm, mjd = compile_model()
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=2)
        getattr(m, array).fill_(value)
        with says(text):
            wc.from_mujoco_warp(mjm, m, d)


@pytest.mark.parametrize(
    ("array", "value", "text"),
    [
        ("mesh_face", 9, "mesh 'corner': mesh_face must be indices from 0 to 3, got [9, 9, 9] at face 0"),
        ("mesh_face", -1, "mesh 'corner': mesh_face must be indices from 0 to 3, got [-1, -1, -1] at face 0"),
        ("mesh_facenormal", 99, "mesh 'corner': mesh_facenormal must be indices from 0 to"),
        ("mesh_vert", NAN, "mesh 'corner': mesh_vert must be finite"),
        ("hfield_data", np.inf, "height field 'hill': heights must be finite, got inf at row 0, column 0"),
        ("hfield_size", 0.0, "height field 'hill': half_size must be positive and finite, got (0.0, 0.0)"),
    ],
)
def test_assets(array: str, value: float, text: str) -> None:
    mjm, mjd = compile_model()
    getattr(mjm, array)[:] = value
    with says(text):
        wc.from_mujoco(mjm, mjd, device="cpu")


def test_meshes_and_height_fields_of_other_sources() -> None:
    cpu = wp.get_device("cpu")
    triangle = {"vertices": np.eye(3, dtype=np.float32), "faces": np.array([[0, 1, 2]], np.int32)}
    with says("mesh 'm': normals must have shape (1, 3, 3), got (3, 3)"):
        pack_meshes([Mesh("m", **triangle, normals=np.zeros((3, 3), np.float32))], cpu)
    with says("mesh 'm': uvs must be finite, got [[nan, nan], [nan, nan], [nan, nan]] at face 0"):
        pack_meshes([Mesh("m", **triangle, uvs=np.full((1, 3, 2), NAN, np.float32))], cpu)
    with says("height field 'h': heights must be 2 to 4097 rows and columns, got shape (1, 5)"):
        pack_height_fields([HeightField("h", np.zeros((1, 5), np.float32), (1.0, 1.0), 1.0, 0.1)], cpu)
