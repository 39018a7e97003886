"""The command that runs other projects' tests: what is new, what is known and what has been mended."""

import unittest
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("absl", reason="pip install absl-py")
from tests.other_projects import __main__ as command
from tests.other_projects import run
from tests.other_projects.projects import Project

STATE = {"in place": False}


def cases() -> type[unittest.TestCase]:
    class Cases(unittest.TestCase):  # in a function, where pytest does not find it
        def test_in_place(self) -> None:
            assert STATE["in place"]

        def test_wrong(self) -> None:
            raise AssertionError("1 is not 2")

        def test_broken(self) -> None:
            raise AttributeError("no such thing")

        def test_left_out(self) -> None:
            self.skipTest("not here")

    return Cases


@contextmanager
def in_place() -> Iterator[None]:
    STATE["in place"] = True
    try:
        yield
    finally:
        STATE["in place"] = False


class Small(Project):
    def cases(self) -> Iterator[unittest.TestCase]:
        yield from map(cases(), ("test_in_place", "test_wrong", "test_broken", "test_left_out"))


def small(known: Mapping[str, str], name: str = "json") -> Project:
    return Small(name, {}, in_place, known)


def said(
    known: Mapping[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *asked: str
) -> tuple[int, str]:
    monkeypatch.setattr(command, "PROJECTS", {"json": small(known)})
    monkeypatch.setattr("sys.argv", ["tests.other_projects", *asked])
    code = command.main()
    return code, capsys.readouterr().out


def test_what_is_known_is_no_error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    known = {"Cases.test_wrong": "differs", "Cases.test_b*": "differs"}
    code, text = said(known, monkeypatch, capsys)
    assert code == 0 and "json: 1 pass, 2 differ as is known, 1 skip themselves" in text
    assert not STATE["in place"]


def test_a_new_failure_is_an_error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code, text = said({"Cases.test_wrong": "differs"}, monkeypatch, capsys)
    assert code == 1 and "NEW FAILURE Cases.test_broken: AttributeError: no such thing" in text


def test_what_is_known_and_passes_is_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    known = {"Cases.test_wrong": "differs", "Cases.test_broken": "differs", "Cases.test_in_place": "differs"}
    code, text = said(known, monkeypatch, capsys)
    assert code == 1 and "PASSES Cases.test_in_place: take it off the list" in text
    code, text = said(known, monkeypatch, capsys, "-k", "broken")  # of a part nothing is said about the rest
    assert code == 0 and "json: 0 pass, 1 differ as is known" in text


def test_tests_of_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "PLUGIN", "no:doctest")
    (tmp_path / "test_it.py").write_text(
        "def test_one(): pass\ndef test_human(): pass\ndef test_two(): assert 1 == 2\n"
    )
    project = Project("json", {}, in_place, {}, folder="test_it.py", left_out="human")
    outcome = run.run(project, tmp_path, "")
    assert outcome.passed == ["test_it.test_one"] and list(outcome.failed) == ["test_it.test_two"]


def test_projects_say_why_they_cannot_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    gone = Project("no_such_project", {}, in_place, {})
    folder = Project("json", {}, in_place, {}, folder="tests")
    monkeypatch.setattr(command, "PROJECTS", {"no_such_project": gone, "json": folder})
    monkeypatch.setattr("sys.argv", ["tests.other_projects"])
    assert command.main() == 0
    text = capsys.readouterr().out
    assert "no_such_project: not run: no_such_project cannot be imported" in text
    assert "json: not run: its package has no tests; clone its repository and pass --clone json=FOLDER" in text
    monkeypatch.setattr("sys.argv", ["tests.other_projects", "no_such_project"])
    assert command.main() == 1
