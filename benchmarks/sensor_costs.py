"""Cost of each stage of a sensor: ``python -m warpcam.benchmarks.sensor_costs``.

The humanoid of the suite, and what one effect adds to a frame: the median of ``Rig.read`` with it less that without it,
in milliseconds and as a share of the frame of colour with shadows, which is drawn alone. An effect on depth is the only
one of its rig. One on colours comes after a gain, so that the way from bytes to linear light and back counts once: as
"colors", the cost of that gain.
"""

import argparse
import functools
import json
from collections.abc import Sequence
from typing import Any

import warp as wp

import warpcam as wc
from warpcam import sensors
from warpcam.benchmarks import cases, machine, measure, problem

DEPTH: dict[str, sensors.Effect] = {
    "AxialNoise": sensors.AxialNoise(),
    "AzureKinectNoise": sensors.AzureKinectNoise(),
    "DarkDropout": sensors.DarkDropout(),
    "DepthBias": sensors.DepthBias(offset=0.01),
    "DepthDrift": sensors.DepthDrift(sigma=0.01),
    "DepthFixedPattern": sensors.DepthFixedPattern(constant=0.001),
    "DepthQuantization": sensors.DepthQuantization(),
    "DepthRange": sensors.DepthRange(min=0.2, max=5.0),
    "DisparityNoise": sensors.DisparityNoise(baseline=0.05, sigma=0.1),
    "DisparityQuantization": sensors.DisparityQuantization(baseline=0.05),
    "EdgeDropout": sensors.EdgeDropout(),
    "FlyingPixels": sensors.FlyingPixels(threshold=0.1, probability=0.5),
    "GrazingDropout": sensors.GrazingDropout(start=70.0, end=85.0),
    "LateralNoise": sensors.LateralNoise(),
    "MatchingWindow": sensors.MatchingWindow(baseline=0.05),
    "PolynomialNoise": sensors.PolynomialNoise(linear=0.01),
    "RandomDropout": sensors.RandomDropout(probability=0.02),
    "ShiftedLookup": sensors.ShiftedLookup(),
    "StereoShadow": sensors.StereoShadow(baseline=0.05),
}
EMVA: dict[str, Any] = {
    "photons_at_white": 9000.0,
    "quantum_efficiency": 0.5,
    "full_well": 4000.0,
    "gain": 0.05,
    "dark_noise": 3.0,
    "bits": 8.0,
}
CURVE = {"toe": (1.0,) * 3, "shoulder": (0.5,) * 3, "gamma": (0.8,) * 3, "center": (-0.5,) * 3}
COLORS: dict[str, sensors.Effect] = {
    "BayerMosaic": sensors.BayerMosaic(),
    "Blur": sensors.Blur(0.8),
    "ChromaticAberration": sensors.ChromaticAberration(1.01, 0.99),
    "DeadPixels": sensors.DeadPixels(1e-4, 1e-4, 0.7),
    "Dsnu": sensors.Dsnu(0.002),
    "Emva1288": sensors.Emva1288(**EMVA),
    "Exposure": sensors.Exposure(0.5),
    "Gain": sensors.Gain(1.5),
    "GammaCurve": sensors.GammaCurve(2.2),
    "JpegArtifacts": sensors.JpegArtifacts(60.0),
    "NaturalVignetting": sensors.NaturalVignetting(0.5),
    "Ppisp": sensors.Ppisp(1.1, 0.2, (0.1,) * 6, (-0.3,) * 9, (0.5,) * 8, **CURVE),
    "Prnu": sensors.Prnu(0.01),
    "Quantization": sensors.Quantization(6.0),
    "ReadNoise": sensors.ReadNoise(0.01),
    "ResponseCurve": sensors.ResponseCurve(**CURVE),
    "Sharpening": sensors.Sharpening(0.5),
    "ShotNoise": sensors.ShotNoise(500.0),
    "ToneCurve": sensors.ToneCurve(),
    "Vignetting": sensors.Vignetting((-0.5, 0.1, -0.1), (0.1, 0.0)),
    "WhiteBalance": sensors.WhiteBalance((1.2, 1.0, 0.7)),
}
FIRST = sensors.Gain(1.1)


class Costs:
    """Times of one scene in poses of one problem.

    Attributes:
        shaded: Milliseconds of a frame of colours with shadows.
    """

    def __init__(self, worlds: int, size: int, device: wp.Device):
        self._device = device
        self._problem = problem.build(cases.CASES["humanoid"], worlds, size, size)
        self._scene = wc.from_mujoco_warp(self._problem.mjm, self._problem.m, self._problem.d)
        self._plain: dict[tuple[str, ...], float] = {}
        self.shaded = self._median(self._renderer(("rgb",), shadows=True).render)

    def added(self, effects: Sequence[sensors.Effect], outputs: tuple[str, ...]) -> float:
        """Milliseconds that a rig of these effects adds to a frame of these outputs."""
        renderer = self._renderer(outputs)
        if outputs not in self._plain:
            self._plain[outputs] = self._median(renderer.render)
        rig = sensors.Rig(renderer, {self._problem.cameras[0]: effects})
        return self._median(rig.read) - self._plain[outputs]

    def _renderer(self, outputs: tuple[str, ...], shadows: bool = False) -> wc.Renderer:
        size = self._problem.width
        camera = wc.Camera(self._problem.cameras[0], width=size, height=size, outputs=outputs, shadows=shadows)
        return wc.Renderer(self._scene, [camera])

    def _median(self, frame: Any) -> float:
        return measure.median_of(frame, self._problem.place, problem.POSE_SETS, self._device)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--size", type=int, default=128, help="pixels of a side")
    parser.add_argument("--only", nargs="+", choices=(*DEPTH, *COLORS), metavar="EFFECT", help="these effects")
    parser.add_argument("--out", help="JSON file")
    options = parser.parse_args(arguments)
    device = wp.get_device(options.device)
    with wp.ScopedDevice(device):
        costs = Costs(options.worlds, options.size, device)
        report: dict[str, Any] = {
            "about": __doc__,
            "machine": machine.describe(device),
            "worlds": options.worlds,
            "size": options.size,
            "rgb_shadows_ms": costs.shaded,
            "results": [],
        }
        print(
            f"colours with shadows of {options.worlds} worlds, {options.size} x {options.size}: {costs.shaded:.3f} ms"
        )

        def add(name: str, milliseconds: float) -> None:
            share = milliseconds / costs.shaded
            report["results"].append({"effect": name, "ms": milliseconds, "share": share})
            print(f"{name:22} {milliseconds:8.3f} ms {100 * share:6.1f} %", flush=True)

        for name, effect in DEPTH.items():
            if name in (options.only or DEPTH):
                add(name, costs.added([effect], ("depth", *effect.reads)))
        first = functools.cache(lambda: costs.added([FIRST], ("rgb",)))
        if not options.only:
            add("colors", first())
        for name, effect in COLORS.items():
            if name in (options.only or COLORS):
                add(name, costs.added([FIRST, effect], ("rgb",)) - first())
    if options.out:
        with open(options.out, "w") as file:
            json.dump(report, file, indent=1)


if __name__ == "__main__":
    main()
