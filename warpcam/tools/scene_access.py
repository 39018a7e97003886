"""Arguments of commands that say which files a scene may open."""

import argparse
from pathlib import Path
from typing import Any


def add(command: argparse.ArgumentParser) -> None:
    """Add ``--trusted`` and ``--search-path`` to a command."""
    command.add_argument(
        "--trusted", action="store_true", help="let the scene's files name files outside of the scene's folder"
    )
    command.add_argument(
        "--search-path",
        action="append",
        default=[],
        type=Path,
        metavar="DIR",
        help="let the scene's files name files in this folder, too, and look for files there; may be given again",
    )


def options_of(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments ``trusted`` and ``search_paths`` of ``warpcam.load``."""
    return {"trusted": options.trusted, "search_paths": options.search_path}
