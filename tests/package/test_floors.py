"""Floors: what may import or include what, of Python modules and of native headers, without circles."""

import ast
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NATIVE = ROOT / "kernels" / "native"
# Rooms by floor, the lowest first: each may use itself and lower floors, and rooms of one floor do not use each other.
HEADER_FLOORS = (
    ("core",),
    ("shapes",),
    ("camera", "texture", "lights"),
    ("geometry",),
    ("accel",),
    ("output",),
    ("flow", "shading"),
    ("traversal", "splats"),
    ("shadow", "antialiasing", "shading_pass", "path"),
    ("occlusion",),
    ("build", "labels", "sensors"),
)
# Likewise of modules; a module is in the room with the longest name that its own begins with.
PYTHON_FLOORS = (
    ("warpcam.kernels",),
    ("warpcam.core",),
    ("warpcam.device", "warpcam.errors"),
    ("warpcam.accel",),
    ("warpcam.textures",),
    ("warpcam.camera",),
    ("warpcam.outputs",),
    ("warpcam.scene",),
    ("warpcam.render", "warpcam.sources"),
    ("warpcam.labeling", "warpcam.sensors"),
    ("warpcam.jax",),
    ("warpcam.randomize",),
    ("warpcam.load",),
    ("warpcam",),
    ("warpcam.visualize",),
    ("warpcam.envs", "warpcam.compat", "warpcam.viewer"),
    ("warpcam.train", "warpcam.datasets"),
    ("warpcam.benchmarks",),
    ("warpcam.tools",),
    ("warpcam.__main__", "warpcam.train.__main__"),
)

Uses = Mapping[str, Sequence[str]]


def floor_of(name: str, floors: Sequence[Sequence[str]], separator: str) -> tuple[int, str]:
    """Floor and room of a module or header."""
    rooms = [(len(room), floor, room) for floor, rooms in enumerate(floors) for room in rooms]
    found = [entry for entry in rooms if name == entry[2] or name.startswith(entry[2] + separator)]
    assert found, f"{name} is in no room"
    _, floor, room = max(found)
    return floor, room


def faults(uses: Uses, floors: Sequence[Sequence[str]], separator: str) -> list[str]:
    """Uses of higher floors, and of other rooms of the same floor."""
    found = []
    for user, used in uses.items():
        floor, room = floor_of(user, floors, separator)
        for name in used:
            below, other = floor_of(name, floors, separator)
            if below > floor or (below == floor and other != room):
                found.append(f"{user} uses {name}")
    return found


def circles(uses: Uses) -> list[list[str]]:
    """Circles of uses, each once, as a path that ends where it begins."""
    done: set[str] = set()
    found = []

    def walk(name: str, path: list[str]) -> None:
        if name in path:
            found.append([*path[path.index(name) :], name])
        elif name not in done:
            for used in uses.get(name, ()):
                walk(used, [*path, name])
            done.add(name)

    for name in uses:
        walk(name, [])
    return found


def header_uses() -> Uses:
    """Native headers by path below ``kernels/native``, with those that each includes."""
    paths = {path.relative_to(NATIVE).as_posix(): path for path in NATIVE.rglob("*.h")}
    include = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)
    return {name: [used for used in include.findall(path.read_text()) if used in paths] for name, path in paths.items()}


def python_uses() -> Uses:
    """Modules of the package, with those that each imports when it is imported itself."""
    folders = {
        "warpcam": ROOT / "warpcam",
        "warpcam.kernels": ROOT / "kernels",
        "warpcam.benchmarks": ROOT / "benchmarks",
    }
    paths = {}
    for package, folder in folders.items():
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder).with_suffix("").parts
            if package == "warpcam" and parts[0] in ("kernels", "benchmarks"):  # links to the other folders
                continue
            paths[".".join((package, *parts)).removesuffix(".__init__")] = path
    return {name: imports(ast.parse(path.read_text()), name, paths) for name, path in paths.items()}


def imports(tree: ast.Module, name: str, modules: Mapping[str, Path]) -> list[str]:
    """Modules of the package that a module's top level imports, without what is for type checkers alone."""
    found: dict[str, None] = {}
    pending: list[ast.stmt] = list(tree.body)
    while pending:
        node = pending.pop(0)
        if isinstance(node, ast.ImportFrom) and node.module is not None and not node.level:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                found[full if full in modules else node.module] = None
        elif isinstance(node, ast.Import):
            found.update(dict.fromkeys(alias.name for alias in node.names))
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            pending += node.orelse
        elif isinstance(node, ast.If | ast.Try | ast.With | ast.ClassDef):
            pending += [child for child in ast.walk(node) if isinstance(child, ast.Import | ast.ImportFrom)]
    return [used for used in found if used in modules and used != name]


def test_headers_include_lower_floors() -> None:
    uses = header_uses()
    assert len(uses) > 100
    assert faults(uses, HEADER_FLOORS, "/") == []


def test_headers_include_headers_that_are_there() -> None:
    include = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)
    for path in NATIVE.rglob("*.h"):
        for used in include.findall(path.read_text()):
            assert (NATIVE / used).is_file(), f"{path.relative_to(NATIVE)} includes {used}"


def test_headers_do_not_go_round_in_circles() -> None:
    assert circles(header_uses()) == []


def test_modules_import_lower_floors() -> None:
    uses = python_uses()
    assert len(uses) > 200
    assert faults(uses, PYTHON_FLOORS, ".") == []


def test_modules_do_not_go_round_in_circles() -> None:
    uses = {name: [used for used in found if used != "warpcam"] for name, found in python_uses().items()}
    assert circles(uses) == []


def test_a_module_of_a_higher_floor_is_found() -> None:
    tree = ast.parse("from warpcam.render import renderer\nif TYPE_CHECKING:\n    from warpcam import viewer\n")
    modules = dict.fromkeys(("warpcam.render.renderer", "warpcam.viewer"), ROOT)
    uses = {"warpcam.scene.planted": imports(tree, "warpcam.scene.planted", modules)}
    assert faults(uses, PYTHON_FLOORS, ".") == ["warpcam.scene.planted uses warpcam.render.renderer"]


@pytest.mark.parametrize("used", ["shading/pbr.h", "shadow/shadow_pass.h"])
def test_a_higher_floor_is_found(used: str) -> None:
    uses = {**header_uses(), "antialiasing/planted.h": [used], "geometry/planted.h": [used]}
    found = faults(uses, HEADER_FLOORS, "/")
    assert f"geometry/planted.h uses {used}" in found
    assert (f"antialiasing/planted.h uses {used}" in found) == used.startswith("shadow/")


def test_a_circle_is_found() -> None:
    uses = {
        **header_uses(),
        "core/one.h": ["core/two.h"],
        "core/two.h": ["core/three.h"],
        "core/three.h": ["core/one.h"],
    }
    assert ["core/one.h", "core/two.h", "core/three.h", "core/one.h"] in circles(uses)
