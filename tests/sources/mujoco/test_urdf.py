"""URDF files: what is there to be seen is drawn, and meshes are found by the packages that they name."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.sources.mujoco import urdf

BOX = '<collision><geometry><box size="4 4 4"/></geometry></collision>'
MESH = '<visual><geometry><mesh filename="{}" scale="1 1 2"/></geometry></visual>'
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)) + (
    "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
)


def write(folder: Path, links: str, more: str = "") -> Path:
    """A robot in the folder of a package, with a mesh beside."""
    (folder / "arm" / "urdf").mkdir(parents=True)
    (folder / "arm" / "meshes").mkdir()
    (folder / "arm" / "meshes" / "cube.obj").write_text(CUBE)
    path = folder / "arm" / "urdf" / "arm.urdf"
    path.write_text(f'<robot name="r">{more}<link name="a">{links}</link></robot>')
    return path


@pytest.mark.parametrize("name", ["package://arm/", "model://arm/", "../", "file://{}/arm/"])
def test_what_is_there_to_be_seen_is_drawn(name: str, tmp_path: Path, device: wp.Device) -> None:
    """And what is there to be touched is not."""
    pytest.importorskip("mujoco_warp")
    path = write(tmp_path, MESH.format(name.format(tmp_path) + "meshes/cube.obj") + BOX)
    np.testing.assert_allclose(wc.load(path, 2, device=device).bounds()[1], (1.0, 1.0, 2.0), atol=1e-6)


def test_other_packages_are_found_by_the_variable_of_ros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "here", MESH.format("package://parts/cube.obj"))
    (tmp_path / "there" / "parts").mkdir(parents=True)
    (tmp_path / "there" / "parts" / "cube.obj").write_text(CUBE)
    with pytest.raises(ValueError, match=r"cube\.obj"):
        urdf.load(path)
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{tmp_path / 'there'}")
    assert urdf.load(path).nmesh == 1


@pytest.mark.parametrize("mesh", ["package://arm/meshes/none.obj", "package://arm/meshes/cube.dae"])
def test_collision_shapes_are_drawn_where_there_is_nothing_else(
    mesh: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    alone = urdf.load(write(tmp_path / "alone", BOX))
    assert (alone.ngeom, list(alone.geom_group)) == (1, [0]) and not caplog.text
    path = write(tmp_path / "both", MESH.format(mesh) + BOX)
    path.with_name("cube.dae").write_text("<COLLADA/>")
    unread = urdf.load(path)
    assert (unread.ngeom, unread.geom_type[0]) == (1, mujoco.mjtGeom.mjGEOM_BOX)
    assert "shows its collision shapes, as a mesh cannot be read" in caplog.text and "link a" in caplog.text


def test_what_the_file_says_counts(tmp_path: Path) -> None:
    more = '<mujoco><compiler discardvisual="true" meshdir="../meshes"/></mujoco>'
    assert urdf.load(write(tmp_path / "a", MESH.format("cube.obj") + BOX, more)).ngeom == 1
    more = '<mujoco><compiler meshdir="../meshes"/></mujoco>'
    assert urdf.load(write(tmp_path / "b", MESH.format("package://x/cube.obj") + BOX, more)).nmesh == 1


def test_links_without_inertia(tmp_path: Path) -> None:
    path = write(tmp_path, BOX)
    path.write_text(
        path.read_text().replace(
            "</robot>",
            '<link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>',
        )
    )
    assert urdf.load(path).njnt == 1


@pytest.mark.parametrize("text", ["<robot", '<robot name="r"><link/></robot>', "\xff", "<mujoco><geom/></mujoco>"])
def test_bad_files(text: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp")
    (tmp_path / "it.urdf").write_text(text, encoding="latin-1")
    with pytest.raises(wc.WarpcamError, match="scene: MuJoCo cannot read"):
        wc.load(tmp_path / "it.urdf", device="cpu")
