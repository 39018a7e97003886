"""Pictures of ``mujoco.Renderer``, and the difference of an image of ours from them away from edges."""

import mujoco
import numpy as np
import scenes
import warp as wp
from mujoco_reference import reference_renderer

import warpcam as wc

SIZE = 128
SHADOW_MAP = 1024  # texels on a side: edges are left out, and Mesa takes 0.1 s to draw MuJoCo's 4096
FINE = 120  # slices and stacks of what MuJoCo draws round: coarser ones show in highlights
STEP = 12  # between neighbouring pixels, from which on there is an edge


def paint(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int = 0) -> np.ndarray:
    """(height, width, 3) uint8."""
    mjm.vis.quality.numslices = mjm.vis.quality.numstacks = FINE
    mjm.vis.quality.offsamples, mjm.vis.quality.shadowsize = 0, SHADOW_MAP
    with reference_renderer(mjm, SIZE, SIZE) as renderer:
        renderer.update_scene(mjd, camera=camera)
        return renderer.render().copy()


def ours(mjm: mujoco.MjModel, mjd: mujoco.MjData, device: wp.Device, camera: int = 0, **options: object) -> np.ndarray:
    near, far = mjm.vis.map.znear * mjm.stat.extent, mjm.vis.map.zfar * mjm.stat.extent
    seen = wc.Camera(camera, width=SIZE, height=SIZE, outputs=("rgb",), shadows=True, near=near, far=far)
    return scenes.look(wc.from_mujoco(mjm, mjd, device=device, **options), seen)["rgb"][0]


def edges(image: np.ndarray) -> np.ndarray:
    """Pixels less than two from an edge."""
    found = np.zeros(image.shape[:2], bool)
    for axis in (0, 1):
        steps = np.abs(np.diff(image.astype(int), axis=axis)).max(axis=-1) > STEP
        for side in ((1, 0), (0, 1)):
            found |= np.pad(steps, [side if a == axis else (0, 0) for a in (0, 1)])
    padded = np.pad(found, 1)
    return np.any([padded[i : i + SIZE, j : j + SIZE] for i in range(3) for j in range(3)], axis=0)


def check(
    mjm: mujoco.MjModel,
    device: wp.Device,
    *,
    limit: int = 3,
    most: float = 0.002,
    differs: bool = True,
    **options: object,
) -> np.ndarray:
    """Compare; at most the part ``most`` of what is not near an edge may be farther off than ``limit``.

    With ``differs`` an image made without layers must be farther off: the test would see it if they were missing.
    """
    mjd = scenes.forward(mjm)
    painted, seen = paint(mjm, mjd), ours(mjm, mjd, device, **options)
    inner = ~(edges(painted) | edges(seen))
    assert inner.mean() > 0.4

    def wrong(image: np.ndarray) -> float:
        return float((np.abs(painted.astype(int) - image).max(axis=-1) > limit)[inner].mean())

    print(f"{inner.mean():.0%} are no edges, {wrong(seen):.2%} of them differ by more than {limit}")
    assert wrong(seen) <= most
    if differs:
        assert wrong(ours(mjm, mjd, device, reflections=False, transparency=False)) > 0.02
    return seen
