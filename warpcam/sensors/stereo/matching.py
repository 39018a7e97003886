"""Settings of stereo matching."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.sensors.kernels.stereo_matching import MAX_DISPARITIES, Matcher

MAX_CENSUS_BITS = 31
MAX_COST = 2**15  # of all paths together, as sums have 16 bits
DISPARITY_STEP = 16
PATHS = (4, 8)
MEDIANS = (1, 3, 5, 7)

Subpixel = Literal["parabola", "equiangular"]


@dataclass(frozen=True)
class StereoMatching:
    """Semi-global matching of census words. Values are SAPIEN's, of ``StereoDepthSensorConfig``, but for ``contrast``.

    A pixel's word has a bit for each pair of pixels that face each other across the middle of a window around it: is
    the first as bright as the second? (Center-symmetric census: Spangenberg et al., "Weighted Semi-Global Matching and
    Center-Symmetric Census Transform for Robust Driver Assistance", 2013.) The cost of a disparity is the Hamming
    distance of two words, added up over a block of pixels. Costs are added up along straight paths, with a penalty for
    each change of disparity (Hirschmueller, "Stereo Processing by Semiglobal Matching and Mutual Information", 2008).
    The disparity of least cost counts, between whole numbers that of a curve through three costs, unless

    - no pair of the pixel's window differs by ``contrast``: it would take over what is around it,
    - another, not next to it, costs nearly as little (``uniqueness``),
    - the right image has a different one for the pixel that it leads to (``max_difference``).

    A median filter comes last. Costs take 4 bytes for each pixel and disparity: see ``StereoCamera``.

    Attributes:
        max_disparity: Number of disparities, from 0 on: a multiple of 16, from 16 to 256 [pixels]. Nothing nearer than
            focal length times baseline over this is measured.
        census: Width and height of the census window, odd; at most 63 pixels together.
        block: Width and height of blocks, odd.
        p1: Penalty for a change of disparity by 1, for each pixel of a block [bits].
        p2: Penalty for a larger change, more than ``p1`` [bits].
        paths: 4, along rows and columns, as SAPIEN has it; or 8, along diagonals, too.
        contrast: Least difference of a pair of pixels of the census window that makes a pixel count, from 0, which
            all have and SAPIEN asks for, to 255 [levels].
        uniqueness: By how much the least cost must be below that of any other disparity that is not next to it, from 0
            to 99 [% of that cost]; 0 allows all.
        subpixel: "parabola" through three costs, as SAPIEN has it; or "equiangular", two lines of opposite slopes, as
            Hamming distances are more alike (Shimizu and Okutomi, "Sub-Pixel Estimation Error Cancellation on
            Area-Based Matching", 2005): disparities are drawn less to whole numbers.
        max_difference: Greatest difference between the disparities of both images [pixels]; None: any.
        median: Side of the median filter, 1 (none), 3, 5 or 7 [pixels].

    Raises:
        WarpcamError: A value is not allowed.
    """

    max_disparity: int = 128
    census: tuple[int, int] = (7, 7)
    block: tuple[int, int] = (7, 7)
    p1: int = 8
    p2: int = 32
    paths: int = 4
    contrast: int = 2
    uniqueness: int = 15
    subpixel: Subpixel = "parabola"
    max_difference: int | None = 1
    median: int = 3

    def __post_init__(self) -> None:
        largest = f"a multiple of {DISPARITY_STEP} from {DISPARITY_STEP} to {MAX_DISPARITIES}"
        disparities = self._whole("max_disparity", largest, DISPARITY_STEP, MAX_DISPARITIES)
        if disparities % DISPARITY_STEP:
            raise WarpcamError(f"StereoMatching: max_disparity must be {largest}, got {disparities}")
        self._window("census")
        self._window("block")
        if not 1 <= self.bits <= MAX_CENSUS_BITS:
            raise WarpcamError(f"StereoMatching: census must have from 3 to 63 pixels, got {self.census!r}")
        self._whole("p1", "a whole number of at least 1", 1)
        self._whole("p2", f"a whole number above p1, which is {self.p1}", self.p1 + 1)
        self._choice("paths", PATHS)
        self._whole("contrast", "a whole number from 0 to 255", 0, 255)
        self._whole("uniqueness", "a whole number from 0 to 99", 0, 99)
        if not isinstance(self.subpixel, str) or self.subpixel not in get_args(Subpixel):
            allowed = " or ".join(map(repr, get_args(Subpixel)))
            raise WarpcamError(f"StereoMatching: subpixel must be {allowed}, got {self.subpixel!r}")
        if self.max_difference is not None:
            self._whole("max_difference", "a whole number of at least 0, or None", 0)
        self._choice("median", MEDIANS)
        cost = self.paths * self.block[0] * self.block[1] * (self.bits + self.p2)
        if cost >= MAX_COST:
            raise WarpcamError(
                f"StereoMatching: paths * pixels of a block * (bits of a census word + p2) must be below {MAX_COST}, "
                f"got {self.paths} * {self.block[0] * self.block[1]} * ({self.bits} + {self.p2}) = {cost}"
            )

    @property
    def bits(self) -> int:
        """Bits of a census word."""
        return (self.census[0] * self.census[1] - 1) // 2

    def bytes_per_world(self, width: int, height: int) -> int:
        """Memory that matching takes for each world that is matched at the same time [bytes]."""
        return width * height * (4 * self.max_disparity + 2 * 4 + 3 * 4)

    def matcher(self, width: int, height: int) -> Matcher:
        """The struct for kernels, without its arrays."""
        matcher, area = Matcher(), self.block[0] * self.block[1]
        matcher.width, matcher.height, matcher.disparities = width, height, self.max_disparity
        matcher.bits, matcher.contrast = self.bits, self.contrast
        matcher.census_radius_x, matcher.census_radius_y = (side // 2 for side in self.census)
        matcher.block_radius_x, matcher.block_radius_y = (side // 2 for side in self.block)
        matcher.p1, matcher.p2 = self.p1 * area, self.p2 * area
        matcher.uniqueness, matcher.median = self.uniqueness, self.median
        matcher.is_equiangular = int(self.subpixel == "equiangular")
        most = MAX_DISPARITIES  # two disparities differ by less
        matcher.max_difference = -1 if self.max_difference is None else min(self.max_difference, most)
        return matcher

    def _whole(self, name: str, allowed: str, low: int, high: float = math.inf) -> int:
        value = getattr(self, name)
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
            raise WarpcamError(f"StereoMatching: {name} must be {allowed}, got {value!r}")
        object.__setattr__(self, name, int(value))  # one of NumPy might overflow
        return int(value)

    def _choice(self, name: str, choices: Sequence[int]) -> None:
        words = f"{', '.join(map(str, choices[:-1]))} or {choices[-1]}"
        if self._whole(name, words, choices[0], choices[-1]) not in choices:
            raise WarpcamError(f"StereoMatching: {name} must be {words}, got {getattr(self, name)!r}")

    def _window(self, name: str) -> None:
        value: Any = getattr(self, name)
        if not (
            isinstance(value, tuple | list)
            and len(value) == 2
            and all(isinstance(side, int | np.integer) and not isinstance(side, bool) for side in value)
            and all(side > 0 and side % 2 == 1 for side in value)
        ):
            raise WarpcamError(f"StereoMatching: {name} must be width and height, both odd, got {value!r}")
        object.__setattr__(self, name, (int(value[0]), int(value[1])))
