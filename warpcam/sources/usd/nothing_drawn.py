"""Stages that show nothing: the reason of each, and the way out."""

from collections import Counter
from collections.abc import Sequence

from pxr import Usd, UsdGeom

from warpcam.sources.common.scene_graph import SceneGraph


def unloaded(stage: Usd.Stage) -> list[str]:
    """Return the paths of prims whose payloads are not loaded."""
    loaded = set(stage.GetLoadSet())
    return sorted(str(path) for path in stage.FindLoadable() if path not in loaded)


def reason_of_no_shapes(stage: Usd.Stage, purposes: Sequence[str]) -> str:
    """Return the reason why no prim of a stage is drawn."""
    prims = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))
    if not prims:
        masked = stage.GetPopulationMask() != Usd.StagePopulationMask.All()
        way = "open it without a population mask" if masked else "write geometry into it, or give the file that has it"
        return f"the stage is empty, it has no prims; {way}"
    waiting = unloaded(stage)
    if waiting:
        return (
            f"the stage has nothing that can be drawn: payloads are not loaded, {_some(waiting)}; call stage.Load(), "
            "or open the stage without Usd.Stage.LoadNone"
        )
    inactive = [str(prim.GetPath()) for prim in prims if not prim.IsActive()]
    there = [prim for prim in prims if prim.IsActive() and prim.IsDefined() and not prim.IsAbstract()]
    drawable = [prim for prim in there if prim.IsA(UsdGeom.Gprim)]
    others = [prim for prim in drawable if UsdGeom.Imageable(prim).ComputePurpose() not in purposes]
    if others and len(others) == len(drawable):
        found = sorted({str(UsdGeom.Imageable(prim).ComputePurpose()) for prim in others})
        return (
            f"the stage has nothing that can be drawn: its geometry is for {', '.join(map(repr, found))}, "
            f"{_some([str(prim.GetPath()) for prim in others])}; give purposes={(*purposes, *found)}"
        )
    if not there and inactive:
        return (
            f"the stage has nothing that can be drawn: prims are inactive, {_some(inactive)}; call prim.SetActive(True)"
        )
    if not there:
        return (
            "the stage has nothing that can be drawn: it has only classes and overs, which are for other stages; give "
            "the stage that refers to it"
        )
    kinds = Counter(str(prim.GetTypeName()) or "prim without a type" for prim in there)
    listed = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(8))
    if drawable or stage.GetCompositionErrors():
        return f"the stage has nothing that can be drawn: it has {listed}; warnings say what is left out"
    return (
        f"the stage has nothing that can be drawn: it has {listed}; drawn are meshes, solids, points, curves and splats"
    )


def hidden(graph: SceneGraph) -> str:
    """Return the path that hides all shapes of a graph; empty if some are seen, or can be at another time."""
    seen, moving = graph.seen(), graph.moving()
    if not graph.items or any(seen[item.node] or moving[item.node] for item in graph.items):
        return ""
    node = graph.items[0].node
    while graph.nodes[node].visible:
        node = graph.nodes[node].parent
    return graph.nodes[node].name


def _some(paths: Sequence[str]) -> str:
    more = f" and {len(paths) - 3} more" if len(paths) > 3 else ""
    return ", ".join(paths[:3]) + more
