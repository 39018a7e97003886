"""The page in a browser: what it shows of a scene, when it is drawn anew, and the command that serves it."""

import contextlib
import sys
import urllib.request
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import trimesh
import warp as wp

import warpcam as wc
from warpcam.tools import cli
from warpcam.tools.demo_simulation import Simulation

pytest.importorskip("viser", reason="needs viser: pip install warpcam[view]")

from viser import transforms

from warpcam import viewer as viewers
from warpcam.viewer import ClientCamera, Viewer, ViewSelection

PLACE, TARGET = (0.3, -2.0, 0.9), (0.1, 0.2, 0.3)
THINGS = """
<light pos="0 0 3"/>
<geom type="plane" size="0 0 1" rgba="0.4 0.5 0.4 1"/>
<geom name="ball" size="0.2" pos="0.1 0.2 0.3" rgba="0.9 0.1 0.1 1"/>
<body name="box" pos="-0.4 0.3 0.5"><freejoint/><geom type="box" size="0.1 0.15 0.2"/></body>
<camera name="above" pos="0 0 3"/>
<camera pos="0 0 4"/>
"""


def eye(aspect: float) -> ClientCamera:
    """At PLACE, looking at TARGET, the world's +Z up in its picture, as a page of viser tells it."""
    ahead = np.subtract(TARGET, PLACE) / np.linalg.norm(np.subtract(TARGET, PLACE))
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    turn = transforms.SO3.from_matrix(np.stack([right, np.cross(ahead, right), ahead], axis=1))
    return ClientCamera(PLACE, tuple(turn.wxyz), float(np.radians(50.0)), aspect)


@pytest.fixture
def simulated() -> tuple[mujoco.MjModel, list[mujoco.MjData]]:
    """Two worlds, in the second of which the box is elsewhere."""
    mjm = scenes.compile_xml(THINGS)
    states = [mujoco.MjData(mjm) for _ in range(2)]
    states[1].qpos[0] += 0.3
    for state in states:
        mujoco.mj_forward(mjm, state)
    return mjm, states


@pytest.fixture
def viewer(device: wp.Device, simulated: Any) -> Any:
    shown = Viewer(wc.from_mujoco(*simulated, device=device), width=48, height=32, port=18080)
    yield shown
    shown.close()


@pytest.mark.parametrize("output", ["rgb", "segmentation"])
@pytest.mark.parametrize("world", [0, 1])
def test_a_page_sees_what_a_camera_there_sees(viewer: Viewer, simulated: Any, world: int, output: str) -> None:
    own = wc.Camera(
        "own",
        width=48,
        height=32,
        outputs=(output,),
        lens=wc.Pinhole(fovy=50.0),
        position=PLACE,
        rotation=scenes.looking(PLACE, TARGET),
        shadows=True,
        antialiasing=4 if output == "rgb" else 1,
    )
    image = wc.Renderer(viewer._scene, [own]).render()["own"][output][world : world + 1].cpu().numpy()
    shown = viewer.picture(ViewSelection(output, "free", world), eye(48 / 32))
    expected = viewers.visualize.picture(output, image)[0]
    assert shown.shape == (32, 48, 3)
    assert (shown != expected).any(-1).mean() < 0.01
    assert len(np.unique(expected.reshape(-1, 3), axis=0)) > 2
    other = viewer.picture(ViewSelection(output, "free", 1 - world), eye(48 / 32))
    assert (shown != other).any(-1).mean() > 0.01


def test_a_wide_window_shows_more_at_the_sides(viewer: Viewer) -> None:
    choice = ViewSelection("segmentation", "free", 0)
    square, wide = (viewer.picture(choice, eye(aspect)) for aspect in (1.5, 3.0))
    ball = square[16, 24]
    widths = [(image[16] == ball).all(-1).sum() for image in (square, wide)]
    heights = [(image[:, 24] == ball).all(-1).sum() for image in (square, wide)]
    assert widths[0] == pytest.approx(2 * widths[1], abs=2.5)
    assert heights[0] == heights[1]
    assert heights[0] > 4


@pytest.mark.parametrize(("camera", "index"), [("above", 0), ("1", 1)])
def test_a_camera_of_the_scene_is_shown_within_borders(viewer: Viewer, camera: str, index: int) -> None:
    image = wc.Renderer(viewer._scene, [wc.Camera(index, width=48, height=32, outputs=("depth",))]).render()
    expected = viewers.visualize.picture("depth", image[index]["depth"][:1].cpu().numpy())[0]
    for aspect, shape, cut in ((3.0, (32, 96), np.s_[:, 24:72]), (0.75, (64, 48), np.s_[16:48])):
        shown = viewer.picture(ViewSelection("depth", camera, 0), eye(aspect))
        assert shown.shape == (*shape, 3)
        np.testing.assert_array_equal(shown[cut], expected)
        shown[cut] = 0
        assert not shown.any()


