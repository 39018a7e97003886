"""Worlds of a USD or mesh file: things are placed, and materials have images, as the sample says."""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

import numpy as np
import torch
import warp as wp

import warpcam
from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate import mesh_distractors, usd_distractors
from warpcam.datasets.generate.distractor_pool import ROOT, DistractorPool
from warpcam.datasets.generate.image_files import image_files
from warpcam.datasets.generate.placements import placed
from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.recipes import Draw, Placement
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.sources import load_file
from warpcam.sources.common import formats


class FileScene:
    """A scene of a file that no simulator moves; attributes and methods are those of ``MujocoScene``."""

    host = None

    def __init__(self, plan: Plan, device: wp.Device):
        self._plan = plan
        recipe = plan.recipes.textures
        files = [] if recipe is None else image_files(recipe.folder, "textures: folder")
        textures = {f"warpcam dataset {number}": path for number, path in enumerate(files)}
        self._pool: DistractorPool | None = None
        if plan.recipes.distractors is not None:
            self._pool = DistractorPool(plan, plan.recipes.distractors)
        scene = _load(plan, device, textures, self._pool)
        self.scene: warpcam.DrivenScene = scene
        self.draws: dict[str, Draw] = {}
        if recipe is not None:
            rows = tuple(
                row
                for row, name in enumerate(scene.materials)
                if any(fnmatchcase(name, pattern) for pattern in recipe.names)
            )
            if not rows:
                has = ", ".join(scene.materials) or "none"
                raise WarpcamError(
                    f"textures: names: {', '.join(recipe.names)} is no material of the scene; it has {has}"
                )
            choice = tuple(scene.textures.index(name) for name in textures)
            self.draws["material_texture"] = Draw(choice=choice, rows=rows)
            self.draws["material_texture_repeat"] = Draw(*recipe.repeat, rows=rows, linked=True)
        self._placed = self._choose_paths()
        if self._pool is not None:
            scene.vary("shape_colors")

    def names(self, by: str) -> dict[int, str]:
        if by == "semantic":
            return {number: label for label, number in self.scene.semantics.items()}
        paths = {"body": self.scene.bodies, "instance": self.scene.instances, "shape": self.scene.shapes}[by]
        named = enumerate(paths)
        return {number: path for number, path in named if path and not path.startswith(ROOT)}

    def default_grouping(self) -> str:
        if self.scene.semantics:
            return "semantic"
        return "instance" if self.scene.instances else "body"

    def row(self, attribute: str, name: str) -> int:
        known = {"shape": self.scene.shapes, "material": self.scene.materials}.get(attribute.split("_")[0], ())
        if name not in known:
            raise WarpcamError(f"scene: {attribute}: rows has {name!r}, the scene has {', '.join(known) or 'no names'}")
        return known.index(name)

    def keypoints(self) -> dict[str, tuple[int, tuple[float, float, float]]]:
        raise WarpcamError("labels: keypoints are sites of MuJoCo's scenes, this is a scene of a file")

    def place(self, samples: Sequence[int]) -> None:
        taken: list[list[np.ndarray]] = [[] for _ in samples]
        if self._placed:
            poses = [
                list(placed(self._plan, sample, self._placed, own).values())
                for sample, own in zip(samples, taken, strict=True)
            ]
            self.scene.set_poses([path for path, _, _ in self._placed], np.array(poses, np.float32))
        if self._pool is not None:
            things = np.tile(np.eye(1, 7, 3, dtype=np.float32), (len(samples), len(self._pool.things), 1))
            for world, (sample, own) in enumerate(zip(samples, taken, strict=True)):
                for number, pose in self._pool.poses(sample, own).items():
                    things[world, number] = pose
            self.scene.set_poses(self._pool.paths, things)

    def finish_looks(self, samples: Sequence[int]) -> None:
        if self._pool is not None:
            colors = np.stack([self._pool.colors(sample) for sample in samples])
            columns = [self.scene.shapes.index(f"{path}/shape") for path in self._pool.paths]
            tensor = self.scene.vary("shape_colors")
            tensor[:, torch.as_tensor(columns, device=tensor.device)] = torch.from_numpy(colors).to(tensor.device)

    def _choose_paths(self) -> list[tuple[str, Placement, np.ndarray]]:
        """Paths that the recipes place, with the rotations of the file."""
        every = dict.fromkeys([*self.scene.bodies, *self.scene.instances, *self.scene.shapes])
        known = [path for path in every if not path.startswith(ROOT)]
        chosen: dict[str, Placement] = {}
        for pattern, recipe in self._plan.recipes.poses:
            found = [path for path in known if path and fnmatchcase(path, pattern)]
            if not found:
                raise WarpcamError(f"poses: {pattern!r} is nothing of the scene; it has {', '.join(known)}")
            for path in found:
                chosen.setdefault(path, recipe)
        return [(path, recipe, self.scene.pose(path)[3:]) for path, recipe in chosen.items()]


@preserve_cuda_context()
def _load(
    plan: Plan, device: wp.Device, textures: Mapping[str, Path], pool: DistractorPool | None
) -> warpcam.DrivenScene:
    path = Path(plan.scene)
    if pool is not None and path.suffix.lower() in formats.USD:
        access = plan.access()
        stage = usd_distractors.stage_with(plan.scene, pool, access)
        return load_file.load_stage(stage, plan.worlds, device=device, textures=textures, access=access)
    add = None if pool is None else partial(mesh_distractors.add, pool)
    scene = load_file.load(
        path,
        plan.worlds,
        device,
        None,
        "Z",
        textures,
        trusted=plan.trusted,
        search_paths=plan.search_paths,
        add=add,
    )
    assert isinstance(scene, warpcam.DrivenScene)  # the kind of file is known
    return scene
