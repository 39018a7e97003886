"""The benchmark suite builds its scenes, runs its renderers, compares images and writes what it found."""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fast_compile
import numpy as np
import pytest
import warp as wp

pytest.importorskip("mujoco_warp")

import warpcam as wc
from warpcam.benchmarks import (
    cases,
    compare,
    host,
    measure,
    options,
    peers,
    problem,
    procedural_scenes,
    report,
    run,
    sweeps,
    tasks,
)
from warpcam.tools import cli

ROOT = Path(__file__).resolve().parents[2]
QUICK = fast_compile.__file__
TINY = ("--worlds", "2", "--size", "16x16", "--replays", "2", "--device", "cpu")


def bench(*arguments: Any) -> int:
    return cli.main(["bench", *map(str, arguments)])


def places(shared: problem.Problem) -> np.ndarray:
    """Return the positions of geoms and of the points of flexes, (world, place, 3) [m]."""
    return np.concatenate((shared.d.geom_xpos.numpy(), shared.d.flexvert_xpos.numpy()), axis=1)


@pytest.mark.parametrize("case", cases.CASES.values(), ids=list(cases.CASES))
def test_case_builds_and_moves(case: cases.Case) -> None:
    if not tasks.available(case):
        pytest.skip(f"its files come with {case.package}")
    shared = problem.build(case, worlds=2, width=16, height=16)
    before = places(shared)
    shared.place(1)
    moved = np.abs(places(shared) - before).max(axis=(1, 2))
    assert (moved > 1e-3).all(), "a world stays where it is from one set of poses to the next"
    assert len(shared.drawn_geoms()) > 1 or shared.faces() > 0
    assert np.abs(before[0] - before[1]).max() > 1e-3, "both worlds are in the same pose"


