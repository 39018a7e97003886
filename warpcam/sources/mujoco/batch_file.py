"""Many worlds of one MJCF file, for the command line: MuJoCo-Warp holds them, each with joints of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.core.memory_errors import memory_told
from warpcam.sources.mujoco import mjcf_files, urdf

# How far a joint without limits is moved at most.
LOOSE_HINGE = 0.4  # [rad]
LOOSE_SLIDE = 0.05  # [m]
LOOSE_BALL = 0.4  # [rad], about each axis
FREE_SHIFT = 0.03  # [m]; never downwards, where a floor may be
FREE_TURN = 0.3  # [rad], about the vertical

DEMO = Path(__file__).parents[2] / "data" / "demo.xml"


@dataclass(frozen=True, eq=False)
class MujocoBatch:
    """A host model with its device Model and Data, as mujoco_warp made them."""

    host: Any
    model: Any
    data: Any


def load(
    path: Path,
    *,
    num_worlds: int,
    seed: int | None,
    device: wp.Device,
    packages: Mapping[str, Path] | None = None,
    access: FileAccess | None = None,
) -> MujocoBatch:
    """Read an MJCF or URDF file (or .mjb) and put `num_worlds` worlds of it on the device, posed and ready to be seen.

    World 0 is the scene as the file has it, with its first keyframe if there is one; the joints of the others
    are random within their ranges, or the same without a seed. ``packages`` are folders that a URDF file names;
    ``access`` is what files may be opened, by default as ``warpcam.load`` has it.
    """
    host, state = read(path, packages, access)
    batch = put(host, state, num_worlds=num_worlds, device=device, path=path)
    if seed is not None:
        batch.data.qpos.assign(joint_positions(host, state.qpos, num_worlds=num_worlds, seed=seed))
        forward(batch)
    return batch


def put(host: Any, state: Any, *, num_worlds: int, device: wp.Device, path: Path) -> MujocoBatch:
    """Put `num_worlds` worlds of one state on the device, ready to be seen; ``path`` is for messages."""
    mjw = _needed("mujoco_warp")
    try:
        with memory_told(f"scene {str(path)!r}"), wp.ScopedDevice(device):
            batch = MujocoBatch(host, mjw.put_model(host), mjw.put_data(host, state, nworld=num_worlds))
    except WarpcamError:
        raise
    except Exception as error:  # of any kind: MuJoCo-Warp does not look at all that MuJoCo allows
        raise WarpcamError(f"scene: MuJoCo-Warp cannot simulate {str(path)!r}: {error}") from error
    forward(batch)
    return batch


def forward(batch: MujocoBatch) -> None:
    """Compute the poses of bodies, geoms, cameras and lights from the joints."""
    import mujoco_warp as mjw

    with wp.ScopedDevice(batch.data.qpos.device):
        mjw.kinematics(batch.model, batch.data)
        mjw.com_pos(batch.model, batch.data)
        mjw.camlight(batch.model, batch.data)


def read(path: Path, packages: Mapping[str, Path] | None = None, access: FileAccess | None = None) -> tuple[Any, Any]:
    """The host's model and state of an MJCF or URDF file (or .mjb), at its first keyframe if there is one."""
    mujoco = _needed("mujoco")
    access = access or FileAccess(path)
    try:
        if path.suffix.lower() == ".urdf":
            host = urdf.load(path, access, packages)
        elif path.suffix.lower() == ".mjb":
            access.check_file(path)
            host = mujoco.MjModel.from_binary_path(str(path))
        else:
            host = mjcf_files.read_spec(path, access).compile()
    except WarpcamError:
        raise
    except ValueError as error:
        raise WarpcamError(f"scene: MuJoCo cannot read {str(path)!r}: {' '.join(str(error).split())}") from None
    state = mujoco.MjData(host)
    restart(host, state)
    return host, state


def read_spec(path: Path, access: FileAccess) -> Any:
    """The MjSpec of an MJCF or URDF file, for changes before it is compiled."""
    _needed("mujoco")
    if path.suffix.lower() == ".mjb":
        raise WarpcamError(f"scene: {str(path)!r} is compiled, and cannot be changed; give the .xml or .urdf file")
    try:
        return (urdf.load_spec if path.suffix.lower() == ".urdf" else mjcf_files.read_spec)(path, access)
    except WarpcamError:
        raise
    except ValueError as error:
        raise WarpcamError(f"scene: MuJoCo cannot read {str(path)!r}: {' '.join(str(error).split())}") from None


def restart(host: Any, state: Any) -> None:
    """Take a state back to where its file begins."""
    mujoco = _needed("mujoco")
    if host.nkey:
        mujoco.mj_resetDataKeyframe(host, state, 0)
    else:
        mujoco.mj_resetData(host, state)
    mujoco.mj_forward(host, state)


def moved(host: Any, positions: np.ndarray, *, seed: int, by: float = 0.1) -> np.ndarray:
    """Joint positions, (world, nq), with every joint a part of the way to other random positions."""
    other = joint_positions(host, positions[0], num_worlds=len(positions) + 1, seed=seed)[1:]
    return positions + by * (other - positions)


