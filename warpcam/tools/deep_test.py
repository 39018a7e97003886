"""What ``warpcam doctor --deep`` compares between a GPU and the CPU: every output, lenses and sensors."""

import importlib.util
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import torch
import warp as wp

import warpcam
from warpcam import sensors
from warpcam.kernels.outputs import OUTPUTS
from warpcam.tools import self_test

Images = dict[str, np.ndarray]

WIDTH, HEIGHT, WORLDS = 48, 40, 2
LENGTH = 2e-4  # of numbers that count as equal, relative above 1
COLOR = 3  # of 255
ALLOWED = 0.01  # share of pixels that may be others: rounding decides what is seen at an edge
ALLOWED_NOISE = 0.03  # the same of sensors, in which rounding decides about holes and steps, too
LENSES: Mapping[str, Callable[[], warpcam.Lens]] = {
    "Pinhole": lambda: warpcam.Pinhole(fovy=60.0),
    "Orthographic": lambda: warpcam.Orthographic(height=3.0),
    "Fisheye": lambda: warpcam.Fisheye(fovy=120.0, k=(0.02, -0.01, 0.0, 0.0)),
    "Equirectangular": warpcam.Equirectangular,
}


def checks() -> dict[str, Callable[[wp.Device], Images]]:
    """What is rendered, by name."""
    found: dict[str, Callable[[wp.Device], Images]] = {"outputs": _outputs, "smooth edges": _smooth_edges}
    found |= {f"lens {name}": _through(make) for name, make in LENSES.items()}
    found |= {"depth camera": _depth_camera, "colour camera": _color_camera, "lidar": _lidar}
    if importlib.util.find_spec("mujoco"):
        found["MuJoCo's light"] = _mujoco
    return found


def compare(device: wp.Device, said: Callable[[str], None] = lambda _: None) -> Iterator[self_test.Comparison]:
    """Render each check on the CPU and on a device, and compare.

    Args:
        device: Compared with the CPU.
        said: Is told what is going on.
    """
    for name, render in checks().items():
        said(f"rendering {name} on the CPU and on {device.alias}")
        judge, images = (render(each) for each in (wp.get_device("cpu"), device))
        allowed = ALLOWED_NOISE if name in ("depth camera", "colour camera", "lidar") else ALLOWED
        for output, image in images.items():
            share = different(image, judge[output])
            yield self_test.Comparison(device.alias, name, output, share, share <= allowed)


def different(image: np.ndarray, judge: np.ndarray) -> float:
    """Share of pixels, the last dimension being their channels, that differ by more than rounding."""
    if image.shape != judge.shape:
        return 1.0
    if image.dtype == np.uint8:
        off = np.abs(image.astype(int) - judge) > COLOR
    elif np.issubdtype(image.dtype, np.integer) or image.dtype == bool:
        off = image != judge
    else:
        with np.errstate(invalid="ignore"):
            near = np.isfinite(judge) & (np.abs(image - judge) <= LENGTH * np.maximum(np.abs(judge), 1.0))
        off = ~(near | (image == judge) | (np.isnan(image) & np.isnan(judge)))
    return float(off.any(axis=-1).mean())


def _camera(**options: Any) -> warpcam.Camera:
    options = {"lens": warpcam.Pinhole(fovy=self_test.FOVY), "width": WIDTH, "height": HEIGHT, **options}
    return warpcam.Camera("eye", position=tuple(self_test.EYE), **options)


def _copies(images: Mapping[str, torch.Tensor]) -> Images:
    return {name: image.cpu().numpy().copy() for name, image in images.items()}


def _outputs(device: wp.Device) -> Images:
    """Every output, of the second of two frames, between which the ball moves."""
    scene = self_test.scene(device, WORLDS)
    renderer = warpcam.Renderer(scene, [_camera(outputs=tuple(OUTPUTS), shadows=True)])
    renderer.render()
    place = self_test.CENTER + np.array((0.1, 0.05, 0.0))
    scene.set_poses(["/ball"], [[[*place, 1.0, 0.0, 0.0, 0.0]]])
    return _copies(renderer.render()["eye"])


def _smooth_edges(device: wp.Device) -> Images:
    camera = _camera(outputs=("rgb",), shadows=True, antialiasing=4)
    return _copies(warpcam.Renderer(self_test.scene(device, WORLDS), [camera]).render()["eye"])


def _through(make: Callable[[], warpcam.Lens]) -> Callable[[wp.Device], Images]:
    def render(device: wp.Device) -> Images:
        camera = _camera(outputs=("rgb", "depth", "normals", "segmentation"), lens=make())
        return _copies(warpcam.Renderer(self_test.scene(device, WORLDS), [camera]).render()["eye"])

    return render


def _rig(device: wp.Device, outputs: tuple[str, ...], stages: Any) -> Images:
    renderer = warpcam.Renderer(self_test.scene(device, WORLDS), [_camera(outputs=outputs, shadows=True)])
    return _copies(sensors.Rig(renderer, {"eye": stages}, seed=1).read()["eye"])


def _depth_camera(device: wp.Device) -> Images:
    return _rig(device, ("depth", "normals"), sensors.realsense_d435())


def _color_camera(device: wp.Device) -> Images:
    stages = [
        sensors.NaturalVignetting(),
        sensors.ShotNoise(electrons=4000.0),
        sensors.ReadNoise(sigma=0.01),
        sensors.JpegArtifacts(quality=80),
    ]
    return _rig(device, ("rgb",), stages)


def _lidar(device: wp.Device) -> Images:
    pattern = sensors.patterns.ouster_os1(channels=32, columns=512)
    scene = self_test.scene(device, WORLDS)
    lidar = sensors.Lidar(scene, pattern, position=(0.0, 0.0, 2.0), rotation=(0.7071068, 0.7071068, 0.0, 0.0), seed=1)
    scan = _copies(lidar.read())
    return {name: scan[name][..., None] for name in ("ranges", "intensities", "ids")}


def _mujoco(device: wp.Device) -> Images:
    """The demo scene with MuJoCo's lighting, textures and reflections."""
    from warpcam.sources.mujoco.batch_file import DEMO

    scene = warpcam.load(DEMO, WORLDS, device=device)
    outputs = ("rgb", "depth", "segmentation", "normals", "albedo")
    camera = warpcam.Camera("overview", width=96, height=72, outputs=outputs, shadows=True)
    return _copies(warpcam.Renderer(scene, [camera]).render()["overview"])
