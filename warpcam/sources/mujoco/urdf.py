"""URDF files: MuJoCo reads links and joints, and meshes and their looks are read here.

MuJoCo's own importer leaves out shapes that are only to be seen, and reads three formats of meshes without colours.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import FileAccess, is_file
from warpcam.sources.common.images import UnreadableError, decoded
from warpcam.sources.common.plain_xml import root_of
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.mujoco import mjcf_files
from warpcam.sources.robots import meshes
from warpcam.sources.robots.looks import UrdfLook, look_of, looks_of
from warpcam.sources.robots.packages import find_files

SEEN, HIDDEN = 1, 3  # groups of shapes: that are seen; that are there to be touched, not drawn unless asked for
ALONE = 0  # group of shapes that are there to be touched, and are drawn
# Of MuJoCo's compiler. Nobody simulates the model: links without an inertia are as good as others.
SETTINGS = {"discardvisual": "false", "balanceinertia": "true", "boundmass": "1e-6", "boundinertia": "1e-9"}
GREY = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's, of what says nothing of its colour
AXES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
LEAST = 4  # vertices of a mesh
MARK = "warpcam shape "


def load(path: Path, access: FileAccess | None = None, packages: Mapping[str, Path] | None = None) -> Any:
    """An MjModel whose visual shapes are drawn, and whose collision shapes are if there are no others.

    Meshes are found by the packages that they name, in the folders above the file and in ``ROS_PACKAGE_PATH``, as far
    as ``access``, by default that of ``warpcam.load``, lets them be opened. What the file itself tells MuJoCo's
    compiler counts. A visual shape that cannot be read is left out with a warning, and its link's collision shapes are
    drawn in its place.

    Raises:
        RefusedError: A file lies outside of what may be opened, or is too large.
        ValueError: MuJoCo cannot read the file, or nothing of it can be drawn.
    """
    return _compiled(path, access or FileAccess(path), packages)[1]


def load_spec(path: Path, access: FileAccess | None = None, packages: Mapping[str, Path] | None = None) -> Any:
    """Return the MjSpec of the model that `load` returns."""
    return _compiled(path, access or FileAccess(path), packages)[0]


def _compiled(path: Path, access: FileAccess, packages: Mapping[str, Path] | None) -> tuple[Any, Any]:
    """The MjSpec of a file and its MjModel."""
    try:
        robot = root_of(access.read(path), path)
    except (ElementTree.ParseError, UnicodeError, OSError):  # MuJoCo says it better
        robot = None
    if robot is None or robot.tag != "robot":
        spec = mjcf_files.read_spec(path, access)
        return spec, spec.compile()
    return _Robot(robot, path, access, packages or {}).compiled()


@dataclass(eq=False)
class _Shape:
    """A visual or collision shape of a link.

    Attributes:
        link: Its link's name.
        name: Its own, or an empty string.
        visual: Whether it is there to be seen.
        look: What its material says.
        file: Of its mesh, or None.
        scale: Of its mesh.
        parts: Of its mesh, once they are read.
    """

    link: str
    name: str
    visual: bool
    look: UrdfLook
    file: Path | None
    scale: tuple[float, ...]
    parts: list[meshes.Part] = field(default_factory=list)


class _Robot:
    def __init__(self, robot: ElementTree.Element, path: Path, access: FileAccess, packages: Mapping[str, Path]):
        self._path, self._robot, self._access = path, robot, access
        self._collector = WarningCollector(str(path))
        self._faults: list[str] = []
        self._read: dict[tuple[Path, tuple[float, ...]], list[meshes.Part] | str] = {}
        self._shapes: dict[str, _Shape] = {}
        self._meshes: dict[int, str] = {}
        self._materials: dict[tuple[Any, ...], str] = {}
        self._textures: dict[Any, str] = {}
        self._images: dict[str, np.ndarray | None] = {}
        self._settle(packages)

    def compiled(self) -> tuple[Any, Any]:
        """The robot's MjSpec and MjModel."""
        try:
            shown = self._read_shapes()
            try:
                spec = self._spec(shown)
                model = spec.compile()
            except ValueError as error:
                fault = " ".join(str(error).split())
                if "hull" not in fault and "qhull" not in fault:
                    raise
                self._collector.warn(f"has meshes that collide with nothing, as MuJoCo makes no hull of one: {fault}")
                spec = self._spec(shown, solid=False)
                model = spec.compile()
        finally:
            self._collector.say()
        if model.ngeom == 0 or (model.geom_group == HIDDEN).all():
            reasons = "; ".join(dict.fromkeys(self._faults)) or "no link has a visual or collision shape"
            raise ValueError(f"nothing of it can be drawn: {reasons}")
        return spec, model

    def _spec(self, shown: Collection[str], solid: bool = True) -> Any:
        """The robot for MuJoCo's compiler, with collision shapes that are drawn of the links ``shown``.

        A compiler that has failed is not used again. Meshes that are not ``solid`` collide with nothing.
        """
        import mujoco

        for known in (self._meshes, self._materials, self._textures):
            known.clear()
        spec, names = mujoco.MjSpec.from_string(ElementTree.tostring(self._robot, encoding="unicode")), dict[str, Any]()
        for geom in list(spec.geoms):
            if geom.name.startswith(MARK):
                shape = self._shapes[geom.name]
                geom.name = shape.name if names.setdefault(shape.name, geom) is geom else ""
                if shape.file is not None and not solid:
                    geom.contype = geom.conaffinity = 0
                self._place(spec, geom, shape, shape.visual or shape.link in shown)
        return spec

    def _settle(self, packages: Mapping[str, Path]) -> None:
        """Tell MuJoCo's compiler its settings, and put marks in the places of shapes."""
        extension = self._robot.find("mujoco")
        if extension is None:
            extension = ElementTree.SubElement(self._robot, "mujoco")
        for element in extension.iter():
            mjcf_files.check_sizes(element.tag, element.attrib, self._path, self._access)
        compiler = extension.find("compiler")
        if compiler is None:
            compiler = ElementTree.SubElement(extension, "compiler")
        find_files(
            self._robot, self._path, compiler.get("meshdir", compiler.get("assetdir", ".")), self._access, packages
        )
        for name, value in SETTINGS.items():
            compiler.set(name, compiler.get(name, value))
        for link in self._robot.iter("link"):
            if (inertia := link.find("inertial/inertia")) is not None and not _is_inertia(inertia):
                self._collector.warn(
                    "has an inertia that no body has, and gets a small one", f"link {link.get('name')}"
                )
                for axis in AXES:
                    inertia.set(axis, "1e-9" if axis[1] == axis[2] else "0")
        named, seen = looks_of(self._robot), compiler.get("discardvisual") == "false"
        for link in self._robot.iter("link"):
            for element in (*(link.findall("visual") if seen else ()), *link.findall("collision")):
                self._mark(link, element, named)

    def _mark(self, link: ElementTree.Element, element: ElementTree.Element, named: Mapping[str, UrdfLook]) -> None:
        geometry = element.find("geometry")
        mesh = geometry.find("mesh") if geometry is not None else None
        name, visual = element.get("name", ""), element.tag == "visual"
        look = look_of(element, named)
        file: Path | None = None
        scale: tuple[float, ...] = (1.0, 1.0, 1.0)
        if geometry is not None and mesh is not None:
            file = Path(mesh.get("filename", ""))
            try:
                values = tuple(float(value) for value in mesh.get("scale", "1").split())
            except ValueError:
                values = ()
            if len(values) not in (1, 3) or not np.isfinite(values).all() or not all(values):
                given = f"link {link.get('name')!r}: scale of a mesh must be three numbers other than zero"
                raise ValueError(f"{given}, got {mesh.get('scale')!r}")
            scale = (values * 3)[:3]
            geometry.remove(mesh)
            ElementTree.SubElement(geometry, "sphere", radius="1")
        mark = f"{MARK}{len(self._shapes)}"
        element.set("name", mark)
        for material in element.findall("material"):
            element.remove(material)
        self._shapes[mark] = _Shape(link.get("name", ""), name, visual, look, file, scale)

    def _read_shapes(self) -> set[str]:
        """Read all meshes, and return the links whose collision shapes are drawn."""
        shown: set[str] = set()
        lost: dict[str, list[str]] = {}
        for shape in self._shapes.values():
            if shape.file is None:
                continue
            key = shape.file, shape.scale
            if key not in self._read:
                try:
                    self._read[key] = meshes.read_parts(shape.file, shape.scale, self._collector, self._access)
                except RefusedError:
                    raise
                except WarpcamError as error:
                    self._read[key] = str(error)
            found = self._read[key]
            if isinstance(found, str):
                self._faults.append(found)
                if shape.visual:
                    lost.setdefault(shape.link, []).append(found)
                else:
                    self._collector.warn(f"has a collision shape that cannot be read: {found}", shape.link)
            else:
                shape.parts = found if shape.visual else [meshes.whole(found)]
        drawn = [shape for shape in self._shapes.values() if shape.file is None or shape.parts]
        if not any(shape.visual for shape in drawn):
            shown = {shape.link for shape in drawn}
        for link, faults in lost.items():
            others = [shape for shape in drawn if shape.link == link and not shape.visual]
            shown |= {link} if others else set()
            how = "shows its collision shapes" if others else "lacks a shape that is there to be seen"
            self._collector.warn(f"{how}, as a mesh cannot be read: {'; '.join(dict.fromkeys(faults))}", f"link {link}")
        return shown

    def _place(self, spec: Any, geom: Any, shape: _Shape, drawn: bool) -> None:
        """Make a mark the shape itself."""
        import mujoco

        geom.group = HIDDEN if not drawn else SEEN if shape.visual else ALONE
        if shape.file is None:
            geom.rgba = shape.look.rgba or GREY
            self._dress(spec, geom, shape.look, None)
            return
        if not shape.parts:
            spec.delete(geom)
            return
        for number, part in enumerate(shape.parts):
            target = geom
            if number:
                target = geom.parent.add_geom(
                    pos=geom.pos, quat=geom.quat, group=geom.group, contype=geom.contype, conaffinity=geom.conaffinity
                )
            target.type, target.size = mujoco.mjtGeom.mjGEOM_MESH, (0.0, 0.0, 0.0)
            target.meshname = self._mesh(spec, shape.file, part)
            self._dress(spec, target, shape.look, part)

    def _mesh(self, spec: Any, file: Path, part: meshes.Part) -> str:
        import mujoco

        if id(part) not in self._meshes:
            taken = set(self._meshes.values())
            names = (file.stem if not number else f"{file.stem}/{number}" for number in range(len(taken) + 1))
            name = self._meshes[id(part)] = next(name for name in names if name not in taken)
            mesh = spec.add_mesh(name=name)
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # open and flat ones have one, too
            corners = part.vertices[np.resize(np.arange(len(part.vertices)), max(len(part.vertices), LEAST))]
            mesh.uservert, mesh.userface = corners.reshape(-1), part.faces.reshape(-1)
            mesh.usernormal = part.normals.reshape(-1)
            mesh.userfacenormal = np.arange(part.faces.size, dtype=np.int32)
            if part.uvs is not None:
                coordinates = part.uvs.reshape(-1, 2) * (1.0, -1.0) + (0.0, 1.0)  # MuJoCo's v counts downwards
                mesh.usertexcoord = coordinates.reshape(-1)
                mesh.userfacetexcoord = np.arange(part.faces.size, dtype=np.int32)
        return self._meshes[id(part)]

    def _dress(self, spec: Any, geom: Any, look: UrdfLook, part: meshes.Part | None) -> None:
        """Give a shape the look of the robot's file, or else that of its mesh."""
        image: Any = None
        key: Any = None
        if look.texture:
            image, key = self._image(look.texture), look.texture
        elif part is not None and look.rgba is None and part.image is not None:
            image, key = part.image, id(part.image)
        rgba = look.rgba or ((1.0,) * 4 if look.texture and image is not None else part.rgba if part else None) or GREY
        geom.rgba = rgba
        if image is None:
            return
        if (key, rgba) not in self._materials:
            name = self._materials[key, rgba] = f"{MARK}{len(self._materials)}"
            material = spec.add_material(name=name, rgba=rgba)
            names = list(material.textures)
            names[int(_role())] = self._texture(spec, key, image)
            material.textures = names
        geom.material = self._materials[key, rgba]

    def _texture(self, spec: Any, key: Any, image: np.ndarray) -> str:
        import mujoco

        if key not in self._textures:
            self._textures[key] = f"{MARK}{len(self._textures)}"
            texture = spec.add_texture(name=self._textures[key])
            texture.type, texture.colorspace = mujoco.mjtTexture.mjTEXTURE_2D, mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR
            texture.height, texture.width, texture.nchannel = image.shape
            texture.data = np.ascontiguousarray(image).tobytes()
        return self._textures[key]

    def _image(self, file: str) -> np.ndarray | None:
        if file not in self._images:
            self._images[file] = None
            if not is_file(Path(file)):
                self._collector.warn("names a texture that is not there", file)
                return None
            try:
                pixels = decoded(self._access.read(Path(file)), self._access, file)
                self._images[file] = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels
            except OSError as error:
                self._collector.warn(f"names a texture that cannot be read ({error.strerror})", file)
            except UnreadableError as error:
                self._collector.warn(f"names a texture that cannot be read ({error})", file)
        return self._images[file]


def _is_inertia(inertia: ElementTree.Element) -> bool:
    """Return True if MuJoCo accepts the inertia: it raises zeros itself, but refuses what is negative along an axis."""
    try:
        xx, xy, xz, yy, yz, zz = (float(inertia.get(axis, "0")) for axis in AXES)
    except ValueError:
        return True  # MuJoCo says it better
    matrix = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return bool(not np.isfinite(matrix).all() or not any((xy, xz, yz)) or np.linalg.eigvalsh(matrix)[0] > 0.0)


def _role() -> Any:
    import mujoco

    return mujoco.mjtTextureRole.mjTEXROLE_RGB