def joint_positions(host: Any, start: np.ndarray, *, num_worlds: int, seed: int) -> np.ndarray:
    """Joint positions, (world, nq) float32: world 0 is `start`, the others are of ``varied_joints``."""
    random, others = np.random.default_rng(seed), num_worlds - 1
    numbers = [random.random((others, count)) for count in joint_numbers(host)]
    varied = varied_joints(host, start, np.concatenate([np.zeros((others, 0)), *numbers], axis=1))
    return np.concatenate((np.asarray(start, np.float32)[None], varied))


def joint_numbers(host: Any) -> list[int]:
    """How many random numbers ``varied_joints`` takes at a time, joint after joint."""
    from mujoco import mjtJoint

    counts = {
        mjtJoint.mjJNT_HINGE: [1],
        mjtJoint.mjJNT_SLIDE: [1],
        mjtJoint.mjJNT_BALL: [3],
        mjtJoint.mjJNT_FREE: [3, 3],
    }
    return [count for kind in host.jnt_type for count in counts[mjtJoint(kind)]]


def varied_joints(host: Any, start: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Joint positions around `start`, (world, nq) float32, that follow from random numbers from 0 to 1, (world, n).

    A hinge or slide with limits takes any value within them; every other joint moves a little.
    """
    from mujoco import mjtJoint

    varied, first = np.tile(np.asarray(start, dtype=np.float64), (len(numbers), 1)), 0

    def between(low: Any, high: Any, count: int) -> np.ndarray:
        nonlocal first
        first += count
        return np.asarray(low) + np.subtract(high, low) * numbers[:, first - count : first]

    kinds = [mjtJoint(kind) for kind in host.jnt_type]  # the numbers themselves do not compare equal to the enum
    for kind, address, limited, limits in zip(kinds, host.jnt_qposadr, host.jnt_limited, host.jnt_range, strict=True):
        if kind in (mjtJoint.mjJNT_HINGE, mjtJoint.mjJNT_SLIDE):
            if limited:
                varied[:, address] = between(float(limits[0]), float(limits[1]), 1)[:, 0]
            else:
                reach = LOOSE_HINGE if kind == mjtJoint.mjJNT_HINGE else LOOSE_SLIDE
                varied[:, address] += between(-reach, reach, 1)[:, 0]
        elif kind == mjtJoint.mjJNT_BALL:
            turn = between(-LOOSE_BALL, LOOSE_BALL, 3)
            varied[:, address : address + 4] = rotated(varied[:, address : address + 4], turn)
        else:
            varied[:, address : address + 3] += between((-FREE_SHIFT, -FREE_SHIFT, 0.0), (FREE_SHIFT,) * 3, 3)
            turn = between((0.0, 0.0, -FREE_TURN), (0.0, 0.0, FREE_TURN), 3)
            varied[:, address + 3 : address + 7] = rotated(varied[:, address + 3 : address + 7], turn)
    return varied.astype(np.float32)


def rotated(quaternions: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) wxyz, turned by rotation vectors (n, 3) [rad] in the parent's frame."""
    angles = np.linalg.norm(turns, axis=1, keepdims=True)
    # sinc, because a turn of zero has no axis.
    w, v = np.cos(0.5 * angles), 0.5 * turns * np.sinc(0.5 * angles / np.pi)
    qw, qv = quaternions[:, :1], quaternions[:, 1:]
    return np.hstack([w * qw - np.sum(v * qv, axis=1, keepdims=True), w * qv + qw * v + np.cross(v, qv)])


def free_camera(host: Any | None, lower: np.ndarray, upper: np.ndarray, aspect: float) -> dict[str, Any]:
    """Return the arguments of a Camera where MuJoCo's default free camera would be, moved back until the box fits.

    Args:
        host: the model, for the free camera's angles and field of view; None for what MuJoCo has by itself.
        lower, upper: corners of what is to be seen [m], (3,).
        aspect: width of the image over its height.
    """
    from warpcam.camera.lens import Pinhole

    view = host.vis.global_ if host is not None else None
    azimuth, elevation = np.radians((90.0, -45.0) if view is None else (view.azimuth, view.elevation))
    fovy = 45.0 if view is None else float(view.fovy)
    center = 0.5 * (lower + upper)
    radius = max(0.5 * float(np.linalg.norm(upper - lower)), 1e-3)
    half = np.radians(0.5 * fovy)
    narrow = min(half, np.arctan(aspect * np.tan(half)))
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    position = center - forward * radius / np.sin(narrow)
    # The camera's -Z looks level along azimuth 90 degrees (+Y) after a quarter turn about X; then pitch, then yaw.
    pitch, yaw = 0.5 * (elevation + 0.5 * np.pi), 0.5 * (azimuth - 0.5 * np.pi)
    rotation = (
        np.cos(yaw) * np.cos(pitch),
        np.cos(yaw) * np.sin(pitch),
        np.sin(yaw) * np.sin(pitch),
        np.sin(yaw) * np.cos(pitch),
    )
    return {"position": position, "rotation": rotation, "lens": Pinhole(fovy=fovy)}


def _needed(name: str) -> Any:
    """MuJoCo, or MuJoCo-Warp, which need not be installed for anything else."""
    try:
        return import_module(name)
    except ImportError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and scenes need it: pip install 'warpcam[mujoco]'"
        ) from None
