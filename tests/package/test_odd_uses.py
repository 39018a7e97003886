"""Odd uses: each works, or gives an error that names what came."""

import copy
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fast_compile
import mujoco
import numpy as np
import pytest
import sphere_scenes
import torch
import warp as wp

import warpcam as wc

WORLDS = 3
HALFWAY = np.sqrt(0.5)


@pytest.fixture(scope="module")
def scene() -> wc.Scene:
    return sphere_scenes.Simulation("cpu", WORLDS).scene


def own(**changes: Any) -> wc.Camera:
    settings: dict[str, Any] = {"lens": wc.Pinhole(fovy=60.0), "position": (0.0, 0.0, 5.0), "outputs": ("depth",)}
    return wc.Camera("own", width=8, height=8, **{**settings, **changes})


def depth(scene: wc.Scene, **changes: Any) -> torch.Tensor:
    return wc.Renderer(scene, [own(**changes)]).render()["own"]["depth"]


def says(text: str) -> Any:
    return pytest.raises(wc.WarpcamError, match=re.escape(text))


# Position and rotation in other forms, which mean what (0, 0, 5) and a quarter turn about z do.
FORMS: dict[str, dict[str, Any]] = {
    "doubles": {"position": torch.tensor([0.0, 0.0, 5.0], dtype=torch.float64)},
    "brain floats": {"position": torch.tensor([0.0, 0.0, 5.0], dtype=torch.bfloat16)},
    "whole numbers": {"position": torch.tensor([0, 0, 5])},
    "with a gradient": {"position": torch.tensor([0.0, 0.0, 5.0], requires_grad=True)},
    "strided": {"position": torch.tensor([[0.0, 9.0], [0.0, 9.0], [5.0, 9.0]])[:, 0]},
    "a vector of Warp": {"position": wp.vec3(0.0, 0.0, 5.0)},
    "an array of Warp": {"position": wp.array([(0.0, 0.0, 5.0)] * WORLDS, dtype=wp.vec3, device="cpu")},
    "short": {"rotation": (1e-25 * HALFWAY, 0.0, 0.0, 1e-25 * HALFWAY)},
    "long": {"rotation": (1e30 * HALFWAY, 0.0, 0.0, 1e30 * HALFWAY)},
}


@pytest.mark.parametrize("form", FORMS)
def test_poses_in_other_forms(form: str, scene: wc.Scene) -> None:
    plain = {"rotation": (HALFWAY, 0.0, 0.0, HALFWAY)}
    assert torch.equal(depth(scene, **{**plain, **FORMS[form]}), depth(scene, **plain))


@contextmanager
def default_device() -> Iterator[None]:
    torch.set_default_device("meta")
    try:
        yield
    finally:
        torch.set_default_device(None)


@contextmanager
def default_dtype() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("state", [default_device, default_dtype, torch.inference_mode, torch.no_grad])
def test_torchs_own_state_changes_nothing(state: Callable[[], Any], scene: wc.Scene) -> None:
    expected = depth(scene)
    with state():
        renderer = wc.Renderer(scene, [own()])
        image = renderer.render(worlds=[0, 1, 2])["own"]["depth"]
    renderer.camera("own").position[:] = torch.tensor([0.0, 0.0, 6.0])
    assert image.device.type == "cpu" and torch.equal(image, expected)
    assert (renderer.render()["own"]["depth"] > expected).all()


def test_numbers_that_make_no_image_cost_their_world(scene: wc.Scene) -> None:
    expected = depth(scene).clone()
    nan, inf = float("nan"), float("inf")
    bad = {"position": (nan, inf), "rotation": (nan, 0.0, 1e-25, 1e30), "fovy": (nan, 0.0, 180.0, -30.0)}
    bad |= {"near": (nan, -1.0, inf), "far": (nan, -1.0, 0.0)}
    for name, values in bad.items():
        for value in values:
            renderer = wc.Renderer(scene, [own()])
            getattr(renderer.camera("own"), name)[1] = value
            image = renderer.render()["own"]["depth"]
            assert renderer.faulty.tolist() == [0, 1, 0], (name, value)
            assert image[1].isinf().all() and torch.equal(image[[0, 2]], expected[[0, 2]])


