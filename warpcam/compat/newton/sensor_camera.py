"""``newton.sensors.SensorCamera``, traced by warpcam."""

import weakref
from collections.abc import Callable
from functools import wraps
from types import SimpleNamespace
from typing import Any

import newton
import numpy as np
import warp as wp
from newton.sensors import SensorCamera as NewtonsCamera

from warpcam.compat.newton.lens_detection import RayBundles
from warpcam.compat.newton.renderers import IMAGES, Mapped, RendererCache
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

BOTH, SIMULATION_ONLY, VISUAL_ONLY = range(3)  # Newton's DeformableSurfaceMode, which older ones do not have
WORLDS_KEPT = 16  # arrays of world indices whose counts are kept


class SensorCamera(NewtonsCamera):
    """Newton's camera sensor by its own names, settings and arrays: see docs/compat/newton.md for what differs.

    Args:
        model: The ``newton.Model``.
        default_clear_data: What is written where nothing is hit, unless ``update`` is told otherwise.
        default_render_config: Settings, unless ``update`` is told otherwise.
        load_textures: False leaves the model's own textures out whatever the settings say, and reads none of them.
        deformable_surface_mode: Whether triangles of cloth and soft bodies are seen, deformable visual meshes, or both.
        physical: Whether surfaces gleam as their roughness and metalness say. False: matt, as Newton's camera has it.
        views_per_world: How many views of one world there may be; None counts them in each new array of
            ``world_indices``, which waits for the device.

    Attributes:
        scene: The ``warpcam.Scene`` that it looks at; a checkerboard of another kind makes it anew, and settings
            that say what of the model is drawn.
        left_out: How often a view was cleared since its world had too many: int32 (1,), a Warp array.
    """

    def __init__(
        self,
        model: newton.Model,
        *,
        default_clear_data: Any = None,
        default_render_config: Any = None,
        load_textures: bool = True,
        deformable_surface_mode: Any = None,
        physical: bool = False,
        views_per_world: int | None = None,
    ):
        mode = BOTH if deformable_surface_mode is None else deformable_surface_mode
        if mode not in (BOTH, SIMULATION_ONLY, VISUAL_ONLY):
            raise WarpcamError(
                f"Invalid deformable_surface_mode: {deformable_surface_mode!r}; allowed are BOTH (0), SIMULATION_ONLY "
                "(1) and VISUAL_ONLY (2)"
            )
        self.default_clear_data = NewtonsCamera.ClearData() if default_clear_data is None else default_clear_data
        self.default_render_config = (
            NewtonsCamera.RenderConfig() if default_render_config is None else default_render_config
        )
        self._model, self._views_per_world = model, views_per_world
        self._render_context = SimpleNamespace(model=model)  # what the methods that are Newton's own ask for
        self._views = RendererCache(model, physical, bool(load_textures), mode != VISUAL_ONLY, mode != SIMULATION_ONLY)
        self._mode = mode
        self._synced: Any = None  # a reference to the state that deformables were last taken of
        self._visuals: Any = None  # and what was given with it
        self._mapped: dict[Any, tuple[Any, Mapped]] = {}
        self.left_out = wp.zeros(1, dtype=wp.int32, device=model.device)

    @property
    def scene(self) -> Any:
        return self._views.scene

    def update(
        self,
        state: newton.State,
        camera_transforms: wp.array,
        camera_rays: wp.array,
        *,
        world_indices: wp.array | None = None,
        clear_data: Any = None,
        render_config: Any = None,
        sync_deformables: bool = True,
        deformable_visuals: Any = None,
        **images: wp.array | None,
    ) -> None:
        """Render; no tree of the model need be refitted before.

        Args:
            state: The state to look at, as it is now: deformables, too.
            camera_transforms: transformf (view,), on the model's device.
            camera_rays: vec3f (height, width, sample, 2), on the model's device: of a pinhole, or parallel. An array
                is read when it is seen first; ``forget_rays`` says that it holds others now.
            world_indices: int32 (view,): a world, or a WorldRenderFlag; None is the view's own number.
            clear_data: In place of ``default_clear_data``.
            render_config: In place of ``default_render_config``.
            sync_deformables: False is for a state that ``sync_deformable_meshes`` was given; it is followed anyway.
            deformable_visuals: ``newton.geometry.DeformableVisuals`` whose points visual meshes have, whatever state
                they were updated from; None makes the points from the state.
            **images: What to write: ``color_image``, ``depth_image``, ``forward_depth_image``, ``shape_index_image``,
                ``normal_image``, ``albedo_image``, ``hdr_color_image``, each (view, height, width).
        """
        if deformable_visuals is not None and not sync_deformables:
            raise WarpcamError("deformable_visuals requires sync_deformables=True")
        if sync_deformables:
            self.sync_deformable_meshes(state, deformable_visuals=deformable_visuals)
        elif self._synced is not None and self._synced() is not state:
            raise WarpcamError(
                "sync_deformables is False, and sync_deformable_meshes was given another state than update: that is "
                "not offered, all is seen of one state"
            )
        config = self.default_render_config if render_config is None else render_config
        clear = self.default_clear_data if clear_data is None else clear_data
        check_array("camera_transforms", camera_transforms, wp.transformf, self.device)
        if camera_transforms.ndim != 1 or camera_transforms.shape[0] < 1:
            raise WarpcamError(f"camera_transforms must have shape (view,), got {tuple(camera_transforms.shape)}")
        check_array("camera_rays", camera_rays, wp.vec3, self.device)
        shape = tuple(camera_rays.shape)
        if len(shape) != 4 or shape[3] != 2 or min(shape) < 1:
            raise WarpcamError(f"camera_rays must have shape (height, width, sample, 2), got {shape}")
        num_views = camera_transforms.shape[0]
        asked = check_images(images, (num_views, *shape[:2]), self.device)
        mapped = self._map(world_indices, num_views)
        with torch_interop.in_order(self.device):
            if world_indices is not None:
                mapped.choose(world_indices)
            views = [(camera_transforms, camera_rays, asked)] * mapped.num_cameras
            self._views.render(state, mapped, views, clear, config, self._visuals)

    def forget_rays(self, rays: wp.array) -> None:
        """Read ``rays`` anew at the next update: another kernel has written others into the array."""
        self._views.bundles.forget(rays)

    def create_default_light(self, *, enable_shadows: bool = True, direction: Any = None, color: Any = None) -> None:
        """The one light, and none until this is called; see ``newton.sensors.SensorCamera.create_default_light``."""
        self._views.looks.set_light(enable_shadows, direction, color)

    def set_ambient_light(self, sky_color: Any, ground_color: Any = None) -> None:
        """Light on what faces up and down; see ``newton.sensors.SensorCamera.set_ambient_light``."""
        self._views.looks.set_ambient(sky_color, ground_color)

    def assign_checkerboard_material(self, *, shape_indices: Any, resolution: int = 64, checker_size: int = 32) -> None:
        """Show a grey checkerboard on these shapes and no texture on others, but for visual meshes.

        Args:
            shape_indices: Of the model.
            resolution: Pixels of the image along each side.
            checker_size: Pixels of each square along each side.
        """
        self._views.assign_checkerboard(shape_indices, resolution, checker_size)

    def sync_deformable_meshes(self, state: newton.State, *, deformable_visuals: Any = None) -> None:
        """Choose what deformables are drawn from: ``update`` follows it, if it is told not to synchronise.

        Args:
            state: The state, which must be that of ``update`` then.
            deformable_visuals: See ``update``.

        Raises:
            RuntimeError: ``deformable_visuals`` have never been updated.
        """
        if not isinstance(state, newton.State):
            raise WarpcamError(f"state must be a newton.State, got {type(state).__name__}")
        if deformable_visuals is not None:
            kind = newton.geometry.DeformableVisuals
            if not isinstance(deformable_visuals, kind):
                raise TypeError(
                    f"deformable_visuals must be DeformableVisuals, got {type(deformable_visuals).__name__}"
                )
            if deformable_visuals.model is not self._model:
                raise WarpcamError("deformable_visuals was created for another model")
            if self._mode == SIMULATION_ONLY:
                raise WarpcamError(
                    "deformable_visuals: deformable_surface_mode is SIMULATION_ONLY, which draws no visual meshes"
                )
            deformable_visuals.wait()
        self._synced, self._visuals = weakref.ref(state), deformable_visuals

    def _map(self, world_indices: wp.array | None, num_views: int) -> Mapped:
        num_worlds = self._model.world_count
        if world_indices is None:
            if num_views > num_worlds:
                raise WarpcamError(
                    f"view_count ({num_views}) exceeds model.world_count ({num_worlds}); pass an explicit "
                    "world_indices mapping for the extra views"
                )
            known = self._mapped.get(num_views)
            if known is None:
                known = self._mapped[num_views] = None, own_worlds(num_views, num_worlds, self.device)
            return known[1]
        check_array("world_indices", world_indices, wp.int32, self.device)
        if tuple(world_indices.shape) != (num_views,):
            raise WarpcamError(f"world_indices shape must be ({num_views},), got {tuple(world_indices.shape)}")
        key = ("worlds", id(world_indices))
        known = self._mapped.get(key)
        if known is None or known[0] is not world_indices:
            if torch_interop.is_capturing(self.device):
                raise WarpcamError(
                    "world_indices: a capture is under way, and this array has not been seen before; call update with "
                    "it once before the capture"
                )
            most = self._views_per_world
            if most is None:
                worlds = world_indices.numpy()
                worlds = worlds[(worlds >= 0) & (worlds < num_worlds)]
                most = int(np.bincount(worlds).max()) if worlds.size else 1
            mapped = Mapped(num_views, num_worlds, most, self.device)
            mapped.left_out = self.left_out
            if len(self._mapped) >= WORLDS_KEPT:
                self._mapped.pop(next(iter(self._mapped)))
            known = self._mapped[key] = world_indices, mapped
        return known[1]


