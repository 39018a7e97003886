"""Data sets: the same whatever draws them, whole after a kill, and clear about what is wrong."""

import dataclasses
import errno
import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np
import pytest
import warp as wp
from dataset_plans import files_of, plan_of, shards_of

import warpcam as wc
from warpcam.datasets.generate import Worlds, generate
from warpcam.datasets.generate.random_numbers import generator
from warpcam.datasets.generate.shards import ShardFolder
from warpcam.datasets.writers import coco
from warpcam.tools import cli

HELPERS = str(Path(__file__).parents[1] / "helpers")


def says(text: str) -> Any:
    return pytest.raises(wc.WarpcamError, match=re.escape(text))


@pytest.fixture
def quick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have processes that are started compile kernels as this one does."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text("import fast_compile\nfast_compile.install(ours=True)\n")
    root = str(Path(wc.__file__).parents[1])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tmp_path / "site"), HELPERS, root)))


def test_samples_follow_from_their_numbers_alone(device: wp.Device, tmp_path: Path) -> None:
    plans = [plan_of(tmp_path, f"of {n}", worlds=n, device=device.alias, count=9, shard_size=4) for n in (1, 3, 8)]
    for plan in plans:
        generate(plan)
    first, *others = map(files_of, (plan.out for plan in plans))
    assert len([name for name in first if "/images/" in name]) == 9
    assert all(first == other for other in others)
    generate(other := plan_of(tmp_path, "other", seed=1, count=9, shard_size=4, device=device.alias))
    images = [name for name in first if "/images/" in name]
    assert not any(first[name] == files_of(other.out)[name] for name in images)


def test_worlds_differ_as_the_recipes_say(device: wp.Device, tmp_path: Path) -> None:
    worlds = Worlds(plan_of(tmp_path, device=device.alias, worlds=8))
    frames = [frame for first in (0, 8) for frame in worlds.draw(range(first, first + 8))]
    positions = np.array([frame.camera_position for frame in frames])
    radii = np.linalg.norm(positions - (0.0, 0.0, 0.2), axis=1)
    assert radii.min() > 1.4 and radii.max() < 2.8 and positions.std(axis=0).min() > 0.2
    angles = [2.0 * np.degrees(np.arctan(24.0 / frame.intrinsics[1])) for frame in frames if frame.intrinsics]
    assert len(angles) == 16 and 40.0 < min(angles) < 45.0 < 50.0 < max(angles) < 55.0
    for frame in frames:
        crate, ball, pill = frame.instances
        assert [each.name for each in frame.instances] == ["crate", "ball", "pill"]
        assert frame.classes == ("box", "round") and [each.category for each in frame.instances] == [0, 1, 1]
        at = [frame.camera_position + frame.camera_rotation @ each.position for each in (crate, ball, pill)]
        assert all((np.abs(place[:2]) < 0.601).all() and 0.149 < place[2] < 0.501 for place in at)
        assert min(np.linalg.norm(at[0] - at[1]), np.linalg.norm(at[0] - at[2])) > 0.3
        assert crate.keypoints.shape == (2, 3) and ball.keypoints.shape == (0, 3)
        for each in frame.instances:
            assert frame.mask(each).sum() == each.visible_pixels
    number_of_ids = {len(np.unique(frame.ids)) for frame in frames}
    assert len(number_of_ids) > 2  # distractors are among the bodies, and not in all samples
    again = next(iter(worlds.draw([11])))
    np.testing.assert_array_equal(again.depth, frames[11].depth)  # the sensor's noise is the sample's


def test_a_data_set_may_grow(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "grown", recipes=None, count=4)
    generate(plan)
    generate(dataclasses.replace(plan, count=7))
    at_once = plan_of(tmp_path, "at once", recipes=None, count=7)
    generate(at_once)
    assert files_of(plan.out) == files_of(at_once.out)
    with says("has 7 samples, --count 4 came"):
        generate(plan)