def test_arrays_of_a_camera_are_written_in_place(scene: wc.Scene) -> None:
    renderer = wc.Renderer(scene, [own()])
    front = renderer.camera("own")
    front.fovy += 1.0
    assert front.fovy.tolist() == [61.0] * WORLDS
    with says("Camera('own'): position cannot be replaced; write to it in place: position[:] = ..."):
        front.position = torch.zeros(WORLDS, 3)
    with says(
        "Camera('own') has no array 'background' of its own, it has position, rotation, fovy, near, far; "
        "background is there where Camera was given one for each world"
    ):
        front.background = torch.zeros(WORLDS, 3)
    assert not hasattr(front, "gain")
    with says("randomize: fovy takes Uniform or (low, high), got Choice"):
        wc.randomize(front, seed=1, fovy=[1, 2])
    with says("it has position, rotation, fovy, near, far; exposure is there where Camera was given one"):
        wc.randomize(front, seed=1, exposure=(0.0, 1.0))


def test_lenses_that_make_no_image_are_not_drawn(scene: wc.Scene) -> None:
    with says("randomize: fovy: values must be from 0 to 180, got 50.0, 600.0"):
        wc.randomize(wc.Renderer(scene, [own()]).camera("own"), fovy=(50.0, 600.0))
    with says("randomize: height: values must be from 0 to inf, got -1.0, 1.0"):
        wc.randomize(wc.Renderer(scene, [own(lens=wc.Orthographic(1.0))]).camera("own"), height=(-1.0, 1.0))


META = "tensor(..., device='meta'"
CAMERAS = {
    f"Camera('own'): position must be numbers, (3,) or (3, 3), got {META}": {"position": torch.ones(3, device="meta")},
    "Camera('own'): position must be numbers, (3,) or (3, 3), got array([0.+1.j": {"position": np.array([1j, 0, 0])},
    "Camera('own'): position must be finite, got inf": {"position": (0.0, 0.0, 1e300)},
    f"Camera('own'): lens Rays: directions must be numbers, got {META}": {
        "lens": wc.Rays(torch.ones((8, 8, 3), device="meta"))
    },
    "Camera('own'): antialiasing is 4.0; allowed are 1, 4": {"antialiasing": 4.0},
}


@pytest.mark.parametrize("text", CAMERAS)
def test_cameras(text: str, scene: wc.Scene) -> None:
    with says(text):
        wc.Renderer(scene, [own(**CAMERAS[text])])


def test_renderers(scene: wc.Scene) -> None:
    renderer = wc.Renderer(scene, [own()])
    with says(f"render: worlds must be ids (n,), or a mask (3,) of bool or uint8, got {META}"):
        renderer.render(worlds=torch.ones(WORLDS, dtype=torch.bool, device="meta"))
    with says("Renderer: camera [] came, it renders 'own'"):
        renderer.array([], "depth")  # type: ignore[arg-type]
    with says("Renderer.array: output [] came, 'own' renders depth"):
        renderer.array("own", [])  # type: ignore[arg-type]
    with says("render: forward must be True or False, got 'no'"):
        renderer.render(forward="no")  # type: ignore[arg-type]
    with says("Renderer: graph must be True or False, got 'no'"):
        wc.Renderer(scene, [own()], graph="no")  # type: ignore[arg-type]
    for way in (pickle.dumps, copy.copy, copy.deepcopy):
        with says("Renderer: it cannot be copied or pickled, as it holds memory of a device"):
            way(renderer)
        with says("Camera('own'): its arrays cannot be copied or pickled: no frame would read the copy"):
            way(renderer.camera("own"))


def test_scenes(scene: wc.Scene) -> None:
    with says("array: 'shape_colours' came; this scene has shape_positions, "):
        scene.array("shape_colours")
    with says("vary: [] came; in this scene it may be shape_colors, "):
        scene.vary([])  # type: ignore[arg-type]
    for way in (pickle.dumps, copy.copy, copy.deepcopy):
        with says("Scene: it cannot be copied or pickled, as it holds memory of a device"):
            way(scene)
    with pytest.raises(AttributeError):
        scene.num_worlds = 5  # type: ignore[misc]
    mjm = mujoco.MjModel.from_xml_string(sphere_scenes.MODEL)
    for name in ("reflections", "transparency"):
        for word in ("no", "backs"):
            with says(f"{name} must be True, False or None, got {word!r}"):
                wc.from_mujoco(mjm, mujoco.MjData(mjm), device="cpu", **{name: word})


