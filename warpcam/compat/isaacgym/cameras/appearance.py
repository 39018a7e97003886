"""What environments look like: colours, textures, ids and lights, and the models that cameras look at."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import newton
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.compat.isaacgym.api.math_types import Vec3
from warpcam.compat.isaacgym.assets.textured_meshes import uv_mesh
from warpcam.compat.isaacgym.kernels import state as kernels
from warpcam.compat.isaacgym.physics.environments import COLLIDES, NO_TEXTURE, VISIBLE, Env, Grounds, Spot, build
from warpcam.compat.isaacgym.physics.physics import Physics
from warpcam.kernels.runtime.launch import Stage, bind_launch

MAX_LIGHTS = 4
GEO = newton.GeoType


@dataclass
class DirectionalLight:
    """One of the directional lights; all linear.

    Attributes:
        intensity: (3,) what a white surface shows that faces it.
        ambient: (3,) what all surfaces show of it.
        direction: (3,) from the scene to the light; of length 0 there is ambient light alone.
    """

    intensity: tuple[float, ...]
    ambient: tuple[float, ...]
    direction: tuple[float, ...]


@dataclass
class Appearance:
    """What can be written at any time, for all environments.

    Attributes:
        lamps: By index.
        textures: Images by handle, (height, width, 3) uint8.
        changed: Grows with each change of a colour or an id.
        textured: Grows with each change of which texture is where.
        lit: Grows with each change of a light.
    """

    lamps: dict[int, DirectionalLight] = field(default_factory=dict)
    textures: dict[int, np.ndarray] = field(default_factory=dict)
    next_texture: int = 0
    changed: int = 0
    textured: int = 0
    lit: int = 0
    meshes: dict[tuple[Any, ...], newton.Mesh | None] = field(default_factory=dict)

    def mesh(self, kind: int, scale: Any, source: Any) -> newton.Mesh | None:
        """A shape as a mesh with texture coordinates, or None if it cannot have any."""
        x, y, z = (float(value) for value in scale)
        size = (x, y, z)
        if source is not None:
            return uv_mesh(kind, size, source)
        key = (int(kind), *size)
        if key not in self.meshes:
            self.meshes[key] = uv_mesh(kind, size, None)
        return self.meshes[key]


class EnvironmentScene:
    """Some environments as a camera sees them: a model of their own, or the one that is simulated.

    Attributes:
        scene: The ``warpcam.Scene``.
        ids: (shape,) int32, what segmentation images show.
        starts: First body of each environment.
    """

    def __init__(
        self,
        physics: Physics,
        envs: Sequence[Env],
        grounds: Grounds,
        looks: Appearance,
        up: newton.Axis,
        colliders: bool,
    ):
        self._physics, self._grounds, self._appearance, self._up = physics, grounds, looks, up
        self.envs, self._colliders = envs, colliders
        self.starts = np.cumsum([0, *(env.counts.bodies for env in envs[:-1])])
        self.version = 0  # grows when the scene is another one
        self._seen: tuple[Any, ...] = ()
        self._clothed = np.zeros(0, bool)  # shapes that may have a texture
        self._read()
        self._make()

    @property
    def poses(self) -> wp.array:
        """Of its bodies, in their environments' frames, as of the last ``update``."""
        poses = self._state.body_q
        return wp.empty(0, dtype=wp.transform, device=self._physics.device) if poses is None else poses

    def update(self) -> None:
        """Bring it up to date with states and looks."""
        looks = self._appearance
        if (looks.changed, looks.textured, looks.lit) != self._seen:
            self._refresh()
        if not len(self._rows):  # nothing but the ground
            return
        poses = self._physics.state.body_q
        if poses.ptr not in self._gather:  # there are two states, which change places
            inputs = [poses, self._rows, self._state.body_q]
            self._gather[poses.ptr] = bind_launch(kernels.gather_poses, len(self._rows), inputs, self._physics.device)
        self._gather[poses.ptr].launch()

    def _refresh(self) -> None:
        looks, before = self._appearance, self._textures
        self._read()
        clothed = self._textures != NO_TEXTURE
        unknown = (clothed & ~self._clothed).any() or not set(self._textures[clothed].tolist()) <= set(self._images)
        if unknown or self._lights != self._count_lights():
            self._make()
            return
        if not np.array_equal(before, self._textures):
            self._cover()
        if looks.changed != self._seen[0]:
            self._paint()
        if looks.lit != self._seen[2]:
            self._light()
        self._seen = (looks.changed, looks.textured, looks.lit)

    def _read(self) -> None:
        """Colours, textures and ids of all that is in these environments, the ground's first."""
        actors = [actor for env in self.envs for actor in env.actors]
        self._textures = np.concatenate([np.zeros(0, np.int64), *(actor.textures for actor in actors)])
        self._colors = np.concatenate([np.zeros((0, 3), np.float32), *(actor.colors for actor in actors)])
        ids = [np.append(actor.segments, actor.segment)[actor.asset.shapes] for actor in actors]
        self._ids = np.concatenate([np.zeros(0, np.int64), *ids])

    def _make(self) -> None:
        physics, looks, device = self._physics, self._appearance, self._physics.device
        clothed = self._textures != NO_TEXTURE
        self._clothed = clothed | self._clothed if len(self._clothed) else clothed  # once is always
        textured = bool(self._clothed.any())
        self._images = list(looks.textures) if textured else []
        apart = textured or self._colliders or self._grounds.differ
        if apart or len(self.envs) != physics.model.world_count:
            builder, spot = build(self.envs, self._grounds, self._up, Vec3(), drawn=not self._colliders)
            self._places = _local(spot, self.envs)
            self._dress(builder)
            with wp.ScopedDevice(device):
                self._model = builder.finalize(device=device, skip_all_validations=True)
        else:
            self._model, spot = physics.model, physics.spot
            self._places = _local(spot, self.envs)
        self._rows = wp.array(spot.bodies.astype(np.int32), dtype=wp.int32, device=device)
        self._state = self._model.state()
        self._gather: dict[int, Stage] = {}
        self._lights = self._count_lights()
        lights = [wc.Light(direction=(0.0, 0.0, -1.0)) for _ in range(self._lights)]
        images = [looks.textures[handle] for handle in self._images]
        self.scene = wc.from_newton(self._model, self._state, lights=lights, ambient=(0.0, 0.0, 0.0), textures=images)
        self._own_materials = self.scene.array("shape_materials").numpy().copy()
        self.scene.array("material_reflectance").zero_()  # matt: what is painted shows its colour and no sheen
        self.ids = wp.zeros(max(len(self._places), 1), dtype=wp.int32, device=device)
        self._own = self._model.shape_color.numpy().copy() if self._model.shape_count else np.zeros((0, 3), np.float32)
        self._paint()
        self._cover()
        self._light()
        self._seen = (looks.changed, looks.textured, looks.lit)
        self.version += 1

    def _dress(self, builder: newton.ModelBuilder) -> None:
        """Show what is to be seen, in its textures."""
        seen = COLLIDES if self._colliders else VISIBLE
        self._bare = np.zeros(len(self._places), bool)
        for shape, place in enumerate(self._places):
            builder.shape_flags[shape] = VISIBLE if builder.shape_flags[shape] & seen else 0
            if place < 0 or not self._clothed[place] or not builder.shape_flags[shape]:
                continue
            kind, source = builder.shape_type[shape], builder.shape_source[shape]
            mesh = self._appearance.mesh(kind, builder.shape_scale[shape], source)
            if mesh is None:
                self._bare[shape] = True
                logging.getLogger("warpcam").warning(
                    "set_rigid_body_texture: shape '%s' has no texture coordinates; its colour is drawn",
                    builder.shape_label[shape],
                )
                continue
            if kind != GEO.MESH:
                builder.shape_scale[shape] = (1.0, 1.0, 1.0)
            builder.shape_type[shape], builder.shape_source[shape] = GEO.MESH, mesh

    def _paint(self) -> None:
        if not len(self._places):
            return
        own = self._places >= 0
        colors, ids = self._own.copy(), np.zeros(len(self._places), np.int64)
        colors[own], ids[own] = self._colors[self._places[own]], self._ids[self._places[own]]
        if not own.all():
            ids[~own] = np.array(self._grounds.segments)[-1 - self._places[~own]]
        self._model.shape_color.assign(colors)
        self.ids.assign(ids.astype(np.uint32).view(np.int32))

    def _cover(self) -> None:
        """Give each shape the material of its texture."""
        if not self._images:
            return
        array = self.scene.array("shape_materials")
        # Of each column, negative for none of these.
        places = np.append(np.where(self._bare, -1, self._places), -1)[self.scene.columns]
        textures = np.where(places >= 0, self._textures[np.maximum(places, 0)], NO_TEXTURE)
        first = self.scene.array("material_roughness").shape[1] - len(self._images)
        row = np.zeros(max(self._images) + 2, np.int32)
        row[self._images] = first + np.arange(len(self._images))
        array.assign(np.where(textures == NO_TEXTURE, self._own_materials, row[textures]).astype(np.int32))

    def _count_lights(self) -> int:
        return max(self._appearance.lamps, default=-1) + 1

    def _light(self) -> None:
        if not self._lights:
            return
        off = DirectionalLight((0.0,) * 3, (0.0,) * 3, (0.0, 0.0, 1.0))
        lamps = [self._appearance.lamps.get(index, off) for index in range(self._lights)]
        toward = np.array([lamp.direction for lamp in lamps], np.float32)
        length = np.linalg.norm(toward, axis=1, keepdims=True)
        toward = np.where(length > 0.0, toward / np.maximum(length, 1e-12), (0.0, 0.0, 1.0))
        intensity = np.where(length > 0.0, [lamp.intensity for lamp in lamps], 0.0)
        for name, values in (
            ("directions", -toward),
            ("diffuse", intensity),
            ("specular", intensity),
        ):
            array = self.scene.array(f"light_{name}")
            array.assign(np.tile(np.asarray(values, np.float32), (array.shape[0], 1, 1)))
        # What light is everywhere does not end where its shadow begins.
        everywhere = np.zeros((3, 3), np.float32)
        everywhere[0] = np.sum([lamp.ambient for lamp in lamps], axis=0)
        self.scene.array("headlight").assign(everywhere)


def _local(spot: Spot, envs: Sequence[Env]) -> np.ndarray:
    """Places of a model's shapes among those of these environments alone, or -1 - n for ground n."""
    every = np.concatenate(
        [np.arange(env.start.shapes, env.start.shapes + env.counts.shapes) for env in envs] or [np.zeros(0, np.int64)]
    )
    places = np.full(int(every.max(initial=-1)) + 2, -1, np.int64)
    places[every] = np.arange(len(every))
    return np.where(spot.shapes >= 0, places[np.maximum(spot.shapes, 0)], spot.shapes)
