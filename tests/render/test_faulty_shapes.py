"""Shapes whose pose or size makes no image: their worlds are faulty, whatever source they come from."""

import logging
from collections.abc import Callable
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc

NAN, INF = float("nan"), float("inf")
# What is written for a shape of the second world, and whether the rest of that world is still drawn.
FAULTS = {
    "rotation of zeros": ("rotation", 0.0, True),
    "rotation of NaN": ("rotation", NAN, False),
    "position of NaN": ("position", NAN, False),
    "infinite position": ("position", INF, False),
    "size of zeros": ("size", 0.0, True),
    "size below 0": ("size", -0.1, True),
    "size of NaN": ("size", NAN, False),
    "infinite size": ("size", INF, False),
}
KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")
WORLDS, BAD = 3, 1

Write = Callable[[str, float], None]


def eye(**changes: Any) -> wc.Camera:
    return scenes.own_camera(position=(0.0, 0.0, 3.0), rotation=(1.0, 0.0, 0.0, 0.0), **changes)


def model_of(kind: str, more: str = "") -> mujoco.MjModel:
    """A shape of the kind, turned so that no part of its rotation is 0, beside a box that stays as it is."""
    geoms = scenes.geom_xml(kind, more='euler="20 30 40" pos="-.8 0 0"')
    return scenes.compile_xml(
        f'{geoms}<geom name="rest" type="box" size=".3 .3 .3" pos="1 0 0"/>{more}', assets=scenes.ASSETS
    )


def of_mujoco_warp(kind: str, more: str = "") -> tuple[wc.Scene, Write]:
    mjm = model_of(kind, more)
    m, d = scenes.put(mjm, WORLDS, batch={"geom_size": WORLDS})
    arrays = {"position": d.geom_xpos, "rotation": d.geom_xmat, "size": m.geom_size}
    return wc.from_mujoco_warp(mjm, m, d), lambda what, value: scenes.write(arrays[what], (BAD, 0), value)


def of_mujoco(kind: str) -> tuple[wc.Scene, Write]:
    mjm = model_of(kind)
    mjds = [scenes.forward(mjm) for _ in range(WORLDS)]
    arrays = {"position": mjds[BAD].geom_xpos, "rotation": mjds[BAD].geom_xmat}

    def write(what: str, value: float) -> None:
        arrays[what][0] = value

    return wc.from_mujoco(mjm, mjds, device=wp.get_device()), write


def of_newton(kind: str) -> tuple[wc.Scene, Write]:
    newton = pytest.importorskip("newton")
    import newton_scenes

    builder, part = newton.ModelBuilder(), newton.ModelBuilder()
    body = part.add_body(xform=newton_scenes.pose(-0.8, 0.0, 0.0, (0.1, 0.2, 0.3, 0.9)))
    add = {
        "sphere": lambda: part.add_shape_sphere(body, radius=0.5),
        "capsule": lambda: part.add_shape_capsule(body, radius=0.3, half_height=0.4),
        "ellipsoid": lambda: part.add_shape_ellipsoid(body, rx=0.6, ry=0.4, rz=0.3),
        "cylinder": lambda: part.add_shape_cylinder(body, radius=0.4, half_height=0.5),
        "box": lambda: part.add_shape_box(body, hx=0.5, hy=0.4, hz=0.3),
        "mesh": lambda: part.add_shape_mesh(body, mesh=newton_scenes.tetrahedron(), scale=(1.0, 1.3, 0.7)),
    }
    add[kind]()
    part.add_shape_box(-1, hx=0.3, hy=0.3, hz=0.3, xform=newton_scenes.pose(1.0, 0.0, 0.0))
    builder.replicate(part, WORLDS)
    model, state = newton_scenes.finalize(builder, wp.get_device())
    shape = 2 * BAD
    arrays = {
        "position": (state.body_q, (BAD, slice(0, 3))),
        "rotation": (state.body_q, (BAD, slice(3, 7))),
        "size": (model.shape_scale, shape),
    }
    return wc.from_newton(model, state), lambda what, value: scenes.write(*arrays[what], value)


def of_arrays(kind: str) -> tuple[wc.Scene, Write]:
    usd = pytest.importorskip("pxr.UsdGeom")
    from pxr import Usd

    stage = Usd.Stage.CreateInMemory()
    usd.SetStageMetersPerUnit(stage, 1.0)
    usd.SetStageUpAxis(stage, "Z")
    define = {"sphere": usd.Sphere, "capsule": usd.Capsule, "cylinder": usd.Cylinder, "box": usd.Cube}[kind]
    define.Define(stage, "/it").AddScaleOp().Set((0.3, 0.3, 0.3))
    rest = usd.Cube.Define(stage, "/rest")
    rest.AddTranslateOp().Set((1.0, 0.0, 0.0))
    rest.AddScaleOp().Set((0.3, 0.3, 0.3))
    scene = wc.from_usd(stage, WORLDS, device=wp.get_device())
    poses = torch.tensor([-0.8, 0.0, 0.0, 0.8, 0.3, 0.2, 0.5]).repeat(WORLDS, 1, 1)
    scene.set_poses(["/it"], poses)

    def write(what: str, value: float) -> None:
        poses[BAD, 0, slice(0, 3) if what == "position" else slice(3, 7)] = value
        scene.set_poses(["/it"], poses)

    return scene, write


