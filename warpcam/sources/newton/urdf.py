"""URDF files for Newton's importer: meshes as they are read here, in metres, with their looks.

Newton 1.8 reads meshes by trimesh alone: units of COLLADA files, libraries of materials beyond the first and colours of
PLY files with texture coordinates are lost there, one mesh that cannot be read refuses the whole robot, and so does a
``<mimic>`` of a fixed joint.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import newton
import numpy as np
import trimesh

from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import FileAccess, Limits, is_file
from warpcam.sources.common.images import UnreadableError, decoded
from warpcam.sources.common.plain_xml import root_of
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.robots import meshes
from warpcam.sources.robots.looks import UrdfLook, look_of, looks_of
from warpcam.sources.robots.packages import check_packages, find_files

MOVABLE = ("revolute", "continuous", "prismatic")
GREY = (0.5, 0.5, 0.5, 1.0)  # of a mesh that says nothing of its colour
STANDING = np.array(((1, 0, 0), (0, 0, -1), (0, 1, 0)), np.float64)  # y up to z up


def add(
    builder: Any,
    path: Any,
    packages: Any,
    options: Mapping[str, Any],
    trusted: bool = False,
    search_paths: Sequence[Any] = (),
    limits: Limits | None = None,
) -> None:
    """See ``warpcam.add_urdf``."""
    if not isinstance(builder, newton.ModelBuilder):
        raise WarpcamError(f"add_urdf: builder must be a newton.ModelBuilder, got {type(builder).__name__}")
    if not isinstance(path, str | Path):
        raise WarpcamError(f"add_urdf: path must be a path, got {type(path).__name__}")
    if not Path(path).is_file():
        raise WarpcamError(f"add_urdf: there is no file {str(path)!r}")
    folders = check_packages(packages, "add_urdf")
    access = FileAccess(Path(path), trusted, search_paths, limits, "add_urdf")
    add_urdf(lambda text: builder.add_urdf(text, **options), builder, Path(path), access, folders)


def add_urdf(
    add: Callable[[str], Any],
    builder: newton.ModelBuilder,
    path: Path,
    access: FileAccess,
    packages: Mapping[str, Path] | None = None,
    *,
    standing: bool = False,
    in_order: bool = False,
) -> None:
    """Have Newton's importer read a robot.

    Args:
        add: Calls the importer with the robot's text.
        builder: What the importer adds to.
        path: A URDF file.
        access: What it may open.
        packages: Folders of packages.
        standing: Whether y is up in files that are there to be seen, but for .dae files.
        in_order: Whether joints are in the order of their names.

    Raises:
        RefusedError: A file lies outside of what may be opened, or is too large.
        WarpcamError: The file is no URDF file, or has no links.
    """
    collector = WarningCollector(str(path))
    try:
        robot = root_of(access.read(path), path)
    except (ElementTree.ParseError, UnicodeError) as error:
        raise WarpcamError(f"{path}: cannot be read, it is no URDF file: {error}") from None
    if robot.tag != "robot":
        raise WarpcamError(f"{path}: cannot be read, it is no URDF file: its root is <{robot.tag}>, not <robot>")
    if robot.find("link") is None:
        raise WarpcamError(f"{path}: has no links, so there is nothing to simulate or to draw")
    if in_order:
        _order(robot)
    find_files(robot, path, ".", access, packages)
    _drop_mimics(robot, collector)
    try:
        _check_textures(robot, access, collector)
        with TemporaryDirectory(prefix="warpcam-") as folder:
            writer = _Writer(robot, Path(folder), collector, standing, access)
            writer.rewrite()
            add(ElementTree.tostring(robot, encoding="unicode"))
            for source in builder.shape_source:
                if isinstance(source, newton.Mesh) and isinstance(source.texture, str):
                    part = writer.textured.get(source.texture)
                    if part is not None:
                        source.texture = part.image
                        if part.look is not None:
                            source.roughness, source.metallic = part.look.roughness, part.look.metallic
    finally:
        collector.say()


def _check_textures(robot: ElementTree.Element, access: FileAccess, collector: WarningCollector) -> None:
    """Take away textures that Newton, which reads every format and size, is not to read."""
    for material in [element for element in robot.iter("material") if element.find("texture") is not None]:
        for texture in material.findall("texture"):
            name = texture.get("filename", "")
            try:
                decoded(access.read(Path(name)), access, name)
            except (OSError, UnreadableError) as error:
                collector.warn(f"names a texture that cannot be read ({error})", name)
                material.remove(texture)


def _order(robot: ElementTree.Element) -> None:
    """Put joints in the order of their names, into the places where joints are."""
    places = [place for place, child in enumerate(robot) if child.tag == "joint"]
    joints = sorted((robot[place] for place in places), key=lambda joint: joint.get("name", ""))
    for place, joint in zip(places, joints, strict=True):
        robot[place] = joint


def _drop_mimics(robot: ElementTree.Element, collector: WarningCollector) -> None:
    """Take away what a joint that cannot move would follow, or be followed in."""
    kinds = {joint.get("name", ""): joint.get("type", "") for joint in robot.findall("joint")}
    for joint in robot.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        name, other = joint.get("name", ""), mimic.get("joint", "")
        if kinds[name] not in MOVABLE:
            collector.warn(f"is a {kinds[name]} joint, and its <mimic> does nothing", name)
        elif kinds.get(other) not in MOVABLE:
            which = f"a {kinds[other]} joint" if other in kinds else "no joint of the robot"
            collector.warn(f"mimics {other!r}, which is {which}, and moves by itself", name)
        else:
            continue
        joint.remove(mimic)


class _Writer:
    """Writer of the meshes of one robot, each part of one look as a file of its own.

    Attributes:
        textured: Parts with images by the file names that stand for those.
    """

    def __init__(
        self,
        robot: ElementTree.Element,
        folder: Path,
        collector: WarningCollector,
        standing: bool,
        access: FileAccess,
    ):
        self._robot, self._folder, self._collector, self._standing = robot, folder, collector, standing
        self._access = access
        self._named = looks_of(robot)
        self._read: dict[tuple[str, tuple[float, ...]], list[meshes.Part] | str] = {}
        self._files: dict[tuple[int, bool], str] = {}
        self._wholes: dict[Any, meshes.Part] = {}
        self.textured: dict[str, meshes.Part] = {}

    def rewrite(self) -> None:
        links = self._robot.findall("link")
        for link in links:
            lost = [fault for visual in link.findall("visual") for fault in self._visual(link, visual)]
            for collision in link.findall("collision"):
                self._collision(link, collision)
            touched = link.findall("collision")
            for other in touched if lost else ():
                shown = copy.deepcopy(other)
                shown.tag = "visual"
                link.append(shown)
            if lost:
                how = "shows its collision shapes" if touched else "lacks a shape that is there to be seen"
                reasons = "; ".join(dict.fromkeys(lost))
                self._collector.warn(f"{how}, as a mesh cannot be read: {reasons}", f"link {link.get('name')}")
        if not any(link.find(kind) is not None for link in links for kind in ("visual", "collision")):
            self._collector.warn("no link has a visual or collision shape that can be drawn")

    def _parts(self, mesh: ElementTree.Element) -> list[meshes.Part] | str:
        """Parts of a mesh, or why it cannot be read."""
        written = mesh.get("scale") or "1"
        scale: tuple[float, ...] = ()
        with suppress(ValueError):
            scale = tuple(float(value) for value in written.split())
        if len(scale) not in (1, 3) or not np.isfinite(scale).all() or not all(scale):
            return f"scale of a mesh must be three numbers other than zero, got {written!r}"
        key = mesh.get("filename", ""), (scale * 3)[:3]
        if key not in self._read:
            try:
                self._read[key] = meshes.read_parts(Path(key[0]), key[1], self._collector, self._access)
            except RefusedError:
                raise
            except WarpcamError as error:
                self._read[key] = str(error)
        return self._read[key]

    def _visual(self, link: ElementTree.Element, visual: ElementTree.Element) -> list[str]:
        """Put parts in place of a mesh, and return why there are none."""
        geometry = visual.find("geometry")
        mesh = geometry.find("mesh") if geometry is not None else None
        if mesh is None:
            return []
        parts = self._parts(mesh)
        place = list(link).index(visual)
        link.remove(visual)
        if isinstance(parts, str):
            return [parts]
        look = look_of(visual, self._named)
        turned = self._standing and not mesh.get("filename", "").lower().endswith(".dae")
        for number, part in enumerate(parts):
            link.insert(place + number, self._element(visual, part, look, turned))
        return []

    def _element(
        self, visual: ElementTree.Element, part: meshes.Part, look: UrdfLook, turned: bool
    ) -> ElementTree.Element:
        element = ElementTree.Element("visual")
        element.extend(copy.deepcopy(child) for child in visual if child.tag == "origin")
        file = self._file(part, turned)
        ElementTree.SubElement(ElementTree.SubElement(element, "geometry"), "mesh", filename=file)
        textured = bool(look.texture) and is_file(Path(look.texture)) and part.uvs is not None
        rgba = look.rgba or ((1.0,) * 4 if textured else part.rgba) or GREY
        material = ElementTree.SubElement(element, "material")
        ElementTree.SubElement(material, "color", rgba=" ".join(map(repr, map(float, rgba))))
        if textured:
            ElementTree.SubElement(material, "texture", filename=look.texture)
        elif look.rgba is None and part.image is not None and part.uvs is not None:
            stand_in = f"{file}.png"
            Path(stand_in).touch()
            self.textured[stand_in] = part
            ElementTree.SubElement(material, "texture", filename=stand_in)
        return element

    def _collision(self, link: ElementTree.Element, collision: ElementTree.Element) -> None:
        geometry = collision.find("geometry")
        mesh = geometry.find("mesh") if geometry is not None else None
        if mesh is None:
            return
        parts = self._parts(mesh)
        if isinstance(parts, str):
            self._collector.warn(f"has a collision shape that cannot be read: {parts}", f"link {link.get('name')}")
            link.remove(collision)
            return
        key = mesh.get("filename", ""), tuple(mesh.get("scale", "").split())
        mesh.set("filename", self._file(self._whole(key, parts), turned=False))
        mesh.attrib.pop("scale", None)

    def _whole(self, key: Any, parts: list[meshes.Part]) -> meshes.Part:
        if key not in self._wholes:
            self._wholes[key] = meshes.whole(parts)
        return self._wholes[key]

    def _file(self, part: meshes.Part, turned: bool) -> str:
        """Name of a file with a part, which has three vertices a face, as its normals differ."""
        key = id(part), turned
        if key not in self._files:
            turn = STANDING if turned else np.eye(3)
            corners = part.vertices[part.faces].reshape(-1, 3) @ turn.T
            rows = np.concatenate((corners, part.normals.reshape(-1, 3) @ turn.T), axis=1).astype(np.float32)
            if part.uvs is not None:
                rows = np.concatenate((rows, part.uvs.reshape(-1, 2).astype(np.float32)), axis=1)
            rows, faces = meshes.unique_rows(rows)
            visual = trimesh.visual.TextureVisuals(uv=rows[:, 6:]) if part.uvs is not None else None
            mesh = trimesh.Trimesh(
                rows[:, :3], faces.reshape(-1, 3), vertex_normals=rows[:, 3:6], visual=visual, process=False
            )
            self._files[key] = str(self._folder / f"{len(self._files)}.glb")
            mesh.export(self._files[key], include_normals=True)
        return self._files[key]
