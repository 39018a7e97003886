"""Cases of the benchmark, as data: scenes with their cameras, settings, and sets of outputs."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import mujoco

from warpcam.benchmarks import cabinet, procedural_scenes, scenes
from warpcam.core.errors import WarpcamError
from warpcam.kernels.outputs import OUTPUTS


@dataclass(frozen=True)
class Cloth:
    """A square cloth of particles: cells across and along, two triangles each, its side and height [m]."""

    cells: tuple[int, int]
    size: float
    height: float


@dataclass(frozen=True)
class Case:
    """One scene and the cameras that look at it.

    Attributes:
        package: The package its files come with, or None for a scene that is made here.
        share: A setting's worlds are divided by this, where a world has several cameras.
        cpu_worlds: How many worlds are drawn on a CPU.
        scatter: How far free bodies are moved from where the scene has them: up to this along each axis [m], and
            turned up to this about each [rad].
        newton: warpcam looks at it through `from_newton`, as at the model that Newton's own camera sees.
        cloth: What hangs in each world; only Newton has it.
        flexes: MuJoCo's flexes are drawn, too; what Newton makes of them is another thing.
        keyframe: Bodies move around the model's first keyframe, if it has one, not around its reference pose.
    """

    name: str
    about: str
    spec: Callable[[], mujoco.MjSpec]
    cameras: tuple[str, ...]
    package: str | None = None
    share: int = 1
    cpu_worlds: int = 64
    scatter: tuple[float, float] = (0.05, 0.5)
    newton: bool = False
    cloth: Cloth | None = None
    flexes: bool = False
    keyframe: bool = False

    def seen_by(self, renderer: str) -> bool:
        return renderer in ("warpcam", "newton") if self.newton else not (self.flexes and renderer == "newton")


@dataclass(frozen=True)
class Setting:
    """Number of worlds and pixels; None for worlds takes the case's own number for a CPU."""

    name: str
    worlds: int | None
    width: int
    height: int

    def worlds_of(self, case: Case) -> int:
        return case.cpu_worlds if self.worlds is None else max(1, self.worlds // case.share)


@dataclass(frozen=True)
class Wanted:
    """A set of outputs that is rendered together."""

    name: str
    outputs: tuple[str, ...]
    shadows: bool = False
    textures: bool = False
    by_peers: bool = True  # whether the peers can be asked for it
    antialiasing: int = 1  # samples where edges are
    reflections: bool = False
    transparency: bool = False


MUJOCO_WARP, MJLAB = "mujoco_warp", "mjlab"
ALOHA_CAMERAS = ("overhead_cam", "worms_eye_cam", "wrist_cam_left", "wrist_cam_right")
PRIMITIVES = partial(scenes.from_mujoco_warp, "primitives.xml")
HUMANOID = partial(scenes.from_mujoco_warp, "humanoid/humanoid.xml")
HUMANOIDS = partial(scenes.from_mujoco_warp, "humanoid/n_humanoid.xml")
ALOHA = partial(scenes.from_mujoco_warp, "aloha_pot/scene.xml")
MUG = partial(scenes.from_mujoco_warp, "mug/mug.xml")
FLOPPY = partial(scenes.from_mujoco_warp, "flex/floppy.xml")

CASES = {
    case.name: case
    for case in (
        Case("primitives", "125 bodies scattered", PRIMITIVES, ("camera0",), MUJOCO_WARP, scatter=(0.3, 3.0)),
        Case("primitives_rows", "125 bodies in rows over a table", PRIMITIVES, ("camera0",), MUJOCO_WARP),
        Case("humanoid", "capsules on a plane, two lights", HUMANOID, ("side",), MUJOCO_WARP),
        Case("n_humanoid", "three humanoids, ten lights", HUMANOIDS, ("_side-1",), MUJOCO_WARP),
        Case("shapes_256", "256 free shapes in a grid", procedural_scenes.shapes_256, ("fixed",), scatter=(0.1, 3.0)),
        Case("quadruped", "walking robot of primitives", procedural_scenes.quadruped, ("fixed",), scatter=(0.2, 0.3)),
        Case("room_1000", "a furnished room of 1,000 shapes", procedural_scenes.room, ("fixed",), cpu_worlds=16),
        Case("mug", "one textured mesh of 25 thousand faces", MUG, ("camera0",), MUJOCO_WARP, scatter=(0.02, 0.5)),
        Case("yam", "robot arm of 18 meshes", scenes.yam_arm, ("fixed",), MJLAB, cpu_worlds=16),
        Case("go1", "robot of 13 meshes on a plane", scenes.go1_on_plane, ("fixed",), MJLAB, cpu_worlds=16),
        Case("aloha_pot", "two arms, four cameras", ALOHA, ALOHA_CAMERAS, MUJOCO_WARP, share=4, cpu_worlds=4),
        Case("g1_terrain", "robot of 35 meshes on hills", scenes.g1_on_terrain, ("fixed",), MJLAB, cpu_worlds=16),
        Case(
            "terrain_256",
            "hills of 256 x 256 cells",
            procedural_scenes.terrain,
            ("drone",),
            cpu_worlds=16,
            scatter=(3.0, 0.3),
        ),
        Case(
            "flex", "a soft body of 384 points", FLOPPY, ("camera0",), MUJOCO_WARP, share=16, cpu_worlds=4, flexes=True
        ),
        Case("franka_cabinet", "arm at a cabinet", cabinet.arm_at_cabinet, ("fixed",), MJLAB, cpu_worlds=16),
    )
}
# What Newton's own benchmark of its camera has, as models of Newton; and cloth, which only Newton has.
CASES |= {
    case.name: case
    for case in (
        *(
            replace(CASES[name], name=f"newton_{name}", newton=True)
            for name in ("shapes_256", "quadruped", "franka_cabinet")
        ),
        Case(
            "newton_cloth", "a cloth of 10,000 triangles over a ball", cabinet.ball_under_cloth, ("fixed",),
            share=16, cpu_worlds=4, newton=True, cloth=Cloth((50, 100), 1.2, 0.65),
        ),
    )
}  # fmt: skip

SETTINGS = {
    setting.name: setting
    for setting in (
        Setting("8192x64", 8192, 64, 64),
        Setting("4096x64", 4096, 64, 64),
        Setting("1024x64", 1024, 64, 64),
        Setting("1024x128", 1024, 128, 128),
        Setting("1024x256", 1024, 256, 256),
        Setting("1x640x480", 1, 640, 480),
        Setting("16x640x480", 16, 640, 480),
        Setting("4x1280x720", 4, 1280, 720),
        Setting("1x1920x1080", 1, 1920, 1080),
        Setting("16x1920x1080", 16, 1920, 1080),
        Setting("cpu", None, 64, 64),
    )
}

DEPTH_AND_IDS = Wanted("ds", ("depth", "segmentation"))
COMMON = {
    wanted.name: wanted
    for wanted in (
        DEPTH_AND_IDS,
        Wanted("rgb", ("rgb",), textures=True),
        Wanted("rgb-shadows", ("rgb",), shadows=True, textures=True),
        Wanted("rgb-ds-shadows", ("rgb", "depth", "segmentation"), shadows=True, textures=True),
    )
}
# What each other output costs on top of depth and segmentation.
EXTRAS = {
    f"ds+{name}": Wanted(f"ds+{name}", (*DEPTH_AND_IDS.outputs, name), textures=True, by_peers=False)
    for name in OUTPUTS
    if name not in DEPTH_AND_IDS.outputs
}
# What Newton's own benchmark asks for.
COLOR_AND_DEPTH = Wanted("rgb-d-shadows", ("rgb", "depth"), shadows=True, textures=True)
# What peers do not draw, and what it costs beside the same without: "rgb-smooth", ...
MORE: Mapping[str, Mapping[str, Any]] = {
    "smooth": {"antialiasing": 4},
    "reflections": {"reflections": True},
    "transparency": {"transparency": True},
}
BESIDE = {
    f"{name}-{more}": replace(COMMON[name], name=f"{name}-{more}", by_peers=False, **options)
    for name in ("rgb", "rgb-shadows")
    for more, options in MORE.items()
}
WANTED = {**COMMON, COLOR_AND_DEPTH.name: COLOR_AND_DEPTH, **BESIDE, **EXTRAS}


def resized(setting: Setting, worlds: int | None, size: str | None) -> Setting:
    """The setting with the worlds and the size WxH that were asked for, if they were, in place of its own."""
    if worlds is not None:
        setting = replace(setting, worlds=positive("--worlds", worlds))
    if size is not None:
        match = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", size)
        if match is None:
            raise WarpcamError(f"--size: {size!r} came, width x height in pixels like 64x64 is needed")
        setting = replace(setting, width=int(match[1]), height=int(match[2]))
    return setting


def positive(option: str, value: int) -> int:
    if value < 1:
        raise WarpcamError(f"{option}: {value} came, at least 1 is needed")
    return value
