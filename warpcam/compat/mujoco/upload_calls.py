"""MuJoCo's calls that upload what a renderer reads once, for those that have no context of MuJoCo's."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import mujoco

UPLOADS = ("mjr_uploadHField", "mjr_uploadMesh", "mjr_uploadTexture")

_own: dict[str, Callable[..., None]] = {}  # MuJoCo's own calls, while they are replaced
_served: set[str] = set()  # names of the front ends that need it


class Context:
    """Context in place of MuJoCo's and OpenGL's, for programs that upload to one and make the other current."""

    def __init__(self, reload: Callable[[], None]):
        self.reload = reload

    def make_current(self) -> None: ...

    @contextmanager
    def as_current(self) -> Iterator[None]:
        yield

    def free(self) -> None: ...

    def __del__(self) -> None:  # programs call it
        self.free()


def serve(front: str) -> None:
    """Have MuJoCo's calls take a ``Context``, too, as long as that front end is installed."""
    if not _served:
        _own.update((name, getattr(mujoco, name)) for name in UPLOADS)
        for name, own in _own.items():
            setattr(mujoco, name, _upload(own))
    _served.add(front)


def leave(front: str) -> None:
    """Give MuJoCo its own calls back, unless another front end is installed."""
    _served.discard(front)
    if not _served:
        for name, own in _own.items():
            setattr(mujoco, name, own)
        _own.clear()


def _upload(own: Callable[..., None]) -> Callable[..., None]:
    @wraps(own)
    def upload(m: mujoco.MjModel, con: Any, *rest: Any, **named: Any) -> None:
        if isinstance(con, Context):
            con.reload()
        else:
            own(m, con, *rest, **named)

    return upload
