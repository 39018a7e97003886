"""Images and labels of samples on the host, as writers take them."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Instance:
    """One labelled instance in one image; boxes, pixels and poses are those of ``warpcam.CameraLabels``.

    Attributes:
        id: In the image of ids.
        name: Of the instance in its scene.
        category: Place of its class in ``Frame.classes``.
        model: Place of its surface among ``ShardLayout.models``; -1 unless the writer needs them.
        visible_box: x0, y0, x1, y1 [pixels], half-open.
        visible_pixels: Pixels that show it.
        amodal_box: Likewise, of the instance alone.
        amodal_pixels: Pixels that would show it alone.
        visibility: Share of these that show it.
        truncated: Whether its amodal mask touches an edge of the image.
        position: Origin of its frame in the camera's frame [m].
        rotation: From its frame to the camera's, w x y z.
        box_center: Of its box in its frame [m].
        half_extents: Of its box [m].
        corners: (8, 2) pixels of the box's corners.
        depth: Planar depth of the box's centre [m].
        whole_box: Of the instance alone, also beyond the image's edges; the amodal box unless the writer needs it.
        whole_pixels: Likewise.
        amodal_mask: (height, width) uint8, 1 where the instance alone would be; None unless the writer needs it.
        keypoints: (keypoint, 3): column and row [pixels], and COCO's visibility; those of its own body alone.
    """

    id: int
    name: str
    category: int
    model: int
    visible_box: tuple[int, int, int, int]
    visible_pixels: int
    amodal_box: tuple[int, int, int, int]
    amodal_pixels: int
    visibility: float
    truncated: bool
    position: np.ndarray
    rotation: np.ndarray
    box_center: np.ndarray
    half_extents: np.ndarray
    corners: np.ndarray
    depth: float
    whole_box: tuple[int, int, int, int]
    whole_pixels: int
    amodal_mask: np.ndarray | None
    keypoints: np.ndarray


@dataclass(frozen=True, eq=False)
class Frame:
    """One image of one sample by one camera.

    Attributes:
        sample: Number of the sample.
        camera: Name of the camera.
        number: Of the image among all of the data set.
        stem: Of the image's file name.
        colors: (height, width, 3) uint8.
        jpeg: The colours as a .jpg file, if the plan has the device encode them, else None.
        depth: (height, width) float32, planar [m], inf where nothing is hit; as a sensor measures it if there is one.
        depth_counts: Pixels of each bin of ``statistics.DEPTHS``, and of those without depth, (bin + 1,).
        ids: (height, width) int32.
        intrinsics: fx, fy, cx, cy [pixels], the first pixel's centre at (0.5, 0.5); None: the lens is no pinhole.
        camera_position: In the world [m], (3,).
        camera_rotation: From the camera's frame (x right, y up, z backward) to the world's, (3, 3).
        instances: What is labelled, in the order of their ids.
        classes: Names of the classes.
        keypoint_names: Names of the keypoints, by class.
    """

    sample: int
    camera: str
    number: int
    stem: str
    colors: np.ndarray
    jpeg: bytes | None
    depth: np.ndarray
    depth_counts: np.ndarray
    ids: np.ndarray
    intrinsics: tuple[float, float, float, float] | None
    camera_position: np.ndarray
    camera_rotation: np.ndarray
    instances: tuple[Instance, ...]
    classes: tuple[str, ...]
    keypoint_names: tuple[tuple[str, ...], ...]

    def mask(self, instance: Instance) -> np.ndarray:
        """Pixels that show an instance, (height, width) bool."""
        return self.ids == instance.id
