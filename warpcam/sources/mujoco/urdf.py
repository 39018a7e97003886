"""URDF files: what MuJoCo's importer leaves out unless it is told, the shapes that are there to be seen."""

import logging
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

HIDDEN = 3  # the group of shapes that are there to be touched, which is not drawn unless asked for
FOLDERS_UP = 8  # how far above a file the packages that it names are looked for
# Of MuJoCo's compiler. Nobody simulates the model: links without an inertia are as good as others.
SETTINGS = {"discardvisual": "false", "balanceinertia": "true", "boundmass": "1e-6", "boundinertia": "1e-9"}
PACKAGES = ("package://", "model://")


def load(path: Path) -> Any:
    """An MjModel whose visual shapes are drawn, and whose collision shapes are if there are no others.

    Meshes are found by the packages that they name, in the folders above the file and in ``ROS_PACKAGE_PATH``. What the
    file itself tells MuJoCo's compiler counts. Where MuJoCo cannot read a visual shape, collision shapes are drawn.

    Raises:
        ValueError: MuJoCo cannot read the file.
    """
    import mujoco

    try:
        text = _with_visuals(path)
    except (ElementTree.ParseError, UnicodeError, OSError):  # MuJoCo says it better
        return mujoco.MjModel.from_xml_path(str(path))
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except ValueError:
            raise error from None
        if model.ngeom == 0:
            raise
        logging.getLogger("warpcam").warning(
            "%s: shows its collision shapes, as MuJoCo cannot read what it should look like: %s",
            path,
            " ".join(str(error).split()),
        )
        return model
    touched = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    if not touched.all():
        model.geom_group[touched] = HIDDEN
    return model


def _with_visuals(path: Path) -> str:
    """The file's text, with meshes by their whole paths."""
    robot = ElementTree.fromstring(path.read_bytes())
    if robot.tag != "robot":
        return ElementTree.tostring(robot, encoding="unicode")
    extension = robot.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(robot, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    compiler.set("strippath", "false")
    find_files(robot, path, compiler.get("meshdir", compiler.get("assetdir", ".")))
    for name, value in SETTINGS.items():
        compiler.set(name, compiler.get(name, value))
    return ElementTree.tostring(robot, encoding="unicode")


def find_files(robot: ElementTree.Element, path: Path, folder: str = ".") -> None:
    """Give the files that a robot names, those of its meshes and textures, whole paths.

    Args:
        robot: The root of a URDF file.
        path: Where that is.
        folder: Where its files are looked for first, from there.
    """
    here = path.resolve().parent
    for tag in ("mesh", "texture"):
        for named in robot.iter(tag):
            if name := named.get("filename"):
                named.set("filename", _found(name, (here / folder, here)))


def _found(name: str, folders: Sequence[Path]) -> str:
    """The first place of a mesh where there is a file, or else the first of all."""
    places = list(_places(name, folders))
    return str(next((place for place in places if place.is_file()), places[0]))


def _places(name: str, folders: Sequence[Path]) -> Iterator[Path]:
    scheme = next((scheme for scheme in PACKAGES if name.startswith(scheme)), "")
    if scheme:
        package, _, rest = name.removeprefix(scheme).partition("/")
        above = [folders[-1], *folders[-1].parents][:FOLDERS_UP]
        roots = [Path(root) for root in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if root]
        for root in (*above, *roots):
            if root.name == package:
                yield root / rest
            yield root / package / rest
    else:
        for folder in folders:
            yield folder / name.removeprefix("file://")
    for folder in folders:
        yield folder / Path(name).name  # where MuJoCo looks by itself
