"""Cost of what leaves the fastest ways of drawing: ``python -m warpcam.benchmarks.conditions``.

A base scene, the humanoid on its plane under one grey light that casts shadows, and conditions that change one thing of
it each. Each is measured between two measurements of the base; ``ratio`` is its time of a pixel over the mean of the
base's two, ``share`` that over how many times as many lights or shapes it has.
"""

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp

import warpcam as wc
from warpcam.benchmarks import cases, machine, measure, problem, scenes
from warpcam.benchmarks.cases import Case
from warpcam.benchmarks.peers.warpcam_renderer import WarpcamPeer
from warpcam.benchmarks.procedural_scenes import shapes

OUTPUTS = ("ds", "rgb", "rgb-shadows")
SIZES = ((64, 64), (84, 84), (96, 96), (128, 72), (160, 90), (224, 224), (256, 256))  # pixels
TINT = (1.0, 0.8, 0.6, 1.0)
Change = Callable[[mujoco.MjSpec], None]


def keep(spec: mujoco.MjSpec) -> None:
    """Change nothing."""


def color_light(spec: mujoco.MjSpec) -> None:
    spec.lights[0].diffuse = 0.6 * np.array(TINT[:3])


def color_floor(spec: mujoco.MjSpec) -> None:
    spec.material("grid").rgba = TINT


def color_both(spec: mujoco.MjSpec) -> None:
    color_light(spec)
    color_floor(spec)


def bare_floor(spec: mujoco.MjSpec) -> None:
    spec.geom("floor").material = ""


def end_floor(spec: mujoco.MjSpec) -> None:
    spec.geom("floor").size = (20.0, 20.0, 1.0)


def add_planes(spec: mujoco.MjSpec, places: tuple[tuple[float, ...], ...], half: float) -> None:
    """Add planes that face the middle, `half` as wide and high [m]; 0 for endless ones."""
    for x, y in places:
        plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": (half, half, 1.0), "material": "grid"}
        spec.worldbody.add_geom(pos=(x, y, 0.0), zaxis=(-x, -y, 0.0), **plane)


def add_lights(spec: mujoco.MjSpec, count: int) -> None:
    """Have `count` lights share the light of one; as many as there may be leave no room for a headlight."""
    for light in list(spec.lights):
        spec.delete(light)
    spec.visual.headlight.active = count < 8
    for index in range(count):
        angle = 2.0 * np.pi * index / count
        scenes.add_sun(spec, (0.5 * np.cos(angle), 0.5 * np.sin(angle), -1.0))
        spec.lights[-1].diffuse = np.full(3, 0.6 / count)


def fade_torso(spec: mujoco.MjSpec) -> None:
    spec.geom("torso").rgba = (0.8, 0.6, 0.4, 0.5)


def humanoid(change: Change) -> mujoco.MjSpec:
    spec = cases.HUMANOID()
    add_lights(spec, 1)
    change(spec)
    return spec


@dataclass(frozen=True)
class Condition:
    """A change of the base.

    Attributes:
        name: In the table.
        change: Of the humanoid's scene.
        shapes: Shapes in a grid in place of that scene, where there are any.
        size: Of images, in place of the run's [pixels].
        times: How many times as many lights or shapes as the base has.
        base: Name of what it is compared with.
        wanted: Options of the outputs.
        camera: Options of the camera.
        varied: What each world has for itself: names of ``Scene.vary``.
    """

    name: str
    change: Change = keep
    shapes: int = 0
    size: tuple[int, int] | None = None
    times: float = 1.0
    base: str = "base"
    wanted: Mapping[str, Any] = field(default_factory=dict)
    camera: Mapping[str, Any] = field(default_factory=dict)
    varied: tuple[str, ...] = ()

    def case(self) -> Case:
        if self.shapes:
            return Case(self.name, self.name, partial(shapes, self.shapes), ("fixed",), scatter=(0.1, 3.0))
        return Case(self.name, self.name, partial(humanoid, self.change), ("side",))


