"""Surfaces of what is labelled: triangles of each instance in its own frame, and which instances are alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.kernels.types import BOX, CAPSULE, CONE, CYLINDER, ELLIPSOID, MESH, SPHERE
from warpcam.labeling.instances import NONE, find_instances
from warpcam.scene.scene import Scene
from warpcam.sources.common.geometry import MeshGeometry, Primitive

SOLIDS = (SPHERE, CAPSULE, CYLINDER, CONE, BOX)
SAME_VERTEX = 1e-6  # places of a shape that are this near, as part of its size, are one
SAME = 1e-5  # corners that are this near are one, where two instances are compared [m]


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A surface of which there are one or more instances.

    Attributes:
        name: Of its class, or of its first instance where instances of the class are not alike.
        vertices: (vertex, 3) float64, in the frame of an instance [m].
        faces: (face, 3) int32, counterclockwise seen from outside.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray


def find_models(
    scene: Scene, by: Any, names: Mapping[int, str], category_of: Mapping[int, int], classes: Sequence[str]
) -> tuple[tuple[ObjectModel, ...], dict[int, int]]:
    """Models of a scene's instances in its first world, and the place of each instance's model among them.

    Args:
        scene: Whose instances they are.
        by: What an instance is.
        names: Of the instances, by id.
        category_of: Class of each instance, by id.
        classes: Names of the classes.

    Raises:
        WarpcamError: An instance has no frame of its own, or a surface of which there is no model.
    """
    surfaces = _surfaces(scene, by, names, sorted(category_of))
    models: list[ObjectModel] = []
    model_of: dict[int, int] = {}
    for category, label in enumerate(classes):
        own: list[int] = []  # of the class
        for instance in (each for each in surfaces if category_of[each] == category):
            vertices, faces = surfaces[instance]
            found = next((place for place in own if _is_alike(models[place], vertices, faces)), None)
            if found is None:
                found = len(models)
                own.append(found)
                models.append(ObjectModel(names[instance], vertices, faces))
            model_of[instance] = found
        if len(own) == 1:
            models[own[0]] = ObjectModel(label, models[own[0]].vertices, models[own[0]].faces)
    return tuple(models), model_of


def diameter(vertices: np.ndarray) -> float:
    """The largest distance of two vertices (vertex, 3)."""
    centered = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radii = np.linalg.norm(centered, axis=1)
    first = centered[radii.argmax()]
    best = float(np.linalg.norm(centered - first, axis=1).max())
    # One of a pair that is farther apart is as far from the middle as half of that, and the other is at most `radii`.
    left = centered[radii > best - radii.max()]
    for rows in np.array_split(left, max(1, len(left) // 256)):
        squares = ((rows[:, None] - left[None]) ** 2).sum(axis=-1)
        best = max(best, float(np.sqrt(squares.max(initial=0.0))))
    return best


def _surfaces(scene: Scene, by: Any, names: Mapping[int, str], ids: Sequence[int]) -> dict[int, Any]:
    """Vertices and faces of each instance, by id."""
    instances = find_instances(scene, by, ids)
    shapes, bodies = scene.tables().shapes, scene.shape_bodies()[0]
    drawn = shapes.drawn.numpy()
    positions, rotations, sizes, assets = (
        getattr(shapes, name).numpy()[0].astype(np.float64) for name in ("positions", "rotations", "sizes", "assets")
    )
    places, types = scene.array("body_positions").numpy()[0], shapes.types.numpy()
    turns = scene.array("body_rotations").numpy()[0].reshape(-1, 3, 3)
    found = {}
    for row, instance in enumerate(instances.ids[0]):
        members = [int(shape) for shape in drawn if instances.places[0, shape] == row]
        if instance == NONE:
            continue
        name, body, own = names[instance], instances.frame_bodies[0, row], instances.frame_shapes[0, row]
        if own >= 0:
            origin, frame = positions[own], rotations[own]
        elif body >= 0:
            origin, frame = places[body], turns[body]
        elif len({int(bodies[shape]) for shape in members}) > 1:
            raise WarpcamError(
                f"labels: {name!r} is on several bodies, so it has no pose of its own; label by body or shape"
            )
        else:
            origin, frame = np.zeros(3), np.eye(3)
        parts, count = [], 0
        for shape in members:
            corners, faces = _merged(_triangles(scene, name, int(types[shape]), sizes[shape], int(assets[shape])))
            corners = corners @ rotations[shape].T + positions[shape]
            parts.append(((corners - origin) @ frame, faces + count))
            count += len(corners)
        vertices, faces = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        found[int(instance)] = vertices, faces.astype(np.int32)
    return found


def _triangles(scene: Scene, name: str, kind: int, size: np.ndarray, asset: int) -> MeshGeometry:
    """A shape in its own frame."""
    if kind == MESH:
        mesh = scene.description().meshes[asset]
        scale = size if scene.description().scaled else np.ones(3)
        corners = mesh.vertices.astype(np.float64) * scale
        half = mesh.faces[: len(mesh.faces) // 2] if mesh.two_sided else mesh.faces
        return MeshGeometry(name, corners, half)
    if kind == ELLIPSOID:
        ball = Primitive(name, SPHERE, (1.0,)).surface()
        return MeshGeometry(name, ball.vertices * size, ball.faces)
    if kind in SOLIDS:
        return Primitive(name, kind, tuple(size[:1] if kind == SPHERE else size)).surface()
    raise WarpcamError(
        f"labels: {name!r} has a plane, a height field or another surface of which no model is written; leave it out "
        "by labels: classes"
    )


def _merged(part: MeshGeometry) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that are used, each place once, and faces with three of them."""
    scale = max(float(np.abs(part.vertices).max()), 1e-30)
    used, corners = np.unique(part.faces, return_inverse=True)
    vertices = part.vertices[used]
    cells = np.rint(vertices / (SAME_VERTEX * scale))
    _, first, place = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    faces = place.reshape(-1)[corners.reshape(-1)].reshape(-1, 3)
    ends = np.sort(faces, axis=1)
    return vertices[first], faces[(ends[:, 0] < ends[:, 1]) & (ends[:, 1] < ends[:, 2])]


def _is_alike(model: ObjectModel, vertices: np.ndarray, faces: np.ndarray) -> bool:
    same = model.vertices.shape == vertices.shape and np.array_equal(model.faces, faces)
    return same and bool(np.abs(model.vertices - vertices).max() < SAME)