@pytest.mark.parametrize("name", list(peers.PEERS))
def test_renderers_agree_and_the_json_says_so(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if name not in peers.installed():
        pytest.skip(f"{name} is not installed")
    size = (96, 72) if name == "mujoco" else (16, 16)
    monkeypatch.setattr(peers, "LARGE_PIXELS", 96 * 72)
    if name == "mujoco" and os.environ.get("MUJOCO_GL") == "disable":
        pytest.skip("no OpenGL")
    out = tmp_path / "tiny.json"
    asked = ("--case", "humanoid", "--peer", "mujoco_warp", name, *TINY, "--size", "x".join(map(str, size)))
    assert bench(*asked, "--out", out) == 0
    written = json.loads(out.read_text())
    assert written["format"] == report.FORMAT and written["kind"] == "cases"
    assert {"cpu", "python", "mujoco", "mujoco-warp"} <= written["runs"][0]["machine"].keys()
    rows = [row for row in written["results"] if row["renderer"] == name]
    assert [row["outputs"] for row in rows] == list(cases.COMMON)
    for row in rows:
        assert "error" not in row, row["error"]
        assert row["rays"] == 2 * size[0] * size[1] and row["worlds"] == 2 and row["setting"] == "cpu"
        assert row["ms"]["frames"] == 2 and row["ms"]["p10"] <= row["ms"]["median"] <= row["ms"]["p90"]
        assert row["setup_s"] >= 0.0 and row["first_frame_s"] > 0.0
        assert 0.0 <= row["compile_s"] <= row["setup_s"] + row["first_frame_s"]
        assert (row.get("told_memory_mb", 0.0) > 0.0) == (name == "warpcam")
        if name == "mujoco_warp":
            continue
        assert row["compared_with"] == "mujoco_warp"
        gap = row["difference"]
        if "segmentation" in cases.COMMON[row["outputs"]].outputs:
            assert gap["hit_fraction"] > 0.5
            assert gap["ids_mismatch"] <= 0.02 and gap["depth_mismatch"] <= 0.02
        if "rgb" in cases.COMMON[row["outputs"]].outputs:
            assert gap["rgb_mean_difference"] < 100.0


@pytest.mark.parametrize("case", [case.name for case in cases.CASES.values() if case.newton])
def test_newtons_camera_and_ours_agree_on_newtons_model(case: str, tmp_path: Path) -> None:
    if not tasks.available(cases.CASES[case]):
        pytest.skip("its files are not installed")
    out = tmp_path / "newton.json"
    arguments = ("--case", case, "--peer", "warpcam", "newton", "mujoco_warp", "--outputs", "ds", "rgb-d-shadows")
    assert bench(*arguments, *TINY, "--size", "48x48", "--worlds", 32 if "cloth" in case else 2, "--out", out) == 0
    rows = json.loads(out.read_text())["results"]
    assert [row["renderer"] for row in rows] == ["warpcam"] * 2 + ["newton"] * 2
    assert all("error" not in row for row in rows)
    for row in rows[2:]:
        assert row["worlds"] == 2 and row["compared_with"] == "warpcam"
        assert row["difference"]["hit_fraction"] > 0.5
        # Newton's camera does not see a cloth from below.
        assert row["difference"]["ids_mismatch"] <= 0.01 and row["difference"]["depth_mismatch"] <= 0.01


def test_ratios_merge_and_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    first, second, both = (tmp_path / name for name in ("a.json", "b.json", "both.json"))
    for out, renderer in ((first, "mujoco_warp"), (second, "warpcam")):
        assert bench("--case", "primitives", "--outputs", "ds", "--peer", renderer, *TINY, "--out", out) == 0
    assert bench("--merge", first, second, "--out", both, "--plot", tmp_path / "both.png") == 0
    ours, peer = (
        next(row for row in json.loads(both.read_text())["results"] if row["renderer"] == name)
        for name in ("warpcam", "mujoco_warp")
    )
    ratio = peer["ms"]["median"] / ours["ms"]["median"]
    assert ours["best_peer"] == {"renderer": "mujoco_warp", "ratio": pytest.approx(ratio)}
    assert peer["times_warpcam"] == pytest.approx(ratio)
    assert (tmp_path / "both.png").read_bytes().startswith(b"\x89PNG")
    assert f"{ratio:.2f}x" in capsys.readouterr().out


def test_extra_outputs_are_compared_with_depth_and_ids(tmp_path: Path) -> None:
    out = tmp_path / "extras.json"
    asked = ("--outputs", "ds", "ds+normals", "--peer", "warpcam", "mujoco_warp")
    assert bench("--case", "humanoid", *asked, *TINY, "--out", out) == 0
    rows = {(row["renderer"], row["outputs"]): row for row in json.loads(out.read_text())["results"]}
    assert ("mujoco_warp", "ds+normals") not in rows
    ours = rows["warpcam", "ds+normals"]
    assert ours["times_ds"] == pytest.approx(ours["ms"]["median"] / rows["warpcam", "ds"]["ms"]["median"])
    assert set(cases.EXTRAS) == {f"ds+{name}" for name in cases.OUTPUTS} - {"ds+depth", "ds+segmentation"}


def test_what_a_scene_cannot_have_fails_each_time(tmp_path: Path) -> None:
    pytest.importorskip("newton")
    out = tmp_path / "more.json"
    asked = ("--outputs", "rgb", "rgb-reflections", "rgb-shadows-reflections", "--peer", "warpcam")
    assert bench("--case", "newton_quadruped", *asked, *TINY, "--out", out) == 1
    rows = {row["outputs"]: row for row in json.loads(out.read_text())["results"]}
    assert [name for name, row in rows.items() if "error" in row] == ["rgb-reflections", "rgb-shadows-reflections"]


@pytest.mark.parametrize("more", list(cases.MORE))
def test_what_peers_do_not_draw_is_compared_with_none(
    more: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "more.json"
    asked_of: list[Any] = []
    for kind in ("Camera", "from_mujoco_warp"):
        made = getattr(wc, kind)
        monkeypatch.setattr(wc, kind, lambda *args, made=made, **named: asked_of.append(named) or made(*args, **named))
    asked = ("--outputs", f"rgb-{more}", f"rgb-shadows-{more}", "rgb", "rgb-shadows", "--peer", "warpcam")
    assert bench("--case", "humanoid", *asked, *TINY, "--out", out) == 0
    rows = {row["outputs"]: row for row in json.loads(out.read_text())["results"]}
    shown = capsys.readouterr().out
    for name in ("rgb", "rgb-shadows"):
        ratio = rows[f"{name}-{more}"]["ms"]["median"] / rows[name]["ms"]["median"]
        assert rows[f"{name}-{more}"]["times_plain"] == pytest.approx(ratio)
        assert f"{ratio:.2f} of none" in shown
        assert cases.WANTED[f"{name}-{more}"].shadows == cases.WANTED[name].shadows
    for option, value in cases.MORE[more].items():
        given = [named[option] for named in asked_of if option in named]
        assert value in given and given[-1] != value


@pytest.mark.parametrize("name", list(sweeps.SWEEPS))
def test_sweep_has_points_and_a_plot(name: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    out, plot = tmp_path / "sweep.json", tmp_path / "sweep.svg"
    points = {"pixels": ("16", "24"), "faces": ("2", "100"), "samples": ("1", "8")}.get(name, ("1", "3"))
    few: tuple[str, ...] = () if name == "worlds" else ("--worlds", "2")
    few += () if name == "pixels" else ("--size", "16x16")
    asked = ("--points", *points, *few, "--replays", "1", "--device", "cpu")
    assert bench("--sweep", name, *asked, "--out", out, "--plot", plot) == 0
    rows = json.loads(out.read_text())["results"]
    assert sorted({row["x"] for row in rows}) == [int(point) for point in points]
    assert all(row["sweep"] == name and row["renderer"] == "warpcam" and "ms" in row for row in rows)
    assert "<svg" in plot.read_text()


def test_every_point_of_a_sweep_can_be_asked_for() -> None:
    parser = argparse.ArgumentParser()
    options.add(parser)
    assert tuple(sweeps.SWEEPS) == options.SWEEPS
    assert options.CASES == tuple(cases.CASES) and options.SETTINGS == tuple(cases.SETTINGS)
    assert options.PEERS == tuple(peers.PEERS) and options.MORE == tuple(cases.MORE)
    for name, (_, values) in sweeps.SWEEPS.items():
        points = sweeps.points(parser.parse_args(["--sweep", name]))
        assert [marks["x"] for _, marks in points] == list(values)


@pytest.mark.parametrize("faces", [100, 1000, 20000])
def test_ball_is_closed_and_has_about_its_faces(faces: int) -> None:
    trimesh = pytest.importorskip("trimesh")
    mjm = procedural_scenes.ball_of(faces).compile()
    assert faces * 0.75 < mjm.nmeshface < faces * 1.25
    mesh = trimesh.Trimesh(mjm.mesh_vert, mjm.mesh_face)
    assert mesh.is_watertight and mesh.volume > 0.0  # the latter: faces look outwards


def test_room_has_a_thousand_shapes() -> None:
    assert procedural_scenes.room().compile().ngeom == 1000


def test_differences_are_counted() -> None:
    depth = np.full((1, 2, 2), 2.0, dtype=np.float32)
    ids = np.array([[[0, 1], [2, -1]]], dtype=np.int32)
    rgb = np.zeros((1, 2, 2, 3), dtype=np.uint8)
    base = {"depth": np.where(ids < 0, np.inf, depth), "segmentation": ids, "rgb": rgb}
    same = compare.difference([base], [base])
    assert same["ids_mismatch"] == same["depth_mismatch"] == same["rgb_mean_difference"] == 0.0
    other = {name: image.copy() for name, image in base.items()}
    other["depth"][0, 0, 0] += 0.5
    other["segmentation"][0, 0, 1] = 7
    other["rgb"][...] = 2
    gap = compare.difference([other], [base])
    assert gap["depth_mismatch"] == gap["ids_mismatch"] == 0.25
    assert gap["depth_max_error_m"] == gap["depth_max_error_same_id_m"] == 0.5
    assert gap["rgb_mean_difference"] == 2.0
    assert gap["rgb_psnr_db"] == pytest.approx(20.0 * np.log10(255.0 / 2.0), abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--case", "teapot"], "--case: 'teapot' came, known are: primitives"),
        (["--outputs", "smell"], "--outputs: 'smell' came, known are: ds"),
        (["--peer", "pov-ray"], "--peer: 'pov-ray' came, known are: mujoco_warp"),
        (["--setting", "huge"], "--setting: 'huge' came"),
        (["--size", "16"], "--size: '16' came"),
        (["--worlds", "0"], "--worlds: 0 came"),
        (["--replays", "0"], "--replays: 0 came"),
        (["--merge", "nowhere.json"], "--merge: 'nowhere.json' cannot be read"),
        (["--sweep", "worlds", "--points", "0"], "--points: 0 came"),
        (["--points", "1"], "--points: came where cases are measured, which takes --case, --cold"),
        (["--sweep", "worlds", "--worlds", "4"], "--worlds: came where --sweep worlds was asked for, which takes"),
        (["--sweep", "shapes", "--case", "humanoid"], "--case: came where --sweep shapes was asked for"),
        (["--host", "--plot", "host.png"], "--plot: came where --host was asked for, which takes --case, --device"),
        (["--host", "--cold"], "--cold: came where --host was asked for"),
        (["--gpus", "--setting", "8192x64"], "--setting: came where --gpus was asked for, which takes --case, --out"),
        (["--merge", "a.json", "--peer", "warpcam"], "--peer: came where --merge was asked for, which takes --out"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_mistakes_get_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(*arguments, *(() if "--merge" in arguments else ("--device", "cpu"))) == 2
    assert said in capsys.readouterr().err


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(run.NEEDED, "no_such_package", "warpcam[bench]")
    assert bench("--device", "cpu") == 2
    assert "bench: no_such_package is not installed; pip install 'warpcam[bench]'" in capsys.readouterr().err


def test_what_is_not_installed_is_said_and_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(peers, "installed", lambda: ["warpcam"])
    out = tmp_path / "alone.json"
    assert bench("--case", "humanoid", "--outputs", "ds", *TINY, "--out", out) == 0
    said = capsys.readouterr().out
    assert "left out: newton, not installed; pip install newton" in said
    assert "left out: mujoco_warp_pbr, not installed; pip install mujoco-warp-pbr (Python 3.12 or newer)" in said
    assert json.loads(out.read_text())["runs"][0]["left_out"].keys() == set(peers.PEERS) - {"warpcam"}
    monkeypatch.setattr(tasks, "available", lambda case: case.package != "mjlab")
    asked = argparse.Namespace(sweep=None, suite=None, scene=None, peer=["warpcam"], case=None)
    assert tasks.left_out(asked)["case yam"] == "mjlab"
    assert (
        tasks.left_out(argparse.Namespace(sweep=None, suite=None, scene=None, peer=["warpcam"], case=["humanoid"]))
        == {}
    )


@pytest.mark.parametrize("cold", [False, True])
def test_empty_caches_are_another_folder(cold: bool, tmp_path: Path) -> None:
    """In a process of its own: what is loaded already is not compiled again."""
    out, kernels = tmp_path / "out.json", tmp_path / "kernels"
    command = [sys.executable, QUICK, "-m", "warpcam.benchmarks", "--case", "humanoid", "--outputs", "ds"]
    command += ["--peer", "warpcam", *TINY, *["--cold"] * cold, "--out", str(out)]
    environment = {**os.environ, "WARP_CACHE_PATH": str(kernels)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    written = json.loads(out.read_text())
    assert written["runs"][0]["cold"] == cold
    assert written["results"][0]["compile_s"] > 0.0
    assert bool(list(kernels.rglob("*.o"))) == (not cold)


def test_host_cost_and_the_first_image(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    full, in_child = [], host.in_child

    def noted(case: cases.Case, wanted: cases.Wanted, device: wp.Device, caches: Path) -> dict[str, float]:
        full.append(bool(list(caches.rglob("*.o"))))
        return in_child(case, wanted, device, caches)

    def quickly(command: list[str], **options: Any) -> Any:
        return subprocess.run([command[0], QUICK, *command[1:]], **options)

    monkeypatch.setattr(host, "subprocess", SimpleNamespace(run=quickly))
    monkeypatch.setattr(host, "in_child", noted)
    monkeypatch.setattr(host, "WANTED", host.WANTED[:1])
    out = tmp_path / "host.json"
    assert bench("--host", "--case", "humanoid", "--device", "cpu", "--out", out) == 0
    written = json.loads(out.read_text())
    (row,) = written["results"]
    assert written["kind"] == "host" and row["outputs"] == "ds"
    assert 0.0 < row["render_us"]["p10"] <= row["render_us"]["median"] <= row["render_us"]["p90"]
    assert full == [False, True]  # the first child has empty caches, the second its
    for first in (row["cold"], row["warm"]):
        parts = first["scene_s"] + first["renderer_s"] + first["first_render_s"]
        assert 0.0 < first["total_s"] == pytest.approx(parts)


def test_spans_that_overlap_are_counted_once() -> None:
    assert measure.covered([]) == 0.0
    assert measure.covered([(2.0, 5.0), (0.0, 1.0), (3.0, 4.0), (4.5, 6.0)]) == 5.0


def test_a_failing_renderer_does_not_stop_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    create = peers.create

    def fail(name: str, shared: problem.Problem) -> peers.Peer:
        if name == "mujoco_warp":
            raise RuntimeError("out of luck")
        return create(name, shared)

    monkeypatch.setattr(peers, "create", fail)
    out = tmp_path / "half.json"
    asked = ("--case", "humanoid", "--outputs", "ds", "--peer", "mujoco_warp", "warpcam")
    assert bench(*asked, *TINY, "--out", out) == 1
    rows = {row["renderer"]: row for row in json.loads(out.read_text())["results"]}
    assert "out of luck" in rows["mujoco_warp"]["error"] and "ms" in rows["warpcam"]
    assert "failed: humanoid 2 x 16x16 ds: mujoco_warp: RuntimeError: out of luck" in capsys.readouterr().out


def test_results_that_are_kept_can_be_merged() -> None:
    for path in sorted((ROOT / "benchmarks" / "results").glob("[cn]*.json")):  # of processors and cards
        kept = report.merge([path])
        assert kept["results"], path
