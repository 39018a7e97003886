"""Isaac Lab's renderer, by the interface it has for them: ``from warpcam.compat.isaaclab import WarpcamRendererCfg``.

Give it to a camera, ``CameraCfg(renderer_cfg=WarpcamRendererCfg())``, and warpcam draws its images: see
docs/compat/isaaclab.md. The renderer's name is "warpcam". ``RayCaster`` and ``RayCasterCamera`` cast rays by Isaac
Lab's configurations and do not need Isaac Lab.
"""

import importlib
from typing import TYPE_CHECKING, Any

from warpcam.compat.isaaclab.ray_caster import RayCaster, RayCasterData
from warpcam.compat.isaaclab.ray_caster_camera import RayCasterCamera, RayCasterCameraData

if TYPE_CHECKING:
    from warpcam.compat.isaaclab.renderer import WarpcamRenderer
    from warpcam.compat.isaaclab.renderer_cfg import WarpcamRendererCfg

__all__ = [
    "RayCaster",
    "RayCasterCamera",
    "RayCasterCameraData",
    "RayCasterData",
    "WarpcamRenderer",
    "WarpcamRendererCfg",
]

# What imports Isaac Lab; the renderer itself imports more of it than a configuration should.
OF_ISAAC_LAB = {"WarpcamRenderer": "renderer", "WarpcamRendererCfg": "renderer_cfg"}


def __getattr__(name: str) -> Any:
    if name in OF_ISAAC_LAB:
        return getattr(importlib.import_module(f"{__name__}.{OF_ISAAC_LAB[name]}"), name)
    raise AttributeError(name)
