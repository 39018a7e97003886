"""Clouds of Gaussians to look at, and what they look like by definition: in float64, every Gaussian for every pixel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import newton
import numpy as np
import scenes

import warpcam as wc
from warpcam.core.color import encoded_beyond

BASE = 0.28209479177387814
FOVY = 40.0


def gaussians(
    positions: Any, colors: Any, *, scales: Any = 0.3, opacities: Any = 0.8, rotations: Any = None, least: float = 0.01
) -> newton.Gaussian:
    """``rotations`` are x y z w; ``colors`` display colours."""
    positions = np.asarray(positions, np.float32)
    count = len(positions)
    scales = np.asarray(scales, np.float32)
    return newton.Gaussian(
        positions,
        rotations,
        np.broadcast_to(scales[:, None] if scales.ndim == 1 else scales, (count, 3)),
        np.broadcast_to(np.asarray(opacities, np.float32), (count,)),
        (np.asarray(colors, np.float32) - 0.5) / BASE,
        min_response=least,
    )


def random_gaussians(count: int, seed: int, *, least: float = 0.02, size: float = 0.15) -> newton.Gaussian:
    """In a cube of half width 1; of every shape, turned every way, more and less opaque."""
    random = np.random.default_rng(seed)
    rotations = random.normal(size=(count, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return newton.Gaussian(
        random.uniform(-1.0, 1.0, (count, 3)),
        rotations,
        size * np.exp(random.uniform(-1.5, 0.5, (count, 3))),
        random.uniform(0.02, 1.0, count),
        random.uniform(-1.5, 1.5, (count, 3)),
        min_response=least,
    )


@dataclass(frozen=True, eq=False)
class Placed:
    """Placement of a cloud: position, rotation x y z w, scale, opacity, the id of its shape."""

    source: newton.Gaussian
    position: Sequence[float] = (0.0, 0.0, 0.0)
    rotation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)
    scale: Sequence[float] = (1.0, 1.0, 1.0)
    opacity: float = 1.0
    shape: int = 0


def matrix(quaternion: Sequence[float]) -> np.ndarray:
    x, y, z, w = np.asarray(quaternion, np.float64) / np.linalg.norm(quaternion)
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )


def eye(**changes: Any) -> wc.Camera:
    """From 4 m along -y towards the origin."""
    position = changes.get("position", (0.0, -4.0, 0.0))
    settings = {
        "width": 33,
        "height": 25,
        "outputs": ("rgb", "rgba", "hdr", "depth", "segmentation", "normals", "points", "distance"),
        "lens": wc.Pinhole(fovy=FOVY),
        "position": position,
        "rotation": scenes.looking(position, (0.0, 0.0, 0.0)),
        "background": (0.2, 0.4, 0.6),
    }
    return scenes.own_camera(**{**settings, **changes})


def rays(camera: wc.Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins and directions in the world, (height, width, 3), as long as one metre of depth is; and the axes."""
    w, *xyz = camera.rotation
    axes = matrix((*xyz, w))
    at = scenes.pixel_rays(camera.width, camera.height, FOVY)
    origins = np.broadcast_to(np.asarray(camera.position, np.float64), at.shape)
    if isinstance(camera.lens, wc.Orthographic):
        step = camera.lens.height / camera.height
        x = (np.arange(camera.width) + 0.5 - camera.width / 2) * step
        y = (camera.height / 2 - np.arange(camera.height) - 0.5) * step
        flat = np.stack((*np.meshgrid(x, y), np.zeros((camera.height, camera.width))), axis=-1)
        origins = origins + flat @ axes.T
        at = np.broadcast_to((0.0, 0.0, -1.0), at.shape)
    return origins, at @ axes.T, axes


def reference(clouds: Sequence[Placed], camera: wc.Camera, behind: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The images by definition.

    Args:
        clouds: What is blended.
        camera: Who looks.
        behind: hdr, depth (inf for nothing) and segmentation of everything else.
    """
    origins, directions, _ = rays(camera)
    times, alphas, colors, ids, normals = [], [], [], [], []
    for cloud in clouds:
        source = cloud.source
        to_shape = np.diag(1.0 / np.asarray(cloud.scale, np.float64)) @ matrix(cloud.rotation).T
        o = (origins - cloud.position) @ to_shape.T
        d = directions @ to_shape.T
        for i in range(source.count):
            white = np.diag(1.0 / source.scales[i].astype(np.float64)) @ matrix(source.rotations[i]).T
            p, q = (o - source.positions[i]) @ white.T, d @ white.T
            t = -(p * q).sum(-1) / (q * q).sum(-1)
            response = np.exp(-0.5 * ((p + t[..., None] * q) ** 2).sum(-1))
            alpha = np.minimum(response * float(source.opacities[i]), 1.0)
            seen = (response > source.min_response) & (alpha > 1.0 / 255.0) & (t > 0.0) & (t < behind["depth"])
            normal = -(q @ white) @ to_shape
            times.append(np.where(seen, t, np.inf))
            alphas.append(np.where(seen, alpha * min(cloud.opacity, 1.0), 0.0))
            colors.append(np.maximum(BASE * source.sh_coeffs[i, :3] + 0.5, 0.0))
            ids.append(cloud.shape)
            normals.append(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
    t, alpha = np.stack(times), np.stack(alphas)
    order = np.argsort(t, axis=0, kind="stable")
    t, alpha = np.take_along_axis(t, order, 0), np.take_along_axis(alpha, order, 0)
    light = np.cumprod(1.0 - alpha, axis=0)
    before = np.concatenate((np.ones_like(light[:1]), light[:-1]))
    hdr = ((before * alpha)[..., None] * np.array(colors)[order]).sum(0) + light[-1][..., None] * behind["hdr"]
    first = np.argmax(light <= 0.5, axis=0)[None]
    lost = light[-1] <= 0.5
    which = np.take_along_axis(order, first, 0)
    normal = np.take_along_axis(np.stack(normals), which[..., None], 0)[0]
    depth = np.where(lost, np.take_along_axis(t, first, 0)[0], behind["depth"])
    return {
        "hdr": hdr,
        "light": light[-1],
        "halves": np.abs(light - 0.5).min(0),  # how near a pixel is to having another surface
        "depth": depth,
        "segmentation": np.where(lost, np.array(ids)[which[0]], behind["segmentation"]),
        "normals": np.where(lost[..., None], normal, behind.get("normals", np.zeros(3))),
    }


def shown(images: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """With hdr, which is light, as the display values that splats are blended in."""
    return {**images, **({"hdr": encoded_beyond(np.maximum(images["hdr"], 0.0))} if "hdr" in images else {})}


def nothing(camera: wc.Camera) -> dict[str, np.ndarray]:
    """Return the background."""
    size = (camera.height, camera.width)
    return {
        "hdr": np.broadcast_to(np.asarray(camera.background), (*size, 3)),
        "depth": np.full(size, np.inf),
        "segmentation": np.full(size, -1),
    }
