"""wc.add_urdf: robots for Newton with meshes as their files say."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc

newton = pytest.importorskip("newton")
trimesh = pytest.importorskip("trimesh")
pytest.importorskip("collada")

QUARTERS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'


def robot(folder: Path, visual: str, more: str = "") -> Path:
    path = folder / "it.urdf"
    path.write_text(f'<robot name="r"><link name="a">{INERTIAL}{visual}</link>{more}</robot>')
    return path


def mesh(name: str, material: str = "") -> str:
    return f'<visual><geometry><mesh filename="{name}"/></geometry>{material}</visual>'


def scene_of(path: Path, **options: object) -> tuple[newton.Model, wc.Scene]:
    builder = newton.ModelBuilder()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of pycollada
        wc.add_urdf(builder, path, **options)  # type: ignore[arg-type]
    model = builder.finalize(device="cpu")
    return model, wc.from_newton(model, model.state())


def corners(scene: wc.Scene) -> list[tuple[int, ...]]:
    camera = wc.Camera(
        "c", width=8, height=8, lens=wc.Orthographic(height=2.0), position=(0, 0, 9), outputs=("albedo",)
    )
    image = wc.Renderer(scene, [camera]).render()["c"]["albedo"][0].numpy()
    return [tuple(map(int, image[row, column])) for row in (1, 6) for column in (1, 6)]


def box_in(unit: float, path: Path) -> None:
    """A box of 1 x 2 x 3 m in a COLLADA file of that unit."""
    text = trimesh.creation.box((1 / unit, 2 / unit, 3 / unit)).export(file_type="dae").decode()
    assert "<asset>" in text
    head, tail = text.split("<asset>", 1)
    own = tail.split("</asset>", 1)[1]
    path.write_text(f'{head}<asset><unit meter="{unit}"/><up_axis>Z_UP</up_axis></asset>{own}')


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.0254, 1000.0])
def test_units_of_collada(unit: float, tmp_path: Path) -> None:
    box_in(unit, tmp_path / "it.dae")
    low, high = scene_of(robot(tmp_path, mesh("it.dae")))[1].bounds()
    np.testing.assert_allclose(high - low, (1, 2, 3), rtol=1e-5)
    low, high = scene_of(robot(tmp_path, mesh("it.dae")), scale=2.0)[1].bounds()
    np.testing.assert_allclose(high - low, (2, 4, 6), rtol=1e-5)


@pytest.mark.parametrize(
    ("mtl", "material", "right"),
    [
        ("map_Kd -s 1 1 1 q.png", "", QUARTERS),
        ("Kd 1 0 0", "", [(255, 0, 0)] * 4),
        ("map_Kd q.png", '<material name="x"><color rgba="0 1 0 1"/></material>', [(0, 255, 0)] * 4),
        ("Kd 1 0 0", '<material name="x"><texture filename="q.png"/></material>', QUARTERS),
    ],
)
def test_looks(mtl: str, material: str, right: list[tuple[int, ...]], tmp_path: Path) -> None:
    Image.fromarray(np.array(QUARTERS, np.uint8).reshape(2, 2, 3).repeat(32, 0).repeat(32, 1)).save(tmp_path / "q.png")
    (tmp_path / "other.mtl").write_text("newmtl other\n")
    (tmp_path / "it.mtl").write_text(f"newmtl m\n{mtl}\n")
    (tmp_path / "it.obj").write_text(
        "mtllib other.mtl\nmtllib it.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        "usemtl m\nf 1/1 2/2 3/3 4/4\n"
    )
    assert corners(scene_of(robot(tmp_path, mesh("it.obj", material)))[1]) == right


def test_fallbacks_and_packages(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = robot(tmp_path, mesh("package://arm/it.stl") + BOX)
    model, scene = scene_of(path)
    assert model.shape_count == 2  # the box to be touched, and to be seen
    np.testing.assert_allclose(scene.bounds()[1], (0.5, 0.5, 0.5))
    assert "shows its collision shapes, as a mesh cannot be read" in caplog.text and "link a" in caplog.text
    (tmp_path / "there").mkdir()
    trimesh.creation.box((4, 4, 4)).export(tmp_path / "there" / "it.stl")
    np.testing.assert_allclose(scene_of(path, packages={"arm": tmp_path / "there"})[1].bounds()[1], (2, 2, 2))


def test_options_are_newtons(tmp_path: Path) -> None:
    model, _ = scene_of(robot(tmp_path, BOX), floating=True, xform=wp.transform((1, 2, 3), wp.quat_identity()))
    np.testing.assert_allclose(model.joint_q.numpy()[:3], (1, 2, 3))


def test_bad_calls(tmp_path: Path) -> None:
    for arguments, text in (
        ((3, "it.urdf"), "add_urdf: builder must be a newton.ModelBuilder, got int"),
        ((newton.ModelBuilder(), 3), "add_urdf: path must be a path, got int"),
        ((newton.ModelBuilder(), "gone.urdf"), "add_urdf: there is no file 'gone.urdf'"),
    ):
        with pytest.raises(wc.WarpcamError, match=text):
            wc.add_urdf(*arguments)  # type: ignore[arg-type]
    for text in ("<robot", "<mujoco/>"):
        (tmp_path / "it.urdf").write_text(text)
        with pytest.raises(wc.WarpcamError, match="is no URDF file"):
            wc.add_urdf(newton.ModelBuilder(), tmp_path / "it.urdf")


def test_units_that_newton_leaves_out_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A box of 1 x 2 x 3 m in centimetres is 300 m long by Newton's own importer."""
    for unit, told in ((1.0, 0), (0.01, 1)):
        box_in(unit, tmp_path / "it.dae")
        builder = newton.ModelBuilder()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            builder.add_urdf(str(robot(tmp_path, mesh("it.dae"))))
        model = builder.finalize(device="cpu")
        wc.from_newton(model, model.state())
        assert caplog.text.count("Newton's importers leave out the <unit> of COLLADA files") == told