WALLS = ((0.0, 3.0), (3.0, 0.0), (-3.0, 0.0))  # [m]
CONDITIONS = {
    condition.name: condition
    for condition in (
        Condition("base"),
        Condition("coloured light", color_light),
        Condition("coloured floor", color_floor),
        Condition("coloured light and floor", color_both),
        Condition("floor without texture", bare_floor),
        Condition("finite plane", end_floor),
        Condition("two endless planes", partial(add_planes, places=WALLS[:1], half=0.0)),
        Condition("four planes, three finite", partial(add_planes, places=WALLS, half=3.0)),
        *(Condition(f"{n} lights", partial(add_lights, count=n), times=n) for n in (2, 3, 4, 6, 8)),
        *(Condition(f"{width}x{height}", size=(width, height)) for width, height in SIZES),
        Condition("reflection", wanted={"reflections": True}),
        Condition("transparency", fade_torso, wanted={"transparency": True}),
        Condition("exposure", camera={"exposure": 0.5}),
        Condition("materials by world", varied=("material_color", "shape_colors")),
        Condition("120 shapes", shapes=120),
        Condition("300 shapes", shapes=300, times=2.5, base="120 shapes"),
    )
}


class Drawn(WarpcamPeer):
    """Images of the base under one condition."""

    def __init__(self, condition: Condition, worlds: int, size: tuple[int, int]):
        self._condition = condition
        super().__init__(problem.build(condition.case(), worlds, *(condition.size or size)))

    def _scene(self, **drawn: bool) -> wc.Scene:
        scene = super()._scene(**drawn)
        for name in self._condition.varied:
            scene.vary(name)
        return scene

    def _own(self, index: int) -> dict[str, Any]:
        return dict(self._condition.camera)

    def milliseconds(self, device: wp.Device) -> float:
        """Time of a frame: the median, on a CPU of its processors' time."""
        with measure.on_one_stream(device):
            self.place(0)
            self.frame("")
            times = measure.time_frames(partial(self.frame, ""), self.place, problem.POSE_SETS, device, None)
        return float(times.get("cpu", times["median"]))


def compared(condition: Condition, name: str, base: Drawn, own: Drawn, device: wp.Device) -> dict[str, Any]:
    """The row of a condition and a set of outputs."""
    base.prepare(cases.WANTED[name])
    own.prepare(replace(cases.WANTED[name], **condition.wanted))
    before, there, after = (drawn.milliseconds(device) for drawn in (base, own, base))
    pixel, usual = 1e6 * there / own.problem.rays, 0.5e6 * (before + after) / base.problem.rays
    return {
        "condition": condition.name,
        "base": condition.base,
        "outputs": name,
        "size": [own.problem.width, own.problem.height],
        "ms": there,
        "base_ms": [before, after],
        "ns_per_pixel": pixel,
        "base_ns_per_pixel": usual,
        "ratio": pixel / usual,
        "share": pixel / usual / condition.times,
    }


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if wp.is_cuda_available() else "cpu")
    parser.add_argument("--worlds", type=int, default=1024)
    parser.add_argument("--size", default="128x128", metavar="WxH", help="pixels of an image")
    parser.add_argument("--only", nargs="+", choices=CONDITIONS, metavar="CONDITION", help=", ".join(CONDITIONS))
    parser.add_argument("--outputs", nargs="+", choices=OUTPUTS, default=OUTPUTS, metavar="NAME")
    parser.add_argument("--out", type=Path, help="JSON file, written after each condition")
    options = parser.parse_args(arguments)
    setting = cases.resized(cases.SETTINGS["1024x128"], options.worlds, options.size)
    device, size = wp.get_device(options.device), (setting.width, setting.height)
    rows: list[dict[str, Any]] = []
    report = {"about": __doc__, "machine": machine.describe(device), "worlds": options.worlds, "results": rows}
    print(f"{'condition':26} {'outputs':12} {'ms':>9} {'ns a pixel':>11} {'base':>8} {'ratio':>6} {'share':>6}")
    with wp.ScopedDevice(device):
        bases: dict[str, Drawn] = {}
        for condition in map(CONDITIONS.__getitem__, options.only or CONDITIONS):
            if condition.base not in bases:
                bases = {condition.base: Drawn(CONDITIONS[condition.base], options.worlds, size)}
            own = Drawn(condition, options.worlds, size)
            for name in options.outputs:
                row = compared(condition, name, bases[condition.base], own, device)
                rows.append(row)
                print(
                    f"{condition.name:26} {name:12} {row['ms']:9.3f} {row['ns_per_pixel']:11.4f} "
                    f"{row['base_ns_per_pixel']:8.4f} {row['ratio']:6.2f} {row['share']:6.2f}",
                    flush=True,
                )
                if options.out:
                    options.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
