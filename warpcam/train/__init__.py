"""Training from pixels: image operations, adapters for learning libraries, videos, and tasks to begin with.

Names are imported when they are asked for first: each adapter needs its own library alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from warpcam.train.cartpole import CartPole, SwingUp
    from warpcam.train.images import Crop, Grey, ImageOperation, ImageTransform, Normalize, Resize
    from warpcam.train.mujoco_task import MujocoTask
    from warpcam.train.pick import Pick
    from warpcam.train.pixel_env import PixelEnv, Step
    from warpcam.train.quadruped import Quadruped
    from warpcam.train.reach import Reach
    from warpcam.train.recorder import Recorder
    from warpcam.train.rsl_rl import RslRlVecEnv
    from warpcam.train.skrl import SkrlEnv
    from warpcam.train.stable_baselines3 import StableBaselines3VecEnv
    from warpcam.train.torchrl import TorchRLEnv

_MODULES = {
    "CartPole": "cartpole",
    "Crop": "images",
    "Grey": "images",
    "ImageOperation": "images",
    "ImageTransform": "images",
    "MujocoTask": "mujoco_task",
    "Normalize": "images",
    "Pick": "pick",
    "PixelEnv": "pixel_env",
    "Quadruped": "quadruped",
    "Reach": "reach",
    "Recorder": "recorder",
    "Resize": "images",
    "RslRlVecEnv": "rsl_rl",
    "SkrlEnv": "skrl",
    "StableBaselines3VecEnv": "stable_baselines3",
    "Step": "pixel_env",
    "SwingUp": "cartpole",
    "TorchRLEnv": "torchrl",
}
__all__ = [
    "CartPole",
    "Crop",
    "Grey",
    "ImageOperation",
    "ImageTransform",
    "MujocoTask",
    "Normalize",
    "Pick",
    "PixelEnv",
    "Quadruped",
    "Reach",
    "Recorder",
    "Resize",
    "RslRlVecEnv",
    "SkrlEnv",
    "StableBaselines3VecEnv",
    "Step",
    "SwingUp",
    "TorchRLEnv",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'warpcam.train' has no attribute {name!r}")
    return getattr(import_module(f"warpcam.train.{_MODULES[name]}"), name)
