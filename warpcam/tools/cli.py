"""The command ``warpcam``: render, dataset, replay, view, train, bench, doctor and cache."""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, NoReturn

import warpcam
from warpcam.core.errors import WarpcamError
from warpcam.tools import startup

# Each command with what its help says in a line, and the modules with its arguments (add) and its work (run): they are
# imported for that command alone.
COMMANDS: Mapping[str, tuple[str, str, str]] = {
    "render": ("render a scene in many worlds and save pictures", "warpcam.tools.render", "warpcam.tools.render"),
    "dataset": ("make labelled images in bulk", "warpcam.tools.dataset", "warpcam.tools.dataset"),
    "view": ("look around in a scene, in a browser", "warpcam.tools.view", "warpcam.tools.view"),
    "bench": ("time warpcam and its peers side by side", "warpcam.benchmarks.options", "warpcam.benchmarks.run"),
    "train": ("train a policy from pixels with rsl_rl", "warpcam.train.options", "warpcam.train.run"),
    "replay": (
        "render the states of demonstrations into images",
        *("warpcam.datasets.trajectories.replay_options",) * 2,
    ),
    "doctor": ("list versions and devices, and test every device", "warpcam.tools.doctor", "warpcam.tools.doctor"),
    "cache": ("show or empty the folder of cached trees", "warpcam.tools.cache", "warpcam.tools.cache"),
}


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything here does; has its arguments once it is asked to parse some."""

    fill: Callable[[argparse.ArgumentParser], None] | None = None

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"warpcam: {message}\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        if self.fill is not None:
            fill, self.fill = self.fill, None
            fill(self)
        return super().parse_known_args(args, namespace)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns its exit code: 0, 1 (the self test failed) or 2 (the user's mistake)."""
    options = _parser().parse_args(arguments)
    try:
        if options.command != "doctor":  # which tells why Warp does not start
            startup.start_warp()
        with startup.unwritable_folders_named():
            code: int = import_module(COMMANDS[options.command][2]).run(options)
    except WarpcamError as error:
        print(f"warpcam: {error}", file=sys.stderr)
        return 2
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="warpcam", description="Cameras for thousands of simulated robot worlds at once.")
    parser.add_argument("--version", action="version", version=f"warpcam {warpcam.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command", parser_class=_Parser)
    for name, (about, module, _) in COMMANDS.items():
        command = commands.add_parser(name, help=about)
        command.fill = lambda parser, module=module: import_module(module).add(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
