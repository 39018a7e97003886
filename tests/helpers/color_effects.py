"""One of each effect on colours, whose parameters all count."""

from typing import Any

from warpcam import sensors

EMVA: dict[str, Any] = {
    "photons_at_white": 9000.0,
    "quantum_efficiency": 0.5,
    "full_well": 4000.0,
    "gain": 0.05,
    "dark_noise": 30.0,
    "bits": 8.0,
    "dark_current": 4000.0,
    "exposure_time": 0.1,
    "black_level": 12.0,
}
CURVE = {"toe": (1.0,) * 3, "shoulder": (0.5,) * 3, "gamma": (0.8,) * 3, "center": (-0.5,) * 3}
EFFECTS: list[sensors.Effect] = [
    sensors.BayerMosaic(),
    sensors.Blur(0.8),
    sensors.ChromaticAberration(1.05, 0.97),
    sensors.DeadPixels(0.1, 0.1, 0.7),
    sensors.DepthOfField(focus_distance=0.5, f_number=1.4, focal_length=0.1),
    sensors.Dsnu(0.02),
    sensors.Emva1288(**EMVA),
    sensors.Exposure(0.5, 0.02, 0.01),
    sensors.Gain(1.5),
    sensors.GammaCurve(2.2),
    sensors.JpegArtifacts(40.0),
    sensors.JpegArtifacts(40.0, "4:4:4"),
    sensors.NaturalVignetting(0.5),
    sensors.Ppisp(1.1, 0.2, (0.1,) * 6, (-0.3,) * 9, (0.5,) * 8, **CURVE),
    sensors.Prnu(0.05),
    sensors.Quantization(4.0),
    sensors.ReadNoise(0.05),
    sensors.ResponseCurve(**CURVE),
    sensors.Sharpening(0.5),
    sensors.ShotNoise(500.0),
    sensors.ToneCurve(),
    sensors.ToneCurve([(0.0, 0.0), (0.3, 0.6), (1.0, 0.9)]),
    sensors.Vignetting((-0.5, 0.1, -0.1), (0.1, 0.0)),
    sensors.WhiteBalance((1.2, 1.0, 0.7)),
]
