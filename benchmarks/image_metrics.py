"""Measures of image similarity."""

import numpy as np

from warpcam.core.errors import WarpcamError

BEST = 99.0  # of images that are the same [dB]


def psnr(reference: np.ndarray, image: np.ndarray) -> float:
    """Peak signal to noise ratio over all channels [dB] of uint8 images (height, width, 3)."""
    error = np.mean(np.square(reference.astype(np.float64) - image.astype(np.float64)))
    return BEST if error == 0.0 else min(BEST, float(10.0 * np.log10(255.0**2 / error)))


def flip(reference: np.ndarray, image: np.ndarray) -> tuple[float, np.ndarray]:
    """FLIP (Andersson et al. 2020), mean and (height, width) map in [0, 1]: what eyes see when the two are swapped."""
    try:
        import flip_evaluator
    except ImportError:
        raise WarpcamError("FLIP: the package flip-evaluator is not installed; pip install flip-evaluator") from None
    as_floats = (np.ascontiguousarray(picture, np.float32) / 255.0 for picture in (reference, image))
    found, mean, _ = flip_evaluator.evaluate(*as_floats, "LDR", applyMagma=False)
    return float(mean), np.asarray(found)[..., 0]


def largest(reference: np.ndarray, image: np.ndarray) -> int:
    """The largest difference of any channel of any pixel, of 255."""
    return int(np.abs(reference.astype(np.int16) - image.astype(np.int16)).max())
