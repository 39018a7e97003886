"""Contacts one by one, on the host, as the solver has found them last."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.compat.isaacgym.api.enums import RIGID_CONTACT
from warpcam.compat.isaacgym.api.math_types import VEC3
from warpcam.compat.isaacgym.physics.environments import Env
from warpcam.core.errors import WarpcamError


@dataclass(frozen=True)
class ContactList:
    """What MuJoCo knows of contacts.

    Attributes:
        geoms: (contact, 2).
        worlds: (contact,).
        places: (contact, 3) in their worlds' frames [m].
        normals: (contact, 3) from the first geom to the second.
        gaps: (contact,) [m].
        reach: (contact,) gaps from which on there is a force [m].
        frictions: (contact, 5) sliding twice, spinning, rolling twice.
        forces: (contact, 3) along the normal and two tangents [N].
    """

    geoms: np.ndarray
    worlds: np.ndarray
    places: np.ndarray
    normals: np.ndarray
    gaps: np.ndarray
    reach: np.ndarray
    frictions: np.ndarray
    forces: np.ndarray


def contacts_of(solver: Any, model: newton.Model, state: newton.State, envs: Sequence[Env], where: str) -> np.ndarray:
    """(contact,) of ``RIGID_CONTACT``, of all environments; before the first step there are none."""
    if solver is None:
        return np.zeros(0, RIGID_CONTACT)
    if not hasattr(solver, "mjc_geom_to_newton_shape"):
        raise WarpcamError(f"{where}: MuJoCo cannot simulate this, and XPBD does not tell its contacts")
    found = _on_host(solver) if solver.use_mujoco_cpu else _on_device(solver, model.device)
    rows = np.zeros(len(found.worlds), RIGID_CONTACT)
    shapes, starts = solver.mjc_geom_to_newton_shape.numpy(), np.array([env.start.bodies for env in envs])
    poses = np.concatenate((state.body_q.numpy(), [(0.0,) * 6 + (1.0,)]))  # the last one is the ground's
    for side in range(2):
        shape = shapes[found.worlds, found.geoms[:, side]]
        body = np.where(shape >= 0, model.shape_body.numpy()[shape], -1)
        rows[f"body{side}"] = np.where(body >= 0, body - starts[found.worlds], -1)
        rows[f"env{side}"] = np.where(body >= 0, found.worlds, -1)
        rows[f"localPos{side}"] = _vectors(_back(poses[body], found.places))
    rows["minDist"], rows["initialOverlap"] = found.gaps, np.maximum(-found.gaps, 0.0)
    rows["normal"], rows["lambda"] = _vectors(found.normals), found.forces[:, 0]
    rows["lambdaFriction"]["x"], rows["lambdaFriction"]["y"] = found.forces[:, 1], found.forces[:, 2]
    for name, column in (("friction", 0), ("torsionFriction", 2), ("rollingFriction", 3)):
        rows[name] = found.frictions[:, column]
    return rows[found.gaps < found.reach]


def _on_host(solver: Any) -> ContactList:
    import mujoco

    model, data = solver.mj_model, solver.mj_data
    contact, forces = data.contact, np.zeros((data.ncon, 6))
    for index in range(data.ncon):
        mujoco.mj_contactForce(model, data, index, forces[index])
    return ContactList(
        geoms=contact.geom.reshape(-1, 2),
        worlds=np.zeros(data.ncon, np.int64),
        places=contact.pos.reshape(-1, 3),
        normals=contact.frame.reshape(-1, 9)[:, :3],
        gaps=contact.dist.reshape(-1),
        reach=contact.includemargin.reshape(-1),
        frictions=contact.friction.reshape(-1, 5),
        forces=forces[:, :3],
    )


def _on_device(solver: Any, device: wp.Device) -> ContactList:
    import mujoco_warp

    model, data = solver.mjw_model, solver.mjw_data
    count = min(int(data.nacon.numpy()[0]), data.naconmax)
    forces = wp.zeros(max(count, 1), dtype=wp.spatial_vector, device=device)
    if count:
        with wp.ScopedDevice(device):  # it launches on the current one
            ids = wp.array(np.arange(count, dtype=np.int32), dtype=wp.int32, device=device)
            mujoco_warp.contact_force(model, data, ids, False, forces)
    contact = data.contact
    return ContactList(
        geoms=contact.geom.numpy()[:count],
        worlds=contact.worldid.numpy()[:count],
        places=contact.pos.numpy()[:count],
        normals=contact.frame.numpy()[:count, 0],
        gaps=contact.dist.numpy()[:count],
        reach=contact.includemargin.numpy()[:count],
        frictions=contact.friction.numpy()[:count],
        forces=forces.numpy()[:count, :3],
    )


def _back(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points in the frames of poses, (n, 7)."""
    away, axis, real = points - poses[:, :3], -poses[:, 3:6], poses[:, 6:]
    turned = 2.0 * np.cross(axis, away)
    return away + real * turned + np.cross(axis, turned)


def _vectors(rows: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(rows, np.float32).view(VEC3)[:, 0]
