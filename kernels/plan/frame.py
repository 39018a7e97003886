"""Plan of a frame: buffers, passes and kernels that draw the images of one camera.

``plan_frame`` is the one place that decides which kernels run. Passes compile and bind what is planned, memory is
counted from the plan.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import warp as wp

from warpcam.kernels.flags import TRAVERSED, ShadingFlag, geometry_of
from warpcam.kernels.outputs import OUTPUTS, lit_outputs, traced_as
from warpcam.kernels.plan import edges, film, history, launches, occlusion, paths, shading, shadow, splats, trace
from warpcam.kernels.plan.buffers import INDIRECT, LIT_PIXELS, REFLECTIONS, planned_buffers
from warpcam.kernels.plan.derived import DerivedKey, plan_derived
from warpcam.kernels.plan.edges import EdgeKey
from warpcam.kernels.plan.film import FilmKey
from warpcam.kernels.plan.occlusion import OccluderKey, OcclusionFilterKey, OcclusionKey
from warpcam.kernels.plan.passes import PASSES, pass_of
from warpcam.kernels.plan.paths import IndirectFilterKey, IndirectKey, PathKey, PathListKey, ReflectionKey
from warpcam.kernels.plan.planned_pass import Arrays, Passes, PlannedPass
from warpcam.kernels.plan.request import BUFFER, ImageRequest
from warpcam.kernels.plan.shading import ShadingKey
from warpcam.kernels.plan.shadow import ShadowKey
from warpcam.kernels.plan.splats import SplatKey
from warpcam.kernels.plan.trace import InViewKey, ListKey, MirrorKey, TraceKey
from warpcam.kernels.plan.words import describe
from warpcam.kernels.runtime.launch import Group, MeshReads
from warpcam.kernels.scene_tables import SceneTables

KernelKey = (
    ListKey | InViewKey | TraceKey | ShadowKey | MirrorKey | ShadingKey | EdgeKey | SplatKey | DerivedKey
    | PathListKey | PathKey | ReflectionKey | IndirectKey | IndirectFilterKey
    | OccluderKey | OcclusionKey | OcclusionFilterKey | FilmKey
)  # fmt: skip

Result = TypeVar("Result")

VISIBLE = ("depth", "shape", "face")  # arrays of the trace that later passes read
FINE = "finer "  # names of finer images and of their buffers, in the camera's scratch memory, begin with this


@dataclass(frozen=True)
class FramePlan:
    """Passes and buffers of one camera.

    Attributes:
        lists: Kernel that writes views and lists shapes for the trace; None where views alone are written.
        list_rows: Rows of four words, for each world, of such a list, or of one of the shapes in view.
        buffers: Names and dtypes of the images between the passes that are no outputs.
        visibility: Passes up to those that find what is seen and what lies in shadows.
        shading: The rest; nothing else writes the images of ``late``.
        late: Outputs that only the passes of ``shading`` write, which may wait for other worlds.
        mirrors: The images show mirrors.
        in_place: Edges are smoothed where the images lie.
        fine: Plan of lit images that are drawn finer, whose means are the camera's; None where none is.
        parts: Parts of a pixel, across and down, that are pixels of the finer images.
        paths: Lit images are traced by paths of light.
        film: Names, dtypes and sizes, down and across, of buffers between an image's light and what is shown of it.
    """

    lists: ListKey | None
    list_rows: int
    buffers: tuple[tuple[str, Any], ...]
    visibility: Passes
    shading: Passes
    late: frozenset[str]
    mirrors: bool
    in_place: bool
    fine: "FramePlan | None" = None
    parts: tuple[int, int] = (1, 1)
    paths: bool = False
    film: tuple[tuple[str, Any, tuple[int, int]], ...] = ()

    @property
    def passes(self) -> Passes:
        """Passes that read and write images and buffers of the camera's size, in the order of their launches."""
        return (*self.visibility, *self.shading)

    def scratch(self, width: int, height: int) -> Iterator[tuple[str, Any, tuple[int, int]]]:
        """Yield name, dtype and size, down and across, of each buffer of a camera of that size [pixels]."""
        for name, dtype in self.buffers:
            yield name, dtype, (height, width)
        yield from self.film
        if self.fine is not None:
            across, down = self.parts
            size = (down * height, across * width)
            for name, dtype in self.fine.buffers:
                yield FINE + name, dtype, size
            drawn = {name for each in self.fine.passes for _, name in each.arrays}
            yield from ((FINE + name, dtype, size) for name, dtype in LIT_PIXELS.items() if name in drawn)

    @property
    def reflects(self) -> bool:
        """Rays find what surfaces mirror, or the light that comes from shapes."""
        own = any(name in (REFLECTIONS, INDIRECT) for name, _ in self.buffers)
        return own or (self.fine is not None and self.fine.reflects)

    @property
    def keys(self) -> tuple[KernelKey, ...]:
        """Kernels of the frame that have variants, each once, in the order of launches."""
        found = [*(self.fine.keys if self.fine else ()), self.lists, *(each.key for each in self.passes)]
        return tuple(dict.fromkeys(key for key in found if key is not None))

    def __str__(self) -> str:
        lines = [describe("views" if self.lists is None else "views and lists of shapes", self.lists)]
        lines += [] if self.fine is None else [f"finer image: {line}" for line in str(self.fine).splitlines()]
        return "\n".join(dict.fromkeys([*lines, *(describe(each.name, each.key) for each in self.passes)]))


