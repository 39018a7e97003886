"""Columns of the tables of a Newton scene."""

import numpy as np

from warpcam.kernels import types
from warpcam.sources.newton.deformables import Deformables
from warpcam.sources.newton.kernels.gather import WHITE
from warpcam.sources.newton.model import Layout
from warpcam.sources.newton.triangle_colors import TriangleColors
from warpcam.sources.newton.visual_meshes import VisualMesh

# What Newton's own camera calls what is no shape, as signed numbers.
SOFT_ID, PARTICLE_ID = -3, -2


class Columns:
    """The columns of all that is drawn: shapes, soft surfaces, particles."""

    def __init__(self, layout: Layout, soft: Deformables, first_finish: int, tints: TriangleColors):
        num_worlds, shapes = layout.ids.shape
        width, loose = soft.num_columns, soft.particles
        self.faces, self.first_soft = np.full((num_worlds, width), -1, np.int32), shapes
        assets = np.full((num_worlds, width), -1, np.int32)
        first = len(layout.meshes)
        for part in soft.parts:
            for number, (world, triangle) in enumerate(zip(part.worlds, part.triangles, strict=True)):
                rows = slice(None) if world < 0 else world
                self.faces[rows, part.column] = WHITE - triangle if part.tinted else triangle
                assets[rows, part.column] = first + number
            first += len(part.worlds)
        self.kinds = np.concatenate(
            (layout.kinds, np.full(width, types.MESH), np.full(loose.shape[1], types.SPHERE))
        ).astype(np.int32)
        soft_ids = np.where(self.faces != -1, SOFT_ID, -1)
        self.ids = np.hstack((layout.ids, soft_ids, np.where(loose >= 0, PARTICLE_ID, -1))).astype(np.int32)
        none = np.full((num_worlds, len(self.kinds) - shapes), -1, np.int32)
        self.bodies = np.hstack((layout.shape_bodies, none)).astype(np.int32)
        rows = num_worlds if width else len(layout.assets)
        beside = np.full((rows, loose.shape[1]), -1, np.int32)
        own = np.broadcast_to(layout.assets, (rows, shapes))
        self.assets = np.hstack((own, assets[:rows], beside)).astype(np.int32)
        plain = np.zeros((len(layout.materials), len(self.kinds) - shapes), np.int32)
        for part in soft.parts:
            if isinstance(part, VisualMesh) and part.texture >= 0:
                plain[:, part.column] = first_finish + part.texture
        plain = tints.materials(plain, num_worlds)
        own = np.broadcast_to(layout.materials, (len(plain), shapes))
        self.materials = np.hstack((own, plain)).astype(np.int32)
