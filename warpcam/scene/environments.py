"""Light from all around, from images in float: which of them each world has, how it stands and how bright it is."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.arrays import as_numbers, per_world
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import Limits
from warpcam.core.world_arrays import WorldArrays
from warpcam.kernels.build import environment_maps as maps
from warpcam.kernels.passes.environments import ROWS, PlacedEnvironments, bind_environments
from warpcam.kernels.passes.suns import bind_suns, make_suns, with_suns
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import SKY_TERMS, EnvironmentMaps
from warpcam.scene.scene import Scene
from warpcam.textures.light_files import read_light
from warpcam.textures.panorama import sky_of_panorama
from warpcam.textures.panorama_sun import sun_of_panorama, without_sun
from warpcam.textures.sky_model import sky_image

# From the axes of sky_of_panorama(), left, up, middle, to those of the kernels: middle, left, up.
AXES = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
NO_SUN = ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0)  # direction, colour and size
MOST_TEXELS = 2**31 - 1  # of all images and their maps


class Environments(WorldArrays):
    """Light from all around for ``Renderer(environments=...)`` with look="pbr" or look="path".

    It stands in place of the scene's own sky: images are linear radiance by longitude and latitude, shared by all
    worlds. ``wc.randomize`` draws its arrays.

    Args:
        scene: Which is lit.
        images: One image or several: files (.hdr, .exr), or arrays (height, width, 3) of floats, at least 0. The top
            row of an image is up, its middle lies along the world's +x, and to the right of that is -y, where
            ``rotation`` does not say otherwise.
        index: Number of the image of each world, one for all or (world,); -1 is none, and no light.
        yaw: By which the image is turned about its upright axis, to the left [degrees]; one for all or (world,).
        rotation: Then from the image's axes to the world's: quaternion w, x, y, z, (4,) or (world, 4). In scenes whose
            +y is up, (0.5, 0.5, 0.5, 0.5) has the image upright with its middle along +z, as UsdLux has it.
        intensity: Factors of the light, one for all, (3,) for red, green and blue, (world,) or (world, 3).
        limits: Of the sizes of files; None is ``Limits()``.
        extract_sun: In look="pbr" an image's brightest small part, no wider than 10 degrees, is a distant light of the
            same irradiance, which casts shadows where cameras have them. False leaves it in the image.

    Attributes:
        index: int32 tensor (world,) on the scene's device, as all of these; it is written in place and read at the next
            frame. Other numbers than those of images are none.
        yaw: float32, (world,).
        rotation: float32, (world, 4).
        intensity: float32, (world, 3).

    Raises:
        RefusedError: A file is larger than the limits.
        WarpcamError: An argument cannot be used.
    """

    def __init__(
        self,
        scene: Scene,
        images: Any,
        *,
        index: Any = 0,
        yaw: Any = 0.0,
        rotation: Any = (1.0, 0.0, 0.0, 0.0),
        intensity: Any = 1.0,
        limits: Limits | None = None,
        extract_sun: bool = True,
    ):
        where = "Environments"
        if not isinstance(scene, Scene):
            raise WarpcamError(f"{where}: scene must be made by from_usd or the like, got {type(scene).__name__}")
        if not isinstance(limits, Limits | None):
            raise WarpcamError(f"{where}: limits must be a warpcam.Limits or None, got {type(limits).__name__}")
        if not isinstance(extract_sun, bool | np.bool_):
            raise WarpcamError(f"{where}: extract_sun must be True or False, got {extract_sun!r}")
        worlds = scene.num_worlds
        several = _several(images)
        light = [_image(each, number, limits) for number, each in enumerate(several)]
        rotation = per_world(rotation, f"{where}: rotation", worlds, (4,))
        if not (np.linalg.norm(rotation, axis=1) > 0.0).all():
            raise WarpcamError(f"{where}: rotation must not be 0, got {rotation!r}")
        factors = _factors(intensity, worlds)
        if factors.min() < 0.0:
            raise WarpcamError(f"{where}: intensity must not be negative, got {intensity!r}")
        device = scene.device
        data = {
            "index": (_indices(index, len(light), worlds), wp.int32),
            "yaw": (per_world(yaw, f"{where}: yaw", worlds, ()), wp.float32),
            "rotation": (rotation, wp.vec4),
            "intensity": (factors, wp.vec3),
        }
        arrays = {
            name: wp.array(np.ascontiguousarray(value), dtype=dtype, device=device)
            for name, (value, dtype) in data.items()
        }
        ranges = {"intensity": (0.0, math.inf), "index": (-1.0, float(len(light) - 1))}
        super().__init__(where, arrays, worlds, device, ranges)
        self._scene, self._light = scene, light
        self._suns = [sun_of_panorama(each) if extract_sun else None for each in light]
        diffuse = [each if sun is None else without_sun(each, sun) for each, sun in zip(light, self._suns, strict=True)]
        placed: Any = PlacedEnvironments()
        for name, array in arrays.items():
            setattr(placed, name, array)
        placed.terms = wp.array(np.stack([_terms(each) for each in diffuse]), dtype=wp.vec3, device=device)
        self._rows = wp.zeros((worlds, ROWS), dtype=wp.vec4, device=device)
        self._sky = wp.zeros((worlds, SKY_TERMS + 1), dtype=wp.vec3, device=device)
        self._stage = bind_environments(placed, self._rows, self._sky, device)
        self._maps: dict[bool, Any] = {}

    @staticmethod
    def sky(
        sun_direction: Any, turbidity: float = 3.0, *, albedo: float = 0.2, sun: bool = True, height: int = 512
    ) -> np.ndarray:
        """Make an image of a clear sky and its sun by closed formulas, to be given as one of ``images``.

        The sky is that of Preetham, Shirley and Smits, A Practical Analytic Model for Daylight (1999); the sun is a
        disk of 0.53 degrees, or of a texel where that is wider, dimmed by air and aerosols as there. Below the horizon
        is even, matt ground. A luminance of 30,000 cd/m^2 is 1: a white surface under a clear noon shows about that.

        Args:
            sun_direction: To the sun, (3,), in the image's axes: +z is up; the world's, where nothing turns the image.
            turbidity: Haze of the air, from 2, clear, to 10.
            albedo: Share of light that the ground reflects, in [0, 1].
            sun: False leaves the sun out, also of the light on the ground, for a light of the scene to be it.
            height: Rows of the image, from 8 to 4,096.

        Returns:
            Linear radiance, Rec. 709, (height, 2 height, 3) float32.

        Raises:
            WarpcamError: An argument cannot be used; the sun must be above the horizon.
        """
        return sky_image(sun_direction, turbidity, albedo, sun, height)

    def scene(self) -> Scene:
        """The scene that it lights."""
        return self._scene

    def stage(self) -> Stage:
        """The stage at a frame's head that reads the arrays."""
        return self._stage

    def tables(self, paths: bool) -> tuple[Any, wp.array]:
        """Return EnvironmentMaps and the terms of each world's sky, Physical.sky; ``paths``: what paths of light read.

        Both looks have what they read of the images in the device's memory from the first renderer of such a look on.
        """
        if paths not in self._maps:
            self._maps[paths] = self._for_paths() if paths else self._for_real_time()
        return self._maps[paths], self._sky

    def has_suns(self) -> bool:
        """Whether some image has a sun that is a light of its own in the real-time look."""
        return any(sun is not None for sun in self._suns)

    def with_suns(self, physical: Any) -> tuple[Any, Stage]:
        """Return Physical with the suns before its lights, and the stage that places them, after ``stage()``."""
        lit = with_suns(physical, self._scene.num_worlds, self._device)
        suns = [(each.direction, each.color, each.sine_squared) if each else NO_SUN for each in self._suns]
        directions, colors, sizes = (np.array(part, np.float32) for part in zip(*suns, strict=True))
        placed = make_suns(directions, colors, sizes, self._device)
        return lit, bind_suns(physical, placed, self._rows, lit, self._device)

    def _for_paths(self) -> Any:
        texels, sums, layouts, start, first = [], [], [], 0, 0
        for light in self._light:
            height, width = light.shape[:2]
            layout = np.zeros(maps.NUMBERS, np.int32)
            layout[:4] = start, width, height, first
            layouts.append(layout)
            texels.append(_rows_of_four(light))
            sums.append(_sums(light))
            start, first = start + height * width, first + len(sums[-1])
        _check_size(start)
        return self._struct(np.concatenate(texels), layouts, np.concatenate(sums))

    def _for_real_time(self) -> Any:
        layouts, start = [], 0
        for light, sun in zip(self._light, self._suns, strict=True):
            layout = np.zeros(maps.NUMBERS, np.int32)
            layout[maps.SIDE :], start = maps.lay_out(maps.map_side(light.shape[0]), start)
            if sun is not None:
                layout[maps.SUN :] = np.array((*sun.direction, sun.cosine, sun.limit), np.float32).view(np.int32)
            layouts.append(layout)
        _check_size(start)
        struct = self._struct(np.zeros((start, 4), np.float32), layouts, np.zeros(0, np.float32))
        for image, (light, sun) in enumerate(zip(self._light, self._suns, strict=True)):
            target = light.shape[:2], struct.texels, struct.layouts, image, self._device
            if sun is not None:
                maps.build_environment_maps(self._texels(without_sun(light, sun)), *target)
            maps.build_environment_maps(self._texels(light), *target, lobes=sun is None)
        return struct

    def _texels(self, light: np.ndarray) -> wp.array:
        return wp.array(_rows_of_four(light), dtype=wp.vec4, device=self._device)

    def _struct(self, texels: np.ndarray, layouts: list[np.ndarray], sums: np.ndarray) -> Any:
        struct: Any = EnvironmentMaps()
        struct.texels = wp.array(texels, dtype=wp.vec4, device=self._device)
        struct.layouts = wp.array(np.concatenate(layouts), dtype=wp.int32, device=self._device)
        struct.sums = wp.array(sums, dtype=wp.float32, device=self._device)
        struct.rows = self._rows
        return struct


