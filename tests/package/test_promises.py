"""Promises that are about a whole process, and the table in docs/promises.md that says which test keeps which."""

import gc
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc
from warpcam.sources.mujoco import batch_file

ROOT = Path(__file__).resolve().parents[2]
MODEL = '<body name="wall"><freejoint/><geom type="box" size="5000 5000 0.5"/></body>'


def put(num_worlds: int) -> tuple[Any, Any, wc.Scene]:
    """A wall under the camera in each world, the simulator's data, and the scene of it."""
    mjm = scenes.compile_xml(MODEL)
    m, d = scenes.put(mjm, num_worlds)
    return mjm, d, wc.from_mujoco_warp(mjm, m, d)


def eye(**options: Any) -> wc.Camera:
    return scenes.own_camera(outputs=("depth", "segmentation", "bodies", "distance"), **options)


def test_frames_and_times_tell_how_old_an_image_is(device: wp.Device) -> None:
    _, d, scene = put(3)
    renderer = wc.Renderer(scene, [eye()])
    frames, times = renderer.frames, renderer.times
    assert frames.tolist() == [0, 0, 0]
    assert torch.isnan(times).all()
    d.time.assign([0.5, 1.0, 1.5])
    renderer.render()
    assert frames.tolist() == [1, 1, 1]
    assert times.tolist() == [0.5, 1.0, 1.5]
    d.time.assign([2.0, 2.5, 3.0])
    renderer.render(worlds=[1])
    assert frames.tolist() == [1, 2, 1]
    assert times.tolist() == [0.5, 2.5, 1.5]
    d.time = wp.array(np.float32([7.0, 8.0, 9.0]), device=device)
    renderer.render()
    assert frames.tolist() == [2, 3, 2]
    assert times.tolist() == [7.0, 8.0, 9.0]
    assert renderer.frames is frames
    assert renderer.times is times
    assert frames.device == renderer.faulty.device


def test_frames_are_counted_in_replays(device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("a CPU has no graphs")
    _, d, scene = put(2)
    renderer = wc.Renderer(scene, [eye()])
    renderer.render()
    wp.synchronize_device(device)
    with wp.ScopedCapture(device) as capture:
        renderer.render()
    for step in range(5):
        d.time.fill_(float(step))
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)
    assert renderer.frames.tolist() == [6, 6]
    assert renderer.times.tolist() == [4.0, 4.0]


def test_times_of_classic_mujoco_and_of_nobody(device: wp.Device) -> None:
    mjm = scenes.compile_xml(MODEL)
    mjds = [scenes.forward(mjm), scenes.forward(mjm)]
    renderer = wc.Renderer(wc.from_mujoco(mjm, mjds, device=device), [eye()])
    mjds[1].time = 4.5
    renderer.render()
    assert renderer.times.tolist() == [0.0, 4.5]
    newton = pytest.importorskip("newton", reason="pip install newton")
    builder = newton.ModelBuilder()
    builder.add_shape_box(-1, hx=5000.0, hy=5000.0, hz=0.5)
    model = builder.finalize(device=device)
    renderer = wc.Renderer(wc.from_newton(model, model.state()), [eye(position=(0.0, 0.0, 2.0))])
    renderer.render()
    assert renderer.frames.tolist() == [1]
    assert torch.isnan(renderer.times).all()


class Held:
    """Resources held now: bytes of the device by Warp and torch, of the process, and Python's objects."""

    def __init__(self, device: wp.Device):
        gc.collect()
        wp.synchronize_device(device)
        self.objects = len(gc.get_objects())
        self.device, self.on_cuda = 0, device.is_cuda
        if device.is_cuda:
            self.device = wp.get_mempool_used_mem_current(device) + torch.cuda.memory_allocated(device.ordinal)
        pages = int(Path("/proc/self/statm").read_text().split()[1]) if Path("/proc/self/statm").exists() else 0
        self.process = pages * os.sysconf("SC_PAGE_SIZE") if pages else 0

    def grown(self, before: "Held") -> list[str]:
        """Return the resources that have grown by more than a process breathes."""
        allowed = {"objects": 300, "device": 0, "process": 64_000_000 if self.on_cuda else 6_000_000}  # a driver's own
        grown = {name: getattr(self, name) - getattr(before, name) for name in allowed}
        return [f"{name}: {more:,} more" for name, more in grown.items() if more > allowed[name]]


