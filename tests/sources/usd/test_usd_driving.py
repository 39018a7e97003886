"""Stages in many worlds, driven by path."""

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc
from warpcam.scene.source import LIVE_ARRAYS

pytest.importorskip("pxr.Usd")
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import above, add_material, add_mesh, add_square


def test_poses_of_many_worlds(stage: Usd.Stage, device: wp.Device) -> None:
    UsdGeom.Xform.Define(stage, "/robot").AddTranslateOp().Set((1, 2, 3))
    cube = UsdGeom.Cube.Define(stage, "/robot/link")
    cube.CreateSizeAttr(0.4)
    UsdGeom.Xformable(cube).AddTranslateOp().Set((0.5, 0, 0))
    hand = UsdGeom.Xform.Define(stage, "/robot/hand")
    UsdGeom.Xformable(hand).AddTranslateOp().Set((0, 1, 0))
    UsdGeom.Sphere.Define(stage, "/robot/hand/tip").CreateRadiusAttr(0.1)
    UsdGeom.Camera.Define(stage, "/robot/hand/eye")
    UsdLux.SphereLight.Define(stage, "/robot/hand/lamp")
    add_square(stage, "/floor", z=-1)
    scene = wc.from_usd(stage, num_worlds=5, device=device)
    link, tip, floor = (scene.shapes.index(f"/{name}") for name in ("robot/link", "robot/hand/tip", "floor"))
    np.testing.assert_allclose(scene.array("shape_positions").numpy()[:, link], np.tile((1.5, 2, 3), (5, 1)))
    random = np.random.default_rng(0)
    poses = np.concatenate((random.normal(size=(5, 2, 3)), random.normal(size=(5, 2, 4))), axis=-1).astype(np.float32)
    where = str(scene.array("shape_positions").device)
    scene.set_poses(["/robot", "/robot/hand"], torch.tensor(poses, device=where))
    turns = np.array([[rotation_of(pose[3:]) for pose in world] for world in poses])

    def at(name: str) -> np.ndarray:
        return scene.array(name).numpy()

    expected_link = poses[:, 0, :3] + turns[:, 0] @ (0.5, 0, 0)
    np.testing.assert_allclose(at("shape_positions")[:, link], expected_link, atol=1e-5)
    np.testing.assert_allclose(at("shape_rotations")[:, link], turns[:, 0], atol=1e-5)
    np.testing.assert_allclose(at("shape_positions")[:, tip], poses[:, 1, :3], atol=1e-5)
    np.testing.assert_allclose(at("camera_positions")[:, 0], poses[:, 1, :3], atol=1e-5)
    np.testing.assert_allclose(at("camera_rotations")[:, 0], turns[:, 1], atol=1e-5)
    np.testing.assert_allclose(at("light_positions")[:, 0], poses[:, 1, :3], atol=1e-5)
    np.testing.assert_allclose(at("light_directions")[:, 0], -turns[:, 1, :, 2], atol=1e-5)
    np.testing.assert_allclose(at("shape_positions")[:, floor], 0.0)
    body = scene.bodies.index("/robot/hand")
    np.testing.assert_allclose(at("body_positions")[:, body], poses[:, 1, :3], atol=1e-5)
    # What is driven by itself does not follow what is above it.
    scene.set_poses(["/robot"], poses[:1, :1])
    np.testing.assert_allclose(at("shape_positions")[:, link], np.tile(expected_link[0], (5, 1)), atol=1e-5)
    np.testing.assert_allclose(at("shape_positions")[:, tip], poses[:, 1, :3], atol=1e-5)