def _several(images: Any) -> Sequence[Any]:
    """Images, of which one may have come alone."""
    try:
        alone = isinstance(images, str | Path) or np.ndim(images) == 3
    except (TypeError, ValueError):  # images of several sizes, or on a GPU
        alone = False
    several = [images] if alone else images
    if not isinstance(several, Sequence) or not several:
        raise WarpcamError(
            "Environments: images must be a file, an array (height, width, 3) or a sequence of these, got "
            f"{type(images).__name__}"
        )
    return several


def _image(given: Any, number: int, limits: Limits | None) -> np.ndarray:
    """Linear radiance, (height, width, 3) float32."""
    where = f"Environments: images[{number}]"
    if isinstance(given, str | Path):
        return read_light(given, limits, where)
    light = as_numbers(given, where, "a file or floats, (height, width, 3)")
    if light.ndim != 3 or light.shape[2] != 3 or not light.size or light.dtype.kind != "f":
        raise WarpcamError(
            f"{where} must be a file or floats, (height, width, 3), linear; got {light.dtype} of {light.shape}"
        )
    with np.errstate(over="ignore"):
        light = np.ascontiguousarray(light, np.float32)
    if not (np.isfinite(light).all() and light.min() >= 0.0):
        raise WarpcamError(f"{where} must be finite and at least 0, got {light.min()} to {light.max()}")
    return light


