"""Normals of smooth meshes, as our renderer behind Isaac Lab's interface has them; Isaac Lab itself is a stand-in."""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
if not hasattr(pytest.importorskip("newton.sensors"), "SensorCamera"):
    pytest.skip("needs Newton 1.8", allow_module_level=True)
import newton_scenes  # noqa: E402, newton may be missing
from newton.sensors import SensorTiledCamera as TheirCamera  # noqa: E402, what Isaac Lab's Newton renderer draws with

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SIZE = (64, 48)
EYE, TARGET = (0.4, -2.5, 2.6), (0.0, 0.0, 0.6)


@pytest.fixture
def renderer_module(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Import the module with Isaac Lab."""
    for name in [name for name in sys.modules if name.startswith(("isaaclab", "warpcam.compat.isaaclab"))]:
        monkeypatch.delitem(sys.modules, name)
    parts: dict[str, dict[str, Any]] = {
        "isaaclab": {},
        "isaaclab.renderers": {"BaseRenderer": object, "RenderBufferKind": object, "RenderBufferSpec": object},
        "isaaclab.renderers.renderer_cfg": {"RendererCfg": object},
        "isaaclab.renderers.segmentation_colors": dict.fromkeys(
            ("BACKGROUND_ID", "UNLABELLED_ID", "pack_rgba", "random_color_from_id")
        ),
        "isaaclab.scene_data": {"REQUIRES_STAGE_AND_MODEL": {}},
        "isaaclab.utils": {"configclass": lambda kind: kind},
    }
    for name, contents in parts.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    from warpcam.compat.isaaclab import renderer

    yield renderer
    for name in [name for name in sys.modules if name.startswith("warpcam.compat.isaaclab")]:
        del sys.modules[name]


def test_they_are_those_of_newtons_renderer(
    device: wp.Device, renderer_module: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    builder = newton.ModelBuilder()
    mesh = newton.Mesh.create_sphere(0.6, num_latitudes=7, num_longitudes=9, compute_inertia=False)
    turn = (0.3, 0.2, 0.1, 1.0)
    builder.add_shape_mesh(-1, mesh=mesh, scale=(0.8, 1.0, 1.9), xform=newton_scenes.pose(-0.5, 0.0, 0.6, turn))
    builder.add_shape_box(-1, hx=0.3, hy=0.3, hz=0.3, xform=newton_scenes.pose(0.6, 0.0, 0.5, turn))
    model, state = newton_scenes.finalize(builder, device)
    simulation = SimpleNamespace(
        get_or_create_backend=lambda cfg: SimpleNamespace(model=model, state_0=state),
        get_scene_data_provider=lambda: SimpleNamespace(create_mapping=lambda labels: labels),
    )
    monkeypatch.setattr(renderer_module, "simulation", lambda: simulation)
    monkeypatch.setattr(renderer_module, "_backend_cfg", lambda sim: None)
    renderer = renderer_module.WarpcamRenderer(renderer_module.WarpcamRendererCfg())
    renderer.initialize()
    camera = wc.Camera(
        "eye",
        width=SIZE[0],
        height=SIZE[1],
        outputs=["normals", "segmentation"],
        lens=wc.Pinhole(fovy=float(np.degrees(0.9))),
        position=EYE,
        rotation=scenes.looking(EYE, TARGET),
    )
    seen = {
        name: image[0].cpu().numpy() for name, image in wc.Renderer(renderer.scene, [camera]).render()["eye"].items()
    }

    w, x, y, z = (float(part) for part in scenes.looking(EYE, TARGET))
    sensor = TheirCamera(model)
    views = wp.array([[wp.transform(EYE, wp.quat(x, y, z, w))]], dtype=wp.transformf, ndim=2, device=device)
    rays = sensor.utils.compute_camera_rays_pinhole(*SIZE, camera_fovs=[0.9])
    normals = sensor.utils.create_normal_image_output(*SIZE, camera_count=1)
    shapes = sensor.utils.create_shape_index_image_output(*SIZE, camera_count=1)
    model.bvh_refit_shapes(state)
    sensor.update(state, views, rays, normal_image=normals, shape_index_image=shapes)
    ids = shapes.numpy()[0, 0]
    same = (ids == seen["segmentation"][..., 0].astype(np.uint32)) & (ids != 0xFFFFFFFF)
    assert same.sum() > 300 and {0, 1} <= set(np.unique(ids[same]))
    close = np.abs(seen["normals"] - normals.numpy()[0, 0])[same].max(axis=-1) < 5e-3
    assert close.mean() > 0.99
