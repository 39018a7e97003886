"""Cameras of a renderer as sensors read them: images, views and the kind of rays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Projection
from warpcam.core.errors import WarpcamError
from warpcam.render.renderer import Renderer
from warpcam.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class DrawnCamera:
    """One camera.

    Attributes:
        camera: As it was asked for.
        projection: Kind of its rays.
        images: Array of each output, (world, height, width, channels).
        measured: Names of those that a sensor's renderer has measured.
        views: View, (world,), of each world's last frame.
    """

    camera: Camera
    projection: Projection
    images: Mapping[str, wp.array]
    measured: frozenset[str]
    views: wp.array


def drawn_cameras(renderer: Any, where: str) -> tuple[Scene, dict[str | int, DrawnCamera]]:
    """The scene of a renderer, and its cameras by name.

    Raises:
        WarpcamError: ``renderer`` is none; the text begins with ``where``.
    """
    if not isinstance(renderer, Renderer):
        raise WarpcamError(f"{where}: renderer must be a Renderer or a Rig, got {type(renderer).__name__}")
    drawn = {}
    for key, camera in renderer._cameras.items():
        images = {name: renderer.array(key, name) for name in renderer.images[key]}
        measured = frozenset(name for name, image in images.items() if image is not renderer.rendered(key, name))
        projection, views = renderer._bindings[key].projection, renderer.views(key)
        drawn[key] = DrawnCamera(camera, projection, images, measured, views)
    return renderer._scene, drawn
