"""Looks of a robot's meshes: those that files show alone, and those that the robot's own materials give."""

import logging
from pathlib import Path

import mujoco
import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.sources.mujoco import urdf

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("mujoco_warp")

QUARTERS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]
RED, GREEN, GREY = ([color] * 4 for color in ((255, 0, 0), (0, 255, 0), (128, 128, 128)))
PLATE = "mtllib it.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\n"
PLATE += "f 1/1 2/2 3/3 4/4\n"


def robot(folder: Path, visual: str, more: str = "", collision: str = "") -> Path:
    Image.fromarray(np.array(QUARTERS, np.uint8).reshape(2, 2, 3).repeat(32, 0).repeat(32, 1)).save(folder / "q.png")
    path = folder / "it.urdf"
    path.write_text(f'<robot name="r">{more}<link name="a">{visual}{collision}</link></robot>')
    return path


def plate(folder: Path, mtl: str) -> str:
    (folder / "it.mtl").write_text(f"newmtl m\n{mtl}\n")
    (folder / "it.obj").write_text(PLATE)
    return '<geometry><mesh filename="it.obj"/></geometry>'


def corners(path: Path, device: wp.Device, height: float = 3.0) -> list[tuple[int, ...]]:
    turn = (1.0, 0.0, 0.0, 0.0) if height > 0.0 else (0.0, 1.0, 0.0, 0.0)
    camera = wc.Camera(
        "c", width=8, height=8, lens=wc.Orthographic(height=2.0), position=(0, 0, height), rotation=turn,
        outputs=("albedo",),
    )  # fmt: skip
    image = wc.Renderer(wc.load(path, device=device), [camera]).render()["c"]["albedo"][0].cpu().numpy()
    return [tuple(map(int, image[row, column])) for row in (1, 6) for column in (1, 6)]


@pytest.mark.parametrize(
    ("mtl", "material", "more", "right"),
    [
        ("map_Kd q.png", "", "", QUARTERS),
        ("Kd 1 0 0", "", "", RED),
        ("Ns 1", "", "", [(118, 118, 118)] * 4),
        ("Kd 1 0 0", '<material name="x"><color rgba="0 1 0 1"/></material>', "", GREEN),
        ("Kd 1 0 0", '<material name="x"/>', '<material name="x"><color rgba="0 1 0 1"/></material>', GREEN),
        ("Kd 1 0 0", '<material name="unknown"/>', "", RED),
        ("map_Kd q.png", '<material name="x"><color rgba="0 1 0 1"/></material>', "", GREEN),
        ("Kd 1 0 0", '<material name="x"><texture filename="q.png"/></material>', "", QUARTERS),
        ("Kd 1 0 0", '<material name="x"/>', '<material name="x"><texture filename="q.png"/></material>', QUARTERS),
        ("Kd 1 0 0", '<material name="x"><texture/><color rgba="0 1 0 1"/></material>', "", GREEN),
        ("Kd 1 0 0", '<material name="x"><texture filename="gone.png"/></material>', "", RED),
    ],
)
def test_looks_of_a_plate(
    mtl: str, material: str, more: str, right: list[tuple[int, ...]], tmp_path: Path, device: wp.Device
) -> None:
    path = robot(tmp_path, f"<visual>{plate(tmp_path, mtl)}{material}</visual>", more)
    assert np.abs(np.subtract(corners(path, device), right)).max() <= 1


def test_a_plate_is_seen_from_behind(tmp_path: Path, device: wp.Device) -> None:
    path = robot(tmp_path, f"<visual>{plate(tmp_path, 'Kd 1 0 0')}</visual>")
    assert corners(path, device, -3.0) == RED


def test_a_colour_stays_with_its_shape(tmp_path: Path) -> None:
    box = '<geometry><box size="1 1 1"/></geometry>'
    green = '<material name="g"><color rgba="0 1 0 0.5"/></material>'
    model = urdf.load(robot(tmp_path, f"<visual>{box}{green}</visual><visual>{box}</visual>"))
    np.testing.assert_allclose(model.geom_rgba, [(0, 1, 0, 0.5), (0.5, 0.5, 0.5, 1)])


def test_parts_of_several_looks(tmp_path: Path) -> None:
    (tmp_path / "it.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nmap_Kd q.png\nd 0.5\n")
    text = PLATE.replace("usemtl m\nf", "usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf")
    (tmp_path / "it.obj").write_text(text)
    mesh = '<visual><geometry><mesh filename="it.obj" scale="1 2 3"/></geometry></visual>'
    model = urdf.load(robot(tmp_path, mesh))
    assert (model.ngeom, model.nmesh, model.ntex) == (2, 2, 1)
    assert sorted(map(tuple, model.geom_rgba.tolist())) == [(1.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0, 0.5)]


