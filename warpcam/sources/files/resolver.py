"""Files that a file of meshes names: libraries of materials, images, buffers."""

from pathlib import Path

import trimesh

from warpcam.core.errors import RefusedError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.images import UnreadableError, decoded
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files import mtl


class Resolver(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
    """Finder of what a file names, which tells of what is not there: trimesh goes on without.

    Attributes:
        library: Of ``mtl.read_libraries``, of an OBJ file.
        text: Of an OBJ file.
        gave_image: Whether an image was found.
        refused: The error of an image that trimesh has asked for, as trimesh goes on without.
    """

    def __init__(self, path: Path, access: FileAccess, data: bytes, collector: WarningCollector):
        super().__init__(str(path), allow_anywhere=True)
        self._access, self._collector = access, collector
        self.refused: RefusedError | None = None
        self._is_obj = path.suffix.lower() == ".obj"
        self.library: dict[str, dict[str, str]] = {}
        self.gave_image, self.text = False, ""
        if self._is_obj:
            text = self.text = mtl.text_of(data)
            self.library = mtl.read_libraries(
                mtl.libraries_of(text),
                self._text,
                lambda line: collector.warn("names a library of materials that is not found", line),
            )
            for name in mtl.used_materials(text):
                if name not in self.library:
                    collector.warn("is used as a material, but no mtllib defines it; it is drawn grey", name)

    def found(self, name: str) -> bytes | None:
        """A file's contents; None if there is none, which is told."""
        data = self._bytes(name)
        if data is None:
            what = "a file is not found; if it is a texture, its material is drawn in its base colour"
            self._collector.warn(what, name)
        return data

    def _text(self, name: str) -> str | None:
        data = self._bytes(name)
        return None if data is None else mtl.text_of(data)

    def _bytes(self, name: str) -> bytes | None:
        try:
            return self._read(name)
        except RefusedError:
            raise
        except (OSError, ValueError):
            return None

    def _read(self, name: str) -> bytes:
        name = name.strip()
        return self._access.read(self._access.find(Path(self.parent), name, name.replace("\\", "/")))

    def get(self, name: str) -> bytes:
        if self._is_obj:  # its library: trimesh only tells which faces have which material
            return "".join(f"newmtl {material}\n" for material in self.library).encode()
        try:
            data = self._read(name)
            decoded(data, self._access, name)  # trimesh asks for images alone, and has Pillow read every format
        except RefusedError as error:
            self.refused = error
            raise
        except OSError:
            self._collector.warn(
                "a file is not found; if it is a texture, its material is drawn in its base colour", name
            )
            raise
        except UnreadableError as error:
            what = f"a texture cannot be read ({error}), and its material is drawn in its base colour"
            self._collector.warn(what, name)
            raise FileNotFoundError(what) from None
        self.gave_image = True
        return data
