"""The documentation as a site: its navigation, its reference of public names, and its links out of docs/."""

import ast
import contextlib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
MODULES = (
    *("warpcam", "warpcam.device", "warpcam.envs", "warpcam.jax", "warpcam.outputs", "warpcam.train", "warpcam.viewer"),
    *("warpcam.datasets", "warpcam.datasets.generate", "warpcam.sensors", "warpcam.sensors.patterns"),
    *(f"warpcam.compat.isaacgym.{name}" for name in ("gymapi", "gymtorch", "gymutil", "terrain_utils", "torch_utils")),
    *(f"warpcam.compat.{path.stem}" for path in sorted((ROOT / "warpcam" / "compat").glob("[!_.]*"))),
)
NOT_PUBLIC = {"warpcam.compat.common"}


def navigation() -> list[str]:
    """Pages of the navigation, in order."""
    yaml = pytest.importorskip("yaml")

    class Loader(yaml.SafeLoader):  # type: ignore[misc, name-defined]
        """Takes no notice of names of Python's objects."""

    Loader.add_multi_constructor("tag:yaml.org,2002:python/name:", lambda *_: None)

    def pages(entry: Any) -> Iterator[str]:
        if isinstance(entry, str):
            yield entry
        for each in entry if isinstance(entry, list) else entry.values() if isinstance(entry, dict) else ():
            yield from pages(each)

    return list(pages(yaml.load((ROOT / "mkdocs.yml").read_text(), Loader)["nav"]))


def public_names(module: str) -> list[str]:
    """``__all__`` of a module, read without importing it: some need what is not installed."""
    path = ROOT.joinpath(*module.split("."))
    text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text()
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return list(ast.literal_eval(node.value))
    pytest.fail(f"{module} has no __all__")


def missing(module: str, reference: set[str]) -> list[str]:
    """Public names of a module that a reference has neither by themselves nor with their whole module."""
    names = [f"{module}.{name}" for name in public_names(module)]
    return [name for name in names if name not in MODULES and not {name, module} & reference]


def reference() -> set[str]:
    """What the pages of the API document: names, and modules in whole."""
    pages = (page.read_text() for page in (DOCS / "api").rglob("*.md"))
    return {name for page in pages for name in re.findall(r"^::: (\S+)$", page, re.MULTILINE)}


def linked_files() -> ModuleType:
    """The hook, which is no part of a package."""
    pytest.importorskip("mkdocs")
    spec = importlib.util.spec_from_file_location("linked_files", DOCS / "linked_files.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_page_is_in_the_navigation_once() -> None:
    pages = navigation()
    own = sorted(page for page in pages if not page.startswith("repository/"))
    assert own == sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))
    assert sorted(set(pages)) == sorted(pages)


@pytest.mark.parametrize("module", sorted({*MODULES} - NOT_PUBLIC))
def test_every_public_name_is_in_the_reference(module: str) -> None:
    names = reference()
    assert not missing(module, names)
    assert missing(module, names - {module} - {f"{module}.{name}" for name in public_names(module)})  # else: no guard


def test_what_whole_modules_do_not_show_is_named_beside_them() -> None:
    """Names that are bound by unpacking are not found where code is read and not run."""
    griffe = pytest.importorskip("griffe")
    package = griffe.load("warpcam", search_paths=[str(ROOT)], resolve_aliases=True)
    text = "".join(page.read_text() for page in (DOCS / "api").rglob("*.md"))
    whole = reference() & {*MODULES}
    assert whole
    for module in sorted(whole):
        members = {}
        for name, each in package[module.removeprefix("warpcam.")].members.items():
            with contextlib.suppress(griffe.AliasResolutionError):  # of what is not of this package
                members[name] = each.final_target if each.is_alias else each
        enums = {name for each in members.values() if each.is_class for name in each.members}
        unseen = [name for name in public_names(module) if name not in members.keys() | enums]
        assert [name for name in unseen if f"`{name}`" not in text] == [], module


def test_tables_of_the_readme_are_those_of_the_performance_page() -> None:
    rows = re.findall(r"^\|.* ms\*\* .*\|$", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert len(rows) > 10
    assert set(rows) <= set((DOCS / "performance.md").read_text().splitlines())


@pytest.mark.parametrize(
    ("page", "link", "expected"),
    [
        ("cameras.md", "[a](outputs.md#flow)", "[a](outputs.md#flow)"),
        ("cameras.md", "[a](../examples/hello.py)", "[a](repository/examples/hello.py.md)"),
        ("examples.md", "[a](../examples/notebooks/a.ipynb)", None),
        (
            "examples.md",
            "[a](../examples/notebooks/labels.ipynb)",
            "[a](repository/examples/notebooks/labels.ipynb.md)",
        ),
        ("compat/mjlab.md", "[a](../../benchmarks/README.md#cases)", "[a](../repository/benchmarks/about.md#cases)"),
        ("repository/CHANGELOG.md", "[a](docs/cameras.md#b)", "[a](../cameras.md#b)"),
        ("repository/benchmarks/about.md", "[a](results) [b](NOTES.md)", "a [b](NOTES.md)"),
        ("cameras.md", "`x[0](y)` [a](nowhere.md) [b](https://example.org)", None),
    ],
)
def test_links_lead_to_where_the_site_has_files(page: str, link: str, expected: str | None) -> None:
    shown = linked_files().on_page_markdown(link, page=SimpleNamespace(file=SimpleNamespace(src_uri=page)))
    assert shown == (expected or link)
