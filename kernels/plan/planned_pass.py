"""A pass of one camera, as it is planned."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from warpcam.kernels.runtime.launch import MeshReads

Key = TypeVar("Key")

Arrays = tuple[tuple[str, str], ...]  # what a pass calls an array, and the name of the image or buffer


@dataclass(frozen=True)
class PlannedPass(Generic[Key]):
    """A pass of one camera.

    Attributes:
        name: Of the pass, in the registry.
        key: What its kernel is compiled for; None for kernels without variants.
        threads: Of its launch, for each world.
        arrays: Images and buffers that it reads and writes.
        reads: Of meshes that move.
    """

    name: str
    key: Key
    threads: int
    arrays: Arrays = ()
    reads: MeshReads = MeshReads.TREES

    def name_of(self, role: str) -> str | None:
        """The image or buffer that the pass knows by that name, or None if it has none."""
        return dict(self.arrays).get(role)


Passes = tuple[PlannedPass[Any], ...]
