"""MkDocs hook: files of the repository outside docs/ that a page links to become pages below ``repository/``.

Links of Markdown files work in the repository, where they are relative paths, and on the site alike. Markdown and
program texts become pages; other files are copied; a link to a folder loses its link.
"""

import json
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[1]
FOLDER = "repository"
PAGES = ("CHANGELOG.md", "CONTRIBUTING.md", "benchmarks/README.md")  # those of the navigation
LANGUAGES = {".py": "python", ".yaml": "yaml"}
LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s#:]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the linked files, and those that they link to."""
    waiting, added = list(PAGES), set()
    for file in files.documentation_pages():
        waiting += _outside(file.content_string, f"docs/{file.src_uri}")
    while waiting:
        path = waiting.pop()
        if path in added or not (ROOT / path).is_file():
            continue
        added.add(path)
        files.append(_as_file(path, config))
        if path.endswith(".md"):
            waiting += _outside((ROOT / path).read_text(), path)
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point links out of docs/, and all links of files from outside, to where the site has their targets."""
    here = page.file.src_uri
    source = here.removeprefix(f"{FOLDER}/") if here.startswith(f"{FOLDER}/") else f"docs/{here}"

    def on_the_site(link: re.Match[str]) -> str:
        text, target, anchor = link.groups()
        path = _resolved(target, source)
        if not (ROOT / path).exists() or (source.startswith("docs/") and path.startswith("docs/")):
            return link[0]
        if not (ROOT / path).is_file():
            return text
        return f"[{text}]({posixpath.relpath(_uri(path), posixpath.dirname(here))}{anchor or ''})"

    return LINK.sub(on_the_site, markdown)


def _resolved(target: str, source: str) -> str:
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), target))


def _outside(text: str, source: str) -> Iterator[str]:
    """Paths of linked files outside docs/, from the repository's root."""
    paths = (_resolved(link[2], source) for link in LINK.finditer(text))
    return (path for path in paths if not path.startswith(("docs/", "..")))


def _uri(path: str) -> str:
    """Where the site's sources have a file of the repository."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    path = path.replace("README.md", "about.md")  # else MkDocs makes it the heading of its section
    return f"{FOLDER}/{path}.md" if Path(path).suffix in (*LANGUAGES, ".ipynb") else f"{FOLDER}/{path}"


def _cells(path: str) -> str:
    """A notebook as a page: its text, and its code in blocks."""
    cells = json.loads((ROOT / path).read_text())["cells"]
    texts = ["".join(cell["source"]) for cell in cells]
    kinds = [cell["cell_type"] for cell in cells]
    return "\n\n".join(
        f"```python\n{text}\n```" if kind == "code" else text for kind, text in zip(kinds, texts, strict=True)
    )


def _as_file(path: str, config: Any) -> File:
    if path.endswith(".ipynb"):
        return File.generated(config, _uri(path), content=_cells(path), inclusion=InclusionLevel.NOT_IN_NAV)
    language = LANGUAGES.get(Path(path).suffix)
    if language is None:
        return File.generated(config, _uri(path), abs_src_path=str(ROOT / path), inclusion=InclusionLevel.NOT_IN_NAV)
    text = f"# {path}\n\n```{language}\n{(ROOT / path).read_text()}```\n"
    return File.generated(config, _uri(path), content=text, inclusion=InclusionLevel.NOT_IN_NAV)
