"""One lens of each class, for images of 45 x 27 pixels, and their published formulas in one direction."""

from collections.abc import Callable, Mapping

import numpy as np
from custom_ray_tables import HEIGHT, WIDTH

import warpcam as wc

PIXELS = {"fx": 21.0, "fy": 19.0, "cx": 23.0, "cy": 13.0}
BENT = (0.06, -0.02, 0.004, -0.0005)  # of fisheyes
PRISM = (0.05, -0.01, 0.004, -0.006, 0.002, -0.0003, 0.003, -0.002)
SIX = (0.04, -0.02, 0.006, -0.001, 0.0002, -0.00001, 0.004, -0.003, 0.003, -0.001, -0.002, 0.0005)
BACKWARD, FORWARD = (0.0, 0.05, 2e-4, -3e-6), (0.0, 20.0, 0.5, -0.8)
LINEAR = (1.1, 0.02, -0.03)

LENSES: Mapping[str, Callable[[], wc.Lens]] = {
    "Pinhole": lambda: wc.Pinhole(**PIXELS),
    "Orthographic": lambda: wc.Orthographic(height=2.5),
    "Fisheye": lambda: wc.Fisheye(**PIXELS, k=BENT, max_fov=250.0),
    "KannalaBrandt": lambda: wc.KannalaBrandt((3.0, 0.2, -0.05), mu=7.0, mv=6.5, cx=23.0, cy=13.0, max_fov=200.0),
    "FTheta backward": lambda: wc.FTheta(backward=BACKWARD, cx=23.0, cy=13.0, linear=LINEAR),
    "FTheta forward": lambda: wc.FTheta(forward=FORWARD, cx=23.0, cy=13.0, linear=LINEAR, max_fov=220.0),
    "Distorted": lambda: wc.Distorted(**PIXELS, coefficients=(-0.1, 0.03, 0.004, -0.006, -0.004)),
    "ThinPrismFisheye": lambda: wc.ThinPrismFisheye(**PIXELS, coefficients=PRISM, max_fov=200.0),
    "RadTanThinPrismFisheye": lambda: wc.RadTanThinPrismFisheye(**PIXELS, coefficients=SIX, max_fov=180.0),
    "Omnidirectional": lambda: wc.Omnidirectional(0.9, **PIXELS, coefficients=(-0.05, 0.01, 0.002, -0.001)),
    "DoubleSphere": lambda: wc.DoubleSphere(-0.2, 0.6, **PIXELS),
    "ExtendedUnified": lambda: wc.ExtendedUnified(0.6, 1.1, **PIXELS),
    "Equirectangular": lambda: wc.Equirectangular(),
    "Rays": lambda: wc.Rays(wc.Fisheye(fovy=150.0).rays(WIDTH, HEIGHT, 1, "lens")[0]),
    "Rays with origins": lambda: wc.Rays(wc.Fisheye(fovy=150.0).rays(WIDTH, HEIGHT, 1, "lens")[0], origins=rising()),
}


def rising() -> np.ndarray:
    """Places of a camera that rises while its rows are read."""
    origins = np.zeros((HEIGHT, WIDTH, 3))
    origins[..., 1] = np.linspace(0.0, 0.2, HEIGHT)[:, None]
    return origins


def published(name: str, points: np.ndarray) -> np.ndarray:
    """Pixels of points by the formula as it was published, one way, with x right, y down and z ahead."""
    x, y, z = points[:, 0], -points[:, 1], -points[:, 2]
    across, length = np.hypot(x, y), np.linalg.norm(points, axis=1)
    angle, turn = np.arctan2(across, z), np.arctan2(y, x)
    a, b = angle * np.cos(turn), angle * np.sin(turn)
    fx, fy, cx, cy = PIXELS["fx"], PIXELS["fy"], PIXELS["cx"], PIXELS["cy"]
    if name == "KannalaBrandt":
        r = 3.0 * angle + 0.2 * angle**3 - 0.05 * angle**5
        return np.stack([7.0 * r * np.cos(turn) + 23.0, 6.5 * r * np.sin(turn) + 13.0], axis=-1)
    if name == "FTheta forward":
        r = sum(c * angle**power for power, c in enumerate(FORWARD))
        u, v = r * np.cos(turn), r * np.sin(turn)
        return np.stack([LINEAR[0] * u + LINEAR[1] * v + 23.0, LINEAR[2] * u + v + 13.0], axis=-1)
    if name == "Equirectangular":
        azimuth, elevation = np.arctan2(x, z), np.arcsin(-y / length)
        return np.stack([(azimuth / (2.0 * np.pi) + 0.5) * WIDTH, (0.5 - elevation / np.pi) * HEIGHT], axis=-1)
    if name == "ThinPrismFisheye":
        k1, k2, p1, p2, k3, k4, sx1, sy1 = PRISM
        r = angle**2
        radial = k1 * r + k2 * r**2 + k3 * r**3 + k4 * r**4
        u = a + a * radial + 2.0 * p1 * a * b + p2 * (r + 2.0 * a * a) + sx1 * r
        v = b + b * radial + 2.0 * p2 * a * b + p1 * (r + 2.0 * b * b) + sy1 * r
    elif name == "RadTanThinPrismFisheye":
        *k, p0, p1, s0, s1, s2, s3 = SIX
        radial = 1.0 + sum(each * angle ** (2 * power) for power, each in enumerate(k, 1))
        a, b = radial * a, radial * b
        r = a * a + b * b
        u = a + 2.0 * p1 * a * b + p0 * (r + 2.0 * a * a) + s0 * r + s1 * r * r
        v = b + 2.0 * p0 * a * b + p1 * (r + 2.0 * b * b) + s2 * r + s3 * r * r
    elif name == "Omnidirectional":
        k1, k2, p1, p2 = -0.05, 0.01, 0.002, -0.001
        a, b = x / (z + 0.9 * length), y / (z + 0.9 * length)
        r = a * a + b * b
        u = a * (1.0 + k1 * r + k2 * r * r) + 2.0 * p1 * a * b + p2 * (r + 2.0 * a * a)
        v = b * (1.0 + k1 * r + k2 * r * r) + 2.0 * p2 * a * b + p1 * (r + 2.0 * b * b)
    elif name == "DoubleSphere":
        ahead = z - 0.2 * length
        over = 0.6 * np.sqrt(across**2 + ahead**2) + 0.4 * ahead
        u, v = x / over, y / over
    else:
        assert name == "ExtendedUnified"
        over = 0.6 * np.sqrt(1.1 * across**2 + z * z) + 0.4 * z
        u, v = x / over, y / over
    return np.stack([fx * u + cx, fy * v + cy], axis=-1)
