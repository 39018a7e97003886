"""glTF, OBJ, STL and PLY: depth against Embree's rays, and what their materials become."""

import io
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image
from views import Around, compare

import warpcam as wc

trimesh = pytest.importorskip("trimesh")

DATA = Path(find_spec("mujoco_warp").origin).parent / "test_data" if find_spec("mujoco_warp") else Path()
REAL = sorted([*DATA.glob("aloha_pot/*.stl"), *DATA.glob("aloha_pot/*.obj")], key=lambda path: -path.stat().st_size)[:8]
Y_UP = np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1.0)))


def scene_of_parts() -> Any:
    """Three meshes under frames in each other, one of them twice, stretched and mirrored."""
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.1, 0.2, 0.3))
    knot = trimesh.creation.torus(0.5, 0.15)
    scene.add_geometry(trimesh.creation.annulus(0.2, 0.5, 0.4), node_name="ring", geom_name="ring", transform=turn)
    stretch = turn @ np.diag((1.0, 2.0, 0.5, 1.0))
    scene.add_geometry(knot, node_name="knot", geom_name="knot", parent_node_name="ring", transform=stretch)
    mirror = trimesh.transformations.translation_matrix((1.2, 0, 0)) @ np.diag((-1.0, 1.0, 1.0, 1.0))
    scene.graph.update(frame_to="other", frame_from="ring", matrix=mirror, geometry="knot")
    return scene


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.name[:24])
def test_depth_of_real_files_is_embrees(path: Path, device: wp.Device) -> None:
    scene = wc.load(path, device=device)
    compare(scene, trimesh.load_mesh(path))


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj", "stl", "ply"])
def test_depth_of_every_format_is_embrees(suffix: str, tmp_path: Path, device: wp.Device) -> None:
    parts = scene_of_parts()
    whole = parts.to_mesh()
    path = tmp_path / f"it.{suffix}"
    if suffix == "gltf":
        for name, data in parts.export(file_type="gltf").items():
            (tmp_path / ("it.gltf" if name == "model.gltf" else name)).write_bytes(data)
    elif suffix == "glb":
        parts.export(path)
    else:
        whole.export(path)
    if suffix.startswith("gl"):
        whole.apply_transform(Y_UP)
    scene = wc.load(path, device=device)
    compare(scene, whole)
    if suffix.startswith("gl"):
        assert len(scene.shapes) == 3
        compare(wc.load(path, device=device, up_axis=None), parts.to_mesh())


def test_units(tmp_path: Path, device: wp.Device) -> None:
    trimesh.creation.box((2, 4, 6)).export(tmp_path / "box.stl")
    low, high = wc.load(tmp_path / "box.stl", device=device, meters_per_unit=0.001).bounds()
    np.testing.assert_allclose(high - low, (0.002, 0.004, 0.006), rtol=1e-5)


def test_parts_of_a_file_are_driven(tmp_path: Path, device: wp.Device) -> None:
    scene_of_parts().export(tmp_path / "it.glb")
    scene = wc.load(tmp_path / "it.glb", 3, device=device)
    assert len(scene._parts.meshes) == 3  # the knot is stretched in two ways
    poses = np.tile(np.array((0, 0, 5, 1, 0, 0, 0), np.float32), (3, 1, 1))
    poses[:, 0, 0] = (1, 2, 3)
    ring = next(name for name in scene.shapes if name.endswith("/ring"))
    scene.set_poses([ring], poses)
    np.testing.assert_allclose(scene.array("shape_positions").numpy()[:, scene.shapes.index(ring), 0], (1, 2, 3))


def square(color: Any = None, image: Any = None, **more: Any) -> Any:
    vertices = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]  # glTF's y is up
    uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=color, baseColorTexture=image, **more)
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return trimesh.Trimesh(vertices, [(0, 1, 2), (0, 2, 3)], visual=visual, process=False)


def seen(scene: wc.Scene, output: str = "albedo") -> np.ndarray:
    camera = wc.Camera(
        "c", width=16, height=16, lens=wc.Orthographic(height=2.0), position=(0, 0, 3), outputs=(output,)
    )
    return wc.Renderer(scene, [camera]).render()["c"][output][0].cpu().numpy()


