"""One world of classic MuJoCo, looked at from anywhere and in many ways: what its front ends have in common."""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.compat.mujoco.gl_camera import GlCamera
from warpcam.compat.mujoco.model_variants import (
    ModelVariant,
    WithModelTransparency,
    WithoutTransparent,
    has_transparent,
    sees_transparent,
)
from warpcam.compat.mujoco.sky_depth import sky_depth
from warpcam.core.errors import WarpcamError
from warpcam.kernels.passes.mirrors import OPAQUE_ABOVE
from warpcam.sources.mujoco.host import load
from warpcam.sources.mujoco.mjv_geoms import MjvCapacity, MjvGeoms, MjvGeomSlots
from warpcam.sources.mujoco.model import DATA_NAMES, MODEL_NAMES
from warpcam.sources.mujoco.tendon_limits import UNLIMITED

VIEW = "view"  # the one camera's name
MAX_CACHED = 8  # renderers of a studio, and scenes: ways to look that are gone to and fro between

# What a scene reads once of what a user may write: such a change makes another scene.
READ_ONCE = (
    *("site_size", "site_group", "site_matid", "tendon_width", "tendon_group", "tendon_matid", "flex_group"),
    *("flex_matid", "skin_group", "skin_matid", "geom_group", "geom_matid", "mat_reflectance"),
    *("geom_type", "site_type", "tendon_limited", "tendon_range", "tendon_margin", "tendon_solimp_lim"),
    *("tendon_stiffness", "tendon_damping", "tendon_frictionloss", "tendon_lengthspring"),
    *("flex_radius", "flex_flatskin", "skin_inflate", "actuator_cranklength"),
)
VIS_COLORS = ("haze", "constraint", "slidercrank", "crankbroken")  # of vis.rgba, likewise
PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
COLORS = ("site_rgba", "tendon_rgba", "flex_rgba", "skin_rgba")
MORE_OF_DATA = (
    *("site_xpos", "site_xmat", "wrap_xpos", "wrap_obj", "ten_wrapadr", "ten_wrapnum", "ten_length"),
    "flexvert_xpos",
)


@dataclass(frozen=True)
class Style:
    """Style of a picture; pictures of equal styles share kernels and buffers.

    Attributes:
        groups: Groups that are drawn, of geoms, sites, tendons, flexes and skins in this order.
        draw: Which of these kinds are drawn.
        shadows: Whether lights cast them.
        reflections: Whether planes and boxes reflect.
        sky: Whether the scene's skybox is behind everything; else black.
        antialiasing: Samples of a pixel at an edge, 1 or 4.
        model_transparency: Whether all but what is fixed to the world is as transparent as the model's
            ``vis.map.alpha`` says.
    """

    groups: tuple[tuple[int, ...], ...] = ((0, 1, 2),) * 5
    draw: tuple[str, ...] = ("geoms", "sites", "tendons", "flexes", "skins", "actuators")
    shadows: bool = True
    reflections: bool = True
    sky: bool = True
    antialiasing: int = 4
    model_transparency: bool = False


