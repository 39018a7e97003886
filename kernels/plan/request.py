"""Request for the images of one camera."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from warpcam.kernels.outputs import lit_outputs

# Parts of a pixel, across and down, that are drawn as pixels of a finer image, by the camera's number of samples; each
# part has EDGE_SAMPLES where an edge runs through it.
SUPERSAMPLING: Mapping[int, tuple[int, int]] = {8: (2, 1), 16: (2, 2), 64: (4, 4)}
EDGE_SAMPLES = 4
BUFFER = "buffer "  # names of buffers begin with this, those of images do not
# Likewise where reflections are traced: all samples are parts, as edges run through what mirrors show, too.
REFLECTED_PARTS: Mapping[int, tuple[int, int]] = {4: (2, 2), 8: (4, 2), 16: (4, 4), 64: (8, 8)}


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
        tone_mapping: One of ``shading.TONE_CURVES``.
        paths: Lit images are traced by paths of light; neither shadows nor antialiasing count then.
        metered: The exposure is set by the light of the whole image.
        bloom: Light is scattered over the image.
        reflections: Rays find what smooth surfaces mirror, and what is seen through clear ones.
        ambient_occlusion: Shapes hide light from all around.
        indirect_light: Rays find light that comes from shapes, and what of that from all around they hide.
        soft_shadows: Shadows are those of lights as large as they are.
    """

    width: int
    height: int
    lens: str
    outputs: tuple[str, ...]
    shadows: bool = False
    antialiasing: int = 1
    tone_mapping: str = "clip"
    paths: bool = False
    metered: bool = False
    bloom: bool = False
    reflections: bool = False
    ambient_occlusion: bool = False
    indirect_light: bool = False
    soft_shadows: bool = False

    @property
    def smooth(self) -> tuple[str, ...]:
        """Outputs whose edges are smoothed."""
        return lit_outputs(self.outputs) if self.antialiasing > 1 and not self.paths else ()

    @property
    def parts(self) -> tuple[int, int]:
        """Parts of a pixel, across and down, in images that are drawn finer; (1, 1) where none is."""
        table = REFLECTED_PARTS if self.reflections else SUPERSAMPLING
        return table.get(self.antialiasing, (1, 1)) if self.smooth else (1, 1)

    @property
    def fine(self) -> "ImageRequest":
        """Lit images whose pixels are the parts of the request's."""
        across, down = self.parts
        width, height = across * self.width, down * self.height
        samples = 1 if self.reflections else EDGE_SAMPLES
        return replace(self, width=width, height=height, outputs=self.smooth, antialiasing=samples)

    @property
    def sharp(self) -> "ImageRequest":
        """All other outputs, which are those of the pixels' centres."""
        rest = tuple(name for name in self.outputs if name not in self.smooth)
        return replace(self, outputs=rest, antialiasing=1)

    @property
    def needs_film(self) -> bool:
        """Whether what lit images show depends on the light of a whole image."""
        return (self.metered or self.bloom) and bool(lit_outputs(self.outputs))

    @property
    def undeveloped(self) -> "ImageRequest":
        """What is drawn for it: light, and the alpha of ``rgba``, beside the outputs that no light changes."""
        if not self.needs_film:
            return self
        alpha = ("rgba",) if "rgba" in self.outputs else ()
        return replace(self, outputs=(*self.unlit.outputs, *alpha, "hdr"), metered=False, bloom=False)

    @property
    def unlit(self) -> "ImageRequest":
        """The outputs that no light changes."""
        lit = lit_outputs(self.outputs)
        return replace(self, outputs=tuple(name for name in self.outputs if name not in lit), paths=False)
