"""Problem that all renderers of a case share.

It holds the model, its worlds on the device, and the sets of poses they move through.
"""

import warnings
from dataclasses import dataclass, field

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from warpcam.benchmarks.cases import Case, Wanted
from warpcam.core.errors import WarpcamError

# A frame is timed in each of these sets in turn, so that no world stays where it is from one frame to the next.
POSE_SETS = 4
# What renderers read of a state, kept for every set.
LIVE = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir", "xpos", "xquat", "flexvert_xpos")


@dataclass
class Problem:
    """A scene in many worlds, each in poses of its own, and the cameras that look at it."""

    case: Case
    mjm: mujoco.MjModel
    m: mjw.Model
    d: mjw.Data
    worlds: int
    width: int
    height: int
    poses: list[dict[str, wp.array]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for index in range(POSE_SETS):
            self.d.qpos.assign(self.positions(index))
            mjw.kinematics(self.m, self.d)
            mjw.com_pos(self.m, self.d)
            mjw.camlight(self.m, self.d)
            mjw.flex(self.m, self.d)
            self.poses.append({name: wp.clone(getattr(self.d, name)) for name in LIVE})
        self.place(0)
        wp.synchronize_device(self.d.qpos.device)

    def positions(self, index: int) -> np.ndarray:
        """Joint positions of all worlds in one set of poses, (world, nq) float32."""
        start = self.mjm.key_qpos[0] if self.case.keyframe and self.mjm.nkey else self.mjm.qpos0
        return random_positions(self.mjm, start, self.worlds, self.case.scatter, seed=index)

    def place(self, index: int) -> None:
        """Put every world into its pose of this set: copies from device to device, which a graph can hold."""
        for name, array in self.poses[index].items():
            if array.size:
                wp.copy(getattr(self.d, name), array)

    def resize(self, width: int, height: int) -> None:
        """Take another size of images [pixels], which renderers heed when they are prepared next."""
        self.width, self.height = width, height

    @property
    def cameras(self) -> tuple[str, ...]:
        return self.case.cameras

    @property
    def camera_ids(self) -> list[int]:
        return [self.mjm.camera(name).id for name in self.cameras]

    @property
    def rays(self) -> int:
        """Rays in one frame, one a pixel."""
        return self.worlds * len(self.cameras) * self.width * self.height

    def drawn_geoms(self) -> np.ndarray:
        """Ids of the geoms all renderers draw: groups 0 to 2 that are not wholly transparent."""
        return np.flatnonzero((self.mjm.geom_group <= 2) & (self.colors()[:, 3] > 0.0))

    def colors(self) -> np.ndarray:
        """Display colour of each geom, (geom, 4): its own, or its material's where it has none."""
        rgba = self.mjm.geom_rgba.copy()
        with_material = (self.mjm.geom_matid >= 0) & (rgba == (0.5, 0.5, 0.5, 1.0)).all(axis=1)
        rgba[with_material] = self.mjm.mat_rgba[self.mjm.geom_matid[with_material]]
        return rgba

    def one_id(self, ids: np.ndarray, kinds: np.ndarray) -> np.ndarray:
        """A number for each pair of an id and its `mjtObj`: geoms have their ids, flexes count on from there."""
        return np.where(kinds == mujoco.mjtObj.mjOBJ_FLEX, ids + self.mjm.ngeom, ids)

    def faces(self) -> int:
        """Triangles of all meshes, cloths and flexes one world draws."""
        drawn = self.drawn_geoms()
        meshes = self.mjm.geom_dataid[drawn[self.mjm.geom_type[drawn] == mujoco.mjtGeom.mjGEOM_MESH]]
        cloth = 0 if self.case.cloth is None else 2 * int(np.prod(self.case.cloth.cells))
        flexes = int(self.mjm.flex_shellnum.sum()) if self.case.flexes else 0
        return int(self.mjm.mesh_facenum[meshes].sum()) + cloth + flexes

    def facts(self, wanted: Wanted) -> dict[str, object]:
        """Return the description of the problem in a row of the results."""
        return {
            "case": self.case.name,
            "worlds": self.worlds,
            "width": self.width,
            "height": self.height,
            "cameras": len(self.cameras),
            "geoms": len(self.drawn_geoms()),
            "faces": self.faces(),
            "lights": int(self.mjm.nlight),
            "lights_casting": int(self.mjm.light_castshadow.sum()),
            "outputs": wanted.name,
            "shadows": wanted.shadows,
            "textures": wanted.textures,
            "rays": self.rays,
        }


def compile_case(case: Case) -> mujoco.MjModel:
    """The compiled model; cameras without a name are called camera0, camera1, ... by their index."""
    spec = case.spec()
    for index, camera in enumerate(spec.cameras):
        camera.name = camera.name or f"camera{index}"
    with warnings.catch_warnings():  # some scenes join models whose solver settings differ; nothing is solved here
        warnings.simplefilter("ignore")
        return spec.compile()


def build(case: Case, worlds: int, width: int, height: int) -> Problem:
    mjm = compile_case(case)
    missing = set(case.cameras) - {mjm.camera(index).name for index in range(mjm.ncam)}
    if missing:
        raise WarpcamError(f"bench: {case.name} has no camera {', '.join(sorted(missing))}")
    m = mjw.put_model(mjm)
    # Nothing is simulated: room for contacts and constraints would only take memory.
    d = mjw.make_data(mjm, nworld=worlds, naconmax=1, naccdmax=1, njmax=1, njmax_nnz=1)
    return Problem(case, mjm, m, d, worlds, width, height)


def random_positions(
    mjm: mujoco.MjModel, around: np.ndarray, worlds: int, scatter: tuple[float, float], seed: int
) -> np.ndarray:
    """Joint positions (world, nq) float32 around others, (nq,).

    Joints with a range move over half of it, others by 0.5 rad or 5 cm; free bodies by `scatter`.
    """
    random = np.random.default_rng(seed)
    qpos = np.tile(around.astype(np.float32), (worlds, 1))
    for joint in range(mjm.njnt):
        start, kind = mjm.jnt_qposadr[joint], mjm.jnt_type[joint]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            position, rotation = slice(start, start + 3), slice(start + 3, start + 7)
            qpos[:, position] += scatter[0] * random.uniform(-1.0, 1.0, (worlds, 3))
            qpos[:, rotation] = rotated(qpos[:, rotation], scatter[1] * random.uniform(-1.0, 1.0, (worlds, 3)))
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            rotation = slice(start, start + 4)
            qpos[:, rotation] = rotated(qpos[:, rotation], random.uniform(-0.5, 0.5, (worlds, 3)))
        else:
            amount = 0.5 if kind == mujoco.mjtJoint.mjJNT_HINGE else 0.05
            low, high = qpos[0, start] - amount, qpos[0, start] + amount
            if mjm.jnt_limited[joint]:
                low, high = 0.5 * (qpos[0, start] + mjm.jnt_range[joint])
            qpos[:, start] = random.uniform(low, high, worlds)
    return qpos


def rotated(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) wxyz turned by rotation vectors (n, 3) [rad]."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = vectors / np.maximum(angle, 1e-9)
    w, v = quaternions[:, :1], quaternions[:, 1:]
    c, s = np.cos(0.5 * angle), np.sin(0.5 * angle) * axis
    return np.concatenate([w * c - (v * s).sum(1, keepdims=True), w * s + c * v + np.cross(v, s)], axis=1)
