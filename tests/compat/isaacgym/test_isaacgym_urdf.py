"""URDF files by the front end of Isaac Gym: units, joints that cannot move, meshes that cannot be read."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import warpcam as wc

pytest.importorskip("newton")
trimesh = pytest.importorskip("trimesh")
pytest.importorskip("collada")

from warpcam.compat.isaacgym import gymapi  # noqa: E402

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    "{}</link>"
)
BOX = '<{0}><geometry><box size="1 1 1"/></geometry></{0}>'
MESH = '<{0}><geometry><mesh filename="{1}"/></geometry></{0}>'
JOINT = '<joint name="{}" type="{}"><parent link="a"/><child link="{}"/>{}</joint>'
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


@pytest.fixture
def sim() -> Any:
    gym, params = gymapi.acquire_gym(), gymapi.SimParams()
    params.up_axis, params.use_gpu_pipeline = gymapi.UP_AXIS_Z, False
    sim = gym.create_sim(-1, 0, gymapi.SIM_PHYSX, params)
    yield sim
    gym.destroy_sim(sim)


def asset(sim: Any, folder: Path, text: str, **options: Any) -> Any:
    (folder / "it.urdf").write_text(f'<robot name="r">{text}</robot>')
    chosen = gymapi.AssetOptions()
    for name, value in options.items():
        setattr(chosen, name, value)
    return gymapi.acquire_gym().load_asset(sim, str(folder), "it.urdf", chosen)


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_units_of_collada(unit: float, sim: Any, tmp_path: Path) -> None:
    text = trimesh.creation.box((1 / unit, 2 / unit, 3 / unit)).export(file_type="dae").decode()
    head, tail = text.split("<asset>", 1)
    own = tail.split("</asset>", 1)[1]
    (tmp_path / "it.dae").write_text(f'{head}<asset><unit meter="{unit}"/></asset>{own}')
    made = asset(sim, tmp_path, LINK.format("a", MESH.format("visual", "it.dae") + MESH.format("collision", "it.dae")))
    for source in made.builder.shape_source:
        np.testing.assert_allclose(np.ptp(source.vertices, axis=0), (1, 2, 3), rtol=1e-5)
    assert len(made.builder.shape_source) == 2


@pytest.mark.parametrize(
    ("kind", "other", "text"),
    [
        ("fixed", "fixed", "is a fixed joint, and its <mimic> does nothing: j2"),
        ("fixed", "revolute", "is a fixed joint, and its <mimic> does nothing: j2"),
        ("revolute", "fixed", "mimics 'j1', which is a fixed joint, and moves by itself: j2"),
        ("revolute", "", "mimics 'gone', which is no joint of the robot, and moves by itself: j2"),
        ("revolute", "revolute", ""),
    ],
)
def test_mimics(kind: str, other: str, text: str, sim: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    mimic = f'<mimic joint="{"j1" if other else "gone"}" multiplier="1" offset="0"/>'
    robot = "".join(LINK.format(name, BOX.format("visual")) for name in "abc")
    robot += JOINT.format("j1", other or "fixed", "b", LIMIT) + JOINT.format("j2", kind, "c", LIMIT + mimic)
    made = asset(sim, tmp_path, robot)
    assert len(made.bodies) == 3 and text in caplog.text and bool(caplog.text) == bool(text)


def test_meshes_that_cannot_be_read(sim: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    lost = MESH.format("visual", "gone.obj") + BOX.format("collision") + MESH.format("collision", "gone.stl")
    made = asset(sim, tmp_path, LINK.format("a", lost) + LINK.format("b", BOX.format("visual")) +
                 JOINT.format("j", "fixed", "b", ""))  # fmt: skip
    assert len(made.builder.shape_type) == 3 and len(made.solid) == 1
    assert "shows its collision shapes, as a mesh cannot be read" in caplog.text and "gone.obj" in caplog.text
    assert "has a collision shape that cannot be read" in caplog.text and "gone.stl" in caplog.text


def test_robots_without_shapes(sim: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert len(asset(sim, tmp_path, LINK.format("a", "")).bodies) == 1
    assert "no link has a visual or collision shape that can be drawn" in caplog.text


def test_errors_have_reasons(sim: Any, tmp_path: Path) -> None:
    for text, reason in (("<link/>", "cannot be read: .*Link has no name"), ("", "it.urdf: has no links")):
        with pytest.raises(wc.WarpcamError, match=reason):
            asset(sim, tmp_path, text)
    (tmp_path / "it.urdf").write_text("<robot")
    with pytest.raises(wc.WarpcamError, match="is no URDF file"):
        gymapi.acquire_gym().load_asset(sim, str(tmp_path), "it.urdf", gymapi.AssetOptions())


@pytest.mark.parametrize(("suffix", "right"), [("stl", (1, 3, 2)), ("dae", (1, 2, 3))])
def test_flipped_visuals(suffix: str, right: tuple[int, ...], sim: Any, tmp_path: Path) -> None:
    data = trimesh.creation.box((1, 2, 3)).export(file_type=suffix)
    (tmp_path / f"it.{suffix}").write_bytes(data)
    name = f"it.{suffix}"
    made = asset(sim, tmp_path, LINK.format("a", MESH.format("visual", name) + MESH.format("collision", name)),
                 flip_visual_attachments=True)  # fmt: skip
    seen, touched = made.builder.shape_source
    np.testing.assert_allclose(np.ptp(seen.vertices, axis=0), right, rtol=1e-5)
    np.testing.assert_allclose(np.ptp(touched.vertices, axis=0), (1, 2, 3), rtol=1e-5)
