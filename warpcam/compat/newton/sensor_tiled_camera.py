"""``newton.sensors.SensorTiledCamera``, traced by warpcam."""

import warnings
import weakref
from functools import wraps
from types import SimpleNamespace
from typing import Any

import newton
import warp as wp
from newton.sensors import SensorTiledCamera as NewtonsCamera

from warpcam.compat.newton.render_config import DOWN
from warpcam.compat.newton.renderers import RendererCache
from warpcam.compat.newton.sensor_camera import check_array, check_images, own_worlds
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

_UNSET: Any = object()
DEPRECATED: type[Warning] = getattr(newton, "NewtonDeprecationWarning", DeprecationWarning)  # older ones have none
RAYS_KEPT = 16  # arrays of rays whose slices are kept


class Utils(NewtonsCamera.Utils):
    """Newton's own helpers, but for the light and the textures."""

    def __init__(self, sensor: "SensorTiledCamera"):
        model = sensor.model
        context = SimpleNamespace(world_count=model.world_count, device=model.device, up_axis=model.up_axis)
        super().__init__(context, sensor.default_render_config)
        self._sensor = weakref.ref(sensor)

    def create_default_light(self, enable_shadows: bool = True, direction: Any = None) -> None:
        """The one light. There is none until this is called, which changes ``default_render_config`` as Newton does."""
        sensor = self._sensor()
        if sensor is not None:
            _set(sensor, "create_default_light", "enable_shadows", enable_shadows)
            sensor._views.looks.set_light(enable_shadows, DOWN if direction is None else direction, None)

    def assign_checkerboard_material(self, *, shape_indices: Any, resolution: int = 64, checker_size: int = 32) -> None:
        """Assign a checkerboard material; changes ``default_render_config`` as Newton does."""
        sensor = self._sensor()
        if sensor is not None:
            sensor._views.assign_checkerboard(shape_indices, resolution, checker_size)
            _set(sensor, "assign_checkerboard_material", "enable_textures", True)

    def assign_checkerboard_material_to_all_shapes(self, resolution: int = 64, checker_size: int = 32) -> None:
        """An older name for all shapes."""
        warnings.warn(
            "assign_checkerboard_material_to_all_shapes is deprecated; use assign_checkerboard_material",
            DEPRECATED,
            stacklevel=2,
        )
        sensor = self._sensor()
        if sensor is not None:
            shapes = range(sensor.model.shape_count)
            self.assign_checkerboard_material(shape_indices=shapes, resolution=resolution, checker_size=checker_size)


def _set(sensor: "SensorTiledCamera", method: str, field: str, value: bool) -> None:
    """Change a setting, and say so, as Newton does."""
    config = sensor.default_render_config
    if getattr(config, field) != value:
        warnings.warn(
            f"SensorTiledCamera.utils.{method}() changed SensorTiledCamera.default_render_config.{field}; set it to "
            f"{value!r} there",
            DEPRECATED,
            stacklevel=3,
        )
    setattr(config, field, value)


def _rays_helper(name: str) -> Any:
    """Newton's own, after which an array that is written again is read again."""
    helper = getattr(NewtonsCamera.Utils, name)

    @wraps(helper)
    def compute(self: Utils, *args: Any, **settings: Any) -> wp.array:
        rays, sensor = helper(self, *args, **settings), self._sensor()
        if sensor is not None:
            sensor.forget_rays(rays)
        return rays

    return compute


for _name in dir(NewtonsCamera.Utils):
    if _name.startswith("compute_") and "rays" in _name:
        setattr(Utils, _name, _rays_helper(_name))


