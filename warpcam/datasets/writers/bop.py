"""BOP: scenes of images with 6D poses, masks and visibilities, in the format of the BOP benchmark.

Lengths are millimetres, the camera's frame is OpenCV's (x right, y down, z ahead), and the first pixel's centre is 0.
"""

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from warpcam.core.rotations import rotation_matrices
from warpcam.datasets.generate.frames import Frame, Instance
from warpcam.datasets.generate.shards import write_json
from warpcam.datasets.writers.bop_annotations import SceneAnnotations, annotation
from warpcam.datasets.writers.bop_models import copy_models, write_models
from warpcam.datasets.writers.encode import encode_frame, encode_png, millimeters
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer

TO_OPENCV = np.diag((1.0, -1.0, -1.0))
MODELS = "models"
FOLDERS = ("rgb", "depth", "mask", "mask_visib")
NO_BOX = [-1, -1, -1, -1]


class BopWriter(Writer):
    """train_pbr/NNNNNN: a scene of each shard; models, camera.json, and objects.json with the name of each obj_id.

    An object is a surface: instances that are alike share its obj_id, and those of a class that differ have their own.

    ``px_count_all`` and ``bbox_obj`` are of the whole silhouette, also beyond the image's edges.
    """

    root = "train_pbr"
    pinhole = True
    masks = True
    whole = True
    models = True
    options: ClassVar = {"depth_scale": 1.0}

    def __init__(self, layout: ShardLayout):
        super().__init__(layout)
        self._cameras: dict[str, Any] = {}
        self._poses: dict[str, Any] = {}
        self._infos: dict[str, Any] = {}
        self._annotations = SceneAnnotations(layout)
        for name in FOLDERS:
            (layout.folder / name).mkdir()
        if layout.index == 0:
            write_models(layout.folder / MODELS, layout.models)

    def encode(self, frame: Frame) -> Any:
        layout, scale = self.layout, float(self.layout.options["depth_scale"])
        number = frame.number - layout.first
        depth = millimeters(frame.depth, scale)
        colors = encode_frame(frame, layout)
        (layout.folder / "rgb" / f"{number:06d}.{layout.image_format}").write_bytes(colors)
        (layout.folder / "depth" / f"{number:06d}.png").write_bytes(encode_png(depth))
        placed = [each for each in frame.instances if np.isfinite(each.position).all()]
        for place, each in enumerate(placed):
            name = f"{number:06d}_{place:06d}.png"
            (layout.folder / "mask" / name).write_bytes(_mask(each.amodal_mask))
            (layout.folder / "mask_visib" / name).write_bytes(_mask(frame.mask(each)))
        poses, infos = [_pose(each) for each in placed], [_info(frame, each, depth) for each in placed]
        by_column = np.asfortranarray(frame.ids)
        annotations = [annotation(by_column, each) for each in placed if each.visible_pixels > 0]
        return number, _camera(frame, scale), poses, infos, annotations

    def append(self, encoded: Any) -> None:
        number, camera, poses, infos, annotations = encoded
        name = str(number)
        self._cameras[name], self._poses[name], self._infos[name] = camera, poses, infos
        self._annotations.add(number, annotations)

    def close(self) -> None:
        folder = self.layout.folder
        for name, entries in (
            ("scene_camera", self._cameras),
            ("scene_gt", self._poses),
            ("scene_gt_info", self._infos),
            ("scene_gt_coco", self._annotations.whole()),
        ):
            write_json(folder / f"{name}.json", entries)

    @classmethod
    def merge(cls, merge: Merge) -> None:
        first = json.loads((merge.shards[0].path / "scene_camera.json").read_text())["0"]
        matrix = first["cam_K"]
        camera = {"fx": matrix[0], "fy": matrix[4], "cx": matrix[2], "cy": matrix[5]}
        size = {"width": merge.width, "height": merge.height, "depth_scale": first["depth_scale"]}
        write_json(merge.out / "camera.json", camera | size, indent=1)
        copy_models(merge.shards[0].path / MODELS, merge.out)
        if merge.validation:
            _list_parts(merge)


def _list_parts(merge: Merge) -> None:
    """Write scene and image of each part, as lists of targets have them."""
    parts: dict[str, list[dict[str, int]]] = {split: [] for split in merge.splits()}
    for shard in merge.shards:
        cameras = len(merge.cameras)
        for sample in range(shard.record["first"], shard.record["end"]):
            for number in range(cameras):
                image = (sample - shard.record["first"]) * cameras + number
                parts[merge.split_of(sample)].append({"scene_id": shard.index, "im_id": image})
    for split, entries in parts.items():
        write_json(Path(merge.out) / f"{split}_images.json", entries)


def _camera(frame: Frame, scale: float) -> dict[str, Any]:
    assert frame.intrinsics is not None  # the writer is for pinholes
    fx, fy, cx, cy = frame.intrinsics
    rotation = TO_OPENCV @ frame.camera_rotation.T
    return {
        "cam_K": [fx, 0.0, cx - 0.5, 0.0, fy, cy - 0.5, 0.0, 0.0, 1.0],
        "depth_scale": scale,
        "cam_R_w2c": rotation.ravel().tolist(),
        "cam_t_w2c": (-1000.0 * rotation @ frame.camera_position).tolist(),
    }


def _pose(instance: Instance) -> dict[str, Any]:
    rotation = TO_OPENCV @ rotation_matrices(instance.rotation[None])[0]
    return {
        "cam_R_m2c": rotation.ravel().tolist(),
        "cam_t_m2c": (1000.0 * TO_OPENCV @ instance.position).tolist(),
        "obj_id": instance.model + 1,
    }


def _info(frame: Frame, instance: Instance, depth: np.ndarray) -> dict[str, Any]:
    seen, whole = instance.visible_pixels, instance.whole_pixels
    assert instance.amodal_mask is not None  # the writer asks for masks
    return {
        "bbox_obj": _box(instance.whole_box) if seen else NO_BOX,
        "bbox_visib": _box(instance.visible_box) if seen else NO_BOX,
        "px_count_all": whole,
        "px_count_valid": int(np.count_nonzero(depth[instance.amodal_mask > 0])),
        "px_count_visib": seen,
        "visib_fract": seen / whole if whole else 0.0,
    }


def _box(box: tuple[int, int, int, int]) -> list[int]:
    """x, y, width and height, which BOP counts from the first to the last pixel's centre."""
    left, top, right, bottom = box
    return [left, top, right - 1 - left, bottom - 1 - top]


def _mask(mask: np.ndarray | None) -> bytes:
    assert mask is not None
    return encode_png(np.where(mask > 0, 255, 0).astype(np.uint8))
