"""Camera models: the effects of one product, and the image that they belong to."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Pinhole
from warpcam.core.errors import WarpcamError
from warpcam.sensors.effect import Effect


@dataclass(frozen=True, eq=False)
class CameraModel(Sequence[Effect]):
    """Effects of a camera, in their order, with its image and its range.

    It may be given to ``Rig`` as any list of effects, and ``camera`` makes the camera that belongs to it::

        model = sensors.realsense_d435()
        camera = model.camera("wrist", parent="hand", position=(0, 0, 0.05), rotation=(1, 0, 0, 0))
        rig = sensors.Rig(wc.Renderer(scene, [camera]), {"wrist": model})

    Attributes:
        name: Of the product.
        effects: From a rendered image to a measured one.
        width: Of the sensor's image [pixels].
        height: Of the sensor's image [pixels].
        fx: Focal length across [pixels of the sensor].
        fy: Focal length down [pixels of the sensor].
        frame_rate: Highest frame rate at that size [Hz].
        near: Least depth that is measured [m].
        far: Greatest depth that is measured [m].

    Raises:
        WarpcamError: A value is not of its kind, or not positive; near is not below far.
    """

    name: str
    effects: tuple[Effect, ...]
    width: int
    height: int
    fx: float
    fy: float
    frame_rate: float
    near: float
    far: float

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise WarpcamError(f"CameraModel: name must be the name of a product, got {self.name!r}")
        where = f"CameraModel({self.name!r})"
        effects = tuple(self.effects) if isinstance(self.effects, Sequence) else (self.effects,)
        for effect in effects:
            if not isinstance(effect, Effect):
                raise WarpcamError(f"{where}: effects of warpcam.sensors are allowed, got {effect!r}")
        object.__setattr__(self, "effects", effects)
        for name in ("width", "height"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
                raise WarpcamError(f"{where}: {name} must be a whole number of pixels, at least 1, got {value!r}")
        for name in ("fx", "fy", "frame_rate", "near", "far"):
            value = getattr(self, name)
            number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
            if not number or not 0.0 < value < math.inf:
                raise WarpcamError(f"{where}: {name} must be a positive number, got {value!r}")
        if self.near >= self.far:
            raise WarpcamError(f"{where}: near must be below far, got near {self.near} and far {self.far}")

    @overload
    def __getitem__(self, index: int) -> Effect: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Effect, ...]: ...
    def __getitem__(self, index: int | slice) -> Effect | tuple[Effect, ...]:
        return self.effects[index]

    def __len__(self) -> int:
        return len(self.effects)

    @property
    def fovx(self) -> float:
        """Horizontal field of view [degrees]."""
        return 2.0 * math.degrees(math.atan(0.5 * self.width / self.fx))

    @property
    def fovy(self) -> float:
        """Vertical field of view [degrees]."""
        return 2.0 * math.degrees(math.atan(0.5 * self.height / self.fy))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs of the renderer that the effects need, each once."""
        changed = ["depth" if effect.kind == "depth" else "rgb" for effect in self.effects if effect.kind != "delivery"]
        return tuple(dict.fromkeys([*changed, *(name for effect in self.effects for name in effect.reads)]))

    def with_effects(self, *effects: Effect) -> "CameraModel":
        """Return a model that has other effects and is the same product in all else."""
        return dataclasses.replace(self, effects=tuple(effects))

    def camera(
        self,
        name: str | int,
        *,
        outputs: Sequence[str] = ("depth",),
        width: int | None = None,
        height: int | None = None,
        **options: Any,
    ) -> Camera:
        """Make a camera with the model's lens, image and needed outputs.

        Args:
            name: As of ``Camera``: one of the scene's, whose pose it has, or, with ``parent``, ``position`` or
                ``rotation``, one of your own.
            outputs: Outputs that are wanted beside those that the effects need.
            width: Of the image [pixels]; the sensor's unless given. The field of view stays, so an image of another
                size is one of larger or smaller pixels. Noise stays that of the sensor's pixels.
            height: Of the image [pixels]; the sensor's unless given.
            options: Further arguments of ``Camera``: ``parent``, ``position`` [m], ``rotation`` (w x y z), ``near``,
                ...

        Raises:
            WarpcamError: An argument is not allowed; ``lens`` is the model's.
        """
        where = f"{self.name}: camera {name!r}"
        if "lens" in options:
            raise WarpcamError(f"{where}: lens is the model's own, and may not be given; got {options['lens']!r}")
        if isinstance(outputs, str):
            raise WarpcamError(f"{where}: outputs must be a list of names, got {outputs!r}")
        plain = Camera(
            name,
            width=self.width if width is None else width,
            height=self.height if height is None else height,
            outputs=tuple(dict.fromkeys([*outputs, *self.outputs])),
            lens=Pinhole(fx=1.0),
            **options,
        )
        lens = Pinhole(fx=self.fx * plain.width / self.width, fy=self.fy * plain.height / self.height)
        return dataclasses.replace(plain, lens=lens)


def focal_length(pixels: int, field_of_view: float) -> float:
    """Focal length [pixels] of an image that spans an angle [degrees]."""
    return 0.5 * pixels / math.tan(math.radians(0.5 * field_of_view))
