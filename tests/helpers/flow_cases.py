"""A small scene whose shapes and camera are moved by hand, and how far what is seen then moves, by definition."""

from collections.abc import Mapping
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import scenes
import warp as wp

import warpcam as wc

WIDTH, HEIGHT = 48, 32
OUTPUTS = ("flow", "flow_valid", "depth", "segmentation", "points")
WALL, BOX, BALL = 0, 1, 2
MODEL = """
  <geom name="wall" type="plane" size="0 0 1" pos="0 0 -4"/>
  <body pos="-.4 .1 -3"><freejoint/><geom name="box" type="box" size=".5 .4 .3"/></body>
  <body pos=".8 -.2 -2.8"><freejoint/><geom name="ball" size=".45"/></body>
"""
LENSES = {
    "pinhole": wc.Pinhole(fovy=60.0),
    "intrinsics": wc.Pinhole(fx=30.0, fy=33.0, cx=22.0, cy=17.5),
    "orthographic": wc.Orthographic(height=4.0),
}


def turn(*axis_angle: float) -> np.ndarray:
    """Rotation matrix of a rotation vector [rad]."""
    vector = np.asarray(axis_angle, np.float64)
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    quaternion, flat = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quaternion, vector / angle, angle)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)


class Moving:
    """The scene in some worlds, and a renderer of it."""

    def __init__(
        self,
        lens: str | wc.Lens = "pinhole",
        num_worlds: int = 1,
        outputs: tuple[str, ...] = OUTPUTS,
        world: str = MODEL,
        assets: str = "",
        graph: bool = True,
        **camera: Any,
    ):
        self.mjm = scenes.compile_xml(world, assets=assets)
        self.m, self.d = scenes.put(self.mjm, num_worlds)
        self.scene = wc.from_mujoco_warp(self.mjm, self.m, self.d)
        self.camera = scenes.own_camera(
            lens=LENSES[lens] if isinstance(lens, str) else lens,
            outputs=outputs,
            **{"width": WIDTH, "height": HEIGHT, **camera},
        )
        self.renderer = wc.Renderer(self.scene, [self.camera], graph=graph)
        self.images = self.renderer.images["eye"]
        self.arrays = self.renderer.camera("eye")

    def see(self, **options: Any) -> dict[str, np.ndarray]:
        """Another frame, on the host."""
        self.renderer.render(**options)
        return scenes.on_host(self.images)

    def move(
        self, shape: int, by: Any = (0.0, 0.0, 0.0), turned: Any = (0.0, 0.0, 0.0), world: Any = slice(None)
    ) -> None:
        """Shift a shape [m], and turn it about its middle [rad]."""
        if np.any(by):
            scenes.write(self.d.geom_xpos, (world, shape), self.d.geom_xpos.numpy()[world, shape] + np.asarray(by))
        if np.any(turned):
            rotation = self.d.geom_xmat.numpy()[world, shape]
            scenes.write(self.d.geom_xmat, (world, shape), turn(*turned) @ rotation)

    def move_camera(self, by: Any = (0.0, 0.0, 0.0), rotation: Any = None) -> None:
        self.arrays.position += np_to(self.arrays.position, by)
        if rotation is not None:
            self.arrays.rotation[:] = np_to(self.arrays.rotation, rotation)

    def state(self) -> dict[str, np.ndarray]:
        """Return the present state of all objects."""
        names = ("fovy", "height", "intrinsics")
        lens = {name: getattr(self.arrays, name).cpu().numpy().copy() for name in names if hasattr(self.arrays, name)}
        return {
            "positions": self.d.geom_xpos.numpy().copy(),
            "rotations": self.d.geom_xmat.numpy().copy(),
            "sizes": np.broadcast_to(self.m.geom_size.numpy(), (*self.d.geom_xpos.shape, 3)).copy(),
            "position": self.arrays.position.cpu().numpy().copy(),
            "rotation": self.arrays.rotation.cpu().numpy().copy(),
            **lens,
        }


def np_to(like: Any, value: Any) -> Any:
    """``value`` as a tensor beside another."""
    import torch

    return torch.tensor(np.asarray(value, np.float32), device=like.device)


def pixels_of(points: np.ndarray, state: Mapping[str, np.ndarray], world: int, size: tuple[int, int]) -> np.ndarray:
    """Column and row where points (..., 3) of the world's frame lie in an image of width and height, float64."""
    width, height = size
    away = (points - state["position"][world]) @ scenes.matrix(state["rotation"][world])
    if "height" in state:
        scale = state["height"][world] / height
        return np.stack((width / 2 + away[..., 0] / scale, height / 2 - away[..., 1] / scale), axis=-1) - 0.5
    if "fovy" in state:
        focal = 0.5 * height / np.tan(0.5 * np.radians(float(state["fovy"][world])))
        fx, fy, cx, cy = focal, focal, width / 2, height / 2
    else:
        fx, fy, cx, cy = state["intrinsics"][world].astype(np.float64)
    x, y = away[..., 0] / -away[..., 2], away[..., 1] / -away[..., 2]
    return np.stack((cx + fx * x, cy - fy * y), axis=-1) - 0.5


def expected(
    seen: Mapping[str, np.ndarray], now: Mapping[str, np.ndarray], then: Mapping[str, np.ndarray], world: int = 0
) -> np.ndarray:
    """The flow of what is seen, (height, width, 2), 0 where nothing is."""
    shape, points = seen["segmentation"][world], seen["points"][world].astype(np.float64)
    height, width = shape.shape
    rows, columns = np.mgrid[:height, :width]
    flow = np.zeros((height, width, 2))
    for each in np.unique(shape[shape >= 0]):
        here = shape == each
        local = (points[here] - now["positions"][world, each]) @ now["rotations"][world, each]
        local *= _ratio(then["sizes"][world, each], now["sizes"][world, each])
        place = then["positions"][world, each] + local @ then["rotations"][world, each].T
        flow[here] = np.stack((columns, rows), -1)[here] - pixels_of(place, then, world, (width, height))
    return flow


def _ratio(then: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return the ratio of a box's or a ball's previous to its present size; planes stay as they are."""
    if not now[1:].any():
        then, now = np.repeat(then[0], 3), np.repeat(now[0], 3)
    return then / now if now.all() else np.ones(3)


def write_sizes(m: mjw.Model, shape: int, size: Any) -> None:
    scenes.write(m.geom_size, (slice(None), shape), size)


def warped(image: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """An image (height, width, channels) as it would have to look now, by where each pixel was: bilinear."""
    height, width = image.shape[:2]
    rows, columns = np.mgrid[:height, :width]
    x = np.clip(columns - flow[..., 0], 0, width - 1)
    y = np.clip(rows - flow[..., 1], 0, height - 1)
    left, top = np.minimum(x.astype(int), width - 2), np.minimum(y.astype(int), height - 2)
    u, v = (x - left)[..., None], (y - top)[..., None]
    image = image.astype(np.float64)
    upper = image[top, left] * (1 - u) + image[top, left + 1] * u
    lower = image[top + 1, left] * (1 - u) + image[top + 1, left + 1] * u
    return upper * (1 - v) + lower * v


def array(values: Any, dtype: Any, device: wp.Device) -> wp.array:
    return wp.array(np.asarray(values), dtype=dtype, device=device)
