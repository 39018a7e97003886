"""Depth cameras that one can buy, each number with its source.

"Maker" numbers are those of the vendor's own documents. "Simulation" numbers are what another simulation of the camera
has, or a data set's calibration of one; they were not measured by the vendor.
"""

from collections.abc import Callable, Mapping
from typing import Any, Literal, get_args

from warpcam.core.errors import WarpcamError
from warpcam.sensors.camera_model import CameraModel, focal_length
from warpcam.sensors.depth.disparity import DisparityNoise, DisparityQuantization, ShiftedLookup
from warpcam.sensors.depth.dropout import DarkDropout, EdgeDropout
from warpcam.sensors.depth.kinect_noise import AxialNoise, LateralNoise
from warpcam.sensors.depth.noise import AzureKinectNoise, PolynomialNoise
from warpcam.sensors.depth.quantization import DepthQuantization
from warpcam.sensors.depth.range_limits import DepthRange
from warpcam.sensors.depth.stereo_shadow import StereoShadow
from warpcam.sensors.effect import Effect

MILLIMETER = 0.001
# Standard deviation and steps of a RealSense's disparity [pixels]; `realsense_d405` has their sources.
REALSENSE_SIGMA, REALSENSE_STEP = 0.08, 1.0 / 32.0
AZURE_KINECT_MODES: dict[str, tuple[int, int, float, float, float, float, float]] = {
    # width, height, field of interest across and down [degrees], frame rate [Hz], range [m]
    "nfov_2x2binned": (320, 288, 75.0, 65.0, 30.0, 0.5, 5.46),
    "nfov_unbinned": (640, 576, 75.0, 65.0, 30.0, 0.5, 3.86),
    "wfov_2x2binned": (512, 512, 120.0, 120.0, 30.0, 0.25, 2.88),
    "wfov_unbinned": (1024, 1024, 120.0, 120.0, 15.0, 0.25, 2.21),
}

AzureKinectMode = Literal["nfov_2x2binned", "nfov_unbinned", "wfov_2x2binned", "wfov_unbinned"]


def _stereo(baseline: float, focal: float, sigma: Any, step: float) -> list[Effect]:
    """Holes, noise and steps of a stereo camera whose second imager is the right one."""
    effects: list[Effect] = [StereoShadow(baseline), DisparityNoise(baseline, sigma, focal_length=focal)]
    return [*effects, DisparityQuantization(baseline, step, focal_length=focal)] if step else effects


def _realsense(
    name: str,
    size: tuple[int, int],
    focal: float,
    baseline: float,
    near: float,
    far: float,
    unit: float = MILLIMETER,
    rate: float = 90.0,
) -> CameraModel:
    effects = _stereo(baseline, focal, REALSENSE_SIGMA, REALSENSE_STEP)
    effects += [DepthQuantization(unit), DepthRange(near, far)]
    return CameraModel(name, tuple(effects), *size, focal, focal, rate, near, far)


def realsense_d405() -> CameraModel:
    """Intel RealSense D405 at 848x480.

    - Maker: baseline 18 mm, horizontal field of view 87 degrees, up to 90 Hz, range 0.07 to 0.5 m: Intel's datasheet of
      the D400 series. The least depth is that of 848x480.
    - Maker: unit 0.1 mm: the depth scale that librealsense reports for it.
    - Maker: steps of 1/32 pixel: Intel's white paper "Subpixel Linearity Improvement for Intel RealSense Depth Camera
      D400 Series".
    - Simulation: disparity noise 0.08 pixels: the subpixel error of ROS simulations of the D435, in the formula of
      Intel's "Best-Known-Methods for Tuning Intel RealSense D400 Depth Cameras for Best Performance".
    """
    return _realsense("RealSense D405", (848, 480), focal_length(848, 87.0), 0.018, 0.07, 0.5, 0.0001)


