"""A stage's tree of prims: what is there, where, and what it is."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdSemantics, UsdShade

from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_matrices
from warpcam.sources.common.geometry import Geometry, polar
from warpcam.sources.common.scene_graph import FrameNode, SceneGraph, ShapeInstance
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.camera import read_camera
from warpcam.sources.usd.gaussians import KIND, read_splats
from warpcam.sources.usd.gprims import GPRIMS, back_of, read_gprim, update_gprim
from warpcam.sources.usd.light import DOME, is_light, pole_of, read_light
from warpcam.sources.usd.material import MaterialReader
from warpcam.sources.usd.mesh import MeshReader
from warpcam.sources.usd.points_and_curves import POINT_PRIMS, PointsAndCurvesReader

MAX_DEPTH = 64  # of point instancers in each other
NOT_DRAWN = ("NurbsCurves", "HermiteCurves", "NurbsPatch", "Volume", "ParticleField")
RIGID_BODY = "PhysicsRigidBodyAPI"


class StageReader:
    """Fills a graph, and brings it to other times."""

    def __init__(
        self,
        stage: Usd.Stage,
        graph: SceneGraph,
        time: Usd.TimeCode,
        purposes: frozenset[str],
        double_sided: bool | None,
        unit: float,
        collector: WarningCollector,
    ):
        self._stage, self._graph, self._time, self._purposes, self._collector = stage, graph, time, purposes, collector
        self._unit = unit
        self._materials = MaterialReader(graph, collector)
        self._meshes = MeshReader(self._materials, double_sided, collector)
        self._strands = PointsAndCurvesReader(self._materials, collector)
        self._solids: dict[Sdf.Path, Geometry] = {}
        self._clouds: dict[Sdf.Path, Geometry | None] = {}
        self._updates: list[Callable[[Usd.TimeCode], None]] = []

    def read(self) -> None:
        pseudo_root = self._stage.GetPseudoRoot()
        for child in self._children(pseudo_root):
            self._walk(child, 0, str(child.GetPath()), UsdGeom.Tokens.default_, ())
        self._graph.at_time = self._at_time

    def _at_time(self, time: float) -> None:
        for update in (*self._updates, *self._meshes.updates):
            update(Usd.TimeCode(time))
        self._collector.say()

    @staticmethod
    def _children(prim: Usd.Prim) -> list[Usd.Prim]:
        shown = Usd.PrimDefaultPredicate
        if prim.IsAbstract() or not (prim.IsDefined() or prim.IsPseudoRoot()):  # below a class or an over: a prototype
            shown = Usd.PrimIsActive & Usd.PrimIsLoaded
        return list(prim.GetFilteredChildren(Usd.TraverseInstanceProxies(shown)))

    def _walk(
        self,
        first: Usd.Prim,
        parent: int,
        name: str,
        purpose: str,
        instancers: tuple[Sdf.Path, ...],
        rest: bool = False,
    ) -> None:
        """Read a prim and all below it, in their order.

        Args:
            first: The prim.
            parent: Its frame.
            name: Its path in the graph.
            purpose: Of what is above it.
            instancers: Point instancers that it is inside of.
            rest: Its own pose is in the parent's frame already.
        """
        stack = [(first, parent, name, purpose)]
        while stack:
            prim, parent, name, purpose = stack.pop()
            imageable = UsdGeom.Imageable(prim)
            if imageable:
                authored = imageable.GetPurposeAttr()
                purpose = authored.Get() if authored.HasAuthoredValue() else purpose
            node = self._add_node(prim, parent, name, rest and prim == first)
            if prim.IsA(UsdGeom.PointInstancer):
                self._walk_instances(UsdGeom.PointInstancer(prim), node, name, purpose, instancers)
                continue
            if purpose in self._purposes:
                self._add_content(prim, node, name)
            if not prim.IsA(UsdGeom.Gprim) or any(not c.IsA(UsdGeom.Subset) for c in self._children(prim)):
                children = [c for c in self._children(prim) if not c.IsA(UsdShade.Material)]
                stack += [(child, node, f"{name}/{child.GetName()}", purpose) for child in reversed(children)]

    def _add_node(self, prim: Usd.Prim, parent: int, name: str, rest: bool) -> int:
        above = self._graph.nodes[parent]
        node = FrameNode(name, parent, np.eye(4), instance=above.instance, labels=_labels(prim) or above.labels)
        if prim.IsInstance():
            node.instance = len(self._graph.instances)
            self._graph.instances.append(name)
        node.body = RIGID_BODY in prim.GetAppliedSchemas() or prim.GetTypeName() == "Xform"
        index = len(self._graph.nodes)
        self._graph.nodes.append(node)
        query = UsdGeom.Xformable(prim)
        moves = bool(query) and not rest and query.TransformMightBeTimeVarying()
        imageable = UsdGeom.Imageable(prim)
        blinks = bool(imageable) and imageable.GetVisibilityAttr().ValueMightBeTimeVarying()

        def update(time: Usd.TimeCode) -> None:
            if query and not rest:
                node.local = _matrix(query.GetLocalTransformation(time))
                node.resets = query.GetResetXformStack()
                if not np.isfinite(node.local).all():
                    self._collector.warn("has a transform that is not finite, and is left out", name)
            if imageable:
                node.visible = imageable.GetVisibilityAttr().Get(time) != UsdGeom.Tokens.invisible

        update(self._time)
        if moves or blinks:
            node.moves = True
            self._updates.append(update)
        return index

    def _add_content(self, prim: Usd.Prim, node: int, name: str) -> None:
        graph, kind = self._graph, str(prim.GetTypeName())
        if prim.IsA(UsdGeom.Mesh) or kind == "TetMesh":
            graph.items += self._meshes.read(prim, node, name, self._time)
            if prim.HasAPI(UsdLux.MeshLightAPI):
                self._collector.warn("shines, which meshes do not here", name)
        elif kind in POINT_PRIMS:
            graph.items += self._strands.read(prim, node, name, self._time)
        elif kind in GPRIMS:
            key = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
            form = self._solids.setdefault(key, read_gprim(prim, self._time, self._meshes.double_sided))
            color, look = self._materials.of_solid(prim, self._time)
            graph.items.append(ShapeInstance(name, node, form, look, color))
            back = back_of(form, prim, self._meshes.double_sided)
            if back is not None:
                graph.items.append(ShapeInstance(f"{name}/back", node, back, look, color))
            if any(attribute.ValueMightBeTimeVarying() for attribute in prim.GetAuthoredAttributes()):
                graph.nodes[node].moves = True
                self._updates.append(lambda time: update_gprim(form, prim, time))
        elif prim.IsA(UsdGeom.Camera):
            self._add_live(graph.cameras, lambda t: read_camera(UsdGeom.Camera(prim), node, name, t, self._unit), prim)
        elif is_light(prim):
            self._add_live(graph.lights, lambda t: self._light(prim, node, name, t), prim)
            if kind in DOME:
                self._materials.add_skybox(prim, self._time, self._turn(prim, node))
        elif kind == KIND:
            self._add_splats(prim, node, name)
        elif kind in NOT_DRAWN or kind.startswith("ParticleField"):
            self._collector.warn(f"is of type {kind}, which is not drawn", name)

    def _add_splats(self, prim: Usd.Prim, node: int, name: str) -> None:
        key = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        if key not in self._clouds:
            self._clouds[key] = read_splats(prim, self._time)
        form = self._clouds[key]
        if form is None:
            self._collector.warn("has splats whose arrays are empty or differ in length, and is left out", name)
            return
        self._graph.items.append(ShapeInstance(name, node, form))
        if prim.GetAttribute("positions").ValueMightBeTimeVarying():
            self._collector.warn("has splats that change with time, and is drawn as it is at first", name)

    def _light(self, prim: Usd.Prim, node: int, name: str, time: Usd.TimeCode) -> Any:
        scale = abs(np.linalg.det(self._graph.worlds_of(node)[:3, :3])) ** (1.0 / 3.0)
        turn = self._turn(prim, node) if str(prim.GetTypeName()) in DOME else np.eye(3)
        materials = self._materials
        return read_light(
            prim,
            node,
            name,
            time=time,
            scale=scale,
            collector=self._collector,
            mean_of=materials.mean_of,
            sky_of=lambda a, w: materials.sky_of(a, w, turn),
        )

    def _turn(self, dome: Usd.Prim, node: int) -> np.ndarray:
        return polar(self._graph.worlds_of(node)[:3, :3])[0] @ pole_of(dome)

    def _add_live(self, things: list[Any], read: Callable[[Usd.TimeCode], Any], prim: Usd.Prim) -> None:
        place = len(things)
        things.append(read(self._time))
        if any(attribute.ValueMightBeTimeVarying() for attribute in prim.GetAuthoredAttributes()):

            def update(time: Usd.TimeCode) -> None:
                things[place] = read(time)

            self._updates.append(update)

    def _walk_instances(
        self, instancer: UsdGeom.PointInstancer, node: int, name: str, purpose: str, instancers: tuple[Sdf.Path, ...]
    ) -> None:
        path = instancer.GetPath()
        if path in instancers or len(instancers) >= MAX_DEPTH:
            raise WarpcamError(f"{self._graph.source}: point instancer {path} has itself among its prototypes")
        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        indices = instancer.GetProtoIndicesAttr().Get(self._time)
        indices = np.array([] if indices is None else indices, np.int64)
        if len(indices) == 0:
            return
        if indices.min() < 0 or indices.max() >= len(targets):
            worst = indices.min() if indices.min() < 0 else indices.max()
            raise WarpcamError(
                f"{self._graph.source}: {path}: protoIndices has {worst}; there are {len(targets)} prototypes"
            )
        placed = self._instance_matrices(instancer, indices, self._time)
        if placed is None:
            raise WarpcamError(
                f"{self._graph.source}: {path}: {len(indices)} protoIndices came, with positions, orientations or "
                "scales of another number"
            )
        mask = instancer.ComputeMaskAtTime(self._time) or [True] * len(indices)
        above, colors = self._materials.inherited, self._instance_colors(instancer, len(indices))
        nodes = []
        for place, (which, matrix) in enumerate(zip(indices, placed, strict=True)):
            own = f"{name}[{place}]"
            instance = FrameNode(own, node, matrix, visible=bool(mask[place]), body=True)
            instance.instance = len(self._graph.instances)
            instance.labels = self._graph.nodes[node].labels
            self._graph.instances.append(own)
            nodes.append((len(self._graph.nodes), instance))
            self._graph.nodes.append(instance)
            prototype = self._stage.GetPrimAtPath(targets[which])
            if not prototype or not prototype.IsActive():
                self._collector.warn("is a prototype that does not exist", str(targets[which]))
                continue
            self._materials.inherited = {
                **above,
                **{key: values[place % len(values)] for key, values in colors.items()},
            }
            self._walk(prototype, nodes[-1][0], f"{own}/{prototype.GetName()}", purpose, (*instancers, path), rest=True)
        self._materials.inherited = above
        attributes = (
            instancer.GetProtoIndicesAttr(),
            instancer.GetPositionsAttr(),
            instancer.GetOrientationsAttr(),
            instancer.GetPrim().GetAttribute("orientationsf"),
            instancer.GetScalesAttr(),
            instancer.GetInvisibleIdsAttr(),
        )
        roots = [UsdGeom.Xformable(self._stage.GetPrimAtPath(target)) for target in targets]
        if any(attribute and attribute.ValueMightBeTimeVarying() for attribute in attributes) or any(
            root and root.TransformMightBeTimeVarying() for root in roots
        ):
            for _, instance in nodes:
                instance.moves = True

            def update(time: Usd.TimeCode) -> None:
                matrices = self._instance_matrices(instancer, indices, time)
                if matrices is None:
                    self._collector.warn("changes its number of instances with time, which stays as it was", name)
                    return
                if list(instancer.GetProtoIndicesAttr().Get(time) or []) != list(indices):
                    self._collector.warn("changes its prototypes with time, and keeps those it had at first", name)
                shown = instancer.ComputeMaskAtTime(time) or [True] * len(nodes)
                for (_, instance), matrix, visible in zip(nodes, matrices, shown, strict=True):
                    instance.local, instance.visible = matrix, bool(visible)

            self._updates.append(update)

    def _instance_colors(self, instancer: UsdGeom.PointInstancer, count: int) -> dict[str, np.ndarray]:
        """Display colours and opacities of instances, (count or 1, channels), as far as there are some."""
        found = {}
        for name, channels in (("displayColor", 3), ("displayOpacity", 1)):
            primvar = UsdGeom.PrimvarsAPI(instancer).FindPrimvarWithInheritance(name)
            values = primvar.ComputeFlattened(self._time) if primvar and primvar.HasValue() else None
            if values is not None and len(values):
                if len(values) in (1, count):
                    found[name] = np.asarray(values, np.float64).reshape(-1, channels)
                else:
                    self._collector.warn(f"has {name} of another number than its instances", str(instancer.GetPath()))
        return found

    def _instance_matrices(
        self, instancer: UsdGeom.PointInstancer, indices: np.ndarray, time: Usd.TimeCode
    ) -> np.ndarray | None:
        """Return each instance's matrix, (instance, 4, 4), in the instancer's frame; None if they differ.

        It includes the prototype's own matrix.

        USD's own function leaves quaternions of half precision as long as they are, which is a stretch.
        """
        positions = np.array(instancer.GetPositionsAttr().Get(time) or [], np.float64).reshape(-1, 3)
        count = len(indices)
        turns = instancer.GetPrim().GetAttribute("orientationsf")
        given = (turns.Get(time) if turns else None) or instancer.GetOrientationsAttr().Get(time) or []
        quaternions = np.array([(q.GetReal(), *q.GetImaginary()) for q in given] or [(1.0, 0.0, 0.0, 0.0)] * count)
        scales = np.array(instancer.GetScalesAttr().Get(time) or np.ones((count, 3)), np.float64)
        if len(positions) != count or len(quaternions) != count or len(scales) != count:
            return None
        matrices = np.tile(np.eye(4), (count, 1, 1))
        matrices[:, :3, :3] = rotation_matrices(quaternions.reshape(-1, 4)) * scales[:, None, :]
        matrices[:, :3, 3] = positions
        own = [np.eye(4)]
        for target in instancer.GetPrototypesRel().GetForwardedTargets():
            root = UsdGeom.Xformable(self._stage.GetPrimAtPath(target))
            own.append(_matrix(root.GetLocalTransformation(time)) if root else np.eye(4))
        return matrices @ np.array(own[1:])[indices]


def _matrix(matrix: Any) -> np.ndarray:
    """Column vectors instead of USD's rows."""
    return np.array(matrix, np.float64).T


def _labels(prim: Usd.Prim) -> tuple[str, ...]:
    """Semantic labels of a prim's own: UsdSemantics', or those of Omniverse's older schema."""
    labels: list[str] = []
    first = Usd.TimeCode.EarliestTime()
    for taxonomy in UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim):
        labels += [str(label) for label in UsdSemantics.LabelsAPI(prim, taxonomy).GetLabelsAttr().Get(first) or []]
    for attribute in prim.GetAuthoredPropertiesInNamespace("semantic"):
        if attribute.GetName().endswith(":params:semanticData") and isinstance(attribute, Usd.Attribute):
            label = attribute.Get(first)
            labels += [] if label is None else [str(label)]
    return tuple(labels)
