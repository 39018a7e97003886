"""Contents of the package: packages and data files are listed, and CI does what the README promises."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest
import warp as wp

from warpcam.kernels.runtime import compile as compilation

ROOT = Path(__file__).resolve().parents[2]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


def packages_in(folder: Path, name: str) -> set[str]:
    """Names of the packages below a folder: every folder that holds Python files."""
    folders = {path.parent for path in folder.rglob("*.py") if path.name != "make_assets.py"}
    return {".".join([name, *path.relative_to(folder).parts]) for path in folders}


def test_every_package_is_listed() -> None:
    found = packages_in(ROOT / "warpcam", "warpcam")
    for folder in ("benchmarks", "kernels"):
        found |= packages_in(ROOT / folder, f"warpcam.{folder}")
    assert set(SETUPTOOLS["packages"]) == found


@pytest.mark.parametrize(("folder", "name"), [("warpcam", "warpcam"), ("kernels", "warpcam.kernels")])
def test_every_data_file_is_listed(folder: str, name: str) -> None:
    listed = {path for pattern in SETUPTOOLS["package-data"][name] for path in (ROOT / folder).glob(pattern)}
    left_out = {".py", ".pyc", ".md"}
    there = {path for path in (ROOT / folder).rglob("*") if path.is_file() and path.suffix not in left_out}
    assert there == listed


def test_all_kernels_are_compiled_with_the_same_flags() -> None:
    """Else Warp's headers are precompiled again, which takes longer than most kernels."""
    folder = ROOT / "kernels"
    paths = [path.relative_to(folder).with_suffix("") for path in folder.rglob("[a-z]*.py")]
    names = [".".join(["warpcam.kernels", *path.parts]) for path in paths]
    values = [value for name in names for value in vars(importlib.import_module(name)).values()]
    kernels = [value for value in values if isinstance(value, wp.Kernel)]
    assert len(kernels) > 30
    expected = compilation.compiler_flags()["cpu_compiler_flags"]
    assert {kernel.key: kernel.module.options["cpu_compiler_flags"] for kernel in kernels} == {
        kernel.key: expected for kernel in kernels
    }


def readme_commands() -> list[str]:
    """The set-up commands of the README: its lines that make an environment."""
    return re.findall(r"^(python3 -m venv .*)$", (ROOT / "README.md").read_text(), flags=re.MULTILINE)


def test_ci_runs_the_commands_of_the_readme() -> None:
    commands = readme_commands()
    assert len(commands) == 2
    script = (ROOT / ".ci" / "run").read_text()
    for command in commands:
        assert command in script


def test_ci_tests_the_oldest_warp_that_is_allowed() -> None:
    dependencies = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    (oldest,) = (each.removeprefix("warp-lang>=") for each in dependencies if each.startswith("warp-lang"))
    assert f"'warp-lang=={oldest}.*'" in (ROOT / ".ci" / "run").read_text()


def test_pictures_of_the_readme_are_small_and_there() -> None:
    names = re.findall(r"\((docs/images/[^)]+)\)", (ROOT / "README.md").read_text())
    assert names
    assert sum((ROOT / name).stat().st_size for name in names) < 400_000
    for page in (ROOT / "docs").glob("*.md"):
        names += re.findall(r"\((images/[^)/]+)\)", page.read_text())
    there = {path.name for path in (ROOT / "docs" / "images").iterdir() if path.is_file()}
    assert there == {Path(name).name for name in names}


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))], ids=lambda page: page.name
)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target
