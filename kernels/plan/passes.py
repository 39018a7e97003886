"""Registry of the passes that draw one camera. Modules of ``kernels/passes`` register what they bind."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Pass:
    """A step of a frame for one camera.

    Attributes:
        name: Of the pass, in words.
        needs: Arrays of the trace that it reads: of "depth", "shape" and "face".
        writes: Outputs that it derives from these. The plan of a frame has the pass where one of them is asked for.
        bind: Binds the pass as it is planned, a ``PlannedPass``, to the arrays of a camera, a ``CameraFrame``; returns
            its ``Stage``.
    """

    name: str
    needs: frozenset[str]
    writes: tuple[str, ...]
    bind: Callable[[Any, Any], Any]


PASSES: dict[str, Pass] = {}


def register(name: str, *, needs: tuple[str, ...] = (), writes: tuple[str, ...] = ()) -> Callable[[Any], Any]:
    """Register the decorated function as the one that binds a pass."""

    def registered(bind: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        if name in PASSES:
            raise ValueError(f"register: a pass {name!r} is there already")
        taken = {output for other in PASSES.values() for output in other.writes} & set(writes)
        if taken:
            raise ValueError(f"register: outputs {sorted(taken)} of {name!r} are derived by another pass already")
        PASSES[name] = Pass(name, frozenset(needs), writes, bind)
        return bind

    return registered


def pass_of(output: str) -> Pass:
    """The pass that derives an output."""
    for one in PASSES.values():
        if output in one.writes:
            return one
    derived = sorted(name for one in PASSES.values() for name in one.writes)
    raise ValueError(f"pass_of: no pass derives {output!r}; derived are {', '.join(derived)}")
