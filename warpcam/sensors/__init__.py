"""Sensors: what a robot's cameras and range sensors measure, in every world, on the device."""

from warpcam.sensors import patterns
from warpcam.sensors.camera_model import CameraModel
from warpcam.sensors.cloud_export import to_open3d, write_ply
from warpcam.sensors.color.depth_of_field import DepthOfField
from warpcam.sensors.color.exposure import Exposure, Gain, WhiteBalance
from warpcam.sensors.color.fixed_patterns import DeadPixels, Dsnu, Prnu
from warpcam.sensors.color.jpeg import JpegArtifacts
from warpcam.sensors.color.mosaic import BayerMosaic
from warpcam.sensors.color.noise import Emva1288, ReadNoise, ShotNoise
from warpcam.sensors.color.optics import Blur, ChromaticAberration, NaturalVignetting, Sharpening, Vignetting
from warpcam.sensors.color.ppisp import Ppisp
from warpcam.sensors.color.tone import GammaCurve, Quantization, ResponseCurve, ToneCurve
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
from warpcam.sensors.lidar import Lidar
from warpcam.sensors.lidar_noise import LidarDropout, LidarNoise
from warpcam.sensors.point_clouds import PointClouds
from warpcam.sensors.rig import Rig
from warpcam.sensors.stereo.dot_projector import DotProjector
from warpcam.sensors.stereo.infrared_noise import InfraredNoise
from warpcam.sensors.stereo.matching import StereoMatching
from warpcam.sensors.stereo.stereo_camera import StereoCamera
from warpcam.sensors.timing.accumulation import Accumulation
from warpcam.sensors.timing.delivery import Deliveries, Delivery
from warpcam.sensors.timing.shutter import MotionBlur, RollingShutter

__all__ = [
    "Accumulation",
    "AxialNoise",
    "AzureKinectNoise",
    "BayerMosaic",
    "Blur",
    "CameraModel",
    "ChromaticAberration",
    "DarkDropout",
    "DeadPixels",
    "Deliveries",
    "Delivery",
    "DepthBias",
    "DepthDrift",
    "DepthFixedPattern",
    "DepthOfField",
    "DepthQuantization",
    "DepthRange",
    "DisparityNoise",
    "DisparityQuantization",
    "DotProjector",
    "Dsnu",
    "EdgeDropout",
    "Effect",
    "EffectFrame",
    "Emva1288",
    "Exposure",
    "FlyingPixels",
    "Gain",
    "GammaCurve",
    "GrazingDropout",
    "InfraredNoise",
    "JpegArtifacts",
    "LateralNoise",
    "Lidar",
    "LidarDropout",
    "LidarNoise",
    "MatchingWindow",
    "MotionBlur",
    "NaturalVignetting",
    "PointClouds",
    "PolynomialNoise",
    "Ppisp",
    "Prnu",
    "Quantization",
    "RandomDropout",
    "ReadNoise",
    "ResponseCurve",
    "Rig",
    "RollingShutter",
    "Sharpening",
    "ShiftedLookup",
    "ShotNoise",
    "StereoCamera",
    "StereoMatching",
    "StereoShadow",
    "ToneCurve",
    "Vignetting",
    "WhiteBalance",
    "azure_kinect",
    "kinect_v1",
    "oak_d",
    "parameter",
    "patterns",
    "realsense_d405",
    "realsense_d415",
    "realsense_d435",
    "realsense_d455",
    "to_open3d",
    "vl53l5cx",
    "write_ply",
    "zed_2",
]
