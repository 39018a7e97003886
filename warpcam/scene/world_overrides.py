"""Arrays of one's own: what each world may have for itself, whatever the scene's simulator holds of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.passes.world_overrides import bind_light_intensity, bind_shape_colors, empty_overrides
from warpcam.kernels.runtime.launch import Stage
from warpcam.scene.source import SPLAT_ARRAYS, LiveArray, SceneDescription, Source, live_arrays_of
from warpcam.scene.validation import check_array

# What no simulator holds: dtype and what its second dimension counts, "" for none.
EXTRA_OVERRIDES: Mapping[str, tuple[Any, str]] = {
    "material_texture_offset": (wp.vec2, "materials"),
    "light_intensity": (wp.float32, "lights"),
    "headlight": (wp.vec3, "parts"),
    "background": (wp.vec3, ""),
    "skybox": (wp.int32, ""),
}
INTENSITY_SCALED = ("light_ambient", "light_diffuse", "light_specular")
# What metallic-roughness materials have no use for: their colour is their shapes'.
UNUSED = ("material_color", "material_emission", "material_specular", "material_shininess")


def override_names(parts: SceneDescription) -> tuple[str, ...]:
    """Return the names of arrays that worlds of such a scene may override."""
    fields = live_arrays_of(parts)
    shapes = ("shape_colors", "shape_materials") if parts.num_materials else ("shape_colors",)
    counts = {"materials": parts.num_materials, "lights": parts.num_lights}
    rest = [
        name
        for name, field in fields.items()
        if (name == "sky" or (name.startswith(("material_", "light_")) and counts[field.rows]))
        and not (parts.physical and name in UNUSED)
        and not (SceneFlag.PROJECTED in parts.flags and name == "material_texture_uniform")  # by the metre, all of them
    ]
    more = [name for name, (_, rows) in EXTRA_OVERRIDES.items() if counts.get(rows, 1)]
    if parts.physical or not any(image.kind == "cube" for image in parts.textures):
        more.remove("skybox")  # a dome's image is light as well
    return (*shapes, *rest, *more, *(SPLAT_ARRAYS if parts.splat_counts else ()))


class WorldOverrides:
    """The arrays that ``Scene.vary`` has made, and the stages that bring them to bear at the head of each frame."""

    def __init__(self, parts: SceneDescription, num_worlds: int, device: wp.Device):
        self._parts, self._num_worlds, self._device = parts, num_worlds, device
        self._fields: Mapping[str, LiveArray] = live_arrays_of(parts)
        self._arrays: dict[str, wp.array] = {}
        self._tensors: dict[str, torch_interop.Tensor] = {}
        self._finished: dict[str, wp.array] = {}
        self._headlight: wp.array | None = None
        self.stages: tuple[Stage, ...] = ()

    def __contains__(self, name: object) -> bool:
        return name in self._tensors

    def tensor(self, name: str) -> torch_interop.Tensor:
        return self._tensors[name]

    def make(self, name: str, source: Source, arrays: Mapping[str, wp.array]) -> None:
        """Make room for an entry for each world of ``arrays[name]``, or of what no simulator holds."""
        allowed = override_names(self._parts)
        if name not in allowed:
            raise WarpcamError(f"vary: {name!r} came; in this scene it may be {', '.join(allowed)}")
        if torch_interop.is_capturing(self._device):
            raise WarpcamError(f"vary: a capture is under way, and {name!r} needs memory; call it before")
        if name in EXTRA_OVERRIDES:
            array = self._make_more(name, arrays)
        elif source.user_owned(name) and self._is_whole(source.arrays()[name]):
            array = self._arrays[name] = source.arrays()[name]  # an entry for each world, for nobody else to write
        else:
            array = self._arrays[name] = self._copied(name, arrays[name], source)
        self._tensors[name] = torch_interop.to_torch(array)

    def over(self, arrays: Mapping[str, wp.array]) -> Mapping[str, wp.array]:
        """The source's arrays with those of one's own in their places."""
        return {**arrays, **self._arrays} if self._arrays else arrays

    def finish(self, source: Source, arrays: Mapping[str, wp.array]) -> Mapping[str, wp.array]:
        """Return the arrays that kernels read instead of ``arrays``; sets ``stages``, which write them."""
        stages, finished = [], dict(arrays)
        for name in INTENSITY_SCALED if "light_intensity" in self._arrays else ():
            intensity = self._arrays["light_intensity"]
            finished[name] = self._room(name, wp.vec3, intensity.shape)
            stages.append(bind_light_intensity(arrays[name], intensity, finished[name], self._device))
        theirs = source.arrays()["shape_colors"]
        if "shape_colors" in self._arrays and not source.user_owned("shape_colors"):
            own, label = self._arrays["shape_colors"], source.user_name("shape_colors")
            check_array(label, self._fields["shape_colors"], theirs, own.shape[1], self._num_worlds, self._device)
            finished["shape_colors"] = self._room("shape_colors", wp.vec4, own.shape)
            stages.append(bind_shape_colors(theirs, own, finished["shape_colors"], self._device))
        if self._headlight is not None:
            finished["headlight"] = self._headlight
        self.stages = tuple(stages)
        return finished

    def stages_over(self, source: Source) -> tuple[Stage, ...]:
        """``stages``, and what the source does to colours that are painted."""
        if source.color_blend is None or "shape_colors" not in self._finished:
            return self.stages
        return (*self.stages, *source.color_blend.blend(self._finished["shape_colors"]))

    @property
    def headlights(self) -> bool:
        return self._headlight is not None

    def kernel_struct(self) -> Any:
        """For the kernels; None where nothing of it is there."""
        names = {"material_texture_offset", "background", "skybox"} & set(self._arrays)
        if not names:
            return None
        overrides = empty_overrides(self._device)
        if "material_texture_offset" in names:
            overrides.texture_offsets = self._arrays["material_texture_offset"]
        if names & {"background", "skybox"}:
            colors, skyboxes = self._arrays.get("background"), self._arrays.get("skybox")
            if colors is None:
                colors = self._room("background", wp.vec3, (1,))
            if skyboxes is None:
                skyboxes = self._room("skybox", wp.int32, (1,))
                skyboxes.fill_(self._parts.skybox)
            overrides.backgrounds, overrides.skyboxes = colors, skyboxes
        return overrides

    def _is_whole(self, array: wp.array) -> bool:
        return array.shape[0] == self._num_worlds and array.is_contiguous

    def _room(self, name: str, dtype: Any, shape: tuple[int, ...]) -> wp.array:
        if name not in self._finished:
            self._finished[name] = wp.zeros(shape, dtype=dtype, device=self._device)
        return self._finished[name]

    def _copied(self, name: str, array: wp.array, source: Source) -> wp.array:
        host = array.numpy()
        if name == "shape_colors" and source.color_blend is not None:
            host = source.color_blend.without_blend(host.copy())
        rows = np.arange(self._num_worlds) % host.shape[0]
        host = np.ascontiguousarray(host[rows])
        if name == "shape_colors":
            host[..., 3] = np.where(host[..., 3] == 0.0, 1.0, host[..., 3])  # what is hidden now may be shown later
        return wp.array(host, dtype=array.dtype, ndim=array.ndim, device=self._device)

    def _make_more(self, name: str, arrays: Mapping[str, wp.array]) -> wp.array:
        dtype, rows = EXTRA_OVERRIDES[name]
        counts = {"materials": self._parts.num_materials, "lights": self._parts.num_lights}
        if name == "headlight":
            # The first three say that it shines, in whatever colours each world has after them.
            colors = arrays["headlight"].numpy()
            host = np.concatenate([np.ones((3, 3), np.float32), np.tile(colors, (self._num_worlds, 1))])
            self._headlight = wp.array(host, dtype=wp.vec3, device=self._device)
            return self._headlight[3:].reshape((self._num_worlds, 3))
        shape = (self._num_worlds, counts[rows]) if rows else (self._num_worlds,)
        array = wp.zeros(shape, dtype=dtype, device=self._device)
        if name == "light_intensity":
            array.fill_(1.0)
        elif name == "skybox":
            array.fill_(self._parts.skybox)
        self._arrays[name] = array
        return array