FORMATS = ("dae", "glb", "obj", "ply", "stl", "stl_ascii")


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_has_its_size_and_place(kind: str, tmp_path: Path, device: wp.Device) -> None:
    mesh = trimesh.creation.box((1, 2, 3))
    mesh.apply_translation((0.5, 1.0, 1.5))
    name = f"it.{kind.partition('_')[0]}"
    data = mesh.export(file_type=kind)
    (tmp_path / name).write_bytes(data.encode() if isinstance(data, str) else data)
    origin = '<origin xyz="0 0 1" rpy="0 0 0"/>'
    path = robot(tmp_path, f'<visual>{origin}<geometry><mesh filename="{name}" scale="1 1 -2"/></geometry></visual>')
    low, high = wc.load(path, device=device).bounds()
    np.testing.assert_allclose((low, high), ((0, 0, -5), (1, 2, 1)), atol=1e-5)


def test_a_mesh_of_many_faces(tmp_path: Path) -> None:
    """MuJoCo itself reads STL files of at most 200,000."""
    trimesh.creation.icosphere(subdivisions=7).export(tmp_path / "it.stl")
    model = urdf.load(robot(tmp_path, '<visual><geometry><mesh filename="it.stl"/></geometry></visual>'))
    assert model.nmeshface == 327680