def check(scene: wc.Scene, write: Write, fault: str, rest_is_drawn: bool, **options: Any) -> None:
    """The fault is its own world's, in which the shape is missing, and with it all or nothing else."""
    what, value, _ = FAULTS[fault]
    renderer = wc.Renderer(scene, [eye(**options)])
    before = scenes.on_host(renderer.render()["eye"])["segmentation"]
    assert not renderer.faulty.any()
    first, rest = np.unique(before[BAD])[1:3]
    write(what, value)
    after = scenes.on_host(renderer.render()["eye"])["segmentation"]
    assert renderer.faulty.tolist() == [0, 1, 0]
    others = [0, 2]
    assert (after[others] == before[others]).all()
    assert not (after[BAD] == first).any()
    assert (after[BAD] == rest).any() == rest_is_drawn


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", KINDS)
def test_worlds_of_mujoco_warp(device: wp.Device, kind: str, fault: str) -> None:
    if kind == "mesh" and FAULTS[fault][0] == "size" and not np.isnan(FAULTS[fault][1]):
        pytest.skip("a mesh of MuJoCo's has no size of its own")
    with wp.ScopedDevice(device):
        check(*of_mujoco_warp(kind), fault, FAULTS[fault][2])


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if FAULTS[fault][0] != "size"])
def test_worlds_of_mujoco(device: wp.Device, fault: str) -> None:
    with wp.ScopedDevice(device):
        check(*of_mujoco("box"), fault, FAULTS[fault][2])


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.filterwarnings("ignore")  # Newton's own
def test_worlds_of_newton(device: wp.Device, kind: str, fault: str) -> None:
    if kind == "mesh" and fault == "size below 0":
        pytest.skip("a scale below 0 mirrors a mesh")
    with wp.ScopedDevice(device):
        check(*of_newton(kind), fault, FAULTS[fault][2])


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if FAULTS[fault][0] != "size"])
@pytest.mark.parametrize("kind", ["sphere", "box"])
def test_worlds_whose_poses_are_arrays(device: wp.Device, kind: str, fault: str) -> None:
    """A quaternion of zeros is no rotation at all."""
    with wp.ScopedDevice(device):
        check(*of_arrays(kind), fault, FAULTS[fault][2] and fault != "rotation of zeros")


@pytest.mark.parametrize("fault", FAULTS)
def test_many_shapes_and_out_of_sight(device: wp.Device, fault: str) -> None:
    """In a scene of so many shapes that a CPU looks closely at those in sight alone."""
    what, value, _ = FAULTS[fault]
    balls = "".join(f'<geom size=".02" pos="{k % 9 / 9 - 0.4} {k // 9 / 9 - 0.4} 0"/>' for k in range(80))
    mjm = scenes.compile_xml('<geom type="box" size=".1 .1 .1" pos="0 0 9"/>' + balls)  # behind the camera
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, WORLDS, batch={"geom_size": WORLDS})
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [eye(width=16, height=16)])
    renderer.render()
    assert not renderer.faulty.any()
    scenes.write({"position": d.geom_xpos, "rotation": d.geom_xmat, "size": m.geom_size}[what], (BAD, 0), value)
    renderer.render()
    assert renderer.faulty.tolist() == [0, 1, 0]


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("fault", ["rotation of zeros", "size of zeros"])
def test_what_is_hidden_is_no_fault(device: wp.Device, fault: str, alpha: float) -> None:
    """One of the shapes that are seen through, which other passes draw."""
    what, value, _ = FAULTS[fault]
    mjm = model_of("box", '<geom size=".1" rgba="1 1 1 .5"/>')
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, WORLDS, batch={"geom_size": WORLDS, "geom_rgba": WORLDS})
    scenes.write(m.geom_rgba, (slice(None), 0, 3), alpha)
    scenes.write({"rotation": d.geom_xmat, "size": m.geom_size}[what], (BAD, 0), value)
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [eye(outputs=("rgb",))])
    renderer.render()
    assert renderer.faulty.tolist() == [0, int(alpha > 0.0), 0]


