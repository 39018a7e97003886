"""Ids and depths by ``mujoco.Renderer``, and how far an image of ours is from them away from edges."""

from dataclasses import dataclass

import mujoco
import numpy as np
import scenes
from mujoco_reference import reference_renderer

import warpcam as wc

SIZE = 128
TOLERANCE = 1e-3  # of depth, relative: what its depth buffer holds


@dataclass(frozen=True)
class Reference:
    """Pictures of MuJoCo: images (height, width), and the camera it drew them with."""

    pairs: np.ndarray  # int32 (height, width, 2), id and mjtObj, or -1 twice
    depth: np.ndarray  # float32 [m]
    camera: wc.Camera


def options() -> mujoco.MjvOption:
    """Return options that draw everything except the lines of range finders."""
    chosen = mujoco.MjvOption()
    chosen.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = False
    return chosen


def near_and_far(mjm: mujoco.MjModel) -> dict[str, float]:
    return {"near": mjm.vis.map.znear * mjm.stat.extent, "far": mjm.vis.map.zfar * mjm.stat.extent}


def draw(mjm: mujoco.MjModel, mjd: mujoco.MjData, camera: int) -> Reference:
    """MuJoCo's images of one camera of the model, or of its free camera, -1."""
    mjm.vis.quality.offsamples = 0  # one sample a pixel, in its centre: a depth of several is of none of them
    shadow_map, mjm.vis.quality.shadowsize = mjm.vis.quality.shadowsize, 16  # neither image has shadows
    with reference_renderer(mjm, SIZE, SIZE) as renderer:
        mjm.vis.quality.shadowsize = shadow_map
        renderer.update_scene(mjd, camera=camera, scene_option=options())
        renderer.enable_segmentation_rendering()
        pairs = renderer.render().copy()
        renderer.disable_segmentation_rendering()
        renderer.enable_depth_rendering()
        depth = renderer.render().copy()
        asked = {"width": SIZE, "height": SIZE, "outputs": ("depth", "segmentation"), **near_and_far(mjm)}
        if camera >= 0:
            return Reference(pairs, depth, wc.Camera(camera, **asked))
        eyes = renderer.scene.camera
        position = 0.5 * (eyes[0].pos + eyes[1].pos)
        rotation = scenes.looking((0, 0, 0), eyes[0].forward, eyes[0].up)
        lens = wc.Pinhole(fovy=mjm.vis.global_.fovy)
        return Reference(pairs, depth, wc.Camera("free", lens=lens, position=position, rotation=rotation, **asked))


def windows(image: np.ndarray) -> np.ndarray:
    """The 3 x 3 neighbourhood of each pixel, (height, width, 9)."""
    padded = np.pad(image, 1, mode="edge")
    return np.stack([padded[i : i + SIZE, j : j + SIZE] for i in range(3) for j in range(3)], axis=-1)


def edge_band(ids: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Pixels next to another id, or to where depth jumps: where it does not go on as it came."""
    around, depths = windows(ids), windows(depth.astype(np.float64)).reshape(SIZE, SIZE, 3, 3)
    inverse = 1.0 / depths  # of a plane it is linear in the image
    bend = np.zeros(ids.shape)
    for axis in (2, 3):
        middle = np.take(inverse, 1, axis=axis)
        ends = np.take(inverse, 0, axis=axis) + np.take(inverse, 2, axis=axis)
        bend = np.maximum(bend, np.abs(ends / middle - 2.0).max(axis=-1))
    return (around != ids[..., None]).any(axis=-1) | (bend > 0.02)


def compare_with(reference: Reference, scene: wc.Scene, name: str, world: int = 0, allowed: int = 0) -> None:
    seen = scenes.look(scene, reference.camera)
    ids, depth = seen["segmentation"][world], seen["depth"][world]
    wrong = (scene.objects[ids] != reference.pairs).any(axis=-1)
    band = edge_band(reference.pairs @ (1, 2**16), reference.depth)
    differ = wrong & ~band
    hit = (ids >= 0) & ~wrong & ~band
    off = np.abs(depth - reference.depth, where=hit, out=np.zeros_like(depth))
    limit = TOLERANCE * reference.depth
    print(
        f"{name}, camera {reference.camera.name}: {(ids >= 0).mean():.0%} hit, edge band {band.mean():.1%}, in it "
        f"{wrong[band].sum()} ids differ, outside {differ.sum()}; "
        f"depth off by {(off / reference.depth).max():.1e} at most"
    )
    assert (ids >= 0).sum() > 50
    assert band.mean() < 0.5
    assert differ.sum() <= allowed
    assert (off > limit).sum() <= allowed
