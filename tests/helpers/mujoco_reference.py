"""MuJoCo's own renderer, as the judge of a test."""

import mujoco
import pytest


def reference_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    """Make a ``mujoco.Renderer``, or skip the test on a machine where it cannot run."""
    try:
        return mujoco.Renderer(model, height, width)
    except Exception as error:
        pytest.skip(
            "MuJoCo's own renderer needs a library on a machine without a display: apt-get install libosmesa6 "
            f"({type(error).__name__})"
        )