def test_endless_planes_and_slack_tendons_are_no_faults(device: wp.Device) -> None:
    """Rows of the table without a size: an endless plane, and pieces that a tendon does not have now."""
    mjm = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody>
        <geom type="plane" size="0 0 .1" pos="0 0 -1"/>
        <geom name="drum" type="cylinder" size=".2 .1"/>
        <site name="a" pos="-.6 .5 0"/><site name="side" pos="0 -.3 0"/>
        <body pos=".6 .5 0"><freejoint/><geom size=".05"/><site name="b"/></body>
      </worldbody><tendon>
        <spatial width=".02"><site site="a"/><geom geom="drum" sidesite="side"/><site site="b"/></spatial>
      </tendon></mujoco>""")
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, scenes.forward(mjm), nworld=WORLDS)
        renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [eye()])
        renderer.render()
        assert not renderer.faulty.any()
        scenes.write(d.qpos, (BAD, slice(0, 3)), (-0.6, 0.5, 0.0))  # the tendon no longer touches the drum
        renderer.render(forward=True)
    assert not renderer.faulty.any()


@pytest.mark.filterwarnings("ignore")  # Newton's own
@pytest.mark.parametrize("fault", ["rotation of zeros", "size of zeros", "rotation of NaN"])
def test_clouds_of_gaussians(device: wp.Device, fault: str) -> None:
    newton = pytest.importorskip("newton")
    import newton_scenes
    import splat_scenes

    what, value, rest_is_drawn = FAULTS[fault]
    part, builder = newton.ModelBuilder(), newton.ModelBuilder()
    cloud = splat_scenes.gaussians(np.zeros((1, 3)), [(0.9, 0.1, 0.2)])
    part.add_shape_gaussian(part.add_body(xform=newton_scenes.pose(-0.8, 0.0, 0.0)), gaussian=cloud)
    part.add_shape_box(-1, hx=0.3, hy=0.3, hz=0.3, xform=newton_scenes.pose(1.0, 0.0, 0.0))
    builder.replicate(part, WORLDS)
    model, state = newton_scenes.finalize(builder, device)
    renderer = wc.Renderer(wc.from_newton(model, state), [eye()])
    ids = scenes.on_host(renderer.render()["eye"])["segmentation"]
    assert not renderer.faulty.any() and (ids[BAD] == 2).any()
    where = (state.body_q, (BAD, slice(3, 7))) if what == "rotation" else (model.shape_scale, 2)
    scenes.write(*where, value)
    ids = scenes.on_host(renderer.render()["eye"])["segmentation"]
    assert renderer.faulty.tolist() == [0, 1, 0]
    assert not (ids[BAD] == 2).any() and (ids[BAD] == 3).any() == rest_is_drawn


@pytest.mark.filterwarnings("ignore")  # Newton's own
def test_a_camera_on_a_body_of_newton_without_a_rotation(device: wp.Device) -> None:
    newton = pytest.importorskip("newton")
    import newton_scenes

    part, builder = newton.ModelBuilder(), newton.ModelBuilder()
    part.add_body(label="head", xform=newton_scenes.pose(0.0, 0.0, 3.0))
    part.add_shape_box(-1, hx=0.3, hy=0.3, hz=0.3)
    builder.replicate(part, WORLDS)
    model, state = newton_scenes.finalize(builder, device)
    camera = scenes.own_camera(position=(0.0, 0.0, 0.0), rotation=(1.0, 0.0, 0.0, 0.0), parent="head")
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    renderer.render()
    assert not renderer.faulty.any()
    scenes.write(state.body_q, (BAD, slice(3, 7)), 0.0)
    depth = scenes.on_host(renderer.render()["eye"])["depth"]
    assert renderer.faulty.tolist() == [0, 1, 0]
    assert np.isfinite(depth).any(axis=(1, 2)).tolist() == [True, False, True]


@pytest.mark.filterwarnings("ignore")  # Newton's own
@pytest.mark.parametrize(("radius", "faulty"), [(0.0, 0), (NAN, 1)])
def test_particles_without_a_radius_are_hidden(device: wp.Device, radius: float, faulty: int) -> None:
    newton = pytest.importorskip("newton")
    import newton_scenes

    builder = newton.ModelBuilder()
    builder.add_particle(pos=(-0.8, 0.0, 0.0), vel=(0.0, 0.0, 0.0), mass=1.0, radius=0.3)
    builder.add_shape_box(-1, hx=0.3, hy=0.3, hz=0.3, xform=newton_scenes.pose(1.0, 0.0, 0.0))
    model, state = newton_scenes.finalize(builder, device)
    renderer = wc.Renderer(wc.from_newton(model, state), [eye()])
    before = scenes.on_host(renderer.render()["eye"])["depth"]
    scenes.write(model.particle_radius, 0, radius)
    after = scenes.on_host(renderer.render()["eye"])["depth"]
    assert renderer.faulty.tolist() == [faulty]
    assert np.isfinite(after).sum() < np.isfinite(before).sum()
    assert np.isfinite(after).any() != bool(faulty)


def test_faults_of_the_first_frame_are_told_once(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    with wp.ScopedDevice(device), caplog.at_level(logging.WARNING, "warpcam"):
        scene, write = of_mujoco_warp("box")
        write("rotation", 0.0)
        renderer = wc.Renderer(scene, [eye()])
        for _ in range(2):
            renderer.render()
    assert caplog.text.count("render: 1 of 3 worlds made no image or miss a shape") == 1
    assert "mujoco_warp.forward" in caplog.text
