"""Worlds in which a ball slides, as a batched env of images for training."""

import warp as wp
from gymnasium.vector import AutoresetMode
from slider_env import Sliders, renderer_of

from warpcam.train import Grey, ImageTransform, Normalize, PixelEnv


def sliders(device: wp.Device, worlds: int = 4, stack: int = 1, live: bool = True, keep_final: bool = True) -> PixelEnv:
    env = Sliders(worlds, AutoresetMode.DISABLED, device, tensors=not live)
    env.live = live
    transforms = {
        "top_rgb": ImageTransform((Grey(), Normalize()), stack=stack),
        "top_depth": ImageTransform((Normalize(3.0, 6.0),)),
    }
    eyes = renderer_of(env)
    return PixelEnv(env, eyes, transforms=transforms, state="state", forward=True, keep_final=keep_final)
