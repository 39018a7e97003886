"""Isaac Lab's renderer, by the interface it has for them: ``from warpcam.compat.isaaclab import WarpcamRendererCfg``.

Give it to a camera, ``CameraCfg(renderer_cfg=WarpcamRendererCfg())``, and warpcam draws its images: see
docs/compat/isaaclab.md. The renderer's name is "warpcam".
"""

from typing import Any

from warpcam.compat.isaaclab.renderer_cfg import WarpcamRendererCfg

__all__ = ["WarpcamRenderer", "WarpcamRendererCfg"]


def __getattr__(name: str) -> Any:
    """The renderer itself imports more of Isaac Lab than a configuration should."""
    if name == "WarpcamRenderer":
        from warpcam.compat.isaaclab.renderer import WarpcamRenderer

        return WarpcamRenderer
    raise AttributeError(name)
