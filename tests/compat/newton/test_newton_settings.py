"""Settings and helpers of Newton's camera sensors, as the page about them says."""

from typing import Any

import numpy as np
import pytest
import warp as wp

newton = pytest.importorskip("newton")
import newton_scenes  # noqa: E402, newton may be missing
from newton.sensors import SensorCamera as TheirCamera  # noqa: E402
from newton.sensors import SensorTiledCamera as TheirTiled  # noqa: E402

from warpcam.compat.newton import SensorCamera, SensorTiledCamera  # noqa: E402 - needs newton

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SIZE = (24, 16)


class Seen:
    """A ball on the ground, seen from above by one sensor."""

    def __init__(self, device: wp.Device, builder: Any = None):
        builder = builder or newton.ModelBuilder()
        builder.add_shape_plane(width=4.0, length=4.0)
        builder.add_shape_sphere(-1, radius=0.4, xform=newton_scenes.pose(0.0, 0.0, 0.4))
        self.model, self.state = newton_scenes.finalize(builder, device)
        self.sensor = SensorCamera(self.model)
        self.sensor.create_default_light()
        self.rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device=device)
        self.views = wp.array([newton_scenes.pose(0.0, 0.0, 4.0)], dtype=wp.transformf, device=device)
        self.color, self.depth = (
            getattr(self.sensor, f"allocate_image_{kind}")(1, *SIZE) for kind in ("color", "depth")
        )

    def frame(self, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
        config = SensorCamera.RenderConfig(**settings)
        self.sensor.update(
            self.state, self.views, self.rays, color_image=self.color, depth_image=self.depth, render_config=config
        )
        return self.color.numpy().copy(), self.depth.numpy().copy()


def test_they_are_newtons_classes(device: wp.Device) -> None:
    seen = Seen(device)
    assert issubclass(SensorCamera, TheirCamera) and issubclass(SensorTiledCamera, TheirTiled)
    assert isinstance(seen.sensor, TheirCamera) and seen.sensor.device == seen.model.device
    for name in ("RenderConfig", "ClearData", "RenderOrder", "AntiAliasing", "WorldRenderFlag"):
        assert getattr(SensorCamera, name) is getattr(TheirCamera, name)


def test_settings_without_an_effect(device: wp.Device) -> None:
    seen = Seen(device)
    color, depth = seen.frame()
    for settings in (
        {"enable_fast_math": False},
        {"render_order": SensorCamera.RenderOrder.TILED, "tile_width": 4, "tile_height": 4},
        {"block_dim": 128},
    ):
        changed = seen.frame(**settings)
        assert (changed[0] == color).all() and (changed[1] == depth).all(), settings


def test_rays_of_a_kernel_of_ones_own_are_read_when_they_were_forgotten(device: wp.Device) -> None:
    seen = Seen(device)
    wider = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=1.6, device=device)
    before, _ = seen.frame()
    wp.copy(seen.rays, wider)  # as a kernel writes them
    assert (seen.frame()[0] == before).all()
    seen.sensor.forget_rays(seen.rays)
    assert (seen.frame()[0] != before).any()


def test_the_scenes_lights_are_the_sensors(device: wp.Device) -> None:
    """The first, which its settings change, and the part of it that shadows leave."""
    seen = Seen(device)
    seen.frame(enable_shadows=True)
    directions = seen.sensor.scene.array("light_directions").numpy()
    assert directions.shape[1] == 2 and (directions[:, 0] == directions[:, 1]).all()
    seen.sensor.create_default_light(direction=(0.6, 0.0, -0.8))
    seen.frame(enable_shadows=True)
    np.testing.assert_allclose(seen.sensor.scene.array("light_directions").numpy()[0, 0], (0.6, 0.0, -0.8), atol=1e-6)


def test_particles_that_are_not_active_are_not_drawn(device: wp.Device) -> None:
    """Newton's own sensor draws them."""
    builder = newton.ModelBuilder()
    for place, flags in enumerate((int(newton.ParticleFlags.ACTIVE), 0)):
        builder.add_particle(pos=(place - 0.5, 0.0, 1.5), vel=(0, 0, 0), mass=1.0, radius=0.2, flags=flags)
    seen = Seen(device, builder)
    _, depth = seen.frame(enable_particles=True)
    near = (depth[0] > 0.0) & (depth[0] < 3.0)
    assert near[:, : SIZE[0] // 2].any() and not near[:, SIZE[0] // 2 :].any()
