"""Distractors beside the meshes of a file."""

import numpy as np

from warpcam.datasets.generate.distractor_pool import DistractorPool, Thing
from warpcam.kernels.types import BOX, CAPSULE, CYLINDER, SPHERE
from warpcam.sources.common.geometry import Primitive
from warpcam.sources.common.scene_graph import FrameNode, SceneGraph, ShapeInstance

GREY = (0.5, 0.5, 0.5, 1.0)
KINDS = {"box": BOX, "capsule": CAPSULE, "cylinder": CYLINDER, "sphere": SPHERE, "ellipsoid": SPHERE}


def add(pool: DistractorPool, graph: SceneGraph) -> None:
    """Add a pool's things to a file's graph, each a body around the world's origin, in metres whatever the file has."""
    for path, thing in zip(pool.paths, pool.things, strict=True):
        body = len(graph.nodes)
        graph.nodes.append(FrameNode(path, -1, np.eye(4), body=True))
        graph.nodes.append(FrameNode(f"{path}/shape", body, _stretch(thing)))
        shape = Primitive(path, KINDS[thing.kind], tuple(map(float, thing.size)))
        graph.items.append(ShapeInstance(f"{path}/shape", body + 1, shape, color=GREY))


def _stretch(thing: Thing) -> np.ndarray:
    """What makes an ellipsoid of a sphere with its first radius, (4, 4)."""
    return np.diag((*(thing.size / thing.size[0]), 1.0)) if thing.kind == "ellipsoid" else np.eye(4)