def realsense_d415() -> CameraModel:
    """Intel RealSense D415 at 1280x720.

    - Simulation: focal length 920 pixels: the calibrated one of SAPIEN's StereoDepthSensor, which has a baseline of
      54.5 mm.
    - Maker: baseline 55 mm, range 0.5 to 3 m, unit 1 mm: Intel's datasheet of the D400 series. Up to 30 Hz: the modes
      that librealsense lists at this size; 90 Hz is for 848x480.
    - Noise and steps of the disparity: as of ``realsense_d405``.
    """
    return _realsense("RealSense D415", (1280, 720), 920.0, 0.055, 0.5, 3.0, rate=30.0)


def realsense_d435() -> CameraModel:
    """Intel RealSense D435 and D435i at 848x480.

    - Simulation: focal length 430.14 pixels: the calibrated one of SAPIEN's StereoDepthSensor.
    - Maker: baseline 50 mm, up to 90 Hz, range 0.3 to 3 m, unit 1 mm: Intel's datasheet of the D400 series.
    - Noise and steps of the disparity: as of ``realsense_d405``.
    """
    return _realsense("RealSense D435", (848, 480), 430.14, 0.05, 0.3, 3.0)


def realsense_d455() -> CameraModel:
    """Intel RealSense D455 at 848x480.

    - Maker: baseline 95 mm, horizontal field of view 87 degrees, up to 90 Hz, range 0.6 to 6 m, unit 1 mm: Intel's
      datasheet of the D400 series.
    - Noise and steps of the disparity: as of ``realsense_d405``.
    """
    return _realsense("RealSense D455", (848, 480), focal_length(848, 87.0), 0.095, 0.6, 6.0)


def azure_kinect(mode: AzureKinectMode = "nfov_unbinned") -> CameraModel:
    """Microsoft Azure Kinect DK, a time-of-flight camera. Needs ``rgb`` beside depth.

    - Maker: image, field of interest, frame rate and range of each mode: Microsoft's hardware specification. The wide
      modes have a fisheye; here they are a pinhole of that field.
    - Simulation: lookup shifted by 0.25 pixels, noise, dropout at steps of 0.8 m and below a brightness of 15/255: the
      Azure Kinect model of BlenderProc 2.8, after Tölgyessy et al., Sensors 2021. Its noise stays within the 17 mm of
      Microsoft's specification, which that paper's measurements confirm.
    - Maker: unit 1 mm: the SDK's DEPTH16 images.

    Args:
        mode: "nfov_unbinned" (640x576), "nfov_2x2binned" (320x288), "wfov_unbinned" (1024x1024) or "wfov_2x2binned"
            (512x512).

    Raises:
        WarpcamError: Any other mode.
    """
    if not isinstance(mode, str) or mode not in get_args(AzureKinectMode):
        allowed = ", ".join(repr(name) for name in get_args(AzureKinectMode))
        raise WarpcamError(f"azure_kinect: mode is {mode!r}; allowed are {allowed}")
    width, height, across, down, rate, near, far = AZURE_KINECT_MODES[mode]
    fx, fy = focal_length(width, across), focal_length(height, down)
    effects = (ShiftedLookup(0.25, fx, fy), AzureKinectNoise(), EdgeDropout(0.8), DarkDropout(15.0 / 255.0))
    units = (DepthQuantization(MILLIMETER), DepthRange(near, far))
    return CameraModel("Azure Kinect", (*effects, *units), width, height, fx, fy, rate, near, far)


