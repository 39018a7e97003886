"""Layers that a stage names: checked one by one before USD, which follows every path, composes the stage."""

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from pxr import Ar, Sdf, Tf, UsdUtils

from warpcam.core.errors import RefusedError, WarpcamError
from warpcam.core.file_access import FileAccess, is_file

PACKAGE = ".usdz"
NESTED = 4  # packages in each other, at most
EXPRESSION = "`"


def check_layers(path: str, access: FileAccess) -> list[Sdf.Layer]:
    """Check all layers of a stage that is to be opened.

    Returns:
        The layers, which stay open as long as they are kept.

    Raises:
        RefusedError: One lies outside of what may be opened, or is too large, or a package is no plain one.
        WarpcamError: One is damaged in a way that would end the process.
    """
    layers: list[Sdf.Layer] = []
    todo, done, checked = [path], set(), set()
    with Ar.ResolverContextBinder(search_context(path, access)):
        while todo:
            identifier = todo.pop()
            if identifier in done:
                continue
            done.add(identifier)
            outer = outer_file(identifier)
            if outer not in checked:
                checked.add(outer)
                access.check_file(outer)
                if outer.suffix.lower() == PACKAGE and is_file(outer):
                    check_package(outer, access)
            try:
                layer = Sdf.Layer.FindOrOpen(identifier)
                named = _named(layer) if layer else []
            except Tf.ErrorException:  # of which the stage tells
                continue
            if layer:
                layers.append(layer)
            for name in named:
                todo += _resolved(name, layer, access)
    return layers


def search_context(path: str, access: FileAccess) -> Ar.DefaultResolverContext:
    """Folders in which USD looks for names that begin without a dot: the stage's own, as by default, and more."""
    return Ar.DefaultResolverContext([str(Path(path).resolve().parent), *map(str, access.search_paths)])


def outer_file(path: str) -> Path:
    """The file of a resolved path: of the package, if that is inside of one."""
    return Path(Ar.SplitPackageRelativePathOuter(path)[0] if Ar.IsPackageRelativePath(path) else path)


def check_package(path: Path, access: FileAccess) -> None:
    """Raise ``RefusedError`` if a package is not as USD wants it: files stored as they are, one after the other."""
    with path.open("rb") as file:
        _check_archive(file, str(path), path.stat().st_size, access, 1)


def _check_archive(file: object, name: str, size: int, access: FileAccess, depth: int) -> None:
    if depth > NESTED:
        raise RefusedError(f"{name}: packages lie in each other {depth} deep, and at most {NESTED} are read")
    try:
        with zipfile.ZipFile(file) as package:  # type: ignore[call-overload]
            entries = package.infolist()
            for entry in entries:
                inside = PurePosixPath(entry.filename.replace("\\", "/"))
                if inside.is_absolute() or ".." in inside.parts:
                    raise RefusedError(f"{name}: has a file named {entry.filename!r}, which leads out of the package")
                if entry.compress_type != zipfile.ZIP_STORED:
                    raise RefusedError(
                        f"{name}: {entry.filename!r} is compressed, and USD's packages have stored files"
                    )
                access.check("file_bytes", entry.file_size, f"{name}: {entry.filename!r}")
            total = sum(entry.file_size for entry in entries)
            if total > size:
                raise RefusedError(f"{name}: its files have {total:,} bytes, and the package itself has {size:,}")
            for entry in entries:
                if entry.filename.lower().endswith((PACKAGE, ".zip")):
                    inner = f"{name}[{entry.filename}]"
                    _check_archive(io.BytesIO(package.read(entry)), inner, entry.file_size, access, depth + 1)
    except (zipfile.BadZipFile, NotImplementedError, ValueError, OSError, RuntimeError) as error:
        if isinstance(error, RefusedError):
            raise
        return  # USD tells of a damaged one


def _check_names(layer: Sdf.Layer) -> None:
    """Raise ``WarpcamError`` if a binary layer has a child without a valid name, for which USD ends the process."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    if any(path.isEmpty for path in paths):
        raise WarpcamError(
            f"{layer.identifier}: the file is damaged: a prim in it has no valid name; write or download it again"
        )


def _named(layer: Sdf.Layer) -> list[str]:
    """Paths of other layers, and of clips, as a layer has them written; in clips, # stands for digits."""
    _check_names(layer)
    found = set(layer.GetCompositionAssetDependencies())
    for part in UsdUtils.ExtractExternalReferences(layer.identifier):
        found |= {name for name in part if Sdf.FileFormat.FindByExtension(Sdf.Layer.SplitIdentifier(name)[0])}
    return sorted(filter(None, found))


def _resolved(name: str, layer: Sdf.Layer, access: FileAccess) -> Iterator[str]:
    """Identifiers of the layers of a path that a layer has."""
    if name.startswith(EXPRESSION):
        if not access.trusted:
            raise RefusedError(
                f"{layer.identifier}: names a layer by the expression {name}, whose file is known only once it is "
                "opened; give trusted=True (--trusted) to open every path"
            )
        return
    anchored = Sdf.ComputeAssetPathRelativeToLayer(layer, Sdf.Layer.SplitIdentifier(name)[0])
    if "#" in anchored:
        place = Path(anchored)
        yield from map(str, sorted(place.parent.glob(place.name.replace("[", "[[]").replace("#", "[0-9]"))))
        return
    resolved = str(Ar.GetResolver().Resolve(anchored))
    if resolved:
        yield resolved