def own_worlds(num_views: int, num_worlds: int, device: wp.Device) -> Mapped:
    """Each view is of the world of its number."""
    mapped = Mapped(num_views, num_worlds, 1, device)
    mapped.worlds.assign(np.arange(num_views, dtype=np.int32))
    if num_views == num_worlds:
        mapped.mask = None
    else:
        assert mapped.mask is not None
        mapped.mask.assign((np.arange(num_worlds) < num_views).astype(np.uint8))
    return mapped


def check_array(name: str, array: Any, dtype: Any, device: wp.Device) -> None:
    if not isinstance(array, wp.array):
        raise TypeError(f"{name} must be a Warp array, got {type(array).__name__}")
    if array.dtype != dtype:
        raise WarpcamError(f"{name} must have dtype {dtype.__name__}, got {array.dtype.__name__}")
    if array.device != device:
        raise RuntimeError(f"{name} must be on the model device ({device}), got {array.device}")


def check_images(images: dict[str, Any], shape: tuple[int, ...], device: wp.Device) -> dict[str, wp.array]:
    """Check the images that are given."""
    for name, image in images.items():
        if name not in IMAGES:
            raise TypeError(f"update has no argument {name!r}; images are {', '.join(IMAGES)}")
        if image is not None:
            check_array(name, image, IMAGES[name][2], device)
            if tuple(image.shape) != shape:
                raise WarpcamError(f"{name} shape must be {shape}, got {tuple(image.shape)}")
    return {name: image for name, image in images.items() if image is not None}


def _rays_helper(helper: Callable[..., wp.array]) -> Callable[..., wp.array]:
    """Newton's own, after which an array that is written again is read again."""

    @wraps(helper)
    def compute(*args: Any, **settings: Any) -> wp.array:
        rays = helper(*args, **settings)
        RayBundles.outdated(rays)
        return rays

    return compute


for _name in dir(NewtonsCamera):
    if _name.startswith("compute_camera_rays_"):
        setattr(SensorCamera, _name, staticmethod(_rays_helper(getattr(NewtonsCamera, _name))))
