"""Projects whose tests are run: where the tests are, what takes the place of what, and which tests differ and why."""

import importlib
import unittest
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest

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
def _installed(front: str) -> Iterator[None]:
    """A front end in place by its own ``install``."""
    module = importlib.import_module(f"warpcam.compat.{front}")
    module.install()
    try:
        yield
    finally:
        module.uninstall()


@contextmanager
def _replaced(front: str, names: tuple[str, ...], modules: Iterable[str]) -> Iterator[None]:
    """Names of a front end in place of those that modules have."""
    ours = importlib.import_module(f"warpcam.compat.{front}")
    with pytest.MonkeyPatch.context() as patch:
        for module in map(importlib.import_module, modules):
            for name in names:
                if hasattr(module, name):
                    patch.setattr(module, name, getattr(ours, name))
        yield


CALLS = ("create_render_context", "refit_bvh", "render", "get_rgb", "get_depth", "get_segmentation")
NEWTON_TESTS: Mapping[str, tuple[str, ...]] = {
    "newton.tests.test_sensor_camera": ("TestSensorCamera", "TestSensorCameraDeformable"),
    "newton.tests.test_sensor_tiled_camera": ("TestSensorTiledCamera",),
    "newton.tests.test_sensor_tiled_camera_hdr_color": ("TestSensorTiledCameraHdrColor",),
    "newton.tests.test_sensor_tiled_camera_heightfield": ("TestSensorTiledCameraHeightfield",),
    "newton.tests.test_sensor_tiled_camera_particles_multiworld": ("TestSensorTiledCameraParticlesMultiworld",),
    "newton.tests.test_sensor_to_rgba": ("TestToRgba",),
    "newton.tests.test_sensor_usd_camera": ("TestSensorCameraRays",),
}

PROJECTS: Mapping[str, Project] = {
    project.name: project
    for project in (
        Project("mujoco", {"mujoco.renderer_test": ("MuJoCoRendererTest",)}, partial(_installed, "mujoco"), MUJOCO),
        Project(
            "mujoco_warp",
            {
                "mujoco_warp._src.render_test": ("RenderTest",),
                "mujoco_warp._src.render_util_test": ("RenderUtilTest",),
            },
            partial(_replaced, "mujoco_warp", CALLS, ("mujoco_warp",)),
            MUJOCO_WARP,
        ),
        Project(
            "newton",
            NEWTON_TESTS,
            partial(_replaced, "newton", ("SensorCamera", "SensorTiledCamera"), NEWTON_TESTS),
            NEWTON,
        ),
        Project(
            "dm_control",
            {
                "dm_control.mujoco.engine_test": ("MujocoEngineTest",),
                "dm_control.mujoco.render_test": ("RenderTest",),
                "dm_control.suite.wrappers.pixels_test": ("PixelsTest",),
            },
            partial(_installed, "dm_control"),
            DM_CONTROL,
        ),
        Project(
            "gymnasium",
            {},
            partial(_installed, "gymnasium"),
            GYMNASIUM,
            folder="tests/envs/mujoco/test_mujoco_rendering.py",
            left_out="human",
        ),
    )
}