def test_killed_and_resumed_by_workers(tmp_path: Path, quick: None) -> None:
    plan = plan_of(tmp_path, "whole", recipes=None, count=40, shard_size=2)
    generate(plan)
    command = [sys.executable, "-m", "warpcam", "dataset", plan.scene, "--writer", "coco", "--count", "40"]
    command += ["--shard-size", "2", "--worlds", "3", "--size", "64x48", "--device", "cpu", "--antialiasing", "1"]
    command += ["--image-format", "png", "--out", str(tmp_path / "killed")]
    begun = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    shards = tmp_path / "killed" / "shards"
    for _ in range(6000):
        if (shards / "000001").exists() or begun.poll() is not None:
            break
        time.sleep(0.01)
    begun.send_signal(signal.SIGKILL)
    assert begun.wait() == -signal.SIGKILL, begun.stdout.read() if begun.stdout else ""
    begun.communicate()
    (shards / ".000019-1.tmp").mkdir(exist_ok=True)  # as a kill leaves it
    before = {name: digest for name, digest in files_of(tmp_path / "killed").items() if re.match(r"shards/\d", name)}
    assert before and not (tmp_path / "killed" / "coco_annotations.json").exists()
    times = {name: (tmp_path / "killed" / name).stat().st_mtime_ns for name in before}
    done = subprocess.run([*command, "--workers", "2"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "40 samples" in done.stdout, done.stderr
    assert files_of(tmp_path / "killed") == files_of(plan.out)
    assert times == {name: (tmp_path / "killed" / name).stat().st_mtime_ns for name in before}


def test_a_killed_worker(tmp_path: Path, quick: None) -> None:
    plan = plan_of(tmp_path, recipes=None, count=400, shard_size=4)
    told = []

    def kill_one(samples: int) -> None:
        told.append(samples)
        if len(told) == 4:
            os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGKILL)

    with says("was ended by SIGKILL while it made shard"):
        generate(plan, 2, kill_one)
    assert all(re.fullmatch(r"\d{6}", name) for name in shards_of(plan.out))
    assert not multiprocessing.active_children()


def test_disk_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, encode, written = plan_of(tmp_path, recipes=None), coco.encode_frame, []

    def encode_until_full(*arguments: Any) -> bytes:
        written.append(1)
        if len(written) > 5:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return encode(*arguments)

    monkeypatch.setattr(coco, "encode_frame", encode_until_full)
    with says(f"no space left for {plan.out!r}; finished shards are whole: free space"):
        generate(plan)
    assert shards_of(plan.out) == ["000000"]
    assert not json.loads((Path(plan.out) / "manifest.json").read_text())["complete"]
    monkeypatch.setattr(coco, "encode_frame", encode)
    generate(plan)
    assert shards_of(plan.out) == ["000000", "000001", "000002"]
    assert json.loads((Path(plan.out) / "manifest.json").read_text())["complete"]


def test_disk_full_in_a_worker(tmp_path: Path, quick: None) -> None:
    site = tmp_path / "site" / "sitecustomize.py"
    full = "def full(*_):\n    raise OSError(errno.ENOSPC, 'No space left on device')\n"
    imports = "import errno\nimport warpcam.datasets.generate\nfrom warpcam.datasets.writers import coco\n"
    patched = f"{imports}{full}coco.encode_frame = full\n"
    site.write_text(
        f"{site.read_text()}import sys\nif 'spawn_main' in ' '.join(sys.orig_argv):\n{indent(patched, '    ')}"
    )
    plan = plan_of(tmp_path, recipes=None, count=4, shard_size=2)
    with says(f"no space left for {plan.out!r}; finished shards are whole: free space"):
        generate(plan, 2)
    assert shards_of(plan.out) == [] and not multiprocessing.active_children()


def test_disk_full_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All shards are whole, and the same command merges them when there is room again."""
    plan = plan_of(tmp_path, recipes=None)

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as fault:
        fault.setattr(coco, "_write", full)
        with says("finished shards are whole: free space and run the same command again"):
            generate(plan)
    before = {path: path.stat().st_mtime_ns for path in Path(plan.out).glob("shards/*/*")}
    assert shards_of(plan.out) == ["000000", "000001", "000002"]
    generate(plan)
    assert before == {path: path.stat().st_mtime_ns for path in Path(plan.out).glob("shards/*/*")}
    assert json.loads((Path(plan.out) / "manifest.json").read_text())["complete"]


def test_parts_of_an_array_of_jobs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_of(tmp_path, "one", recipes=None, count=10, shard_size=2)
    generate(plan)
    parts = dataclasses.replace(plan, out=str(tmp_path / "parts"))
    with ShardFolder(parts, "shards").locked(shared=True):  # another job of the array
        generate(parts, part=(1, 3))
        assert shards_of(parts.out) == ["000001", "000004"]
        with says("another run writes to folder"):
            generate(parts)
    with ShardFolder(parts, "shards").locked(), says("another run writes to folder"):
        generate(parts, part=(0, 3))
    command = ["dataset", plan.scene, "--writer", "coco", "--count", "10", "--shard-size", "2", "--worlds", "3"]
    command += ["--size", "64x48", "--device", "cpu", "--antialiasing", "1", "--image-format", "png"]
    command += ["--out", parts.out]
    assert cli.main([*command, "--shards", "0/3"]) == 0
    assert "the same command without --shards completes it" in capsys.readouterr().out
    assert shards_of(parts.out) == ["000000", "000001", "000003", "000004"]
    assert cli.main(command) == 0
    assert files_of(parts.out) == files_of(plan.out)
    for wrong in ("3/3", "1", "a/b", "-1/2"):
        assert cli.main([*command, f"--shards={wrong}"]) == 2
        assert "--shards: " in capsys.readouterr().err


def test_folders_that_cannot_be_used(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, recipes=None)
    with says("cannot be written: Not a directory"):
        generate(dataclasses.replace(plan, out=str(tmp_path / "scene.xml" / "out")))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "holiday.jpg").write_text("")
    with says("has other files; give an empty or a new folder"):
        generate(dataclasses.replace(plan, out=str(tmp_path / "full")))
    with ShardFolder(plan, "shards").locked(), says("another run writes to folder"):
        generate(plan)
    (tmp_path / "out" / "manifest.json").write_text("[]")
    with says("is no manifest"):
        generate(plan)


def test_other_parameters_are_named(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, recipes=None, count=1)
    generate(plan)
    before = files_of(plan.out)
    recipes = dataclasses.replace(plan.recipes, joints="file")
    with says("made with other seed, width, recipes.joints;"):
        generate(dataclasses.replace(plan, seed=3, width=32, recipes=recipes))
    assert files_of(plan.out) == before


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("camera: {}", "unknown key 'camera', did you mean 'cameras'?; allowed are joints, poses, spacing, cameras"),
        ("cameras: {top: {shel: {radius: 1}}}", "cameras: top: unknown key 'shel', did you mean 'shell'?; allowed are"),
        ("cameras: {top: {shell: {}}}", "cameras: top: shell: 'radius' is missing"),
        (
            "cameras: {top: {shell: {radius: [2, 1]}}}",
            "[from, to] of at least 1e-06 or one number is needed, got [2, 1]",
        ),
        ("cameras: {nose: {}}", "cameras: 'nose' came without a shell, the cameras of the scene are: none"),
        ("joints: sometimes", "joints: one of random, file is needed, got 'sometimes'"),
        ("spacing: wide", "spacing: a number of at least 0 is needed, got 'wide'"),
        (
            "poses: {sofa: {low: [0, 0, 0], high: [1, 1, 1]}}",
            "poses: 'sofa' is no body of the scene; it has crate, ball",
        ),
        ("poses: {ball: {low: [0, 0], high: [1, 1, 1]}}", "poses: ball: low: 3 numbers are needed, got [0, 0]"),
        ("scene: {shape_colour: [0, 1]}", "'shape_colour'"),
        ("scene: {shape_colors: {low: 0}}", "either low and high or choice is needed"),
        ("scene: {light_diffuse: {low: 0, high: 1, rows: [sun]}}", "rows has 'sun', the model has no such light"),
        ("textures: {folder: nowhere}", "textures: folder: there is no folder 'nowhere'"),
        ("textures: {folder: TEXTURES, names: sofa}", "textures: names: sofa is no shape of the scene"),
        ("distractors: {count: [1, 2.5], low: [0, 0, 0], high: [1, 1, 1]}", "whole numbers from 0 to 1000"),
        ("sensors: {free: {model: kinect}}", "model must be one of realsense_d405"),
        ("sensors: {free: {effects: [{name: AxialNose}]}}", "no effect 'AxialNose', did you mean 'AxialNoise'?"),
        (
            "sensors: {free: {effects: [{name: AxialNoise, konstant: 1}]}}",
            "AxialNoise has no parameter 'konstant'; it has constant",
        ),
        ("sensors: {front: {model: oak_d}}", "sensors: 'front' is none of the cameras, which are free"),
        ("labels: {by: colour}", "labels: by: one of body, shape, instance, semantic is needed, got 'colour'"),
        ("labels: {classes: {box: crat}}", "labels: classes: box: nothing is called crat; by 'body' there are crate"),
        ("a: [", "it is not YAML"),
    ],
    ids=lambda value: value.split(":")[0],
)
def test_mistakes_in_recipes(text: str, said: str, tmp_path: Path) -> None:
    with says(said):
        Worlds(plan_of(tmp_path, recipes=text))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--writer", "cocoa"], "--writer: 'cocoa' came; there are coco, bop"),
        (["--count", "0"], "count must be a whole number from 1"),
        (["--option", "min_pixel=3"], "--option: 'min_pixel' came; options of this writer are: min_pixels"),
        (["--option", "min_pixels=some"], "a number, true or false is needed"),
        (["--option", "min_pixels=true"], "--option: min_pixels must be a whole number, got True"),
        (["--randomize", "nowhere.yaml"], "nowhere.yaml: it cannot be read: No such file or directory"),
        (["--camera", "nose"], "'nose' came"),
        (["--workers", "0"], "workers must be a whole number of at least 1, got 0"),
        (["--validation", "1"], "validation must be a share from 0 to below 1"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_mistakes_on_the_command_line(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = ["dataset", "--writer", "coco", "--count", "1", "--size", "8x8", "--device", "cpu", "--worlds", "1"]
    assert cli.main([*plain, "--out", str(tmp_path / "out"), *arguments]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("warpcam: ") and said in printed and len(printed.splitlines()) == 1


def test_the_example(tmp_path: Path) -> None:
    recipes = Path(__file__).parents[2] / "examples" / "dataset.yaml"
    options = ("--size", "64x48", "--antialiasing", "1", "--device", "cpu", "--worlds", "2")
    arguments = ["dataset", "--writer", "yolo", "--count", "2", "--randomize", str(recipes), *options]
    assert cli.main([*arguments, "--out", str(tmp_path / "out")]) == 0
    statistics = json.loads((tmp_path / "out" / "statistics.json").read_text())
    assert statistics["classes"] == ["ball", "block", "can", "egg", "pill", "vase"] and sum(statistics["instances"]) > 6


def test_scenes_of_other_files(tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="needs USD: pip install warpcam[usd]")
    geometry = pytest.importorskip("pxr.UsdGeom")
    stage = usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    geometry.SetStageMetersPerUnit(stage, 1.0)
    geometry.SetStageUpAxis(stage, "Z")
    for name, place in (("Mug", 0.0), ("Ball", 1.5)):
        sphere = geometry.Sphere.Define(stage, f"/World/{name}")
        sphere.AddTranslateOp().Set((place, 0.0, 0.0))
        sphere.CreateRadiusAttr(0.4)
    stage.Save()
    text = """
poses: {/World/Ball: {low: [1, -1, 0], high: [2, 1, 1]}}
cameras: {orbit: {shell: {radius: 5, target: [0, 0, 0]}}}
labels: {by: shape, classes: {mug: Mug, ball: /World/Ball}}
distractors: {count: [0, 4], low: [-1, -1, 0.5], high: [1, 1, 1], size: [0.1, 0.2]}
"""
    plan = plan_of(tmp_path, recipes=text, worlds=4)
    worlds = Worlds(dataclasses.replace(plan, scene=str(tmp_path / "scene.usda")))
    places, seen = [], []
    for frame in worlds.draw(range(4)):
        at = {each.name: frame.camera_position + frame.camera_rotation @ each.position for each in frame.instances}
        np.testing.assert_allclose(at["/World/Mug"], 0.0, atol=1e-5)
        places.append(at["/World/Ball"])
        seen.append(len(np.unique(frame.ids[frame.ids >= 0])))
        assert {each.name: frame.classes[each.category] for each in frame.instances} == {
            "/World/Mug": "mug",
            "/World/Ball": "ball",
        }
    assert len(np.unique(np.round(places, 4), axis=0)) == 4
    assert max(seen) > 3 and len(set(seen)) > 1  # distractors, not the same number in all samples
    assert np.min(places, axis=0)[0] >= 1.0 and np.max(places, axis=0)[0] <= 2.0


@pytest.mark.parametrize("kind", ["glb", "obj"])
def test_distractors_beside_meshes(kind: str, device: wp.Device, tmp_path: Path) -> None:
    """A ball of a file in its own axes and units; distractors are where the recipe has them, in metres, z up."""
    trimesh = pytest.importorskip("trimesh", reason="pip install 'warpcam[meshes]'")
    trimesh.Scene({"mug": trimesh.creation.icosphere(radius=0.3)}).export(tmp_path / f"scene.{kind}")
    text = """
cameras: {orbit: {shell: {radius: 5, target: [0, 0, 0], elevation: 0, azimuth: 270}}}
distractors: {count: [1, 5], low: [1, 0, 1], high: [1, 0, 1], size: [0.1, 0.2]}
"""
    plan = plan_of(tmp_path, recipes=text, worlds=4, device=device.alias)
    plan = dataclasses.replace(plan, scene=str(tmp_path / f"scene.{kind}"))
    worlds = Worlds(plan)
    for frame in worlds.draw(range(4)):
        (ball,) = frame.instances
        assert frame.classes == (ball.name.rsplit("/", 1)[-1],)
        others = (frame.ids >= 0) & (frame.ids != ball.id)
        assert others.any() and frame.mask(ball).any()
        rows, columns = np.nonzero(others)
        focal, middle_x, middle_y = frame.intrinsics[1], *frame.intrinsics[2:]
        depth = frame.depth[others]  # seen from -y: to the right is +x, up is +z
        x, z = (columns + 0.5 - middle_x) * depth / focal, (middle_y - rows - 0.5) * depth / focal
        assert np.hypot(x - 1.0, z - 1.0).max() < 0.5 and np.abs(depth - 5.0).max() < 0.5
        assert np.hypot(x - 1.0, z - 1.0).min() < 0.1


def test_random_numbers_are_the_sample_s_and_the_purpose_s() -> None:
    first, second = (generator(7, sample, "pose") for sample in (0, 1))  # side by side
    numbers = np.array([(first.random(), second.random()) for _ in range(1000)])
    for sample in (0, 1):
        np.testing.assert_array_equal(generator(7, sample, "pose").random(1000), numbers[:, sample])
    others = [numbers[:, 1], generator(7, 0, "looks").random(1000), generator(8, 0, "pose").random(1000)]
    assert all(abs(np.corrcoef(numbers[:, 0], other)[0, 1]) < 0.12 for other in others)
    drawn = generator(7, 0, "pose")
    assert drawn.integers(2**31) == generator(7, 0, "pose").integers(2**31) and drawn.random() != numbers[0, 0]
    assert generator(2**63 - 1, 10**9, "pose").random() < 1.0
