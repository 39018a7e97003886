"""Public names of a class: its members, and attributes that its methods assign."""

import ast
import inspect
import textwrap
from typing import Any


def public_names(kind: Any) -> set[str]:
    """Names without a leading underscore that an object of the class has, by the sources of the class and its bases."""
    names = set(dir(kind))
    for base in inspect.getmro(kind)[:-1]:
        for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(base)))):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                names |= {node.attr} if getattr(node.value, "id", "") == "self" else set()
    return {name for name in names if not name.startswith("_")}
