"""Sizes of YAML files with their aliases: a few lines can stand for billions of entries."""

from typing import Any

from warpcam.core.errors import RefusedError
from warpcam.core.file_access import FileAccess


def check(text: str, access: FileAccess, name: str) -> None:
    """Check a text before it is constructed.

    Args:
        text: YAML.
        access: Limits of sizes.
        name: Of the file, for messages.

    Raises:
        RefusedError: An entry has itself for a part, or there are more entries than ``limits.copies``, with those that
            aliases stand for.
        yaml.YAMLError: The text is no YAML.
    """
    import yaml

    sizes: dict[int, int | None] = {}  # None while a node's parts are counted

    def size(node: Any) -> int:
        if id(node) not in sizes:
            sizes[id(node)] = None
            parts: list[Any] = []
            if isinstance(node, yaml.SequenceNode):
                parts = node.value
            elif isinstance(node, yaml.MappingNode):
                parts = [part for pair in node.value for part in pair]
            sizes[id(node)] = 1 + sum(map(size, parts))
        found = sizes[id(node)]
        if found is None:
            raise RefusedError(f"{name}: line {node.start_mark.line + 1}: an entry has itself for a part")
        return found

    roots = [root for root in yaml.compose_all(text, Loader=yaml.SafeLoader) if root is not None]
    access.check("copies", sum(map(size, roots)), f"{name}: the text, with the entries that its aliases stand for,")