@pytest.mark.parametrize("vertices", [3, 4])
def test_flat_meshes_touch_nothing(vertices: int, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    plate(tmp_path, "Kd 1 0 0")
    if vertices == 3:
        (tmp_path / "it.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh = '<geometry><mesh filename="it.obj"/></geometry>'
    model = urdf.load(robot(tmp_path, f"<visual>{mesh}</visual>", collision=f"<collision>{mesh}</collision>"))
    assert model.ngeom == 2 and not model.geom_contype.any()
    assert "has meshes that collide with nothing, as MuJoCo makes no hull of one" in caplog.text


BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'


def test_fallbacks_are_those_of_a_link(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """One mesh is not there: its link shows its collision shape, and the other link is as it was."""
    path = robot(tmp_path, f"<visual>{plate(tmp_path, 'Kd 1 0 0')}</visual>", collision=BOX)
    lost = '<visual><geometry><mesh filename="package://nowhere/gone.dae"/></geometry></visual>'
    path.write_text(
        path.read_text().replace(
            "</robot>",
            f'<link name="b">{lost}{BOX}</link><link name="c">{lost}</link>'
            '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
            '<joint name="k" type="fixed"><parent link="a"/><child link="c"/></joint></robot>',
        )
    )
    model = urdf.load(path)
    assert model.geom_group.tolist() == [1, 3, 0]
    assert "shows its collision shapes, as a mesh cannot be read" in caplog.text and "gone.dae" in caplog.text
    assert "lacks a shape that is there to be seen" in caplog.text and "link c" in caplog.text
    assert len([record for record in caplog.records if record.levelno >= logging.WARNING]) == 2


def test_fallbacks_keep_paths_and_settings(tmp_path: Path) -> None:
    """The collision mesh is of a package, and links have neither mass nor inertia."""
    folder = tmp_path / "arm" / "urdf"
    folder.mkdir(parents=True)
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "arm" / "box.stl")
    (tmp_path / "arm" / "package.xml").touch()
    lost = '<visual><geometry><mesh filename="package://arm/gone.dae"/></geometry></visual>'
    mesh = '<collision><geometry><mesh filename="package://arm/box.stl"/></geometry></collision>'
    path = robot(folder, lost, collision=mesh)
    joint = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
    path.write_text(path.read_text().replace("</robot>", f'<link name="b">{BOX}</link>{joint}</robot>'))
    model = urdf.load(path)
    assert (model.ngeom, model.njnt, model.nmesh) == (2, 1, 1)


def test_robots_without_shapes_say_so(tmp_path: Path) -> None:
    with pytest.raises(wc.WarpcamError, match="nothing of it can be drawn: no link has a visual or collision shape"):
        wc.load(robot(tmp_path, ""), device="cpu")
    lost = '<visual><geometry><mesh filename="gone.dae"/></geometry></visual>'
    with pytest.raises(wc.WarpcamError, match=r"nothing of it can be drawn: .*gone\.dae: there is no such file"):
        wc.load(robot(tmp_path, lost), device="cpu")


def test_inertias_that_no_body_has(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="2" ixz="0" iyz="0"/>'
    path = robot(tmp_path, "", collision=BOX)
    joint = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
    second = f'<link name="b"><inertial><mass value="1"/>{inertia}</inertial>{BOX}</link>'
    path.write_text(path.read_text().replace("</robot>", f"{second}{joint}</robot>"))
    assert urdf.load(path).njnt == 1
    assert "has an inertia that no body has, and gets a small one: link b" in caplog.text


@pytest.mark.parametrize("name", ["package://arm/box.stl", "model://arm/box.stl", "package://arm/b%6fx.stl"])
def test_packages_are_found(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the argument; by ROS's variables; in folders above, also where the folder is not called as the package is."""
    mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    (tmp_path / "x" / "urdf").mkdir(parents=True)
    path = robot(tmp_path / "x" / "urdf", mesh)
    there = tmp_path / "elsewhere" / "share" / "arm"
    there.mkdir(parents=True)
    trimesh.creation.box().export(there / "box.stl")
    with pytest.raises(wc.WarpcamError, match=r"box\.stl|b%6fx\.stl"):
        wc.load(path, device="cpu")
    assert wc.load(path, device="cpu", packages={"arm": there}).bounds()[1][0] == 0.5
    for variable, value in (("ROS_PACKAGE_PATH", there.parent), ("AMENT_PREFIX_PATH", there.parents[1])):
        with monkeypatch.context() as patch:
            patch.setenv(variable, f"/nowhere:{value}")
            assert urdf.load(path).nmesh == 1
    (there / "box.stl").rename(tmp_path / "x" / "box.stl")
    with pytest.raises(wc.WarpcamError, match=r"outside of the scene's folder '.*/x/urdf'; .* search_paths=\['.*/x'\]"):
        urdf.load(path)
    (tmp_path / "x" / "package.xml").touch()
    assert urdf.load(path).nmesh == 1


LAYOUTS = [
    ("repo/robots/it.urdf", "repo/meshes/b.stl", "package://repo/meshes/b.stl"),
    ("repo/arm/urdf/it.urdf", "repo/arm/meshes/b.stl", "package://arm/meshes/b.stl"),
    ("repo/arm_bringup/urdf/it.urdf", "repo/arm/meshes/b.stl", "package://arm/meshes/b.stl"),
    ("arm-1a2b3c/urdf/it.urdf", "arm-1a2b3c/meshes/b.stl", "package://arm/meshes/b.stl"),
    ("repo/urdf/it.urdf", "repo/arm/meshes/b.stl", "package://arm/meshes/b.stl"),
    ("repo/robots/urdf/it.urdf", "repo/packages/arm/meshes/b.stl", "package://arm/meshes/b.stl"),
    ("space/robots/it.urdf", "space/src/arm/meshes/b.stl", "package://arm/meshes/b.stl"),
    ("data/robots/arm/urdf/it.urdf", "data/robots/arm/meshes/b.stl", "package://data/robots/arm/meshes/b.stl"),
    ("repo/urdf/it.urdf", "repo/meshes/b.stl", "package://meshes/b.stl"),
    ("repo/urdf/it.urdf", "repo/meshes/b.stl", "../meshes/b.stl"),
    ("repo/urdf/it.urdf", "repo/meshes/b.stl", "meshes/b.stl"),
    ("repo/arm/urdf/it.urdf", "repo/arm/meshes/b.stl", "file://$(find arm)/meshes/b.stl"),
    ("repo/bringup/urdf/it.urdf", "repo/arm/meshes/b.stl", "$(find-pkg-share arm)/meshes/b.stl"),
]


@pytest.mark.parametrize(("path", "there", "name"), LAYOUTS)
def test_layouts_of_repositories(path: str, there: str, name: str, tmp_path: Path) -> None:
    """Meshes are found without an argument, in packages and in folders of meshes beside the file's."""
    for folder in (path, there):
        (tmp_path / folder).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / there).parents[1].joinpath("package.xml").touch()
    trimesh.creation.box().export(tmp_path / there)
    mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    robot((tmp_path / path).parent, mesh)
    assert urdf.load(tmp_path / path).nmesh == 1


@pytest.mark.parametrize("name", ["m.stl", "./m.stl", "file://{}/m.stl", "file:{}/m.stl", "file://localhost{}/m.stl"])
def test_plain_paths(name: str, tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "m.stl")
    mesh = f'<visual><geometry><mesh filename="{name.format(tmp_path)}"/></geometry></visual>'
    assert urdf.load(robot(tmp_path, mesh)).nmesh == 1


def test_bad_packages(tmp_path: Path) -> None:
    path = robot(tmp_path, "", collision=BOX)
    for packages, text in (
        (["a"], "load: packages must map names to folders, got list"),
        ({"a": 3}, "load: packages must map names to folders, got 'a': 3"),
        ({"a": "/nowhere"}, "load: packages: 'a': there is no folder '/nowhere'"),
    ):
        with pytest.raises(wc.WarpcamError, match=text):
            wc.load(path, device="cpu", packages=packages)  # type: ignore[arg-type]
    (tmp_path / "it.stl").write_bytes(b"")
    with pytest.raises(wc.WarpcamError, match=r"load: packages is for \.urdf files, not for \.stl files"):
        wc.load(tmp_path / "it.stl", device="cpu", packages={"a": tmp_path})


def test_scales_of_nothing(tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "m.stl")
    for scale in ("0 1 1", "1 1", "x", "nan 1 1"):
        mesh = f'<visual><geometry><mesh filename="m.stl" scale="{scale}"/></geometry></visual>'
        with pytest.raises(ValueError, match="scale of a mesh must be three numbers other than zero, got"):
            urdf.load(robot(tmp_path, mesh))


def test_names_of_shapes_are_kept_once(tmp_path: Path) -> None:
    visual = '<visual name="v"><geometry><box size="1 1 1"/></geometry></visual>'
    model = urdf.load(robot(tmp_path, visual * 2))
    assert [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) for geom in (0, 1)] == ["v", None]