def test_an_image_lies_as_gltf_says(tmp_path: Path, device: wp.Device) -> None:
    pixels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [9, 99, 199]]], np.uint8).repeat(8, 0).repeat(8, 1)
    square(image=Image.fromarray(pixels)).export(tmp_path / "it.glb")
    np.testing.assert_array_equal(seen(wc.load(tmp_path / "it.glb", device=device))[4::8, 4::8], pixels[4::8, 4::8])


def test_factors_are_linear_and_sides_are_told(tmp_path: Path, device: wp.Device) -> None:
    square(color=(128, 0, 255, 255), metallicFactor=0.25, roughnessFactor=0.75).export(tmp_path / "it.glb")
    scene = wc.load(tmp_path / "it.glb", device=device)
    assert np.abs(seen(scene)[8, 8].astype(int) - (188, 0, 255)).max() <= 1
    (look,) = scene._graph_source.graph.materials
    assert (look.metallic, look.roughness) == (0.25, 0.75)
    assert len(scene._parts.meshes[0].faces) == 2
    square(doubleSided=True).export(tmp_path / "it.glb")
    assert len(wc.load(tmp_path / "it.glb", device=device)._parts.meshes[0].faces) == 4


def test_colours_of_faces(tmp_path: Path, device: wp.Device) -> None:
    mesh = trimesh.Trimesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)], process=False)
    mesh.visual.vertex_colors = [(10, 20, 30, 255)] * 4
    mesh.export(tmp_path / "it.ply")
    assert seen(wc.load(tmp_path / "it.ply", device=device))[8, 8].tolist() == [10, 20, 30]
    mesh.visual.vertex_colors = [(0, 0, 0, 255), (255, 0, 0, 255), (255, 0, 0, 255), (0, 0, 0, 255)]
    mesh.export(tmp_path / "it.ply")
    ramp = 255 * (np.arange(16) + 0.5) / 16
    assert np.abs(seen(wc.load(tmp_path / "it.ply", device=device))[3, :, 0] - ramp).max() < 12


@pytest.mark.parametrize(
    ("said", "opacity"),
    [("d 0.25", 0.25), ("d -halo 0.5\nTr 0.5", 0.5), ("d 0.5\nTr 0.1", 0.5), ("Tr 0.25", 0.75), ("Kd 1 0 0", 1.0)],
)
def test_opacity_of_obj(said: str, opacity: float, tmp_path: Path, device: wp.Device) -> None:
    scene = wc.load(glass(tmp_path, said), device=device)
    assert scene.array("shape_colors").numpy()[0, 0, 3] == opacity


