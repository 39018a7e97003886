"""Files that a URDF file names: by packages of ROS, by URIs, or by paths."""

import glob
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import gettempdir
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess

FOLDERS_UP = 8  # how far above a file the packages that it names are looked for
NEAR = 2  # and from how far above in folders beside: further up lies the work of others
SCHEMES = ("package://", "model://")
FIND = re.compile(r"(?:file://)?\$\(find(?:-pkg-share)?\s+([^)\s]+)\s*\)")  # as xacro has it


def check_packages(packages: Any, where: str) -> dict[str, Path]:
    """Return folders of packages by name, as a user gives them."""
    if packages is None:
        return {}
    if not isinstance(packages, Mapping):
        raise WarpcamError(f"{where}: packages must map names to folders, got {type(packages).__name__}")
    found = {}
    for name, folder in packages.items():
        if not isinstance(name, str) or not isinstance(folder, str | Path):
            raise WarpcamError(f"{where}: packages must map names to folders, got {name!r}: {folder!r}")
        if not Path(folder).is_dir():
            raise WarpcamError(f"{where}: packages: {name!r}: there is no folder {str(folder)!r}")
        found[name] = Path(folder)
    return found


def find_files(
    robot: ElementTree.Element,
    path: Path,
    folder: str,
    access: FileAccess,
    packages: Mapping[str, Path] | None = None,
) -> None:
    """Give the files that a robot names, those of its meshes and textures, whole paths.

    Args:
        robot: The root of a URDF file.
        path: Where that is.
        folder: Where its files are looked for first, from there.
        access: What may be opened: the folders of packages as well, once this is done.
        packages: Folders of packages.

    Raises:
        RefusedError: A file is only where nothing may be opened.
    """
    here = path.resolve().parent
    for root in (*(packages or {}).values(), *_roots()):
        access.allow(root)
    for tag in ("mesh", "texture"):
        for named in robot.iter(tag):
            if name := named.get("filename"):
                named.set("filename", _found(name, (here / folder, here), access, packages or {}))


def _found(name: str, folders: Sequence[Path], access: FileAccess, packages: Mapping[str, Path]) -> str:
    """The first place of a file where there is one that may be opened, or else the first of all."""
    name = FIND.sub(r"package://\1", name.strip(), count=1)
    found = access.first_file(_places(name, folders, access, packages))
    return str(found or next(_places(name, folders, access, packages), name))


def _places(name: str, folders: Sequence[Path], access: FileAccess, packages: Mapping[str, Path]) -> Iterator[Path]:
    scheme = next((scheme for scheme in SCHEMES if name.lower().startswith(scheme)), "")
    for written in dict.fromkeys((name, unquote(name), name.replace("\\", "/"))):
        if scheme:
            package, _, rest = written[len(scheme) :].partition("/")
            yield from _of_package(package, rest, folders[-1], access, packages)
        else:
            plain = written[5:] if written.lower().startswith("file:") else written
            plain = plain.removeprefix("//localhost") if plain.startswith("//localhost/") else plain
            plain = plain[2:] if plain.startswith("//") else plain
            for folder in (*folders, *list(folders[-1].parents)[:NEAR], *access.search_paths):
                yield folder / plain
    for folder in folders:
        yield folder / Path(name.replace("\\", "/")).name  # where MuJoCo looks by itself
    if scheme:
        package, _, rest = name[len(scheme) :].partition("/")
        for root in _beside(package, folders[-1]):
            access.allow_package(root)
            yield root / rest


def _of_package(
    package: str, rest: str, here: Path, access: FileAccess, packages: Mapping[str, Path]
) -> Iterator[Path]:
    if package in packages:
        yield packages[package] / rest
    above = [here, *here.parents][:FOLDERS_UP]
    for root in (*above, *_roots(), *access.search_paths):
        if root.name == package:
            access.allow_package(root)
            yield root / rest
        if package not in ("", ".", ".."):
            access.allow_package(root / package)
        yield root / package / rest
    for root in above:  # a package's folder may have another name than the package
        yield root / rest


def _beside(package: str, here: Path) -> Iterator[Path]:
    """Folders of that name in a folder beside the file's or one not far above, as workspaces have them for packages."""
    if package in ("", ".", ".."):
        return
    for above in [here, *here.parents][: NEAR + 1]:
        if above in (Path.home(), Path(above.anchor), Path(gettempdir()).resolve()):
            return
        yield from sorted(above.glob(f"*/{glob.escape(package)}"))


def _roots() -> Iterator[Path]:
    """Folders of packages by the variables of ROS 1 and 2 and of Gazebo."""
    for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"), ("GZ_SIM_RESOURCE_PATH", "")):
        for root in os.environ.get(variable, "").split(os.pathsep):
            if root:
                yield Path(root) / inside
