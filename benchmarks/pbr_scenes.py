"""Scenes of ``look_speed``: generated meshes with maps of colour, normals, roughness and metal below a sky and suns.

They are of the kinds that glTF's sample models and robots in showrooms are of: one mesh of fine detail, many pieces
on a board, a robot with legs, and an arm among lights.
"""

from functools import partial

import mujoco
import numpy as np

from warpcam.benchmarks.cases import Case
from warpcam.benchmarks.pbr_meshes import SIZE, Color, add_material, add_surface, add_texture, revolved, superquadric
from warpcam.benchmarks.scenes import GEOM, Point, look_at

STEEL, DARK, IVORY, WOOD = (0.72, 0.73, 0.75), (0.08, 0.08, 0.09), (0.87, 0.82, 0.7), (0.35, 0.2, 0.1)
ORANGE, GOLD = (0.85, 0.4, 0.08), (0.95, 0.75, 0.35)
SUNS = (((-0.4, 0.5, -1.0), (0.75, 0.7, 0.62)),)
SHOWROOM = (*SUNS, ((0.9, 0.3, -0.8), (0.25, 0.3, 0.4)), ((0.1, -0.8, -0.9), (0.35, 0.22, 0.15)))
PIECES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {  # heights and radii [cm]
    "pawn": ((0, 0, 0.8, 1.2, 3.0, 3.1, 3.5, 4.1, 4.6, 4.7), (0, 1.6, 1.6, 1.0, 0.6, 1.0, 0.9, 1.0, 0.6, 0)),
    "rook": ((0, 0, 0.9, 1.4, 4.0, 4.2, 5.4, 5.4, 4.9, 4.9), (0, 1.9, 1.9, 1.3, 1.0, 1.5, 1.5, 1.1, 1.1, 0)),
    "knight": ((0, 0, 0.9, 1.4, 3.2, 4.0, 5.0, 5.6, 6.2, 6.3), (0, 1.9, 1.9, 1.2, 0.8, 1.6, 1.3, 1.1, 0.5, 0)),
    "bishop": ((0, 0, 0.9, 1.4, 4.4, 4.6, 5.2, 6.2, 7.0, 7.3), (0, 1.8, 1.8, 1.1, 0.6, 1.2, 0.9, 1.1, 0.3, 0)),
    "queen": ((0, 0, 1.0, 1.6, 6.0, 6.2, 6.8, 8.2, 7.9, 8.6), (0, 2.1, 2.1, 1.3, 0.7, 1.4, 0.9, 1.5, 0.5, 0)),
    "king": ((0, 0, 1.0, 1.6, 6.6, 6.8, 7.4, 8.8, 9.0, 9.9), (0, 2.2, 2.2, 1.4, 0.8, 1.5, 1.0, 1.4, 0.4, 0)),
}
RANKS = ("rook", "knight", "bishop", "queen", "king", "bishop", "knight", "rook")
SQUARE = 0.055  # of the board [m]
LEG = 0.25  # of the robot, each half [m]


