"""Boxes of meshes along the axes of their instances' frames, for as long as they stand there as they did."""

from typing import Any

import numpy as np
import warp as wp

from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.types import MESH
from warpcam.labeling import kernels
from warpcam.labeling.instances import Instances
from warpcam.scene.scene import Scene

NO_MESH = -1


def fit_meshes(scene: Scene, instances: Instances) -> Any:
    """``kernels.MeshBoxes`` of the scene as it is now: of each shape in the first world that has it.

    Meshes that move have none. Waits for the device.
    """
    tables, meshes = scene.tables(), scene.description().meshes
    shapes: Any = tables.shapes
    scaled = bool(tables.flags & SceneFlag.PER_SHAPE_SCALE)
    types, count = shapes.types.numpy(), tables.num_shapes
    fits: dict[str, np.ndarray] = {
        "assets": np.full(count, NO_MESH, np.int32),
        "turns": np.zeros((count, 3, 3), np.float32),
        "scales": np.zeros((count, 3), np.float32),
        "low": np.zeros((count, 3), np.float32),
        "high": np.zeros((count, 3), np.float32),
    }
    columns = np.flatnonzero((types == MESH) & (instances.places >= 0).any(axis=0))
    if columns.size:
        rotations, assets, sizes = (array.numpy() for array in (shapes.rotations, shapes.assets, shapes.sizes))
        bodies = scene.array("body_rotations").numpy()
    for column in columns:
        world = int(np.argmax(instances.places[:, column] >= 0))
        asset = int(assets[world % len(assets), column])
        if asset < 0 or meshes[asset].moves or not len(meshes[asset].faces):
            continue
        instance = instances.places[world, column]
        body, shape = instances.frame_bodies[world, instance], instances.frame_shapes[world, instance]
        frame = rotations[world, shape] if shape >= 0 else bodies[world, body] if body >= 0 else np.eye(3)
        turn = frame.T.astype(np.float64) @ rotations[world, column]
        scale = sizes[world % len(sizes), column] if scaled else np.ones(3)
        used = meshes[asset].vertices[np.unique(meshes[asset].faces)] * scale
        along = used @ turn.T
        fits["assets"][column], fits["turns"][column], fits["scales"][column] = asset, turn, scale
        fits["low"][column], fits["high"][column] = along.min(axis=0), along.max(axis=0)
    boxes = kernels.MeshBoxes()
    dtypes = {"assets": wp.int32, "turns": wp.mat33}
    for name, values in fits.items():
        setattr(boxes, name, wp.array(values, dtype=dtypes.get(name, wp.vec3), device=scene.device))
    return boxes
