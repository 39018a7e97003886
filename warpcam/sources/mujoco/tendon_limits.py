"""Tendons that MuJoCo draws in another colour where a limit holds them: those of no material and the colour of all."""

from dataclasses import dataclass

import mujoco
import numpy as np
import warp as wp

from warpcam.sources.mujoco.kernels.tendon_limits import TendonLimits
from warpcam.sources.mujoco.kernels.visual_geoms import ARC, SEGMENT, STRING

LEAST, MOST = 1e-4, 0.9999  # between which MuJoCo holds an impedance
UNLIMITED = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_LIMIT)  # each ends all limits


@dataclass(frozen=True, eq=False)
class LimitedTendons:
    """Constant parameters of limited tendons, by the entry of each of their columns: see ``kernels.strain.Limits``."""

    columns: np.ndarray
    paths: np.ndarray
    hangs: np.ndarray
    ranges: np.ndarray
    impedance: np.ndarray
    power: np.ndarray
    held: np.ndarray

    def upload(self, device: wp.Device) -> TendonLimits:
        limits = TendonLimits()
        for name, dtype in (
            *(("columns", wp.int32), ("paths", wp.int32), ("hangs", wp.bool)),
            *(("ranges", wp.vec3), ("impedance", wp.vec4), ("power", wp.float32)),
        ):
            setattr(limits, name, wp.array(getattr(self, name), dtype=dtype, device=device))
        limits.held = wp.vec3(*self.held)
        return limits


def find_limited_tendons(mjm: mujoco.MjModel, entries: np.ndarray) -> LimitedTendons | None:
    """Return the limited tendons among the entries of a table, (entry, 4); None if there are none.

    They are written to the entries' columns.
    """
    of_tendons = entries[np.isin(entries[:, 0], (SEGMENT, STRING, ARC))]
    limited = (mjm.tendon_limited != 0) & (mjm.tendon_matid < 0)
    limited &= np.array([_moves(mjm, tendon) for tendon in range(mjm.ntendon)], bool)
    off = mjm.opt.disableflags & UNLIMITED
    own = of_tendons[limited[of_tendons[:, 2]]] if mjm.ntendon and not off else of_tendons[:0]
    if not len(own):
        return None
    tendons = own[:, 2]
    solimp = mjm.tendon_solimp_lim[tendons].astype(np.float32)
    solimp[:, (0, 1, 3)] = solimp[:, (0, 1, 3)].clip(LEAST, MOST)
    return LimitedTendons(
        columns=own[:, 1],
        paths=tendons,
        hangs=own[:, 0] == STRING,
        ranges=np.column_stack((mjm.tendon_range[tendons], mjm.tendon_margin[tendons])).astype(np.float32),
        impedance=np.ascontiguousarray(solimp[:, :4]),
        power=np.maximum(solimp[:, 4], 1.0),
        held=np.array(mjm.vis.rgba.constraint[:3], np.float32),
    )


def _moves(mjm: mujoco.MjModel, tendon: int) -> bool:
    """Return whether a tendon's length may change: False if it is held between objects that are fixed to each other."""
    wrap = mujoco.mjtWrap
    path = slice(mjm.tendon_adr[tendon], mjm.tendon_adr[tendon] + mjm.tendon_num[tendon])
    kinds, things = mjm.wrap_type[path], mjm.wrap_objid[path]
    sites = mjm.site_bodyid[things[kinds == wrap.mjWRAP_SITE]]
    geoms = mjm.geom_bodyid[things[np.isin(kinds, (wrap.mjWRAP_SPHERE, wrap.mjWRAP_CYLINDER))]]
    return len(np.unique(mjm.body_weldid[np.concatenate((sites, geoms))])) > 1


def string_length(mjm: mujoco.MjModel, tendon: int) -> float:
    """Return the length of a slack tendon between two sites, as MuJoCo draws it; 0 for a tendon that is never slack.

    It is one that nothing but an upper bound of its length holds: a limit, or a spring that is free below.
    """

    def any_of(*names: str) -> bool:
        values = [getattr(mjm, f"tendon_{name}")[tendon] for name in names if hasattr(mjm, f"tendon_{name}")]
        return any(np.any(value) for value in values)

    stiff = any_of("stiffness", "stiffnesspoly")
    spring, limit = mjm.tendon_lengthspring[tendon], mjm.tendon_range[tendon]
    by_spring = stiff and spring[0] == 0.0 and spring[1] > 0.0
    by_limit = not stiff and bool(mjm.tendon_limited[tendon]) and limit[0] == 0.0
    driven = (mjm.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (mjm.actuator_trnid[:, 0] == tendon)
    falls = not mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY and np.any(mjm.opt.gravity)
    held = any_of("damping", "dampingpoly", "frictionloss") or driven.any()
    if not falls or held or mjm.tendon_num[tendon] != 2 or by_spring == by_limit:
        return 0.0
    return float(limit[1] if by_limit else spring[1])
