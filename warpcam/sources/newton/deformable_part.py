"""Deformable surfaces of Newton: their faces, columns, and texture coordinates of one texel a triangle."""

from dataclasses import dataclass, field

import numpy as np

from warpcam.accel.meshes import Mesh


@dataclass(frozen=True, eq=False)
class DeformablePart:
    """A connected surface, which some worlds have one after another of.

    Attributes:
        faces: (face, 3) int32, particles counted from the first.
        vertices: (vertex, 3) float32, where they were in the first of the worlds [m].
        column: Which of the soft columns it stands in.
        backs: Whether it is seen from both sides.
        worlds: Where it is, -1 for all worlds.
        bases: Its first particle in each of these.
        triangles: One of its triangles in each, for the colour.
        all_triangles: (face,) int32, all of them in each.
        tinted: Whether their colours differ, in some world.
    """

    faces: np.ndarray
    vertices: np.ndarray
    column: int
    backs: bool
    worlds: list[int] = field(default_factory=list)
    bases: list[int] = field(default_factory=list)
    triangles: list[int] = field(default_factory=list)
    all_triangles: list[np.ndarray] = field(default_factory=list)
    tinted: bool = False

    def mesh(self) -> Mesh:
        faces, both = self.faces, self.backs
        uvs = texel_coordinates(len(faces)) if self.tinted else None
        if both:
            faces = np.concatenate((faces, faces[:, (0, 2, 1)]))
            uvs = None if uvs is None else np.concatenate((uvs, uvs))
        return Mesh(f"soft part {self.column}", self.vertices, faces, uvs=uvs, moves=True, two_sided=both)


def image_size(count: int) -> tuple[int, int]:
    """Width and height of an image of so many texels at least."""
    width = int(np.ceil(np.sqrt(count)))
    return width, -(-count // width)


def texel_coordinates(count: int) -> np.ndarray:
    """Texture coordinates, (face, 3, 2) float32: all corners of a face lie in the middle of its texel."""
    width, height = image_size(count)
    row, column = np.divmod(np.arange(count), width)
    uvs = np.stack(((column + 0.5) / width, 1.0 - (row + 0.5) / height), axis=1)
    return np.ascontiguousarray(np.repeat(uvs[:, None], 3, axis=1), np.float32)
