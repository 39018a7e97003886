"""Frames of meshes that move: trees are brought up to date for whoever walks through them, and for nobody else."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam import sensors
from warpcam.kernels.runtime import launch
from warpcam.kernels.runtime.launch import FrameGraph, MeshReads
from warpcam.render.recordings import Recordings

GPU: Any = SimpleNamespace(is_cuda=True)


class FakeStage:
    """A stage that writes down where it was launched."""

    def __init__(self, name: str, log: list[Any], reads: MeshReads = MeshReads.TREES, **kind: bool):
        self.name, self.reads, self._log = name, reads, log
        self.independent = self.for_shading_only = self.for_trees_only = False
        self.__dict__.update(kind)

    def launch(self, stream: Any = None) -> None:
        self._log.append((self.name, stream.name if stream else None))


class FakeStream:
    def __init__(self, name: str, log: list[Any]):
        self.name, self._log = name, log

    def record_event(self, event: Any) -> None:
        self._log.append(("record", self.name, event))

    def wait_event(self, event: Any) -> None:
        self._log.append(("wait", self.name, event))


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the streams of frames and their stages do, in order; events are numbers."""
    log: list[Any] = []
    events, streams = iter(range(99)), iter(range(1, 99))
    monkeypatch.setattr(launch.wp, "Event", lambda device: next(events))
    monkeypatch.setattr(launch, "nonblocking_stream", lambda device: FakeStream(f"side {next(streams)}", log))
    return log


def frame_of(log: list[Any], shades: bool, *chains: list[tuple[str, MeshReads]], device: Any = GPU) -> FrameGraph:
    """The frame of a scene with a mesh that moves, and of these stages."""
    scene = [
        FakeStage("poses", log),
        FakeStage("leaves", log, independent=True),
        FakeStage("trees", log, independent=True, for_trees_only=True),
        FakeStage("normals", log, independent=True, for_shading_only=True),
    ]
    own = [[FakeStage(name, log, reads) for name, reads in chain] for chain in chains]
    phases: Any = [[[FakeStage("views", log)]], own]
    recording = Recordings({True: phases, False: phases}, shades, device).after(tuple(scene))  # type: ignore[arg-type]
    return recording.frames[True]


def names(stages: Any) -> list[str]:
    return [stage.name for stage in stages]


TRACE, SHADING, SHADOW = ("trace", MeshReads.FACES), ("shading", MeshReads.NORMALS), ("shadow", MeshReads.TREES)
WALK = ("trace", MeshReads.TREES)


def test_trees_that_nobody_walks_through_stay_as_they_are(log: list[Any]) -> None:
    assert sorted(names(frame_of(log, False, [TRACE]).stages)) == ["leaves", "poses", "trace", "views"]
    assert "trees" not in names(frame_of(log, True, [TRACE, SHADING]).stages)
    assert "trees" in names(frame_of(log, False, [TRACE], [WALK]).stages)


def test_rays_that_walk_find_trees_ready(log: list[Any]) -> None:
    frame = frame_of(log, True, [WALK, SHADING])
    assert [list(map(names, chains)) for chains in frame.phases] == [
        [["poses", "views"], ["leaves", "trees", "normals"]],
        [["trace", "shading"]],
    ]


def test_trees_are_made_beside_a_trace_that_needs_none(log: list[Any]) -> None:
    frame = frame_of(log, True, [TRACE, SHADOW, SHADING])
    frame.launch(FakeStream("main", log))  # type: ignore[arg-type]
    late = log[log.index(("trees", "side 2")) - 1]
    assert late[:2] == ("wait", "side 2")
    assert log[log.index(late) - 1] == ("record", "main", late[2])  # when leaves are there
    assert log.index(("leaves", "side 1")) < log.index(late)
    done = log[log.index(("normals", "side 2")) + 1]
    assert done[:2] == ("record", "side 2")
    assert log[-4:] == [("trace", "main"), ("wait", "main", done[2]), ("shadow", "main"), ("shading", "main")]


