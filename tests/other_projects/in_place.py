"""A plugin of pytest that puts the front end of the project ``IN_PLACE`` in the place of the project's own classes."""

import os
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from .projects import PROJECTS

_stack = ExitStack()


def pytest_configure(config: pytest.Config) -> None:
    _stack.enter_context(PROJECTS[os.environ["IN_PLACE"]].in_place())


@pytest.fixture(autouse=True, scope="session")
def _given_back() -> Iterator[None]:
    yield
    _stack.close()
