"""Commands of the pages, and the parsers of the programs that they call."""

import argparse
import importlib.util
import re
import runpy
import shlex
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
SHELLS = ("", "sh", "bash")
ENTRYPOINTS = re.compile(r"^ *entrypoint: (.*)$", re.MULTILINE)
SPANS = re.compile(r"`([^`]+)`")
PROGRAMS = ("warpcam", "python", "python3", "pip", "torchrun", "mkdocs", "mike", "apt-get")
# What stands before a program and runs it.
BEFORE = re.compile(r"^(?:srun |[A-Z_]+=\S+ |\$?jobs=\$\()*(?:\.venv/bin/)?")


class Parsed(Exception):  # noqa: N818
    """A program has parsed its arguments, and is to do no more."""


def commands_of(text: str) -> list[list[str]]:
    """Commands of a page, as lists of words: in blocks, in Ray's files, and in sentences."""
    lines = [line for kind, block in BLOCKS.findall(text) if kind in SHELLS for line in _lines(block)]
    lines += ENTRYPOINTS.findall(text)
    spans = [" ".join(span.split()) for span in SPANS.findall(BLOCKS.sub("", text))]
    lines += [span for span in spans if " " in span]
    return list(_split(lines))


def _lines(block: str) -> Iterator[str]:
    """Lines of a block, those that go on joined; what is quoted over several lines stays one."""
    pending = ""
    for line in block.replace("\\\n", " ").splitlines():
        pending += line
        if pending.count('"') % 2:
            pending += "\n"
            continue
        yield pending
        pending = ""


def _split(lines: Sequence[str]) -> Iterator[list[str]]:
    for line in lines:
        for part in line.split(" && "):
            command = BEFORE.sub("", part.strip())
            if command.split(" ")[0] not in PROGRAMS:
                inner = re.findall(r'"(warpcam [^"]*)"', command)
                yield from (shlex.split(each) for each in inner)
                continue
            yield shlex.split(command, comments=True)


def parse(command: Sequence[str]) -> None:
    """Have the program of a command parse its arguments, and do nothing else; SystemExit tells of a wrong one."""
    program, *arguments = command
    if program != "pip":  # what is in brackets may be left out; I/N are numbers
        arguments = [word.removeprefix("[").removesuffix("]").replace("I/N", "0/2") for word in arguments]
    PARSERS[program](arguments)


def _warpcam(arguments: list[str]) -> None:
    from warpcam.tools import cli

    if len(arguments) == 1:  # a sentence that names the command
        arguments = [*arguments, "--help"]
    if arguments[-1] == "--help":
        try:
            cli._parser().parse_args(arguments)
        except SystemExit as end:
            if end.code:
                raise
        return
    cli._parser().parse_args(arguments)


def _python(arguments: list[str]) -> None:
    if "-m" not in arguments:
        raise SystemExit(f"python {arguments}: -m is wanted")
    _, module, *rest = arguments
    if module == "timeit":
        *options, statement = rest
        compile(options[options.index("-s") + 1], "setup", "exec")
        compile(statement, "statement", "exec")
    elif module != "venv":
        _module(module, rest or ["--help"])


def _module(module: str, arguments: list[str]) -> None:
    """Run a module up to where its arguments are parsed."""
    if importlib.util.find_spec(module) is None:
        raise ModuleNotFoundError(f"there is no {module}", name=module)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # runpy's, of a module that is imported already
        _until_parsed(module, arguments, lambda: runpy.run_module(module, run_name="__main__"))


def _until_parsed(name: str, arguments: list[str], run: Callable[[], Any]) -> None:
    parse_args, argv = argparse.ArgumentParser.parse_args, sys.argv

    def parsed(parser: argparse.ArgumentParser, given: Any = None, namespace: Any = None) -> None:
        parse_args(parser, given, namespace)
        raise Parsed

    argparse.ArgumentParser.parse_args = parsed  # type: ignore[assignment, method-assign]
    sys.argv = [name, *arguments]
    try:
        run()
    except Parsed:
        return
    except SystemExit as end:
        if end.code or "--help" not in arguments:
            raise
        return
    finally:
        argparse.ArgumentParser.parse_args, sys.argv = parse_args, argv  # type: ignore[method-assign]
    raise SystemExit(f"{name} parses no arguments")


def _torchrun(arguments: list[str]) -> None:
    from torch.distributed.run import get_args_parser

    options = get_args_parser().parse_args(arguments)
    if options.module:
        _module(options.training_script, options.training_script_args)
    elif not (ROOT / options.training_script).is_file():
        raise SystemExit(f"there is no {options.training_script}")


def _pip(arguments: list[str]) -> None:
    """Requirements that are well formed, and extras that this project has."""
    from packaging.requirements import InvalidRequirement, Requirement

    command, *words = arguments
    options = {word for word in words if word.startswith("-")}
    if command != "install" or not options <= {"-e", "--no-deps"}:
        raise SystemExit(f"pip: {command} came with {sorted(options)}")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for word in words:
        if word in options:
            continue
        try:
            wanted = Requirement(re.sub(r"^\.(?=\[|$)", "warpcam", word))
        except InvalidRequirement as error:
            raise SystemExit(f"pip: {error}") from None
        if wanted.name == "warpcam" and not wanted.extras <= extras.keys():
            raise SystemExit(f"pip: there is no extra {', '.join(sorted(wanted.extras - extras.keys()))}")


def _mkdocs(arguments: list[str]) -> None:
    from mkdocs.__main__ import cli

    if arguments[0] not in cli.commands:
        raise SystemExit(f"mkdocs: there is no command {arguments[0]}")
    cli.commands[arguments[0]].make_context(arguments[0], arguments[1:])


def _mike(arguments: list[str]) -> None:
    from mike.driver import main

    _until_parsed("mike", arguments, main)


def _apt(arguments: list[str]) -> None:
    if arguments[0] != "install":
        raise SystemExit(f"apt-get: install is wanted, got {arguments[0]}")


PARSERS: dict[str, Callable[[list[str]], None]] = {
    "warpcam": _warpcam,
    "python": _python,
    "python3": _python,
    "pip": _pip,
    "torchrun": _torchrun,
    "mkdocs": _mkdocs,
    "mike": _mike,
    "apt-get": _apt,
}