def test_memory_stays_flat(device: wp.Device) -> None:
    """Over 10,000 frames with 1,000 resets between them, and over renderers that are made anew and dropped."""
    _, d, scene = put(4)
    positions = wp.to_torch(d.geom_xpos)[..., 2]
    renderer = wc.Renderer(scene, [eye(width=8, height=8)])
    camera = eye(width=8, height=8)

    def run(frames: int) -> None:
        for frame in range(frames):
            positions.sub_(0.001)
            if frame % 10 == 9:
                mask = torch.zeros(4, dtype=torch.bool, device=positions.device)
                mask[frame // 10 % 4] = True
                positions.masked_fill_(mask[:, None], -2.5)
                renderer.render(worlds=mask)
                if frame % 200 == 199:
                    wc.Renderer(scene, [camera]).render()
            else:
                renderer.render()

    run(600)  # what is loaded and grown once
    before = Held(device)
    run(10_000)
    assert Held(device).grown(before) == []


def test_growth_is_seen(device: wp.Device) -> None:
    """The judge itself."""
    before = Held(device)
    kept = [[frame] for frame in range(1000)]
    assert [each.split(":")[0] for each in Held(device).grown(before)] == ["objects"]
    more = np.ones(400_000_000, np.uint8)  # many tests before may have left much that is freed meanwhile
    assert "process" in [each.split(":")[0] for each in Held(device).grown(before)]
    del kept, more


# Renders in threads and in processes that are spawned, keeps all of it, and falls off its end.
PROGRAM = """
import multiprocessing, sys, threading
import warp as wp
wp.config.log_level = wp.LOG_WARNING
from warpcam.tools import self_test

def total(name):
    shot = self_test.shoot(wp.get_device(name))
    assert self_test.fault(shot.images) is None
    return int(shot.images["rgb"].sum())

def keep(name, totals):
    totals.append(total(name))

def forever(name):
    from warpcam.scene.file_scene import DrivenScene
    from warpcam.sources.common.scene_graph_source import SceneGraphSource
    import warpcam as wc
    scene = DrivenScene(SceneGraphSource(self_test._graph(), 1, wp.get_device(name)))
    camera = wc.Camera("eye", width=48, height=48, outputs=self_test.OUTPUTS, lens=wc.Pinhole(fovy=60.0),
                       position=(0.0, 0.0, 3.0), shadows=True)
    global renderer
    renderer = wc.Renderer(scene, [camera])
    begun.set()
    while True:
        renderer.render()

if __name__ == "__main__":
    name = sys.argv[1]
    totals, begun = [], threading.Event()
    keep(name, totals)
    threads = [threading.Thread(target=keep, args=(name, totals)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        totals += pool.map(total, [name, name])
        pool.close()
        pool.join()
    threading.Thread(target=forever, args=(name,), daemon=True).start()
    begun.wait()
    print("DONE", *totals)
"""


def test_a_process_ends_cleanly(device: wp.Device, tmp_path: Path) -> None:
    """With renderers in threads, one of which is in the middle of a frame, and in processes that it has spawned."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    command = [sys.executable, str(program), device.alias]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    totals = re.search("DONE (.*)", done.stdout).group(1).split()
    assert len(totals) == 6
    assert len(set(totals)) == 1
    said = [line for line in done.stderr.splitlines() if line.strip() and "CUDA driver" not in line]
    assert said == []


def away_from_edges(*ids: np.ndarray) -> np.ndarray:
    """Pixels whose neighbours are all of one shape, in each of the images (world, height, width)."""
    inside = np.ones(ids[0].shape, bool)
    for image in ids:
        padded = np.pad(image, ((0, 0), (1, 1), (1, 1)), mode="edge")
        for row in range(3):
            for column in range(3):
                inside &= padded[:, row : row + image.shape[1], column : column + image.shape[2]] == image
    return inside


def test_cpu_and_cuda_agree_away_from_edges() -> None:
    if not wp.is_cuda_available():
        pytest.skip("needs a GPU")
    seen = []
    for name in ("cpu", "cuda:0"):
        put = batch_file.load(batch_file.DEMO, num_worlds=4, seed=3, device=wp.get_device(name))
        camera = wc.Camera("overview", width=96, height=72, outputs=("rgb", "depth", "segmentation"), shadows=True)
        seen.append(scenes.look(wc.from_mujoco_warp(put.host, put.model, put.data), camera))
    cpu, cuda = seen
    inside = away_from_edges(cpu["segmentation"], cuda["segmentation"])
    assert inside.mean() > 0.5
    assert (cpu["segmentation"] != cuda["segmentation"]).mean() < 0.005
    np.testing.assert_array_equal(cpu["segmentation"][inside], cuda["segmentation"][inside])
    np.testing.assert_allclose(cuda["depth"][inside], cpu["depth"][inside], rtol=1e-4)
    off = np.abs(cpu["rgb"].astype(int) - cuda["rgb"]).max(axis=-1)
    assert (off[inside] > 4).mean() < 0.005  # edges of shadows


def named_tests(text: str) -> list[tuple[str, str]]:
    """Files and tests that a page names: "tests/file.py", then tests, each in backquotes."""
    found, file = [], ""
    for word in re.findall(r"`([^`]+)`", text):
        if word.startswith("tests/"):
            file = word
            found.append((file, ""))
        elif word.startswith("test_"):
            found.append((file, word))
    return found


def missing(text: str) -> list[str]:
    gone = []
    for file, test in named_tests(text):
        path = ROOT / file
        source = path.read_text() if path.is_file() else ""
        if not path.is_file() or (test and not re.search(rf"^\s*def {test}\(", source, flags=re.MULTILINE)):
            gone.append(f"{file} {test}".strip())
    return gone


def test_every_promise_has_a_test_that_is_there() -> None:
    page = (ROOT / "docs" / "promises.md").read_text()
    rows = re.findall(r"^\| (P\d+) \|(.*)\|$", page, flags=re.MULTILINE)
    assert [name for name, _ in rows] == [f"P{number}" for number in range(1, 16)]
    for name, row in rows:
        assert [test for _, test in named_tests(row) if test], name
    assert missing(page) == []


def test_a_test_that_is_gone_is_seen() -> None:
    text = "| P1 | `tests/package/test_promises.py` `test_that_is_not_there` | and `tests/test_nowhere.py` `test_x` |"
    assert missing(text) == [
        "tests/package/test_promises.py test_that_is_not_there",
        "tests/test_nowhere.py",
        "tests/test_nowhere.py test_x",
    ]
