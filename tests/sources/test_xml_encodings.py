"""XML of encodings that Python does not have, or that its parser does not read."""

import contextlib
from pathlib import Path
from xml.etree import ElementTree

import pytest

import warpcam as wc
from warpcam.core.file_access import FileAccess
from warpcam.sources.common import plain_xml

ENCODINGS = ("utf--1e38", "utf-32", "rot13", "idna", "")
ROBOT = '<?xml version="1.0" encoding="{}"?><robot name="r"><link name="a"/></robot>'


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_such_a_document_is_no_xml(encoding: str) -> None:
    with pytest.raises(ElementTree.ParseError):
        plain_xml.root_of(ROBOT.format(encoding).encode(), Path("a.urdf"))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_urdf_files_of_such_encodings(encoding: str, tmp_path: Path) -> None:
    """MuJoCo reads some, as it does not look at encodings; for Newton they are told as no URDF."""
    path = tmp_path / "a.urdf"
    path.write_text(ROBOT.format(encoding))
    with contextlib.suppress(wc.WarpcamError):
        wc.load(path, device="cpu")
    pytest.importorskip("newton")
    from newton import ModelBuilder

    from warpcam.sources.newton import urdf

    with pytest.raises(wc.WarpcamError, match="it is no URDF file"):
        urdf.add_urdf(print, ModelBuilder(), path, FileAccess(path))
