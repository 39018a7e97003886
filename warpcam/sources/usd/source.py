"""OpenUSD: stages, through the `usd-core` package."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom

from warpcam.core import device as device_rule
from warpcam.core.arrays import MAX_EXPOSURE
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.scene.file_scene import DrivenScene
from warpcam.scene.layers import check_tristate
from warpcam.scene.validation import check_num_worlds, check_unit
from warpcam.sources.common.images import named_images
from warpcam.sources.common.scene_graph import FrameNode, SceneGraph
from warpcam.sources.common.scene_graph_source import SceneGraphSource
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.usd.nothing_drawn import hidden, reason_of_no_shapes, unloaded
from warpcam.sources.usd.opening import open_file, opened, short
from warpcam.sources.usd.stage import StageReader

PURPOSES = ("default", "render", "proxy", "guide")
UNITS = (1e-3, 1e4)  # a scene that is smaller or larger than this is likely to have wrong units [m]


def load(
    path_or_stage: Any,
    num_worlds: int,
    *,
    device: Any,
    time: float | None,
    purposes: Sequence[str],
    up_axis: str | None,
    meters_per_unit: float | None,
    double_sided: bool | None,
    semantics: Mapping[str, int] | None,
    textures: Mapping[str, Any],
    exposure: float | None,
    transparency: bool | None,
    access: FileAccess,
) -> DrivenScene:
    check_num_worlds(num_worlds)
    if not isinstance(double_sided, bool | np.bool_ | None):
        raise WarpcamError(f"double_sided must be True, False or None, got {double_sided!r}")
    is_number = isinstance(exposure, int | float | np.number) and not isinstance(exposure, bool)
    if exposure is not None and not (is_number and -math.inf < exposure <= MAX_EXPOSURE):
        raise WarpcamError(f"exposure must be a finite number up to {MAX_EXPOSURE} or None, got {exposure!r}")
    for purpose in purposes if not isinstance(purposes, str) else [purposes]:
        if purpose not in PURPOSES or isinstance(purposes, str):
            raise WarpcamError(f"purposes must be a sequence of {', '.join(map(repr, PURPOSES))}, got {purposes!r}")
    if up_axis not in ("Z", None):
        raise WarpcamError(f'up_axis must be "Z", or None for the stage\'s own axes, got {up_axis!r}')
    check_unit(meters_per_unit)
    check_tristate("transparency", transparency)
    images, where = named_images(textures, access.limits), device_rule.resolve(device)
    stage, name = opened(path_or_stage, access)
    collector = WarningCollector(name)
    try:
        graph = read_graph(stage, name, collector, access, meters_per_unit, up_axis, time, purposes, double_sided)
    finally:
        collector.say()
    for label, image in images.items():
        graph.texture_names.append(label)
        graph.textures.append(image)
    scene = DrivenScene(SceneGraphSource(graph, int(num_worlds), where, semantics, exposure, transparency))
    low, high = scene.bounds()
    size = float(np.linalg.norm(high - low))
    if size > 0.0 and not UNITS[0] <= size <= UNITS[1]:
        unit = float(np.cbrt(abs(np.linalg.det(graph.nodes[0].local[:3, :3]))))
        collector.warn(f"is {size:.3g} m across; if that is wrong, give meters_per_unit, which is {unit:g}")
        collector.say()
    return scene


def read_file(path: Path, collector: WarningCollector, access: FileAccess) -> SceneGraph:
    """Read a file in its own axes, in metres.

    Raises:
        RefusedError: A file lies outside of what may be opened, or something is too large.
        WarpcamError: The file cannot be read, or shows nothing.
    """
    return read_graph(open_file(str(path), access), str(path), collector, access, up_axis=None)


def read_graph(
    stage: Usd.Stage,
    name: str,
    collector: WarningCollector,
    access: FileAccess,
    meters_per_unit: float | None = None,
    up_axis: str | None = "Z",
    time: float | None = None,
    purposes: Sequence[str] = ("default", "render"),
    double_sided: bool | None = None,
) -> SceneGraph:
    """Read a stage; arguments as ``warpcam.from_usd`` has them.

    Raises:
        RefusedError: A texture lies outside of what may be opened, or something is too large.
        WarpcamError: USD cannot read it, or it shows nothing.
    """
    _tell_of_errors(stage, collector)
    unit = _unit(stage, meters_per_unit, collector)
    root = np.diag((unit, unit, unit, 1.0))
    for path in unloaded(stage):
        collector.warn("has payloads that are not loaded, and are not drawn; stage.Load() loads them", path)
    axis = str(UsdGeom.GetStageUpAxis(stage))
    if axis not in ("Y", "Z"):
        collector.warn(f"has upAxis {axis!r}, known are Y and Z, and keeps its own axes")
    if up_axis == "Z" and axis == "Y":
        root = root @ np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)), np.float64)
    graph = SceneGraph(name, [FrameNode("/", -1, root)])
    start = _time(stage, time)
    try:
        StageReader(
            stage,
            graph,
            start,
            purposes=frozenset(purposes),
            double_sided=double_sided,
            unit=unit,
            collector=collector,
            access=access,
        ).read()
    except Tf.ErrorException as error:
        raise WarpcamError(f"{name}: USD cannot read it: {short(error)}") from None
    if not graph.items:
        raise WarpcamError(f"{name}: {reason_of_no_shapes(stage, purposes)}")
    hider = hidden(graph)
    if hider:
        raise WarpcamError(
            f"{name}: has nothing to draw; {len(graph.items)} shapes came, none is visible: {hider} is invisible; make "
            "it visible; scene.set_visible hides it again"
        )
    return graph


def _tell_of_errors(stage: Usd.Stage, collector: WarningCollector) -> None:
    """Cyclic references, files that are not found, and the like: USD leaves such arcs out."""
    for error in stage.GetCompositionErrors():
        collector.warn("is incomplete, USD left something out", " ".join(str(error).split()))


def _unit(stage: Usd.Stage, given: float | None, collector: WarningCollector) -> float:
    if given is not None:
        return float(given)
    unit = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not 0.0 < unit < math.inf:
        raise WarpcamError(f"the stage's metersPerUnit is {unit}; give meters_per_unit, a positive number")
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        collector.warn(
            f"does not say its metersPerUnit; USD's default of {unit:g} is taken unless you give meters_per_unit"
        )
    return unit


def _time(stage: Usd.Stage, time: float | None) -> Usd.TimeCode:
    if time is not None:
        if isinstance(time, bool) or not isinstance(time, int | float) or not math.isfinite(time):
            raise WarpcamError(f"time must be a finite number, got {time!r}")
        return Usd.TimeCode(float(time))
    return Usd.TimeCode(stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else Usd.TimeCode.EarliestTime()
