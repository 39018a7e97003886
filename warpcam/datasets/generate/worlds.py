"""Worlds of a data set: a scene, a renderer, labels and sensors, which draw any samples."""

import dataclasses
import re
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp

import warpcam
from warpcam import sensors
from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate import cameras as camera_rules
from warpcam.datasets.generate import device_jpeg, sensing, statistics
from warpcam.datasets.generate.file_scene import FileScene
from warpcam.datasets.generate.frames import Frame, Instance
from warpcam.datasets.generate.image_files import image_files, read_cover
from warpcam.datasets.generate.mujoco_scene import MujocoScene
from warpcam.datasets.generate.object_models import ObjectModel, find_models
from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.random_numbers import generator, seed_of
from warpcam.datasets.generate.recipes import Draw
from warpcam.datasets.generate.whole_silhouettes import WholeSilhouettes
from warpcam.datasets.writers import find_writer
from warpcam.labeling.instances import OUTPUT_OF, find_instances
from warpcam.render.drawn_cameras import drawn_cameras
from warpcam.sources.common import formats

IMAGE_LABELS = tuple(
    field.name
    for field in dataclasses.fields(warpcam.CameraLabels)
    if field.name not in ("keypoint_depths", "amodal_masks")
)


class Worlds:
    """Draws samples of a plan on one device; building it compiles all kernels.

    Attributes:
        cameras: Names of the cameras.
        classes: Names of the classes.
        models: Surfaces of what is labelled; none unless the writer needs them.
        device: Where it draws.
    """

    def __init__(self, plan: Plan):
        self._plan, self._recipes, writer = plan, plan.recipes, find_writer(plan.writer)
        self.device = resolve(plan.device)
        if plan.jpeg == "torchcodec":
            device_jpeg.require()
        kind = Path(plan.scene).suffix.lower()
        self._source: Any = (MujocoScene if kind in formats.MUJOCO else FileScene)(plan, self.device)
        scene: warpcam.Scene = self._source.scene
        self._choose_classes(scene)
        self.models: tuple[ObjectModel, ...] = ()
        self._model_of: dict[int, int] = {}
        if writer.models:
            self.models, self._model_of = find_models(scene, self._by, self._names, self._category_of, self.classes)
        self._photographs = (
            image_files(self._recipes.backgrounds.folder, "backgrounds: folder") if self._recipes.backgrounds else []
        )
        self._draws = {name: self._bound(name, draw) for name, draw in self._all_draws()}
        if self._draws:  # before the renderer is made: it is made for what is drawn
            warpcam.randomize(scene, seed=0, **self._draws)
        lower, upper = scene.bounds()
        self._middle = 0.5 * (lower + upper)
        self._chosen = camera_rules.choose_cameras(plan, scene)
        self.cameras = tuple(self._chosen)
        effects = {name: sensing.effects_of(recipe, f"sensors: {name}") for name, recipe in self._recipes.sensors}
        color = "rgba" if self._photographs else "rgb"
        self._color, self._ids = color, OUTPUT_OF[self._by]
        made = []
        for name, (key, recipe) in self._chosen.items():
            needed = sensing.outputs_of(effects.get(name, ()))
            outputs = tuple(dict.fromkeys((color, "depth", self._ids, *needed)))
            made.append(camera_rules.make_camera(plan, scene, self._source.host, name, key, recipe, outputs))
        self._keys = dict(zip(self._chosen, (camera.name for camera in made), strict=True))
        self._renderer = warpcam.Renderer(scene, made)
        keypoints = self._source.keypoints() if self._recipes.labels.keypoints else {}
        ids = list(self._category_of)
        self._labels = warpcam.labels(self._renderer, by=self._by, ids=ids, masks=writer.masks, keypoints=keypoints)
        self._keypoint_bodies = np.array([body for body, _ in keypoints.values()], np.int64)
        self.keypoint_names = self._keypoints_of_classes(list(keypoints))
        self._rig = None
        if effects:
            measured = {self._keys[name]: found for name, found in effects.items()}
            self._rig = sensors.Rig(self._renderer, measured, by_world=False)
        _, drawn = drawn_cameras(self._renderer, "dataset")
        self._pinhole = {name: drawn[self._keys[name]].projection == "pinhole" for name in self.cameras}
        if writer.pinhole and not all(self._pinhole.values()):
            name = next(name for name, pinhole in self._pinhole.items() if not pinhole)
            raise WarpcamError(f"--writer: {plan.writer} has pinhole cameras alone, and {name!r} has another lens")
        self._whole = WholeSilhouettes(self._renderer, made, self._by, ids, self._ids) if writer.whole else None

    def draw(self, samples: Sequence[int]) -> Iterator[Frame]:
        """Draw at most as many samples as there are worlds, and yield their images, sample after sample.

        Images are copied to the host before the first is yielded.
        """
        plan, count = self._plan, len(samples)
        padded = [*samples, *[samples[-1]] * (plan.worlds - count)]
        self._vary(padded)
        images = self._look(padded)
        found = self._labels.read()
        whole = {} if self._whole is None else self._whole.read()
        hosts = {}
        for name, key in self._keys.items():
            drawn = {output: images[key][output][:count] for output in (self._color, "depth", self._ids)}
            arrays = {output: _on_host(image) for output, image in drawn.items()}
            arrays["counts"] = _on_host(statistics.depth_counts(drawn["depth"][..., 0]))
            labels = {field: _on_host(getattr(found[key], field)[:count]) for field in IMAGE_LABELS}
            boxes, pixels = whole.get(key, (found[key].amodal_boxes, found[key].amodal_pixels))
            labels |= {"whole_boxes": _on_host(boxes[:count]), "whole_pixels": _on_host(pixels[:count])}
            if (masks := found[key].amodal_masks) is not None:
                labels["amodal_masks"] = _on_host(masks[:count])
            files: list[bytes | None] = [None] * count
            if plan.jpeg == "torchcodec":
                files = [*device_jpeg.encode(drawn[self._color], plan.quality)]
            hosts[name] = arrays, files, labels, self._renderer.views(key).numpy().copy()
        ids = _on_host(self._labels.ids[:count])
        if self.device.is_cuda:
            torch.cuda.current_stream(wp.device_to_torch(self.device)).synchronize()
        for place, sample in enumerate(samples):
            for number, name in enumerate(self.cameras):
                yield self._frame(sample, number, name, place, ids[place], *hosts[name])

    def _vary(self, samples: Sequence[int]) -> None:
        """Give each world the poses, looks and cameras of its sample."""
        self._source.place(samples)
        if self._draws:
            seeds = self._seeds(samples, "looks")
            warpcam.randomize(self._renderer.scene, seed=seeds, by_world=False, **self._draws)
        self._source.finish_looks(samples)
        for name, (_, recipe) in self._chosen.items():
            self._place_camera(name, recipe, samples)

    def _seeds(self, samples: Sequence[int], purpose: str) -> torch.Tensor:
        seeds = np.array([seed_of(self._plan.seed, sample, purpose) for sample in samples], np.int32)
        return torch.from_numpy(seeds).to(wp.device_to_torch(self.device))

    def _look(self, samples: Sequence[int]) -> Any:
        if self._rig is None:
            return self._renderer.render()
        self._rig.seeds.copy_(self._seeds(samples, "sensors"))
        self._rig.reset()
        self._rig.frames.zero_()
        for name, recipe in self._recipes.sensors:
            if recipe.randomize:
                draws = {key: _recipe(draw, draw.rows) for key, draw in recipe.randomize}
                parameters = self._rig.parameters(self._keys[name])
                seeds = self._seeds(samples, f"sensor {name}")
                warpcam.randomize(parameters, seed=seeds, by_world=False, **draws)
        return self._rig.read(time=0.0)

    def _place_camera(self, name: str, recipe: Any, samples: Sequence[int]) -> None:
        arrays = self._renderer.camera(self._keys[name])
        if recipe.shell is not None:
            positions, rotations = camera_rules.shell_poses(self._plan, name, recipe.shell, self._middle, samples)
            arrays.position.copy_(torch.from_numpy(positions))
            arrays.rotation.copy_(torch.from_numpy(rotations))
        if recipe.fovy is not None:
            angles = camera_rules.fields_of_view(self._plan, name, recipe.fovy, samples)
            arrays.fovy.copy_(torch.from_numpy(angles))
        draws = {key: value for key in ("exposure", "gain") if (value := getattr(recipe, key)) is not None}
        if draws:
            warpcam.randomize(arrays, seed=self._seeds(samples, f"light of {name}"), by_world=False, **draws)

    def _choose_classes(self, scene: warpcam.Scene) -> None:
        """Find what is labelled: names, and the class of each instance."""
        recipe = self._recipes.labels
        self._by: Any = recipe.by or self._source.default_grouping()
        names = self._source.names(self._by)
        drawn = set(find_instances(scene, self._by, None).ids.ravel().tolist())
        self._names = {number: name for number, name in sorted(names.items()) if number in drawn}
        # The last part of a path, and of copies that have numbers what they are copies of.
        short = {number: re.sub(r"\[\d+\]$", "", name.rsplit("/", 1)[-1]) for number, name in self._names.items()}
        if recipe.classes is None:
            self.classes = tuple(dict.fromkeys(short.values()))
            self._category_of = {number: self.classes.index(name) for number, name in short.items()}
        else:
            self.classes = tuple(name for name, _ in recipe.classes)
            self._category_of = {}
            for number, name in self._names.items():
                for category, (_, patterns) in enumerate(recipe.classes):
                    if any(fnmatchcase(each, pattern) for pattern in patterns for each in (name, short[number])):
                        self._category_of.setdefault(number, category)
            for category, (name, patterns) in enumerate(recipe.classes):
                if category not in self._category_of.values():
                    has = ", ".join(self._names.values()) or "none"
                    what = f"labels: classes: {name}: nothing is called {', '.join(patterns)}"
                    raise WarpcamError(f"{what}; by {self._by!r} there are {has}")
        if not self._category_of:
            raise WarpcamError(f"labels: by {self._by!r} nothing of the scene has a name, so there is nothing to label")

    def _keypoints_of_classes(self, names: list[str]) -> tuple[tuple[str, ...], ...]:
        """Names of the keypoints of each class's first body."""
        if names and self._by != "body":
            raise WarpcamError(f"labels: keypoints are those of bodies, and by is {self._by!r}")
        first: dict[int, int] = {}
        for number, category in self._category_of.items():
            first.setdefault(category, number)
        return tuple(
            tuple(name for name, body in zip(names, self._keypoint_bodies, strict=True) if body == first.get(category))
            for category in range(len(self.classes))
        )

    def _all_draws(self) -> Iterator[tuple[str, Draw]]:
        yield from self._recipes.scene
        for name, draw in self._source.draws.items():
            if name in dict(self._recipes.scene):
                raise WarpcamError(f"textures: {name} is drawn by scene, too; leave one of them away")
            yield name, draw

    def _bound(self, name: str, draw: Draw) -> Any:
        """The recipe as ``warpcam.randomize`` takes it, with names of rows as numbers."""
        rows = draw.rows
        if rows is not None:
            several = rows if isinstance(rows, tuple) else (rows,)
            rows = [self._source.row(name, row) if isinstance(row, str) else row for row in several]
        return _recipe(draw, rows)

    def _frame(
        self,
        sample: int,
        number: int,
        name: str,
        place: int,
        ids: np.ndarray,
        images: Mapping[str, np.ndarray],
        files: Sequence[bytes | None],
        labels: Mapping[str, np.ndarray],
        views: np.ndarray,
    ) -> Frame:
        view = views[place]
        scale, center = view["scale"], view["center"]
        pinhole = (float(1.0 / scale[0]), float(1.0 / scale[1]), float(center[0]), float(center[1]))
        own = {field: values[place] for field, values in labels.items()}
        stem = f"{sample:08d}" + (f"-{camera_rules.file_name(name)}" if len(self.cameras) > 1 else "")
        return Frame(
            sample=sample,
            camera=name,
            number=sample * len(self.cameras) + number,
            stem=stem,
            colors=self._composed(images[self._color][place], sample, name),
            jpeg=files[place],
            depth=images["depth"][place, ..., 0],
            depth_counts=images["counts"][place],
            ids=images[self._ids][place, ..., 0],
            intrinsics=pinhole if self._pinhole[name] else None,
            camera_position=np.array(view["origin"], np.float64),
            camera_rotation=np.array(view["rotation"], np.float64).reshape(3, 3),
            instances=tuple(
                self._instance(int(instance), row, own) for row, instance in enumerate(ids) if instance >= 0
            ),
            classes=self.classes,
            keypoint_names=self.keypoint_names,
        )

    def _composed(self, colors: np.ndarray, sample: int, camera: str) -> np.ndarray:
        """Colours with a photograph behind them, if there are any."""
        recipe = self._recipes.backgrounds
        if recipe is None:
            return colors
        random = generator(self._plan.seed, sample, f"background {camera}")
        if random.random() >= recipe.probability:
            return np.ascontiguousarray(colors[..., :3])
        path = self._photographs[int(random.integers(len(self._photographs)))]
        height, width = colors.shape[:2]
        photograph = read_cover(path, width, height, random.random(), random.random())
        through = 1.0 - colors[..., 3:].astype(np.float32) / 255.0
        return np.round(np.minimum(colors[..., :3] + through * photograph, 255.0)).astype(np.uint8)

    def _instance(self, number: int, row: int, labels: Mapping[str, np.ndarray]) -> Instance:
        mine = np.flatnonzero(self._keypoint_bodies == number)
        keypoints = np.column_stack((labels["keypoints"][mine], labels["keypoint_visibility"][mine]))
        return Instance(
            id=number,
            name=self._names[number],
            category=self._category_of[number],
            model=self._model_of.get(number, -1),
            visible_box=_box(labels["visible_boxes"][row]),
            visible_pixels=int(labels["visible_pixels"][row]),
            amodal_box=_box(labels["amodal_boxes"][row]),
            amodal_pixels=int(labels["amodal_pixels"][row]),
            visibility=float(labels["visibility"][row]),
            truncated=bool(labels["truncated"][row]),
            position=labels["positions"][row].astype(np.float64),
            rotation=labels["rotations"][row].astype(np.float64),
            box_center=labels["box_centers"][row].astype(np.float64),
            half_extents=labels["half_extents"][row].astype(np.float64),
            corners=labels["corners"][row],
            depth=float(labels["depths"][row]),
            whole_box=_box(labels["whole_boxes"][row]),
            whole_pixels=int(labels["whole_pixels"][row]),
            amodal_mask=labels["amodal_masks"][row] if "amodal_masks" in labels else None,
            keypoints=keypoints.reshape(len(mine), 3),
        )


def _on_host(tensor: torch.Tensor) -> np.ndarray:
    """A copy, also of memory of the host: the next samples are drawn into that while these are encoded.

    From a GPU it is there once the current stream has been waited for: pinned memory is copied to by the device.
    """
    host = torch.empty(tensor.shape, dtype=tensor.dtype, pin_memory=tensor.is_cuda)
    copied: np.ndarray = host.copy_(tensor, non_blocking=True).numpy()
    return copied


def _box(numbers: np.ndarray) -> tuple[int, int, int, int]:
    left, top, right, bottom = map(int, numbers)
    return left, top, right, bottom


def _recipe(draw: Draw, rows: Any) -> Any:
    if draw.choice is not None:
        return warpcam.Choice(list(draw.choice), rows=rows)
    of: Any = draw.of
    return warpcam.Uniform(draw.low, draw.high, of=of, rows=rows, linked=draw.linked)