class FrameRenderer:
    """A model, a state of it, and every way in which somebody looked at it.

    Scenes and renderers are made when they are first needed and kept; taking a state costs one copy on the host.

    Args:
        model: The ``mujoco.MjModel``: what changes in it is seen at the next picture.
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
    """

    def __init__(self, model: mujoco.MjModel, device: Any = None):
        self._model = model
        self._device = device
        self._state = mujoco.MjData(model)
        self._sizes = _sizes(self._state)
        self._scenes: OrderedDict[Any, _CachedScene] = OrderedDict()
        self._eyes: OrderedDict[Any, _CameraRenderer] = OrderedDict()
        self._room = MjvCapacity()  # of scenes with something beside the model
        self._copies: dict[
            type[ModelVariant], tuple[ModelVariant, FrameRenderer]
        ] = {}  # the same state with other colours

    def take(self, data: mujoco.MjData) -> None:
        """Keep the state as it is now: what is simulated later is not seen in pictures of this one."""
        if not isinstance(data, mujoco.MjData):
            raise TypeError(f"data must be a mujoco.MjData, got {type(data).__name__}")
        if _sizes(data) != self._sizes:
            raise WarpcamError(
                f"data was made from another model: nq, nbody and ngeom are {_sizes(data)} there, {self._sizes} here"
            )
        mujoco.mj_copyData(self._state, self._model, data)

    def content(self, data: mujoco.MjData) -> bytes:
        """Equal for states, with the model as it is, that are drawn alike."""
        live = [getattr(data, name).tobytes() for name in (*DATA_NAMES.values(), *MORE_OF_DATA)]
        live += [getattr(self._model, name).tobytes() for name in (*MODEL_NAMES.values(), *COLORS)]
        light = self._model.vis.headlight
        head = np.concatenate((light.ambient, light.diffuse, light.specular, [light.active]))
        return repr(self._fixed()).encode() + head.tobytes() + b"".join(live)

    def reload(self) -> None:
        """Read meshes, height fields and textures of the model again at the next picture."""
        self._scenes.clear()
        self._eyes.clear()
        self._copies.clear()

    def scene(self, style: Style, backs: bool = False, mjv_geoms: MjvGeoms | None = None) -> wc.Scene:
        """The scene in which what that style names is drawn; with ``backs`` planes are seen from behind."""
        model = self._model
        known = (style.groups, style.draw, style.reflections, backs, self._fixed())
        seen, transparent = self._opacity()
        for key, made in reversed(self._scenes.items()):
            if key[0] == known and made.suits(seen, transparent, mjv_geoms):
                self._scenes.move_to_end(key)
                return made.filled(mjv_geoms)
        groups = dict(zip(("geoms", "sites", "tendons", "flexes", "skins"), style.groups, strict=True))
        places = None
        if mjv_geoms is not None:
            self._room = self._room.grown(mjv_geoms)
            places = MjvGeomSlots(model, self._room)
        scene = load(
            model,
            self._state,
            groups=groups,
            device=self._device,
            draw=style.draw,
            reflections=None if style.reflections else False,
            transparency="backs" if backs else None,
            decor=places,
        )
        key = known, seen.tobytes(), transparent.tobytes(), None if places is None else places.room
        made = self._scenes[key] = _CachedScene(scene, seen, transparent, places)
        _shorten(self._scenes)
        return made.filled(mjv_geoms)

    def look(
        self,
        view: GlCamera,
        style: Style,
        width: int,
        height: int,
        outputs: Sequence[str],
        drawn: Sequence[str] = (),
        *,
        through: bool = False,
        mjv_geoms: MjvGeoms | None = None,
    ) -> dict[str, np.ndarray]:
        """Images (height, width, channels) by output, of the state that was taken last; they are the caller's own.

        ``depth`` is ``view.far`` where nothing is hit. ``objects`` is an output here, too: int32 id and ``mjtObj``,
        -1 twice where nothing is hit. With ``drawn`` these outputs are drawn and only ``outputs`` of them read: then
        the same kernels serve whatever is asked. With ``through`` depth is of what is not transparent, and of the
        skybox, as MuJoCo's buffer of depth has it where it draws colours. ``mjv_geoms`` stands beside the model.
        """
        if style.model_transparency:
            plain, thinned = replace(style, model_transparency=False), self._copy(WithModelTransparency)
            return thinned.look(view, plain, width, height, outputs, drawn, through=through, mjv_geoms=mjv_geoms)
        solid = [name for name in outputs if name == "objects" or (name == "depth" and not through)]
        planes = self._planes_from_behind(view, style)
        turned = None if mjv_geoms is None else mjv_geoms.facing(view.position)
        if not solid or (not planes.size and turned is mjv_geoms):
            return self._look(
                view, style, width, height, outputs=outputs, drawn=drawn, through=through, mjv_geoms=mjv_geoms
            )
        with self._turned(planes):
            images = self._look(view, style, width, height, outputs=solid, drawn=drawn, through=False, mjv_geoms=turned)
        rest = [name for name in outputs if name not in solid]
        if rest:
            images |= self._look(
                view, style, width, height, outputs=rest, drawn=drawn, through=through, mjv_geoms=mjv_geoms
            )
        return images

    def _with_sky(self, depth: np.ndarray, view: GlCamera, style: Style) -> np.ndarray:
        """Return depth (height, width, 1) with the skybox before all that lies beyond it."""
        height, width = depth.shape[:2]
        sky = sky_depth(self._model, self._state, view, style.groups[0], width, height) if style.sky else None
        return depth if sky is None else np.minimum(depth, sky[..., None])

    def _look(
        self,
        view: GlCamera,
        style: Style,
        width: int,
        height: int,
        outputs: Sequence[str],
        drawn: Sequence[str],
        through: bool,
        mjv_geoms: MjvGeoms | None,
    ) -> dict[str, np.ndarray]:
        """Return the images of ``look``, in which planes are seen from behind in colours alone."""
        has_transparent_geoms = mjv_geoms is not None and mjv_geoms.transparent
        if (
            through
            and "depth" in outputs
            and (has_transparent_geoms or has_transparent(self._model, style.groups, style.draw))
        ):
            more, all_drawn = (
                [*names, "objects"] if names and "objects" not in names else names for names in (outputs, drawn)
            )
            images = self._look(
                view, style, width, height, outputs=more, drawn=all_drawn, through=False, mjv_geoms=mjv_geoms
            )
            if has_transparent_geoms or sees_transparent(self._model, images["objects"]):
                opaque = None if mjv_geoms is None else mjv_geoms.opaque()
                plain = self._copy(WithoutTransparent)
                images["depth"] = plain.look(view, style, width, height, ("depth",), mjv_geoms=opaque)["depth"]
            images["depth"] = self._with_sky(images["depth"], view, style)
            return {name: images[name] for name in outputs}
        names, wanted = _outputs(drawn or outputs), _outputs(outputs)
        backs = "rgb" in wanted and self._planes_from_behind(view, style).size > 0
        backs = backs and not has_transparent(self._model, style.groups, style.draw)  # such a scene shows them anyway
        scene = self.scene(style, backs, mjv_geoms)
        key = (id(scene), names, width, height, view.orthographic, style.shadows, style.sky, style.antialiasing)
        if key not in self._eyes or self._eyes[key].scene is not scene:
            self._eyes[key] = _CameraRenderer(scene, style, view, width, height, names)
            _shorten(self._eyes)
        self._eyes.move_to_end(key)
        images = self._eyes[key].see(view, wanted)
        if through and "depth" in images:
            images["depth"] = self._with_sky(images["depth"], view, style)
        if "objects" in outputs:
            ids = images.pop("segmentation")[..., 0]
            images["objects"] = scene.objects[ids] if mjv_geoms is None else self._objects(scene, ids, mjv_geoms)
        return images

    def _objects(self, scene: wc.Scene, ids: np.ndarray, mjv_geoms: MjvGeoms) -> np.ndarray:
        """Return the objects beside the model, with their names there."""
        made = next(made for made in self._scenes.values() if made.scene is scene)
        table = scene.objects.copy()
        if made.places is not None:
            first = len(table) - 1 - len(made.places.objects)
            for old, new in mjv_geoms.renamed:
                table[:first][(scene.objects[:first] == old).all(axis=1)] = new
            table[first:-1] = made.places.objects
        return table[ids]

    def _planes_from_behind(self, view: GlCamera, style: Style) -> np.ndarray:
        """Return the ids of drawn planes that have their backs to the camera."""
        model, state = self._model, self._state
        if "geoms" not in style.draw:
            return np.zeros(0, np.int64)
        planes = np.flatnonzero(model.geom_type == PLANE)
        behind = ((view.position - state.geom_xpos[planes]) * state.geom_xmat[planes, 2::3]).sum(axis=1) < 0.0
        seen = np.isin(model.geom_group[planes], style.groups[0]) & (model.geom_rgba[planes, 3] > 0.0)
        return planes[behind & seen]

    @contextmanager
    def _turned(self, planes: np.ndarray) -> Iterator[None]:
        """Have planes face the other way within this context."""
        poses = self._state.geom_xmat
        before = poses[planes].copy()
        poses[planes] *= np.array((1.0, -1.0, -1.0) * 3)
        try:
            yield
        finally:
            poses[planes] = before

    def _copy(self, kind: type[ModelVariant]) -> "FrameRenderer":
        """Return the same state in a copy of the model."""
        if kind not in self._copies or self._copies[kind][0].is_old():
            follower = kind(self._model)
            self._copies[kind] = follower, FrameRenderer(follower.model, self._device)
            self._copies[kind][1]._state = self._state
        follower, frame_renderer = self._copies[kind]
        follower.follow()
        return frame_renderer

    def _fixed(self) -> tuple[Any, ...]:
        """Equal as long as a scene that was made needs not be made anew."""
        model = self._model
        values = [getattr(model, name).tobytes() for name in READ_ONCE]
        transparent = (
            (model.geom_rgba[:, 3] < OPAQUE_ABOVE).tobytes(),
            (model.mat_rgba[:, 3] < OPAQUE_ABOVE).tobytes(),
        )
        sizes = model.vis.map
        scales = (sizes.znear, sizes.zfar, sizes.shadowclip, sizes.shadowscale, sizes.haze, model.stat.extent)
        cranks = (model.vis.scale.slidercrank, model.stat.meansize)
        colors = [np.asarray(getattr(model.vis.rgba, name)).tobytes() for name in VIS_COLORS]
        return (*values, *transparent, scales, cranks, *colors, model.opt.disableflags & UNLIMITED)

    def _opacity(self) -> tuple[np.ndarray, np.ndarray]:
        """Return which sites, tendons, flexes and skins are visible now, and which of these are transparent."""
        alpha = np.concatenate([getattr(self._model, name)[:, 3] for name in COLORS])
        return alpha > 0.0, alpha < OPAQUE_ABOVE


