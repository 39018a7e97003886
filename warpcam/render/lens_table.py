"""Ray tables of one camera's lens, on the scene's device."""

import numpy as np
import warp as wp

from warpcam.accel.offset_ray_tables import offset_pixel_width, pack_offset_rays
from warpcam.accel.ray_tables import pack_rays, pixel_angle, table_handles
from warpcam.camera.camera import Camera
from warpcam.camera.lens_tables import RayTableLens


class LensTable:
    """Rays of a camera's pixels, or of parts of them.

    Attributes:
        table: float32, (1 or world, number), as native/camera/ray_table.h reads it.
        handles: vec4, (1 or world, 1): of each table, in place of a lens's intrinsics.
    """

    def __init__(self, camera: Camera, lens: RayTableLens, num_worlds: int, device: wp.Device, parts: tuple[int, int]):
        self._camera, self._num_worlds, self._parts = camera, num_worlds, parts
        self._has_origins = lens.has_origins
        packed, widths = self._packed(lens)
        count = num_worlds if lens.differs else 1  # of tables, which may all begin as one
        self.table = wp.array(np.broadcast_to(packed, (count, packed.shape[1])), dtype=wp.float32, device=device)
        handles = self._handles_of(widths if len(widths) == count else widths * count)
        self.handles = wp.array(handles, dtype=wp.vec4, device=device).reshape((-1, 1))

    def assign(self, lens: RayTableLens) -> None:
        """Write another lens over the table, which differs by world only if the first did."""
        packed, widths = self._packed(lens)
        self.table.assign(np.broadcast_to(packed, self.table.shape))
        self.handles.assign(self._handles_of(widths).reshape(-1, 1, 4))

    def _packed(self, lens: RayTableLens) -> tuple[np.ndarray, list[float]]:
        """A lens's tables, with places where rays begin if the first had them, and how wide a pixel is of each."""
        camera = self._camera
        size = (camera.width, camera.height, self._num_worlds, camera.where)
        rays = lens.rays(*size, self._parts)
        if not self._has_origins:
            return pack_rays(rays), [pixel_angle(one) for one in rays]
        rays, starts = np.broadcast_arrays(rays, lens.starts(*size))
        widths = [offset_pixel_width(one, begin) for one, begin in zip(rays, starts, strict=True)]
        return pack_offset_rays(rays, starts), widths

    def _handles_of(self, widths: list[float]) -> np.ndarray:
        count, floats = self.table.shape
        across, down = self._parts
        size = (across * self._camera.width, down * self._camera.height)
        return table_handles(self.table.ptr or 0, count, floats, *size, widths)