def studio(lights: tuple[tuple[Point, Color], ...] = SUNS) -> mujoco.MjSpec:
    """A sky, a floor and lights from far away."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    head = spec.visual.headlight
    head.ambient = head.diffuse = head.specular = (0.0, 0.0, 0.0)
    spec.visual.quality.shadowsize = 4096
    sky, gradient = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    up, down = (0.45, 0.6, 0.85), (0.6, 0.57, 0.52)
    spec.add_texture(name="sky", type=sky, builtin=gradient, rgb1=up, rgb2=down, width=128, height=768)
    # The floor's colour is a texture: mujoco_warp_pbr takes the numbers of `rgba` as linear, warpcam as sRGB.
    add_texture(spec, "floor", np.full((SIZE, SIZE, 3), 0.5))
    floor = spec.add_material(name="floor", rgba=(1, 1, 1, 1), specular=0.5, roughness=0.6, metallic=0.0)
    floor.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "floor"
    spec.worldbody.add_geom(type=GEOM.mjGEOM_PLANE, size=(20.0, 20.0, 1.0), material="floor")
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    for direction, color in lights:
        spec.worldbody.add_light(type=sun, pos=(0.0, 0.0, 5.0), dir=direction, diffuse=color, castshadow=True)
    return spec


def show(body: mujoco.MjsBody, mesh: str, material: str, pos: Point = (0.0, 0.0, 0.0)) -> None:
    body.add_geom(type=GEOM.mjGEOM_MESH, meshname=mesh, material=material, pos=pos, contype=0, conaffinity=0)


def helmet() -> mujoco.MjSpec:
    """One mesh of 65,000 triangles with bumps, worn metal and lights."""
    spec = studio()
    points = superquadric((0.3, 0.34, 0.36), 0.8, rows=129, columns=256)
    across, around = np.linspace(0.0, np.pi, 129)[:, None], np.linspace(0.0, 2.0 * np.pi, 257)[None]
    points *= (1.0 + 0.04 * np.sin(across) * np.sin(6.0 * around) * np.sin(9.0 * across))[..., None]
    add_surface(spec, "helmet", points)
    add_material(spec, "helmet", (STEEL, ORANGE), roughness=(0.15, 0.7), metal=(1.0, 0.0), glow=(0.2, 0.7, 1.0))
    body = spec.worldbody.add_body(pos=(0.0, 0.0, 0.5))
    body.add_freejoint()
    show(body, "helmet", "helmet")
    look_at(spec, (0.9, -0.9, 0.8), (0.0, 0.0, 0.45))
    return spec


def chess() -> mujoco.MjSpec:
    """32 pieces of 15,000 triangles on a board."""
    spec = studio()
    add_material(spec, "white", (IVORY, (0.8, 0.72, 0.6)), roughness=(0.15, 0.45), bumps=0.5, seed=10)
    add_material(spec, "black", (DARK, WOOD), roughness=(0.1, 0.4), bumps=0.5, seed=20)
    add_material(spec, "frame", (WOOD, (0.25, 0.13, 0.06)), roughness=(0.3, 0.6), cells=24.0, seed=30)
    for name, (heights, radii) in PIECES.items():
        add_surface(spec, name, 0.01 * revolved(heights, radii))
    add_surface(spec, "square", superquadric((0.5 * SQUARE, 0.5 * SQUARE, 0.01), 0.1, rows=12, columns=24))
    add_surface(spec, "frame", superquadric((4.4 * SQUARE, 4.4 * SQUARE, 0.02), 0.1, rows=12, columns=24))
    show(spec.worldbody, "frame", "frame", (0.0, 0.0, 0.02))
    for row in range(8):
        for column in range(8):
            place = ((column - 3.5) * SQUARE, (row - 3.5) * SQUARE, 0.04)
            show(spec.worldbody, "square", ("black", "white")[(row + column) % 2], place)
            if row in (0, 1, 6, 7):
                body = spec.worldbody.add_body(pos=(place[0], place[1], 0.05))
                body.add_joint(axis=(0, 0, 1))
                for axis in ((1, 0, 0), (0, 1, 0)):
                    slide = mujoco.mjtJoint.mjJNT_SLIDE
                    body.add_joint(type=slide, axis=axis, range=(-0.01, 0.01), limited=True)
                show(body, RANKS[column] if row in (0, 7) else "pawn", "white" if row < 4 else "black")
    look_at(spec, (0.35, -0.55, 0.42), (0.0, 0.0, 0.03))
    return spec


def quadruped() -> mujoco.MjSpec:
    """A robot of 17 meshes with four legs of three joints."""
    spec = studio()
    add_material(spec, "shell", (ORANGE, DARK), roughness=(0.2, 0.5), bumps=0.5, cells=6.0, seed=40)
    add_material(spec, "metal", (STEEL, DARK), roughness=(0.2, 0.6), metal=(1.0, 1.0), bumps=1.0, seed=50)
    add_surface(spec, "trunk", superquadric((0.32, 0.13, 0.09), 0.4))
    add_surface(spec, "joint", superquadric((0.06, 0.06, 0.06), 0.6))
    add_surface(spec, "thigh", superquadric((0.045, 0.03, 0.5 * LEG + 0.03), 0.6))
    add_surface(spec, "shank", revolved((-0.5 * LEG, -0.5 * LEG, 0.4 * LEG, 0.5 * LEG), (0.0, 0.018, 0.03, 0.0)))
    add_surface(spec, "foot", superquadric((0.03, 0.03, 0.03), 1.0))
    trunk = spec.worldbody.add_body(pos=(0.0, 0.0, 2.0 * LEG))
    trunk.add_freejoint()
    show(trunk, "trunk", "shell")
    for x in (-0.27, 0.27):
        for y in (-0.17, 0.17):
            hip = trunk.add_body(pos=(x, y, 0.0))
            hip.add_joint(axis=(1, 0, 0), range=(-0.3, 0.3), limited=True)
            show(hip, "joint", "metal")
            thigh = hip.add_body(pos=(0.0, 0.2 * y, 0.0))
            thigh.add_joint(axis=(0, 1, 0), range=(0.2, 1.0), limited=True)
            show(thigh, "thigh", "shell", (0.0, 0.0, -0.5 * LEG))
            shank = thigh.add_body(pos=(0.0, 0.0, -LEG))
            shank.add_joint(axis=(0, 1, 0), range=(-1.6, -0.6), limited=True)
            show(shank, "shank", "metal", (0.0, 0.0, -0.5 * LEG))
            show(shank, "foot", "shell", (0.0, 0.0, -LEG))
    look_at(spec, (1.0, -1.1, 0.8), (0.0, 0.0, 0.35))
    return spec


def showroom() -> mujoco.MjSpec:
    """An arm of seven joints among three lights, with things on a table."""
    spec = studio(SHOWROOM)
    add_material(spec, "arm", ((0.9, 0.9, 0.9), (0.8, 0.8, 0.82)), roughness=(0.2, 0.4), bumps=0.2, seed=60)
    add_material(spec, "metal", (STEEL, DARK), roughness=(0.2, 0.6), metal=(1.0, 1.0), bumps=1.0, seed=70)
    add_material(spec, "gold", (GOLD, ORANGE), roughness=(0.1, 0.4), metal=(1.0, 1.0), bumps=1.0, seed=80)
    add_material(spec, "table", (WOOD, (0.45, 0.28, 0.15)), roughness=(0.3, 0.6), cells=24.0, seed=90)
    add_surface(spec, "table", superquadric((0.6, 0.6, 0.1), 0.1))
    add_surface(spec, "joint", superquadric((0.06, 0.06, 0.06), 0.6))
    add_surface(spec, "link", superquadric((0.05, 0.05, 0.09), 0.5))
    add_surface(spec, "finger", superquadric((0.012, 0.02, 0.05), 0.4))
    add_surface(spec, "vase", revolved((0, 0, 0.05, 0.12, 0.18, 0.2), (0, 0.04, 0.07, 0.04, 0.03, 0.045)))
    show(spec.worldbody, "table", "table", (0.0, 0.0, 0.1))
    for place in ((0.35, -0.3, 0.2), (0.4, 0.25, 0.2), (-0.3, -0.4, 0.2)):
        show(spec.worldbody, "vase", "gold", place)
    body = spec.worldbody.add_body(pos=(-0.2, 0.0, 0.27))
    show(body, "joint", "metal")
    for joint in range(7):
        bent = bool(joint % 2)
        body = body.add_body(pos=(0.0, 0.0, 0.15 if joint else 0.02))
        body.add_joint(axis=(0, 1, 0) if bent else (0, 0, 1), range=(0.2, 1.2) if bent else (-1.0, 1.0), limited=True)
        show(body, "link", "arm", (0.0, 0.0, 0.075))
        show(body, "joint", "metal", (0.0, 0.0, 0.15))
    for side in (-0.03, 0.03):
        show(body, "finger", "metal", (0.0, side, 0.24))
    look_at(spec, (1.5, -1.5, 1.2), (0.0, 0.0, 0.45))
    return spec


_case = partial(Case, cameras=("fixed",), cpu_worlds=1)
SCENES = {
    case.name: case
    for case in (
        _case("helmet", "one mesh of fine detail", helmet),
        _case("chess", "32 pieces on a board", chess, scatter=(0.0, 0.0)),
        _case("quadruped", "a robot with four legs", quadruped, scatter=(0.05, 0.2)),
        _case("showroom", "an arm among three lights", showroom),
    )
}
