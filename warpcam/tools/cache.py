"""The command ``warpcam cache``: the folder of cached trees."""

import argparse

from warpcam.accel import tree_cache

ABOUT = "show or empty the folder of cached trees; WARPCAM_CACHE_DIR says where it is, WARPCAM_CACHE_SIZE its limit"


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.description = ABOUT
    command.add_argument("action", choices=("show", "clear"), nargs="?", default="show", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    folder = tree_cache.folder()
    if folder is None:
        print("there is no folder of cached trees")
    elif options.action == "clear":
        print(f"{tree_cache.trim(folder, 0):,} bytes removed from {folder}")
    else:
        print(f"{tree_cache.size(folder):,} of {tree_cache.limit():,} bytes used in {folder}")
    return 0