def test_recipes() -> None:
    model = sphere_scenes.MODEL.replace("<worldbody>", '<asset><material name="m"/></asset><worldbody>')
    mjm = mujoco.MjModel.from_xml_string(model)
    scene = wc.from_mujoco(mjm, mujoco.MjData(mjm), device="cpu")
    with says("randomize: material_texture: a choice of indices takes -1 for none alone, got [99]"):
        wc.randomize(scene, seed=1, material_texture=[99])
    with says("randomize: shape_materials: a choice of indices takes -1 for none and 0 to 0, got [-2]"):
        wc.randomize(scene, seed=1, shape_materials=[-2])
    with says("randomize: shape_materials: what is chosen from must be whole numbers, got [0.7]"):
        wc.randomize(scene, seed=1, shape_materials=[0.7])
    with says("randomize: shape_colors: rows must be whole numbers, got 'a'"):
        wc.randomize(scene, seed=1, shape_colors=wc.Uniform(0.0, 1.0, rows="a"))  # type: ignore[arg-type]
    with says("randomize: shape_colors: of must be one of 'value', 'offset', 'factor', 'turn', got ['value']"):
        wc.randomize(scene, seed=1, shape_colors=wc.Uniform(0.0, 1.0, of=["value"]))  # type: ignore[arg-type]
    with says("randomize: shape_colors: linked must be True or False, got array([1, 0])"):
        linked: Any = np.array([1, 0])
        wc.randomize(scene, seed=1, shape_colors=wc.Uniform(0.0, 1.0, linked=linked))
    with says("randomize: shape_colors: bounds must be finite numbers, got 1e+300"):
        wc.randomize(scene, seed=1, shape_colors=wc.Uniform(0.0, 1e300))


