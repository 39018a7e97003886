"""Runs of one project's tests, and what they say beside the list of what is known to differ."""

import os
import subprocess
import sys
import tempfile
import unittest
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from .projects import Project

PLUGIN = "other_projects.in_place"  # a clone may have a package "tests" of its own


@dataclass
class Outcome:
    """Outcome of a project's tests.

    Attributes:
        passed: Names of tests.
        skipped: Names of tests, and why the project skips them.
        failed: Names of tests, and the ends of their messages.
    """

    passed: list[str] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    def new(self, known: Mapping[str, str]) -> dict[str, str]:
        """Failures that no pattern names."""
        return {name: why for name, why in self.failed.items() if not any(fnmatchcase(name, one) for one in known)}

    def mended(self, known: Mapping[str, str]) -> list[str]:
        """Patterns that name tests which all pass."""
        return [
            one
            for one in known
            if any(fnmatchcase(name, one) for name in self.passed)
            and not any(fnmatchcase(name, one) for name in (*self.failed, *self.skipped))
        ]


def run(project: Project, folder: Path | None, pattern: str) -> Outcome:
    """Run those tests whose names have the pattern in them; of a project whose tests lie in a folder, with pytest."""
    return _run_folder(project, folder, pattern) if folder is not None else _run_package(project, pattern)


def _run_package(project: Project, pattern: str) -> Outcome:
    from absl import flags

    if not flags.FLAGS.is_parsed():
        flags.FLAGS.mark_as_parsed()
    outcome = Outcome()
    with project.in_place():
        for case in project.cases():
            name = f"{type(case).__name__}.{case._testMethodName}"
            if pattern not in name:
                continue
            result = unittest.TestResult()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                case.run(result)
            wrong = [text for _, text in (*result.failures, *result.errors)] + [
                f"{one.id()} passes" for one in result.unexpectedSuccesses
            ]
            if wrong:
                outcome.failed[name] = wrong[0].strip().splitlines()[-1]
            elif result.skipped:
                outcome.skipped[name] = result.skipped[0][1]
            else:
                outcome.passed.append(name)
    return outcome


def _run_folder(project: Project, folder: Path, pattern: str) -> Outcome:
    outcome = Outcome()
    with tempfile.TemporaryDirectory() as place:
        report = Path(place) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", PLUGIN, "-p", "no:cacheprovider", f"--junitxml={report}"]
        chosen = [pattern] * bool(pattern) + [f"not {project.left_out}"] * bool(project.left_out)
        command += ["-W", "ignore", "-k", " and ".join(chosen), project.folder]
        paths = [str(Path(__file__).resolve().parents[up]) for up in (1, 2)] + [os.environ.get("PYTHONPATH", "")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "IN_PLACE": project.name}
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        if not report.exists():
            outcome.failed["pytest"] = (done.stdout + done.stderr).strip().splitlines()[-1]
            return outcome
        for case in ElementTree.parse(report).iter("testcase"):
            name = f"{case.get('classname', '').rpartition('.')[2]}.{case.get('name')}"
            wrong = [part for part in case if part.tag in ("failure", "error")]
            skipped = [part for part in case if part.tag == "skipped"]
            if wrong:
                outcome.failed[name] = (wrong[0].get("message") or "").splitlines()[0]
            elif skipped:
                outcome.skipped[name] = skipped[0].get("message") or ""
            else:
                outcome.passed.append(name)
    return outcome
