"""Launches: kernels are launched where threads that are the first to need one wait for each other."""

import ast
from pathlib import Path

from tests.package.test_floors import ROOT

LAUNCHERS = {"kernels/runtime/compile.py", "kernels/runtime/launch.py", "kernels/build/bvh4.py"}
CALLS = {"launch", "launch_tiled", "force_load", "load_module"}


def _callers(path: Path) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{node.lineno} wp.{node.func.attr}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and isinstance(node.func.value, ast.Name)
        and node.func.value.id in ("wp", "warp")
        and node.func.attr in CALLS
    ]


def test_warp_is_asked_to_launch_in_few_modules() -> None:
    paths = [path for room in ("kernels", "warpcam") for path in (ROOT / room).rglob("*.py")]
    callers = {str(path.relative_to(ROOT)): _callers(path) for path in paths}
    assert callers["kernels/runtime/launch.py"]
    others = [call for path, calls in callers.items() if path not in LAUNCHERS for call in calls]
    assert not others, others