def test_what_resets_its_stack_of_frames_stays_where_it_is(stage: Usd.Stage, device: wp.Device) -> None:
    """Links of robots that are rigid bodies below one another reset their stack of frames."""
    UsdGeom.Xform.Define(stage, "/robot")
    add_square(stage, "/robot/base")
    link = UsdGeom.Xform.Define(stage, "/robot/link")
    link.AddTranslateOp().Set((1, 2, 3))
    link.SetResetXformStack(True)
    add_square(stage, "/robot/link/it")
    scene = wc.from_usd(stage, device=device)
    scene.set_poses(["/robot"], np.array([[[5, 0, 0, 1, 0, 0, 0]]], np.float32))
    np.testing.assert_allclose(scene.array("shape_positions").numpy()[0], ((5, 0, 0), (1, 2, 3)))
    scene.set_poses(["/robot/link"], np.array([[[0, 0, 7, 1, 0, 0, 0]]], np.float32))
    np.testing.assert_allclose(scene.array("shape_positions").numpy()[0], ((5, 0, 0), (0, 0, 7)))


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )


def test_worlds_of_their_own(stage: Usd.Stage, device: wp.Device) -> None:
    """Visibility and colours, with no mesh stored twice."""
    for name, x in (("a", -1.0), ("b", 1.0)):
        UsdGeom.Xform.Define(stage, f"/{name}").AddTranslateOp().Set((x, 0, 0))
        square = add_square(stage, f"/{name}/square", half=0.5)
        square.CreateDisplayColorAttr([(1, 1, 1)])
    scene = wc.from_usd(stage, num_worlds=3, device=device)
    renderer = wc.Renderer(scene, [above(3.0, 16, 4.0, "albedo", "segmentation")])
    images = renderer.render()["above"]
    assert images["albedo"][:, 8, 4].tolist() == [[255] * 3] * 3
    scene.set_colors(["/a"], np.array([[[1, 0, 0]], [[0, 1, 0]], [[0, 0, 1]]], np.float32))
    scene.set_visible(["/b"], np.array([[True], [False], [True]]))
    renderer.render()
    assert images["albedo"][:, 8, 4].tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 255]]
    assert (images["segmentation"][:, 8, 12, 0] >= 0).tolist() == [True, False, True]
    scene.set_visible(["/b"], np.array([[True], [True], [False]]))
    scene.set_visible(["/a/square"], np.array([[False]]))
    renderer.render()
    assert (images["segmentation"][:, 8, 12, 0] >= 0).tolist() == [True, True, False]
    assert (images["segmentation"][:, 8, 4, 0] >= 0).tolist() == [False] * 3
    scene.set_visible(["/a/square"], np.array([[True]]))
    renderer.render()
    assert images["albedo"][:, 8, 4].tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 255]]


def test_four_thousand_variations_share_their_mesh(stage: Usd.Stage, device: wp.Device) -> None:
    """Poses, visibilities, colours and textures of each world's own; meshes and images are there once."""
    count, side = 4096, 32
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, side + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    faces = [(a, a + side + 1, a + side + 2, a + 1) for a in first]
    for name in ("left", "right"):
        mesh = add_mesh(stage, f"/{name}/mesh", np.append(grid, np.zeros((len(grid), 1)), axis=1), faces)
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
        st.Set([tuple(map(float, place + 0.5)) for place in grid])
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(
            UsdShade.Material(add_material(stage, f"/Looks/{name}", diffuseColor=(1.0, 1.0, 1.0)).GetPrim().GetParent())
        )
    pool = {
        name: np.full((64, 64, 3), color, np.uint8) for name, color in (("red", (255, 0, 0)), ("blue", (0, 0, 255)))
    }
    one, many = (wc.from_usd(stage, num_worlds=n, device=device, textures=pool) for n in (1, count))
    random = np.random.default_rng(0)
    poses = np.zeros((count, 2, 7), np.float32)
    poses[:, :, 3] = 1.0
    poses[:, :, 0] = (-1.0, 1.0)
    swapped, seen, painted, image = random.random((4, count)) < 0.5
    poses[swapped] = poses[swapped][:, ::-1]
    colors = np.where(painted[:, None, None], np.float32((0.0, 1.0, 0.0)), np.float32((1.0, 1.0, 1.0)))
    many.set_poses(["/left", "/right"], poses)
    many.set_visible(["/left"], seen[:, None])
    many.set_colors(["/right"], np.ascontiguousarray(colors))
    many.set_textures(["/Looks/left"], image[:, None].astype(np.int32))
    seen_images = wc.Renderer(many, [above(3.0, 4, 3.0, "albedo")]).render()["above"]["albedo"].cpu().numpy()
    sides = np.where(swapped[:, None, None], seen_images[:, 1, (3, 0)], seen_images[:, 1, (0, 3)])
    shown = np.where(seen[:, None], np.where(image[:, None], (0, 0, 255), (255, 0, 0)), 0)
    np.testing.assert_array_equal(sides[:, 0], shown)
    np.testing.assert_array_equal(sides[:, 1], np.where(painted[:, None], (0, 255, 0), 255))
    for part, name in (("_meshes", "faces"), ("_meshes", "nodes"), ("_meshes", "uvs"), ("_textures", "texels")):
        assert getattr(getattr(many, part), name).shape == getattr(getattr(one, part), name).shape
    own = sum(many.array(name).capacity for name in LIVE_ARRAYS)
    assert own < count * 2 * 200  # bytes: what a shape, a body and a material have of their own


