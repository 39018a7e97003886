"""A data set before it is made: everything that its samples follow from."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.datasets.generate.image_files import image_files
from warpcam.datasets.generate.recipes import Recipes
from warpcam.datasets.generate.scene_files import digest_of, digests
from warpcam.sources.common import formats


@dataclass(frozen=True)
class Plan:
    """What to make, without anything of a device: it can be pickled and sent to other processes and machines.

    A sample is one world, seen by all cameras. It follows from the plan and its number alone. Shard ``k`` has the
    samples from ``k * shard_size`` on.

    Attributes:
        scene: File of the scene.
        out: Folder of the data set.
        writer: Name of its format: a key of ``warpcam.datasets.writers.WRITERS``.
        count: How many samples.
        seed: Of all random numbers.
        width: Of an image [pixels].
        height: Of an image [pixels].
        cameras: Names or indices of the scene's cameras; None is those of the recipes, else all.
        recipes: How samples differ.
        shard_size: Samples of a shard.
        worlds: Worlds that are drawn at once. Samples do not depend on it.
        device: Name of the device; None is the first GPU, or the CPU.
        image_format: "png" or "jpg" of colour images.
        quality: Of .jpg, from 1 to 95.
        jpeg: What encodes .jpg: "pillow", in threads of the host, or "torchcodec", on the device: nvJPEG on GPUs.
        antialiasing: As ``Camera`` has it.
        validation: Share of the samples, drawn by number, that are listed for validation.
        options: Of the writer, by name.
        trusted: As ``warpcam.load`` has it. Folders that the recipes name are the user's own, wherever they are.
        search_paths: As ``warpcam.load`` has it.
    """

    scene: str
    out: str
    writer: str
    count: int
    seed: int = 0
    width: int = 640
    height: int = 480
    cameras: tuple[str, ...] | None = None
    recipes: Recipes = field(default_factory=Recipes)
    shard_size: int = 100
    worlds: int = 16
    device: str | None = None
    image_format: str = "jpg"
    quality: int = 92
    jpeg: str = "pillow"
    antialiasing: int = 4
    validation: float = 0.0
    options: tuple[tuple[str, Any], ...] = ()
    trusted: bool = False
    search_paths: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, low, high in (
            ("count", 1, 10**9),
            ("seed", 0, 2**63 - 1),
            ("width", 1, 2**15),
            ("height", 1, 2**15),
            ("shard_size", 1, 10**6),
            ("worlds", 1, 2**20),
            ("quality", 1, 95),
        ):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise WarpcamError(f"dataset: {name} must be a whole number from {low} to {high}, got {value!r}")
        if self.image_format not in ("png", "jpg"):
            raise WarpcamError(f"dataset: image_format must be 'png' or 'jpg', got {self.image_format!r}")
        if self.jpeg not in ("pillow", "torchcodec"):
            raise WarpcamError(f"dataset: jpeg must be 'pillow' or 'torchcodec', got {self.jpeg!r}")
        if self.jpeg == "torchcodec" and (self.image_format != "jpg" or self.recipes.backgrounds is not None):
            raise WarpcamError("dataset: jpeg 'torchcodec' is for .jpg, and for recipes without backgrounds")
        if not 0.0 <= self.validation < 1.0:
            raise WarpcamError(f"dataset: validation must be a share from 0 to below 1, got {self.validation!r}")
        known = (*formats.MUJOCO, *formats.USD, *formats.MESHES)
        if Path(self.scene).suffix.lower() not in known:
            raise WarpcamError(f"scene: {self.scene!r} came; known are {', '.join(known)}")
        if not Path(self.scene).is_file():
            raise WarpcamError(f"scene: there is no file {self.scene!r}")
        self.access()

    def access(self) -> FileAccess:
        """What the scene may open.

        Raises:
            WarpcamError: ``trusted`` or ``search_paths`` cannot be used.
        """
        return FileAccess(Path(self.scene), self.trusted, self.search_paths, where="dataset")

    @property
    def num_shards(self) -> int:
        """How many shards."""
        return -(-self.count // self.shard_size)

    def samples(self, shard: int) -> range:
        """Samples of a shard."""
        first = shard * self.shard_size
        return range(first, min(first + self.shard_size, self.count))

    def parameters(self) -> dict[str, Any]:
        """All that samples follow from, as plain values of JSON, by name; what they do not follow from is left out.

        ``count`` is not among them: a data set may grow. All files that samples follow from are read for their digests.
        """
        plain = asdict(self)
        for name in ("out", "count", "worlds", "device", "trusted", "search_paths"):
            del plain[name]
        plain["scene"] = Path(self.scene).name
        plain["scene_sha256"] = digests(Path(self.scene), self.access())
        for name in ("textures", "backgrounds"):
            recipe = getattr(self.recipes, name)
            if recipe is not None:
                plain[f"{name}_sha256"] = digest_of(image_files(recipe.folder, f"{name}: folder"))
        return json.loads(json.dumps(plain))


def different(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Names of parameters that differ, nested ones joined by points."""
    found = []
    for name in dict.fromkeys([*old, *new]):
        first, second = old.get(name), new.get(name)
        if isinstance(first, dict) and isinstance(second, dict):
            found += [f"{name}.{each}" for each in different(first, second)]
        elif first != second:
            found.append(name)
    return found
