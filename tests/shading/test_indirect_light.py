"""One bounce of light from shapes in the real-time look."""

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.core.errors import WarpcamError

pytest.importorskip("pxr.Usd")
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import add_material, add_mesh

ALBEDO = 0.5
HEIGHT = 0.5  # of the plate that shines, above the floor [m]


def lit(scene: wc.Scene, camera: wc.Camera, **options: Any) -> np.ndarray:
    return wc.Renderer(scene, [camera], **options).render()["c"]["hdr"].cpu().numpy()[0, ..., 0]


def bind(prim: UsdGeom.Gprim, stage: Usd.Stage, color: float, emission: float = 0.0) -> None:
    """A matt material of its own."""
    path = f"/Looks{prim.GetPath()}"
    inputs = {"diffuseColor": (color,) * 3, "emissiveColor": (emission,) * 3, "ior": 1.0, "roughness": 1.0}
    add_material(stage, path, **inputs)
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, path))


def matt(stage: Usd.Stage, path: str, points: list[tuple[float, ...]], color: float, emission: float = 0.0) -> None:
    """A square of four corners with two sides."""
    mesh = add_mesh(stage, path, points, [(0, 1, 2, 3)])
    mesh.CreateDoubleSidedAttr(True)
    bind(mesh, stage, color, emission)


def no_sky(stage: Usd.Stage) -> None:
    """Stages without lights get a sky of their own."""
    UsdLux.DistantLight.Define(stage, "/sun").CreateIntensityAttr(0.0)


def form_factor(x: np.ndarray, y: np.ndarray, half: float) -> np.ndarray:
    """Of places on the floor to a parallel square about the middle: four rectangles with a corner above the place."""

    def corner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        p, q = np.hypot(1.0, a), np.hypot(1.0, b)
        return (a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2.0 * np.pi)

    left, right, down, up = ((half + side * at) / HEIGHT for at in (x, y) for side in (1, -1))
    return sum(corner(a, b) for a in (left, right) for b in (down, up))


@pytest.mark.parametrize(("half", "most", "rms"), [(1.0, 0.08, 0.02), (0.2, 0.08, 0.02)])
def test_a_plate_lights_a_floor(stage: Usd.Stage, half: float, most: float, rms: float, device: wp.Device) -> None:
    """A square that shines above a floor, against the closed form of the form factor."""
    matt(stage, "/floor", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], ALBEDO)
    plate = [(-half, -half, HEIGHT), (half, -half, HEIGHT), (half, half, HEIGHT), (-half, half, HEIGHT)]
    matt(stage, "/plate", plate, 0.0, 1.0)
    no_sky(stage)
    camera = wc.Camera("c", width=64, height=48, lens=wc.Orthographic(height=1.5), position=(0.0, 0.0, 0.4),
                       outputs=("hdr",))  # fmt: skip
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    seen = lit(scene, camera, look="pbr", indirect_light=True) / ALBEDO
    pixel = 1.5 / 48
    x, y = np.meshgrid(pixel * (np.arange(64) - 31.5), pixel * (np.arange(48) - 23.5))
    error = seen - form_factor(x, y, half)
    assert np.abs(error).max() < most
    assert np.sqrt((error**2).mean()) < rms
    assert abs(error.mean()) < 0.004
    assert not lit(scene, camera, look="pbr").any()


def shining_box(stage: Usd.Stage) -> None:
    box = UsdGeom.Cube.Define(stage, "/light")
    box.CreateSizeAttr(0.6)
    UsdGeom.Xformable(box).AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, 1.0))
    bind(box, stage, 0.0, 5.0)


def shining_mesh(stage: Usd.Stage) -> None:
    """A square, with many tiny triangles along its edge."""
    points, faces = [(-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3)], [tuple(range(4))]
    for x in np.linspace(-0.3, 0.3, 200, endpoint=False).tolist():
        faces.append(tuple(range(len(points), len(points) + 3)))
        points += [(x, 0.3), (x + 0.003, 0.3), (x, 0.31)]
    mesh = add_mesh(stage, "/light", [(x, y, 1.0) for x, y in points], faces)
    mesh.CreateDoubleSidedAttr(True)
    bind(mesh, stage, 0.0, 5.0)


