"""Sensors: what a robot's cameras and range sensors measure, in every world, on the device."""

from warpcam.sensors.cloud_export import to_open3d, write_ply
from warpcam.sensors.color.exposure import Exposure, Gain, WhiteBalance
from warpcam.sensors.color.fixed_patterns import DeadPixels, Dsnu, Prnu
from warpcam.sensors.color.jpeg import JpegArtifacts
from warpcam.sensors.color.mosaic import BayerMosaic
from warpcam.sensors.color.noise import Emva1288, ReadNoise, ShotNoise
from warpcam.sensors.color.optics import Blur, ChromaticAberration, NaturalVignetting, Sharpening, Vignetting
from warpcam.sensors.color.ppisp import Ppisp
from warpcam.sensors.color.tone import GammaCurve, Quantization, ResponseCurve, ToneCurve
from warpcam.sensors.depth.range_limits import DepthRange
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.point_clouds import PointClouds
from warpcam.sensors.rig import Rig

__all__ = [
    "BayerMosaic",
    "Blur",
    "ChromaticAberration",
    "DeadPixels",
    "DepthRange",
    "Dsnu",
    "Effect",
    "EffectFrame",
    "Emva1288",
    "Exposure",
    "Gain",
    "GammaCurve",
    "JpegArtifacts",
    "NaturalVignetting",
    "PointClouds",
    "Ppisp",
    "Prnu",
    "Quantization",
    "ReadNoise",
    "ResponseCurve",
    "Rig",
    "Sharpening",
    "ShotNoise",
    "ToneCurve",
    "Vignetting",
    "WhiteBalance",
    "parameter",
    "to_open3d",
    "write_ply",
]
