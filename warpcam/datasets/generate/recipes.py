"""What a YAML file says of how samples differ, and of what is labelled."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import Limits
from warpcam.datasets.generate.strict import (
    by_name,
    dataclass_by_name,
    flag,
    folder,
    freeze,
    names,
    nested,
    number,
    one_of,
    optional,
    read_dataclass,
    read_file,
    read_mapping,
    setting,
    span,
    vector,
)

SHAPES = ("box", "sphere", "capsule", "cylinder", "ellipsoid")


@dataclass(frozen=True)
class Placement:
    """Where a body is placed.

    Attributes:
        low: Lowest position in the world [m].
        high: Highest position [m].
        rotation: "keep" as the scene has it, "yaw" any angle about the vertical, "any".
    """

    low: tuple[float, ...] = setting(vector(3))
    high: tuple[float, ...] = setting(vector(3))
    rotation: str = setting(one_of("keep", "yaw", "any"), "any")


@dataclass(frozen=True)
class Shell:
    """Positions of a camera on a shell around what it looks at.

    Attributes:
        radius: Distance from the target [m].
        target: What it looks at [m]; None is the middle of the scene's bounds.
        spread: By how much the target moves at most along each axis [m].
        azimuth: About the vertical [degrees]; 0 is seen from +x.
        elevation: Above the horizontal [degrees].
        roll: About the line of sight [degrees].
    """

    radius: tuple[float, float] = setting(span(1e-6))
    target: tuple[float, ...] | None = setting(optional(vector(3)), None)
    spread: tuple[float, ...] = setting(vector(3), (0.0, 0.0, 0.0))
    azimuth: tuple[float, float] = setting(span(), (0.0, 360.0))
    elevation: tuple[float, float] = setting(span(-90.0, 90.0), (10.0, 80.0))
    roll: tuple[float, float] = setting(span(), (0.0, 0.0))


@dataclass(frozen=True)
class CameraRecipe:
    """One camera: of the scene, or with a shell one of its own.

    Attributes:
        shell: Where it is.
        fovy: Vertical field of view [degrees]; None is the scene's, or 45.
        exposure: Logarithm to base 2 of a factor of all light.
        gain: Factor of red, green and blue, each drawn alone.
    """

    shell: Shell | None = setting(optional(nested(Shell)), None)
    fovy: tuple[float, float] | None = setting(optional(span(1e-3, 179.0)), None)
    exposure: tuple[float, float] | None = setting(optional(span(-127.0, 127.0)), None)
    gain: tuple[float, float] | None = setting(optional(span(0.0)), None)


@dataclass(frozen=True)
class Draw:
    """Random values of one attribute, as ``warpcam.Uniform`` or ``warpcam.Choice`` has them; ``rows`` may be names."""

    low: Any = setting(lambda value, where: freeze(value), None)
    high: Any = setting(lambda value, where: freeze(value), None)
    of: str = setting(one_of("value", "offset", "factor", "turn"), "value")
    rows: Any = setting(lambda value, where: freeze(value), None)
    linked: bool = setting(flag, False)
    choice: Any = setting(lambda value, where: freeze(value), None)


def read_draw(value: Any, where: str) -> Draw:
    """``[from, to]``, or a mapping with ``low`` and ``high``, or with ``choice``."""
    if isinstance(value, list):
        return Draw(*span()(value, where))
    draw = read_dataclass(Draw, value, where)
    if (draw.choice is None) == (draw.low is None or draw.high is None):
        raise WarpcamError(f"{where}: either low and high or choice is needed, got {value!r}")
    return draw


@dataclass(frozen=True)
class Textures:
    """Images of a folder on shapes of the scene.

    Attributes:
        folder: Of the images: .png, .jpg, .jpeg.
        names: Patterns of names: of shapes in MuJoCo's scenes, of materials in others.
        repeat: How often the image is repeated.
    """

    folder: str = setting(folder)
    names: tuple[str, ...] = setting(names, ("*",))
    repeat: tuple[float, float] = setting(span(0.0), (1.0, 1.0))


@dataclass(frozen=True)
class Backgrounds:
    """Photographs where the scene is not, in ``rgb``.

    Attributes:
        folder: Of the images: .png, .jpg, .jpeg.
        probability: Share of the images that have one.
    """

    folder: str = setting(folder)
    probability: float = setting(number(0.0, 1.0), 1.0)


@dataclass(frozen=True)
class Distractors:
    """Things that are not labelled.

    Attributes:
        count: How many a sample has.
        low: Lowest position [m].
        high: Highest position [m].
        size: Half of what they span at most [m].
        shapes: Of which kinds.
    """

    count: tuple[int, int] = setting(span(0, 1000, whole=True))
    low: tuple[float, ...] = setting(vector(3))
    high: tuple[float, ...] = setting(vector(3))
    size: tuple[float, float] = setting(span(1e-6), (0.02, 0.1))
    shapes: tuple[str, ...] = setting(lambda value, where: tuple(map_shapes(value, where)), SHAPES)


def map_shapes(value: Any, where: str) -> list[str]:
    return [one_of(*SHAPES)(each, where) for each in names(value, where)]


@dataclass(frozen=True)
class SensorRecipe:
    """What measures a camera's images.

    Attributes:
        model: Name of a depth camera, as ``warpcam render --sensor`` takes it.
        effects: Effects in their order: mappings with a ``name`` of ``warpcam.sensors`` and its parameters.
        randomize: Of the effects' parameters, by name.
    """

    model: str | None = setting(optional(lambda value, where: names(value, where)[0]), None)
    effects: tuple[Any, ...] = setting(lambda value, where: _effects(value, where), ())
    randomize: tuple[tuple[str, Draw], ...] = setting(by_name(read_draw), ())


def _effects(value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise WarpcamError(f"{where}: a list of effects is needed, got {value!r}")
    for each in value:
        if "name" not in read_mapping(each, where):
            raise WarpcamError(f"{where}: each effect needs a name, got {each!r}")
    return freeze(value)


@dataclass(frozen=True)
class LabelRecipe:
    """What is labelled.

    Attributes:
        by: What an instance is, as ``warpcam.labels`` has it; None: "body" in MuJoCo's scenes, in others "semantic" if
            there are labels, else "instance" or "body".
        classes: Patterns of names of instances, by class. None: each instance that has a name is of its own class.
        keypoints: Whether MuJoCo's sites are keypoints of their bodies.
    """

    by: str | None = setting(optional(one_of("body", "shape", "instance", "semantic")), None)
    classes: tuple[tuple[str, tuple[str, ...]], ...] | None = setting(optional(by_name(names)), None)
    keypoints: bool = setting(flag, False)


@dataclass(frozen=True)
class Recipes:
    """Everything that a YAML file may say.

    Attributes:
        joints: "random" within their ranges, as ``warpcam render`` draws them, or as the "file" has them; MuJoCo's
            scenes.
        poses: Bodies that are placed, by patterns of their names (MuJoCo) or paths.
        spacing: Least distance between positions of things that are placed [m].
        cameras: By name. None: those of the scene, or one that sees all of it.
        scene: Attributes of ``Scene.vary``, drawn by ``warpcam.randomize``.
        textures: Images on shapes.
        backgrounds: Images behind the scene.
        distractors: Things that are not labelled.
        sensors: By camera.
        labels: What is labelled.
    """

    joints: str = setting(one_of("random", "file"), "random")
    poses: tuple[tuple[str, Placement], ...] = setting(dataclass_by_name(Placement), ())
    spacing: float = setting(number(0.0), 0.0)
    cameras: tuple[tuple[str, CameraRecipe], ...] | None = setting(optional(dataclass_by_name(CameraRecipe)), None)
    scene: tuple[tuple[str, Draw], ...] = setting(by_name(read_draw), ())
    textures: Textures | None = setting(optional(nested(Textures)), None)
    backgrounds: Backgrounds | None = setting(optional(nested(Backgrounds)), None)
    distractors: Distractors | None = setting(optional(nested(Distractors)), None)
    sensors: tuple[tuple[str, SensorRecipe], ...] = setting(dataclass_by_name(SensorRecipe), ())
    labels: LabelRecipe = setting(nested(LabelRecipe), LabelRecipe())


def read_recipes(path: Path | None, limits: Limits | None = None) -> Recipes:
    """What a YAML file says; without a file, joints of MuJoCo's scenes are random and all else is the scene's.

    Folders that the file names may be anywhere: a recipe is the user's own.

    Args:
        path: Of the file.
        limits: Of its size, and of the entries that aliases stand for; None is ``warpcam.Limits()``.

    Raises:
        WarpcamError: The file cannot be read, something in it is not known or not allowed, or over a limit.
    """
    return Recipes() if path is None else read_file(Recipes, path, limits)
