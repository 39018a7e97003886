"""Models of rsl_rl that see images: bytes as they are stored, half precision, channels last."""

from typing import Any

import torch
from rsl_rl.models import CNNModel
from rsl_rl.modules import CNN
from rsl_rl.modules.distribution import GaussianDistribution

WHITE = 255.0  # what a byte of a colour is divided by


class Encoder(CNN):  # type: ignore[misc]
    """Convolutions of one group of images, which may be colours of 8 bits: these become numbers from 0 to 1.

    Args:
        half: Compute in bfloat16; weights and result are float32.
        channels_last: Have the channel be the fastest index in memory, as tensor cores take it.
        spatial_softmax: Give for each channel of the last convolution the mean place in the image, x and y from -1 to
            1, weighted by the softmax of the channel (Finn et al. 2016, Deep Spatial Autoencoders), not all numbers.
        convolutions: As ``rsl_rl.modules.CNN`` has them.
    """

    def __init__(
        self, *, half: bool = False, channels_last: bool = False, spatial_softmax: bool = False, **convolutions: Any
    ):
        super().__init__(**convolutions, flatten=not spatial_softmax)
        places = None
        if spatial_softmax:
            height, width = self.output_dim
            y, x = torch.meshgrid(torch.linspace(-1.0, 1.0, height), torch.linspace(-1.0, 1.0, width), indexing="ij")
            places = torch.stack((x.flatten(), y.flatten()), dim=1)
            self._output_dim, self._output_channels = 2 * self.output_channels, None
        self.register_buffer("_places", places, persistent=False)
        self._half, self._layout = half, torch.channels_last if channels_last else torch.contiguous_format
        self.to(memory_format=self._layout)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """Encode images, (image, channel, height, width) uint8 or float32, as (image, number) float32."""
        colors = images.dtype is torch.uint8
        dtype = torch.bfloat16 if self._half else torch.float32
        images = images.to(dtype=dtype, memory_format=self._layout)
        if colors:
            images = images * (1.0 / WHITE)
        # The cache of weights in half precision would outlive a CUDA graph that is recorded.
        with torch.autocast(images.device.type, torch.bfloat16, enabled=self._half, cache_enabled=False):
            encoded = super().forward(images)
        if self._places is None:
            return encoded.float()
        shares = torch.softmax(encoded.float().flatten(2), dim=2)
        return (shares @ self._places).flatten(1)


class ImageModel(CNNModel):  # type: ignore[misc]
    """``CNNModel`` of rsl_rl with an ``Encoder`` for each group of images.

    Args:
        observations: As those that it will see.
        groups: Names of groups by set.
        which: The set, "actor" or "critic".
        outputs: Count of numbers that it gives.
        cnn_cfg: Convolutions of each group: settings of ``rsl_rl.modules.CNN``.
        half: As ``Encoder`` has it.
        channels_last: As ``Encoder`` has it.
        options: Others of ``CNNModel``.
    """

    def __init__(
        self,
        observations: Any,
        groups: dict[str, list[str]],
        which: str,
        outputs: int,
        *,
        cnn_cfg: dict[str, Any],
        half: bool = False,
        channels_last: bool = False,
        **options: Any,
    ):
        encoders = {
            group: Encoder(
                half=half,
                channels_last=channels_last,
                input_dim=tuple(observations[group].shape[2:4]),
                input_channels=observations[group].shape[1],
                **cnn_cfg,
            )
            for group in groups[which]
            if observations[group].ndim == 4
        }
        super().__init__(observations, groups, which, outputs, cnns=torch.nn.ModuleDict(encoders), **options)


class Gaussian(GaussianDistribution):  # type: ignore[misc]
    """``GaussianDistribution`` of rsl_rl that draws without waiting for the device, so that a CUDA graph can."""

    def sample(self) -> torch.Tensor:
        return self._distribution.rsample().detach()
