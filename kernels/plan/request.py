"""Request for the images of one camera."""

from dataclasses import dataclass

from warpcam.kernels.outputs import lit_outputs


@dataclass(frozen=True)
class ImageRequest:
    """Images that one camera is asked for.

    Attributes:
        width: Of the images [pixels].
        height: Of the images [pixels].
        lens: One of ``launches.LENSES``.
        outputs: Names, of ``OUTPUTS``.
        shadows: Lights cast shadows.
        antialiasing: Samples of a pixel.
    """

    width: int
    height: int
    lens: str
    outputs: tuple[str, ...]
    shadows: bool = False
    antialiasing: int = 1

    @property
    def smooth(self) -> tuple[str, ...]:
        """Outputs whose edges are smoothed."""
        return lit_outputs(self.outputs) if self.antialiasing > 1 else ()
