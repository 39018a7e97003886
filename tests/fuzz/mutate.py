"""Structured mutations of files: bytes, numbers, elements of XML, values of JSON and YAML, names of other files."""

import json
import random
import re
import struct
from collections.abc import Callable
from copy import deepcopy
from pathlib import PurePosixPath
from typing import Any
from xml.etree import ElementTree

NUMBER = re.compile(rb"(?<![\w.])-?\d+\.?\d*(?:[eE][-+]?\d+)?")
NAMED = re.compile(rb"[\w./\\:-]+\.(?:png|jpg|obj|mtl|stl|ply|bin|xml|usda?|glb|dae)\b")
EXTREMES = (
    "-1", "0", "1", "2", "255", "65536", "1000000", "2147483647", "2147483648", "-2147483648", "4294967295",
    "9223372036854775808", "1e38", "-1e38", "1e308", "1e-308", "1e999", "nan", "inf", "-inf", "0x10", "1e", "",
)  # fmt: skip
INTEGERS = (0, 1, 3, 255, 65535, 1 << 20, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, (1 << 32) - 4)
FLOATS = (float("nan"), float("inf"), -float("inf"), 1e38, -1e38, 1e-45, 0.0, -1.0)
NAMES = (
    "", ".", "..", "missing.png", "../outside.png", "/etc/passwd", "/dev/zero", "http://127.0.0.1:9/a.png",
    "file:///etc/passwd", "data:image/png;base64,AAAA", "a" * 5000, "\u00e9\u2028\U0001f600", "package://no/a.stl",
)  # fmt: skip
BINARY = (".glb", ".stl", ".ply", ".usdc", ".usdz", ".bin", ".png", ".msh", ".mjb")
HEADER = 256  # bytes in which most lengths of files lie
DEPTH = 3000  # of elements within elements


def mutated(files: dict[str, bytes], main: str, rng: random.Random) -> dict[str, bytes]:
    """A seed's files with one to four mutations, mostly of its main file."""
    files = dict(files)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        name = main if rng.random() < 0.8 or len(files) == 1 else rng.choice(sorted(files))
        files[name] = mutated_file(files[name], PurePosixPath(name).suffix.lower(), rng)
    return files


def mutated_file(data: bytes, suffix: str, rng: random.Random) -> bytes:
    """One mutation of a file, as its format offers them."""
    structured: dict[str, Callable[[bytes, random.Random], bytes]] = {
        ".xml": _xml, ".urdf": _xml, ".dae": _xml, ".gltf": _json, ".json": _json, ".glb": _glb, ".yaml": _yaml,
    }  # fmt: skip
    known = structured.get(suffix)
    if known is not None and rng.random() < 0.6:
        try:
            return known(data, rng)
        except (ValueError, SyntaxError, RecursionError, LookupError, AttributeError, struct.error):
            pass  # an earlier mutation broke it
    if suffix in BINARY and (b"\0" in data or rng.random() < 0.3):
        return rng.choice((_flip, _flip, _length, _length, _length, _float, _chunk, _cut))(data, rng)
    return rng.choice((_number, _number, _number, _name, _line, _line, _word, _chunk, _cut, _flip))(data, rng)


def _flip(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 4, 32))):
        if changed:
            changed[rng.randrange(len(changed))] = rng.choice((0, 255, rng.randrange(256)))
    return bytes(changed)


def _place(data: bytes, size: int, rng: random.Random) -> int:
    """A place for ``size`` bytes, half of the time among the first ones."""
    end = max(len(data) - size, 0)
    at = rng.randint(0, min(HEADER, end) if rng.random() < 0.5 else end)
    return at - at % rng.choice((1, 4))


def _written(data: bytes, new: bytes, rng: random.Random) -> bytes:
    at = _place(data, len(new), rng)
    return data[:at] + new + data[at + len(new) :]


def _length(data: bytes, rng: random.Random) -> bytes:
    number = rng.choice(INTEGERS)
    return _written(data, rng.choice((struct.pack("<I", number), struct.pack("<Q", number))), rng)


def _float(data: bytes, rng: random.Random) -> bytes:
    return _written(data, struct.pack("<f", rng.choice(FLOATS)), rng)


def _chunk(data: bytes, rng: random.Random) -> bytes:
    """A part removed, repeated or moved."""
    size = min(rng.choice((1, 4, 16, 64, 1024)), len(data))
    first, second = _place(data, size, rng), _place(data, size, rng)
    part = data[first : first + size]
    return rng.choice(
        (data[:first] + data[first + size :], data[:first] + part * 2 + data[first + size :],
         data[:second] + part + data[second:], data[:second] + part + data[second + size :])
    )  # fmt: skip


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randint(0, len(data))]


