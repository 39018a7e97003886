"""Files that a scene is read from, and digests of what they hold."""

import hashlib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, is_file
from warpcam.sources.common import formats
from warpcam.sources.common.plain_xml import root_of

OBJ_MAPS = ("map_kd", "map_ke", "map_d", "norm")  # that are drawn
IMAGE = re.compile(r"<(?:\w+:)?init_from[^>]*>\s*(?:<(?:\w+:)?ref>)?([^<]+)<")  # of COLLADA 1.4, and of 1.5
TEXTURE = re.compile(rb"^comment TextureFile (.+?)\r?$", re.MULTILINE)  # of PLY
PLY_HEAD = 1 << 16  # bytes of a file in which its header ends


def scene_files(scene: Path, access: FileAccess) -> list[Path]:
    """The file of a scene and all meshes, images and layers that it and these name, sorted; each may be opened.

    What cannot be read names nothing: the loader tells of it, and of what may not be opened.
    """
    found: set[Path] = set()
    todo = [scene.resolve()]
    while todo:
        path = todo.pop()
        if path in found or not is_file(path) or not access.permits(path):
            continue
        found.add(path)
        read = READERS.get(path.suffix.lower())
        if read is not None:
            try:
                todo += [named.resolve() for named in read(path, access)]
            except (WarpcamError, OSError, ValueError, ElementTree.ParseError, ImportError):
                continue
    return sorted(found)


def digests(scene: Path, access: FileAccess) -> dict[str, str]:
    """SHA-256 of each of a scene's files, by its path from the scene's folder."""
    folder = scene.resolve().parent
    return {Path(os.path.relpath(path, folder)).as_posix(): _digest(path) for path in scene_files(scene, access)}


def digest_of(paths: Iterable[Path]) -> str:
    """One SHA-256 of the names and the contents of files."""
    whole = hashlib.sha256()
    for path in paths:
        whole.update(f"{path.name} {_digest(path)}\n".encode())
    return whole.hexdigest()


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _of_mujoco(path: Path, access: FileAccess) -> Iterator[Path]:
    """Files of an MJCF or a URDF file."""
    import mujoco

    from warpcam.sources.mujoco import mjcf_files
    from warpcam.sources.robots.packages import find_files

    mjcf_files.check(path, access)
    robot = root_of(access.read(path), path)
    if robot.tag != "robot":
        yield from map(Path, mujoco.mju_getXMLDependencies(str(path)))
        return
    compiler = robot.find("mujoco/compiler")
    folder = "." if compiler is None else compiler.get("meshdir", compiler.get("assetdir", "."))
    find_files(robot, path, folder, access)
    for tag in ("mesh", "texture"):
        yield from (Path(each.get("filename", "")) for each in robot.iter(tag))


def _of_usd(path: Path, access: FileAccess) -> Iterator[Path]:
    from pxr import Tf, UsdUtils

    from warpcam.sources.usd.layer_files import check_layers

    check_layers(str(path), access)
    try:
        layers, assets, _ = UsdUtils.ComputeAllDependencies(str(path))
    except Tf.ErrorException:
        return
    yield from (Path(layer.realPath) for layer in layers if layer is not None)
    yield from map(Path, assets)


def _of_gltf(path: Path, access: FileAccess) -> Iterator[Path]:
    from warpcam.sources.files.gltf_document import Document

    document = Document(path, access)
    for entry in (*document.listed("buffers"), *document.listed("images")):
        uri = entry.get("uri") if isinstance(entry, Mapping) else None
        if isinstance(uri, str) and not uri.startswith("data:"):
            yield access.find(path.parent, unquote(uri), uri)


def _of_obj(path: Path, access: FileAccess) -> Iterator[Path]:
    from warpcam.sources.files import mtl

    for line in mtl.libraries_of(mtl.text_of(access.read(path))):
        for library in _beside(path, access, [line, *line.split()]):
            if not is_file(library):
                continue
            yield library
            materials = mtl.read_libraries([line], partial(_text_of, access, library), lambda _: None)
            for said in materials.values():
                yield from _beside(path, access, [mtl.texture_map(said[key]).file for key in OBJ_MAPS if said.get(key)])


def _text_of(access: FileAccess, library: Path, _: str) -> str:
    from warpcam.sources.files import mtl

    return mtl.text_of(access.read(library))


def _of_collada(path: Path, access: FileAccess) -> Iterator[Path]:
    for written in IMAGE.findall(access.read(path).decode(errors="replace")):
        plain = unquote(written.strip().removeprefix("file://"))
        yield from _beside(path, access, [written.strip(), plain, plain.lstrip("/"), Path(plain).name])


def _of_ply(path: Path, access: FileAccess) -> Iterator[Path]:
    with path.open("rb") as file:
        head = file.read(PLY_HEAD).split(b"end_header")[0]
    yield from _beside(path, access, [name.decode(errors="replace") for name in TEXTURE.findall(head)])


def _beside(path: Path, access: FileAccess, names: Iterable[str]) -> Iterator[Path]:
    """Files that are named from a file's folder, also with the other slash."""
    yield from (access.find(path.parent, name, name.replace("\\", "/")) for name in names)


READERS: Mapping[str, Callable[[Path, FileAccess], Iterator[Path]]] = {
    ".xml": _of_mujoco,
    ".urdf": _of_mujoco,
    **dict.fromkeys(formats.USD, _of_usd),
    ".gltf": _of_gltf,
    ".glb": _of_gltf,
    ".obj": _of_obj,
    ".dae": _of_collada,
    ".ply": _of_ply,
}
