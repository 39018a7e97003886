"""Gaussian splats that a user gives a scene: clouds, where they are, and which of them each world begins with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from warpcam.accel.gaussians import MIN_ALPHA, GaussianCloud
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, Limits
from warpcam.core.torch_interop import require_wxyz, to_numpy
from warpcam.sources.common.gaussian_cloud import MIN_RESPONSE
from warpcam.sources.common.splat_files import read_cloud_file

REQUIRED = ("positions", "scales", "colors")
OPTIONAL = ("rotations", "opacities", "harmonics")


@dataclass(frozen=True, eq=False)
class Splats:
    """Clouds of Gaussians of which each world has one, fixed to a body.

    Attributes:
        clouds: One or a sequence of: the path of a .ply file as training of splats writes it; or a mapping with arrays
            of Gaussians: ``positions`` (n, 3), centres [m]; ``scales`` (n, 3), standard deviations along the axes [m];
            ``colors`` (n, 3), display colours; ``rotations`` (n, 4), quaternions w x y z, without them none is rotated;
            ``opacities`` (n,) in [0, 1], without them 1; ``harmonics`` (n, 3, 8 or 15, 3), coefficients of spherical
            harmonics of degrees 1, 2 and 3, which add to ``colors`` by the direction of the ray in the clouds' frame.
        body: Name or index of the body that the clouds move with; None is the world.
        position: (3,) of the clouds' origin in the body's frame [m].
        rotation: (4,) quaternion w x y z from the clouds' frame to the body's.
        scale: Factor of the clouds' size, or one for each of their axes (3,); above 0.
        choice: Cloud that each world begins with, (world,) int, -1 for none; one number is for all worlds. None is the
            first cloud. ``scene.vary("splat_choice")`` changes it.
        limits: Sizes of files that are refused; None is ``Limits()``.

    Raises:
        WarpcamError: An argument cannot be used. Files are read, and arrays checked, when a scene is made.
    """

    clouds: Any
    body: str | int | None = None
    position: Any = (0.0, 0.0, 0.0)
    rotation: Any = (1.0, 0.0, 0.0, 0.0)
    scale: Any = 1.0
    choice: Any = None
    limits: Limits | None = None

    least_response: ClassVar[float] = MIN_RESPONSE
    least_alpha: ClassVar[float] = MIN_ALPHA
    opaque: ClassVar[bool] = False  # see SceneDescription.opaque_splats
    changes: ClassVar[bool] = False  # see GaussianCloud

    def __post_init__(self) -> None:
        for cloud in self.listed():
            if not isinstance(cloud, str | Path | Mapping):
                raise WarpcamError(
                    "Splats: clouds must be paths of .ply files or mappings with arrays, or a sequence of these, got "
                    f"{type(cloud).__name__}"
                )
        if not self.listed():
            raise WarpcamError("Splats: clouds is empty; at least one is needed")
        _numbers("position", self.position, (3,))
        require_wxyz(self.rotation, "Splats: rotation")
        if not np.linalg.norm(_numbers("rotation", self.rotation, (4,))) > 0.0:
            raise WarpcamError(f"Splats: rotation must be a quaternion of any length but 0, got {self.rotation!r}")
        if not (self.scales() > 0.0).all():
            raise WarpcamError(f"Splats: scale must be above 0, got {self.scale!r}")
        if self.body is not None and (isinstance(self.body, bool) or not isinstance(self.body, str | int | np.integer)):
            raise WarpcamError(f"Splats: body must be a name, an index or None, got {self.body!r}")

    def listed(self) -> list[Any]:
        """The clouds as a list."""
        several = isinstance(self.clouds, Sequence) and not isinstance(self.clouds, str)
        return list(self.clouds) if several else [self.clouds]

    def scales(self) -> np.ndarray:
        """Factors along the clouds' axes, (3,)."""
        return np.broadcast_to(_numbers("scale", self.scale, (), (3,)), (3,))

    def choices(self, num_worlds: int) -> np.ndarray:
        """Cloud that each world begins with, (world,) int32."""
        try:
            values = to_numpy(0 if self.choice is None else self.choice)
        except (TypeError, ValueError, RuntimeError):
            values = np.zeros(0)
        if values.dtype.kind not in "iu" or values.shape not in ((), (num_worlds,)):
            came = f"{values.dtype} {values.shape}" if values.size else repr(self.choice)
            raise WarpcamError(
                f"Splats: choice must be a whole number or one for each of {num_worlds} worlds, got {came}"
            )
        most = len(self.listed()) - 1
        wrong = (values < -1) | (values > most)
        if wrong.any():
            raise WarpcamError(
                f"Splats: choice has {int(values[wrong].flat[0])}; allowed are -1 for none and 0 to {most}"
            )
        return np.broadcast_to(values, (num_worlds,)).astype(np.int32)

    def read(self) -> list[GaussianCloud]:
        """The clouds; files are opened here."""
        return [
            self._cloud_of(f"clouds[{place}]", cloud)
            if isinstance(cloud, Mapping)
            else read_cloud_file(Path(cloud), FileAccess(Path(cloud), limits=self.limits, where="Splats"))
            for place, cloud in enumerate(self.listed())
        ]

    def _cloud_of(self, name: str, arrays: Mapping[str, Any]) -> GaussianCloud:
        read = _arrays_of(name, arrays)
        return GaussianCloud(
            name=name,
            positions=read["positions"],
            rotations=read["rotations"],
            scales=read["scales"],
            opacities=read["opacities"],
            colors=read["colors"],
            least_response=self.least_response,
            least_alpha=self.least_alpha,
            harmonics=read.get("harmonics"),
            changes=self.changes,
        )


