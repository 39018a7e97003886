"""Material libraries of OBJ files (.mtl): statements of each material, and the files that they name.

Colours are display colours, as the programs that write these files take them.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from warpcam.core.file_access import FileAccess
from warpcam.sources.common.images import UnreadableError, decoded
from warpcam.sources.common.materials import BARE, WHITE
from warpcam.sources.common.opacity import opacity_of
from warpcam.sources.common.scene_graph import Material
from warpcam.sources.common.warnings import WarningCollector

NUMBERS = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2, "-boost": 1, "-bm": 1, "-texres": 1}  # options with numbers, at most
WORDS = ("-blendu", "-blendv", "-clamp", "-cc", "-imfchan", "-type", "-colorspace")
WITHOUT_EFFECT = ("-blendu", "-blendv", "-boost", "-cc", "-texres", "-type", "-bm")  # of filters and of other maps
DRAWN = ("kd", "map_kd", "ks", "ns", "d", "tr", "map_d", "ke", "map_ke", "norm", "pr", "pm", "illum")
LIGHTING = ("ka", "map_ka", "ni", "sharpness", "tf")  # of other models of light
SPECULAR = 0.08  # reflectance of a material whose Ks is 1: 0.5, which most programs write, is an index of 1.5


@dataclass(frozen=True)
class TextureMap:
    """A statement that names an image: its file name as it is written, and its options."""

    file: str
    options: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def numbers(self, option: str, default: tuple[float, ...]) -> np.ndarray:
        """Values of an option, as many as ``default`` has; those that are not given are of ``default``."""
        given = [float(value) for value in self.options.get(option, ())][: len(default)]
        return np.array([*given, *default[len(given) :]])


@dataclass(frozen=True, eq=False)
class ObjLook:
    """A material with the places of its images.

    Attributes:
        material: Its look; ``texture`` and the like are indices of the graph.
        scale: (2,) factor of texture coordinates.
        offset: (2,) added to them afterwards.
    """

    material: Material
    scale: np.ndarray
    offset: np.ndarray


def text_of(data: bytes) -> str:
    """Decode an OBJ file or a library, so that names in both are the same: UTF-8, or else Latin-1."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def libraries_of(text: str) -> list[str]:
    """Return what an OBJ file writes behind ``mtllib``: a file name each, or several, or one with spaces."""
    return [rest for key, rest in _statements(text) if key == "mtllib" and rest]


def used_materials(text: str) -> list[str]:
    """Return the names of the materials that an OBJ file uses, each once."""
    return list(dict.fromkeys(rest for key, rest in _statements(text) if key == "usemtl" and rest))


def read_libraries(
    names: Sequence[str], read: Callable[[str], str | None], missing: Callable[[str], None]
) -> dict[str, dict[str, str]]:
    """Return the statements of all materials of some libraries by their names, keywords in lower case.

    Args:
        names: Of ``libraries_of``.
        read: Gives a file's text, or None if there is none.
        missing: Hears of names that are not found.
    """
    found: dict[str, dict[str, str]] = {}
    for line in names:
        files = [read(line)]
        if files[0] is None:  # several names, or one that is not there
            files = [read(name) for name in line.split()]
            if any(data is None for data in files):
                missing(line)
        for data in files:
            own: dict[str, str] = {}
            for key, rest in _statements(data or ""):
                if key == "newmtl":
                    own = found[rest] = {}
                else:
                    own[key] = rest
    return found


def texture_map(text: str) -> TextureMap:
    """Read what stands behind ``map_Kd`` and the like: options, then a file name, in which there may be spaces."""
    options: dict[str, Sequence[str]] = {}
    rest = text.strip()
    while match := re.match(r"(-\w+)\s+", rest):
        option, rest = match[1].lower(), rest[match.end() :]
        if option in NUMBERS:
            values = re.match(rf"(?:[-+.\d][-+.\deE]*\s+){{0,{NUMBERS[option]}}}", rest)
            taken = values[0] if values else ""
        else:
            taken = (re.match(r"\S+\s+", rest) or [""])[0] if option in WORDS else ""
        options[option], rest = taken.split(), rest[len(taken) :]
    return TextureMap(rest, options)


