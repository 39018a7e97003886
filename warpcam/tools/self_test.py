"""A small scene that needs no simulator, and what must be seen of it on every device."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.camera.lens import Pinhole
from warpcam.kernels.types import BOX, SPHERE
from warpcam.render.renderer import Renderer
from warpcam.scene.file_scene import DrivenScene
from warpcam.sources.common import tessellate
from warpcam.sources.common.geometry import Geometry, MeshGeometry, Primitive
from warpcam.sources.common.scene_graph import FrameNode, LightNode, Material, SceneGraph, ShapeInstance
from warpcam.sources.common.scene_graph_source import SceneGraphSource

SIZE, WORLDS, FRAMES = 48, 4, 5
OUTPUTS = ("rgb", "depth", "segmentation")
FOVY = 60.0  # [degrees]
EYE = np.array((0.0, 0.0, 3.0))  # it looks along -z
WALL, BALL, BLOCK = 0, 1, 2  # ids of the shapes
CENTER, RADIUS = np.array((-0.5, 0.3, 0.5)), 0.5  # of the ball [m]
BLOCK_AT, HALF = np.array((0.6, -0.4, 0.25)), 0.3  # of a cube of triangles, turned about z [m]

# What images of two devices may differ by. At an edge rounding decides what is seen.
OTHER_IDS = 0.01  # share of pixels
DEPTH = 1e-4  # relative, where ids agree
COLOR = 3  # of 255, in all but as many pixels where ids agree


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """Images that a device made of the scene.

    Attributes:
        images: By output, (world, height, width, channels).
        first: Until the first frame was there, with all that had to be compiled [s].
        frame: Of a later frame of all worlds, at best [s].
        plan: The kernels that made them, in words.
    """

    images: dict[str, np.ndarray]
    first: float
    frame: float
    plan: str | None = None


@dataclass(frozen=True)
class Comparison:
    """An image of a device beside the CPU's.

    Attributes:
        device: Its alias.
        check: What was rendered: see deep_test.py.
        output: Name of the image.
        different: Share of pixels that are not the CPU's.
        passed: Whether these are few enough.
    """

    device: str
    check: str
    output: str
    different: float
    passed: bool


def scene(device: wp.Device, worlds: int) -> DrivenScene:
    """The scene there: "/wall", "/ball" and "/block" in the light of "/sun"."""
    return DrivenScene(SceneGraphSource(_graph(), worlds, device))


def shoot(device: wp.Device) -> RenderedFrame:
    """Render the scene there."""
    start = time.perf_counter()
    camera = Camera(
        "eye",
        width=SIZE,
        height=SIZE,
        outputs=OUTPUTS,
        lens=Pinhole(fovy=FOVY),
        position=tuple(EYE),
        shadows=True,
    )
    renderer = Renderer(scene(device, WORLDS), [camera])
    times = []
    for _ in range(1 + FRAMES):
        renderer.render()
        wp.synchronize_device(device)
        times.append(time.perf_counter())
    images = {name: image.cpu().numpy().copy() for name, image in renderer.images["eye"].items()}
    return RenderedFrame(images, times[0] - start, float(np.diff(times).min()), str(renderer.plan["eye"]))


def fault(images: dict[str, np.ndarray]) -> str | None:
    """Check images of the scene against the shapes' own equations; return the fault, or None."""
    depth, ids = images["depth"][..., 0].astype(np.float64), images["segmentation"][..., 0]
    slope = np.tan(np.radians(0.5 * FOVY))
    x = (2.0 * (np.arange(SIZE) + 0.5) / SIZE - 1.0) * slope
    with np.errstate(invalid="ignore"):
        points = EYE + depth[..., None] * np.stack(np.broadcast_arrays(x, -x[:, None], -1.0), axis=-1)
    for shape, name in ((WALL, "wall"), (BALL, "ball"), (BLOCK, "block")):
        if not ((ids == shape).mean(axis=(1, 2)) > 0.02).all():
            return f"the {name} is not seen"
    if not np.isin(ids, (WALL, BALL, BLOCK)).all():
        return f"shape {int(np.setdiff1d(ids, (WALL, BALL, BLOCK))[0])} is seen, and there are 3"
    wall = np.abs(points[ids == WALL][:, 2]).max()
    if not wall < 1e-4:
        return f"the wall is {wall:.2g} m from where it is"
    ball = np.abs(np.linalg.norm(points[ids == BALL] - CENTER, axis=-1) - RADIUS).max()
    if not ball < 1e-3:
        return f"the ball is {ball:.2g} m from where it is"
    front = np.abs(points[ids == BLOCK][:, 2] - BLOCK_AT[2] - HALF).min()
    if not front < 1e-4:
        return f"the front of the block is {front:.2g} m from where it is"
    if not (images["rgb"].std(axis=(1, 2, 3)) > 10.0).all():
        return "the colours are all alike"
    return None


def difference(images: dict[str, np.ndarray], judge: dict[str, np.ndarray]) -> tuple[float, str | None]:
    """Share of pixels that differ by more than rounding, and what is too much of it, or None."""
    same = (images["segmentation"] == judge["segmentation"])[..., 0]
    with np.errstate(invalid="ignore"):
        off = np.abs(images["depth"] - judge["depth"])[..., 0]
        far = ~(off <= DEPTH * np.abs(judge["depth"][..., 0])) & same
    other = (np.abs(images["rgb"].astype(int) - judge["rgb"]).max(axis=-1) > COLOR) & same
    share = float((~same | far | other).mean())
    for what, pixels, allowed in (("ids", ~same, OTHER_IDS), ("depths", far, 0.0), ("colours", other, OTHER_IDS)):
        if pixels.mean() > allowed:
            return share, f"{what} of {pixels.mean():.1%} of the pixels are not the CPU's"
    return share, None


def _graph() -> SceneGraph:
    """A wall, a ball and a block in the light of a sun."""
    turn = np.eye(4)
    turn[:2, :2] = (0.8, -0.6), (0.6, 0.8)
    turn[:3, 3] = BLOCK_AT
    nodes = [
        FrameNode("/", -1, np.eye(4)),
        FrameNode("/wall", 0, _at((0.0, 0.0, -0.5))),
        FrameNode("/ball", 0, _at(CENTER)),
    ]
    nodes += [FrameNode("/block", 0, turn), FrameNode("/sun", 0, _tilted())]
    wall, ball = Primitive("wall", BOX, (9.0, 9.0, 0.5)), Primitive("ball", SPHERE, (RADIUS,))
    forms: list[Geometry] = [wall, ball, MeshGeometry("block", *tessellate.box(np.full(3, HALF)))]
    return SceneGraph(
        "self test",
        nodes,
        [ShapeInstance(nodes[1 + i].name, 1 + i, form, i) for i, form in enumerate(forms)],
        [Material("wall", (0.6, 0.6, 0.6)), Material("ball", (0.8, 0.1, 0.1)), Material("block", (0.1, 0.3, 0.8))],
        lights=[LightNode("/sun", 4, "distant", (2.0, 2.0, 2.0))],
    )


def _at(position: Any) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = position
    return matrix


def _tilted() -> np.ndarray:
    """A frame whose -z points to where the light goes: down the view, to the right."""
    c, s = np.cos(0.5), np.sin(0.5)
    matrix = np.eye(4)
    matrix[:3, :3] = (c, 0.0, -s), (0.0, 1.0, 0.0), (s, 0.0, c)
    return matrix
