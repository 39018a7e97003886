"""Projects whose tests are run: where the tests are, what takes the place of what, and which tests differ and why."""

import importlib
import unittest
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

from .known import DM_CONTROL, GYMNASIUM, MUJOCO, MUJOCO_WARP, NEWTON


@dataclass(frozen=True)
class Project:
    """A project's tests.

    Attributes:
        name: The package that is tested.
        modules: Modules of its tests and the classes in them that are run.
        in_place: Puts a front end in the place of the project's own classes, within a context.
        known: Tests that fail, by a pattern of ``Class.test``, and why they do.
        folder: Where the tests are in a clone of the repository, if the package has none; pytest runs them.
        left_out: Tests of a folder that are not run, by a part of their names: they need a display.
    """

    name: str
    modules: Mapping[str, tuple[str, ...]]
    in_place: Callable[[], AbstractContextManager[None]]
    known: Mapping[str, str]
    folder: str = ""
    left_out: str = ""

    def missing(self) -> str:
        """Why none of the tests can be run; empty if they can."""
        for module in (self.name, *self.modules):
            try:
                importlib.import_module(module)
            except (ImportError, AttributeError, unittest.SkipTest) as error:
                return f"{module} cannot be imported: {error}"
        return ""

    def cases(self) -> Iterator[unittest.TestCase]:
        """Each of its tests."""
        for module, names in self.modules.items():
            for name in names:
                kind = getattr(importlib.import_module(module), name)
                yield from _flat(unittest.defaultTestLoader.loadTestsFromTestCase(kind))


def _flat(suite: Any) -> Iterator[unittest.TestCase]:
    for part in suite:
        if isinstance(part, unittest.TestSuite):
            yield from _flat(part)
        else:
            yield part


@contextmanager
def _mujoco() -> Iterator[None]:
    from warpcam.compat import mujoco as front

    front.install()
    try:
        yield
    finally:
        front.uninstall()


@contextmanager
def _dm_control() -> Iterator[None]:
    from warpcam.compat import dm_control as front

    front.install()
    try:
        yield
    finally:
        front.uninstall()


@contextmanager
def _gymnasium() -> Iterator[None]:
    from warpcam.compat import gymnasium as front

    front.install()
    try:
        yield
    finally:
        front.uninstall()


@contextmanager
def _replaced(places: list[tuple[Any, str, Any]]) -> Iterator[None]:
    before = [(place, name, getattr(place, name)) for place, name, _ in places]
    for place, name, value in places:
        setattr(place, name, value)
    try:
        yield
    finally:
        for place, name, value in before:
            setattr(place, name, value)


def _mujoco_warp() -> AbstractContextManager[None]:
    import mujoco_warp

    from warpcam.compat import mujoco_warp as front

    calls = ("create_render_context", "refit_bvh", "render", "get_rgb", "get_depth", "get_segmentation")
    return _replaced([(mujoco_warp, name, getattr(front, name)) for name in calls])


def _newton() -> AbstractContextManager[None]:
    from warpcam.compat import newton as front

    modules = [importlib.import_module(name) for name in PROJECTS["newton"].modules]
    kinds = ("SensorCamera", "SensorTiledCamera")
    return _replaced([(one, kind, getattr(front, kind)) for one in modules for kind in kinds if hasattr(one, kind)])


PROJECTS: Mapping[str, Project] = {
    project.name: project
    for project in (
        Project("mujoco", {"mujoco.renderer_test": ("MuJoCoRendererTest",)}, _mujoco, MUJOCO),
        Project(
            "mujoco_warp",
            {
                "mujoco_warp._src.render_test": ("RenderTest",),
                "mujoco_warp._src.render_util_test": ("RenderUtilTest",),
            },
            _mujoco_warp,
            MUJOCO_WARP,
        ),
        Project(
            "newton",
            {
                "newton.tests.test_sensor_camera": ("TestSensorCamera", "TestSensorCameraDeformable"),
                "newton.tests.test_sensor_tiled_camera": ("TestSensorTiledCamera",),
                "newton.tests.test_sensor_tiled_camera_hdr_color": ("TestSensorTiledCameraHdrColor",),
                "newton.tests.test_sensor_tiled_camera_heightfield": ("TestSensorTiledCameraHeightfield",),
                "newton.tests.test_sensor_tiled_camera_particles_multiworld": (
                    "TestSensorTiledCameraParticlesMultiworld",
                ),
                "newton.tests.test_sensor_to_rgba": ("TestToRgba",),
                "newton.tests.test_sensor_usd_camera": ("TestSensorCameraRays",),
            },
            _newton,
            NEWTON,
        ),
        Project(
            "dm_control",
            {
                "dm_control.mujoco.engine_test": ("MujocoEngineTest",),
                "dm_control.mujoco.render_test": ("RenderTest",),
                "dm_control.suite.wrappers.pixels_test": ("PixelsTest",),
            },
            _dm_control,
            DM_CONTROL,
        ),
        Project(
            "gymnasium",
            {},
            _gymnasium,
            GYMNASIUM,
            folder="tests/envs/mujoco/test_mujoco_rendering.py",
            left_out="human",
        ),
    )
}
