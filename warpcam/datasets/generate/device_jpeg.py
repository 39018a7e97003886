"""JPEG files of images where they lie: on a GPU by nvJPEG, through torchcodec."""

from importlib.util import find_spec

import torch

from warpcam.core.errors import WarpcamError


def is_installed() -> bool:
    """Whether torchcodec is there."""
    return find_spec("torchcodec") is not None


def require() -> None:
    """Raise a ``WarpcamError`` if torchcodec cannot be used."""
    try:
        from torchcodec.encoders import JpegEncoder  # noqa: F401
    except (ImportError, OSError, RuntimeError) as error:  # missing, older than 0.16, or of another torch
        reason = " ".join(str(error).split())[:200]
        raise WarpcamError(
            f"dataset: jpeg 'torchcodec' cannot be used ({reason}); pip install 'warpcam[jpeg]', or use 'pillow'"
        ) from None


def encode(colors: torch.Tensor, quality: int) -> list[bytes]:
    """Files of images (image, height, width, 3) uint8; waits for the device once."""
    from torchcodec.encoders import JpegEncoder

    planes = colors.permute(0, 3, 1, 2).contiguous()
    files = [JpegEncoder(image).to_tensor(quality=quality) for image in planes]
    ends = torch.tensor([len(file) for file in files]).cumsum(0).tolist()
    whole = torch.cat(files).cpu().numpy().tobytes()
    return [whole[start:end] for start, end in zip([0, *ends], ends, strict=False)]