NOTHING = FramePlan(None, 0, (), (), (), frozenset(), mirrors=False, in_place=False)


def merged(plans: Iterable[FramePlan]) -> FramePlan:
    """One plan with the passes of all, each once: groups of other sizes may have other kernels."""
    plans = list(plans)
    fine = [plan.fine for plan in plans if plan.fine is not None]
    return replace(
        plans[0],
        visibility=tuple(dict.fromkeys(each for plan in plans for each in plan.visibility)),
        shading=tuple(dict.fromkeys(each for plan in plans for each in plan.shading)),
        fine=merged(fine) if fine else None,
    )


def plan_frame(tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group | None = None) -> FramePlan:
    """Plan the frame of one camera.

    Args:
        tables: The scene.
        request: What is asked for.
        device: Where it is drawn.
        group: Worlds that are drawn together; None is all. The kernels' regions depend on it, the buffers do not.
    """
    if request.needs_film:
        return _plan_film(tables, request, device, group)
    if request.paths and lit_outputs(request.outputs):
        return _plan_paths(tables, request, device, group)
    if request.parts != (1, 1):
        return _plan_supersampled(tables, request, device, group)
    group = Group.of_all(tables.num_worlds) if group is None else group
    lit, smooth = lit_outputs(request.outputs), request.smooth
    transparent = tables.layers is not None and tables.layers.has_transparent and bool(lit)
    mirrors = tables.layers is not None and tables.layers.has_mirrors and bool(lit)
    mirrors = mirrors and request.lens not in launches.TABLES
    capacity = 0 if transparent else trace.capacity_of(tables, request, device)
    in_view = trace.chooses_in_view(tables, request, device)
    in_place = bool(smooth) and edges.in_place(tables, request, device)
    buffers = planned_buffers(tables, request, device, transparent, mirrors, () if in_place else smooth)
    planner = _Planner(
        tables, request, device, group, buffers=buffers, mirrors=mirrors, listed=capacity > 0, in_view=in_view
    )
    rest = tuple(name for name in request.outputs if name not in lit)
    if transparent:  # what is seen through is not where the other outputs have it
        sets = [(rest, False), (lit, True)] if rest else [(lit, True)]
        visibility = tuple(each for names, opaque in sets for part in planner.plan(names, opaque) for each in part)
        last: Passes = ()
    else:
        visibility, last = planner.plan((*lit, *rest), False)
    if in_view:
        key = trace.plan_in_view(tables, request, device)
        visibility = (PlannedPass("shapes in view", key, launches.THREADS, reads=MeshReads.FACES), *visibility)
    return FramePlan(
        lists=trace.plan_list(tables, request, device) if capacity else None,
        list_rows=trace.in_view_rows(tables) if in_view else trace.rows_of(capacity, request.outputs),
        buffers=tuple(buffers.items()),
        visibility=visibility,
        shading=last,
        late=frozenset() if transparent or smooth else _late(tables, request),
        mirrors=mirrors,
        in_place=in_place,
    )


