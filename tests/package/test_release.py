"""A release: one version everywhere, the same dependencies for pip and conda, and workflows that run what is there."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

yaml = pytest.importorskip("yaml", reason="pip install 'warpcam[calibration]'")

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CONDA_NAMES = {"torch": "pytorch"}
WORKFLOWS = ROOT / ".github" / "workflows"


def read(path: str) -> Any:
    return yaml.safe_load((ROOT / path).read_text())


def test_one_version_everywhere() -> None:
    recipe = read("packaging/conda/recipe.yaml")
    heading = re.search(r"^## (\S+), (not yet released|\d{4}-\d\d-\d\d)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert heading is not None
    assert PROJECT["version"] == recipe["context"]["version"] == str(read("CITATION.cff")["version"]) == heading[1]
    assert PROJECT["license"] == recipe["about"]["license"] == read("CITATION.cff")["license"]


def test_changes_can_be_read_in_five_minutes() -> None:
    assert len((ROOT / "CHANGELOG.md").read_bytes()) < 12_000


def without_spaces(requirement: str) -> str:
    name, limits = re.fullmatch(r"([\w-]+)\s*(.*)", requirement).groups()  # type: ignore[union-attr]
    return CONDA_NAMES.get(name, name) + limits.replace(" ", "")


def test_conda_needs_what_pip_needs() -> None:
    recipe = read("packaging/conda/recipe.yaml")
    python, *others = recipe["requirements"]["run"]
    assert set(map(without_spaces, others)) == set(map(without_spaces, PROJECT["dependencies"]))
    lowest = recipe["context"]["python_min"]
    assert without_spaces(python.replace("${{ python_min }}", lowest)) == f"python{PROJECT['requires-python']}"
    extras = [each for extra in PROJECT["optional-dependencies"].values() for each in extra]
    assert set(map(without_spaces, recipe["requirements"]["run_constraints"])) <= set(map(without_spaces, extras))
    (script,) = recipe["build"]["python"]["entry_points"]
    assert script.replace(" ", "") == "warpcam=" + PROJECT["scripts"]["warpcam"]


def test_the_image_is_built_of_folders_that_are_there() -> None:
    text = (ROOT / "packaging" / "Dockerfile").read_text()
    copied = [name for line in re.findall(r"^COPY (?!--)(.*) \S+$", text, re.M) for name in line.split()]
    assert {"pyproject.toml", "warpcam", "kernels", "benchmarks"} <= set(copied)
    let_in = (ROOT / ".dockerignore").read_text()
    for name in copied:
        assert (ROOT / name).exists(), name
        assert f"!{name}" in let_in, name
    extras = re.search(r"^ARG EXTRAS=(\S+)$", text, re.M)
    assert extras is not None
    assert set(extras[1].split(",")) <= PROJECT["optional-dependencies"].keys()


def test_workflows_run_what_is_there() -> None:
    files = {path.name: read(f".github/workflows/{path.name}") for path in WORKFLOWS.iterdir()}
    assert files.keys() == {"ci.yml", "release.yml"}
    runs = [
        step["run"]
        for file in files.values()
        for job in file["jobs"].values()
        for step in job["steps"]
        if "run" in step
    ]
    assert ".ci/run" in runs and (ROOT / ".ci" / "run").is_file()
    assert files["release.yml"]["jobs"]["publish"]["needs"] == "try"
    tried = files["release.yml"]["jobs"]["try"]
    pythons = {f"Programming Language :: Python :: {each}" for each in tried["strategy"]["matrix"]["python"]}
    assert pythons == {each for each in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", each)}