class LookReader:
    """Reader of the materials of one OBJ file.

    Args:
        library: Of ``read_libraries``.
        read: Gives a file's contents, or None if there is none.
        access: Limits of sizes.
        texture: Adds an image to the scene: its name, its pixels, whether it is one of colours. Returns its index.
        collector: Hears of what is not drawn.
    """

    def __init__(
        self,
        library: Mapping[str, Mapping[str, str]],
        read: Callable[[str], bytes | None],
        access: FileAccess,
        texture: Callable[[str, np.ndarray, bool], int],
        collector: WarningCollector,
    ):
        self._library, self._read, self._texture, self._collector = library, read, texture, collector
        self._access = access
        self._images: dict[str, np.ndarray | None] = {}

    def look(self, name: str) -> ObjLook:
        said = self._library[name]
        for key in said:
            if key not in (*DRAWN, *LIGHTING):
                self._collector.warn(f"has {key}, which is not drawn", name)
        color_map, pixels = self._map(name, said, "map_kd")
        emission_map, emission = self._map(name, said, "map_ke")
        _, normals = self._map(name, said, "norm")
        opacity, opacity_map = self._opacity(name, said)
        emitted = self._color(name, said, "ke", None)
        gloss, specular = self._number(name, said, "ns"), self._values(name, said, "ks")
        first = color_map or emission_map or TextureMap("")
        clamps = "".join(first.options.get("-clamp", ())).lower() == "on"
        flat = str(said.get("illum", "")).strip() in ("0", "1")
        rough = self._number(name, said, "pr")
        if rough is None and gloss is not None:
            rough = float((2.0 / (max(gloss, 0.0) + 2.0)) ** 0.25)  # an exponent of Blinn's as roughness of GGX
        reflectance = 0.04 if specular is None else SPECULAR * float(np.mean(specular))
        material = Material(
            name,
            self._color(name, said, "kd", BARE if pixels is None else WHITE) or WHITE,
            opacity=opacity,
            roughness=0.5 if rough is None else rough,
            metallic=self._number(name, said, "pm") or 0.0,
            reflectance=0.0 if flat else reflectance,
            emission=emitted or ((0.0,) * 3 if emission is None else WHITE),
            texture=-1 if pixels is None else self._texture(name, pixels, True),
            normals=-1 if normals is None else self._texture(f"{name}/normals", normals, False),
            emission_texture=-1 if emission is None else self._texture(f"{name}/emission", emission, True),
            opacity_map=opacity_map,
            wrap=("clamp", "clamp") if clamps else ("repeat", "repeat"),
        )
        scale, offset = first.numbers("-s", (1.0, 1.0))[:2], first.numbers("-o", (0.0, 0.0))[:2]
        return ObjLook(material, scale, offset)

    def _map(self, name: str, said: Mapping[str, str], key: str) -> tuple[TextureMap | None, np.ndarray | None]:
        if not said.get(key):
            return None, None
        found = texture_map(said[key])
        for option in found.options:
            if option not in ("-s", "-o", "-clamp", "-mm", *WITHOUT_EFFECT):
                self._collector.warn(f"has a texture with the option {option}, which is not drawn", name)
        if found.file not in self._images:
            data, pixels = self._read(found.file), None
            if data is not None:
                try:
                    pixels = decoded(data, self._access, found.file)
                except UnreadableError as error:
                    what = f"a texture cannot be read ({error}), and its material is drawn in its base colour"
                    self._collector.warn(what, found.file)
            self._images[found.file] = pixels
        pixels = self._images[found.file]
        if pixels is None:
            return None, None
        base, gain = found.numbers("-mm", (0.0, 1.0))
        if (base, gain) != (0.0, 1.0):
            pixels = np.rint(np.clip(255.0 * base + gain * pixels, 0.0, 255.0)).astype(np.uint8)
        return found, pixels

    def _opacity(self, name: str, said: Mapping[str, str]) -> tuple[float, int]:
        """Opacity, and the index of its map or -1; ``Tr`` is what ``d`` lacks of 1."""
        value = self._number(name, said, "d")
        if value is None and (clear := self._number(name, said, "tr")) is not None:
            value = 1.0 - clear
        factor = 1.0 if value is None else float(np.clip(value, 0.0, 1.0))
        _, pixels = self._map(name, said, "map_d")
        if pixels is None:
            return factor, -1
        values = pixels[..., 3 if pixels.shape[2] == 4 else 0] / 255.0
        opacity, drawn = opacity_of(values, factor, 0.0)
        return opacity, -1 if drawn is None else self._texture(f"{name}/opacity", drawn, False)

    def _number(self, name: str, said: Mapping[str, str], key: str) -> float | None:
        if key not in said:
            return None
        try:
            value = float(said[key].split()[-1])
        except (ValueError, IndexError):
            value = np.nan
        if not np.isfinite(value):
            what = "d that is not a finite number, and is solid" if key == "d" else f"{key} that is not a finite number"
            self._collector.warn(f"has {what}", name)
            return None
        return value

    def _color(self, name: str, said: Mapping[str, str], key: str, default: Any) -> Any:
        """A linear colour of a display colour of one number or three; ``default`` where there is none."""
        values = self._values(name, said, key)
        if values is None:
            return default
        red, green, blue = (float(linear(value)) for value in values)
        return red, green, blue

    def _values(self, name: str, said: Mapping[str, str], key: str) -> list[float] | None:
        if key not in said:
            return None
        try:
            values = [float(value) for value in said[key].split()]
        except ValueError:
            values = []
        if len(values) not in (1, 2, 3) or not np.isfinite(values).all():
            self._collector.warn(f"has {key} that is not one number or three", name)
            return None
        return [*values, *values[-1:] * 2][:3]


def linear(value: float) -> float:
    """The inverse of the sRGB transfer function, of a value that is cut off at 0 and 1."""
    value = min(max(value, 0.0), 1.0)
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def _statements(text: str) -> Iterator[tuple[str, str]]:
    """Yield keyword, in lower case, and rest of each line."""
    for line in text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines():
        parts = line.split(None, 1)
        if parts and not parts[0].startswith("#"):
            yield parts[0].lower(), parts[1].strip() if len(parts) > 1 else ""
