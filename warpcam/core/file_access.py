"""Which files a scene may open, and how large what they hold may be: all readers of files ask here."""

import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from warpcam.core.errors import RefusedError, WarpcamError

# Folders of assets, which by custom lie beside a scene's folder: robot/urdf/robot.urdf names ../meshes/arm.stl.
ASSETS = frozenset(
    ("asset", "assets", "collision", "image", "images", "material", "materials", "mesh", "meshes", "obj", "objs", "stl",
     "stls", "texture", "textures", "visual")
)  # fmt: skip
PACKAGE, PACKAGE_LEVELS = "package.xml", 8  # file that marks a ROS package's folder; how far above a scene it may be


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Sizes that the files of a scene may have at most. What is larger is refused before it is decoded.

    Attributes:
        file_bytes: Bytes of one file.
        scene_bytes: Bytes of all files that a scene names, of the images in them once these are decoded, of the copies
            that it makes of buffers, and of the memory that it asks for.
        image_pixels: Width times height of one image. Pillow's own limit, ``PIL.Image.MAX_IMAGE_PIXELS``, counts, too.
        elements: Vertices, faces or points of one mesh, elements of one buffer, cells of one height field.
        copies: Parts that a file has repeated: by ``<replicate>`` and ``<attach>`` of MJCF files, instances of glTF
            files, prims of a USD stage with those of its instances, entries of YAML files with those of their aliases.

    Raises:
        WarpcamError: One is not a whole number of at least 1.
    """

    file_bytes: int = 4 << 30
    scene_bytes: int = 16 << 30
    image_pixels: int = 1 << 27
    elements: int = 1 << 27
    copies: int = 1_000_000

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise WarpcamError(f"Limits: {each.name} must be a whole number of at least 1, got {value!r}")


class FileAccess:
    """What one scene may open.

    Args:
        scene: File of the scene. Its folder, the folder of the file that it links to, the ROS package around it and
            the folders ``ASSETS`` beside it may be opened. None is no folder at all.
        trusted: Whether every path may be opened. Limits count nevertheless.
        search_paths: More folders that may be opened. Names that lead to no file from their own folder are looked for
            there.
        limits: Of sizes; None is ``Limits()``.
        where: The public function, for messages.

    Attributes:
        limits: Of sizes.
        trusted: Whether every path may be opened.
        search_paths: Folders.

    Raises:
        WarpcamError: An argument cannot be used.
    """

    def __init__(
        self,
        scene: Path | None,
        trusted: bool = False,
        search_paths: Sequence[Any] = (),
        limits: Limits | None = None,
        where: str = "load",
    ):
        if not isinstance(trusted, bool):
            raise WarpcamError(f"{where}: trusted must be True or False, got {trusted!r}")
        if not isinstance(limits, Limits | None):
            raise WarpcamError(f"{where}: limits must be a warpcam.Limits or None, got {type(limits).__name__}")
        self.trusted, self.limits = trusted, limits or Limits()
        self.search_paths = _folders(search_paths, where)
        self._scene, self._taken = scene, 0
        self._allowed = [Path(os.path.realpath(folder)) for folder in self.search_paths]
        self._above: list[Path] = []
        for folder in () if scene is None else dict.fromkeys((_real(scene.parent), _real(scene).parent)):
            self._allowed.append(folder)
            self._allowed += _package_around(folder)
            self._above.append(folder.parent)

    def allow(self, folder: Path) -> None:
        """Let a folder be opened that the user, not a file, has named."""
        self._allowed.append(_real(folder))

    def allow_package(self, folder: Path) -> None:
        """Let a ROS package's folder be opened; one without a package.xml is none."""
        if is_file(folder / PACKAGE):
            self.allow(folder)

    def permits(self, path: Path) -> bool:
        """Return True if a file may be opened by where it lies, links followed."""
        if self.trusted:
            return True
        try:
            real = _real(path)
        except (OSError, ValueError):  # a name that the system does not take is no file
            return True
        if any(real.is_relative_to(folder) for folder in self._allowed):
            return True
        for above in self._above:
            inside = real.relative_to(above).parts if real.is_relative_to(above) else ()
            if len(inside) > 1 and inside[0].lower() in ASSETS:
                return True
        return False

    def refusal(self, path: Path) -> RefusedError:
        """Return the error for a file that may not be opened."""
        real = _real(path)
        link = f", a link to {str(real)!r}," if real != Path(os.path.abspath(path)) else ""
        folder = "" if self._scene is None else f" {str(_real(self._scene.parent))!r}"
        return RefusedError(
            f"{self._scene}: names the file {str(path)!r}{link} outside of the scene's folder{folder}; if that is "
            f"meant, give search_paths=[{str(real.parent)!r}] (--search-path), or trusted=True (--trusted) to open "
            "every path"
        )

    def check_path(self, path: Path) -> None:
        """Raise ``RefusedError`` if a file is there and may not be opened."""
        if not self.permits(path) and _is_there(path):
            raise self.refusal(path)

    def check_file(self, path: Path) -> None:
        """Raise ``RefusedError`` if another reader may not open a file: for its place, its kind or its size."""
        self.check_path(path)
        if is_file(path):
            self._count_file(path, path.stat().st_size)
        elif _is_there(path):
            raise RefusedError(f"{self._scene}: names {str(path)!r}, which is no plain file")

    def read(self, path: Path) -> bytes:
        """Return a file's bytes.

        Raises:
            RefusedError: It lies outside of what may be opened, or is too large.
            OSError: It cannot be read, or is no plain file: a device may have no end, a pipe no beginning.
        """
        if _is_there(path) and not is_file(path):
            raise FileNotFoundError(f"{path} is no plain file")
        self.check_path(path)
        with path.open("rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                raise FileNotFoundError(f"{path} is no plain file")
            self._count_file(path, found.st_size)
            return file.read(found.st_size)

    def find(self, folder: Path, *names: str) -> Path:
        """Return the place of a file that is named from a folder: there, or below the search paths.

        Args:
            folder: Where names begin.
            names: Ways to write the file's name, the likeliest first.

        Raises:
            RefusedError: Files of these names are only where nothing may be opened.
        """
        found = self.first_file(above / name for above in (folder, *self.search_paths) for name in names)
        return folder / names[0] if found is None else found

    def first_file(self, places: Iterable[Path]) -> Path | None:
        """Return the first place that has a file and may be opened; None if there is no file.

        Raises:
            RefusedError: There are files, and none may be opened.
        """
        refused: Path | None = None
        for place in places:
            if is_file(place):
                if self.permits(place):
                    return place
                refused = refused or place
        if refused is not None:
            raise self.refusal(refused)
        return None

    def check(self, limit: str, value: int, what: str) -> None:
        """Raise ``RefusedError`` if a size is over a limit.

        Args:
            limit: Name of an attribute of ``Limits``.
            value: The size.
            what: File and part that has it, for the message.
        """
        most = getattr(self.limits, limit)
        if value > most:
            raise RefusedError(
                f"{what} has {value:,} {limit.replace('_', ' ')}, and {limit} of limits is {most:,}; if that is meant, "
                f"give limits=warpcam.Limits({limit}={value})"
            )

    def take(self, count: int, what: str) -> None:
        """Count bytes of memory that the scene takes; raises ``RefusedError`` if all are over the limit."""
        self._taken += count
        self.check("scene_bytes", self._taken, f"{what}: the scene, with all that it names,")

    def _count_file(self, path: Path, size: int) -> None:
        self.check("file_bytes", size, str(path))
        self.take(size, str(path))


def is_file(path: Path) -> bool:
    """Return True if there is such a plain file; a name that the system does not take is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _is_there(path: Path) -> bool:
    """Return True if there is a file of any kind, a device or a pipe, too."""
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):
        return False


def read_named(path: Any, limits: Limits | None, where: str) -> bytes:
    """Return the bytes of a file that the user names: it may lie anywhere, its size counts.

    Raises:
        RefusedError: The file is too large.
        WarpcamError: ``limits`` is none.
        OSError: It cannot be read, or is no plain file.
    """
    return FileAccess(None, trusted=True, limits=limits, where=where).read(Path(path))


def _folders(paths: Any, where: str) -> tuple[Path, ...]:
    if isinstance(paths, str | Path) or not isinstance(paths, Sequence):
        raise WarpcamError(f"{where}: search_paths must be a sequence of folders, got {paths!r}")
    for path in paths:
        if not isinstance(path, str | Path) or not Path(path).is_dir():
            raise WarpcamError(f"{where}: search_paths must be folders, and {str(path)!r} is none")
    return tuple(map(Path, paths))


def _real(path: Path) -> Path:
    return Path(os.path.realpath(path))


def _package_around(folder: Path) -> Iterator[Path]:
    """The folder of the ROS package that a folder is in."""
    for above in (folder, *list(folder.parents)[:PACKAGE_LEVELS]):
        if is_file(above / PACKAGE):
            yield above
            return
