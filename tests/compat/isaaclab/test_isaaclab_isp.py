"""Image processing of Isaac Lab's cameras, beside that of its own package."""

from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

HOW = "pip install isaaclab lazy_loader"
ppisp = pytest.importorskip("isaaclab_ppisp", reason=HOW, exc_type=ImportError)
pytest.importorskip("isaaclab.renderers", reason=HOW, exc_type=ImportError)

from tests.compat.isaaclab import test_isaaclab as lab  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Isaac Lab's and Newton's own
simulation = lab.simulation
INPUTS = {
    "responsivity": 1.2,
    "exposureOffset": -0.5,
    "vignettingAlpha1G": -0.8,
    "vignettingCenterB": (0.1, 0.2),
    "vignettingAlpha2B": -1.0,
    "colorLatentRed": (1.0, -0.5),
    "colorLatentNeutral": (-2.0, 1.5),
    "crfToeB": 0.7,
    "crfShoulderR": -0.4,
    "crfCenterR": 0.6,
}


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Isaac Lab's own processing, its kernel in a module without those of its network, which are for CUDA alone."""
    from isaaclab_ppisp import kernels

    alone = wp.Kernel(kernels._apply_ppisp_kernel.func, key="ppisp", module=wp.get_module("ppisp_alone"))
    monkeypatch.setattr(kernels, "_apply_ppisp_kernel", alone)

    def processed(hdr: np.ndarray, inputs: dict[str, Any]) -> np.ndarray:
        light = wp.array(hdr, dtype=wp.float32, device="cpu")
        rgba = wp.zeros((*hdr.shape[:3], 4), dtype=wp.uint8, device="cpu")
        ppisp.PpispPipeline(ppisp.PpispCfg(inputs=inputs)).apply(light, rgba)
        return rgba.numpy()

    return processed


@pytest.mark.parametrize("inputs", [{}, INPUTS], ids=["defaults", "some"])
def test_images_are_those_of_its_own_package(simulation: Any, process: Any, inputs: dict[str, Any]) -> None:
    images = lab.frame(simulation, ["rgba", "rgb_hdr", "depth"], isp_cfg=ppisp.PpispCfg(inputs=inputs))[0]
    plain = lab.frame(simulation, ["rgba", "rgb_hdr", "depth"])[0]
    assert (images["rgb_hdr"] == plain["rgb_hdr"]).all() and (images["depth"] == plain["depth"]).all()
    expected = process(images["rgb_hdr"], inputs)
    assert np.abs(images["rgba"].astype(int) - expected).max() <= 1  # which cuts fractions off
    assert np.abs(images["rgba"].astype(int) - plain["rgba"]).max() > 20


def test_light_is_processed_without_being_asked_for(simulation: Any) -> None:
    cfg = ppisp.PpispCfg(inputs=INPUTS)
    alone, beside = (lab.frame(simulation, ["rgb", "rgba", *more], isp_cfg=cfg)[0] for more in ([], ["rgb_hdr"]))
    assert (alone["rgba"] == beside["rgba"]).all() and (alone["rgb"] == alone["rgba"][..., :3]).all()


def test_cameras_of_the_stage_have_inputs() -> None:
    usd, geometry = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdGeom")
    from isaaclab.sensors.camera.camera_isp import CameraISPMode
    from pxr import Sdf

    from warpcam.compat.isaaclab import isp

    stage = usd.Stage.CreateInMemory()
    for path in ("/plain", "/eye"):
        geometry.Camera.Define(stage, path)
    stage.GetPrimAtPath("/eye").CreateAttribute("ppisp:exposureOffset", Sdf.ValueTypeNames.Float).Set(1.5)
    for mode, path, offset in (
        (CameraISPMode.AUTO_CAMERA, "/eye", 1.5),
        (CameraISPMode.AUTO_CAMERA, "/plain", None),
        (CameraISPMode.AUTO_ANY, "/plain", 1.5),
        (ppisp.PpispCfg(camera_prim_path="/eye"), "/plain", 1.5),
    ):
        effect = isp.effect_of(isp.resolve(mode, stage, path))
        assert (None if effect is None else effect.exposure_offset) == offset


@pytest.mark.parametrize(
    ("cfg", "kinds", "message"),
    [
        (ppisp.PpispCfg(inputs={"crfToe": 1.0}), ["rgba"], "CameraCfg.isp_cfg: Unknown PPISP input: crfToe"),
        ("film", ["rgba"], "CameraCfg.isp_cfg: Unsupported PPISP configuration type"),
        (ppisp.PpispCfg(), ["depth"], "isp_cfg: processed images are rgb and rgba; ask for one in data_types"),
        (ppisp.PpispCfg(controller_weights=(0.0,)), ["rgba"], "isp_cfg.controller_weights are not offered"),
    ],
)
def test_other_settings_are_refused(simulation: Any, cfg: Any, kinds: list[str], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        lab.frame(simulation, kinds, isp_cfg=cfg)
