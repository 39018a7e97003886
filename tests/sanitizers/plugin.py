"""A plugin of pytest: tests whose kernels clang compiles, with sanitizers, and which are told like scenes."""

import time
from collections.abc import Iterator

import pytest

from tests.sanitizers import clang
from tests.sanitizers.reports import BEGINS, ENDS

clang.install()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    began, failed = time.monotonic(), item.session.testsfailed
    print(f"\n{BEGINS}{item.nodeid}", flush=True)
    result = yield
    if item.session.testsfailed == failed:
        print(f"\n{ENDS}{time.monotonic() - began:.1f}", flush=True)
    return result
