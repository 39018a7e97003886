"""XML that declares no entities: these can open files, and grow without end."""

from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from warpcam.core.errors import RefusedError


def root_of(data: bytes, path: Path) -> ElementTree.Element:
    """Return the root of a document.

    Raises:
        RefusedError: It declares entities.
        xml.etree.ElementTree.ParseError: It is no XML.
    """
    with suppress(expat.ExpatError):  # the same, with words for users
        check(data, path)
    try:
        return ElementTree.fromstring(data)
    except (LookupError, ValueError) as error:
        raise ElementTree.ParseError(str(error)) from None


def check(data: bytes, path: Path) -> None:
    """Raise ``RefusedError`` if a document declares entities, and ``ExpatError`` if it is no XML."""

    def declared(name: str, *_: object) -> None:
        raise RefusedError(
            f"{path}: declares the XML entity {name!r}, which can open other files; entities are not read"
        )

    parser = expat.ParserCreate()
    parser.EntityDeclHandler = declared
    try:
        parser.Parse(data, True)
    except RefusedError:  # a ValueError, too
        raise
    except (LookupError, ValueError) as error:  # an encoding that Python does not have, or its parser does not read
        raise expat.ExpatError(str(error)) from None