@dataclass(frozen=True, eq=False)
class _CachedScene:
    """A scene, which sites, tendons, flexes and skins were seen and transparent when it was made, and its places."""

    scene: wc.Scene
    seen: np.ndarray
    transparent: np.ndarray
    places: MjvGeomSlots | None

    def suits(self, seen: np.ndarray, transparent: np.ndarray, mjv_geoms: MjvGeoms | None) -> bool:
        if self.places is None or mjv_geoms is None:
            holds = self.places is None and mjv_geoms is None
        else:
            holds = self.places.room.holds(mjv_geoms)
        return holds and bool((self.seen >= seen).all() and (self.transparent == transparent)[seen].all())

    def filled(self, mjv_geoms: MjvGeoms | None) -> wc.Scene:
        if self.places is not None and mjv_geoms is not None:
            self.places.fill(mjv_geoms)
        return self.scene


class _CameraRenderer:
    """A renderer with one camera, which is moved to where somebody looks from."""

    def __init__(
        self, scene: wc.Scene, style: Style, view: GlCamera, width: int, height: int, outputs: tuple[str, ...]
    ):
        self.scene = scene
        self._width, self._height = width, height
        lens: wc.Lens = wc.Orthographic(height=1.0) if view.orthographic else wc.Pinhole(fx=1.0)
        camera = wc.Camera(
            VIEW, width=width, height=height, outputs=outputs, lens=lens, position=view.position,
            rotation=view.rotation, near=view.near, far=view.reach, depth_clipping="max", shadows=style.shadows,
            antialiasing=style.antialiasing, background=None if style.sky else (0.0, 0.0, 0.0),
        )  # fmt: skip
        self._renderer = wc.Renderer(scene, [camera])
        arrays = self._renderer.camera(VIEW)
        names = ("position", "rotation", "near", "far", "height" if view.orthographic else "intrinsics")
        self._arrays = {name: wp.from_torch(getattr(arrays, name)) for name in names}
        self._written: dict[str, Any] = {}

    def see(self, view: GlCamera, wanted: Sequence[str]) -> dict[str, np.ndarray]:
        values: dict[str, Any] = {"position": view.position.tolist(), "rotation": view.rotation.tolist()}
        reach = view.reach
        values.update(near=view.near, far=reach)
        across, down = view.right - view.left, view.top - view.bottom
        if view.orthographic:
            values["height"] = down
        else:
            fx, fy = view.near * self._width / across, view.near * self._height / down
            values["intrinsics"] = (fx, fy, -view.left * self._width / across, view.top * self._height / down)
        for name, value in values.items():
            if self._written.get(name) != value:
                self._arrays[name].assign(np.array([value], np.float32))
                self._written[name] = value
        images = self._renderer.render()[VIEW]
        on_host = {name: images[name][0].cpu().numpy() for name in wanted}
        if not self.scene.device.is_cuda:
            on_host = {name: image.copy() for name, image in on_host.items()}
        if "depth" in on_host:
            on_host["depth"][on_host["depth"] >= np.float32(reach)] = view.far
        return on_host


def _outputs(names: Sequence[str]) -> tuple[str, ...]:
    return tuple("segmentation" if name == "objects" else name for name in names)


def _sizes(data: mujoco.MjData) -> tuple[int, int, int]:
    return len(data.qpos), len(data.xpos), len(data.geom_xpos)


def _shorten(kept: OrderedDict[Any, Any]) -> None:
    while len(kept) > MAX_CACHED:
        kept.popitem(last=False)