def _plan_film(tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group | None) -> FramePlan:
    """Plan light, and what is shown of it when that of the whole image is there."""
    drawn = plan_frame(tables, request.undeveloped, device, group)
    last = tuple(film.plan_passes(request))
    return replace(drawn, shading=(*drawn.shading, *last), late=frozenset(), film=film.plan_buffers(request))


def _plan_paths(tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group | None) -> FramePlan:
    """Plan lit images by the path tracer, and the other outputs as they always are."""
    rest = plan_frame(tables, request.unlit, device, group) if request.unlit.outputs else NOTHING
    images = tuple((name, name) for name in lit_outputs(request.outputs))
    traced = (
        PlannedPass("path shapes", paths.plan_list(tables, request, device), paths.LIST_THREADS),
        PlannedPass("paths", paths.plan_paths(tables, request, device), request.width * request.height, images),
    )
    return replace(rest, shading=(*rest.shading, *traced), late=frozenset(), paths=True)


def _plan_supersampled(tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group | None) -> FramePlan:
    """Plan lit images as the means of finer ones, and the other outputs by themselves."""
    sharp = plan_frame(tables, request.sharp, device, group) if request.sharp.outputs else NOTHING
    pixels = request.width * request.height
    means = (
        PlannedPass("mean of parts", None, pixels, (("parts", FINE + name), ("mean", name)), MeshReads.FACES)
        for name in request.smooth
    )
    return replace(
        sharp,
        shading=(*sharp.shading, *means),
        late=frozenset(),  # finer images are drawn beside those of other worlds
        fine=plan_frame(tables, request.fine, device, group),
        parts=request.parts,
    )


def _late(tables: SceneTables, request: ImageRequest) -> frozenset[str]:
    """Outputs that only the last passes write, in scenes without transparent shapes and smooth edges.

    With transparent shapes there are two traces, one after the other. Edges are best smoothed beside the trace of other
    worlds, and not after that of all.
    """
    derived = frozenset(name for name in request.outputs if traced_as(name, tables.shape_types) is None)
    # Without meshes and height fields the trace may write albedo.
    return derived if geometry_of(tables.shape_types) & TRAVERSED else derived - {"albedo"}


