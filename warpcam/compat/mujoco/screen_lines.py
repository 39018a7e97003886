"""Lines that are so many pixels wide, as thin boxes that face the camera: in pieces that widen with their distance."""

import mujoco
import numpy as np

from warpcam.compat.mujoco.gl_camera import GlCamera

GROWTH = 1.1  # how much farther the end of a piece is at most than its start
MOST_PIECES = 64
THICKNESS = 1e-3  # of a piece, as part of its width


def line_pieces(
    start: np.ndarray, end: np.ndarray, pixels: np.ndarray, view: GlCamera, height: int, smooth: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the visible pieces of lines.

    Args:
        start: (line, 3) world frame [m].
        end: (line, 3).
        pixels: (line,) how wide they are [pixels].
        view: From where they are seen.
        height: Of the image [pixels].
        smooth: Whether pixels are of several samples. Where they are not, OpenGL draws whole pixels beside each other,
            or above each other for what is less than half as steep as it may be.

    Returns:
        Of each piece which line it is part of, its middle (piece, 3) [m], its axes as columns (piece, 3, 3), the last
        one along the line, and its half extents (piece, 3) [m].
    """
    start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, np.asarray(view.rotation, np.float64))
    camera = turn.reshape(3, 3)  # columns right, up, backwards
    which, points = _cut(
        start, end, -(start - view.position) @ camera[:, 2], -(end - view.position) @ camera[:, 2], view
    )
    middles = 0.5 * (points[0] + points[1])
    depths = -(middles - view.position) @ camera[:, 2]
    widths = (pixels if smooth else np.maximum(np.floor(pixels + 0.5), 1.0))[which]
    if not smooth:
        seen = [((ends - view.position) @ camera[:, :2]) for ends in points]
        if not view.orthographic:
            seen = [at / -((ends - view.position) @ camera[:, 2:]) for at, ends in zip(seen, points, strict=True)]
        across = np.abs(seen[1] - seen[0])
        widths = widths * across.max(axis=1) / np.maximum(np.linalg.norm(across, axis=1), 1e-300)
    pixel = (view.top - view.bottom) / height * (1.0 if view.orthographic else depths / view.near)
    half = 0.5 * widths * pixel
    length = np.linalg.norm(points[1] - points[0], axis=1)
    towards = np.broadcast_to(camera[:, 2], middles.shape) if view.orthographic else view.position - middles
    return (
        which,
        middles,
        _axes(points[1] - points[0], towards),
        np.stack((half, THICKNESS * half, 0.5 * length), axis=1),
    )


def _cut(
    start: np.ndarray, end: np.ndarray, first: np.ndarray, last: np.ndarray, view: GlCamera
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Pieces of what lies beyond the near plane: of which lines, and from where to where.

    ``first`` and ``last`` are the planar depths of the ends.
    """
    near, slope = view.near, last - first
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.where(slope != 0.0, (near - first) / slope, 0.0)
    begin, stop = np.where(first < near, crossing, 0.0), np.where(last < near, crossing, 1.0)
    seen = ((first >= near) | (last >= near)) & (stop > begin) & (start != end).any(axis=1)
    nearest, farthest = (np.maximum(first + part * slope, near) for part in (begin, stop))
    grown = np.ones_like(near * first) if view.orthographic else farthest / nearest
    counts = np.clip(np.ceil(np.abs(np.log(grown)) / np.log(GROWTH)), 1, MOST_PIECES).astype(np.int64) * seen
    which = np.repeat(np.arange(len(start)), counts)
    piece = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    points, grown = [], grown[which]
    for part in (piece / counts[which], (piece + 1) / counts[which]):  # of the way, if each piece grows alike
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(np.abs(grown - 1.0) > 1e-6, (grown**part - 1.0) / (grown - 1.0), part)
        along = begin[which] + share * (stop - begin)[which]
        points.append(start[which] + along[:, None] * (end - start)[which])
    return which, points


def _axes(along: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Axes as columns (n, 3, 3): the last one along a vector (n, 3), the second as far as it can be towards another."""
    z = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    x = np.cross(towards, z)
    aside = np.where(np.abs(z[:, :1]) < 0.9, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))  # of what is seen end on
    lost = np.linalg.norm(x, axis=1, keepdims=True) <= 1e-9 * np.linalg.norm(towards, axis=1, keepdims=True)
    x = np.where(lost, np.cross(aside, z), x)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-300)
    return np.stack((x, np.cross(z, x), z), axis=2)
