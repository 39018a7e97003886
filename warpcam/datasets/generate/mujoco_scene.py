"""Worlds of a MuJoCo file: joints, bodies, textures and distractors follow from the sample."""

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp

import warpcam
from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate.distractor_pool import DistractorPool
from warpcam.datasets.generate.image_files import image_files, read_texture
from warpcam.datasets.generate.placements import placed
from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.random_numbers import generator
from warpcam.datasets.generate.recipes import Distractors, Draw, Textures
from warpcam.sources.mujoco import batch_file

PREFIX = "warpcam dataset "  # of names in the model


class MujocoScene:
    """A scene of MuJoCo-Warp.

    Attributes:
        scene: What is drawn.
        host: The ``mujoco.MjModel``.
        draws: Recipes of the textures, by attribute of the scene.
        cameras: Bounds without distractors, for a camera that sees all.
    """

    def __init__(self, plan: Plan, device: wp.Device):
        self._plan, self._recipes = plan, plan.recipes
        self._placed: list[tuple[str, Any]] = []
        self.draws: dict[str, Draw] = {}
        path = Path(plan.scene)
        recipes = plan.recipes
        if recipes.poses or recipes.textures or recipes.distractors:
            import mujoco

            spec = batch_file.read_spec(path, plan.access())
            self._choose_bodies(spec, mujoco)
            materials = self._add_textures(spec, mujoco, recipes.textures) if recipes.textures else []
            self._add_distractors(spec, mujoco, recipes.distractors)
            try:
                self.host = spec.compile()
            except ValueError as error:
                raise WarpcamError(f"scene: {str(path)!r} with the recipes' changes: {error}") from None
            state = mujoco.MjData(self.host)
            batch_file.restart(self.host, state)
            self._choose_textures(materials, recipes.textures)
        else:
            self.host, state = batch_file.read(path, access=plan.access())
        self._start, self._mocap = np.array(state.qpos), (np.array(state.mocap_pos), np.array(state.mocap_quat))
        self._batch = batch_file.put(self.host, state, num_worlds=plan.worlds, device=device, path=path)
        self.scene = warpcam.from_mujoco_warp(self.host, self._batch.model, self._batch.data)
        if recipes.distractors:
            count = len(self._pool.things)
            self._pool_geoms = np.array([self.host.geom(self._distractor(k)).id for k in range(count)], np.int64)
            self._mocaps = self.host.body_mocapid[self.host.geom_bodyid[self._pool_geoms]]
            self.scene.vary("shape_colors")

    def names(self, by: str) -> dict[int, str]:
        """Names of instances, by id."""
        if by == "body":
            named = {index: self.host.body(index).name for index in range(1, self.host.nbody)}
        elif by == "shape":
            named = {index: self.host.geom(index).name for index in range(self.host.ngeom)}
        else:
            raise WarpcamError(f"labels: by: MuJoCo's scenes have 'body' and 'shape', got {by!r}")
        return {index: name for index, name in named.items() if name and not name.startswith(PREFIX)}

    def default_grouping(self) -> str:
        return "body"

    def row(self, attribute: str, name: str) -> int:
        """Row of a named shape, material or light in an array of ``Scene.vary``."""
        kind = {"shape": "geom", "material": "material", "light": "light"}.get(attribute.split("_")[0])
        try:
            return int(getattr(self.host, kind or "")(name).id)
        except (AttributeError, KeyError):
            raise WarpcamError(
                f"scene: {attribute}: rows has {name!r}, the model has no such {kind or 'row'}"
            ) from None

    def keypoints(self) -> dict[str, tuple[int, tuple[float, float, float]]]:
        """MuJoCo's sites, as ``warpcam.labels`` takes them."""
        return warpcam.site_keypoints(self.host)

    def place(self, samples: Sequence[int]) -> None:
        """Give each world the joints and bodies of its sample."""
        joints, positions, rotations = self.states(samples)
        data = self._batch.data
        data.qpos.assign(joints.astype(np.float32))
        if self.host.nmocap:
            data.mocap_pos.assign(positions.astype(np.float32))
            data.mocap_quat.assign(rotations.astype(np.float32))
        batch_file.forward(self._batch)

    def states(self, samples: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joint positions (sample, nq), and positions and quaternions of mocap bodies (sample, nmocap, 3 and 4)."""
        joints = np.tile(self._start, (len(samples), 1))
        positions, rotations = (np.repeat(array[None], len(samples), 0) for array in self._mocap)
        if self._recipes.joints == "random":
            count = sum(batch_file.joint_numbers(self.host))
            numbers = [generator(self._plan.seed, sample, "joints").random(count) for sample in samples]
            joints[:] = batch_file.varied_joints(self.host, self._start, np.array(numbers).reshape(len(samples), count))
        for world, sample in enumerate(samples):
            taken: list[np.ndarray] = []
            poses = placed(
                self._plan, sample, [(name, recipe, self._rotation(name)) for name, recipe in self._placed], taken
            )
            for name, pose in poses.items():
                body = self.host.body(name)
                mocap = int(self.host.body_mocapid[body.id])
                if mocap >= 0:
                    positions[world, mocap], rotations[world, mocap] = pose[:3], pose[3:]
                else:
                    first = int(self.host.jnt_qposadr[self.host.body_jntadr[body.id]])
                    joints[world, first : first + 7] = pose
            if self._recipes.distractors:
                for number, pose in self._pool.poses(sample, taken).items():
                    mocap = self._mocaps[number]
                    positions[world, mocap], rotations[world, mocap] = pose[:3], pose[3:]
        return joints, positions, rotations

    def finish_looks(self, samples: Sequence[int]) -> None:
        """Colour the distractors of each sample, and hide those that it lacks; after all other draws."""
        if self._recipes.distractors is None:
            return
        colors = np.stack([self._pool.colors(sample) for sample in samples])
        tensor = self.scene.vary("shape_colors")
        columns = torch.as_tensor(self._pool_geoms, device=tensor.device)
        tensor[:, columns] = torch.from_numpy(colors).to(tensor.device)

    def _choose_bodies(self, spec: Any, mujoco: Any) -> None:
        """Bodies that the recipes place, by name; those that nothing moves are made free to be placed."""
        bodies = {body.name: body for body in spec.bodies if body.name and body.parent is not None}
        for pattern, recipe in self._recipes.poses:
            found = [name for name in bodies if fnmatchcase(name, pattern)]
            if not found:
                raise WarpcamError(f"poses: {pattern!r} is no body of the scene; it has {', '.join(bodies) or 'none'}")
            for name in found:
                body = bodies[name]
                free = [joint for joint in body.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
                if not free and (body.joints or body.parent.name != "world"):
                    raise WarpcamError(
                        f"poses: {name!r} is moved by joints or on another body; bodies with a free joint, and those "
                        "fixed to the world, may be placed"
                    )
                if not free:
                    body.mocap = True
                if name not in dict(self._placed):
                    self._placed.append((name, recipe))

    def _rotation(self, name: str) -> np.ndarray:
        """Rotation of a body as the file has it."""
        body = self.host.body(name)
        if self.host.body_mocapid[body.id] >= 0:
            return np.array(self.host.body_quat[body.id])
        first = int(self.host.jnt_qposadr[self.host.body_jntadr[body.id]])
        return self._start[first + 3 : first + 7]

    def _add_textures(self, spec: Any, mujoco: Any, recipe: Textures) -> list[str]:
        """Add the folder's images, and a material of its own to each shape; returns the materials' names."""
        files = image_files(recipe.folder, "textures: folder")
        for number, path in enumerate(files):
            image = read_texture(path)
            texture = spec.add_texture()
            texture.name, texture.type = f"{PREFIX}{number}", mujoco.mjtTexture.mjTEXTURE_2D
            texture.height, texture.width, texture.nchannel = (*image.shape[:2], 3)
            texture.data = image.tobytes()
        named = [(geom, geom.name or geom.parent.name) for geom in spec.geoms]
        chosen = [geom for geom, name in named if any(fnmatchcase(name, pattern) for pattern in recipe.names)]
        if not chosen:
            raise WarpcamError(f"textures: names: {', '.join(recipe.names)} is no shape of the scene")
        materials = []
        for number, geom in enumerate(chosen):
            material = spec.add_material()
            material.name = f"{PREFIX}{number}"
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = f"{PREFIX}{number % len(files)}"
            geom.material, geom.rgba = material.name, (1.0, 1.0, 1.0, 1.0)
            materials.append(material.name)
        return materials

    def _choose_textures(self, materials: list[str], recipe: Textures | None) -> None:
        if recipe is None:
            return
        textures = tuple(k for k in range(self.host.ntex) if self.host.tex(k).name.startswith(PREFIX))
        rows = tuple(int(self.host.material(name).id) for name in materials)
        self.draws["material_texture"] = Draw(choice=textures, rows=rows)
        self.draws["material_texture_repeat"] = Draw(*recipe.repeat, rows=rows, linked=True)

    def _add_distractors(self, spec: Any, mujoco: Any, recipe: Distractors | None) -> None:
        """Add bodies of which each sample has some."""
        if recipe is None:
            return
        self._pool = DistractorPool(self._plan, recipe)
        for number, thing in enumerate(self._pool.things):
            body = spec.worldbody.add_body()
            body.name, body.mocap = self._distractor(number), True
            body.pos = 0.5 * (np.array(recipe.low) + recipe.high)
            geom = body.add_geom()
            geom.name, geom.type = body.name, getattr(mujoco.mjtGeom, f"mjGEOM_{thing.kind.upper()}")
            geom.size = thing.size
            geom.contype = geom.conaffinity = 0

    def _distractor(self, number: int) -> str:
        return f"{PREFIX}distractor {number}"