@pytest.mark.parametrize("camera", ["free", "above"])
def test_a_sensor_of_choice_measures(viewer: Viewer, camera: str) -> None:
    truth = viewer.picture(ViewSelection("depth", camera, 0), eye(1.5))
    measured = viewer.picture(ViewSelection("depth", camera, 0, "kinect_v1"), eye(1.5))
    again = viewer.picture(ViewSelection("depth", camera, 0, "kinect_v1"), eye(1.5))
    assert (truth != measured).any(-1).mean() > 0.05
    assert (again != measured).any(-1).mean() > 0.05  # another frame
    assert (viewer.picture(ViewSelection("depth", camera, 0), eye(1.5)) == truth).all()


@pytest.mark.usefixtures("small_maps")
def test_environments(simulated: Any, device: wp.Device) -> None:
    """They are seen in the looks that they light, and MuJoCo's is as without."""
    scene = wc.from_mujoco(*simulated, device=device)
    red = wc.Environments(scene, np.full((4, 8, 3), (0.5, 0.0, 0.0), np.float32))
    with pytest.raises(wc.WarpcamError, match="Viewer: environments light look='pbr' and look='path', and the look is"):
        Viewer(scene, environments=red)
    viewer = Viewer(scene, width=48, height=32, port=8300, look="pbr", environments=red)
    try:
        sky = {
            look: viewer.picture(ViewSelection("rgb", viewers.FREE, 0, look=look), eye(1.5))[0, 0]
            for look in ("mujoco", "pbr")
        }
    finally:
        viewer.close()
    assert (sky["pbr"] == (188, 0, 0)).all()
    assert (sky["mujoco"] != sky["pbr"]).any()


@pytest.mark.parametrize("moved", [3, None, "yes"])
def test_update_takes_true_or_false(viewer: Viewer, moved: Any) -> None:
    with pytest.raises(wc.WarpcamError, match=rf"Viewer.update: moved must be True or False, got {moved!r}"):
        viewer.update(moved=moved)


