"""Run other projects' tests.

It ends with an error if a failure is not known, if one that is known passes, or if a named project cannot be run.
"""

import argparse
import ctypes.util
import os
import sys
from pathlib import Path

from .projects import PROJECTS
from .run import run

# Before anything imports mujoco, whose own renderer some tests need, as tests/conftest.py has it.
os.environ.setdefault("MUJOCO_GL", "osmesa" if ctypes.util.find_library("OSMesa") else "disable")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.other_projects", description=__doc__)
    parser.add_argument(
        "projects", nargs="*", metavar="PROJECT", help=f"of {', '.join(PROJECTS)}; all if none is given"
    )
    parser.add_argument("-k", default="", metavar="TEXT", help="only tests that have this in their names")
    parser.add_argument(
        "--clone", action="append", default=[], metavar="PROJECT=FOLDER",
        help="a clone of a project whose package has no tests: gymnasium=/path/to/Gymnasium",
    )  # fmt: skip
    given = parser.parse_args()
    clones = {name: Path(folder) for name, _, folder in (clone.partition("=") for clone in given.clone)}
    for name in (*given.projects, *clones):
        if name not in PROJECTS:
            parser.error(f"{name!r} came; projects are {', '.join(PROJECTS)}")
    wrong = 0
    for name in given.projects or PROJECTS:
        project = PROJECTS[name]
        reason = project.missing()
        if not reason and project.folder and name not in clones:
            reason = f"its package has no tests; clone its repository and pass --clone {name}=FOLDER"
        if reason:
            print(f"{name}: not run: {reason}")
            wrong += name in given.projects
            continue
        outcome = run(project, clones.get(name) if project.folder else None, given.k)
        new, mended = outcome.new(project.known), [] if given.k else outcome.mended(project.known)
        known = len(outcome.failed) - len(new)
        print(f"{name}: {len(outcome.passed)} pass, {known} differ as is known, {len(outcome.skipped)} skip themselves")
        for test, why in new.items():
            print(f"  NEW FAILURE {test}: {why}")
        for pattern in mended:
            print(f"  PASSES {pattern}: take it off the list in tests/other_projects/known.py")
        wrong += len(new) + len(mended)
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main())
