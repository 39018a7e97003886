"""Lengths of source files: a file that a reader can hold in mind has at most 400 lines."""

from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MAX_LINES = 400
FOLDERS = ("warpcam", "kernels", "benchmarks", "examples", "tests")
SUFFIXES = (".py", ".h")
LONGER = {
    "kernels/native/texture/sampler.h",
    "kernels/native/traversal/trace_target.h",
}


def sources(root: Path) -> list[Path]:
    """Source files of the repository, each once: links to folders are not followed."""
    paths = (path for folder in FOLDERS for path in (root / folder).rglob("*") if path.suffix in SUFFIXES)
    return [path for path in paths if path.resolve() == path]


def too_long(root: Path, paths: Iterable[Path]) -> list[str]:
    """Files with more lines than allowed, by path below ``root``."""
    return [path.relative_to(root).as_posix() for path in paths if path.read_text().count("\n") > MAX_LINES]


def test_files_are_short() -> None:
    paths = sources(ROOT)
    assert len(paths) > 500
    assert set(too_long(ROOT, paths)) <= LONGER


def test_a_long_file_is_found(tmp_path: Path) -> None:
    for name, lines in (("short.py", MAX_LINES), ("long.h", MAX_LINES + 1)):
        (tmp_path / name).write_text("x\n" * lines)
    assert too_long(tmp_path, sorted(tmp_path.iterdir())) == ["long.h"]