@dataclass(frozen=True)
class _Planner:
    """Plans the passes that make some of a camera's outputs."""

    tables: SceneTables
    request: ImageRequest
    device: wp.Device
    group: Group
    buffers: Mapping[str, Any]
    mirrors: bool
    listed: bool
    in_view: bool

    def plan(self, outputs: Sequence[str], opaque: bool) -> tuple[Passes, Passes]:
        """Passes of visibility and of shading; ``opaque``: of what is seen without transparent shapes."""
        tables, request = self.tables, self.request
        arrays, derived = self._traced(outputs)
        written = dict(arrays)
        seen = tuple((role, name) for role, name in arrays if role in VISIBLE)
        lit = lit_outputs(derived)
        shadows = ((("shadow", f"{BUFFER}shadow"),) if f"{BUFFER}shadow" in self.buffers else ()) if lit else ()
        smooth = tuple(name for name in request.smooth if name in derived)
        lit_into = {name: f"{BUFFER}lit {name}" for name in smooth if f"{BUFFER}lit {name}" in self.buffers}

        first = [self._trace(arrays, opaque)]
        if shadows:
            first.append(self._pass("shadow", self._plan(shadow.plan_shadow), (*seen, *shadows)))
        visible: Arrays = ()
        if lit and f"{BUFFER}visible" in self.buffers:
            first += self._occlusion(seen)
            visible = (("visible", f"{BUFFER}visible"),)
        indirect = (("indirect", INDIRECT),) if lit and INDIRECT in self.buffers else ()
        if indirect:
            first += self._indirect(seen)
        last: list[PlannedPass[Any]] = []
        reflecting = self.mirrors and bool(lit)
        colors = tuple((name, lit_into.get(name, name)) for name in lit)
        if reflecting:
            last += self._mirrors(colors, written)
        shaded = tuple((name, lit_into.get(name, name)) for name in derived if name in PASSES["shading"].writes)
        if shaded:
            write_back = bool(smooth) and opaque and tables.physical is None and tables.splats is None
            shares = occlusion.shares_of(tables, request) if visible else ShadingFlag(0)
            mixed = ((("reflections", REFLECTIONS),) if REFLECTIONS in self.buffers else ()) if lit else ()
            if mixed:
                last += self._reflections((*seen, *mixed), listed=bool(indirect))
            more = {"write_back": write_back, "reflections": bool(mixed), "indirect": bool(indirect)}
            launch = self._shading(shaded, bool(shadows), shares=shares, mirrors=reflecting, **more)
            used = (*seen, *shadows, *visible, *indirect, *mixed, *shaded)
            clear = tables.layers is None or not tables.layers.has_transparent
            last.append(self._pass("shading", launch, used, MeshReads.NORMALS if clear else MeshReads.TREES))
        if smooth:
            bytes_each = self._dtype(written["shape"]) is wp.int8
            images = tuple((f"smooth {name}", name) for name in smooth)
            smoothing = self._plan(edges.plan_edges, byte_ids=bytes_each)
            last.append(self._pass("smooth edges", smoothing, (*seen, *colors, *images)))
        others = dict.fromkeys(pass_of(name).name for name in derived if name not in PASSES["shading"].writes)
        for name in others:
            images = tuple((output, output) for output in derived if output in PASSES[name].writes)
            deriving = plan_derived(tables, request, self.device)
            last.append(self._pass(name, deriving, (*seen, *images), MeshReads.NORMALS))
        if tables.splats is not None:
            first.insert(0, PlannedPass("check of Gaussians", None, 1, reads=MeshReads.FACES))
            last.append(self._splats(outputs, written))
        return tuple(first), tuple(last)

    def _traced(self, outputs: Sequence[str]) -> tuple[Arrays, list[str]]:
        """Arrays that the trace writes, and the outputs that later passes derive."""
        names = {name: traced_as(name, self.tables.shape_types) for name in outputs}
        images = {role: name for name, role in names.items() if role is not None}
        derived = [name for name, role in names.items() if role is None]
        if self.tables.ids_by_world and "shape" in images:  # asked for are ids; later passes read columns
            images["ids"] = images.pop("shape")
        if "albedo" in derived and self._plan(trace.traces_albedo, images=images):
            images["albedo"] = "albedo"
            derived.remove("albedo")
        if self.request.lens in launches.TABLES:
            images = _swapped(images)
        for role in VISIBLE:
            if role not in images and BUFFER + role in self.buffers:
                images[role] = BUFFER + role
        return tuple(images.items()), derived

    def _trace(self, arrays: Arrays, opaque: bool) -> PlannedPass[Any]:
        roles, flags = [role for role, _ in arrays], shading.traced_albedo_flags(self.tables)
        launch = self._plan(
            trace.plan_trace, images=roles, flags=flags, opaque=opaque, listed=self.listed, in_view=self.in_view
        )
        return self._pass("trace", launch, arrays, trace.reads_of(self.tables, self.request, launch.key))

    def _path_shapes(self) -> PlannedPass[Any]:
        key = paths.plan_list(self.tables, self.request, self.device)
        return PlannedPass("path shapes", key, paths.LIST_THREADS)

    def _reflections(self, arrays: Arrays, listed: bool) -> list[PlannedPass[Any]]:
        """Passes that find what smooth surfaces mirror and what is seen through clear ones; ``listed``: shapes are."""
        rays, mean = paths.plan_reflections(self.tables, self.request, self.device)
        pixels = self.request.width * self.request.height
        arrays += (("glossy", f"{BUFFER}glossy"), ("glossy_share", f"{BUFFER}glossy share"))
        traced: list[PlannedPass[Any]] = [
            PlannedPass("reflections", rays, pixels, arrays),
            PlannedPass("reflection filter", mean, pixels, arrays),
        ]
        return traced if listed else [self._path_shapes(), *traced]

    def _indirect(self, seen: Arrays) -> list[PlannedPass[Any]]:
        """Passes that find the light that comes from shapes to the surface of each pixel."""
        rays, mean = paths.plan_indirect(self.tables, self.request, self.device)
        pixels, arrays = self.request.width * self.request.height, (*seen, ("indirect_rays", f"{BUFFER}indirect rays"))
        return [
            self._path_shapes(),
            PlannedPass("indirect rays", rays, pixels, arrays),
            PlannedPass("indirect filter", mean, pixels, (*arrays, ("indirect", INDIRECT))),
        ]

    def _occlusion(self, seen: Arrays) -> list[PlannedPass[Any]]:
        """Passes that find what share of light reaches the surface of each pixel."""
        keys = occlusion.plan_occlusion(self.tables, self.request, self.device)
        pixels, rays = self.request.width * self.request.height, (*seen, ("rays", f"{BUFFER}rays"))
        return [
            PlannedPass("occluders", keys[0], occlusion.LIST_THREADS),
            PlannedPass("occlusion rays", keys[1], pixels, rays),
            PlannedPass("occlusion filter", keys[2], pixels, (*rays, ("visible", f"{BUFFER}visible"))),
        ]

    def _mirrors(self, colors: Arrays, written: Mapping[str, str]) -> list[PlannedPass[Any]]:
        """Passes that draw into the images what mirrors show; the mirrors' own colour comes on top."""
        mirrored = tuple((role, name) for role in VISIBLE if (name := f"{BUFFER}mirror {role}") in self.buffers)
        seen = (("seen depth", written["depth"]), ("seen shape", written["shape"]))
        faces = "face" in dict(mirrored)
        return [
            PlannedPass("mirrors", None, 1),
            self._pass("trace in mirrors", self._plan(trace.plan_mirror, faces=faces), (*seen, *mirrored)),
            self._pass("shading", self._shading(colors, False, mirrors=True, mirrored=True), (*mirrored, *colors)),
        ]

    def _shading(self, images: Arrays, shadows: bool, **how: Any) -> launches.PlannedLaunch[ShadingKey]:
        return self._plan(shading.plan_shading, outputs=[name for name, _ in images], shadows=shadows, **how)

    def _splats(self, outputs: Sequence[str], written: Mapping[str, str]) -> PlannedPass[Any]:
        images = {name: name for name in outputs if name in splats.IMAGES or name in history.OUTPUTS}
        if self.request.lens in launches.TABLES:
            images = _swapped(images)
        launch = splats.plan_splats(self.tables, self.request, self.device, images=tuple(images))
        seen = (("seen depth", written["depth"]), ("seen shape", written["shape"]))
        return self._pass("Gaussians", launch, (*seen, *images.items()), MeshReads.FACES)

    def _plan(self, plan: Callable[..., Result], **more: Any) -> Result:
        """Call a plan whose arguments are scene, request, device and group, and more of its own."""
        return plan(self.tables, self.request, self.device, self.group, **more)

    def _pass(
        self,
        name: str,
        launch: launches.PlannedLaunch[Any],
        arrays: Arrays,
        reads: MeshReads = MeshReads.TREES,
    ) -> PlannedPass[Any]:
        return PlannedPass(name, launch.key, launch.threads, arrays, reads)

    def _dtype(self, name: str) -> Any:
        return self.buffers[name] if name.startswith(BUFFER) else OUTPUTS[name].dtype


def _swapped(images: Mapping[str, str]) -> dict[str, str]:
    """Rename images for a trace by a ray table, whose depth is the distance along the ray."""
    names = {"depth": "distance", "distance": "depth"}
    return {names.get(role, role): name for role, name in images.items()}