def _replaced(data: bytes, pattern: re.Pattern[bytes], new: str, rng: random.Random) -> bytes:
    found = list(pattern.finditer(data))
    if not found:
        return _flip(data, rng)
    match = rng.choice(found[:40] if rng.random() < 0.5 else found)
    return data[: match.start()] + new.encode() + data[match.end() :]


def _number(data: bytes, rng: random.Random) -> bytes:
    return _replaced(data, NUMBER, rng.choice(EXTREMES), rng)


def _name(data: bytes, rng: random.Random) -> bytes:
    return _replaced(data, NAMED, rng.choice(NAMES), rng)


def _line(data: bytes, rng: random.Random) -> bytes:
    return _shuffled(data, b"\n", rng)


def _word(data: bytes, rng: random.Random) -> bytes:
    return _shuffled(data, b" ", rng)


def _shuffled(data: bytes, between: bytes, rng: random.Random) -> bytes:
    """A line or word removed, repeated, many times too, or exchanged with another."""
    parts = data.split(between)
    first, second = rng.randrange(len(parts)), rng.randrange(len(parts))
    kind = rng.randrange(4)
    if kind == 0:
        del parts[first]
    elif kind == 1:
        parts.insert(second, parts[first])
    elif kind == 2:
        parts[first], parts[second] = parts[second], parts[first]
    else:
        parts[first:first] = parts[first : first + 1] * rng.choice((2, 50, 500))
    return between.join(parts)


def _xml(data: bytes, rng: random.Random) -> bytes:
    root = ElementTree.fromstring(data)
    elements = list(root.iter())
    parents = [element for element in elements if len(element)] or [root]
    element, other, parent = rng.choice(elements), rng.choice(elements), rng.choice(parents)
    kind = rng.randrange(8)
    if kind <= 2 and element.attrib:
        key = rng.choice(sorted(element.attrib))
        words = element.attrib[key].split()
        if kind == 0 and words:
            words[rng.randrange(len(words))] = rng.choice(EXTREMES)
            element.set(key, " ".join(words))
        else:
            count = rng.choice((0, 1, 3, 4, 100, 10000))
            element.set(key, rng.choice((*NAMES, *EXTREMES, " ".join(["1"] * count))).replace("\0", ""))
    elif kind == 3 and element.attrib:
        del element.attrib[rng.choice(sorted(element.attrib))]
    elif kind == 4 and other.attrib:
        key = rng.choice(sorted(other.attrib))
        element.set(key, other.attrib[key])
    elif kind == 5 and len(parent):
        parent.remove(rng.choice(list(parent)))
    elif kind == 6 and len(parent):
        parent.append(deepcopy(rng.choice(list(parent))))
    elif kind == 7 and rng.random() < 0.8:
        element.append(deepcopy(other))  # a copy: an element within itself has no end
    else:
        inner = element
        for _ in range(rng.choice((3, 100, DEPTH))):
            inner = ElementTree.SubElement(inner, element.tag)
    return ElementTree.tostring(root)


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Containers and keys of everything within a value."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, item in pairs for place in ((value, key), *_places(item))]


def _changed_value(value: Any, rng: random.Random) -> Any:
    places = _places(value)
    if not places:
        return rng.choice((None, [], {}, 0, "x"))
    holder, key = rng.choice(places)
    kind = rng.randrange(5)
    if kind == 0:
        del holder[key]
    elif kind == 1:
        source, other = rng.choice(places)
        holder[key] = json.loads(json.dumps(source[other]))
    elif kind == 2 and isinstance(holder, list):
        holder.extend([holder[key]] * rng.choice((1, 10, 1000)))
    else:
        holder[key] = rng.choice(
            (None, True, [], {}, [[]], "", rng.choice(NAMES), -1, rng.choice(INTEGERS), 1 << 63, 1 << 70, 1e38, -1e300,
             0.5, float("nan"), float("inf"), [holder[key]], {"a": holder[key]})
        )  # fmt: skip
    return value


def _json(data: bytes, rng: random.Random) -> bytes:
    return json.dumps(_changed_value(json.loads(data), rng)).encode()


def _yaml(data: bytes, rng: random.Random) -> bytes:
    """Of YAML files, as JSON, which YAML includes."""
    import yaml

    try:
        value = yaml.safe_load(data)
    except yaml.YAMLError as error:
        raise ValueError("it is not YAML any more") from error
    return json.dumps(_changed_value(value, rng), default=str).encode()


def _glb(data: bytes, rng: random.Random) -> bytes:
    size = struct.unpack_from("<I", data, 12)[0]
    text = _json(data[20 : 20 + size], rng)
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest
