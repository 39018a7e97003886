"""Newton's Gaussians as clouds."""

import newton
import numpy as np

from warpcam.accel.splats import Cloud
from warpcam.errors import WarpcamError

BASE = 0.28209479177387814  # the spherical harmonic of degree 0, 1 / (2 sqrt(pi))


def read_cloud(source: newton.Gaussian, label: str) -> Cloud:
    """What Newton's own renderers draw of it: colours are those of degree 0, the same from all sides."""
    harmonics = source.sh_coeffs
    if harmonics is None or harmonics.shape[1] < 3:
        raise WarpcamError(f"model: the splats of shape '{label}': sh_coeffs must have 3 columns or more")
    colors = np.maximum(np.float32(BASE) * harmonics[:, :3] + np.float32(0.5), 0.0)
    if source.sh_color_space == newton.utils.ColorSpace.LINEAR:
        colors = _encode(colors)
    return Cloud(
        name=label,
        positions=np.asarray(source.positions, np.float32),
        rotations=np.asarray(source.rotations, np.float32)[:, [3, 0, 1, 2]],
        scales=np.asarray(source.scales, np.float32),
        opacities=np.asarray(source.opacities, np.float32),
        colors=np.asarray(colors, np.float32),
        least_response=float(source.min_response),
    )


def _encode(linear: np.ndarray) -> np.ndarray:
    """Display values, sRGB, of linear ones."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1.0 / 2.4) - 0.055)
