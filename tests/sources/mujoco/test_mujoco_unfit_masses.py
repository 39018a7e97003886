"""Models that MuJoCo reads, and MuJoCo-Warp cannot factorize."""

from pathlib import Path

import pytest

import warpcam as wc

mjw = pytest.importorskip("mujoco_warp")


def test_a_model_that_mujoco_warp_cannot_factorize(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from numpy.linalg import LinAlgError

    def fail(*_: object, **__: object) -> None:
        raise LinAlgError("Matrix is not positive definite")

    path = tmp_path / "a.xml"
    path.write_text('<mujoco><worldbody><geom size="0.1"/></worldbody></mujoco>')
    monkeypatch.setattr(mjw, "put_model", fail)
    with pytest.raises(wc.WarpcamError, match=r"MuJoCo-Warp cannot simulate .*a\.xml.*positive definite"):
        wc.load(path, device="cpu")
