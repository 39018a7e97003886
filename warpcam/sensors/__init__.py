"""Sensors: what a robot's cameras and range sensors measure, in every world, on the device."""

from warpcam.sensors.camera_model import CameraModel
from warpcam.sensors.depth.disparity import DisparityNoise, DisparityQuantization, MatchingWindow, ShiftedLookup
from warpcam.sensors.depth.dropout import DarkDropout, EdgeDropout, FlyingPixels, GrazingDropout, RandomDropout
from warpcam.sensors.depth.kinect_noise import AxialNoise, LateralNoise
from warpcam.sensors.depth.noise import AzureKinectNoise, DepthBias, DepthDrift, DepthFixedPattern, PolynomialNoise
from warpcam.sensors.depth.quantization import DepthQuantization
from warpcam.sensors.depth.range_limits import DepthRange
from warpcam.sensors.depth.stereo_shadow import StereoShadow
from warpcam.sensors.depth_cameras import (
    azure_kinect,
    kinect_v1,
    oak_d,
    realsense_d405,
    realsense_d415,
    realsense_d435,
    realsense_d455,
    vl53l5cx,
    zed_2,
)
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.rig import Rig

__all__ = [
    "AxialNoise",
    "AzureKinectNoise",
    "CameraModel",
    "DarkDropout",
    "DepthBias",
    "DepthDrift",
    "DepthFixedPattern",
    "DepthQuantization",
    "DepthRange",
    "DisparityNoise",
    "DisparityQuantization",
    "EdgeDropout",
    "Effect",
    "EffectFrame",
    "FlyingPixels",
    "GrazingDropout",
    "LateralNoise",
    "MatchingWindow",
    "PolynomialNoise",
    "RandomDropout",
    "Rig",
    "ShiftedLookup",
    "StereoShadow",
    "azure_kinect",
    "kinect_v1",
    "oak_d",
    "parameter",
    "realsense_d405",
    "realsense_d415",
    "realsense_d435",
    "realsense_d455",
    "vl53l5cx",
    "zed_2",
]
