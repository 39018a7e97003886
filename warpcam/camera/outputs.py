"""Check of the outputs that a camera is asked for."""

from collections.abc import Sequence
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.kernels.outputs import OUTPUTS


def check_outputs(names: Any, where: str) -> tuple[str, ...]:
    """The names in the order given, or the error that lists what there is."""
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise WarpcamError(f'{where}: outputs must be a sequence of names like ("rgb", "depth"), got {names!r}')
    if not names:
        raise WarpcamError(f"{where}: outputs is empty; allowed are {', '.join(OUTPUTS)}")
    for name in names:
        if not isinstance(name, str) or name not in OUTPUTS:
            raise WarpcamError(f"{where}: outputs has {name!r}; allowed are {', '.join(OUTPUTS)}")
    if len(set(names)) < len(names):
        raise WarpcamError(f"{where}: outputs names something twice: {list(names)!r}")
    return tuple(names)
