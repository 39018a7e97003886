"""Files and sizes that an MJCF file names: checked before MuJoCo, which follows every path, opens or makes them."""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, is_file

# What MuJoCo's reader of XML, tinyxml2, takes for tags: more than XML allows.
ASIDE = re.compile(r"<\s*(?:!--.*?--|!\[CDATA\[.*?\]\]|\?.*?\?|![^>]*)>", re.DOTALL)
BEGIN = re.compile(r"<\s*(/?)([^\s/>\"'=<]+)")
ATTRIBUTE = re.compile(r"\s*([^\s/>\"'=<]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
END = re.compile(r"\s*(/?)\s*>")
ENTITY = re.compile(r"&(?:#x([0-9a-fA-F]+)|#([0-9]+)|(lt|gt|amp|quot|apos));")
NAMED = {"lt": "<", "gt": ">", "amp": "&", "quot": '"', "apos": "'"}
SCHEME = re.compile(r"^\w+://")
FOLDERS = ("meshdir", "texturedir", "assetdir")
UNITS = {"K": 10, "M": 20, "G": 30, "T": 40, "P": 50, "E": 60}  # powers of two of <size memory>
PNG = b"\x89PNG\r\n\x1a\n"
ASSETS = ("meshes", "textures", "hfields", "skins")


@dataclass(frozen=True)
class _Tag:
    """A tag; ``ends`` is 0 for one that opens an element, 1 for one that closes it, 2 for an element of one tag."""

    name: str
    attributes: dict[str, str]
    ends: int


@dataclass
class _Named:
    """What a model names: files by their element, the folders that they may be named from, and models."""

    files: list[tuple[str, str]] = field(default_factory=list)
    bases: list[Path] = field(default_factory=list)
    folders: list[str] = field(default_factory=lambda: [""])
    models: list[Path] = field(default_factory=list)
    attached: int = 0  # how many copies of models the model has


def read_spec(path: Path, access: FileAccess) -> Any:
    """The MjSpec of a file, whose files and sizes are checked; files are looked for in the search paths, too.

    Raises:
        RefusedError: A file lies outside of what may be opened, or a size is over a limit.
        ValueError: MuJoCo cannot read the file.
    """
    import mujoco

    check(path, access)
    spec = mujoco.MjSpec.from_file(str(path))
    folders = ["", *(folder for folder in (spec.meshdir, spec.texturedir) if folder)]
    for asset in (asset for name in ASSETS for asset in getattr(spec, name)) if access.search_paths else ():
        if asset.file and not any(map(is_file, _places(asset.file, [path.parent], folders))):
            found = access.find(path.parent, asset.file)
            if is_file(found):
                access.check_file(found)
                check_content(found, asset_kind(asset), access)
                asset.file = str(found.resolve())
    return spec


def asset_kind(asset: Any) -> str:
    """Return "hfield" of an MjsHField, and the like."""
    return type(asset).__name__.removeprefix("Mjs").lower()


def check(path: Path, access: FileAccess, copies: int = 1, above: tuple[Path, ...] = ()) -> None:
    """Raise ``RefusedError`` for what a file names, itself or by what it includes, that may not be opened or made."""
    if path.resolve() in above:
        raise WarpcamError(f"{path}: is a model that has itself for a part")
    named = _Named()
    _scan(path, path.parent, access, named, copies, set())
    for kind, name in named.files:
        for place in _places(name, named.bases, named.folders):
            access.check_file(place)
            if is_file(place):
                check_content(place, kind, access)
    for model in named.models:
        if is_file(model):
            check(model, access, max(named.attached, 1), (*above, path.resolve()))


def check_content(path: Path, kind: str, access: FileAccess) -> None:
    """Raise ``RefusedError`` for a file whose header claims more than the limits allow."""
    with path.open("rb") as file:
        head = file.read(24)
    if head[:8] == PNG and len(head) == 24:
        width, height = (int.from_bytes(head[at : at + 4], "big") for at in (16, 20))
        access.check("image_pixels", width * height, str(path))
        access.take(4 * width * height, str(path))
    elif kind == "hfield" and len(head) >= 8:
        rows, columns = (int.from_bytes(head[at : at + 4], "little", signed=True) for at in (0, 4))
        size = path.stat().st_size
        access.check("elements", rows * columns, str(path))
        if min(rows, columns) < 0 or 8 + 4 * rows * columns != size:
            raise WarpcamError(
                f"{path}: is no height field: its header says {rows} x {columns} cells, which are "
                f"{8 + 4 * rows * columns} bytes; it has {size}"
            )


def _places(name: str, bases: list[Path], folders: list[str]) -> Iterator[Path]:
    """Where MuJoCo may look for a file, as the compiler's settings may have it."""
    written = name.replace("\\", "/")
    plain = SCHEME.sub("", written)
    names = dict.fromkeys((name, written, plain, os.path.normpath(plain), plain.rpartition("/")[2]))
    found = (base / folder / each for base in bases for folder in folders for each in names if each)
    yield from dict.fromkeys(place for path in found for place in (path, Path(os.path.normpath(path))))


def _scan(path: Path, folder: Path, access: FileAccess, named: _Named, copies: int, done: set[Path]) -> None:
    """Collect what a file and all that it includes name, and check what they have made.

    Args:
        path: The file.
        folder: Of the model.
        access: Checks files and sizes.
        named: Is added to.
        copies: How often the file's content is repeated.
        done: Files that are read, as MuJoCo includes a file once.
    """
    if path.resolve() in done:
        return
    done.add(path.resolve())
    named.bases += [base for base in (folder, path.parent) if base not in named.bases]
    repeated: list[tuple[str, int]] = []  # of elements that are open
    for tag in _tags(path, access):
        if tag.ends == 1:
            while repeated and repeated.pop()[0] != tag.name:
                pass
            continue
        times = max(_whole(tag.attributes.get("count", "1")), 1) if tag.name == "replicate" else 1
        total = copies * prod(count for _, count in repeated) * times
        access.check("copies", total, f"{path}: <{tag.name}>")
        if tag.ends == 0:
            repeated.append((tag.name, times))
        for key in FOLDERS if tag.name == "compiler" else ():
            named.folders.append(tag.attributes.get(key, "").replace("\\", "/"))
        if tag.name == "attach":
            named.attached += total
            access.check("copies", named.attached, f"{path}: <attach>")
        files = [value for key, value in tag.attributes.items() if key.startswith("file") and value]
        for name in files:
            if tag.name in ("include", "model"):
                for place in _places(name, [path.parent, folder], named.folders):
                    access.check_file(place)
                    if tag.name == "model":
                        named.models += [place] if is_file(place) else []
                    elif is_file(place):
                        _scan(place, folder, access, named, total, done)
            else:
                named.files.append((tag.name, name))
        check_sizes(tag.name, tag.attributes, path, access)


def check_sizes(name: str, attributes: Mapping[str, str], path: Path, access: FileAccess) -> None:
    """Raise ``RefusedError`` if an element of a file has more made than the limits allow."""
    what = f"{path}: <{name}>"
    if name == "texture":
        pixels = _whole(attributes.get("width", "0")) * max(_whole(attributes.get("height", "0")), 1)
        access.check("image_pixels", pixels, what)
        access.take(pixels * max(_whole(attributes.get("nchannel", "3")), 1), what)
    elif name == "hfield":
        access.check("elements", _whole(attributes.get("nrow", "0")) * _whole(attributes.get("ncol", "0")), what)
    elif name in ("flexcomp", "composite"):
        access.check("elements", prod(max(_whole(word), 1) for word in attributes.get("count", "1").split()), what)
    elif name == "mesh":
        sizes = (max(_whole(word), 1) for word in attributes.get("params", "").split())
        access.check("elements", prod(sizes), what)
    elif name == "size":
        for key, value in attributes.items():
            if key == "memory":
                access.take(_bytes(value), f"{what} memory")
            else:
                access.check("copies" if key.startswith("nuser_") else "elements", _whole(value), f"{what} {key}")


def _tags(path: Path, access: FileAccess) -> Iterator[_Tag]:
    """Yield the tags of a file as tinyxml2 sees them.

    Raises:
        WarpcamError: Something is no tag, which tinyxml2 refuses, too.
    """
    text = access.read(path).partition(b"\0")[0].decode("utf-8", "surrogateescape")
    at = text.find("<")
    while at >= 0:
        if aside := ASIDE.match(text, at):
            end = aside.end()
        else:
            found = _tag(text, at)
            if found is None:
                line = text.count("\n", 0, at) + 1
                raise WarpcamError(f"scene: MuJoCo cannot read {str(path)!r}: XML parse error, line {line}: no tag")
            tag, end = found
            yield tag
        at = text.find("<", end)


def _tag(text: str, at: int) -> tuple[_Tag, int] | None:
    """The tag that begins at a place, and where it ends; None if there is none."""
    begin = BEGIN.match(text, at)
    if begin is None:
        return None
    attributes: dict[str, str] = {}
    end = begin.end()
    while found := ATTRIBUTE.match(text, end):
        attributes[found[1].lower()] = _unescaped(found[2] if found[2] is not None else found[3])
        end = found.end()
    closed = END.match(text, end)
    if closed is None:
        return None
    return _Tag(begin[2].lower(), attributes, 1 if begin[1] else 2 if closed[1] else 0), closed.end()


def _unescaped(text: str) -> str:
    def character(found: re.Match[str]) -> str:
        if found[3]:
            return NAMED[found[3]]
        code = int(found[1], 16) if found[1] else int(found[2])
        return chr(code) if 0 < code < 0xD800 or 0xE000 <= code < 0x110000 else found[0]

    return ENTITY.sub(character, text)


def _whole(text: str) -> int:
    """The number that a text begins with, as MuJoCo reads it; 0 if there is none."""
    return _number(text, lambda value: int(abs(value)))


def _bytes(text: str) -> int:
    """Bytes of <size memory>; 0 for -1, which stands for none."""
    power = UNITS.get(text.strip()[-1:].upper(), 0)
    return _number(text.strip().rstrip("KMGTPEkmgtpe"), lambda value: int(value) << power if value > 0 else 0)


def _number(text: str, make: Callable[[float], int]) -> int:
    try:
        return make(float(text.split()[0]))
    except OverflowError:
        return 1 << 62
    except (ValueError, IndexError):
        return 0
