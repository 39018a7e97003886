"""Denoising of path-traced images by Intel Open Image Denoise, which need not be installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.color import srgb_to_linear
from warpcam.core.errors import WarpcamError
from warpcam.core.torch_interop import torch

FLOAT, BYTE = "torch.float32", "torch.uint8"


def denoise(
    hdr: torch.Tensor, *, albedo: torch.Tensor | None = None, normals: torch.Tensor | None = None
) -> torch.Tensor:
    """Return images of path-traced light with less noise: each world's by Open Image Denoise's filter "RT".

    The result is not unbiased: the filter guesses, and its errors do not fall as those of paths do. Images of what
    surfaces are keep their edges and textures sharp; a camera gives them as outputs of the same names.

    Works on the images' device, a CPU or a CUDA GPU, one world after the other, and waits for each. Differentiates
    nothing.

    Args:
        hdr: Linear light, (world, height, width, 3) float32.
        albedo: Base colours, of the same shape: uint8, display values as the output ``albedo`` has them, or float32,
            linear in [0, 1].
        normals: In the frame of the world, unit or 0, float32 of the same shape; only together with ``albedo``.

    Returns:
        (world, height, width, 3) float32, a new tensor on the same device.

    Raises:
        WarpcamError: pyoidn is not installed, an argument is no such tensor, a CUDA graph is being captured, or Open
            Image Denoise cannot work on the device.
    """
    _check("hdr", hdr, hdr, (FLOAT,))
    if albedo is not None:
        _check("albedo", albedo, hdr, (BYTE, FLOAT))
    if normals is not None:
        _check("normals", normals, hdr, (FLOAT,))
        if albedo is None:
            raise WarpcamError("denoise: normals came without albedo; give both, albedo alone, or neither")
    library = open_image_denoise()
    if hdr.is_cuda:
        torch_interop.require_no_capture(wp.device_from_torch(hdr.device), "denoise")
    if albedo is not None and str(albedo.dtype) == BYTE:
        albedo = hdr.new_tensor(srgb_to_linear(np.arange(256) / 255.0))[albedo.long()]
    result = hdr.new_empty(hdr.shape)
    for world in range(len(hdr)):
        surfaces = (None if image is None else image[world] for image in (albedo, normals))
        try:
            result[world] = library.denoise(hdr[world], *surfaces, hdr=True)
        except RuntimeError as error:
            raise WarpcamError(f"denoise: Open Image Denoise fails on {hdr.device}: {error}") from error
    return result


def open_image_denoise() -> Any:
    """Import the library, only now: it need not be installed otherwise."""
    try:
        return import_module("pyoidn")
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and denoise needs it: pip install 'warpcam[denoise]'"
        ) from error
    except OSError as error:
        raise WarpcamError(f"denoise: Open Image Denoise cannot be loaded: {error}") from error


def _check(name: str, image: Any, hdr: Any, dtypes: tuple[str, ...]) -> None:
    """Refuse what is no image, or not like ``hdr``."""
    allowed = f"a torch tensor, (world, height, width, 3) {' or '.join(dtypes)}, on a CPU or a CUDA GPU"
    if not torch_interop.is_tensor(image):
        raise WarpcamError(f"denoise: {name} must be {allowed}; got {type(image).__name__}")
    is_image = image.ndim == 4 and image.shape[-1] == 3 and min(image.shape) > 0
    if not is_image or str(image.dtype) not in dtypes or image.device.type not in ("cpu", "cuda"):
        raise WarpcamError(f"denoise: {name} must be {allowed}; got {_told(image)}")
    if image.shape != hdr.shape or image.device != hdr.device:
        raise WarpcamError(f"denoise: {name} must have the shape and device of hdr, {_told(hdr)}; got {_told(image)}")


def _told(image: torch.Tensor) -> str:
    return f"{tuple(image.shape)} {image.dtype} on {image.device}"
