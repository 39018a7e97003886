"""Models with all that MuJoCo draws beside geoms."""

import mujoco
import numpy as np
import scenes

PICTURE = """
  <texture name="checks" type="2d" builtin="checker" rgb1="1 .2 .2" rgb2=".2 .2 1" width="64" height="64" mark="edge"
    markrgb="1 1 0"/>
  <material name="checks" texture="checks" texrepeat="2 3"/>
  <material name="gold" rgba=".9 .7 .1 1" specular="1" shininess=".9"/>
"""
SITES = """
  <site name="ball" type="sphere" size=".2" pos="-.8 0 .3" rgba="1 0 0 1"/>
  <site name="pill" type="capsule" size=".1 .2" pos="-.3 0 .3" euler="30 40 0" rgba="0 1 0 1"/>
  <site name="egg" type="ellipsoid" size=".1 .2 .3" pos=".2 0 .3" euler="30 40 0" material="gold"/>
  <site name="can" type="cylinder" size=".1 .2" pos=".7 0 .3" euler="30 40 0"/>
  <body pos="0 0 -.4"><freejoint/><geom size=".1" pos=".2 .1 0"/>
    <site name="cube" type="box" size=".1 .2 .15" euler="30 40 10" rgba="0 0 1 1"/></body>
  <site name="clear" type="sphere" size=".3" pos=".6 0 -.4" rgba="1 1 1 0"/>
  <site name="other" type="sphere" size=".3" pos=".6 0 -.4" group="3"/>
"""
WEDGE = """
  <mesh name="wedge" vertex="-.5 -.4 0 .5 -.4 0 .5 .4 0 -.5 .4 0 .2 0 .6" refpos=".1 .2 0" refquat=".9 .3 .2 .1"/>
"""
MESHES = """
  <body pos="0 0 -.2"><joint type="ball"/><geom size=".05"/>
    <site type="mesh" mesh="wedge" pos=".1 .2 0" euler="20 30 40" rgba=".9 .5 .2 1"/></body>
"""
TENDONS = """
  <site name="a" pos="-.7 0 .6"/><site name="b" pos=".6 .05 .3" size=".03"/><site name="c" pos=".4 0 -.5"/>
  <geom name="drum" type="cylinder" size=".25 .2" euler="90 0 0"/>
  <body pos="-.5 0 -.4"><joint type="slide" axis="0 0 1"/><geom size=".1"/><site name="d" size=".12"/></body>
"""
PATHS = """
  <tendon>
    <spatial width=".04" rgba="1 .5 0 1"><site site="a"/><geom geom="drum"/><site site="c"/></spatial>
    <spatial width=".03" material="gold"><site site="a"/><site site="b"/><pulley divisor="2"/><site site="c"/>
      <site site="d"/></spatial>
    <spatial width=".3" group="4"><site site="a"/><site site="d"/></spatial>
  </tendon>
"""

STRINGS = """
  <site name="a" pos="-.9 0 .6"/><site name="b" pos=".5 .3 .2"/><site name="c" pos="-.88 0 -.4"/><site name="e"/>
  <body pos=".9 0 -.2"><joint type="slide" axis="0 0 1"/><geom size=".1"/><site name="d"/></body>
"""
HANGING = """
  <tendon>
    <spatial width=".03" limited="true" range="0 2.2" rgba="1 .5 0 1"><site site="a"/><site site="b"/></spatial>
    <spatial width=".03" limited="true" range="0 2.4"><site site="c"/><site site="a"/></spatial>
    <spatial width=".02" stiffness="10" springlength="0 1.1"><site site="e"/><site site="d"/></spatial>
    <spatial width=".02" limited="true" range="0 .5"><site site="b"/><site site="e"/></spatial>
    <spatial width=".02" limited="true" range=".1 3"><site site="c"/><site site="e"/></spatial>
    <spatial width=".02" limited="true" range="0 3" damping="1"><site site="c"/><site site="b"/></spatial>
  </tendon>
"""


WRAPS = """
  <site name="a" pos="-.9 -.1 -.2"/><site name="b" pos=".9 .2 -.1"/><site name="up" pos="0 0 1"/>
  <geom name="drum" type="cylinder" size=".3 .3" euler="80 20 0"/>
  <body pos="0 .1 -.6"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".25"/>
    <site name="left" pos="-.1 -.1 .6"/>
    <site name="right" pos=".1 0 .6"/><site name="down" pos="0 -.2 -1"/></body>
"""
AROUND = """
  <tendon>
    <spatial width=".04" rgba="1 .5 0 1"><site site="a"/><geom geom="drum" sidesite="up"/><site site="b"/></spatial>
    <spatial width=".03" rgba=".2 .8 .1 1"><site site="left"/><geom geom="ball" sidesite="down"/><site site="right"/>
      <geom geom="drum" sidesite="up"/><site site="b"/></spatial>
  </tendon>
"""
LIMITS = """
  <site name="a" pos="-.8 0 .6"/><site name="b" pos="-.8 0 .2"/><site name="c" pos="-.8 0 -.2"/>
  <site name="d" pos="-.8 0 -.6"/><site name="e" pos="-.8 0 -.9"/>
  <body pos=".7 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1"/><site name="u" pos="0 0 .6"/>
    <site name="v" pos="0 0 .2"/><site name="w" pos="0 0 -.2"/><site name="x" pos="0 0 -.6"/>
    <site name="y" pos="0 0 -.9"/></body>
"""
HELD = """
  <tendon>
    <spatial width=".05" limited="true" range=".2 1.2"><site site="a"/><site site="u"/></spatial>
    <spatial width=".05" limited="true" range="0 1.4" solimplimit=".1 .9 .4 .3 3"><site site="b"/><site site="v"/>
    </spatial>
    <spatial width=".05" limited="true" range="1.7 3" margin=".1" solimplimit=".2 .9 .5"><site site="c"/>
      <site site="w"/></spatial>
    <spatial width=".05" limited="true" range=".1 1.2" material="gold"><site site="d"/><site site="x"/></spatial>
    <spatial width=".05" limited="true" range=".1 1.2" rgba="0 .5 1 1"><site site="e"/><site site="y"/></spatial>
    <spatial width=".03" limited="true" range="0 2.5" margin="2"><site site="a"/><site site="y"/></spatial>
  </tendon>
"""