def test_opacity_of_obj_that_is_not_drawn(tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    scene = wc.load(glass(tmp_path, "map_d gone.png\nmap_Ks gone.png"), device=device)
    assert scene.array("shape_colors").numpy()[0, 0, 3] == 1.0
    wc.load(glass(tmp_path, "d half"), device=device)
    for text in ("a file is not found", "gone.png", "has map_ks, which is not drawn: glass",
                 "has d that is not a finite number"):  # fmt: skip
        assert text in caplog.text


def glass(folder: Path, said: str) -> Path:
    (folder / "it.mtl").write_text(f"newmtl glass\n{said}\n")
    (folder / "it.obj").write_text("mtllib it.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl glass\nf 1 2 3\n")
    return folder / "it.obj"


def test_missing_images_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    image = Image.fromarray(np.zeros((4, 4, 3), np.uint8))
    for name, data in trimesh.Scene(square(image=image)).export(file_type="gltf").items():
        (tmp_path / name).write_bytes(data)
    tree = json.loads((tmp_path / "model.gltf").read_bytes())
    tree["images"] = [{"uri": "gone.png"}]
    (tmp_path / "model.gltf").write_text(json.dumps(tree))
    scene = wc.load(tmp_path / "model.gltf", device=device)
    assert seen(scene)[8, 8].tolist() == [255] * 3
    assert "gone.png" in caplog.text


BROKEN = {"empty.obj": b"", "points.obj": b"v 0 0 0\nv 1 0 0\n", "text.glb": b"nothing", "text.ply": b"ply\nnothing"}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(BROKEN[name])
    with pytest.raises(wc.WarpcamError, match=name):
        wc.load(tmp_path / name, device="cpu")


def test_indices_out_of_range_and_infinite_vertices(tmp_path: Path) -> None:
    data = io.BytesIO(square().export(file_type="glb")).getvalue()
    bad = data.replace(np.array((-1, 0, 1), np.float32).tobytes(), np.array((np.inf, 0, 1), np.float32).tobytes())
    assert bad != data
    (tmp_path / "it.glb").write_bytes(bad)
    with pytest.raises(wc.WarpcamError, match="vertices must be finite"):
        wc.load(tmp_path / "it.glb", device="cpu")


BAD_CALLS = {
    "load: there is no file 'gone.glb'": ("gone.glb", {}),
    "load: 'it.fbx' came; known are .xml, .mjb, .urdf, .usd, .usda, .usdc, .usdz, .glb": ("it.fbx", {}),
    "load: path must be a path, got int": (3, {}),
    "num_worlds must be a whole number, at least 1, got 0": (__file__.replace(".py", ".stl"), {"num_worlds": 0}),
    "up_axis must be \"Z\", or None for the file's own axes, got 'Y'": ("here.stl", {"up_axis": "Y"}),
    "meters_per_unit must be a positive number, got -1": ("here.stl", {"meters_per_unit": -1}),
    "meters_per_unit must be a positive number, got True": ("here.stl", {"meters_per_unit": True}),
    "textures must map names to images, got list": ("broken.glb", {"textures": ["a"]}),
    "transparency must be True, False or None, got 1": ("broken.glb", {"transparency": 1}),
}


@pytest.mark.parametrize("text", BAD_CALLS)
def test_bad_calls(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path, arguments = BAD_CALLS[text]
    if arguments:
        path = "broken.glb" if path == "broken.glb" else "here.stl"
        trimesh.creation.box().export(tmp_path / "here.stl")
        (tmp_path / "broken.glb").write_bytes(b"glTF")
    with pytest.raises(wc.WarpcamError) as caught:
        wc.load(path, device="cpu", **arguments)
    assert text in str(caught.value)


def test_mjcf_and_urdf_are_read_by_mujoco(tmp_path: Path, device: wp.Device) -> None:
    pytest.importorskip("mujoco_warp")
    urdf = (
        '<robot name="r"><link name="l"><collision><geometry><box size="1 2 3"/></geometry></collision></link></robot>'
    )
    (tmp_path / "it.urdf").write_text(urdf)
    (tmp_path / "it.xml").write_text("<mujoco><worldbody><geom type='box' size='.5 1 1.5'/></worldbody></mujoco>")
    for name in ("it.urdf", "it.xml"):
        scene = wc.load(tmp_path / name, 3, device=device)
        assert scene.num_worlds == 3
        np.testing.assert_allclose(scene.bounds()[1], (0.5, 1.0, 1.5), atol=1e-6)
        assert isinstance(Around(*scene.bounds(), (1, 1, 1)), Around)


def test_formats_of_the_command_line(tmp_path: Path) -> None:
    from warpcam.tools import cli

    scene_of_parts().export(tmp_path / "it.glb")
    trimesh.creation.box().export(tmp_path / "it.stl")
    (tmp_path / "it.usda").write_text('#usda 1.0\n(metersPerUnit = 1)\ndef Cube "c" {}\n')
    urdf = '<robot name="r"><link name="l"><visual><geometry><box size="1 2 3"/></geometry></visual></link></robot>'
    (tmp_path / "it.urdf").write_text(urdf)
    for name in ("it.glb", "it.stl", "it.usda"):
        out = tmp_path / f"out-{name}"
        arguments = ["render", str(tmp_path / name), "--device", "cpu", "--worlds", "2", "--size", "24x24"]
        assert cli.main([*arguments, "--outputs", "depth,semantics,instances", "--out", str(out)]) == 0
        picture = np.asarray(Image.open(out / "free-depth.png"))
        assert picture[:, :24].std() > 1.0
