"""Warnings about a scene that was read: collected, and given once for each kind of problem."""

import logging
from collections.abc import Callable

FEW = 3  # places that are named


class WarningCollector:
    """Sentences with the places they are about."""

    def __init__(self, source: str):
        self._source = source
        self._warnings: dict[str, dict[str, None]] = {}
        self._remarks: dict[str, dict[str, None]] = {}

    def warn(self, what: str, where: str = "") -> None:
        """Something is missing or wrong."""
        self._warnings.setdefault(what, {})[where] = None

    def remark(self, what: str, where: str = "") -> None:
        """Something is drawn in another way than its author may have meant."""
        self._remarks.setdefault(what, {})[where] = None

    def say(self) -> None:
        """Log all of it, warnings as such."""
        log = logging.getLogger("warpcam")
        for sentences, tell in ((self._warnings, log.warning), (self._remarks, log.info)):
            self._tell(sentences, tell)
            sentences.clear()

    def _tell(self, sentences: dict[str, dict[str, None]], tell: Callable[..., None]) -> None:
        for what, places in sentences.items():
            named = [place for place in places if place]
            more = f" and {len(named) - FEW} more" if len(named) > FEW else ""
            where = f": {', '.join(named[:FEW])}{more}" if named else ""
            tell("%s: %s%s", self._source, what, where)