def flexcomp(dim: int, more: str = "", **changes: str) -> str:
    """Return the XML of a flex that hangs free, of any dimension."""
    count = {1: "6 1 1", 2: "5 4 1", 3: "4 3 3"}[dim]
    settings = {"pos": "0 0 0", "rgba": ".2 .7 .9 1", "radius": ".05", "name": "soft", **changes}
    values = " ".join(f'{name}="{value}"' for name, value in settings.items())
    return (
        f'<flexcomp type="grid" dim="{dim}" count="{count}" spacing=".25 .25 .25" mass="1" {values}>'
        f'<contact selfcollide="none"/>{more}</flexcomp>'
    )


def with_flex(dim: int, **changes: str) -> mujoco.MjModel:
    floor = '<geom type="plane" size="3 3 .1" pos="0 0 -1"/>'
    return scenes.compile_xml(floor + flexcomp(dim, **changes), assets=PICTURE)


def with_skin(inflate: float = 0.05, more: str = 'material="checks"') -> mujoco.MjModel:
    """A sheet of two by six cells on two bodies, of which one turns."""
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 7), np.linspace(-0.3, 0.3, 3), indexing="ij")
    vertices = np.stack((x, y, 0.1 * x * x), axis=-1).reshape(-1, 3)
    texture = np.stack((x + 0.8, y + 0.3), axis=-1).reshape(-1, 2)
    faces = [
        corner
        for i in range(6)
        for j in range(2)
        for corner in (3 * i + j, 3 * i + j + 3, 3 * i + j + 4, 3 * i + j, 3 * i + j + 4, 3 * i + j + 1)
    ]
    right = np.clip(vertices[:, 0] + 0.5, 0.0, 1.0)

    def text(values: object) -> str:
        return " ".join(f"{value:g}" for value in np.ravel(values))

    def bone(body: str, weights: np.ndarray, where: str) -> str:
        held = np.flatnonzero(weights > 0.0)
        return f'<bone body="{body}" {where} vertid="{text(held)}" vertweight="{text(weights[held])}"/>'

    bones = bone("left", 1.0 - right, 'bindpos="-.4 0 0" bindquat="1 0 0 0"')
    bones += bone("right", right, 'bindpos=".4 0 .1" bindquat=".8 .6 0 0"')
    skin = (
        f'<deformable><skin name="skin" inflate="{inflate}" vertex="{text(vertices)}" texcoord="{text(texture)}" '
        f'face="{text(faces)}" {more}>{bones}</skin></deformable>'
    )
    bodies = (
        '<body name="left" pos="-.4 0 0"><geom size=".05"/></body>'
        '<body name="right" pos=".4 0 .1" euler="73.7398 0 0"><joint axis="1 .3 0"/><geom size=".05"/></body>'
    )
    return scenes.compile_xml(bodies, assets=PICTURE, more=skin)


MODELS = {
    "sites": lambda: scenes.compile_xml(SITES, assets=PICTURE),
    "meshes": lambda: scenes.compile_xml(MESHES, assets=PICTURE + WEDGE),
    "tendons": lambda: scenes.compile_xml(TENDONS, assets=PICTURE, more=PATHS),
    "wraps": lambda: scenes.compile_xml(WRAPS, assets=PICTURE, more=AROUND),
    "held": lambda: scenes.compile_xml(LIMITS, assets=PICTURE, more=HELD),
    "strings": lambda: scenes.compile_xml(STRINGS, assets=PICTURE, more=HANGING),
    "line": lambda: with_flex(1),
    "cloth": lambda: with_flex(2),
    "flat cloth": lambda: with_flex(2, flatskin="true", material="gold"),
    "textured cloth": lambda: with_flex(
        2,
        material="checks",
        rgba=".5 .5 .5 1",
        texcoord=" ".join(f"{i / 4} {j / 3}" for i in range(5) for j in range(4)),
    ),
    "solid": lambda: with_flex(3),
    "flat solid": lambda: with_flex(3, flatskin="true", radius="0"),
    "skin": with_skin,
}  # fmt: skip


def bent(name: str, seed: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """One of the models, not as it was made."""
    mjm = MODELS[name]()
    mjm.vis.quality.numslices = mjm.vis.quality.numstacks = 120
    mjd = mujoco.MjData(mjm)
    random = np.random.default_rng(seed)
    velocity = random.normal(0.0, 0.08, mjm.nv)
    mujoco.mj_integratePos(mjm, mjd.qpos, velocity, 1.0)
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd
