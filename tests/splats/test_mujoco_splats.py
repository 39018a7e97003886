"""Clouds of Gaussians that a user puts into scenes of MuJoCo, another one in each world."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.core import torch_interop
from warpcam.tools import cli

CAMERA = '<camera name="eye" pos="0 -4 0" xyaxes="1 0 0 0 0 1" fovy="40"/>'
BALL = '<body name="cart" pos="0 0 0.4"><freejoint/><geom type="sphere" size="0.2" pos="1 0 0"/></body>'
WORLD = f"{CAMERA}<site pos='0 0 9'/>{BALL}"
RED, GREEN, BLUE = (0.9, 0.1, 0.2), (0.1, 0.8, 0.3), (0.2, 0.3, 0.9)
OPACITY, SIZE, FOVY = 0.8, 0.3, 40.0
CENTER = (12, 16)
STEP = 1.0 / 255.0


def cloud(color: Any, **changes: Any) -> Mapping[str, Any]:
    """One Gaussian at the origin."""
    return {
        "positions": np.zeros((1, 3)), "scales": np.full((1, 3), SIZE), "colors": [color], "opacities": [OPACITY],
        **changes,
    }  # fmt: skip


def eye(*outputs: str) -> wc.Camera:
    return wc.Camera("eye", width=33, height=25, outputs=outputs or ("rgb", "depth", "segmentation", "bodies"))


def scene_of(splats: Any, device: wp.Device, num_worlds: int = 3, world: str = WORLD) -> tuple[wc.Scene, Any]:
    """A scene of MuJoCo-Warp, and its Data."""
    mjm = scenes.compile_xml(world)
    with wp.ScopedDevice(device):
        d = mjw.put_data(mjm, scenes.forward(mjm), nworld=num_worlds)
        return wc.from_mujoco_warp(mjm, mjw.put_model(mjm), d, splats=splats), d


def alphas(middle: Any) -> np.ndarray:
    """Alpha of one Gaussian with its centre there, (height, width), by definition."""
    directions = scenes.pixel_rays(33, 25, FOVY) @ np.array(((1, 0, 0), (0, 0, 1), (0, -1, 0)))
    offset = np.cross(np.array((0.0, -4.0, 0.0)) - middle, directions)
    squared = (offset**2).sum(-1) / (directions**2).sum(-1) / SIZE**2
    response = np.exp(-0.5 * squared)
    return np.where(response > 0.0113, OPACITY * response, 0.0)


def test_each_world_has_its_own(device: wp.Device) -> None:
    scene, _ = scene_of(wc.Splats([cloud(RED), cloud(GREEN)], choice=[0, 1, -1]), device)
    renderer = wc.Renderer(scene, [eye()])
    seen = scenes.on_host(renderer.render()["eye"])
    away = np.arange(33) < 22  # from where the ball is
    for world, color in enumerate((RED, GREEN, (0.0, 0.0, 0.0))):
        expected = alphas((0.0, 0.0, 0.0))[..., None] * np.array(color)
        assert np.abs(seen["rgb"][world] * STEP - expected)[:, away].max() < 1.5 * STEP
    assert seen["depth"][:, *CENTER] == pytest.approx((4.0, 4.0, np.inf))
    # the ball is geom 0, the site 1 and the splats 2: objects of no kind of MuJoCo's, on the world body
    assert seen["segmentation"][:, *CENTER].tolist() == [2, 2, -1]
    assert seen["bodies"][:, *CENTER].tolist() == [0, 0, -1]
    assert scene.objects.tolist() == [
        [0, mujoco.mjtObj.mjOBJ_GEOM],
        [0, mujoco.mjtObj.mjOBJ_SITE],
        [0, mujoco.mjtObj.mjOBJ_UNKNOWN],
        [-1, -1],
    ]
    choice = scene.vary("splat_choice")
    assert (choice.shape, choice.tolist()) == ((3, 1), [[0], [1], [-1]])
    choice[:, 0] = choice[:, 0].flip(0)  # in place: the next frame shows it
    after = scenes.on_host(renderer.render()["eye"])
    for name in ("rgb", "depth", "segmentation"):
        assert np.array_equal(after[name], seen[name][::-1], equal_nan=True)


def test_they_move_with_a_body(device: wp.Device) -> None:
    turned = (np.cos(0.25 * np.pi), 0.0, np.sin(0.25 * np.pi), 0.0)  # a quarter of a turn about y: x to -z
    splats = wc.Splats(cloud(RED, positions=[(0.1, 0.0, 0.0)]), body="cart", position=(0.0, 0.0, 0.2), rotation=turned)
    scene, d = scene_of([splats], device)
    renderer = wc.Renderer(scene, [eye()])
    for shift, rotation, middle in (
        (0.0, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.4 + 0.2 - 0.1)),
        (-0.3, (1.0, 0.0, 0.0, 0.0), (-0.3, 0.0, 0.4 + 0.2 - 0.1)),
        (-0.3, turned, (-0.3 + 0.2 - 0.1, 0.0, 0.4)),  # z to x, and what was -z to -x
    ):
        scenes.write(d.qpos, (slice(None), 0), shift)
        scenes.write(d.qpos, (slice(None), slice(3, 7)), rotation)
        with wp.ScopedDevice(device):
            seen = scenes.on_host(renderer.render(forward=True)["eye"])
        expected = alphas(middle)[..., None] * np.array(RED)
        assert np.abs(seen["rgb"] * STEP - expected)[:, :14, :18].max() < 1.5 * STEP  # apart from the ball
    row, column = np.argwhere(seen["segmentation"][0] == 2)[0]
    assert (seen["bodies"][:, row, column] == 1).all()


def test_size_and_several(device: wp.Device) -> None:
    """Each ``Splats`` is a shape of its own: a choice, and an id."""
    big = wc.Splats([cloud(BLUE, scales=np.full((1, 3), SIZE / 2)), cloud(GREEN)], scale=2.0, position=(-0.6, 0.0, 0.0))
    scene, _ = scene_of((wc.Splats(cloud(RED), choice=-1), big), device, num_worlds=2)
    seen = scenes.on_host(wc.Renderer(scene, [eye()]).render()["eye"])
    expected = alphas((-0.6, 0.0, 0.0))[..., None] * np.array(BLUE)
    assert np.abs(seen["rgb"] * STEP - expected)[:, :, :22].max() < 1.5 * STEP
    assert set(np.unique(seen["segmentation"])) == {-1, 0, 3}
    assert scene.vary("splat_choice").tolist() == [[-1, 0]] * 2


def test_classic_mujoco_and_one_row(device: wp.Device) -> None:
    """Sites are drawn, which a table of its own is made for; poses come from the host."""
    mjm = scenes.compile_xml(f"{CAMERA}{BALL}<site pos='-1 0 0' size='0.2'/>")
    mjds = [scenes.forward(mjm) for _ in range(2)]
    plain = scenes.look(wc.from_mujoco(mjm, mjds, device=device), eye())
    splats = wc.Splats([cloud(RED)], choice=[-1, 0], position=(0.0, 0.0, -0.4), body="cart")
    scene = wc.from_mujoco(mjm, mjds, device=device, splats=splats)
    seen = scenes.look(scene, eye())
    for name, image in plain.items():
        assert np.array_equal(seen[name][0], image[0], equal_nan=True)
    assert seen["segmentation"][1, *CENTER] == 2
    site = plain["segmentation"][1] == 1
    assert site.any()
    assert (seen["segmentation"][1] == 1)[site].all()
    mjds[1].qpos[2] += 3.0
    mujoco.mj_forward(mjm, mjds[1])
    assert scenes.look(scene, eye())["segmentation"][1, *CENTER] == -1


def test_colors_of_shapes_are_varied(device: wp.Device) -> None:
    scene, _ = scene_of(wc.Splats(cloud(RED)), device)
    colors = scene.vary("shape_colors")
    colors[:, 0, :3] = torch_interop.to_torch(wp.array([(0.0, 1.0, 0.0)], dtype=wp.float32, device=device))
    colors[1, -1, 3] = 0.5  # half of the cloud's opacity
    colors[2, -1, 3] = 0.0
    seen = scenes.look(scene, eye())
    assert seen["rgb"][:, *CENTER, 0] * STEP == pytest.approx(OPACITY * RED[0] * np.array((1.0, 0.5, 0.0)), abs=STEP)
    ball = seen["rgb"][0][seen["segmentation"][0] == 0]
    assert ball[:, 1].max() > 0
    assert ball[:, 0].max() < 10  # of the cloud that lies over it


def test_choice_is_drawn_at_random(device: wp.Device) -> None:
    scene, _ = scene_of(wc.Splats([cloud(RED), cloud(GREEN)]), device, num_worlds=64)
    wc.randomize(scene, splat_choice=[-1, 0, 1], seed=3)
    choice = scene.vary("splat_choice").cpu().numpy()[:, 0]
    assert set(choice) == {-1, 0, 1}
    colors = scenes.look(scene, eye())["rgb"][:, *CENTER] * STEP
    expected = OPACITY * np.array((RED, GREEN, (0.0, 0.0, 0.0)))[choice]
    assert np.abs(colors - expected).max() < STEP
    with pytest.raises(wc.WarpcamError, match="splat_choice: a choice of indices takes -1 for none and 0 to 1, got"):
        wc.randomize(scene, splat_choice=[0, 2])


def test_no_such_cloud_is_a_fault_of_the_world(device: wp.Device) -> None:
    scene, _ = scene_of(wc.Splats([cloud(RED), cloud(GREEN)]), device)
    renderer = wc.Renderer(scene, [eye()])
    choice = scene.vary("splat_choice")
    choice[1], choice[2] = 2, -2
    seen = scenes.on_host(renderer.render()["eye"])
    assert seen["segmentation"][:, *CENTER].tolist() == [2, -1, -1]
    assert renderer.faulty.tolist() == [0, 1, 1]


def write_ply(path: Path, color: Any) -> None:
    """One Gaussian as ``cloud`` has it, as training writes it."""
    harmonics = (np.array(color) - 0.5) / 0.28209479177387814
    values = {
        **dict(zip("xyz", np.zeros(3), strict=True)), **{f"f_dc_{k}": harmonics[k] for k in range(3)},
        "opacity": np.log(OPACITY / (1.0 - OPACITY)), **{f"scale_{k}": np.log(SIZE) for k in range(3)},
        "rot_0": 1.0, **{f"rot_{k}": 0.0 for k in range(1, 4)},
    }  # fmt: skip
    head = ["ply", "format ascii 1.0", "element vertex 1", *(f"property float {name}" for name in values), "end_header"]
    path.write_text("\n".join([*head, " ".join(map(str, values.values())), ""]))


def test_files(device: wp.Device, tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    for name, color in (("red", RED), ("green", GREEN)):
        write_ply(tmp_path / f"{name}.ply", color)
    (tmp_path / "scene.xml").write_text(f"<mujoco><worldbody>{WORLD}</worldbody></mujoco>")
    splats = wc.Splats([tmp_path / "red.ply", str(tmp_path / "green.ply")], choice=[1, 0])
    scene = wc.load(tmp_path / "scene.xml", 2, device=device, splats=splats)
    colors = scenes.look(scene, eye())["rgb"][:, *CENTER] * STEP
    assert np.abs(colors - OPACITY * np.array((GREEN, RED))).max() < STEP
    (tmp_path / "mesh.ply").write_text("ply\nformat ascii 1.0\nelement vertex 0\nend_header\n")
    for name, message in (
        ("none.ply", "there is no such file"), ("scene.xml", "allowed are .ply files"), ("mesh.ply", "mesh.ply: "),
    ):  # fmt: skip
        with pytest.raises(wc.WarpcamError, match=message):
            wc.load(tmp_path / "scene.xml", device=device, splats=wc.Splats(tmp_path / name))
    text = (tmp_path / "red.ply").read_text().replace("float f_dc_2\n", "float f_dc_2\nproperty float f_rest_0\n")
    (tmp_path / "rest.ply").write_text(text.rstrip() + " 0.0\n")
    with pytest.raises(wc.WarpcamError, match=r"rest\.ply: .* have 1 columns f_rest"):
        wc.load(tmp_path / "scene.xml", device=device, splats=wc.Splats(tmp_path / "rest.ply"))
    body = text.index("end_header\n") + len("end_header\n")
    (tmp_path / "empty.ply").write_text(re.sub(r"element vertex \d+", "element vertex 0", text[:body]))
    with pytest.raises(wc.WarpcamError, match=r"empty\.ply: has 0 vertices: neither Gaussian splats nor triangles"):
        wc.load(tmp_path / "scene.xml", device=device, splats=wc.Splats(tmp_path / "empty.ply"))
    small = wc.Splats(tmp_path / "red.ply", limits=wc.Limits(file_bytes=100))
    with pytest.raises(wc.WarpcamError, match="100"):
        wc.load(tmp_path / "scene.xml", device=device, splats=small)
    with pytest.raises(wc.WarpcamError, match=r"splats is for .xml, .* not for .ply files"):
        wc.load(tmp_path / "red.ply", device=device, splats=wc.Splats(tmp_path / "red.ply"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"clouds": []}, "Splats: clouds is empty"),
        ({"clouds": 3}, "Splats: clouds must be paths of .ply files or mappings .* got int"),
        ({"clouds": (cloud(RED) for _ in range(2))}, "Splats: clouds must be .* got generator"),
        ({"clouds": [cloud(RED), None]}, "Splats: clouds must be .* got NoneType"),
        ({"position": (0, 0)}, r"Splats: position must be 3 finite numbers, got \(0, 0\)"),
        ({"rotation": (0, 0, 0, 0)}, "Splats: rotation must be a quaternion of any length but 0"),
        ({"scale": 0.0}, "Splats: scale must be above 0, got 0.0"),
        ({"scale": (1.0, np.nan, 1.0)}, "Splats: scale must be a finite number or 3 finite numbers"),
        ({"scale": 1e-300}, "Splats: scale must be above 0, got 1e-300"),
        ({"scale": 1e300}, r"Splats: scale must be a finite number or 3 finite numbers, got 1e\+300"),
        ({"position": (0.0, 1e300, 0.0)}, "Splats: position must be 3 finite numbers"),
        ({"rotation": wp.quat(0.0, 0.0, 0.0, 1.0)}, "Splats: rotation .*wp.quat"),
        ({"body": 1.5}, "Splats: body must be a name, an index or None, got 1.5"),
        ({"body": "arm"}, "Splats: body: the scene has no body 'arm'; it has: 'world', 'cart'"),
        ({"choice": [0, 1]}, "Splats: choice must be a whole number or one for each of 3 worlds"),
        ({"choice": 0.5}, "Splats: choice must be a whole number or one for each of 3 worlds"),
        ({"choice": [0, 2, -1]}, "Splats: choice has 2; allowed are -1 for none and 0 to 1"),
        ({"clouds": {"positions": np.zeros((1, 3))}}, "'scales', 'colors' is missing; needed are positions"),
        ({"clouds": cloud(RED, rgba=1)}, "'rgba' came; needed are positions"),
        ({"clouds": cloud(RED, opacities=[1.5])}, r"opacities must be in \[0, 1\]"),
        ({"clouds": cloud(RED, scales=[(-1, 1, 1)])}, "scales must not be below 0"),
        ({"clouds": cloud(RED, scales=[(1, 1)])}, r"scales must have shape \(1, 3\), got \(1, 2\)"),
        ({"clouds": cloud(RED, positions=1.0)}, r"positions must have shape \(n, 3\), got \(\)"),
        ({"clouds": cloud(RED, positions=[(0.0, 1e300, 0.0)])}, r"positions must be finite and below 1e\+18"),
        ({"clouds": cloud(RED, rotations=[wp.quat(0.0, 0.0, 0.0, 1.0)])}, "rotations .*wp.quat"),
        ({"clouds": cloud(RED, colors="red")}, "colors must be an array of numbers, got str"),
    ],
)
def test_bad_splats(device: wp.Device, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        scene_of(wc.Splats(**{"clouds": [cloud(RED), cloud(GREEN)], **changes}), device)


def test_splats_are_splats(device: wp.Device) -> None:
    with pytest.raises(
        wc.WarpcamError, match=r"splats must be a warpcam\.Splats, a sequence of them or None, got dict"
    ):
        scene_of(cloud(RED), device)


def test_the_command(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    for name, color in (("red", RED), ("green", GREEN)):
        write_ply(tmp_path / f"{name}.ply", color)
    (tmp_path / "scene.xml").write_text(f"<mujoco><worldbody>{CAMERA}</worldbody></mujoco>")
    paths = [str(tmp_path / name) for name in ("scene.xml", "red.ply", "green.ply")]
    command = ["render", paths[0], "--splats", *paths[1:], "--worlds", "2", "--device", "cpu", "--size", "33x25"]
    assert cli.main([*command, "--outputs", "rgb", "--out", str(tmp_path / "out")]) == 0
    picture = np.asarray(Image.open(tmp_path / "out" / "eye-rgb.png"))
    found = {tuple(color) for color in picture.reshape(-1, 3).tolist()}
    for color in (RED, GREEN):
        assert min(np.abs(np.array(color) * OPACITY / STEP - each).max() for each in found) < 1.5
    assert cli.main(["render", paths[1], "--splats", paths[2], "--out", str(tmp_path / "out")]) == 2