class SensorTiledCamera(NewtonsCamera):
    """Newton's older camera sensor, several cameras in each world: see docs/compat/newton.md for what differs.

    Args:
        model: The ``newton.Model``.
        default_render_config: Settings, unless ``update`` is told otherwise.
        config: Its old name, which Newton is about to drop.
        load_textures: False leaves the model's own textures out whatever the settings say, and reads none of them.
        physical: Whether surfaces gleam as their roughness and metalness say. False: matt, as Newton's camera has it.
    """

    Utils: Any = Utils

    def __init__(
        self,
        model: newton.Model,
        *,
        default_render_config: Any = None,
        config: Any = _UNSET,
        load_textures: bool = True,
        physical: bool = False,
    ):
        warnings.warn(
            "SensorTiledCamera is deprecated as of Newton 1.7, which is about to drop it; use SensorCamera",
            DEPRECATED,
            stacklevel=2,
        )
        self.model = model
        if config is not _UNSET:
            warnings.warn(
                "SensorTiledCamera(config=...) is deprecated; use default_render_config",
                DEPRECATED,
                stacklevel=2,
            )
            if default_render_config is not None:
                raise TypeError("Specify only one of default_render_config and its old name, config.")
            default_render_config = config
        settings = NewtonsCamera.RenderConfig() if default_render_config is None else default_render_config
        self._config, self._clear = settings, NewtonsCamera.ClearData()
        self._views = RendererCache(model, physical, bool(load_textures), simulated=True, visual=False)
        self._mapped = own_worlds(model.world_count, model.world_count, model.device)
        self._slices: dict[int, tuple[wp.array, list[wp.array]]] = {}
        self._utils = Utils(self)

    @property
    def scene(self) -> Any:
        """The ``warpcam.Scene`` that it looks at."""
        return self._views.scene

    @property
    def default_render_config(self) -> Any:
        return self._config

    @property
    def render_config(self) -> Any:
        """Older name of ``default_render_config``."""
        warnings.warn(
            "SensorTiledCamera.render_config is deprecated as of Newton 1.4; use default_render_config",
            DEPRECATED,
            stacklevel=2,
        )
        return self._config

    @property
    def default_clear_data(self) -> Any:
        return self._clear

    @property
    def utils(self) -> Any:
        return self._utils

    def sync_transforms(self, state: newton.State) -> None:
        """Nothing to do: ``update`` follows the state."""

    def forget_rays(self, rays: wp.array) -> None:
        """Read ``rays`` anew at the next update: others have been written into the array."""
        self._slices.pop(id(rays), None)

    def update(
        self,
        state: newton.State,
        camera_transforms: wp.array | None = None,
        camera_rays: wp.array | None = None,
        *,
        clear_data: Any = None,
        render_config: Any = None,
        kernel_block_dim: int = 64,
        **images: wp.array | None,
    ) -> None:
        """Render all worlds and cameras; no tree of the model need be refitted before.

        Args:
            state: The state to look at.
            camera_transforms: transformf (camera, world), on the model's device.
            camera_rays: vec3f (camera, height, width, 2): see ``SensorCamera.update``.
            clear_data: In place of ``default_clear_data``.
            render_config: In place of ``default_render_config``.
            kernel_block_dim: Changes nothing.
            **images: What to write, as in ``SensorCamera.update``, each (world, camera, height, width).
        """
        device, num_worlds = self.model.device, self.model.world_count
        check_array("camera_transforms", camera_transforms, wp.transformf, device)
        check_array("camera_rays", camera_rays, wp.vec3, device)
        assert camera_transforms is not None and camera_rays is not None
        shape = tuple(camera_rays.shape)
        if len(shape) != 4 or shape[3] != 2 or min(shape) < 1:
            raise WarpcamError(f"camera_rays must have shape (camera, height, width, 2), got {shape}")
        if tuple(camera_transforms.shape) != (shape[0], num_worlds):
            raise WarpcamError(
                f"camera_transforms must have shape ({shape[0]}, {num_worlds}), got {tuple(camera_transforms.shape)}"
            )
        asked = check_images(images, (num_worlds, *shape[:3]), device)
        views = [
            (camera_transforms[camera], rays, {name: image[:, camera] for name, image in asked.items()})
            for camera, rays in enumerate(self._of_cameras(camera_rays))
        ]
        with torch_interop.in_order(device):
            self._views.render(
                state,
                self._mapped,
                views,
                self._clear if clear_data is None else clear_data,
                self._config if render_config is None else render_config,
            )

    def _of_cameras(self, camera_rays: wp.array) -> list[wp.array]:
        """Each camera's rays, (height, width, 1, 2), the same arrays every time."""
        known = self._slices.pop(id(camera_rays), None)
        if known is None or known[0] is not camera_rays:
            if len(self._slices) >= RAYS_KEPT:
                self._slices.pop(next(iter(self._slices)))
            _, height, width, _ = camera_rays.shape
            slices = [camera_rays[camera].reshape((height, width, 1, 2)) for camera in range(camera_rays.shape[0])]
            known = camera_rays, slices
        self._slices[id(camera_rays)] = known  # the last used at the end
        return known[1]
