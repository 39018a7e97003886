"""Machines that are made up: what CUDA shows of four cards, as the rule of devices would find it."""

import re
from types import SimpleNamespace
from typing import Any

UUIDS = [f"GPU-{letter * 8}-0000-0000-0000-000000000000" for letter in "abcd"]
PART = "MIG-eeeeeeee-0000-0000-0000-000000000000"  # of the last card


def cards_shown(setting: str | None) -> list[int]:
    """Return CUDA's reading of ``CUDA_VISIBLE_DEVICES`` on a machine of four cards: the card behind each ordinal."""
    if setting is None:
        return [0, 1, 2, 3]
    cards: list[int] = []
    for entry in setting.split(","):
        word = entry.strip()
        card = int(word) if re.fullmatch(r"-?\d+", word) else 3 if word == PART else -1
        card = UUIDS.index(word) if word in UUIDS else card
        if not 0 <= card < 4:
            break
        if card in cards:
            return []
        cards.append(card)
    return cards


class Machine:
    """Stands in for Warp on a machine of four cards."""

    Device = SimpleNamespace

    def __init__(self, setting: str | None, driver: tuple[int, int] | None = (13, 0)):
        cards = cards_shown(setting) if driver else []
        self.driver = driver
        self._gpus = [SimpleNamespace(alias=f"cuda:{i}", card=card) for i, card in enumerate(cards)]
        self._all = {each.alias: each for each in [SimpleNamespace(alias="cpu", card=None), *self._gpus]}

    def init(self) -> None:
        """Nothing has to be started."""

    def get_devices(self) -> list[Any]:
        return list(self._all.values())

    def get_cuda_device_count(self) -> int:
        return len(self._gpus)

    def get_device(self, name: str | None) -> Any:
        if name == "cuda":
            if not self._gpus:
                raise RuntimeError('"cuda" device requested but CUDA is not supported')
            return self._gpus[0]
        if name is None:
            return [*self._all.values()][-1]
        if name not in self._all:
            raise ValueError(f"Invalid device identifier: {name}")
        return self._all[name]
