"""Models that MuJoCo reads, and MuJoCo-Warp does not take."""

from pathlib import Path

import pytest
from numpy.linalg import LinAlgError

import warpcam as wc

mjw = pytest.importorskip("mujoco_warp")


@pytest.mark.parametrize("error", [LinAlgError, NotImplementedError, RuntimeError, IndexError])
def test_a_model_that_mujoco_warp_refuses(
    error: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error("Matrix is not positive definite")

    path = tmp_path / "a.xml"
    path.write_text('<mujoco><worldbody><geom size="0.1"/></worldbody></mujoco>')
    monkeypatch.setattr(mjw, "put_model", fail)
    with pytest.raises(wc.WarpcamError, match=r"MuJoCo-Warp cannot simulate .*a\.xml.*positive definite"):
        wc.load(path, device="cpu")


def test_memory_that_mujoco_warp_does_not_get(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("Failed to allocate 4096 bytes on device 'cpu'")

    path = tmp_path / "a.xml"
    path.write_text('<mujoco><worldbody><geom size="0.1"/></worldbody></mujoco>')
    monkeypatch.setattr(mjw, "put_data", fail)
    with pytest.raises(wc.OutOfMemoryError, match=r"a\.xml.*4,096 more bytes"):
        wc.load(path, device="cpu")
