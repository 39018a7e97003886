"""Tone mapping curves as they were published, in float64: light (..., 3) to what a display is to show of it, linear."""

from collections.abc import Callable, Mapping

import numpy as np

# Stephen Hill's fit of ACES (BakingLab): its rows are those of matrices of columns of light.
ACES_INPUT = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
ACES_OUTPUT = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
# Rec. 709 to Rec. 2020 (ITU-R BT.2407), and the inset of AgX there, by rows.
TO_REC2020 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0113], [0.0164, 0.0880, 0.8956]])
FROM_REC2020 = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])
AGX_INSET = np.array(
    [
        [0.856627153315983, 0.0951212405381588, 0.0482516061458583],
        [0.137318972929847, 0.761241990602591, 0.101439036467562],
        [0.11189821299995, 0.0767994186031903, 0.811302368396859],
    ]
)
AGX_OUTSET = np.linalg.inv(
    [
        [0.899796955911611, 0.0871996192028351, 0.013003424885555],
        [0.11142098895748, 0.875575586156966, 0.0130034248855548],
        [0.11142098895748, 0.0871996192028349, 0.801379391839686],
    ]
)


def aces(light: np.ndarray) -> np.ndarray:
    seen = light @ ACES_INPUT.T
    fitted = (seen * (seen + 0.0245786) - 0.000090537) / (seen * (0.983729 * seen + 0.4329510) + 0.238081)
    return fitted @ ACES_OUTPUT.T


def khronos_neutral(light: np.ndarray) -> np.ndarray:
    start, desaturation = 0.8 - 0.04, 0.15
    least = light.min(axis=-1, keepdims=True)
    color = light - np.where(least < 0.08, least - 6.25 * least**2, 0.04)
    peak = color.max(axis=-1, keepdims=True)
    bright = np.maximum(peak, start)  # darker colours are returned before
    squeezed = 1.0 - (1.0 - start) ** 2 / (bright + 1.0 - 2.0 * start)
    white = 1.0 - 1.0 / (desaturation * (bright - squeezed) + 1.0)
    return np.where(peak < start, color, (1.0 - white) * color * squeezed / bright + white * squeezed)


def agx(light: np.ndarray) -> np.ndarray:
    inset = light @ TO_REC2020.T @ AGX_INSET.T
    stops = np.log2(np.maximum(inset, 1e-10) / 0.18)
    x = np.clip((stops + 10.0) / 16.5, 0.0, 1.0)
    curved = np.polyval([15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232], x)
    return np.maximum(curved @ AGX_OUTSET.T, 0.0) ** 2.2 @ FROM_REC2020.T


CURVES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "clip": lambda light: light,
    "reinhard": lambda light: light / (1.0 + light),
    "aces": aces,
    "khronos_neutral": khronos_neutral,
    "agx": agx,
}