# Renders, and renders again in a child that has been forked off, where the threads of the parent are not.
FORKING = """
import os, sys
sys.path.append(sys.argv[1])
import sphere_scenes
renderer = sphere_scenes.Simulation("cpu").renderer(("depth",))
expected = renderer.render()["top"]["depth"].clone().numpy()
child = os.fork()
if child == 0:
    renderer.images["top"]["depth"].zero_()
    os._exit(0 if (renderer.render()["top"]["depth"].numpy() == expected).all() else 3)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="it forks")
def test_a_forked_process_renders_on() -> None:
    folder = os.path.dirname(sphere_scenes.__file__)
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": "", "WARPCAM_CPU_THREADS": "2"}
    command = [sys.executable, fast_compile.__file__, "-c", FORKING, folder]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def test_binary_models_by_a_name_in_capitals(tmp_path: Path) -> None:
    path = str(tmp_path / "BALL.MJB")
    mujoco.mj_saveModel(
        mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"), path
    )
    assert wc.load(path, 2, device="cpu").num_worlds == 2


def test_files(tmp_path: Any) -> None:
    path = tmp_path / "balls.xml"
    path.write_text(sphere_scenes.MODEL)
    for count in (0, -1, 2.5, "2", True):
        with says(f"num_worlds must be a whole number, at least 1, got {count!r}"):
            wc.load(path, count)
    with says("num_worlds must be less than 2^31, got 1000000000000"):
        wc.load(path, 10**12)


def test_stages(stage: Any) -> None:
    from pxr import UsdGeom

    UsdGeom.Sphere.Define(stage, "/Ball")
    with says("num_worlds must be less than 2^31, got 2147483648"):
        wc.from_usd(stage, 2**31)
    with says("semantics must map labels to whole numbers, got list"):
        wc.from_usd(stage, semantics=["ball"])  # type: ignore[arg-type]
    with says("semantics: numbers must be of 32 bits, got 'ball': 4294967296"):
        wc.from_usd(stage, semantics={"ball": 2**32})
    with says("double_sided must be True, False or None, got 'both'"):
        wc.from_usd(stage, double_sided="both")  # type: ignore[arg-type]
    for exposure in ("bright", float("nan")):
        with says(f"exposure must be a finite number up to 127 or None, got {exposure!r}"):
            wc.from_usd(stage, exposure=exposure)
    with says("textures must map names to images, got list"):
        wc.from_usd(stage, textures=["oak.png"])  # type: ignore[arg-type]
    with says("textures must map names to images, got list"):
        wc.from_usd(stage, textures=[])  # type: ignore[arg-type]
    scene = wc.from_usd(stage, device="cpu")
    with says(f"set_poses: poses must be an array of float32, got {META}"):
        scene.set_poses(["/Ball"], torch.zeros(1, 1, 7, device="meta"))
    with says("set_poses: poses must have shape (1 or 1, 1, 7), got (1,)"):
        scene.set_poses(["/Ball"], torch.tensor(1.0))


LIGHTS = {
    "lights[0]: color must not be negative, got (-1, 0, 0)": {"color": (-1, 0, 0)},
    "lights[0]: intensity must not be negative, got -1.0": {"intensity": -1.0},
    "lights[0]: ambient must not be negative, got (0, 0, -1)": {"ambient": (0, 0, -1)},
    "lights[0]: exponent must not be negative, got -2.0": {"kind": "spot", "exponent": -2.0},
    "lights[0]: active must be True, False or (2,) bool, got 1": {"active": 1},
    "lights[0]: shadows must be True, False or (2,) bool, got [True, False, True]": {"shadows": [True, False, True]},
}


def lit(**changes: Any) -> wc.Scene:
    newton = pytest.importorskip("newton")
    robot, builder = newton.ModelBuilder(), newton.ModelBuilder()
    robot.add_shape_box(-1, hx=2.0, hy=2.0, hz=0.1)
    builder.replicate(robot, 2)
    with wp.ScopedDevice("cpu"):
        model = builder.finalize()
        return wc.from_newton(model, model.state(), lights=[wc.Light(**changes)], ambient=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("text", LIGHTS)
def test_lights(text: str) -> None:
    with says(text):
        lit(**LIGHTS[text])


def test_light_from_all_around_is_not_negative() -> None:
    newton = pytest.importorskip("newton")
    with wp.ScopedDevice("cpu"):
        model = newton.ModelBuilder().finalize()
        with says("ambient must not be negative, got (0.2, 0.2, -0.1)"):
            wc.from_newton(model, model.state(), ambient=(0.2, 0.2, -0.1))


def test_a_light_is_on_where_it_is_told() -> None:
    scene = lit(active=torch.tensor([False, True]))
    image = wc.Renderer(scene, [own(outputs=("rgb",))]).render()["own"]["rgb"]
    assert (image[0] == 0).all() and (image[1, 2:6, 2:6] > 100).all()


def test_nothing_is_made_within_a_capture(stage: Any, device: wp.Device) -> None:
    from pxr import UsdGeom

    UsdGeom.Sphere.Define(stage, "/Ball")
    scene = wc.from_usd(stage, device=device)
    poses = torch.tensor([[[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]], device=wp.device_to_torch(device))
    visible = torch.ones(1, 1, dtype=torch.bool, device=poses.device)
    renderer = wc.Renderer(scene, [own()])
    renderer.render()
    tries: dict[str, Callable[[], Any]] = {
        "Renderer": lambda: wc.Renderer(scene, [own()]),
        "set_lens": lambda: renderer.set_lens("own", wc.Fisheye(fovy=90.0)),
        "set_poses, for the first time of these paths": lambda: scene.set_poses(["/Ball"], poses),
        "set_visible, for the first time of these paths": lambda: scene.set_visible(["/Ball"], visible),
        "set_time": lambda: scene.set_time(0.0),
    }
    with wp.ScopedCapture(device):
        for what, call in tries.items():
            with says(f"{what}: a capture is under way; do this before it"):
                call()
    scene.set_poses(["/Ball"], poses)
    with wp.ScopedCapture(device):
        scene.set_poses(["/Ball"], poses)
    wc.Renderer(scene, [own()]).render()