@pytest.fixture
def open_page(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Opens a page of a number: its camera, and the pictures that it has been sent."""
    pages: dict[int, Any] = {}
    monkeypatch.setattr(viewer.server, "get_clients", lambda: dict(pages))

    def open_one(number: int) -> tuple[Any, list[np.ndarray]]:
        sent: list[np.ndarray] = []
        camera = SimpleNamespace(**{name: np.array(value) for name, value in eye(1.5)._asdict().items()})
        keep = SimpleNamespace(set_background_image=lambda image, *_, **__: sent.append(image))
        pages[number] = SimpleNamespace(camera=camera, scene=keep)
        return camera, sent

    return open_one


def test_only_what_has_changed_is_drawn(viewer: Viewer, simulated: Any, open_page: Any) -> None:
    mjm, (state, _) = simulated
    assert viewer.update() == 0
    _, first = open_page(0)
    assert viewer.update(moved=False) == 1
    assert viewer.update(moved=False) == 0
    camera, second = open_page(1)
    assert viewer.update(moved=False) == 1
    np.testing.assert_array_equal(first[-1], second[-1])
    camera.position = np.add(camera.position, (0.0, 0.0, 0.4))
    assert viewer.update(moved=False) == 1
    assert (first[-1] != second[-1]).any()
    state.qpos[2] += 0.3
    mujoco.mj_forward(mjm, state)
    assert viewer.update() == 2
    assert (first[-1] != first[-2]).any()
    viewer._output.value = "depth"
    assert viewer.update(moved=False) == 2
    assert (first[-1] != first[-2]).any()
    assert (len(first), len(second)) == (3, 4)


def traced(viewer: Viewer, samples: int, position: Any = PLACE) -> np.ndarray:
    """World 0 by so many paths a pixel, of a camera at PLACE or moved from there without a turn."""
    own = wc.Camera(
        "own",
        width=48,
        height=32,
        outputs=("rgb",),
        lens=wc.Pinhole(fovy=50.0),
        position=position,
        rotation=scenes.looking(PLACE, TARGET),
    )
    renderer = wc.Renderer(viewer._scene, [own], look="path", path=wc.PathOptions(samples=samples))
    return renderer.render()["own"]["rgb"][0].cpu().numpy()


def assert_alike(picture: np.ndarray, expected: np.ndarray) -> None:
    """But for paths that rounding of the camera's pose sends elsewhere."""
    assert (picture != expected).any(-1).mean() < 0.02


def test_looks_are_those_of_the_scene(viewer: Viewer, device: wp.Device) -> None:
    assert viewer._look.options == ("mujoco", "pbr", "path")
    pictures = {
        name: viewer.picture(ViewSelection("rgb", "above", 0, look=name), eye(1.5)) for name in ("mujoco", "pbr")
    }
    assert (pictures["mujoco"] != pictures["pbr"]).any()
    for name, picture in pictures.items():
        own = wc.Camera("above", width=48, height=32, outputs=("rgb",), shadows=True, antialiasing=4)
        image = wc.Renderer(viewer._scene, [own], look=name).render()["above"]["rgb"][0].cpu().numpy()
        np.testing.assert_array_equal(picture, image)
    file = Path(__file__).parents[2] / "warpcam" / "data" / "vase.obj"
    other = Viewer(wc.load(file, device=device), width=16, height=16, port=18080, look="path")
    assert (other._look.options, other._look.value) == (("pbr", "path"), "path")
    other.close()


def test_paths_are_added_while_nothing_moves(
    viewer: Viewer, simulated: Any, open_page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until a picture has its fill; what moves begins anew."""
    monkeypatch.setattr(viewers, "MOST_SAMPLES", 12)
    monkeypatch.setattr(viewers, "_paced", lambda added, seconds: 4)
    mjm, (state, _) = simulated
    camera, sent = open_page(0)
    viewer._look.value = "path"
    shown = []
    while viewer.update(moved=False):
        shown.append(viewer._paths.value)
    assert viewer._paths.visible
    assert shown == [1, 5, 9, 12]
    for picture, samples in zip(sent, shown, strict=True):
        assert_alike(picture, traced(viewer, samples))
    camera.position = np.add(PLACE, (0.0, 0.0, 0.4))
    assert [viewer.update(moved=False) for _ in range(4)] == [1, 1, 1, 0]  # 4, 8 and 12 paths
    assert_alike(sent[-3], traced(viewer, 4, camera.position))
    assert_alike(sent[-1], traced(viewer, 12, camera.position))
    state.qpos[2] += 0.3
    mujoco.mj_forward(mjm, state)
    assert viewer.update() == 1
    assert viewer._paths.value == 4
    assert_alike(sent[-1], traced(viewer, 4, camera.position))
    viewer._output.value = "depth"  # which no light changes
    assert [viewer.update(moved=False) for _ in range(2)] == [1, 0]
    assert not viewer._paths.visible


def test_pages_that_look_from_elsewhere_get_their_paths_one_after_the_other(
    viewer: Viewer, open_page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewers, "MOST_SAMPLES", 8)
    monkeypatch.setattr(viewers, "_paced", lambda added, seconds: 4)
    viewer._look.value = "path"
    _, first = open_page(0)
    camera, second = open_page(1)
    camera.position = np.add(PLACE, (0.0, 0.0, 0.4))
    assert [viewer.update(moved=False) for _ in range(5)] == [2, 1, 1, 1, 0]
    assert_alike(first[-1], traced(viewer, 8))
    assert_alike(second[-1], traced(viewer, 8, camera.position))
    assert (len(first), len(second)) == (3, 2)


def test_paths_come_as_fast_as_they_are_drawn() -> None:
    added = [16]
    for seconds in (0.001, 0.001, viewers.PACE, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0):
        added.append(viewers._paced(added[-1], seconds))
    assert added == [16, 32, 64, 64, 32, 16, 8, 4, 2, 1, 1]
    assert viewers._paced(viewers.MOST_ADDED, 0.001) == viewers.MOST_ADDED


def test_the_page_is_served(viewer: Viewer) -> None:
    with urllib.request.urlopen(viewer.url, timeout=10.0) as page:
        assert page.status == 200
        assert b"<html" in page.read().lower()


def test_the_address_of_a_host_with_colons() -> None:
    mjm = scenes.compile_xml("<geom size='0.1'/>")
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device="cpu")
    try:
        viewer = Viewer(scene, width=16, height=16, host="::1")
    except wc.WarpcamError:
        pytest.skip("this machine has no IPv6")
    with contextlib.closing(viewer), urllib.request.urlopen(viewer.url, timeout=10.0) as page:
        assert viewer.url.startswith("http://[::1]:") and page.status == 200


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"width": 0}, "width must be a whole number from 1 to 8192, got 0"),
        ({"height": 32.0}, "height must be a whole number"),
        ({"port": 70000}, "port must be a whole number from 1 to 65535"),
        ({"host": 8080}, "host must be an address"),
        ({"host": "192.0.2.1"}, "host must be an address of this machine .* got '192.0.2.1'"),
        ({"host": "nowhere.invalid"}, "host must be an address of this machine .* got 'nowhere.invalid'"),
        ({"scene": "demo.xml"}, "scene must be a Scene, got str"),
        ({"look": "toon"}, "look is 'toon'; allowed are 'mujoco', 'pbr', 'path'"),
    ],
)
def test_wrong_arguments_are_told(changes: dict[str, Any], told: str) -> None:
    mjm = scenes.compile_xml("<geom size='0.1'/>")
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device="cpu")
    arguments = {"scene": scene, "width": 16, "height": 16, **changes}
    with pytest.raises(wc.WarpcamError, match=told):
        Viewer(**arguments)


def test_without_viser_it_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "warpcam.viewer")
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(wc.WarpcamError, match=r"pip install 'warpcam\[view\]'"):
        import warpcam.viewer  # noqa: F401


SWING = """<mujoco><option timestep="0.004"/><worldbody><light pos="0 0 3"/>
  <body pos="0 0 1"><joint name="h" axis="0 1 0" range="-90 90" limited="true" ref="0"/>
    <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/></body></worldbody></mujoco>"""


def test_a_simulation_follows_the_clock(tmp_path: Path) -> None:
    (tmp_path / "swing.xml").write_text(SWING)
    simulation = Simulation(tmp_path / "swing.xml", 3, seed=4)
    starts = [float(state.qpos[0]) for state in simulation.states]
    assert starts[0] == 0.0
    assert len(set(starts)) == 3
    expected = mujoco.MjData(simulation.host)
    mujoco.mj_step(simulation.host, expected, nstep=12)
    moved = [
        simulation.advance(seconds) for seconds in (0.0195, 0.0025, 0.029, 0.0005)
    ]  # 4.9, 5.5, 12.75 and 12.9 steps
    assert moved == [True, True, True, False]
    np.testing.assert_array_equal(simulation.states[0].qpos, expected.qpos)
    controls: dict[str, Any] = {}

    def control(name: str, *_: Any, **__: Any) -> Any:
        keep = lambda react: controls.__setitem__(name, react)  # noqa: E731
        return SimpleNamespace(on_click=keep, on_update=keep)

    simulation.add_controls(SimpleNamespace(add_checkbox=control, add_button=control))
    controls["Simulate"](SimpleNamespace(target=SimpleNamespace(value=False)))
    assert not simulation.advance(1.0)
    np.testing.assert_array_equal(simulation.states[0].qpos, expected.qpos)
    controls["Restart"](None)
    assert simulation.advance(0.0)
    np.testing.assert_allclose([float(state.qpos[0]) for state in simulation.states], starts)


@pytest.mark.parametrize("name", ["swing.xml", "thing.stl"])
def test_the_command_serves_a_file_until_interrupted(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    if path.suffix == ".xml":
        path.write_text(SWING)
    else:
        trimesh.creation.box().export(path)
    seen: list[bool] = []

    def update(self: Viewer, moved: bool) -> int:
        assert self._look.value == "pbr"
        assert self._rays == {
            "ambient_occlusion": 0.5,
            "soft_shadows": True,
            "indirect_light": False,
            "reflections": True,
        }
        seen.append(moved)
        if len(seen) == 4:
            raise KeyboardInterrupt
        return 0

    monkeypatch.setattr(viewers.Viewer, "update", update)
    options = "--worlds 2 --size 32x24 --device cpu --port 18090 --look pbr --ambient-occlusion 0.5 --soft-shadows"
    assert cli.main(["view", str(path), *options.split(), "--reflections"]) == 0
    assert "http://127.0.0.1:180" in capsys.readouterr().out
    assert any(seen) == (path.suffix == ".xml")


@pytest.mark.parametrize(("flag", "value"), [("--worlds", "0"), ("--size", "big"), ("--port", "0"), ("--seed", "-1")])
def test_the_command_tells_what_is_wrong(flag: str, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["view", "--device", "cpu", flag, value]) == 2
    assert flag.lstrip("-") in capsys.readouterr().err