def test_every_chain_waits_for_trees_by_itself_and_every_frame_in_the_end(log: list[Any]) -> None:
    frame = frame_of(log, True, [TRACE, SHADING], [TRACE, SHADOW])
    for _ in range(2):
        log.clear()
        frame.launch(FakeStream("main", log))  # type: ignore[arg-type]
        done = log[log.index(("normals", "side 2")) + 1][2]
        for chain, last in (("main", "shading"), ("side 1", "shadow")):
            assert log.index(("trace", chain)) < log.index(("wait", chain, done)) < log.index((last, chain))
        assert log.count(("wait", "main", done)) == 1


@pytest.mark.parametrize("chains", [[[TRACE, SHADOW]], [[TRACE, SHADING], [TRACE, SHADOW]], [[WALK]], [[TRACE]]])
def test_streams_wait_for_what_the_same_frame_has_recorded(chains: Any, log: list[Any]) -> None:
    """Else a frame that is captured would wait for work that is not, which CUDA refuses."""
    frame = frame_of(log, True, *chains)
    for _ in range(3):
        log.clear()
        frame.launch(FakeStream("main", log))  # type: ignore[arg-type]
        recorded = set()
        for entry in log:
            if entry[0] == "record":
                recorded.add(entry[2])
            elif entry[0] == "wait":
                assert entry[2] in recorded


def test_a_frame_ends_with_all_of_its_streams(log: list[Any]) -> None:
    late = [FakeStage("trees", log)]
    frame = FrameGraph([[[FakeStage("trace", log, MeshReads.FACES)]]], GPU, late)  # type: ignore[list-item, arg-type]
    frame.launch(FakeStream("main", log))  # type: ignore[arg-type]
    assert log[-3:-1] == [("record", "side 1", 1), ("trace", "main")]
    assert log[-1] == ("wait", "main", 1)


def test_on_a_cpu_late_stages_come_before_the_others(log: list[Any]) -> None:
    frame = frame_of(log, True, [TRACE, SHADOW], device=SimpleNamespace(is_cuda=False))
    frame.launch()
    expected = ["poses", "views", "leaves", "trees", "normals", "trace", "shadow"]
    assert log == [(name, None) for name in expected]


class Cloth:
    """A cloth over the ground in two worlds, whose points are elsewhere in each step."""

    def __init__(self, device: wp.Device):
        newton = pytest.importorskip("newton", reason="needs Newton: pip install warpcam[newton]")
        import newton_scenes

        builder = newton.ModelBuilder()
        builder.replicate(newton_scenes.cloth(20), 2)
        builder.add_ground_plane()
        self.model, self.state = newton_scenes.finalize(builder, device)
        self._first = self.state.particle_q.numpy().copy()
        self._random = np.random.default_rng(4)

    def scene(self) -> wc.Scene:
        return wc.from_newton(self.model, self.state)

    def step(self) -> None:
        """Turn the cloth, lift it and crumple it: boxes of before hold little of it."""
        turn = np.linalg.qr(self._random.normal(size=(3, 3)))[0]
        points = (self._first - (0.0, 0.0, 1.0)) @ turn * 0.7 + (0.0, 0.0, 1.2)
        points += self._random.normal(size=points.shape) * 0.03
        self.state.particle_q.assign(points.astype(np.float32))


def camera(inside: bool = False, **options: Any) -> wc.Camera:
    """Looks at the cloth from above, or out of the box around it."""
    position, target = ((0.05, 0.02, 1.2), (1.0, 0.3, 1.18)) if inside else ((0.3, -2.4, 2.6), (0.0, 0.0, 0.6))
    return scenes.own_camera(
        **{"width": 64, "height": 64, "outputs": ("depth", "segmentation"), "lens": wc.Pinhole(fovy=60.0)} | options,
        position=position,
        rotation=scenes.looking(position, target),
    )


