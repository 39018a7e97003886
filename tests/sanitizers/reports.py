"""What sanitizers wrote, as findings of scenes."""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
BEGINS = "== scene "  # a line of what is drawn next
ENDS = "== drawn "
HEADER = "== header "  # a line of a header that a kernel includes
_CLANG = re.compile(r"ERROR: (AddressSanitizer: [\w-]+)|^(\S+:\d+):\d+: runtime error: (.*)")
_NVIDIA = re.compile(r"^========= (?!COMPUTE-SANITIZER|\w+ SUMMARY)(\S.*)")  # what belongs to it is indented
_FRAME = re.compile(r"#\d+ 0x\w+ in .* (\S+/(?:kernels|warpcam)/\S+?:\d+)|^=+ +at (.*)")
_ADDRESS = re.compile(r"0x[0-9a-f]+")


def told(text: str, begin: str) -> list[str]:
    """What follows in lines that begin so, each once."""
    return sorted({line.removeprefix(begin) for line in text.splitlines() if line.startswith(begin)})


def drawn(text: str, tool: str = "asan+ubsan") -> list[dict[str, Any]]:
    """What a process wrote that drew scenes, one entry for each that was begun."""
    parts = [part.split("\n", 1) for part in re.split(f"^{BEGINS}", text, flags=re.MULTILINE)[1:]]
    return [_scene(name, rest.splitlines(), tool) for name, rest in parts]


def _scene(name: str, lines: list[str], tool: str) -> dict[str, Any]:
    ends = [line.removeprefix(ENDS) for line in lines if line.startswith(ENDS)]
    return {
        "tool": tool,
        "scene": name,
        "seconds": float(ends[0]) if ends else None,
        "end": "" if ends else next((line for line in reversed(lines) if line.strip()), "")[:300],
        "findings": findings(lines),
    }


def findings(lines: list[str]) -> list[dict[str, object]]:
    """Distinct findings of a scene, the most frequent first: what, where and how often."""
    counts = Counter(_found(lines))
    return [{"what": what, "place": place, "count": count} for (what, place), count in counts.most_common()]


def _found(lines: list[str]) -> Iterator[tuple[str, str]]:
    for number, line in enumerate(lines):
        if match := _CLANG.search(line):
            yield (match[1], _place(lines[number + 1 :])) if match[1] else (match[3], _short(match[2]))
        elif match := _NVIDIA.match(line):
            yield _ADDRESS.sub("0x...", match[1]), _place(lines[number + 1 :])


def _place(lines: list[str]) -> str:
    """The first frame of our own below a finding."""
    for line in lines[:60]:
        if match := _FRAME.search(line):
            return _short(match[1] or _ADDRESS.sub("0x...", match[2]))
    return ""


def _short(place: str) -> str:
    return place.replace(f"{ROOT}/", "")
