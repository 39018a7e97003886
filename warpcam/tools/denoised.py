"""Denoised images of ``warpcam render --denoise``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from warpcam.core.color import linear_to_srgb
from warpcam.core.errors import WarpcamError
from warpcam.core.torch_interop import torch
from warpcam.render.denoise import denoise, open_image_denoise

LIT = ("rgb", "rgba", "hdr")
NEEDED = ("hdr", "albedo", "normals")  # outputs that denoising reads


def check(look: str | None, outputs: Sequence[str], tone_mapping: str) -> None:
    """Refuse what cannot be denoised, before all work."""
    if look != "path":
        raise WarpcamError("--denoise: it is of --look path alone")
    if tone_mapping != "clip":
        raise WarpcamError(f"--denoise: --tone-mapping {tone_mapping} came, denoised light is shown by 'clip' alone")
    if not set(outputs) & set(LIT):
        raise WarpcamError(f"--denoise: --outputs must have one of {', '.join(LIT)}, got {','.join(outputs)}")
    open_image_denoise()


def denoised(images: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Images of one camera, with those of light denoised; alpha stays as it is."""
    light = denoise(images["hdr"], albedo=images["albedo"], normals=images["normals"])
    shown = torch.from_numpy(np.rint(255.0 * linear_to_srgb(light.cpu().numpy())).astype(np.uint8))
    changed = {**images, "hdr": light, "rgb": shown}
    if "rgba" in images:
        changed["rgba"] = torch.cat((shown, images["rgba"][..., 3:].cpu()), dim=-1)
    return changed
