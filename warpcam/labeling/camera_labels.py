"""Labels of one camera, as ``Labels.read`` returns them."""

from __future__ import annotations

from dataclasses import dataclass

from warpcam.core.torch_interop import torch


@dataclass(frozen=True, eq=False)
class CameraLabels:
    """Labels of one camera: tensors on the scene's device, the same memory at each read.

    Instances are those of ``Labels.ids``. Boxes in the image are x0, y0, x1, y1 [pixels], half-open: columns x0 to
    x1 - 1 and rows y0 to y1 - 1. Pixels of points are column and row, the first pixel's centre at (0.5, 0.5). The
    camera's frame is x right, y up, z backward (OpenGL, MuJoCo); quaternions are w x y z. An instance that a world
    lacks has 0 in boxes, pixels, ``visibility`` and ``truncated``, and NaN in the rest.

    Attributes:
        visible_boxes: int32 (world, instance, 4): tight box of the pixels that show the instance; 0 where none does.
        visible_pixels: int32 (world, instance): how many pixels show it.
        amodal_boxes: int32 (world, instance, 4): tight box of the pixels that would show it if nothing else were there;
            0 where none would. -1 with ``labels(amodal=False)``.
        amodal_pixels: int32 (world, instance): how many pixels these are; -1 with ``labels(amodal=False)``.
        visibility: float32 (world, instance): ``visible_pixels`` / ``amodal_pixels``, 0 where no pixel would show it;
            NaN with ``labels(amodal=False)``. As BOP's ``visib_fract``, of pixels of ids in place of depths.
        truncated: uint8 (world, instance): 1 where the amodal mask touches an edge of the image, beyond which the
            instance may go on; 0 with ``labels(amodal=False)``.
        positions: float32 (world, instance, 3): origin of the instance's frame in the camera's frame [m].
        rotations: float32 (world, instance, 4): rotation from the instance's frame to the camera's, w x y z, w >= 0.
        box_centers: float32 (world, instance, 3): centre of the box of all its shapes along the axes of its frame, in
            its frame [m]. It encloses spheres, capsules, ellipsoids, cylinders, boxes and meshes tightly; meshes that
            are deformed or have been turned on their body, or scaled, since labels were made, and all else by the
            boxes that they have in frames of their own.
        half_extents: float32 (world, instance, 3): half widths of that box [m]; infinite if an endless plane is part of
            the instance, NaN if nothing of it is drawn.
        corners: float32 (world, instance, 8, 2): pixels of the box's corners. Corner k lies on the upper side of axis i
            (0, 1, 2 for x, y, z) where bit i of k is 1. NaN for corners that the lens does not see; a pinhole sees
            beyond the image's edges, a lens that is a table of rays does not.
        centers: float32 (world, instance, 2): pixel of the box's centre; NaN likewise.
        depths: float32 (world, instance): planar depth of the box's centre [m], negative behind the camera.
        keypoints: float32 (world, keypoint, 2): pixels of the keypoints, in the order of ``Labels.keypoints``; NaN as
            for corners.
        keypoint_depths: float32 (world, keypoint): their planar depths [m], negative behind the camera.
        keypoint_visibility: uint8 (world, keypoint), COCO's v: 0 outside the image or of the range from ``near`` to
            ``far``, 1 hidden, 2 visible: the camera's ray to the keypoint meets no surface that is nearer by more than
            the tolerance. What can be seen through hides as if it were solid, as it does in depth.
        amodal_masks: uint8 (world, instance, height, width): 1 in the pixels that would show the instance if nothing
            else were there. None without ``labels(masks=True)``.
    """

    visible_boxes: torch.Tensor
    visible_pixels: torch.Tensor
    amodal_boxes: torch.Tensor
    amodal_pixels: torch.Tensor
    visibility: torch.Tensor
    truncated: torch.Tensor
    positions: torch.Tensor
    rotations: torch.Tensor
    box_centers: torch.Tensor
    half_extents: torch.Tensor
    corners: torch.Tensor
    centers: torch.Tensor
    depths: torch.Tensor
    keypoints: torch.Tensor
    keypoint_depths: torch.Tensor
    keypoint_visibility: torch.Tensor
    amodal_masks: torch.Tensor | None = None
