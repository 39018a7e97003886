"""Cameras for thousands of robot-simulation worlds at once, with no graphics stack."""

from importlib.metadata import PackageNotFoundError as _PackageNotFoundError
from importlib.metadata import version as _version

from warpcam.camera.calibration import Calibration, read_calibration
from warpcam.camera.camera import Camera
from warpcam.camera.distorted import Distorted, RadTanThinPrismFisheye, ThinPrismFisheye
from warpcam.camera.film import AutoExposure, Bloom
from warpcam.camera.fisheye import Fisheye, FTheta, KannalaBrandt
from warpcam.camera.lens import Lens, Orthographic, Pinhole
from warpcam.camera.lens_tables import Rays
from warpcam.camera.wide_lenses import DoubleSphere, Equirectangular, ExtendedUnified, Omnidirectional
from warpcam.core.errors import OutOfMemoryError, WarpcamError
from warpcam.core.file_access import Limits
from warpcam.labeling.camera_labels import CameraLabels
from warpcam.labeling.keypoints import site_keypoints
from warpcam.labeling.labels import Labels, labels
from warpcam.load import add_urdf, from_mujoco, from_mujoco_warp, from_newton, from_usd, load
from warpcam.randomize import Choice, Uniform, randomize
from warpcam.render.denoise import denoise
from warpcam.render.memory import Memory, estimate_memory
from warpcam.render.paths import PathOptions
from warpcam.render.renderer import Renderer
from warpcam.scene.environments import Environments
from warpcam.scene.file_scene import DrivenScene
from warpcam.scene.light import Light
from warpcam.scene.scene import Scene
from warpcam.sources.common.splats import Splats

try:
    __version__ = _version("warpcam")
except _PackageNotFoundError:  # run from its sources
    __version__ = "0+unknown"

__all__ = [
    "AutoExposure",
    "Bloom",
    "Calibration",
    "Camera",
    "CameraLabels",
    "Choice",
    "Distorted",
    "DoubleSphere",
    "DrivenScene",
    "Environments",
    "Equirectangular",
    "ExtendedUnified",
    "FTheta",
    "Fisheye",
    "KannalaBrandt",
    "Labels",
    "Lens",
    "Light",
    "Limits",
    "Memory",
    "Omnidirectional",
    "Orthographic",
    "OutOfMemoryError",
    "PathOptions",
    "Pinhole",
    "RadTanThinPrismFisheye",
    "Rays",
    "Renderer",
    "Scene",
    "Splats",
    "ThinPrismFisheye",
    "Uniform",
    "WarpcamError",
    "add_urdf",
    "denoise",
    "estimate_memory",
    "from_mujoco",
    "from_mujoco_warp",
    "from_newton",
    "from_usd",
    "labels",
    "load",
    "randomize",
    "read_calibration",
    "site_keypoints",
]
