"""USD's solids, as wide as it says and exactly what they are."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from closed_form import box, capsule, cone, cylinder, ellipsoid
from views import Around, depth, look_at, quaternion

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Usd, UsdGeom
from usd_stages import above, expected, image, pose

DIRECTIONS = ((0.6, -0.8, 0.5), (-0.7, 0.3, -0.4))


def check(scene: wc.Scene, entry: Any, frame: np.ndarray, rough: float = 2e-5, few: float = 0.002) -> None:
    low, high = scene.bounds()
    for direction in DIRECTIONS:
        around = Around(low, high, direction)
        ours, theirs = depth(scene, around), expected(entry, frame, around)
        hit = np.isfinite(ours) & np.isfinite(theirs)
        assert np.isfinite(theirs).mean() > 0.02
        wrong = np.isfinite(ours) != np.isfinite(theirs)
        wrong[hit] |= np.abs(ours[hit] - theirs[hit]) > rough * around.radius
        assert wrong.mean() <= few


TURNED = {"X": np.array(((0, 0, 1), (1, 0, 0), (0, 1, 0.0))), "Y": np.array(((0, 1, 0), (0, 0, 1), (1, 0, 0.0)))}


def about(frame: np.ndarray, axis: str) -> np.ndarray:
    turned = frame.copy()
    turned[:3, :3] = frame[:3, :3] @ TURNED.get(axis, np.eye(3))
    return turned


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 2.0, 2.0), (0.5, 1.5, 2.5), (-1.0, 2.0, 0.7)])
@pytest.mark.parametrize("kind", ["Cube", "Sphere"])
def test_cubes_and_spheres_take_any_scale(
    stage: Usd.Stage, kind: str, scale: tuple, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    prim = stage.DefinePrim("/it", kind)
    frame = pose(prim, scale)
    entry = (lambda o, d: box(o, d, np.ones(3))) if kind == "Cube" else (lambda o, d: ellipsoid(o, d, np.ones(3)))
    scene = wc.from_usd(stage, device=device)
    assert not scene._parts.meshes
    check(scene, entry, frame)


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", ["Cylinder", "Capsule", "Cone"])
@pytest.mark.parametrize("even", [True, False])
def test_solids_about_an_axis(stage: Usd.Stage, kind: str, axis: str, even: bool, device: wp.Device) -> None:
    solid = getattr(UsdGeom, kind).Define(stage, "/it")
    solid.CreateAxisAttr(axis)
    solid.CreateRadiusAttr(0.4)
    solid.CreateHeightAttr(1.6)
    frame = pose(solid, (1.5, 1.5, 1.5) if even else (0.8, 1.3, 1.9))
    entries = {
        "Cylinder": lambda o, d: cylinder(o, d, 0.4, 0.8),
        "Capsule": lambda o, d: capsule(o, d, 0.4, 0.8),
        "Cone": lambda o, d: cone(o, d, 0.4, 0.8),
    }
    scene = wc.from_usd(stage, device=device)
    assert bool(scene._parts.meshes) != even
    check(scene, entries[kind], about(frame, axis), 2e-5 if even else 2e-3, 0.002 if even else 0.006)


def test_base_of_a_cone_below_its_tip(stage: Usd.Stage, device: wp.Device) -> None:
    """A ray along the axis meets the base, not the tip that it runs to."""
    solid = UsdGeom.Cone.Define(stage, "/it")
    solid.CreateRadiusAttr(0.4)
    solid.CreateHeightAttr(1.6)
    up = np.array((0.0, 0.0, -2.0)), quaternion(np.diag((1.0, -1.0, -1.0)))
    for lens in (wc.Pinhole(fovy=40.0), wc.Orthographic(height=1.0)):
        camera = wc.Camera("up", width=33, height=33, outputs=("depth",), lens=lens, position=up[0], rotation=up[1])
        seen = wc.Renderer(wc.from_usd(stage, device=device), [camera]).render()["up"]["depth"][0, ..., 0].cpu().numpy()
        assert np.isfinite(seen).sum() > 300
        assert np.abs(seen - 1.2)[np.isfinite(seen)].max() < 1e-5


def test_the_tip_of_a_cone_has_no_hole(stage: Usd.Stage, device: wp.Device) -> None:
    """Rays from above to the tip, and to places a few millionths of the cone beside it."""
    solid = UsdGeom.Cone.Define(stage, "/it")
    solid.CreateRadiusAttr(0.4)
    solid.CreateHeightAttr(1.6)
    worlds, random = 400, np.random.default_rng(0)
    tips = np.array((0.0, 0.0, 0.8)) + random.normal(size=(worlds, 3)) * np.geomspace(1e-7, 1e-4, worlds)[:, None]
    aside = random.uniform(-0.12, 0.12, (worlds, 2))  # less than the cone's slope: all come into it
    distances = random.uniform(0.5, 5.0, worlds)
    away = np.concatenate((aside, np.ones((worlds, 1))), axis=1)
    eyes = tips + distances[:, None] * away / np.linalg.norm(away, axis=1)[:, None]
    rotations = np.stack([quaternion(look_at(eye, tip)) for eye, tip in zip(eyes, tips, strict=True)])
    camera = wc.Camera(
        "eye", width=1, height=1, outputs=("depth",), lens=wc.Pinhole(fovy=1.0), position=eyes, rotation=rotations
    )
    scene = wc.from_usd(stage, num_worlds=worlds, device=device)
    seen = wc.Renderer(scene, [camera]).render()["eye"]["depth"].cpu().numpy().reshape(-1)
    assert np.isfinite(seen).all()
    assert np.abs(seen - distances).max() < 5e-3


@pytest.mark.parametrize("distance", [2.0, 20.0, 200.0])
def test_no_ray_is_lost_where_the_base_of_a_cone_meets_its_side(
    stage: Usd.Stage, distance: float, device: wp.Device
) -> None:
    solid = UsdGeom.Cone.Define(stage, "/it")
    solid.CreateRadiusAttr(0.4)
    solid.CreateHeightAttr(1.6)
    eye = distance * np.array((0.0, -0.9, -0.4))
    angle = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 200))
    rim = np.stack((0.4 * np.sin(angle), -0.4 * np.cos(angle), np.full(angle.shape, -0.8)), axis=-1)
    camera = wc.Camera("eye", width=200, height=200, outputs=("distance",), lens=wc.Rays(rim - eye), position=eye)
    seen = wc.Renderer(wc.from_usd(stage, device=device), [camera]).render()["eye"]["distance"][0, ..., 0].cpu().numpy()
    assert np.isfinite(seen).all()
    assert np.abs(seen - np.linalg.norm(rim - eye, axis=-1)).max() < 1e-5 * (1.0 + distance)


@pytest.mark.parametrize("scale", [(1.5, 1.5, -0.7), (-1.5, 1.5, 0.7), (-1.0, -1.0, -2.0), (1.2, -1.2, -1.2)])
def test_cones_are_exact_when_mirrored(stage: Usd.Stage, scale: tuple, device: wp.Device) -> None:
    solid = UsdGeom.Cone.Define(stage, "/it")
    solid.CreateRadiusAttr(0.4)
    solid.CreateHeightAttr(1.6)
    frame = pose(solid, scale)
    scene = wc.from_usd(stage, device=device)
    assert not scene._parts.meshes
    check(scene, lambda o, d: cone(o, d, 0.4, 0.8), frame)


@pytest.mark.parametrize("kind", ["Cylinder_1", "Capsule_1"])
def test_solids_of_two_equal_radii_are_exact(stage: Usd.Stage, kind: str, device: wp.Device) -> None:
    prim = stage.DefinePrim("/it", kind)
    for name in ("radiusTop", "radiusBottom"):
        prim.GetAttribute(name).Set(0.4)
    prim.GetAttribute("height").Set(1.6)
    prim.GetAttribute("axis").Set("Z")
    entry = cylinder if kind == "Cylinder_1" else capsule
    scene = wc.from_usd(stage, device=device)
    assert not scene._parts.meshes
    check(scene, lambda o, d: entry(o, d, 0.4, 0.8), np.eye(4))
    prim.GetAttribute("radiusTop").Set(0.2)
    assert wc.from_usd(stage, device=device)._parts.meshes


@pytest.mark.parametrize(("axis", "spans"), [("X", (0, 2, 4)), ("Y", (4, 0, 2)), ("Z", (2, 4, 0))])
@pytest.mark.parametrize("sides", [True, False])
def test_planes_are_as_wide_as_usd_says(
    stage: Usd.Stage, axis: str, spans: tuple, sides: bool, device: wp.Device
) -> None:
    plane = UsdGeom.Plane.Define(stage, "/it")
    plane.CreateAxisAttr(axis)
    plane.CreateWidthAttr({"X": 4.0, "Y": 4.0, "Z": 2.0}[axis])  # along z, x, x
    plane.CreateLengthAttr({"X": 2.0, "Y": 2.0, "Z": 4.0}[axis])  # along y, z, y
    plane.CreateDoubleSidedAttr(sides)
    scene = wc.from_usd(stage, device=device)
    low, high = scene.bounds()
    np.testing.assert_allclose(high - low, spans, atol=1e-6)
    normal = np.eye(3)["XYZ".index(axis)]
    for sign in (1.0, -1.0):
        eye = 3.0 * sign * normal
        camera = wc.Camera(
            "c", width=8, height=8, lens=wc.Pinhole(fovy=20.0), position=eye,
            rotation=quaternion(look_at(eye, np.zeros(3))), outputs=("depth",),
        )  # fmt: skip
        assert np.isfinite(image(scene, "depth", camera)).all() == (sides or sign > 0.0)


def test_endless_planes(stage: Usd.Stage, device: wp.Device) -> None:
    plane = UsdGeom.Plane.Define(stage, "/it")
    plane.CreateWidthAttr(0.0)
    plane.CreateLengthAttr(0.0)
    for sides in (False, True):
        plane.CreateDoubleSidedAttr(sides)
        scene = wc.from_usd(stage, device=device)
        assert scene.shapes == ("/it", "/it/back")[: 1 + sides]
        assert image(scene, "depth", above(3.0, 8, 1000.0)) == pytest.approx(3.0)
        below = wc.Camera(
            "c", width=8, height=8, lens=wc.Pinhole(fovy=20.0), position=(0, 0, -3), outputs=("depth",),
            rotation=(0.0, 1.0, 0.0, 0.0),
        )  # fmt: skip
        assert np.isfinite(image(scene, "depth", below)).all() == sides
