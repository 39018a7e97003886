"""Stages from files: what cannot be opened has its reason, and the way out."""

import re
import zipfile
from pathlib import Path
from typing import Any

from pxr import Tf, Usd

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.sources.usd.layer_files import check_layers, search_context

# Kinds of files by their first bytes, with the endings that USD wants for them.
KINDS = {
    b"#usda": ("text", (".usda", ".usd")),
    b"PXR-USDC": ("binary", (".usdc", ".usd")),
    b"PK\x03\x04": ("package", (".usdz",)),
}
LFS = b"version https://git-lfs"
WORDS = re.compile(r" in file \S+ : '(.*?)'(?= Error in '|$)")  # of the first of USD's errors
TABLE = slice(16, 24)  # bytes of a binary file that have the place of its table of contents


def opened(path_or_stage: Any, access: FileAccess) -> tuple[Usd.Stage, str]:
    """Return the stage and its name for messages."""
    if isinstance(path_or_stage, Usd.Stage):
        return path_or_stage, path_or_stage.GetRootLayer().identifier
    if not isinstance(path_or_stage, str | Path):
        raise WarpcamError(f"path_or_stage must be a path or a pxr.Usd.Stage, got {type(path_or_stage).__name__}")
    path = str(path_or_stage)
    if "://" in path:
        raise WarpcamError(f"from_usd: {path!r} is an address; open it by pxr.Usd.Stage.Open, and give the stage")
    if not Path(path).exists():
        raise WarpcamError(f"from_usd: there is no file {path!r}")
    if Path(path).is_dir():
        raise WarpcamError(f"from_usd: {path!r} is a folder; give a .usd, .usda, .usdc or .usdz file")
    return open_file(path, access), path


def open_file(path: str, access: FileAccess) -> Usd.Stage:
    """Open a stage whose layers are checked.

    Raises:
        RefusedError: A layer lies outside of what may be opened, or is too large.
        WarpcamError: USD cannot open it.
    """
    layers = check_layers(path, access)
    try:
        stage = Usd.Stage.Open(path, search_context(path, access))
        del layers  # which the stage keeps
        return stage
    except Tf.ErrorException as error:
        reason = _fault(Path(path)) if Path(path).is_file() else ""
        reason = reason or f"{short(error)}; mend that place, or write or download the file again"
        raise WarpcamError(f"{path}: USD cannot open it: {reason}") from None


def short(error: Exception) -> str:
    """Return the words of USD's error that matter to a reader."""
    try:
        text = " ".join(str(error).split())
    except UnicodeDecodeError:  # the error has bytes of the file
        return "its text is not UTF-8"
    found = WORDS.search(text)
    return (found[1] if found else text)[:500].strip()


def _fault(path: Path) -> str:
    """Return the fault of a file that its bytes show; empty for text, whose faults USD names by line."""
    data = path.read_bytes()
    if not data:
        return "the file is empty; write or download it again"
    if data.startswith(LFS):
        return "it is a Git LFS pointer in the place of the file; run `git lfs pull`"
    kind, endings = next((found for start, found in KINDS.items() if data.startswith(start)), ("", ()))
    if not kind:
        starts = "'#usda', 'PXR-USDC' or, of a package, 'PK'"
        return f"it is no USD file: it begins with {data[:12]!r}, and USD files with {starts}"
    if path.suffix.lower() not in endings:
        return f"it is a {kind} file of USD with another ending; rename it to {' or '.join(endings)}"
    if kind == "binary":
        table = int.from_bytes(data[TABLE], "little")
        what = "truncated" if not 0 < table < len(data) else "truncated or damaged"
        return f"the file is {what}, {len(data)} bytes are there; write or download it again"
    if kind == "package":
        if not zipfile.is_zipfile(path):
            return "the package is truncated or damaged; write or download it again"
        try:
            with zipfile.ZipFile(path) as package:
                first = next(iter(package.namelist()), "")
        except (zipfile.BadZipFile, NotImplementedError, ValueError):
            return "the package's table of files is damaged; write or download it again"
        if Path(first).suffix.lower() not in (".usd", ".usda", ".usdc"):
            return f"the package has no stage: its first file must be .usd, .usda or .usdc, and is {first!r}"
    return ""