def check_splats(splats: Any) -> list[Splats]:
    """The argument ``splats`` of the functions that make a scene, as a list."""
    listed = [] if splats is None else list(splats) if isinstance(splats, Sequence) else [splats]
    for each in listed:
        if not isinstance(each, Splats):
            raise WarpcamError(
                f"splats must be a warpcam.Splats, a sequence of them or None, got {type(each).__name__}"
            )
    return listed


def _arrays_of(name: str, arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The arrays of a cloud, float32, with those that were left out."""
    unknown = [key for key in arrays if key not in (*REQUIRED, *OPTIONAL)]
    missing = [key for key in REQUIRED if key not in arrays]
    if unknown or missing:
        raise WarpcamError(
            f"splats '{name}': {', '.join(map(repr, unknown or missing))} {'came' if unknown else 'is missing'}; "
            f"needed are {', '.join(REQUIRED)}, allowed beside them {', '.join(OPTIONAL)}"
        )
    if "rotations" in arrays:
        require_wxyz(arrays["rotations"], f"splats '{name}': rotations")
    read = {key: _floats(name, key, values) for key, values in arrays.items()}
    if not read["positions"].ndim:
        raise WarpcamError(f"splats '{name}': positions must have shape (n, 3), got ()")
    count = len(read["positions"])
    read.setdefault("rotations", np.tile(np.array((1.0, 0.0, 0.0, 0.0), np.float32), (count, 1)))
    read.setdefault("opacities", np.ones(count, np.float32))
    opacities = read["opacities"]
    if not ((opacities >= 0.0) & (opacities <= 1.0)).all():
        raise WarpcamError(f"splats '{name}': opacities must be in [0, 1]")
    if not (read["scales"] >= 0.0).all():
        raise WarpcamError(f"splats '{name}': scales must not be below 0")
    return read


def _floats(name: str, key: str, values: Any) -> np.ndarray:
    try:
        with np.errstate(over="ignore"):  # what float32 cannot hold is not finite
            return np.array(to_numpy(values), np.float32)
    except (TypeError, ValueError, RuntimeError):
        raise WarpcamError(f"splats '{name}': {key} must be an array of numbers, got {type(values).__name__}") from None


def _numbers(name: str, value: Any, *shapes: tuple[int, ...]) -> np.ndarray:
    try:
        with np.errstate(over="ignore"):
            numbers = to_numpy(value).astype(np.float32)
    except (TypeError, ValueError, RuntimeError):
        numbers = np.full(0, np.nan)
    if numbers.shape not in shapes or not np.isfinite(numbers).all():
        allowed = " or ".join(f"{shape[0]} finite numbers" if shape else "a finite number" for shape in shapes)
        raise WarpcamError(f"Splats: {name} must be {allowed}, got {value!r}")
    return numbers
