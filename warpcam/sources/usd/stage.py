"""A stage's tree of prims: what is there, where, and what it is."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdSemantics, UsdShade

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.geometry import Geometry, polar
from warpcam.sources.common.scene_graph import FrameNode, SceneGraph, ShapeInstance
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.attributes import AttributeReader
from warpcam.sources.usd.camera import read_camera
from warpcam.sources.usd.gaussians import KIND, read_splats
from warpcam.sources.usd.gprims import GPRIMS, back_of, read_gprim, update_gprim
from warpcam.sources.usd.instancer import InstancerReader
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
        access: FileAccess,
    ):
        self._stage, self._graph, self._time, self._purposes, self._collector = stage, graph, time, purposes, collector
        self._unit, self._access = unit, access
        self._attributes = AttributeReader(collector)
        self._materials = MaterialReader(graph, self._attributes, collector, access)
        self._meshes = MeshReader(self._materials, double_sided, self._attributes, collector)
        self._strands = PointsAndCurvesReader(self._materials, self._attributes, collector)
        self._instancers = InstancerReader(stage, graph.source, self._attributes, collector)
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
                given = self._attributes.get(prim, "purpose") if authored.IsAuthored() else purpose
                purpose = given if authored.HasAuthoredValue() else purpose
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
        labels = self._labels(prim) or above.labels
        node = FrameNode(name, parent, np.eye(4), instance=above.instance, labels=labels)
        if prim.IsInstance():
            node.instance = len(self._graph.instances)
            self._graph.instances.append(name)
        node.body = RIGID_BODY in prim.GetAppliedSchemas() or prim.GetTypeName() == "Xform"
        index = len(self._graph.nodes)
        self._access.check("copies", index + 1, f"{self._graph.source}: the stage, with all prims of its instances,")
        self._graph.nodes.append(node)
        query = UsdGeom.Xformable(prim)
        moves = bool(query) and not rest and query.TransformMightBeTimeVarying()
        imageable = UsdGeom.Imageable(prim)
        blinks = bool(imageable) and imageable.GetVisibilityAttr().ValueMightBeTimeVarying()

        def update(time: Usd.TimeCode) -> None:
            if query and not rest:
                node.local = self._attributes.transform(query, time)
                node.resets = query.GetResetXformStack()
                if not np.isfinite(node.local).all():
                    self._collector.warn("has a transform that is not finite, and is left out", name)
            if imageable:
                node.visible = self._attributes.get(prim, "visibility", time) != UsdGeom.Tokens.invisible

        if query and not rest:
            self._attributes.check_transform(query)
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
            read, sides = self._attributes, self._meshes.double_sided
            form = self._solids.setdefault(key, read_gprim(prim, self._time, sides, read))
            color, look = self._materials.of_solid(prim, self._time)
            graph.items.append(ShapeInstance(name, node, form, look, color))
            back = back_of(form, prim, sides, read)
            if back is not None:
                graph.items.append(ShapeInstance(f"{name}/back", node, back, look, color))
            if any(attribute.ValueMightBeTimeVarying() for attribute in prim.GetAuthoredAttributes()):
                graph.nodes[node].moves = True
                self._updates.append(lambda time: update_gprim(form, prim, time, read))
        elif prim.IsA(UsdGeom.Camera):
            self._add_live(
                graph.cameras, lambda t: read_camera(prim, node, name, t, self._unit, self._attributes), prim
            )
        elif is_light(prim):
            self._add_live(graph.lights, lambda t: self._light(prim, node, name, t), prim)
            if kind in DOME:
                image = self._attributes.get(prim, "inputs:texture:file", self._time)
                self._materials.images.add_skybox(image, str(prim.GetPath()), self._turn(prim, node))
        elif kind == KIND:
            self._add_splats(prim, node, name)
        elif kind in NOT_DRAWN or kind.startswith("ParticleField"):
            self._collector.warn(f"is of type {kind}, which is not drawn", name)

    def _add_splats(self, prim: Usd.Prim, node: int, name: str) -> None:
        key = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        if key not in self._clouds:
            self._clouds[key] = read_splats(prim, self._time, self._attributes)
        form = self._clouds[key]
        if form is None and self._attributes.refused(prim, "positions", "positionsh"):
            return
        if form is None:
            self._collector.warn("has splats whose arrays are empty or differ in length, and is left out", name)
            return
        self._graph.items.append(ShapeInstance(name, node, form))
        if prim.GetAttribute("positions").ValueMightBeTimeVarying():
            self._collector.warn("has splats that change with time, and is drawn as it is at first", name)

    def _light(self, prim: Usd.Prim, node: int, name: str, time: Usd.TimeCode) -> Any:
        scale = abs(np.linalg.det(self._graph.worlds_of(node)[:3, :3])) ** (1.0 / 3.0)
        turn = self._turn(prim, node) if str(prim.GetTypeName()) in DOME else np.eye(3)
        images = self._materials.images
        return read_light(
            prim,
            node,
            name,
            time=time,
            scale=scale,
            attributes=self._attributes,
            collector=self._collector,
            mean_of=images.mean_of,
            sky_of=lambda asset, where: images.sky_of(asset, where, turn),
        )

    def _turn(self, dome: Usd.Prim, node: int) -> np.ndarray:
        return polar(self._graph.worlds_of(node)[:3, :3])[0] @ pole_of(dome, self._attributes)

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
        placement = self._instancers.place(instancer, self._time)
        if placement is None:
            return
        indices = placement.indices
        self._access.check("copies", len(self._graph.nodes) + len(indices), f"{self._graph.source}: {path}")
        mask = self._instancers.shown(instancer, len(indices), self._time)
        above = self._materials.inherited
        colors = self._instancers.colors(instancer, len(indices), self._time)
        nodes = []
        for place, (which, matrix) in enumerate(zip(indices, placement.matrices, strict=True)):
            own = f"{name}[{place}]"
            instance = FrameNode(own, node, matrix, visible=bool(mask[place]), body=True)
            instance.instance = len(self._graph.instances)
            instance.labels = self._graph.nodes[node].labels
            self._graph.instances.append(own)
            nodes.append((len(self._graph.nodes), instance))
            self._graph.nodes.append(instance)
            prototype = self._stage.GetPrimAtPath(placement.targets[which])
            if not prototype or not prototype.IsActive():
                self._collector.warn("is a prototype that does not exist", str(placement.targets[which]))
                continue
            self._materials.inherited = {
                **above,
                **{key: values[place % len(values)] for key, values in colors.items()},
            }
            self._walk(prototype, nodes[-1][0], f"{own}/{prototype.GetName()}", purpose, (*instancers, path), rest=True)
        self._materials.inherited = above
        if placement.moves:
            for _, instance in nodes:
                instance.moves = True

            def update(time: Usd.TimeCode) -> None:
                matrices = self._instancers.matrices(instancer, indices, time)
                if matrices is None:
                    self._collector.warn("changes its number of instances with time, which stays as it was", name)
                    return
                if not np.array_equal(self._attributes.get(instancer.GetPrim(), "protoIndices", time), indices):
                    self._collector.warn("changes its prototypes with time, and keeps those it had at first", name)
                shown = self._instancers.shown(instancer, len(nodes), time)
                for (_, instance), matrix, visible in zip(nodes, matrices, shown, strict=True):
                    instance.local, instance.visible = matrix, bool(visible)

            self._updates.append(update)

    def _labels(self, prim: Usd.Prim) -> tuple[str, ...]:
        """Semantic labels of a prim's own: UsdSemantics', or those of Omniverse's older schema."""
        labels: list[str] = []
        types = Sdf.ValueTypeNames
        for taxonomy in UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim):
            labels += self._attributes.get(prim, f"semantics:labels:{taxonomy}", expected=types.TokenArray) or ()
        for attribute in prim.GetAuthoredPropertiesInNamespace("semantic"):
            name = str(attribute.GetName())
            if name.endswith(":params:semanticData"):
                label = self._attributes.get(prim, name, expected=types.String)
                labels += [] if label is None else [label]
        return tuple(labels)
