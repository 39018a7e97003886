"""Scenes of shapes of random sizes, moved by hand: all types, a mesh of many faces and a rough height field."""

import mujoco
import numpy as np
import scenes

RANGES = {
    "plane": ((0.1, 0.1, 0.1), (0.6, 0.6, 0.1)),
    "sphere": ((0.05,), (0.4,)),
    "capsule": ((0.05, 0.05), (0.25, 0.5)),
    "ellipsoid": ((0.05, 0.05, 0.05), (0.4, 0.4, 0.4)),
    "cylinder": ((0.05, 0.05), (0.35, 0.4)),
    "box": ((0.05, 0.05, 0.05), (0.4, 0.4, 0.4)),
}


def ball_mesh(random: np.random.Generator) -> str:
    """A bumpy ball of 720 faces, as the vertices and faces of an MJCF mesh."""
    rings, around = 16, 24
    polar, azimuth = np.pi * np.arange(1, rings) / rings, 2.0 * np.pi * np.arange(around) / around
    sine = np.sin(polar)[:, None]
    points = np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)[:, None] + 0.0 * azimuth), -1)
    points = points.reshape(-1, 3) * random.uniform(0.25, 0.45, (len(points.reshape(-1, 3)), 1))
    vertices = np.concatenate((points, [(0, 0, 0.35), (0, 0, -0.35)]))
    top, bottom = len(vertices) - 2, len(vertices) - 1
    faces = []
    for i in range(around):
        j = (i + 1) % around
        faces += [(top, i, j), (bottom, (rings - 2) * around + j, (rings - 2) * around + i)]
        for ring in range(rings - 2):
            a, b = ring * around, (ring + 1) * around
            faces += [(a + i, b + i, b + j), (a + i, b + j, a + j)]
    numbers = [" ".join(map(str, np.asarray(values).reshape(-1))) for values in (vertices, faces)]
    return f'<mesh name="mesh" vertex="{numbers[0]}" face="{numbers[1]}"/>'


def height_field(random: np.random.Generator) -> str:
    heights = " ".join(f"{height:.3f}" for height in random.uniform(0.0, 1.0, 13 * 9))
    return f'<hfield name="hfield" nrow="13" ncol="9" size="0.4 0.5 0.3 0.1" elevation="{heights}"/>'


def cluster(kind: str, random: np.random.Generator, count: int = 10, more: str = "") -> mujoco.MjModel:
    """Shapes of one type, or of all types in turn, each on a body that is moved by hand, and ``more`` before them."""
    kinds = scenes.TYPES if kind == "all" else (kind,)
    bodies = []
    for index in range(count):
        of = kinds[index % len(kinds)]
        size = random.uniform(*RANGES[of]) if of in RANGES else None
        bodies.append(f'<body mocap="true">{scenes.geom_xml(of, f"{of}{index}", size=size)}</body>')
    return scenes.compile_xml(more + "".join(bodies), assets=ball_mesh(random) + height_field(random))
