"""Renderers behind one env of training: warpcam, and peers whose images take the place of warpcam's."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import warp as wp

import warpcam as wc
from warpcam.benchmarks import peers
from warpcam.benchmarks.cases import Case, Wanted
from warpcam.benchmarks.problem import Problem
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.sensors.rig import Rig
from warpcam.train.mujoco_task import MujocoTask

WARPCAM, PLAIN = "warpcam", "warpcam-1-sample"
PEERS = ("mujoco_warp", "newton")
RENDERERS = (WARPCAM, PLAIN, *PEERS)
WANTED = Wanted("rgb", ("rgb",))
FRAMES = 10  # of each variant of a peer, of which the fastest is taken


def eyes(name: str, task: MujocoTask, width: int, height: int) -> wc.Renderer | Rig:
    """What the policy of a task sees.

    Args:
        name: "warpcam" is the task's own; "warpcam-1-sample" has one sample of a pixel, as peers have; the others are
            peers, which draw all worlds in each frame.
        task: What is looked at. Its state is lost.
        width: Of an image [pixels].
        height: Likewise.
    """
    if name == WARPCAM:
        return task.eyes(width, height)
    if task.output != "rgb":
        raise WarpcamError(f"--renderers: {name} came, but the task sees {task.output}, only {WARPCAM} is possible")
    camera = wc.Camera(task.camera, width=width, height=height, outputs=("rgb",), far=20.0)
    return wc.Renderer(task.scene, [camera]) if name == PLAIN else PeerEyes(name, task, camera)


class PeerEyes(wc.Renderer):
    """A renderer of warpcam in name: a peer draws, and its colours are put where warpcam's would be.

    Args:
        name: Of the peer.
        task: What is looked at.
        camera: One of the model's cameras.
    """

    def __init__(self, name: str, task: MujocoTask, camera: wc.Camera):
        super().__init__(task.scene, [camera])
        case = Case("task", "", mujoco.MjSpec, (camera.name,))
        sizes = (task.num_envs, camera.width, camera.height)
        device = task.scene.device
        with wp.ScopedDevice(device):
            problem = Problem(case, task.host, task.model, task.data, *sizes)
            self._peer: Any = peers.create(name, problem)
            self._peer.prepare(WANTED)
            self._bring = follow_newton(self._peer, problem) if name == "newton" else _nothing
            self._variant = fastest(self._peer, device)
            red, self._packed = packed(name, self._peer, sizes)
            self._shifts = (16, 8, 0) if red else (0, 8, 16)
        self._rgb = self.array(camera.name, "rgb")

    def render(self, worlds: Any = None, forward: bool = False) -> Any:
        """Draw all worlds, whichever are asked for: peers know no masks."""
        device = self.scene.device
        with torch_interop.in_order(device), wp.ScopedDevice(device):
            self._bring()
            self._peer.frame(self._variant)
            wp.launch(unpack, self._packed.shape, inputs=[self._packed, *self._shifts], outputs=[self._rgb])
        return self.images


def _nothing() -> None:
    """Bring nothing: a peer that reads MuJoCo-Warp's data."""


def packed(name: str, peer: Any, sizes: tuple[int, int, int]) -> tuple[bool, wp.array]:
    """Return whether red is in the third byte of a pixel, not the first, and the pixels, (world, row, column)."""
    worlds, width, height = sizes
    if name == "newton":
        return False, peer.batches[0].images["rgb"]
    return True, peer.context.rgb_data.reshape((worlds, height, width))


def fastest(peer: Any, device: wp.Device) -> str:
    """Return the variant whose frames take least time."""
    times = {}
    for variant in peer.variants:
        for warm in (True, False):
            wp.synchronize_device(device)
            begun = time.perf_counter()
            for _ in range(1 if warm else FRAMES):
                peer.frame(variant)
            wp.synchronize_device(device)
            times[variant] = time.perf_counter() - begun
    return min(times, key=lambda variant: times[variant])


def follow_newton(peer: Any, problem: Problem) -> Callable[[], None]:
    """Return what copies poses of bodies and of the camera from MuJoCo-Warp's data to Newton's state."""
    data, bodies = problem.d, wp.array(peer.built.moving, dtype=wp.int32)
    bring = partial(
        wp.launch,
        copy_bodies,
        (problem.worlds, len(bodies)),
        inputs=[data.xpos, data.xquat, bodies],
        outputs=[peer.state.body_q],
    )
    look = partial(
        wp.launch,
        copy_camera,
        problem.worlds,
        inputs=[data.cam_xpos, data.cam_xmat, problem.camera_ids[0]],
        outputs=[peer.batches[0].transforms],
    )

    def both() -> None:
        bring()
        look()

    return both


@wp.kernel(enable_backward=False)  # type: ignore[untyped-decorator]
def copy_bodies(
    positions: wp.array2d[wp.vec3],
    rotations: wp.array2d[wp.quat],  # w x y z
    bodies: wp.array[wp.int32],
    poses: wp.array[wp.transformf],
) -> None:
    world, index = wp.tid()
    body = bodies[index]
    q = rotations[world, body]
    poses[world * bodies.shape[0] + index] = wp.transformf(positions[world, body], wp.quat(q[1], q[2], q[3], q[0]))


@wp.kernel(enable_backward=False)  # type: ignore[untyped-decorator]
def copy_camera(
    positions: wp.array2d[wp.vec3], rotations: wp.array2d[wp.mat33], camera: wp.int32, poses: wp.array[wp.transformf]
) -> None:
    world = wp.tid()
    poses[world] = wp.transformf(positions[world, camera], wp.quat_from_matrix(rotations[world, camera]))


@wp.kernel(enable_backward=False)  # type: ignore[untyped-decorator]
def unpack(
    packed: wp.array3d[wp.uint32], red: wp.uint32, green: wp.uint32, blue: wp.uint32, rgb: wp.array4d[wp.uint8]
) -> None:
    world, row, column = wp.tid()
    pixel = packed[world, row, column]
    rgb[world, row, column, 0] = wp.uint8((pixel >> red) & wp.uint32(255))
    rgb[world, row, column, 1] = wp.uint8((pixel >> green) & wp.uint32(255))
    rgb[world, row, column, 2] = wp.uint8((pixel >> blue) & wp.uint32(255))
