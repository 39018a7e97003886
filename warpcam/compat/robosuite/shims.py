"""Attributes of MuJoCo before 3.10 that robosuite 1.5.2 needs: the minimum of them."""

from typing import Any

import mujoco
import numpy as np

_mended: list[bool] = []


def mend() -> None:
    """Mend it, once; with a MuJoCo that robosuite knows nothing is done.

    Members of MuJoCo's enums equal NumPy's integers again, robosuite's data has the inertia matrix ``qM``, and
    ``mujoco.mj_fullM`` takes its arguments in the old order, too.
    """
    version = tuple(int(part) for part in mujoco.__version__.split(".")[:2])
    if _mended or version < (3, 10):
        return
    _mended.append(True)
    for name in dir(mujoco):
        if name.startswith("mjt") and isinstance(getattr(mujoco, name), type):
            _compare(getattr(mujoco, name))
    _full_inertia()


def _compare(enum: Any) -> None:
    equal, members = enum.__eq__, getattr(enum, "__members__", None)
    if members is None:
        return

    def __eq__(self: Any, other: Any) -> Any:  # noqa: N807 - it becomes the class's own
        return int(self) == int(other) if isinstance(other, np.integer) else equal(self, other)

    def __ne__(self: Any, other: Any) -> Any:  # noqa: N807 - likewise
        return not self == other

    def __hash__(self: Any) -> int:  # noqa: N807 - that of the integers it equals
        return hash(int(self))

    for method in (__eq__, __ne__, __hash__):
        setattr(enum, method.__name__, method)


def _full_inertia() -> None:
    from robosuite.utils import binding_utils

    new = mujoco.mj_fullM

    def full(model: Any, first: Any, second: Any) -> None:
        """(model, data, destination) as it is now, or (model, destination, qM) as it was."""
        if isinstance(first, np.ndarray):
            new(model, second.of, first)
        else:
            new(model, first, second)

    mujoco.mj_fullM = full
    binding_utils.MjData.qM = property(lambda data: _Inertia(data._data))


class _Inertia:
    """Stands for a simulation's inertia matrix until ``mj_fullM`` writes it out."""

    def __init__(self, of: Any):
        self.of = of
