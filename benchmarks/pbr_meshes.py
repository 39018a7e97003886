"""Meshes and maps of the scenes of ``look_speed``: surfaces on grids, and textures of seeded noise."""

from collections.abc import Sequence

import mujoco
import numpy as np

ROLE = mujoco.mjtTextureRole
SIZE = 512  # texels of a side of a map
Color = tuple[float, float, float]


def add_surface(spec: mujoco.MjSpec, name: str, points: np.ndarray) -> None:
    """Add a mesh through a grid of points, (row, column, 3) [m]; u runs along columns, v along rows."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    corners = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack((*corners[:3], corners[0], *corners[2:]), axis=-1).reshape(-1, 3)
    v, u = np.meshgrid(np.linspace(0.0, 1.0, rows), np.linspace(0.0, 1.0, columns), indexing="ij")
    vertices = points.reshape(-1, 3)
    sides = vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    faces = faces[np.linalg.norm(np.cross(*sides), axis=1) > 1e-12]
    mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL, smoothnormal=True)
    mesh.uservert, mesh.userface = vertices.ravel(), faces.ravel()
    mesh.usertexcoord, mesh.userfacetexcoord = np.stack((u, v), axis=-1).ravel(), faces.ravel()


def revolved(heights: Sequence[float], radii: Sequence[float], rows: int = 120, columns: int = 64) -> np.ndarray:
    """Points, (row, column, 3) [m], of a profile that is turned about z."""
    along = np.linspace(0.0, 1.0, rows)
    knots = np.linspace(0.0, 1.0, len(heights))
    z, r = np.interp(along, knots, heights)[:, None], np.interp(along, knots, radii)[:, None]
    angle = np.linspace(0.0, 2.0 * np.pi, columns + 1)[None]
    return np.stack((r * np.cos(angle), r * np.sin(angle), z + 0.0 * angle), axis=-1)


def superquadric(half: Color, power: float, rows: int = 64, columns: int = 96) -> np.ndarray:
    """Points, (row, column, 3) [m], of a ball (power 1) that becomes a rounded box as the power falls."""
    up = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows)[:, None]
    around = np.linspace(0.0, 2.0 * np.pi, columns + 1)[None]

    def rounded(x: np.ndarray) -> np.ndarray:
        return np.sign(x) * np.abs(x) ** power

    x, y = rounded(np.cos(up)) * rounded(np.cos(around)), rounded(np.cos(up)) * rounded(np.sin(around))
    return np.stack((x, y, rounded(np.sin(up)) + 0.0 * around), axis=-1) * half


def noise(cells: float, seed: int) -> np.ndarray:
    """Smooth noise that repeats without a seam, (SIZE, SIZE) in [0, 1], with about so many bumps along a side."""
    white = np.random.default_rng(seed).normal(size=(SIZE, SIZE))
    frequency = np.fft.fftfreq(SIZE, 1.0 / SIZE)
    spectrum = np.fft.fft2(white) * np.exp(-0.5 * (frequency[:, None] ** 2 + frequency**2) / cells**2)
    found = np.fft.ifft2(spectrum).real
    return np.clip(0.5 + found / (5.0 * found.std()), 0.0, 1.0)


def add_texture(spec: mujoco.MjSpec, name: str, image: np.ndarray) -> str:
    """Add an image, (SIZE, SIZE, 3) in [0, 1]; returns its name."""
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=SIZE, height=SIZE, nchannel=3)
    texture.data = np.rint(255.0 * np.clip(image, 0.0, 1.0)).astype(np.uint8).tobytes()
    return name


def add_material(spec: mujoco.MjSpec, name: str, colors: tuple[Color, Color], *, roughness: tuple[float, float],
                 metal: tuple[float, float] = (0.0, 0.0), bumps: float = 2.0, cells: float = 12.0,
                 glow: Color | None = None, seed: int = 0) -> None:  # fmt: skip
    """Add a material with maps of its colour, of roughness and metal, of normals and, with ``glow``, of light.

    Args:
        colors: Between which noise mixes, in sRGB.
        roughness: Least and most.
        metal: In the first colour, and in the second.
        bumps: How steep the normals are.
        cells: Bumps along a side of the maps.
        glow: Colour of spots that shine, in sRGB.
        seed: Of the noise.
    """
    patches, height = noise(cells, seed), noise(2.0 * cells, seed + 1)
    share = np.clip(6.0 * (patches - 0.5) + 0.5, 0.0, 1.0)
    color = np.array(colors[0]) * (1.0 - share[..., None]) + np.array(colors[1]) * share[..., None]
    orm = (
        0.6 + 0.4 * height,
        roughness[0] + (roughness[1] - roughness[0]) * height,
        metal[0] + (metal[1] - metal[0]) * share,
    )
    slopes = [bumps * 8.0 * (np.roll(height, -1, axis) - np.roll(height, 1, axis)) for axis in (1, 0)]
    normal = np.stack((-slopes[0], -slopes[1], np.ones_like(height)), axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    maps = {ROLE.mjTEXROLE_RGB: color, ROLE.mjTEXROLE_ORM: np.stack(orm, axis=-1)}
    maps[ROLE.mjTEXROLE_NORMAL] = 0.5 + 0.5 * normal
    material = spec.add_material(name=name, rgba=(1, 1, 1, 1), specular=0.5, roughness=1.0, metallic=1.0)
    if glow is not None:
        material.emission = 1.0
        maps[ROLE.mjTEXROLE_EMISSIVE] = np.where(patches[..., None] > 0.72, np.array(glow), 0.0)
    for role, image in maps.items():
        material.textures[int(role)] = add_texture(spec, f"{name}{int(role)}", image)
