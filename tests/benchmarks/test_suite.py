"""Generated scenes and scenes of one's own: how they are built and measured, and how ratios are spread over them."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")

import mujoco

from warpcam.benchmarks import distribution, measure, own_scene, problem, report, runner, suite
from warpcam.benchmarks.suite import recipes, solids
from warpcam.tools import cli

TINY = ("--worlds", "2", "--size", "16x16", "--replays", "2", "--device", "cpu")
ROBOT = """<robot name="arm"><link name="base"><visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual></link>
<link name="tip"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="0 0 0.4"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
MODEL = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="1 1 1"/>
<camera name="left" pos="-1 -2 1" xyaxes="1 0 0 0 0.4 0.9"/><camera pos="1 -2 1" xyaxes="1 0 0 0 0.4 0.9"/>
<body pos="0 0 0.3"><joint type="slide" axis="0 0 1"/><geom size="0.2"/></body></worldbody>
<keyframe><key qpos="0.5"/></keyframe></mujoco>"""
STAGE = """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Y"
)
def Sphere "Ball"
{
    double radius = 0.5
    color3f[] primvars:displayColor = [(1, 0, 0)]
}
def Cone "Cone"
{
    double3 xformOp:translate = (2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Mesh "Tent"
{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(-2, 0, 0), (-1, 0, 0), (-1, 1, 0)]
}
def DistantLight "Sun"
{
    float inputs:intensity = 2
}
def SphereLight "Lamp"
{
    double3 xformOp:translate = (0, 3, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
STILL = "<mujoco><worldbody><geom size='0.3' pos='1 0 0'/></worldbody></mujoco>"


def bench(*arguments: Any) -> int:
    return cli.main(["bench", *map(str, arguments)])


def rows_of(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(path.read_text())["results"]
    return rows


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_halves_are_equal_and_share_nothing() -> None:
    tuning, held_out, both = (recipes.recipes_of(half) for half in ("tuning", "held-out", "all"))
    assert len(both) >= 40 and len(tuning) == len(held_out) == len(both) / 2
    assert {recipe.seed for recipe in tuning}.isdisjoint(recipe.seed for recipe in held_out)
    assert sorted(r.family for r in tuning) == sorted(r.family for r in held_out)
    # Neither half may ever get a scene of the other's.
    assert [r.name for r in tuning[:2]] == ["pile_00", "table_01"]
    assert [r.name for r in held_out[:2]] == ["pile_12", "table_13"]
    for half in (tuning, held_out):
        assert min(r.shapes for r in half) < 40 and max(r.shapes for r in half) > 4000
        assert {"none", "hills"} < {r.floor for r in both} and len({r.lights for r in half}) > 3
        assert {r.light for r in half} == {"sun", "lamps", "bulbs"}
        assert {r.textures for r in half} == {0.0, 0.3, 0.9}


@pytest.mark.parametrize("recipe", recipes.recipes_of("all"), ids=lambda recipe: recipe.name)
def test_scene_is_what_its_recipe_says(recipe: recipes.Recipe) -> None:
    mjm = suite.build(recipe.seed).compile()
    assert mjm.ngeom == pytest.approx(recipe.shapes, rel=0.06, abs=2)
    assert mjm.nlight == recipe.lights and mjm.light_castshadow.sum() == recipe.casting
    assert (mjm.ntex > 0) == (recipe.textures > 0.0 or "textured" in recipe.floor)
    grounds = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    assert np.isin(mjm.geom_type, grounds).any() == (recipe.floor != "none")
    moving = (mjm.body_weldid[mjm.geom_bodyid] != 0).mean()
    assert moving > 0.0
    if recipe.family in ("kitchen", "flat", "office", "store"):
        assert moving < 0.12
    # Kernels of peers hold both: with other values each scene would need kernels of its own.
    assert float(mjm.vis.map.znear * mjm.stat.extent) == 0.015625 and float(mjm.vis.map.zfar * mjm.stat.extent) == 256.0


def test_scene_is_the_same_each_time() -> None:
    first, second = (suite.build(26).compile() for _ in range(2))
    for name in ("geom_pos", "geom_size", "geom_rgba", "mesh_vert", "tex_data", "light_pos"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize("kind", list(solids.SOLIDS))
@pytest.mark.parametrize("faces", [300, 5000])
def test_solid_is_closed_and_has_about_its_faces(kind: str, faces: int) -> None:
    trimesh = pytest.importorskip("trimesh")
    solid = solids.SOLIDS[kind](np.random.default_rng(3), faces)
    mesh = trimesh.Trimesh(solid.points, solid.faces, process=False)
    assert mesh.is_watertight and mesh.volume > 0.0
    assert 0.7 * faces < len(solid.faces) < 1.4 * faces
    assert solid.corners.shape == solid.faces.shape and solid.corners.max() == len(solid.uvs) - 1


@pytest.mark.parametrize("seed", [0, 3, 9, 14])
def test_camera_sees_many_things(seed: int) -> None:
    """In each world, of some families: MuJoCo's rays from the camera hit many geoms, none of them close."""
    case = suite.case_of(recipes.recipe_of(seed))
    shared = problem.build(case, worlds=3, width=16, height=16)
    for world in range(3):
        data = mujoco.MjData(shared.mjm)
        data.qpos[:] = shared.positions(1)[world]
        mujoco.mj_kinematics(shared.mjm, data)
        mujoco.mj_camlight(shared.mjm, data)
        x, y = (0.4 * (axis - 12.0) / 12.0 for axis in np.meshgrid(np.arange(25), np.arange(25)))
        local = np.stack((x, y, np.full_like(x, -1.0)), -1).reshape(-1, 3)
        hit, distances = set(), []
        for ray in local @ data.cam_xmat[0].reshape(3, 3).T:
            geom = np.zeros(1, dtype=np.int32)
            distances.append(mujoco.mj_ray(shared.mjm, data, data.cam_xpos[0], ray, None, 1, -1, geom))
            hit.add(int(geom[0]))
        assert len(hit) >= 8
        found = np.array(distances)
        assert np.mean((found >= 0.0) & (found < 0.1)) < 0.3


def test_suite_is_measured_resumed_and_spread(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "suite.json"
    asked = ("--suite", "tuning", "--part", "1/24", "--peer", "mujoco_warp", "warpcam", *TINY, "--out", out)
    assert bench(*asked, "--outputs", "ds", "--seconds", "0") == 0
    assert "stopped after 0 s; --resume measures the rest" in capsys.readouterr().out
    assert [row["renderer"] for row in rows_of(out)] == ["mujoco_warp"]
    assert bench(*asked, "--outputs", "ds", "--resume") == 0
    rows = rows_of(out)
    assert [row["renderer"] for row in rows] == ["mujoco_warp", "warpcam"]
    assert {row["case"] for row in rows} == {"pile_00"} and rows[1]["best_peer"]["renderer"] == "mujoco_warp"
    assert json.loads(out.read_text())["kind"] == "suite" and len(json.loads(out.read_text())["runs"]) == 2
    said = capsys.readouterr().out
    assert "geometric mean" in said and "pile_00" in said

    def never(*arguments: Any) -> None:
        raise AssertionError("measured again")

    monkeypatch.setattr(runner.problem, "build", never)
    assert bench(*asked, "--outputs", "ds", "--resume") == 0
    assert rows_of(out) == rows


def test_what_failed_is_measured_again_on_resume(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    out = tmp_path / "suite.json"
    asked = ("--suite", "held-out", "--part", "1/24", "--peer", "warpcam", "--outputs", "ds", *TINY, "--out", out)
    build = problem.build

    def fail(*arguments: Any) -> None:
        raise RuntimeError("out of luck")

    monkeypatch.setattr(runner.problem, "build", fail)
    assert bench(*asked) == 1
    assert [row["renderer"] for row in rows_of(out)] == ["any"]
    monkeypatch.setattr(runner.problem, "build", build)
    assert bench(*asked, "--resume") == 0
    assert [row["renderer"] for row in rows_of(out)] == ["warpcam"]


def result(case: str, renderer: str, ms: float | None, outputs: str = "ds") -> dict[str, Any]:
    facts = {"case": case, "worlds": 4, "width": 8, "height": 8, "outputs": outputs, "renderer": renderer}
    return facts | ({"error": "Traceback:\nNo: luck"} if ms is None else {"ms": {"median": ms}})


def test_spread_of_ratios_counts_what_failed(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [result(f"s{index}", "warpcam", 1.0) for index in range(4)]
    rows += [result(f"s{index}", "newton", ms) for index, ms in enumerate((2.0, 8.0, None, None))]
    rows += [result(f"s{index}", "mujoco_warp", ms) for index, ms in enumerate((4.0, None, 4.0, None))]
    rows += [result("s4", "warpcam", None), result("s4", "newton", 1.0)]
    report.rank(rows)
    assert rows[0]["best_peer"] == {"renderer": "newton", "ratio": 2.0} and "failed_peers" not in rows[0]
    assert rows[1]["failed_peers"] == ["mujoco_warp"]
    assert "best_peer" not in rows[3] and rows[3]["failed_peers"] == ["newton", "mujoco_warp"]
    (found,) = distribution.spreads(rows).values()
    assert found.scenes == 3 and found.least == (2.0, "s0") and found.median == 4.0
    assert found.low == pytest.approx(2.4) and found.mean == pytest.approx(4.0)
    assert found.best == {"newton": 2, "mujoco_warp": 1}
    assert found.unranked == ["s3", "s4"]
    assert found.failed == {"newton": 2, "mujoco_warp": 2, "warpcam": 1}
    distribution.show({"results": rows})
    said = capsys.readouterr().out
    assert "newton 2, mujoco_warp 2, warpcam 1" in said and "s3, s4" in said
    assert "failed: s1 4 x 8x8 ds: mujoco_warp: No: luck" in said


def test_best_peer_follows_new_results() -> None:
    rows = [result("s", "warpcam", 1.0), result("s", "newton", 3.0)]
    report.rank(rows)
    assert rows[0]["best_peer"]["ratio"] == 3.0
    rows[1] = result("s", "newton", None)
    report.rank(rows)
    assert "best_peer" not in rows[0] and rows[0]["failed_peers"] == ["newton"]


@pytest.mark.parametrize(
    ("file", "text", "camera", "seen"),
    [
        ("mine.xml", MODEL, (), "left"),
        ("mine.xml", MODEL, ("--camera", "camera1"), "camera1"),
        ("arm.urdf", ROBOT, (), "whole scene"),
        ("stage.usda", STAGE, (), "whole scene"),
    ],
    ids=["MJCF", "camera without a name", "URDF", "USD"],
)
def test_scene_of_ones_own_is_measured(
    file: str, text: str, camera: tuple[str, ...], seen: str, tmp_path: Path
) -> None:
    if file.endswith("usda"):
        pytest.importorskip("pxr")
    path, out = written(tmp_path, file, text), tmp_path / "own.json"
    asked = ("--scene", path, *camera, "--peer", "mujoco_warp", "warpcam", "--outputs", "ds")
    assert bench(*asked, *TINY, "--out", out) == 0
    rows = rows_of(out)
    assert [row["renderer"] for row in rows] == ["mujoco_warp", "warpcam"] and rows[0]["case"] == path.stem
    assert rows[1]["difference"]["hit_fraction"] > 0.02 and rows[1]["difference"]["ids_mismatch"] <= 0.02
    assert own_scene.case_of(path, camera[1] if camera else None).cameras == (seen,)


@pytest.mark.parametrize(("ms", "frames"), [(0.01, 200), (10.0, 25), (60.0, 12), (250.0, 8), (5000.0, 4)])
def test_long_frames_are_timed_less_often(ms: float, frames: int) -> None:
    assert measure.frame_count(ms, sets=4) == frames


def test_own_scene_begins_at_its_keyframe(tmp_path: Path) -> None:
    shared = problem.build(own_scene.case_of(written(tmp_path, "key.xml", MODEL), None), 3, 8, 8)
    assert np.abs(shared.positions(0) - 0.5).max() < 0.06


SEEN = STILL.replace("<geom", "<camera name='eye' pos='1 -2 0.5' xyaxes='1 0 0 0 0.2 1' fovy='30'/><geom")


@pytest.mark.parametrize(("text", "name"), [(STILL, "whole scene"), (SEEN, "eye, swaying")], ids=["added", "its own"])
def test_camera_moves_where_nothing_else_does(text: str, name: str, tmp_path: Path) -> None:
    case = own_scene.case_of(written(tmp_path, "still.xml", text), None)
    shared = problem.build(case, 2, 8, 8)
    assert case.cameras == (name,)
    camera = shared.camera_ids[0]
    first, second = (poses["cam_xpos"].numpy()[:, camera] for poses in shared.poses[:2])
    assert (np.abs(first - second).max(axis=1) > 1e-4).all()
    assert np.abs(first - second).max() < 0.1
    if name != "whole scene":
        np.testing.assert_allclose(first, np.broadcast_to((1.0, -2.0, 0.5), (2, 3)), atol=0.05)
        assert shared.mjm.cam_fovy[camera] == 30.0


def test_stage_becomes_a_model(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    mjm = own_scene.read(written(tmp_path, "stage.usda", STAGE)).compile()
    kinds = mujoco.mjtGeom
    assert mjm.geom_type.tolist() == [kinds.mjGEOM_SPHERE, kinds.mjGEOM_MESH, kinds.mjGEOM_MESH]
    np.testing.assert_allclose(mjm.geom_rgba[0], (1.0, 0.0, 0.0, 1.0), atol=1e-6)
    assert mjm.geom_size[0, 0] == pytest.approx(0.5)
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    low, high = own_scene.bounds(mjm, data)
    assert low[0] < -1.9 and high[0] > 2.9 and high[2] > 0.9  # what was up on the stage is along z
    point = mjm.light_type == mujoco.mjtLightType.mjLIGHT_POINT
    assert point.tolist() == [False, True]
    np.testing.assert_allclose(mjm.light_pos[point], [[0.0, 0.0, 3.0]], atol=1e-6)


@pytest.mark.skipif(os.environ.get("MUJOCO_GL") == "disable", reason="no OpenGL")
def test_mujocos_own_renderer_draws_few_large_images(tmp_path: Path) -> None:
    out = tmp_path / "large.json"
    asked = ("--scene", written(tmp_path, "mine.xml", MODEL), "--peer", "warpcam", "mujoco", *TINY, "--out", out)
    assert bench(*asked, "--size", "320x240", "--outputs", "ds", "rgb-shadows-smooth") == 0
    rows = {(row["renderer"], row["outputs"]): row for row in rows_of(out)}
    theirs = rows["mujoco", "ds"]
    assert theirs["variants"].keys() == {"left on the GPU", "read"} and "memory_mb" not in theirs
    assert theirs["difference"]["hit_fraction"] > 0.1
    assert theirs["difference"]["ids_mismatch"] < 0.01 and theirs["difference"]["depth_mismatch"] < 0.01
    assert rows["mujoco", "rgb-shadows-smooth"]["difference"]["rgb_psnr_db"] > 30.0
    assert rows["warpcam", "rgb-shadows-smooth"]["best_peer"]["renderer"] == "mujoco"


@pytest.mark.parametrize(("worlds", "size"), [(17, "320x240"), (2, "64x64")])
def test_mujocos_own_renderer_is_not_asked_for_much_else(
    worlds: int, size: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "many.json"
    asked = ("--case", "humanoid", "--peer", "mujoco", "--outputs", "ds", "--device", "cpu", "--out", out)
    assert bench(*asked, "--worlds", worlds, "--size", size) == 0
    assert "left out: mujoco, which is asked for at most 16 worlds of at least 76800 pixels" in capsys.readouterr().out
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--suite", "tuning", "--part", "5/4"], "--part: '5/4' came, one of so many parts like 1/4 is needed"),
        (["--suite", "tuning", "--case", "humanoid"], "--case: came where --suite was asked for"),
        (["--case", "humanoid", "--part", "1/2"], "--part: came where cases are measured"),
        (["--case", "humanoid", "--camera", "side"], "--camera: came where cases are measured"),
        (["--scene", "nowhere.xml"], "--scene: there is no file 'nowhere.xml'"),
        (["--scene", __file__], "came; known are .xml"),
    ],
    ids=lambda value: " ".join(value[:4]) if isinstance(value, list) else "",
)
def test_mistakes_get_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(*arguments, "--device", "cpu") == 2
    assert said in capsys.readouterr().err


def test_unknown_camera_is_named_with_those_there_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, "mine.xml", MODEL)
    assert bench("--scene", path, "--camera", "top", "--device", "cpu") == 2
    assert "--camera: 'top' came, mine.xml has left, camera1" in capsys.readouterr().err


def test_file_that_is_no_model_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench("--scene", written(tmp_path, "bad.xml", "<mujoco><worldbodies/></mujoco>"), "--device", "cpu") == 2
    assert "--scene: MuJoCo cannot read" in capsys.readouterr().err


def test_report_of_another_kind_is_not_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = written(tmp_path, "old.json", json.dumps({"format": 1, "kind": "host", "runs": [], "results": []}))
    assert bench("--suite", "tuning", "--part", "1/24", *TINY, "--resume", "--out", old) == 2
    assert "is of kind host, this run of suite" in capsys.readouterr().err
