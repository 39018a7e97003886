"""Which headers of kernels/native a header includes, directly or by others."""

import re
from collections.abc import Iterable

from tests.sanitizers.reports import ROOT

NATIVE = ROOT / "kernels" / "native"
_INCLUDE = re.compile(r'^\s*#include "([^"]+)"', re.MULTILINE)


def all_headers() -> set[str]:
    return {str(path.relative_to(NATIVE)) for path in NATIVE.rglob("*.h")}


def named(source: str) -> list[str]:
    """Headers that a source includes itself."""
    return _INCLUDE.findall(source)


def closure(headers: Iterable[str]) -> set[str]:
    """The headers and all that they include."""
    found: set[str] = set()
    left = list(headers)
    while left:
        header = left.pop()
        if header not in found and (NATIVE / header).is_file():
            found.add(header)
            left += named((NATIVE / header).read_text())
    return found
