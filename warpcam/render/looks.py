"""Looks of a scene: how its lit images are made."""

import itertools
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args
from weakref import WeakSet

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core.errors import WarpcamError
from warpcam.kernels.passes.world_overrides import without_background
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import Background, Lights, Physical
from warpcam.render.occlusion import Occlusion
from warpcam.render.paths import PathOptions, check_whole
from warpcam.scene.environments import Environments
from warpcam.scene.scene import Scene
from warpcam.scene.source import SceneDescription

LookName = Literal["mujoco", "pbr", "path"]
FEW = 3  # materials that a warning names
_told: WeakSet[SceneDescription] = WeakSet()  # whose transmission has been told of


def looks_of(scene: Scene) -> tuple[LookName, ...]:
    """Looks that a scene can be rendered in, its own first."""
    parts = scene.description()
    own: tuple[LookName, ...] = ("pbr",) if parts.physical else ("mujoco",)
    if not parts.physical and parts.as_physical is None:
        return own
    others: tuple[LookName, ...] = ("pbr", "path") if scene.tables().splats is None else ("pbr",)
    return tuple(dict.fromkeys((*own, *others)))


class Look:
    """What a renderer was asked for.

    Args:
        name: One of ``LookName``; None is the scene's own.
        options: Of paths; only with "path".
        scene: The scene.
        environments: ``Environments`` of it, or None.
        reflections: Whether rays find what surfaces mirror, and what is seen through clear ones.
    """

    def __init__(self, name: Any, options: Any, scene: Scene, environments: Any = None, reflections: Any = False):
        own = "pbr" if scene.description().physical else "mujoco"
        if name is not None and not (isinstance(name, str) and name in get_args(LookName)):
            allowed = ", ".join(repr(each) for each in get_args(LookName))
            raise WarpcamError(f"Renderer: look is {name!r}; allowed are {allowed}, or None for the scene's own")
        self.name: LookName = next(each for each in get_args(LookName) if each == (own if name is None else name))
        if options is not None and not isinstance(options, PathOptions):
            raise WarpcamError(f"Renderer: path must be a PathOptions or None, got {options!r}")
        if options is not None and not self.traces_paths:
            raise WarpcamError(f"Renderer: path has options of look='path', and the look is {self.name!r}")
        self._has_splats = scene.tables().splats is not None
        if self.traces_paths and self._has_splats:
            raise WarpcamError("Renderer: look='path' draws no clouds of Gaussians, which this scene has")
        self.options = (options or PathOptions()) if self.traces_paths else None  # of paths
        self._parts, self._device = scene.description(), scene.device
        if self.name != own and "mujoco" == self.name:
            raise WarpcamError("Renderer: look='mujoco' is of scenes of MuJoCo alone, this one's own is 'pbr'")
        if own == "mujoco" and self.name != own and self._parts.as_physical is None:
            raise WarpcamError(
                f"Renderer: look is {self.name!r}, for which this scene has no materials; its own is {own!r}"
            )
        self.reflections = self._checked_reflections(reflections)
        if not (self.traces_paths or self.reflections):
            _tell_of_transmission(self._parts)
        self._arrays: Mapping[str, wp.array] | None = None
        self._environments = self._checked(environments, scene)
        self._suns: tuple[Stage, ...] = ()  # of the tables that were asked for last

    def tables(self, tables: SceneTables) -> SceneTables:
        """The scene's tables as this look takes them."""
        return self._lit_by_environments(self._physical(tables))

    def stages(self) -> Sequence[Stage]:
        """Stages at the head of a frame, before those that draw."""
        return () if self._environments is None else (self._environments.stage(), *self._suns)

    def _physical(self, tables: SceneTables) -> SceneTables:
        if self.name == "mujoco" or tables.physical is not None or self._parts.as_physical is None:
            return tables
        if self._arrays is None:
            self._arrays = self._parts.as_physical(self._device)
        if self._arrays["roughness"].shape[1] != tables.materials.color.shape[1]:
            raise WarpcamError(f"Renderer: look is {self.name!r}, which scenes that mjv_updateScene fills have not")
        physical: Any = Physical()
        for name, array in self._arrays.items():
            setattr(physical, name, array)
        lights: Any = Lights()
        lights.assign(tables.lights)
        lights.specular = lights.diffuse
        physical.plain = lights
        layers = tables.layers
        if layers is not None:  # neither mirrors nor haze are of this look
            layers = replace(layers, mirrors=wp.empty(0, dtype=wp.int32, device=self._device), haze=None)
        return replace(tables, physical=physical, has_maps=self._parts.maps, layers=layers, horizon=0.0)

    def _checked(self, environments: Any, scene: Scene) -> Environments | None:
        if environments is None:
            return None
        if not isinstance(environments, Environments):
            raise WarpcamError(f"Renderer: environments must be a warpcam.Environments or None, got {environments!r}")
        if environments.scene() is not scene:
            raise WarpcamError("Renderer: environments are of another scene; make some of this one")
        if self.name == "mujoco" or self._has_splats:
            why = "the scene has clouds of Gaussians" if self._has_splats else "the look is 'mujoco'"
            raise WarpcamError(f"Renderer: environments light look='pbr' and look='path' of shapes, and {why}")
        return environments

    def _checked_reflections(self, reflections: Any) -> bool:
        if not isinstance(reflections, bool | np.bool_):
            raise WarpcamError(f"Renderer: reflections must be True or False, got {reflections!r}")
        if reflections and self.name != "pbr":
            raise WarpcamError(
                f"Renderer: reflections is True, which is of look='pbr' alone; the look is {self.name!r}"
            )
        if reflections and self._has_splats:
            raise WarpcamError(
                "Renderer: reflections is True, and mirrors show no clouds of Gaussians, which this scene has"
            )
        return bool(reflections)

    def _lit_by_environments(self, tables: SceneTables) -> SceneTables:
        """The tables with images in float in place of the scene's own sky."""
        if self._environments is None:
            return tables
        physical: Any = Physical()
        physical.assign(tables.physical)
        physical.environments, physical.sky = self._environments.tables(self.traces_paths)
        if self._parts.unlit and not tables.headlights:
            lights: Any = Lights()
            lights.assign(tables.lights)
            lights.headlight = wp.zeros(3, dtype=wp.vec3, device=self._device)
            physical.plain, tables = lights, replace(tables, lights=lights)
        if self._environments.has_suns() and not self.traces_paths:
            physical, stage = self._environments.with_suns(physical)
            self._suns = (stage,)
            tables = replace(tables, lights=physical.plain, num_lights=tables.num_lights + 1)
        background: Any = Background()
        background.color, background.skybox = wp.vec3(0.0, 0.0, 0.0), -1
        return replace(
            tables,
            physical=physical,
            background=background,
            has_skybox=False,
            world_overrides=without_background(tables.world_overrides, self._device),
            has_environment=True,
            shows_environment=True,
        )

    def paths(self, device: wp.Device) -> tuple[PathOptions, wp.array] | None:
        """Options of paths and int32, (1,): how many ``accumulate`` adds; None where no paths are traced."""
        if self.options is None:
            return None
        self.more = wp.zeros(1, dtype=wp.int32, device=device)
        return self.options, self.more

    def check_display(self, cameras: Iterable[Camera]) -> None:
        """Raise for a camera whose curve of display colours, automatic exposure or bloom this look has not."""
        if self.name == "mujoco":
            why, more = "the look is 'mujoco', which has", "; look='pbr' and look='path' have all"
        elif self._has_splats:
            why, more = "the scene has clouds of Gaussians, whose colours are a display's; they have", ""
        else:
            return
        plain = {"tone_mapping": "clip", "auto_exposure": None, "bloom": None}
        for camera, (name, allowed) in itertools.product(cameras, plain.items()):
            if (value := getattr(camera, name)) != allowed:
                raise WarpcamError(f"{camera.where}: {name} is {value!r}, and {why} {allowed!r} alone{more}")

    def occlusion(
        self, ambient_occlusion: Any, soft_shadows: Any, indirect_light: Any, cameras: Iterable[Camera]
    ) -> Occlusion:
        """What hides light, as it came to a renderer, or the error that says what is wrong with it."""
        return Occlusion.of(ambient_occlusion, soft_shadows, indirect_light, self.name, self._has_splats, cameras)

    def check_more(self, samples: Any, has_drawn: bool) -> int:
        """The number of paths that are to be added, or the error that there is nothing to add to."""
        count = check_whole("accumulate: samples", samples, 1)
        if not (self.traces_paths and has_drawn):
            why = "render() comes first" if self.traces_paths else f"the look is {self.name!r}"
            raise WarpcamError(f"accumulate: there are no paths to add to, as {why}")
        return count

    @property
    def traces_paths(self) -> bool:
        return self.name == "path"


def _tell_of_transmission(parts: SceneDescription) -> None:
    """Warn, once for a scene, that the real-time look draws no transmission without reflections."""
    names = parts.transmissive
    if names and parts not in _told:
        _told.add(parts)
        more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
        logging.getLogger("warpcam").warning(
            "Renderer: look='pbr' draws no transmission without reflections=True, and look='path' does; these "
            "materials are drawn solid: %s%s",
            ", ".join(names[:FEW]),
            more,
        )
