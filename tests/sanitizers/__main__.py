"""``python -m tests.sanitizers --cpu`` or ``--gpu``: kernels of small scenes under sanitizers.

On a CPU, Warp's source of each kernel is compiled by the system's clang with AddressSanitizer and
UndefinedBehaviorSanitizer; which functions of kernels/native were reached is told, too. On a GPU, compute-sanitizer
looks at what users' kernels do: memcheck, racecheck, initcheck and synccheck. Exits with 1 if one of them found
something, or if a scene was not drawn to its end.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from tests.sanitizers import coverage, cpu, gpu


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.sanitizers", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--cpu", action="store_true")
    where.add_argument("--gpu", action="store_true")
    parser.add_argument("--scenes", nargs="+", metavar="SCENE", help="names (default: all for a CPU, few for a GPU)")
    parser.add_argument("--tests", nargs="+", default=[], metavar="PATH", help="tests in place of scenes, on a CPU")
    parser.add_argument("--tools", nargs="+", choices=gpu.TOOLS, default=list(gpu.TOOLS), help="of compute-sanitizer")
    parser.add_argument("--processes", type=int, default=16, help="at a time, on a GPU (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    options = parser.parse_args(arguments)
    room: Any = cpu if options.cpu else gpu
    if (reason := room.available()) is not None:
        print(f"sanitizers: {reason}")
        return 2
    from tests.sanitizers import scenes

    unknown = set(options.scenes or ()) - set(scenes.SCENES)
    if unknown:
        parser.error(f"--scenes: {', '.join(sorted(unknown))}: there are {', '.join(scenes.SCENES)}")
    if options.cpu:
        result = cpu.run(options.scenes or list(scenes.SCENES), options.tests)
    else:
        result = gpu.run(options.scenes or list(scenes.FEW), options.tools, options.processes)
    failed = _print(result, whole=not (options.scenes or options.tests))
    if options.out is not None:
        options.out.write_text(json.dumps(result, indent=1) + "\n")
    return int(failed)


def _print(result: dict[str, Any], whole: bool) -> bool:
    """One line for each tool and scene, and findings below it; true if there were any, or if all miss a header."""
    failed = False
    for scene in result["scenes"]:
        state = f"{scene['seconds']} s" if scene["seconds"] is not None else f"not drawn to its end: {scene['end']}"
        print(f"{scene['tool']:10} {scene['scene']:32} {len(scene['findings']):3} findings, {state}")
        failed |= bool(scene["findings"]) or scene["seconds"] is None
        for finding in scene["findings"]:
            print(f"    {finding['count']:6} times {finding['what']} | {finding['place']}")
    headers = result.get("headers", {})
    for header, counts in headers.items():
        print(f"{header:48} {counts['reached']:4} of {counts['functions']:4} functions, "
              f"{counts['lines_reached']:5} of {counts['lines']:5} lines")  # fmt: skip
    left = result.get("headers_left", coverage.missed(headers))
    for header in left if whole else ():
        print(f"{header}: no scene reaches it")
        failed = True
    return failed


if __name__ == "__main__":
    sys.exit(main())
