"""Processes that learn together: device and seed of each, and what they come to."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import torch

pytest.importorskip("gymnasium", reason="pip install 'warpcam[train]'")

from warpcam.train.ranks import Rank

HELPERS = Path(__file__).resolve().parents[1] / "helpers"


def test_ranks_have_seeds_of_their_own_and_the_first_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("RANK", "5"), ("LOCAL_RANK", "1"), ("WORLD_SIZE", "8")):
        monkeypatch.setenv(name, value)
    rank = Rank.here()
    assert rank == Rank(number=5, local=1, count=8) and not rank.writes and Rank().writes
    assert Rank().seed(3) == 3
    assert len({Rank(number, 0, 8).seed(3) for number in range(8)}) == 8
    assert rank.device("cpu") == "cpu"


ONE_HOST = [["--standalone", "--nproc-per-node", "2"]]


def two_hosts() -> list[list[str]]:
    """As on two hosts, the second of which finds the first by its address; here both are this one."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    shared = ["--nnodes", "2", "--nproc-per-node", "1", "--master-addr", "127.0.0.1", "--master-port", port]
    return [[*shared, "--node-rank", str(number)] for number in range(2)]


@pytest.mark.parametrize("hosts", [1, 2])
def test_two_processes_learn_the_same_weights_from_different_worlds(tmp_path: Path, hosts: int) -> None:
    pytest.importorskip("rsl_rl", reason="pip install 'warpcam[train]'")
    program = [str(HELPERS / "fast_compile.py"), str(HELPERS / "learns_together.py"), str(tmp_path)]
    # Without Mesa, before which triton would have to be imported.
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": "", "OMP_NUM_THREADS": "1", "MUJOCO_GL": "disable"}
    groups = [
        subprocess.Popen(
            [sys.executable, "-m", "torch.distributed.run", *launched, *program],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for launched in (ONE_HOST if hosts == 1 else two_hosts())
    ]
    try:
        for group in groups:
            printed, _ = group.communicate(timeout=240)
            assert group.returncode == 0, printed
    finally:
        for group in groups:
            group.kill()
    first, second = (torch.load(tmp_path / f"{number}.pt") for number in range(2))
    assert [one["local"] for one in (first, second)] == ([0, 1] if hosts == 1 else [0, 0])
    assert not (first["states"] == second["states"]).any()
    for model in ("actor", "critic"):
        assert all(map(torch.equal, first["after"][model], second["after"][model])), model
        assert not any(map(torch.equal, first["after"][model], first["before"][model])), model
