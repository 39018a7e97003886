"""Builder of one scene: adds shapes, looks, lights, floors and cameras, all drawn from the scene's seed."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from warpcam.benchmarks.scenes import GEOM, facing, hills
from warpcam.benchmarks.suite.recipes import Recipe
from warpcam.benchmarks.suite.solids import SOLIDS

Floats = Sequence[float] | np.ndarray
JOINT = mujoco.mjtJoint
LIGHT = mujoco.mjtLightType
TEXTURE_SIDE = 128
MATERIALS = 6  # with a texture each, in a scene that has textures
PRIMITIVES = (GEOM.mjGEOM_BOX, GEOM.mjGEOM_SPHERE, GEOM.mjGEOM_CAPSULE, GEOM.mjGEOM_CYLINDER, GEOM.mjGEOM_ELLIPSOID)
# Distance of the near and far plane of MuJoCo's cameras [m]. Peers compile kernels that hold it: equal in all scenes.
NEAR, FAR = 0.015625, 256.0


class Place:
    """A scene while it is built.

    Attributes:
        count: Shapes so far.
        random: Generator that everything is drawn from.
    """

    def __init__(self, recipe: Recipe, extent: float) -> None:
        """Begin a scene whose size is about `extent` [m], a power of two."""
        self.recipe, self.count = recipe, 0
        self.random = np.random.default_rng((7, recipe.seed))
        self.spec = spec = mujoco.MjSpec()
        self.world = spec.worldbody
        spec.default.geom.contype = spec.default.geom.conaffinity = 0  # nothing is simulated
        spec.stat.extent, spec.stat.center = extent, (0.0, 0.0, 0.25 * extent)
        spec.visual.map.znear, spec.visual.map.zfar = NEAR / extent, FAR / extent
        self._hue = self.random.uniform()
        self._materials = [self._material(index) for index in range(MATERIALS if recipe.textures else 0)]
        self._solids: dict[str, list[str]] = {}

    # Looks.

    def color(self, spread: float = 1.0) -> tuple[float, float, float, float]:
        """A random opaque colour; a small `spread` keeps to hues near the scene's own."""
        hue = self._hue + spread * self.random.uniform(-0.5, 0.5)
        wheel = 0.5 + 0.5 * np.cos(2.0 * np.pi * (hue + np.array((0.0, 1.0, 2.0)) / 3.0))
        saturation, value = self.random.uniform(0.1, 0.7), self.random.uniform(0.4, 0.95)
        red, green, blue = (float(c) for c in value * (1.0 - saturation * (1.0 - wheel)))
        return red, green, blue, 1.0

    def look(self, spread: float = 1.0) -> dict[str, Any]:
        """Arguments of a geom that give it a texture or a colour."""
        if self._materials and self.random.uniform() < self.recipe.textures:
            return {"material": self._materials[int(self.random.integers(len(self._materials)))]}
        return {"rgba": self.color(spread)}

    def _material(self, index: int) -> str:
        name = f"look{index}"
        self._texture(name, ("checks", "planks", "speckles", "stains")[index % 4])
        repeat = float(self.random.choice((1.0, 2.0, 4.0)))
        material = self.spec.add_material(name=name, texuniform=bool(index % 2), texrepeat=(repeat, repeat))
        material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
        material.specular, material.shininess = self.random.uniform(0.0, 0.6), self.random.uniform(0.1, 0.9)
        return name

    def _texture(self, name: str, kind: str) -> None:
        """Add an image of TEXTURE_SIDE squared pixels in two colours."""
        random, side = self.random, TEXTURE_SIDE
        row, column = np.mgrid[0:side, 0:side]
        if kind == "checks":
            mix = ((row * 8 // side + column * 8 // side) % 2).astype(np.float64)
        elif kind == "planks":
            mix = random.uniform(0.0, 1.0, 8)[row * 8 // side] + 0.1 * random.uniform(0.0, 1.0, side)[column]
        elif kind == "speckles":
            mix = random.uniform(0.0, 1.0, (side, side)) ** 3
        else:
            mix = np.kron(random.uniform(0.0, 1.0, (side // 8, side // 8)), np.ones((8, 8)))
        first, second = np.array(self.color()[:3]), np.array(self.color()[:3])
        pixels = 255.0 * (first + np.clip(mix, 0.0, 1.0)[..., None] * (second - first))
        flat = mujoco.mjtTexture.mjTEXTURE_2D
        texture = self.spec.add_texture(name=name, type=flat, width=side, height=side, nchannel=3)
        texture.data = np.rint(pixels).astype(np.uint8).tobytes()

    # Shapes.

    def add(self, body: Any, kind: Any, size: Floats, pos: Floats = (0.0, 0.0, 0.0), **more: Any) -> None:
        """Add a geom; with a random look where `more` names none."""
        look = {} if {"rgba", "material"} & more.keys() else self.look()
        full = (*(float(s) for s in size), 0.0, 0.0)[:3]
        body.add_geom(type=kind, size=full, pos=pos, **look, **more)
        self.count += 1

    def box(self, center: Floats, size: Floats, body: Any = None, **more: Any) -> None:
        """Add a box by its full size."""
        self.add(body or self.world, GEOM.mjGEOM_BOX, 0.5 * np.asarray(size), center, **more)

    def bar(self, start: Floats, end: Floats, radius: float, body: Any = None, **more: Any) -> None:
        """Add a capsule between two points."""
        self.add(body or self.world, GEOM.mjGEOM_CAPSULE, (radius,), fromto=(*start, *end), **more)

    def primitive(self, body: Any, scale: float, kind: Any = None, **more: Any) -> None:
        """Add a primitive of random kind and proportions whose half size is about `scale` [m]."""
        kind = PRIMITIVES[int(self.random.integers(len(PRIMITIVES)))] if kind is None else kind
        self.add(body, kind, scale * self.random.uniform(0.5, 1.1, 3), **more)

    def solid(self, kind: str) -> str:
        """Name of a mesh of the scene of this kind; each scene has up to four different ones."""
        made = self._solids.setdefault(kind, [])
        if len(made) < 4:
            faces = round(self.recipe.faces * self.random.uniform(0.6, 1.4))
            made.append(SOLIDS[kind](self.random, faces).add_to(self.spec, f"{kind}{len(made)}"))
            return made[-1]
        return made[int(self.random.integers(len(made)))]

    def mesh(self, body: Any, kind: str, pos: Floats = (0.0, 0.0, 0.0), **more: Any) -> None:
        """Add a mesh that is to be seen as a geom."""
        self.add(body, GEOM.mjGEOM_MESH, (0.0,), pos, meshname=self.solid(kind), **more)

    # Bodies.

    def body(self, parent: Any, pos: Floats, yaw: float = 0.0, name: str = "") -> Any:
        quaternion = (np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw))
        inertia = {"mass": 1.0, "inertia": (1.0, 1.0, 1.0), "explicitinertial": True}
        return parent.add_body(pos=pos, quat=quaternion, name=name, **inertia)

    def free(self, pos: Floats) -> Any:
        """Add a body that moves freely, turned about z."""
        body = self.body(self.world, pos, self.random.uniform(-np.pi, np.pi))
        body.add_freejoint()
        return body

    def hinged(self, parent: Any, pos: Floats, axis: Floats, low: float, high: float) -> Any:
        body = self.body(parent, pos)
        body.add_joint(type=JOINT.mjJNT_HINGE, axis=axis, range=(low, high), limited=True)
        return body

    def sliding(self, parent: Any, pos: Floats, axis: Floats, low: float, high: float) -> Any:
        body = self.body(parent, pos)
        body.add_joint(type=JOINT.mjJNT_SLIDE, axis=axis, range=(low, high), limited=True)
        return body

    # Surroundings.

    def floor(self, half: float) -> None:
        """Add the recipe's floor, with this half side [m] where it ends."""
        kind = self.recipe.floor
        if kind == "none":
            return
        if kind == "hills":
            height = hills(65, self.recipe.seed)
            self.spec.add_hfield(
                name="hills", size=(half, half, 0.08 * half, 0.1), nrow=65, ncol=65, userdata=height.ravel()
            )
            ground = -0.08 * half * height[32, 32]
            self.world.add_geom(type=GEOM.mjGEOM_HFIELD, hfieldname="hills", pos=(0.0, 0.0, ground), **self.look(0.2))
            self.count += 1
            return
        where, _, how = kind.partition("-")
        size = (0.0, 0.0, 1.0) if where == "infinite" else (half, half, 1.0)
        look: dict[str, Any] = {"rgba": (0.5, 0.5, 0.5, 1.0) if how == "grey" else self.color()}
        if how == "textured":
            self._texture("floor", "checks")
            material = self.spec.add_material(name="floor", texuniform=True, texrepeat=(0.5, 0.5))
            material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "floor"
            look = {"material": "floor"}
        self.add(self.world, GEOM.mjGEOM_PLANE, size, **look)

    def light(self, wide: float, high: float) -> None:
        """Add the recipe's lights over an area of this half side, at this height at most [m]."""
        count, random = self.recipe.lights, self.random
        headlight = self.spec.visual.headlight
        headlight.ambient, headlight.diffuse = (0.2,) * 3, (0.5,) * 3 if count == 0 else (0.25,) * 3
        for index in range(count):
            color = np.full(3, min(0.9, 1.4 / count))
            if self.recipe.colored_lights:
                color *= random.uniform(0.4, 1.0, 3)
            about = random.uniform(-0.8, 0.8, 2) * wide
            pos, direction = (*about, random.uniform(0.8, 1.0) * high), (0.0, 0.0, -1.0)
            if self.recipe.light == "sun" and index == 0:
                kind, direction = LIGHT.mjLIGHT_DIRECTIONAL, (*random.uniform(-0.6, 0.6, 2), -1.0)
            elif self.recipe.light == "bulbs":
                kind = LIGHT.mjLIGHT_POINT
            else:
                kind, direction = LIGHT.mjLIGHT_SPOT, (*(-0.5 * about / high + random.uniform(-0.2, 0.2, 2)), -1.0)
            self.world.add_light(
                type=kind,
                pos=pos,
                dir=direction,
                diffuse=color,
                cutoff=float(random.uniform(35.0, 75.0)),
                castshadow=index < self.recipe.casting,
            )

    def camera(self, pos: Floats, target: Floats, fovy: float = 45.0, body: Any = None) -> None:
        """Add the camera `view`; `pos` and `target` are in the frame of its body [m]."""
        (body or self.world).add_camera(name="view", pos=pos, quat=facing(tuple(pos), tuple(target)), fovy=fovy)

    def around(self, radius: float, height: float, target: Floats, fovy: float = 45.0) -> None:
        """Add a fixed camera at a random side of a target."""
        angle = self.random.uniform(-np.pi, np.pi)
        offset = np.array((radius * np.cos(angle), radius * np.sin(angle), height))
        self.camera(np.asarray(target, dtype=np.float64) + offset, target, fovy)
