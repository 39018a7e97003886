"""A graph on a device: its shapes in many worlds, with poses, colours and textures that a user drives."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from warpcam.accel.gaussians import GaussianCloud
from warpcam.accel.meshes import Mesh
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage, launch_kernel
from warpcam.kernels.types import MESH, SKY_TERMS, SPLATS
from warpcam.kernels.update import poses as pose_kernels
from warpcam.kernels.update.refit import DeformingTree
from warpcam.scene.layers import transparent_layers
from warpcam.scene.source import SceneDescription, live_arrays_of
from warpcam.sources.common import materials
from warpcam.sources.common.driven_frames import DrivenFrames
from warpcam.sources.common.geometry import MeshGeometry, RenderShape
from warpcam.sources.common.scene_graph import LightNode, Material, SceneGraph, ShapeInstance, middle_of
from warpcam.sources.common.warnings import WarningCollector

MAX_LIGHTS = 32  # that are kept; more cannot cast shadows
MAX_SHINING = 8  # at once: shading/fixed_function.h


class SceneGraphSource:
    """The arrays of a graph. All but poses have one row for all worlds until they are driven."""

    live_on_device = True
    color_blend = None

    def __init__(
        self,
        graph: SceneGraph,
        num_worlds: int,
        device: wp.Device,
        labels: Mapping[str, int] | None = None,
        exposure: float | None = None,
        transparency: bool | None = None,
    ):
        self.device, self.graph, self.num_worlds = device, graph, num_worlds
        self._gain = None if exposure is None else 2.0**exposure
        self._collector = WarningCollector(graph.source)
        worlds, seen = graph.worlds(), graph.seen()
        self._moving = graph.moving()
        fits = [
            item.geometry.transformed(worlds[item.node, :3, :3]) if np.isfinite(worlds[item.node]).all() else None
            for item in graph.items
        ]
        kept = [
            place
            for place, (item, fit) in enumerate(zip(graph.items, fits, strict=True))
            if self._moving[item.node] or (fit is not None and seen[item.node])
        ]
        self.items = [graph.items[place] for place in kept]
        if not self.items:
            raise WarpcamError(
                f"{graph.source}: has nothing to draw; {len(graph.items)} shapes came, none is visible: each is "
                "hidden, has no size, or a pose that is not finite"
            )
        self._meshes: dict[int, int] = {}  # by identity: what has been baked is kept by its form
        meshes: list[Mesh] = []
        clouds: list[GaussianCloud] = []
        for place in kept:
            fit = fits[place]
            mesh = fit.mesh if fit is not None else None
            if mesh is not None and id(mesh) not in self._meshes:
                self._meshes[id(mesh)] = len(meshes)
                meshes.append(materials.masked(mesh, self._look(graph.items[place])))
            cloud = fit.cloud if fit is not None else None
            if cloud is not None and id(cloud) not in self._meshes:
                self._meshes[id(cloud)] = len(clouds)
                clouds.append(cloud)
        self.body_nodes = [index for index, node in enumerate(graph.nodes) if index == 0 or node.body]
        body_of = graph.bodies()
        self.labels = graph.numbered(labels)
        self._lamp_order = self._brightest(worlds, seen)
        self._types = np.array([self._type(graph.items[place], fits[place]) for place in kept], np.int32)
        drawn = np.flatnonzero(self._types != SPLATS).tolist()
        self.parts = SceneDescription(
            num_worlds=num_worlds,
            shape_types=self._types,
            shape_bodies=np.array([body_of[item.node] for item in self.items], np.int32),
            drawn=drawn,
            bodies=[graph.nodes[index].name for index in self.body_nodes],
            cameras=[eye.camera() for eye in graph.cameras],
            num_materials=len(graph.materials),
            num_lights=len(self._lamp_order),
            meshes=meshes,
            height_fields=[],
            textures=graph.textures,
            skybox=graph.skybox,
            clouds=clouds,
            shape_instances=np.array([graph.nodes[item.node].instance for item in self.items], np.int32),
            shape_semantics=np.array([self._label(item.node) for item in self.items], np.int32),
            physical=True,
            unlit=not graph.lights,
            maps=any(index >= 0 for look in graph.materials for index in look.maps),
            transmissive=tuple(dict.fromkeys(look.name for look in graph.materials if look.transmission > 0.0)),
            layers=transparent_layers(
                self._types,
                drawn,
                np.array([[materials.opacity(self._look(item), item.color) for item in self.items]]),
                transparency,
            ),
        )
        self._arrays: Mapping[str, wp.array] = {}
        self._own: dict[str, wp.array] = {}
        self._frames = DrivenFrames(graph, num_worlds, device)
        self._first: tuple[np.ndarray, np.ndarray] | None = None  # sizes and assets that shapes had at first
        self._turns = np.zeros((0, 3, 3))
        self._packed: Any = None  # the scene's meshes on the device
        self._moved: dict[int, tuple[wp.array, Sequence[Stage]]] = {}
        self._make_arrays()
        self._fill(worlds, seen)
        self._collector.say()

    # The protocol.

    def arrays(self) -> Mapping[str, wp.array]:
        return self._arrays

    def user_owned(self, field: str) -> bool:
        if field == "material_texture":
            self.make_room("textures")
        return field == "material_texture"

    def user_name(self, field: str) -> str:
        return f"{self.graph.source}: {field}"

    def global_ambient(self) -> float:
        return 0.0

    def clock(self) -> wp.array | None:
        return None

    def refresh(self) -> None:
        pass

    def forward(self) -> None:
        pass

    def kernels(self) -> tuple[wp.Kernel, ...]:
        return ()

    def stages(self, meshes: Any) -> tuple[Any, ...]:
        """Nothing moves by itself."""
        self._packed = meshes
        return ()

    def bind(self, state: Any) -> None:
        raise WarpcamError("bind: this scene reads no state; set_poses places its things")

    # What a user drives.

    def drive(self, nodes: Sequence[int], poses: wp.array, columns: wp.array) -> None:
        """Take poses (world*, path, 7) of driven frames; ``columns`` are theirs, see ``columns_of``."""
        self._frames.drive(nodes, poses, columns, self._arrays)

    def columns_of(self, nodes: Sequence[int]) -> wp.array:
        """Return the columns that hold the poses of frames, which are driven from now on."""
        if self._frames.add(nodes):
            self._place(self.graph.worlds())
        return self._frames.columns_of(nodes)

    def make_room(self, name: str) -> wp.array:
        """An array of which each world has a row of its own from now on: "visible", "colors" or "textures"."""
        if self._own[name].shape[0] < self.num_worlds:
            torch_interop.require_no_capture(self.device, f"set_{name}, for the first time")
            host = self._own[name].numpy()
            host = np.ascontiguousarray(np.broadcast_to(host, (self.num_worlds, *host.shape[1:])))
            self._own[name] = wp.array(host, dtype=self._own[name].dtype, device=self.device)
            if name == "textures":
                self._arrays = {**self._arrays, "material_texture": self._own["textures"]}
            elif self._arrays["shape_colors"].shape[0] < self.num_worlds:
                colors = wp.zeros((self.num_worlds, len(self.items)), dtype=wp.vec4, device=self.device)
                self._arrays = {**self._arrays, "shape_colors": colors}
        return self._own[name]

    def finish_colors(self) -> None:
        inputs = [self._own["colors"], self._own["visible"]]
        colors = self._arrays["shape_colors"]
        launch_kernel(pose_kernels.finish_colors, colors.shape, inputs, [colors], device=self.device)

    def set_time(self, time: float) -> None:
        if self.graph.at_time is None:
            raise WarpcamError(f"{self.graph.source}: has no time samples")
        self.graph.at_time(time)
        self._fill(self.graph.worlds(), self.graph.seen())
        self._move_surfaces()
        self._collector.say()

    # How the arrays are made.

    def _type(self, item: Any, fit: RenderShape | None) -> int:
        if fit is not None:
            return fit.type
        upright = item.geometry.transformed(np.eye(3))
        return upright.type if upright is not None else MESH

    def _look(self, item: ShapeInstance) -> Material | None:
        return self.graph.materials[item.material] if item.material >= 0 else None

    def _label(self, node: int) -> int:
        return next((self.labels[label] for label in self.graph.nodes[node].labels if label in self.labels), 0)

    def _make_arrays(self) -> None:
        counts = {
            "shapes": len(self.items),
            "materials": len(self.graph.materials),
            "lights": len(self._lamp_order),
            "bodies": len(self.body_nodes),
            "cameras": len(self.graph.cameras),
            "terms of the sky": SKY_TERMS + 1,
        }
        self._arrays = arrays = {
            name: wp.zeros(
                (self.num_worlds if field.every_world else 1, counts[field.rows], *field.more),
                dtype=field.dtype,
                device=self.device,
            )
            for name, field in live_arrays_of(self.parts).items()
        }
        headlight = np.zeros((3, 3)) if self.graph.lights else np.array(materials.HEADLIGHT)
        arrays["headlight"] = wp.array(headlight, dtype=wp.vec3, device=self.device)
        described = [materials.material_of(look) for look in self.graph.materials]
        self._put("material_color", [materials.UNSET] * len(described))
        for name in ("roughness", "metallic", "reflectance", "transmission", "emissive"):
            self._put(f"material_{name}", [getattr(material, name) for material in described])
        roles = arrays["material_texture"].shape[2]
        self._put("material_texture", [material.textures[:roles] for material in described])
        self._put("material_texture_repeat", [(1.0, 1.0)] * len(described))
        self._put("shape_materials", [item.material for item in self.items])
        colors = [materials.color_of(self._look(item), item.color) for item in self.items]
        self._own = {
            "colors": wp.array(np.array([colors], np.float32), dtype=wp.vec4, device=self.device),
            "visible": wp.full((1, len(self.items)), 1, dtype=wp.uint8, device=self.device),
            "textures": self._arrays["material_texture"],
        }
        self._hidden = np.zeros(len(self.items), bool)
        self.finish_colors()

    def _move_surfaces(self) -> None:
        """Bring the meshes whose points change with time to where they are now, with their trees."""
        for form in {id(item.geometry): item.geometry for item in self.items}.values():
            for mesh, points in form.now() if isinstance(form, MeshGeometry) and form.moves else ():
                index = self._meshes.get(id(mesh))
                if index is None:
                    continue
                if index not in self._moved:
                    array = wp.array(points, dtype=wp.vec3, device=self.device)
                    assets, bases = np.array([index]), np.zeros(1, np.int64)
                    tree = DeformingTree(
                        self._packed, assets, bases, mesh.fronts, self.device, two_sided=mesh.two_sided
                    )
                    self._moved[index] = array, tree.record(array)
                array, stages = self._moved[index]
                array.assign(points)
                for stage in stages:
                    stage.launch()

    def _put(self, name: str, rows: Any) -> None:
        """The one row of all worlds."""
        array = self._arrays[name]
        if array.size:
            values = np.asarray(rows).reshape(1, *array.shape[1:], -1)
            array.assign(values if values.shape[-1] > 1 else values[..., 0])

    def _fill(self, worlds: np.ndarray, seen: np.ndarray) -> None:
        """Write all that may change with time."""
        fits = [
            item.geometry.transformed(worlds[item.node, :3, :3]) if np.isfinite(worlds[item.node]).all() else None
            for item in self.items
        ]
        sizes, assets, hidden = np.zeros((len(fits), 3)), np.full(len(fits), -1), np.zeros(len(fits), bool)
        self._turns = np.tile(np.eye(3), (len(fits), 1, 1))
        for place, (item, fit) in enumerate(zip(self.items, fits, strict=True)):
            hidden[place] = fit is None or not seen[item.node]
            if fit is None:
                continue
            asset = fit.mesh if fit.cloud is None else fit.cloud
            if fit.type != self._types[place] or (asset is not None and id(asset) not in self._meshes):
                self._collector.warn(
                    "changes its stretch with time, and is drawn with the one it had at first", item.name
                )
                fit = self._as_before(place, fit)
            self._turns[place] = fit.rotation
            sizes[place] = fit.size
            if asset is not None and id(asset) in self._meshes:
                assets[place] = self._meshes[id(asset)]
        if self._first is None:
            self._first = sizes, assets
        assets = np.where(assets < 0, self._first[1], assets)
        self._put("shape_sizes", sizes)
        self._put("shape_assets", assets)
        if (hidden != self._hidden).any():
            changed = np.flatnonzero(hidden != self._hidden)
            visible = self._own["visible"].numpy()
            visible[:, changed] = ~hidden[changed]
            self._own["visible"].assign(visible)
            self._hidden = hidden
            self.finish_colors()
        self._place(worlds)
        self._frames.write_all(self._arrays)
        self._light(seen)
        cameras = self.graph.cameras
        self._put("camera_intrinsics", [(eye.focal, eye.focal, eye.offset[0], -eye.offset[1]) for eye in cameras])

    def _as_before(self, place: int, fit: RenderShape) -> RenderShape:
        size = self._first[0][place] if self._first is not None else np.zeros(3)
        return RenderShape(int(self._types[place]), fit.rotation, size)

    def _brightest(self, worlds: np.ndarray, seen: np.ndarray) -> list[int]:
        """The lights that there is room for, those before others that light the middle of the scene more."""
        lamps = self._lit(range(len(self.graph.lights)), seen)
        middle = middle_of(self.items, worlds)
        arriving = [materials.irradiance_at(lamp, worlds[lamp.node, :3, 3], middle) for lamp in lamps]
        order = sorted(range(len(lamps)), key=lambda place: -arriving[place])
        local = [place for place in order if lamps[place].kind != "dome"]
        shining = sum(arriving[place] > 0.0 for place in local)
        if shining > MAX_SHINING:
            self._collector.warn(
                f"has {shining} lights, of which the {MAX_SHINING} that give the most light here shine"
            )
        if self._gain is None:  # once: lights that are dimmed later are to be seen dimmer
            total = sum(arriving) - sum(arriving[place] for place in local[MAX_SHINING:])
            self._gain = 1.0 / total if 0.0 < total < np.inf else 1.0
        return order[:MAX_LIGHTS]

    def _lit(self, order: Sequence[int], seen: np.ndarray) -> list[LightNode]:
        """Lights as they are, those off that are not visible."""
        lamps = [self.graph.lights[place] for place in order]
        return [replace(lamp, active=bool(lamp.active and seen[lamp.node])) for lamp in lamps]

    def _light(self, seen: np.ndarray) -> None:
        lamps = self._lit(self._lamp_order, seen)
        for name, rows in materials.light_rows(lamps, self._gain or 1.0).items():
            self._put(f"light_{name}", rows)
        self._put("sky", materials.sky_rows(lamps, self._gain or 1.0))

    def _place(self, worlds: np.ndarray) -> None:
        """Place shapes, bodies, lights and cameras in the world, or in driven frames."""
        lamps = [self.graph.lights[place] for place in self._lamp_order]
        self._frames.place(
            worlds,
            {
                "shape": [(item.node, worlds[item.node], self._turns[k]) for k, item in enumerate(self.items)],
                "body": [(node, worlds[node], None) for node in self.body_nodes],
                "light": [(lamp.node, worlds[lamp.node], None) for lamp in lamps],
                "camera": [(eye.node, worlds[eye.node], None) for eye in self.graph.cameras],
            },
        )
