"""What an MJCF file is checked for is all that MuJoCo itself names as its parts."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from warpcam.core.file_access import FileAccess

mujoco = pytest.importorskip("mujoco")
PACKAGES = ("mujoco", "mujoco_warp", "newton", "dm_control", "robosuite", "gymnasium_robotics")


class Listener(FileAccess):
    """Lists the files that are checked."""

    def __init__(self, scene: Path):
        super().__init__(scene, trusted=True)
        self.checked: set[Path] = set()

    def check_file(self, path: Path) -> None:
        self.checked.add(path.resolve())
        super().check_file(path)


def models() -> list[Path]:
    """MJCF files of installed packages."""
    specs = [find_spec(package) for package in PACKAGES]
    folders = [Path(spec.origin).parent for spec in specs if spec is not None and spec.origin]
    paths = sorted(path for folder in folders for path in folder.rglob("*.xml"))
    return [path for path in paths if b"<mujoco" in path.read_bytes()[:5000]]


def test_all_that_mujoco_opens_is_checked() -> None:
    from warpcam.sources.mujoco import mjcf_files

    named = 0
    for path in models():
        try:
            parts = {Path(part).resolve() for part in mujoco.mju_getXMLDependencies(str(path))}
        except (ValueError, mujoco.FatalError):  # no model of its own
            continue
        access = Listener(path)
        mjcf_files.check(path, access)
        missing = {part for part in parts if part.is_file()} - access.checked - {path.resolve()}
        assert not missing, (path, missing)
        named += len(parts) - 1
    assert named > 0
