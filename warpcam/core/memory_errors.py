"""The error of a device that has no memory left."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from warpcam.core import torch_interop
from warpcam.core.errors import OutOfMemoryError

_FAILED = re.compile(r"Failed to allocate (?P<bytes>\d+) bytes (?:on|with \w+ on) device '(?P<device>[^']+)'")  # Warp's
ADVICE = "ask for fewer worlds, pixels or outputs (warpcam.estimate_memory tells what a renderer takes), or free some"


@contextmanager
def memory_told(call: str) -> Iterator[None]:
    """Raise ``OutOfMemoryError`` where Warp, torch or Python has found no memory.

    Args:
        call: Begins the error's text.
    """
    try:
        yield
    except (RuntimeError, MemoryError) as error:
        if isinstance(error, MemoryError) or torch_interop.is_out_of_memory(error):
            raise OutOfMemoryError(f"{call}: out of memory ({error}); {ADVICE}") from error
        failed = _FAILED.search(str(error))
        if failed is None:
            raise
        asked = f"{int(failed['bytes']):,} more bytes were asked for"
        raise OutOfMemoryError(f"{call}: out of memory on {failed['device']}, where {asked}; {ADVICE}") from error