@pytest.mark.parametrize("light", [shining_box, shining_mesh])
def test_places_on_lights_are_drawn_well(
    stage: Usd.Stage, light: Callable[[Usd.Stage], None], device: wp.Device
) -> None:
    """Rays of a pixel end where light comes from: not at sides that face away, nor at the smallest faces."""
    matt(stage, "/floor", [(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)], ALBEDO)
    light(stage)
    no_sky(stage)
    camera = wc.Camera("c", width=32, height=32, lens=wc.Orthographic(height=4.0), position=(0.0, 0.0, 0.45),
                       outputs=("hdr",))  # fmt: skip
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    seen = lit(scene, camera, look="pbr", indirect_light=True)
    traced = lit(scene, camera, look="path", path=wc.PathOptions(samples=512, bounces=1))
    assert seen.mean() == pytest.approx(traced.mean(), rel=0.01)
    assert np.sqrt(((seen - traced) ** 2).mean()) < 0.07 * traced.mean()


def room(stage: Usd.Stage, emission: float) -> None:
    """A closed cube of 2 m about the origin, all of whose walls are alike."""
    for axis in range(3):
        for side in (-1.0, 1.0):
            points = [np.roll((side, u, v), axis) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            name = f"/wall_{'xyz'[axis]}{'a' if side < 0 else 'b'}"
            matt(stage, name, [tuple(map(float, point)) for point in points], ALBEDO, emission)


def inside(**more: Any) -> wc.Camera:
    return wc.Camera("c", width=96, height=64, lens=wc.Pinhole(fovy=90.0), position=(0.2, 0.1, 0.5), outputs=("hdr",),
                     **more)  # fmt: skip


def test_walls_that_shine_light_each_other(stage: Usd.Stage, device: wp.Device) -> None:
    """In a furnace each wall sends E (1 + albedo) after one bounce; paths see the same."""
    room(stage, 0.7)
    no_sky(stage)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    seen = lit(scene, inside(), look="pbr", indirect_light=True)
    np.testing.assert_allclose(seen, 0.7 * (1.0 + ALBEDO), rtol=0.05)
    assert seen.mean() == pytest.approx(0.7 * (1.0 + ALBEDO), rel=0.005)
    traced = lit(scene, inside(), look="path", path=wc.PathOptions(samples=16, bounces=1))
    assert traced.mean() == pytest.approx(0.7 * (1.0 + ALBEDO), rel=0.01)


def test_a_lamp_lights_a_room_by_its_walls(stage: Usd.Stage, device: wp.Device) -> None:
    """A lamp in a room, with a box that casts shadows: as bright as paths of two bounces."""
    room(stage, 0.0)
    box = UsdGeom.Cube.Define(stage, "/box")
    box.CreateSizeAttr(0.5)
    UsdGeom.Xformable(box).AddTranslateOp().Set(Gf.Vec3d(0.3, 0.2, -0.75))
    bind(box, stage, 0.8)
    lamp = UsdLux.SphereLight.Define(stage, "/lamp")
    lamp.CreateRadiusAttr(0.02)
    lamp.CreateIntensityAttr(400.0)
    UsdGeom.Xformable(lamp).AddTranslateOp().Set(Gf.Vec3d(-0.3, -0.2, 0.4))
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    seen = lit(scene, inside(shadows=True), look="pbr", indirect_light=True)
    direct = lit(scene, inside(shadows=True), look="pbr")
    traced = lit(scene, inside(), look="path", path=wc.PathOptions(samples=64, bounces=2))
    assert seen.mean() == pytest.approx(traced.mean(), rel=0.03)
    assert direct.mean() < 0.9 * seen.mean()
    lit_there = np.pad(direct > 0.001 * direct.max(), 1, mode="edge")  # and, of edges, beside it
    dark = ~np.any([lit_there[j : j + 64, i : i + 96] for j in range(3) for i in range(3)], axis=0)
    assert dark.sum() > 20
    assert seen[dark].mean() == pytest.approx(traced[dark].mean(), rel=0.05)


def worlds_of(device: wp.Device, heights: list[float]) -> wc.Scene:
    model = mujoco.MjModel.from_xml_string("""<mujoco><visual><headlight ambient=".5 .5 .5" diffuse="0 0 0"/></visual>
      <worldbody><light pos="0.5 0 2" dir="0 0 -1" cutoff="180" bulbradius=".2" diffuse=".5 .5 .5"/>
      <geom type="plane" size="0 0 1" rgba="1 1 1 1"/><geom pos="1 0 .5" type="sphere" size=".2" rgba="1 1 1 .5"/>
      <body name="b"><freejoint/><geom type="box" size=".3 .2 .1" rgba=".8 .3 .3 1"/></body></worldbody></mujoco>""")
    states = []
    for height in heights:
        state = mujoco.MjData(model)
        state.qpos[2] = height
        mujoco.mj_forward(model, state)
        states.append(state)
    return wc.from_mujoco(model, states, device=device)


def test_highlights_of_metals_are_no_spots(stage: Usd.Stage, device: wp.Device) -> None:
    """The floor around a smooth metal ball in the sun is lit evenly, not by the few rays that find its highlight."""
    matt(stage, "/floor", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], ALBEDO)
    ball = UsdGeom.Sphere.Define(stage, "/ball")
    ball.CreateRadiusAttr(0.5)
    UsdGeom.Xformable(ball).AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, 0.5))
    add_material(stage, "/Looks/ball", diffuseColor=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.1)
    UsdShade.MaterialBindingAPI.Apply(ball.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/ball"))
    sun = UsdLux.DistantLight.Define(stage, "/sun")
    sun.CreateIntensityAttr(math.pi)
    sun.CreateNormalizeAttr(True)
    UsdGeom.Xformable(sun).AddRotateXYZOp().Set(Gf.Vec3f(40.0, 0.0, 0.0))
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    options = {"width": 96, "height": 96, "lens": wc.Orthographic(height=4.0), "position": (0.0, 0.0, 3.0)}
    camera = wc.Camera("c", outputs=("hdr",), **options)
    plain, seen = (lit(scene, camera, look="pbr", indirect_light=on) for on in (False, True))
    x, y = np.meshgrid(*2 * [(np.arange(96) + 0.5) / 24.0 - 2.0])
    floor = np.hypot(x, y) > 0.6
    assert (seen - plain)[floor].max() < 0.25 * np.median(plain[floor])


@pytest.mark.parametrize(("antialiasing", "reflections"), [(1, False), (4, True), (16, False)])
def test_worlds_are_drawn_as_alone(device: wp.Device, antialiasing: int, reflections: bool) -> None:
    camera = wc.Camera("c", width=40, height=30, lens=wc.Pinhole(fovy=50.0), position=(0.0, 0.0, 3.0),
                       outputs=("hdr", "depth"), shadows=True, antialiasing=antialiasing)  # fmt: skip
    options: dict[str, Any] = {"look": "pbr", "indirect_light": True, "soft_shadows": True, "reflections": reflections}
    renderer = wc.Renderer(worlds_of(device, [0.3, 0.6]), [camera], **options)
    images = renderer.render()["c"]["hdr"]
    both = images.cpu().numpy().copy()
    for world, height in enumerate([0.3, 0.6]):
        alone = wc.Renderer(worlds_of(device, [height]), [camera], **options).render()["c"]["hdr"][0].cpu().numpy()
        np.testing.assert_array_equal(both[world], alone)
    images.zero_()
    renderer.render(worlds=[1])
    assert not images[0].any()
    np.testing.assert_array_equal(images[1].cpu().numpy(), both[1])


def test_nothing_runs_for_those_who_do_not_ask(device: wp.Device) -> None:
    camera = wc.Camera("c", width=8, height=8, lens=wc.Pinhole(fovy=50.0), position=(0.0, 0.0, 3.0), outputs=("rgb",))
    scene = worlds_of(device, [0.3])
    plain = wc.Renderer(scene, [camera], look="pbr")
    assert "indirect" not in str(plain.plan["c"])
    for more in ({}, {"reflections": True}, {"ambient_occlusion": math.inf}):
        asked = wc.Renderer(scene, [camera], look="pbr", indirect_light=True, **more)
        text = str(asked.plan["c"])
        assert all(text.count(name) == 1 for name in ("path shapes", "indirect rays", "indirect filter"))
        assert "occlusion" not in text
        told = wc.estimate_memory(scene, [camera], look="pbr", indirect_light=True, **more)
        assert told.total == asked.memory.total > plain.memory.total


ERRORS = {
    "indirect_light must be True or False, got 1": {"indirect_light": 1},
    "indirect_light is of look='pbr', and the look is 'path'": {"look": "path"},
    "indirect_light is of look='pbr', and the look is 'mujoco'": {"look": "mujoco"},
    "ambient_occlusion is 0.5 and indirect_light is True": {"ambient_occlusion": 0.5},
}


@pytest.mark.parametrize("text", ERRORS)
def test_what_cannot_be(text: str, device: wp.Device) -> None:
    camera = wc.Camera("c", width=8, height=8, lens=wc.Pinhole(fovy=50.0), position=(0.0, 0.0, 3.0), outputs=("rgb",))
    with pytest.raises(WarpcamError, match=f"Renderer: {text}"):
        wc.Renderer(worlds_of(device, [0.3]), [camera], **{"look": "pbr", "indirect_light": True, **ERRORS[text]})
