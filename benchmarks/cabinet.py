"""Scenes after Newton's own benchmarks: an arm at a cabinet, and a ball under a cloth."""

import mujoco
import numpy as np

from warpcam.benchmarks.scenes import GEOM, add_floor, add_sun, from_mjlab, look_at

Floats = tuple[float, ...]
WHITE, PALE, STEEL = (0.85, 0.84, 0.8, 1.0), (0.75, 0.66, 0.5, 1.0), (0.55, 0.56, 0.58, 1.0)
DEEP, WIDE, TALL, PANEL = 0.4, 0.6, 0.8, 0.018  # of the cabinet [m]
STAND = 0.3  # what the arm stands on [m]


def add_panel(
    body: mujoco.MjsBody, center: tuple[float, ...], size: tuple[float, ...], rgba: tuple[float, ...]
) -> None:
    """Add a box by its full size."""
    body.add_geom(type=GEOM.mjGEOM_BOX, pos=center, size=0.5 * np.array(size), rgba=rgba)


def add_handle(body: mujoco.MjsBody, center: np.ndarray, along: np.ndarray) -> None:
    """Add a bar on two posts, in front of (+x) a place."""
    out = np.array((0.035, 0.0, 0.0))
    bars = [(center + out - along, center + out + along, 0.007)]
    bars += [(center + side * along, center + out + side * along, 0.005) for side in (-0.8, 0.8)]
    for start, end, radius in bars:
        body.add_geom(type=GEOM.mjGEOM_CAPSULE, fromto=(*start, *end), size=(radius, 0.0, 0.0), rgba=STEEL)


def add_cabinet(spec: mujoco.MjSpec) -> None:
    """Add a cabinet that opens to +x: two drawers above two doors."""
    case = spec.worldbody.add_body(name="cabinet", pos=(-0.35, 0.0, 0.0))
    add_panel(case, (-0.5 * DEEP, 0.0, 0.5 * TALL), (PANEL, WIDE, TALL), WHITE)
    for side in (-0.5, 0.5):
        add_panel(case, (0.0, side * (WIDE - PANEL), 0.5 * TALL), (DEEP, PANEL, TALL), WHITE)
    for height in (0.05, 0.48, TALL):
        add_panel(case, (0.0, 0.0, height), (DEEP, WIDE, PANEL), WHITE)
    for index, height in enumerate((0.57, 0.71)):
        drawer = case.add_body(name=f"drawer{index}", pos=(0.0, 0.0, height))
        drawer.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0), range=(0.0, 0.3), limited=True)
        add_panel(drawer, (0.5 * DEEP, 0.0, 0.0), (PANEL, WIDE - 0.01, 0.13), PALE)
        add_panel(drawer, (-0.5 * DEEP + 0.03, 0.0, 0.0), (PANEL, WIDE - 0.06, 0.1), PALE)
        add_panel(drawer, (0.0, 0.0, -0.05), (DEEP - 0.04, WIDE - 0.06, 0.5 * PANEL), PALE)
        for side in (-0.5, 0.5):
            add_panel(drawer, (0.0, side * (WIDE - 0.08), 0.0), (DEEP - 0.04, PANEL, 0.1), PALE)
        add_handle(drawer, np.array((0.5 * DEEP, 0.0, 0.0)), np.array((0.0, 0.08, 0.0)))
    for side in (-1.0, 1.0):
        door = case.add_body(name=f"door{side:+.0f}", pos=(0.5 * DEEP, 0.5 * side * WIDE, 0.265))
        door.add_joint(axis=(0, 0, side), range=(0.0, 1.5), limited=True)
        add_panel(door, (0.0, -0.25 * side * WIDE, 0.0), (PANEL, 0.5 * WIDE - 0.005, 0.41), PALE)
        add_handle(door, np.array((0.0, -0.44 * side * WIDE, 0.1)), np.array((0.0, 0.0, 0.07)))


def arm_at_cabinet() -> mujoco.MjSpec:
    """An arm of 18 meshes that faces a cabinet with drawers and doors, after Newton's `franka_cabinet`."""
    spec = from_mjlab("i2rt_yam/xmls/yam.xml")
    arm = spec.worldbody.bodies[0]
    arm.pos, arm.quat = (0.55, 0.0, STAND), (0.0, 0.0, 0.0, 1.0)
    spec.worldbody.add_geom(
        type=GEOM.mjGEOM_CYLINDER, pos=(0.55, 0.0, 0.5 * STAND), size=(0.08, 0.5 * STAND, 0.0), rgba=STEEL
    )
    add_cabinet(spec)
    add_floor(spec)
    add_sun(spec, (-1.0, -0.4, -0.7))
    look_at(spec, (1.7, 1.25, 1.05), (0.05, 0.0, 0.42))
    return spec


def ball_under_cloth() -> mujoco.MjSpec:
    """Build the objects that a cloth hangs over: a ball and a box on a plane."""
    spec = mujoco.MjSpec()
    add_floor(spec)
    add_sun(spec)
    ball = spec.worldbody.add_body(pos=(0.0, 0.0, 0.3))
    ball.add_freejoint()
    ball.add_geom(type=GEOM.mjGEOM_SPHERE, size=(0.2, 0.0, 0.0), rgba=STEEL)
    add_panel(spec.worldbody, (0.5, 0.4, 0.15), (0.3, 0.3, 0.3), PALE)
    look_at(spec, (1.5, 1.1, 1.1), (0.0, 0.0, 0.35))
    return spec
