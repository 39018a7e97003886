"""Slider-cranks as MuJoCo draws them: a rod along the slider's axis, and a crank from where it ends to its site."""

import mujoco
import numpy as np


def count_drives(mjm: mujoco.MjModel) -> int:
    """Return the number of actuators with an id in ``segmentation``: all of them, if some are slider-cranks."""
    return mjm.nu if len(cranks_of(mjm)) else 0


def cranks_of(mjm: mujoco.MjModel) -> np.ndarray:
    """Ids of the actuators that are slider-cranks."""
    return np.flatnonzero(mjm.actuator_trntype == mujoco.mjtTrn.mjTRN_SLIDERCRANK)


def colors_of_cranks(mjm: mujoco.MjModel) -> np.ndarray:
    """(2, 4) float32: of those that reach, and of those that are too short."""
    return np.stack((mjm.vis.rgba.slidercrank, mjm.vis.rgba.crankbroken)).astype(np.float32)


def radius_of_rods(mjm: mujoco.MjModel) -> float:
    """[m]; a crank has half of it."""
    return float(mjm.stat.meansize * mjm.vis.scale.slidercrank)