def _factors(intensity: Any, worlds: int) -> np.ndarray:
    """Of red, green and blue in each world, (world, 3)."""
    where = "Environments: intensity"
    factors = as_numbers(intensity, where)
    if factors.ndim == 0 or (factors.shape == (worlds,) and worlds != 3):
        factors = factors[..., None].repeat(3, axis=-1)
    if factors.shape not in ((3,), (worlds, 3)):
        allowed = dict.fromkeys(("one number", (3,), (worlds,), (worlds, 3)))
        raise WarpcamError(f"{where} must have shape {', '.join(map(str, allowed))}, got {intensity!r}")
    return per_world(factors, where, worlds, (3,))


def _indices(value: Any, images: int, worlds: int) -> np.ndarray:
    """The image of each world, (world,) int32."""
    allowed = f"whole numbers from -1 to {images - 1}, one or {(worlds,)}"
    numbers = as_numbers(value, "Environments: index", allowed)
    whole = numbers.dtype.kind in "iu" and numbers.shape in ((), (worlds,))
    if not whole or numbers.min() < -1 or numbers.max() >= images:
        raise WarpcamError(f"Environments: index must be {allowed}, got {value!r}")
    return np.broadcast_to(numbers, worlds).astype(np.int32)


def _check_size(texels: int) -> None:
    if texels > MOST_TEXELS:
        raise WarpcamError(
            f"Environments: images have {texels:,} texels with their maps, at most {MOST_TEXELS:,} are allowed"
        )


def _terms(light: np.ndarray) -> np.ndarray:
    """Terms of the sky in the image's axes, (SKY_TERMS, 3)."""
    return sky_of_panorama(light, AXES)


def _rows_of_four(light: np.ndarray) -> np.ndarray:
    """Texels as the kernels read them, (texel, 4)."""
    return np.concatenate((light, np.zeros((*light.shape[:2], 1), np.float32)), axis=2).reshape(-1, 4)


def _sums(light: np.ndarray) -> np.ndarray:
    """Sums of shares of rows and of their texels, as native/path/environment_cells.h reads them, flat float32.

    A texel's share is its luminance, interpolated as paths see it, times its solid angle: the mean of the interpolation
    over a texel is 1/8, 6/8 and 1/8 of three neighbours along each axis.
    """
    height = len(light)
    bright = light.astype(np.float64) @ (0.2126, 0.7152, 0.0722)
    bright = 0.125 * np.roll(bright, 1, axis=1) + 0.75 * bright + 0.125 * np.roll(bright, -1, axis=1)
    padded = np.pad(bright, ((1, 1), (0, 0)), mode="edge")
    bright = 0.125 * padded[:-2] + 0.75 * padded[1:-1] + 0.125 * padded[2:]
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    rows = bright.sum(axis=1) * (edges[:-1] - edges[1:])
    rows = rows if rows.sum() > 0.0 else edges[:-1] - edges[1:]
    texels = np.where(bright.sum(axis=1, keepdims=True) > 0.0, bright, 1.0)
    parts = [_from_0_to_1(rows[None]).ravel(), _from_0_to_1(texels).ravel()]
    return np.concatenate(parts).astype(np.float32)


def _from_0_to_1(shares: np.ndarray) -> np.ndarray:
    """Sums along the last axis, 0 first and 1 last."""
    sums = np.concatenate((np.zeros((len(shares), 1)), np.cumsum(shares, axis=1)), axis=1)
    return sums / sums[:, -1:]
