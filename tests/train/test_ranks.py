"""Processes that learn together: device and seed of each."""

import pytest

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")

from warpcam.train.ranks import Rank


def test_ranks_have_seeds_of_their_own_and_the_first_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("RANK", "5"), ("LOCAL_RANK", "1"), ("WORLD_SIZE", "8")):
        monkeypatch.setenv(name, value)
    rank = Rank.here()
    assert rank == Rank(number=5, local=1, count=8) and not rank.writes and Rank().writes
    assert Rank().seed(3) == 3
    assert len({Rank(number, 0, 8).seed(3) for number in range(8)}) == 8
    assert rank.device("cpu") == "cpu"
