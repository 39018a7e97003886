"""Weights that attach the vertices of MuJoCo's skins to its bodies."""

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True, eq=False)
class BoneWeights:
    """How the vertices of all skins hang on bodies: see ``kernels.update.skinning.SkinWeights``."""

    starts: np.ndarray
    bodies: np.ndarray
    places: np.ndarray


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """(3, 3) float64."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, quaternion.astype(np.float64))
    return turn.reshape(3, 3)


def no_bone_weights() -> BoneWeights:
    return BoneWeights(np.zeros(1, np.int32), np.zeros(0, np.int32), np.zeros((0, 4), np.float32))


def bone_weights_of(mjm: mujoco.MjModel) -> BoneWeights:
    vertices, bodies, places = [], [], []
    for skin in range(mjm.nskin):
        for bone in range(mjm.skin_boneadr[skin], mjm.skin_boneadr[skin] + mjm.skin_bonenum[skin]):
            rows = slice(mjm.skin_bonevertadr[bone], mjm.skin_bonevertadr[bone] + mjm.skin_bonevertnum[bone])
            own = mjm.skin_vertadr[skin] + mjm.skin_bonevertid[rows]
            local = (mjm.skin_vert[own] - mjm.skin_bonebindpos[bone]) @ matrix_of(mjm.skin_bonebindquat[bone])
            vertices.append(own)
            bodies.append(np.full(len(own), mjm.skin_bonebodyid[bone]))
            places.append(np.column_stack((local, mjm.skin_bonevertweight[rows])))
    of = np.concatenate(vertices)
    order = np.argsort(of, kind="stable")
    starts = np.r_[0, np.cumsum(np.bincount(of, minlength=mjm.nskinvert))]
    return BoneWeights(
        starts.astype(np.int32),
        np.concatenate(bodies)[order].astype(np.int32),
        np.concatenate(places)[order].astype(np.float32),
    )