def zed_2(disparity_sigma: Any = 0.21) -> CameraModel:
    """Stereolabs ZED 2 at HD720 (1280x720).

    - Maker: focal length 532 pixels: one camera's factory calibration for HD720.
    - Maker: baseline 120 mm, range 0.3 to 20 m: Stereolabs' documentation of the lens of 2.1 mm. 60 Hz: its mode HD720.
    - Maker: disparity noise: Stereolabs gives the depth error of the family as below 1 % up to 3 m and 5 % up to 15 m;
      both are 0.21 pixels of disparity.
    - Depth is given as floating-point numbers, so it has no unit, and no step of the disparity is published.

    Args:
        disparity_sigma: Standard deviation of the disparity [pixels]; a number or (world,).
    """
    effects = (*_stereo(0.12, 532.0, disparity_sigma, 0.0), DepthRange(0.3, 20.0))
    return CameraModel("ZED 2", effects, 1280, 720, 532.0, 532.0, 60.0, 0.3, 20.0)


def oak_d() -> CameraModel:
    """Luxonis OAK-D at 800P (1280x800), with subpixel disparity of 3 bits.

    - Maker: focal length 882.5 pixels, baseline 75 mm, steps of 1/8 pixel, least depth 0.7 m (95 pixels of disparity),
      unit 1 mm: Luxonis' documentation. Up to 120 Hz: its data sheet.
    - Simulation: greatest depth 12 m: aerial_gym 2.0.1. Luxonis gives the same as the end of the OAK-D Lite's ideal
      range.
    - Simulation: disparity noise 0.25 pixels: the example of an OAK-D in NVIDIA's documentation of its depth sensor.
    """
    effects = (*_stereo(0.075, 882.5, 0.25, 0.125), DepthQuantization(MILLIMETER), DepthRange(0.7, 12.0))
    return CameraModel("OAK-D", effects, 1280, 800, 882.5, 882.5, 120.0, 0.7, 12.0)


def kinect_v1() -> CameraModel:
    """Microsoft Kinect for Xbox 360, a structured-light camera, 640x480. Needs ``normals`` beside depth.

    - Axial and lateral noise: Nguyen, Izadi and Lovell, 3DIMPVT 2012.
    - Simulation: focal length 585 pixels: the camera of the 7-Scenes data set.
    - Simulation: baseline 75 mm, steps of 1/8 pixel: simkinect (Handa et al., ICRA 2014). The projector takes the place
      of a second imager, to the right.
    - Maker: range 0.8 to 4 m, 30 Hz, unit 1 mm: the default mode of Microsoft's SDK.
    """
    focal, baseline = 585.0, 0.075
    effects = (
        StereoShadow(baseline),
        LateralNoise(focal_length=focal),
        AxialNoise(),
        DisparityQuantization(baseline, 0.125, focal_length=focal),
        DepthQuantization(MILLIMETER),
        DepthRange(0.8, 4.0),
    )
    return CameraModel("Kinect v1", effects, 640, 480, focal, focal, 30.0, 0.8, 4.0)


def vl53l5cx() -> CameraModel:
    """STMicroelectronics VL53L5CX, a time-of-flight sensor of 8x8 zones; each zone is one ray.

    - Maker: zones, field of view 45x45 degrees, 15 Hz, range up to 4 m: ST's data sheet.
    - Simulation: least range 0.2 m, noise ``3.083e-6 z^2 - 4.073e-6 z + 5.308e-3`` around ``z + 0.025`` [m]: aerial_gym
      2.0.1.
    - Maker: unit 1 mm: ST's driver.
    """
    noise = PolynomialNoise(constant=5.308e-3, linear=-4.073e-6, quadratic=3.083e-6, offset=0.025)
    focal = focal_length(8, 45.0)
    effects = (noise, DepthQuantization(MILLIMETER), DepthRange(0.2, 4.0))
    return CameraModel("VL53L5CX", effects, 8, 8, focal, focal, 15.0, 0.2, 4.0)


# Models by name, in their modes by default, for programs that take names.
CAMERA_MODELS: Mapping[str, Callable[[], CameraModel]] = {
    made.__name__: made
    for made in (
        realsense_d405,
        realsense_d415,
        realsense_d435,
        realsense_d455,
        azure_kinect,
        zed_2,
        oak_d,
        kinect_v1,
        vl53l5cx,
    )
}
