"""Image signal processing of Isaac Lab's cameras: ``CameraCfg.isp_cfg``."""

from typing import Any

from warpcam import sensors
from warpcam.core.errors import WarpcamError


def resolve(isp_cfg: Any, stage: Any, camera_path: str | None) -> Any:
    """Return the settings with all inputs, those on the stage's cameras among them; None is no processing.

    Args:
        isp_cfg: None, a PpispCfg of isaaclab_ppisp or a CameraISPMode of Isaac Lab.
        stage: The stage.
        camera_path: Path of the first camera.

    Raises:
        WarpcamError: It is something else, or has inputs that PPISP does not.
    """
    if isp_cfg is None:
        return None
    from isaaclab_ppisp import resolve_and_normalize  # part of Isaac Lab's wheel

    try:
        return resolve_and_normalize(isp_cfg, stage, camera_path)
    except (TypeError, ValueError) as error:
        raise WarpcamError(f"CameraCfg.isp_cfg: {error}") from error


def effect_of(isp_cfg: Any) -> sensors.Ppisp | None:
    """Return the effect with resolved settings.

    Raises:
        WarpcamError: They have weights of a network that chooses exposure and colours.
    """
    if isp_cfg is None:
        return None
    if isp_cfg.controller_weights is not None:
        raise WarpcamError(
            "CameraCfg.isp_cfg.controller_weights are not offered: exposure and colours are those of its inputs; "
            "allowed is None"
        )
    return sensors.Ppisp.from_inputs(isp_cfg.inputs)
