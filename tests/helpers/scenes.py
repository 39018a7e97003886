"""Small scenes to look at, cameras to look with, and where the models of installed packages are."""

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

import warpcam as wc

ALL_GROUPS = (0, 1, 2, 3, 4, 5)
DEGREE = np.pi / 180.0

# One shape of each type, each on a body of its own that is moved by hand. Index and name are those of the geom.
TYPES = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")
SIZES = {
    "plane": (0.9, 0.6, 0.1),
    "sphere": (0.5,),
    "capsule": (0.3, 0.4),
    "ellipsoid": (0.6, 0.4, 0.3),
    "cylinder": (0.4, 0.5),
    "box": (0.5, 0.4, 0.3),
}
CUBE = "-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"
CUBE_FACES = "0 2 1 1 2 3  4 5 6 5 7 6  0 1 4 1 5 4  2 6 3 3 6 7  0 4 2 2 4 6  1 3 5 3 7 5"
ASSETS = f"""
  <mesh name="mesh" vertex="{CUBE}" face="{CUBE_FACES}" scale="0.5 0.4 0.3"/>
  <hfield name="hfield" nrow="3" ncol="4" size="0.6 0.5 0.4 0.2" elevation="0 1 2 3  0 1 2 3  0 1 2 3"/>
"""


def compile_xml(world: str, *, assets: str = "", more: str = "") -> mujoco.MjModel:
    """A model of what stands in the world body and the asset section."""
    return mujoco.MjModel.from_xml_string(
        f"<mujoco>{more}<asset>{assets}</asset><worldbody>{world}</worldbody></mujoco>"
    )


def geom_xml(kind: str, name: str = "", more: str = "", size: Sequence[float] | None = None) -> str:
    """A geom of the type; a mesh or height field is the asset of the type's name."""
    chosen = SIZES.get(kind) if size is None else size
    what = f'{kind}="{kind}"' if kind in ("mesh", "hfield") else f'size="{" ".join(map(str, chosen))}"'
    return f'<geom name="{name or kind}" type="{kind}" {what} {more}/>'


def forward(mjm: mujoco.MjModel) -> mujoco.MjData:
    """The model's first keyframe if there is one, else its start."""
    mjd = mujoco.MjData(mjm)
    if mjm.nkey:
        mujoco.mj_resetDataKeyframe(mjm, mjd, 0)
    mujoco.mj_forward(mjm, mjd)
    return mjd


def put(
    mjm: mujoco.MjModel, num_worlds: int, *, mjd: mujoco.MjData | None = None, batch: Mapping[str, int] | None = None
) -> tuple[mjw.Model, mjw.Data]:
    """Worlds of the model on the current device, with room for hardly any contact: nothing is simulated."""
    mjd = forward(mjm) if mjd is None else mjd
    m = mjw.put_model(mjm, batch_sizes=dict(batch)) if batch else mjw.put_model(mjm)
    return m, mjw.put_data(mjm, mjd, nworld=num_worlds, nconmax=64, njmax=256)


def write(array: wp.array, index: Any, value: Any) -> None:
    """``array[index] = value`` in place, whatever device it is on."""
    host = array.numpy()
    host[index] = value
    array.assign(host)


def matrix(quaternion: Any) -> np.ndarray:
    """Rotation matrix, (3, 3) float64, of a quaternion w x y z."""
    flat = np.zeros(9)
    unit = np.asarray(quaternion, np.float64)
    mujoco.mju_quat2Mat(flat, unit / np.linalg.norm(unit))
    return flat.reshape(3, 3)


def looking(position: Any, target: Any, up: Any = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Quaternion w x y z of a camera at ``position`` that has ``target`` in its centre."""
    backward = np.asarray(position, np.float64) - np.asarray(target, np.float64)
    backward /= np.linalg.norm(backward)
    right = np.cross(up, backward)
    if np.linalg.norm(right) < 1e-6:
        right = np.cross((0.0, 1.0, 0.0), backward)
    right /= np.linalg.norm(right)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.stack((right, np.cross(backward, right), backward), axis=1).reshape(9))
    return quaternion


def pixel_rays(width: int, height: int, fovy: float) -> np.ndarray:
    """Camera-frame direction (x, y, -1) through the centre of each pixel, (height, width, 3) float64."""
    scale = 2.0 * np.tan(0.5 * fovy * DEGREE) / height
    row, column = np.mgrid[:height, :width]
    x, y = (column + 0.5 - 0.5 * width) * scale, (0.5 * height - row - 0.5) * scale
    return np.stack((x, y, np.full(x.shape, -1.0)), axis=-1)


def own_camera(**changes: Any) -> wc.Camera:
    """A camera of one's own, called "eye", at the origin; 32 x 32 pixels, depth and segmentation."""
    settings: dict[str, Any] = {
        "width": 32,
        "height": 32,
        "outputs": ("depth", "segmentation"),
        "lens": wc.Pinhole(fovy=60.0),
        "position": (0.0, 0.0, 0.0),
    }
    return wc.Camera("eye", **{**settings, **changes})


def on_host(images: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Copies; images of one channel lose that dimension."""
    return {
        name: (image[..., 0] if image.shape[-1] == 1 else image).cpu().numpy().copy() for name, image in images.items()
    }


def look(scene: wc.Scene, camera: wc.Camera, **options: Any) -> dict[str, np.ndarray]:
    """One frame of one camera, on the host."""
    return on_host(wc.Renderer(scene, [camera], **options).render()[camera.name])


def package_folder(package: str) -> Path | None:
    """Return the folder of an installed package, without importing it; None if it is not installed."""
    spec = importlib.util.find_spec(package)
    return Path(spec.origin).parent if spec is not None and spec.origin else None


MUJOCO_WARP_MODELS = Path(mjw.__file__).parent / "test_data"
