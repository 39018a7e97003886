"""Scenes that no simulator moves: the user does."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_quaternions
from warpcam.kernels.runtime.launch import launch_kernel
from warpcam.kernels.update import poses as pose_kernels
from warpcam.scene.scene import Scene

if TYPE_CHECKING:
    from warpcam.sources.common.scene_graph_source import SceneGraphSource


class DrivenScene(Scene):
    """A scene of a file, in many worlds. Made by ``from_usd`` and ``load``.

    What is set is an array with a leading world dimension, (world, ...) or (1, ...) for all alike, as a tensor, a Warp
    array or numpy. On the scene's device it is neither copied to the host nor waited for, and once something of the
    same paths has been set, setting it again allocates nothing and may be captured. The next render shows it.

    Paths are those of the file. A path stands for itself and all that is below it.
    """

    def __init__(self, source: "SceneGraphSource"):
        super().__init__(source)
        self._graph_source = source
        self._names = {node.name: index for index, node in enumerate(source.graph.nodes)}
        self._columns: dict[tuple[str, ...], tuple[list[int], wp.array]] = {}
        self._groups: dict[tuple[str, ...], tuple[wp.array, wp.array]] = {}
        self._materials: dict[tuple[str, ...], wp.array] = {}

    @property
    def shapes(self) -> tuple[str, ...]:
        """Paths of the shapes, in the order of their ids in ``segmentation``."""
        return tuple(item.name for item in self._graph_source.items)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Paths of the bodies, in the order of their ids in ``bodies``."""
        return tuple(self._parts.bodies)

    @property
    def instances(self) -> tuple[str, ...]:
        """Paths of the replicated things, in the order of their ids in ``instances``."""
        return tuple(self._graph_source.graph.instances)

    @property
    def materials(self) -> tuple[str, ...]:
        """Paths of the materials."""
        return tuple(look.name for look in self._graph_source.graph.materials)

    @property
    def textures(self) -> tuple[str, ...]:
        """Names of the images, which ``set_textures`` chooses from."""
        return tuple(self._graph_source.graph.texture_names)

    @property
    def semantics(self) -> Mapping[str, int]:
        """The number of each label in ``semantics``."""
        return dict(self._graph_source.labels)

    def pose(self, path: str) -> np.ndarray:
        """Pose of something in the world as the file has it: position [m] and quaternion w x y z, (7,) float64."""
        matrix = self._graph_source.graph.worlds_of(self._node("pose", path))
        rotation = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
        quaternion = rotation_quaternions(rotation[None])[0]
        return np.concatenate((matrix[:3, 3], quaternion / np.linalg.norm(quaternion)))

    def set_poses(self, paths: Sequence[str], poses: Any) -> None:
        """Place things: each with all that is fixed to it, but for what is placed by a path of its own.

        A thing that has been placed stays where it is when ``set_time`` is called, and keeps its size.

        Args:
            paths: What to place.
            poses: (world, path, 7) float32: position in the world [m], and a quaternion w x y z of any length but 0
                from the thing's own axes to the world's; (1, path, 7) for the same in all worlds.
        """
        key = self._check_paths("set_poses", paths)
        array = self._take("set_poses: poses", poses, (len(key), 7), wp.float32)
        if key not in self._columns:
            torch_interop.require_no_capture(self.device, "set_poses, for the first time of these paths")
            nodes = [self._node("set_poses", path) for path in key]
            self._columns[key] = nodes, self._graph_source.columns_of(nodes)
        with torch_interop.in_order(self.device):
            self._graph_source.drive(self._columns[key][0], array, self._columns[key][1])

    def set_visible(self, paths: Sequence[str], visible: Any) -> None:
        """Show or hide shapes.

        Args:
            paths: Of what is to be seen or not. What was hidden when the scene was read is not there at all.
            visible: (world, path) or (1, path), bool or uint8.
        """
        key = self._check_paths("set_visible", paths)
        array = self._take("set_visible: visible", visible, (len(key),), wp.uint8)
        groups, shapes = self._shapes_of("set_visible", key)
        rows = self._graph_source.make_room("visible")
        with torch_interop.in_order(self.device):
            inputs = [array, groups, shapes]
            launch_kernel(pose_kernels.set_visible, (self.num_worlds, len(shapes)), inputs, [rows], device=self.device)
            self._graph_source.finish_colors()

    def set_colors(self, paths: Sequence[str], colors: Any) -> None:
        """Paint shapes. A texture stays, and is multiplied by the colour.

        Args:
            paths: Of what to paint.
            colors: Display colours in [0, 1], (world, path, 3 or 4) float32, or (1, path, 3 or 4); what has an alpha
                of 0 is not seen. Without an alpha that of before stays.
        """
        key = self._check_paths("set_colors", paths)
        array = self._take("set_colors: colors", colors, (len(key), (3, 4)), wp.float32)
        if "shape_colors" in self._own:
            raise WarpcamError('set_colors: vary("shape_colors") holds the colours now; write them there')
        groups, shapes = self._shapes_of("set_colors", key)
        rows = self._graph_source.make_room("colors")
        with torch_interop.in_order(self.device):
            inputs = [array, groups, shapes]
            launch_kernel(pose_kernels.set_colors, (self.num_worlds, len(shapes)), inputs, [rows], device=self.device)
            self._graph_source.finish_colors()

    def set_textures(self, materials: Sequence[str], textures: Any) -> None:
        """Give materials other images.

        Args:
            materials: Paths of materials, see ``materials``.
            textures: (world, material) int32, places in ``textures``, -1 for none. Others are an error, or on a GPU,
                where they are not looked at, none.
        """
        key = self._check_paths("set_textures", materials)
        array = self._take("set_textures: textures", textures, (len(key),), wp.int32)
        if key not in self._materials:
            torch_interop.require_no_capture(self.device, "set_textures, for the first time of these materials")
            known = self.materials
            for name in key:
                if name not in known:
                    raise WarpcamError(f"set_textures: the scene has no material {name!r}; it has: {_some(known)}")
            rows = np.array([known.index(name) for name in key], np.int32)
            self._materials[key] = wp.array(rows, dtype=wp.int32, device=self.device)
        count, given = len(self.textures), torch_interop.as_array(textures)
        if given is None or given.device.is_cpu:
            places = torch_interop.to_numpy(textures)
            wrong = places[(places < -1) | (places >= count)]
            if wrong.size:
                allowed = f"are -1 for none and 0 to {count - 1}" if count else "is -1 for none alone"
                raise WarpcamError(f"set_textures: textures has {wrong[0]}; allowed {allowed}")
        rows = self._graph_source.make_room("textures")
        with torch_interop.in_order(self.device):
            inputs = [array, self._materials[key], count]
            launch_kernel(pose_kernels.set_textures, (self.num_worlds, len(key)), inputs, [rows], device=self.device)

    def set_time(self, time: float) -> None:
        """Bring all worlds to a time of the file, in its time codes: poses, visibility, sizes, lights, lenses."""
        if isinstance(time, bool) or not isinstance(time, int | float | np.number) or not np.isfinite(time):
            raise WarpcamError(f"set_time: time must be a finite number, got {time!r}")
        with torch_interop.in_order(self.device):
            torch_interop.require_no_capture(self.device, "set_time")
            self._graph_source.set_time(float(time))

    def _check_paths(self, where: str, paths: Any) -> tuple[str, ...]:
        if isinstance(paths, str) or not isinstance(paths, Sequence):
            raise WarpcamError(f'{where}: paths must be a sequence of paths like ["/World/Box"], got {paths!r}')
        if not paths:
            raise WarpcamError(f"{where}: paths is empty; at least one is needed")
        key = tuple(str(path) for path in paths)
        if len(set(key)) < len(key):
            raise WarpcamError(f"{where}: paths names something twice: {list(key)!r}")
        return key

    def _node(self, where: str, path: str) -> int:
        if path not in self._names:
            raise WarpcamError(f"{where}: the scene has no {path!r}; it has: {_some(tuple(self._names))}")
        return self._names[path]

    def _shapes_of(self, where: str, key: tuple[str, ...]) -> tuple[wp.array, wp.array]:
        """For each shape that a path stands for: the path's place, and the shape."""
        if key not in self._groups:
            torch_interop.require_no_capture(self.device, f"{where}, for the first time of these paths")
            groups: list[int] = []
            shapes: list[int] = []
            above = self._ancestors()
            by_name = {name: shape for shape, name in enumerate(self.shapes)}
            for group, path in enumerate(key):
                node = self._names.get(path)
                found = [by_name[path]] if node is None and path in by_name else []
                if node is not None:
                    found = [s for s, item in enumerate(self._graph_source.items) if node in above[item.node]]
                elif not found:
                    self._node(where, path)
                if not found:
                    raise WarpcamError(f"{where}: {path!r} has no shapes that were visible when the scene was read")
                groups += [group] * len(found)
                shapes += found
            self._groups[key] = tuple(
                wp.array(np.array(values, np.int32), dtype=wp.int32, device=self.device) for values in (groups, shapes)
            )
        return self._groups[key]

    def _ancestors(self) -> list[frozenset[int]]:
        """Return, for each frame, itself and all frames above it."""
        above: list[frozenset[int]] = []
        for index, node in enumerate(self._graph_source.graph.nodes):
            above.append((above[node.parent] if node.parent >= 0 else frozenset()) | {index})
        return above

    def _take(self, what: str, value: Any, rest: tuple[Any, ...], dtype: Any) -> wp.array:
        """The value as an array on the scene's device, checked."""
        array = torch_interop.as_array(value)
        kinds = (wp.bool, wp.uint8) if dtype is wp.uint8 else (dtype,)
        if array is not None and not array.device.is_cpu:
            device_rule.require_same(self.device, "the scene is", array.device, what)
        if array is None or array.device != self.device or array.dtype not in kinds:
            if array is not None and array.device == self.device and array.device.is_cuda:
                names = " or ".join(kind.__name__ for kind in kinds)
                raise WarpcamError(f"{what} must be {names}, got {array.dtype.__name__}")
            array = self._upload(what, value, dtype)
        elif array.dtype is wp.bool:
            array = array.view(wp.uint8)
        shape = tuple(array.shape)
        fits = len(shape) == 1 + len(rest) and shape[0] in (1, self.num_worlds)
        if not fits or not all(
            n in (m if isinstance(m, tuple) else (m,)) for n, m in zip(shape[1:], rest, strict=True)
        ):
            wanted = ", ".join(" or ".join(map(str, m)) if isinstance(m, tuple) else str(m) for m in rest)
            raise WarpcamError(f"{what} must have shape ({self.num_worlds} or 1, {wanted}), got {shape}")
        return array

    def _upload(self, what: str, value: Any, dtype: Any) -> wp.array:
        if torch_interop.is_capturing(self.device):
            raise WarpcamError(f"{what}: a capture is under way; give a tensor on {self.device.alias}")
        torch_interop.require_wxyz(value, what)
        try:
            numbers = np.asarray(torch_interop.to_numpy(value))
            allowed = {wp.uint8: "bu", wp.int32: "iu"}.get(dtype, "fiu")
            if numbers.dtype.kind not in allowed:
                raise TypeError
        except (TypeError, ValueError, RuntimeError):
            name = "bool or uint8" if dtype is wp.uint8 else dtype.__name__
            raise WarpcamError(f"{what} must be an array of {name}, got {value!r}") from None
        return wp.array(np.ascontiguousarray(numbers.astype(wp.dtype_to_numpy(dtype))), dtype=dtype, device=self.device)


def _some(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names[:20])) + (f" and {len(names) - 20} more" if len(names) > 20 else "") or "none"
