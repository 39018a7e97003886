"""Notebooks run from the first cell to the last, as a user's kernel would, and are stored without what they showed."""

import json
import re
from pathlib import Path
from typing import Any

import fast_compile
import pytest

nbclient = pytest.importorskip("nbclient", reason="pip install nbclient ipykernel")
pytest.importorskip("ipykernel", reason="pip install nbclient ipykernel")
import nbformat  # noqa: E402

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
# Kernels that are quick to compile, in the folder of all tests, on the CPU.
BEFORE = f"""
import os, sys
os.environ["CUDA_VISIBLE_DEVICES"] = ""
sys.path.append({str(Path(fast_compile.__file__).parent)!r})
import fast_compile
fast_compile.install(ours=True)
"""
PRINTED = {
    "first_picture": r"m$",
    "labels": r"visible of the crate \[%\]: [1-9]\d, .*\nvisible of the ball \[%\]: 100, 100",
    "sensors": r"nearer than 2 m: .* mm, beyond 3 m: .* mm",
}
PICTURES = {"first_picture": 4, "labels": 1, "sensors": 2}


def outputs_of(book: Any) -> list[Any]:
    return [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path: Path, tmp_path: Path) -> None:
    book = nbformat.read(path, as_version=4)
    book.cells.insert(0, nbformat.v4.new_code_cell(BEFORE))
    nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = outputs_of(book)
    printed = "".join(output.text for output in outputs if output.output_type == "stream" and output.name == "stdout")
    assert sum("image/png" in output.get("data", {}) for output in outputs) == PICTURES[path.stem]
    assert re.search(PRINTED[path.stem], printed, re.MULTILINE), printed


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_stored_without_outputs(path: Path) -> None:
    text = path.read_text()
    cells = json.loads(text)["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert len(code) < len(cells) < 20
    assert len(text) < 10_000
    assert path.name in (FOLDER.parents[1] / "docs" / "examples.md").read_text()


def test_a_cell_that_fails_is_seen(tmp_path: Path) -> None:
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("raise ValueError('wrong')")])
    with pytest.raises(nbclient.exceptions.CellExecutionError, match="wrong"):
        nbclient.NotebookClient(book, timeout=60, resources={"metadata": {"path": str(tmp_path)}}).execute()