def test_driving_neither_allocates_nor_binds_again(stage: Usd.Stage, device: wp.Device) -> None:
    UsdGeom.Xform.Define(stage, "/x")
    UsdGeom.Cube.Define(stage, "/x/cube")
    scene = wc.from_usd(stage, num_worlds=4, device=device)
    poses = wp.zeros((4, 1, 7), dtype=wp.float32, device=device)
    colors = wp.zeros((4, 1, 4), dtype=wp.float32, device=device)
    scene.set_poses(["/x"], poses)
    scene.set_colors(["/x"], colors)
    tables = scene.tables()
    pointers = {name: scene.array(name).ptr for name in ("shape_positions", "shape_colors")}
    scene.set_poses(["/x"], poses)
    scene.set_colors(["/x"], colors)
    assert scene.tables() is tables
    assert pointers == {name: scene.array(name).ptr for name in pointers}


BAD_DRIVING = {
    "set_poses: the scene has no '/nothing'; it has: '/', '/x', '/x/cube'": lambda s: s.set_poses(
        ["/nothing"], np.zeros((1, 1, 7), np.float32)
    ),
    "set_poses: poses must have shape (3 or 1, 1, 7), got (2, 1, 7)": lambda s: s.set_poses(
        ["/x"], np.zeros((2, 1, 7), np.float32)
    ),
    "set_poses: paths must be a sequence of paths like [\"/World/Box\"], got '/x'": lambda s: s.set_poses(
        "/x", np.zeros((1, 1, 7), np.float32)
    ),
    "set_poses: paths names something twice: ['/x', '/x']": lambda s: s.set_poses(
        ["/x", "/x"], np.zeros((1, 2, 7), np.float32)
    ),
    "set_colors: colors must have shape (3 or 1, 1, 3 or 4), got (1, 1, 5)": lambda s: s.set_colors(
        ["/x"], np.zeros((1, 1, 5), np.float32)
    ),
    "set_visible: visible must be an array of bool or uint8, got": lambda s: s.set_visible(["/x"], np.zeros((1, 1))),
    "set_visible: '/empty' has no shapes that were visible when the scene was read": lambda s: s.set_visible(
        ["/empty"], np.zeros((1, 1), bool)
    ),
    "set_textures: the scene has no material '/x'; it has: none": lambda s: s.set_textures(
        ["/x"], np.zeros((1, 1), np.int32)
    ),
}


@pytest.mark.parametrize("text", BAD_DRIVING)
def test_driving_badly(text: str, stage: Usd.Stage) -> None:
    UsdGeom.Xform.Define(stage, "/x")
    UsdGeom.Cube.Define(stage, "/x/cube")
    if "/empty" in text:
        UsdGeom.Xform.Define(stage, "/empty")
    scene = wc.from_usd(stage, num_worlds=3, device="cpu")
    with pytest.raises(wc.WarpcamError) as caught:
        BAD_DRIVING[text](scene)
    assert text in str(caught.value)
