"""Newton's Gaussians as clouds."""

import newton
import numpy as np

from warpcam.accel.gaussians import GaussianCloud
from warpcam.core.errors import WarpcamError
from warpcam.sources.common.gaussian_cloud import display_colors


def read_cloud(source: newton.Gaussian, label: str) -> GaussianCloud:
    """Read a cloud of Gaussians as Newton's own renderers draw it: colours of degree 0, the same from all sides.

    In which order ``sh_coeffs`` has the others is not defined: it differs between what Newton reads from PLY and USD.
    """
    harmonics = source.sh_coeffs
    if harmonics is None or harmonics.shape[1] < 3:
        raise WarpcamError(f"model: the splats of shape '{label}': sh_coeffs must have 3 columns or more")
    return GaussianCloud(
        name=label,
        positions=np.asarray(source.positions, np.float32),
        rotations=np.asarray(source.rotations, np.float32)[:, [3, 0, 1, 2]],
        scales=np.asarray(source.scales, np.float32),
        opacities=np.asarray(source.opacities, np.float32),
        colors=display_colors(harmonics[:, :3], source.sh_color_space == newton.utils.ColorSpace.LINEAR),
        least_response=float(source.min_response),
    )
