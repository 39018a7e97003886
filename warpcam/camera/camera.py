"""Cameras: what the user asks for."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal, get_args

import numpy as np

from warpcam.camera.film import AutoExposure, Bloom
from warpcam.camera.lens import Lens
from warpcam.camera.lens_tables import RayTableLens, check_table_size
from warpcam.camera.outputs import check_outputs
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.passes.antialiasing import SAMPLES
from warpcam.kernels.plan.request import SUPERSAMPLING

DepthClipping = Literal["none", "max", "zero"]
ToneMapping = Literal["clip", "reinhard", "aces", "khronos_neutral", "agx"]


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera, in every world.

    With ``position``, ``rotation`` or ``parent`` it is one of your own, by any name; without, the scene's camera of
    that name or index. It looks along -z, with +y up and +x right. Whatever may be given for each world has a leading
    dimension (world,), as numpy, torch or Warp array; ``renderer.camera(name)`` gives the arrays to write later.

    Attributes:
        name: Name or index of the scene's camera, or the name of your own. Its images carry it as their key.
        width: Of the image [pixels].
        height: Of the image [pixels].
        outputs: What to render: names in ``warpcam.outputs.OUTPUTS``.
        lens: In place of the scene camera's own lens; a camera of your own needs one.
        position: (3,) or (world, 3), in the parent's frame [m]; the parent's origin unless given.
        rotation: Quaternion, w x y z, (4,) or (world, 4), in the parent's frame; of any length but 0.
        parent: Name or index of the body to which a camera of your own is fixed; None is the world.
        near: Nothing nearer than this is seen: planar depth, at least 0 [m]; a number or (world,). None is the scene
            camera's, or 0. With Fisheye, Distorted and Rays it and ``far`` are distances along the ray.
        far: Nothing there or farther is seen: planar depth, beyond ``near`` [m]; a number or (world,). None is the
            scene camera's, or infinity.
        depth_clipping: What ``depth`` shows where nothing is hit: inf ("none"), ``far`` ("max") or 0 ("zero").
        shadows: Whether the scene's lights cast shadows in ``rgb``, ``rgba`` and ``hdr``.
        antialiasing: Samples of a pixel that an edge runs through: 1, or 4 as ``mujoco.Renderer`` has it, or 8, 16 or
            64, for shapes thinner than a pixel: 2, 4 or 16 parts of each pixel are drawn. It smooths ``rgb``, ``rgba``
            and ``hdr``; all other outputs are those of the pixel's centre.
        background: Display colour in [0, 1] where nothing is hit, (3,) or (world, 3); None is the scene's own: its
            skybox, else black.
        exposure: All light is multiplied by 2 to this in ``rgb``, ``rgba`` and ``hdr``: a number or (world,), at
            most 127.
        gain: All light is multiplied by this, too: a number, (3,) for red, green and blue, or (world, 3).
        tone_mapping: Curve from light to ``rgb`` and ``rgba`` in the looks "pbr" and "path", before sRGB: "clip" cuts
            light off at white; "reinhard", "aces", "khronos_neutral" and "agx" show brighter light as less than white.
            MuJoCo's look and scenes with clouds of Gaussians have "clip" alone.
        auto_exposure: ``AutoExposure`` for the looks "pbr" and "path": each world's light sets its exposure, to which
            ``exposure`` is added; None has ``exposure`` alone.
        bloom: ``Bloom`` for these looks, of light before the curve, in ``hdr``, too; None scatters no light.
        exclude_bodies: Bodies whose shapes the camera does not see, as its own housing: a name or an index, or several.
            Their shapes cast shadows nevertheless.
    """

    name: str | int
    _: KW_ONLY
    width: int
    height: int
    outputs: Sequence[str] = ("rgb",)
    lens: Lens | None = None
    position: Any = None
    rotation: Any = None
    parent: str | int | None = None
    near: Any = None
    far: Any = None
    depth_clipping: DepthClipping = "none"
    shadows: bool = False
    antialiasing: int = 1
    background: Any = None
    exposure: Any = None
    gain: Any = None
    tone_mapping: ToneMapping = "clip"
    auto_exposure: AutoExposure | None = None
    bloom: Bloom | None = None
    exclude_bodies: Any = ()

    def __post_init__(self) -> None:
        if isinstance(self.name, bool) or not isinstance(self.name, str | int | np.integer) or self.name == "":
            raise WarpcamError(f"Camera: name must be a camera's name or index, got {self.name!r}")
        if not isinstance(self.name, str):
            object.__setattr__(self, "name", int(self.name))
        object.__setattr__(self, "width", self._pixels("width"))
        object.__setattr__(self, "height", self._pixels("height"))
        object.__setattr__(self, "outputs", check_outputs(self.outputs, self.where))
        if self.lens is not None and not isinstance(self.lens, Lens):
            raise WarpcamError(
                f"{self.where}: lens must be a lens, such as Pinhole or Fisheye, or None, got {self.lens!r}"
            )
        if self.is_own and self.lens is None:
            raise WarpcamError(
                f"{self.where}: position, rotation or parent make it a camera of your own, which needs a lens: "
                "Pinhole(...), Orthographic(...), Fisheye(...), Distorted(...) or Rays(...)"
            )
        flows = [name for name in self.outputs if name in ("flow", "flow_valid")]
        if flows and isinstance(self.lens, RayTableLens):
            raise WarpcamError(
                f"{self.where}: outputs has {flows[0]!r}, which no lens that is a table of rays has "
                f"({type(self.lens).__name__}); Pinhole and Orthographic have it"
            )
        for name, choices in (("depth_clipping", get_args(DepthClipping)), ("tone_mapping", get_args(ToneMapping))):
            if not isinstance(value := getattr(self, name), str) or value not in choices:
                allowed = ", ".join(map(repr, choices))
                raise WarpcamError(f"{self.where}: {name} is {value!r}; allowed are {allowed}")
        if not isinstance(self.shadows, bool | np.bool_):
            raise WarpcamError(f"{self.where}: shadows must be True or False, got {self.shadows!r}")
        for name, kind in (("auto_exposure", AutoExposure), ("bloom", Bloom)):
            if (value := getattr(self, name)) is not None and not isinstance(value, kind):
                raise WarpcamError(f"{self.where}: {name} must be {kind.__name__}(...) or None, got {value!r}")
        object.__setattr__(self, "antialiasing", self._samples())
        across, down = SUPERSAMPLING.get(self.antialiasing, (1, 1))
        check_table_size(self.lens, across * self.width, down * self.height, self.where)
        self._check_background()
        object.__setattr__(self, "exclude_bodies", self._excluded())

    @property
    def is_own(self) -> bool:
        """True for a camera of the user's own, False for one of the scene's."""
        return self.position is not None or self.rotation is not None or self.parent is not None

    @property
    def has_exposure(self) -> bool:
        """True where all light is multiplied by an exposure and a gain, which have arrays."""
        return self.exposure is not None or self.gain is not None or self.needs_film

    @property
    def needs_film(self) -> bool:
        """True where what is shown depends on the light of the whole image."""
        return self.auto_exposure is not None or self.bloom is not None

    @property
    def where(self) -> str:
        """Prefix of error messages about this camera."""
        return f"Camera({self.name!r})"

    def _pixels(self, name: str) -> int:
        value = getattr(self, name)
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
            raise WarpcamError(f"{self.where}: {name} must be a whole number of pixels, at least 1, got {value!r}")
        return int(value)

    def _samples(self) -> int:
        is_whole = isinstance(self.antialiasing, int | np.integer) and not isinstance(self.antialiasing, bool)
        finer = () if isinstance(self.lens, RayTableLens) and not self.lens.has_parts else (*SUPERSAMPLING,)
        if not is_whole or self.antialiasing not in (1, *SAMPLES, *finer):
            allowed = ", ".join(map(str, (1, *SAMPLES, *finer)))
            why = "" if finer else f" with {type(self.lens).__name__}, which has a ray for each pixel"
            raise WarpcamError(f"{self.where}: antialiasing is {self.antialiasing!r}; allowed are {allowed}{why}")
        return int(self.antialiasing)

    def _excluded(self) -> tuple[str | int, ...]:
        return bodies_of(self.exclude_bodies, f"{self.where}: exclude_bodies")

    def _check_background(self) -> None:
        if self.background is None:
            return
        try:
            color = np.asarray(torch_interop.to_numpy(self.background)).astype(np.float64, casting="same_kind")
        except (TypeError, ValueError, RuntimeError):
            color = np.zeros(0)
        if color.shape[-1:] != (3,) or color.ndim > 2 or not ((color >= 0.0) & (color <= 1.0)).all():
            raise WarpcamError(
                f"{self.where}: background must be red, green and blue in [0, 1], or None, got {self.background!r}"
            )
        one = tuple(float(channel) for channel in color) if color.ndim == 1 else color
        object.__setattr__(self, "background", one)


def bodies_of(bodies: Any, where: str) -> tuple[str | int, ...]:
    """Names or indices of bodies, of one or several.

    Raises:
        WarpcamError: They are none; the text begins with ``where``.
    """
    several = (bodies,) if isinstance(bodies, str | int | np.integer) else bodies
    if not isinstance(several, Sequence) or not all(
        isinstance(body, str | int | np.integer) and not isinstance(body, bool) for body in several
    ):
        raise WarpcamError(f"{where} must be a body's name or index, or a sequence of these, got {bodies!r}")
    return tuple(several)