LIT = {"outputs": ("rgb", "depth", "segmentation"), "shadows": True}
PATTERN = sensors.patterns.grid(size=(2.4, 2.4), resolution=0.1)


def lidar_of(scene: wc.Scene) -> Any:
    return sensors.Lidar(scene, PATTERN, position=(0.0, 0.0, 2.2), outputs=("ranges",))


def read(labels: Any) -> dict[str, np.ndarray]:
    found = labels.read()["eye"]
    return {name: getattr(found, name).cpu().numpy() for name in ("amodal_boxes", "amodal_pixels", "visible_pixels")}


def alike(found: np.ndarray, expected: np.ndarray, most: float = 0.005) -> None:
    """At common edges two faces are hit at the same depth, and colours are of either."""
    assert (np.abs(found.astype(np.float64) - expected) > 2).mean() <= most


def test_whoever_walks_finds_trees_of_the_state_as_it_is(device: wp.Device) -> None:
    cloth = Cloth(device)
    scene = cloth.scene()
    plain, within = (wc.Renderer(scene, [camera(inside)]) for inside in (False, True))
    plain.render()
    labels = wc.labels(plain, by="shape")
    assert any(stage.for_trees_only for stage in scene.stages()) == device.is_cuda
    frames = plain._recording().frames.values()
    assert not any(stage.for_trees_only for frame in frames for stage in frame.stages)
    lit: Any = None
    for step in range(3):
        cloth.step()
        fresh = cloth.scene()
        reference = wc.Renderer(fresh, [camera(**LIT)])
        expected = scenes.on_host(reference.render()["eye"])
        found = scenes.on_host(plain.render()["eye"])
        for name in found:
            np.testing.assert_array_equal(found[name], expected[name])
        inside = (wc.Renderer(fresh, [camera(inside=True)]), within)
        np.testing.assert_array_equal(*(scenes.on_host(each.render()["eye"])["segmentation"] for each in inside))
        first = read(labels)  # of trees that the frame has left alone
        for name, values in read(wc.labels(reference, by="shape")).items():
            np.testing.assert_array_equal(first[name], values)
        if step % 2 == 0:  # the state has moved since the last frame with trees
            ranges = lidar_of(scene).read()["ranges"].cpu().numpy()
            np.testing.assert_allclose(ranges, lidar_of(fresh).read()["ranges"].cpu().numpy(), rtol=1e-5)
            cloth.step()
            fresh = cloth.scene()
            expected = scenes.on_host(wc.Renderer(fresh, [camera(**LIT)]).render()["eye"])
            plain.render()
        lit = lit or wc.Renderer(scene, [camera(**LIT)])
        found = scenes.on_host(lit.render()["eye"])
        for name in ("depth", "segmentation"):
            np.testing.assert_array_equal(found[name], expected[name])
        alike(found["rgb"], expected["rgb"])
        dark = scenes.on_host(wc.Renderer(fresh, [camera(outputs=("rgb",))]).render()["eye"])["rgb"]
        assert (np.abs(dark.astype(int) - expected["rgb"]) > 10).mean() > 0.01  # there are shadows


@pytest.mark.parametrize("graph", [False, True])
def test_trees_beside_the_trace_are_there_for_shadows_and_colours(
    graph: bool, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    cloth = Cloth(device)
    lit = wc.Renderer(cloth.scene(), [camera(**LIT)], graph=graph)
    monkeypatch.setattr(Recordings, "_late", lambda *_: [])
    reference = wc.Renderer(cloth.scene(), [camera(**LIT)], graph=graph)
    assert any(frame._late for frame in lit._recording().frames.values()) == device.is_cuda
    assert not any(frame._late for frame in reference._recording().frames.values())
    for _ in range(40):
        cloth.step()
        expected, found = (scenes.on_host(renderer.render()["eye"]) for renderer in (reference, lit))
        for name in ("depth", "segmentation"):
            np.testing.assert_array_equal(found[name], expected[name])
        alike(found["rgb"], expected["rgb"])
