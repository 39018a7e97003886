"""MuJoCo's visual geoms beside geoms: sites, tendons, flexes, skins and slider-cranks.

They are further shapes of the scene. Columns count geoms, sites, tendons, flexes, skins, and actuators where some are
slider-cranks, as the ids of ``segmentation`` do; a tendon, or a flex that is a line, is drawn as several capsules or
cylinders, and a slider-crank as two, whose columns follow on all these.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from warpcam.accel.meshes import Mesh
from warpcam.core.errors import WarpcamError
from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.types import CAPSULE, CYLINDER, MESH, SPHERE
from warpcam.kernels.update.refit import FaceShading
from warpcam.kernels.update.skinning import Shell
from warpcam.scene.source import SceneDescription
from warpcam.sources.mujoco.deformables import flex_surface, skin_surface
from warpcam.sources.mujoco.kernels.visual_geoms import ARC, COPY, CRANK, EDGE, MARK, MOST_PIECES, ROD, SEGMENT, STRING
from warpcam.sources.mujoco.mjv_geoms import MjvGeomClass
from warpcam.sources.mujoco.model import DRAWN, KINDS, VERSION, Groups, groups_by_kind
from warpcam.sources.mujoco.skin_weights import BoneWeights, bone_weights_of, matrix_of, no_bone_weights
from warpcam.sources.mujoco.slider_cranks import colors_of_cranks, count_drives, cranks_of, radius_of_rods
from warpcam.sources.mujoco.tendon_limits import LimitedTendons, find_limited_tendons, string_length

OBJECTS = (
    mujoco.mjtObj.mjOBJ_GEOM,
    mujoco.mjtObj.mjOBJ_SITE,
    mujoco.mjtObj.mjOBJ_TENDON,
    mujoco.mjtObj.mjOBJ_FLEX,
    mujoco.mjtObj.mjOBJ_SKIN,
    mujoco.mjtObj.mjOBJ_ACTUATOR,
    mujoco.mjtObj.mjOBJ_UNKNOWN,  # what stands beside the model
)
MAX_STRING = 100  # points of a tendon that hangs slack
MAX_SLICES = 63  # of half a turn around what a tendon is wrapped around
WRAPPED = (3, 15)  # the version from which on MuJoCo draws tendons around what they are wrapped around
IN_FRAMES = (3, 14)  # the version from which on sites that are meshes have the frames of their files
DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)


@dataclass(frozen=True, eq=False)
class Moved:
    """A flex or a skin: a mesh that moves, one for each world.

    Attributes:
        column: Of the table.
        mesh: Where the model starts.
        hull: How its points are made.
        of_skin: Of the skins' vertices, else of the flexes'.
        shading: Of its faces.
    """

    column: int
    mesh: Mesh
    hull: Shell
    of_skin: bool
    shading: FaceShading


@dataclass(frozen=True, eq=False)
class VisualGeoms:
    """All of it.

    Attributes:
        num_columns: Of the table, with those of the geoms.
        entries: (entry, 4) int32, what is written each frame: see ``kernels.extras.Entries``.
        radii: (entry,) float32.
        lengths: (entry,) float32, of strings and cranks [m].
        crank_colors: (2, 4) float32, see ``kernels.extras.Entries``.
        up: (3,) against gravity, unit.
        num_points_of_string: How many.
        slices: Pieces of half a turn of an arc, 0 where paths have none.
        types: (geom,) int32.
        offsets: (row,) and turns, (row, 3, 3), where in their frames marks stand: as they are, and meshes.
        held: Tendons whose colour tells that a limit holds them.
        sizes: (column, 3) float32, and so on: of the columns beside the geoms' what never changes.
        materials: (column,) int32.
        colors: (column, 4) float32.
        assets: (column,) int32.
        rows: (column,) int64, the geom, site, tendon, flex, skin or actuator of a column, counted through all of these.
        moved: Meshes that move.
        num_points: Of all of these.
        num_skin_vertices: Of all skins.
        bonds: Of these.
        num_decor: Places for what stands beside the model.
    """

    num_columns: int
    entries: np.ndarray
    radii: np.ndarray
    lengths: np.ndarray
    crank_colors: np.ndarray
    up: np.ndarray
    num_points_of_string: int
    slices: int
    types: np.ndarray
    offsets: np.ndarray
    turns: np.ndarray
    held: LimitedTendons | None
    sizes: np.ndarray
    materials: np.ndarray
    colors: np.ndarray
    assets: np.ndarray
    rows: np.ndarray
    moved: Sequence[Moved]
    num_points: int
    num_skin_vertices: int
    bonds: BoneWeights
    num_decor: int

    @property
    def lines(self) -> bool:
        """True if sizes are written each frame."""
        return bool(np.isin(self.entries[:, 0], (SEGMENT, EDGE, STRING, ROD)).any())

    @property
    def kinds(self) -> frozenset[int]:
        """Kinds of the entries."""
        return frozenset(self.entries[:, 0].tolist())

    def reads(self, kind: int) -> bool:
        return kind in self.kinds


def colors_of(mjm: mujoco.MjModel, extras: VisualGeoms) -> np.ndarray:
    """Return the present colours of all columns, (column, 4) float32; alpha 0 draws nothing."""
    drives = np.tile(colors_of_cranks(mjm)[:1], (count_drives(mjm), 1))
    decor = np.zeros((extras.num_decor, 4), np.float32)  # written each frame
    values = (mjm.geom_rgba, mjm.site_rgba, mjm.tendon_rgba, mjm.flex_rgba, mjm.skin_rgba, drives, decor)
    colors = np.concatenate(values)[extras.rows]
    np.maximum(colors[:, 3], 0.0, out=colors[:, 3])
    return colors


def objects(mjm: mujoco.MjModel, num_decor: int = 0) -> np.ndarray:
    """Id and mjtObj of what has each id of ``segmentation``, (id + 1, 2) int32; the last row is for -1, nothing."""
    counts = (*_counts(mjm), num_decor)
    rows = [np.stack((np.arange(n), np.full(n, int(kind))), axis=1) for n, kind in zip(counts, OBJECTS, strict=True)]
    return np.concatenate([*rows, [(-1, -1)]]).astype(np.int32)


def check_kinds(draw: Any) -> frozenset[str]:
    try:
        kinds = [draw] if isinstance(draw, str) else list(draw)
    except TypeError:
        raise WarpcamError(f"draw must be some of {', '.join(DRAWN)}, got {draw!r}") from None
    for kind in kinds:
        if kind not in DRAWN:
            raise WarpcamError(f"draw: {kind!r} came; allowed are {', '.join(DRAWN)}")
    return frozenset(kinds)


def with_visual_geoms(
    parts: SceneDescription,
    mjm: mujoco.MjModel,
    groups: Groups,
    kinds: Collection[str],
    decor: Sequence[MjvGeomClass] = (),
) -> tuple[SceneDescription, VisualGeoms | None]:
    """The scene's parts with what is drawn beside geoms, and that; None where there is nothing of it."""
    if "geoms" not in kinds:
        parts = replace(parts, drawn=[])
    parts = replace(parts, objects=objects(mjm, len(decor)), num_materials=parts.num_materials + len(decor))
    reader = _Reader(mjm, parts, groups_by_kind(groups), kinds, decor)
    reader.read()
    if not reader.drawn:
        return parts, None
    return reader.parts(), reader.extras()


def _counts(mjm: mujoco.MjModel) -> tuple[int, ...]:
    return mjm.ngeom, mjm.nsite, mjm.ntendon, mjm.nflex, mjm.nskin, count_drives(mjm)


class _Reader:
    """Goes through the model once, adding columns."""

    def __init__(
        self,
        mjm: mujoco.MjModel,
        parts: SceneDescription,
        groups: Mapping[str, list[int]],
        kinds: Collection[str],
        decor: Sequence[MjvGeomClass],
    ):
        self._mjm, self._parts, self._kinds, self._decor = mjm, parts, kinds, decor
        self._shown = [groups[kind] for kind in KINDS]
        self._first = np.r_[0, np.cumsum((*_counts(mjm), len(decor)))]
        total = int(self._first[-1])
        self._types, self._ids = np.full(total, SPHERE, np.int32), np.arange(total, dtype=np.int32)
        self._bodies = np.full(total, -1, np.int32)
        self._bodies[: mjm.ngeom], self._types[: mjm.ngeom] = parts.shape_bodies, parts.shape_types
        self._sizes, self._colors = np.zeros((total, 3), np.float32), np.zeros((total, 4), np.float32)
        self._materials, self._assets = np.full(total, -1, np.int32), np.full(total, -1, np.int32)
        self._entries = [(COPY, geom, geom, 0) for geom in parts.drawn]
        self._radii = [0.0] * len(self._entries)
        self._lengths: dict[int, float] = {}
        self._string_points = min(int(mjm.vis.quality.numslices) + 1, MAX_STRING)
        self._slices = min(int(mjm.vis.quality.numslices), MAX_SLICES) if VERSION >= WRAPPED else 0
        self._more: list[tuple[int, int, int]] = []  # columns beyond: type, id, row of what is static
        self._moved: list[Moved] = []
        self._points = 0
        self.drawn: list[int] = []

    def read(self) -> None:
        mjm = self._mjm
        start = mujoco.MjData(mjm)
        mujoco.mj_kinematics(mjm, start)
        mujoco.mj_comPos(mjm, start)
        if mjm.nflex:
            mujoco.mj_flex(mjm, start)
        if "sites" in self._kinds:
            self._read_sites()
        if "tendons" in self._kinds:
            self._read_tendons()
        if "flexes" in self._kinds:
            self._read_flexes(start)
        if "skins" in self._kinds:
            self._read_skins()
        if "actuators" in self._kinds:
            self._read_cranks()
        self._read_decor()

    def parts(self) -> SceneDescription:
        parts = self._parts
        types = np.r_[self._types, [kind for kind, _, _ in self._more]].astype(np.int32)
        ids = np.r_[self._ids, [number for _, number, _ in self._more]].astype(np.int32)
        bodies = np.r_[self._bodies, np.full(len(self._more), -1)].astype(np.int32)
        if self._more:
            worlds = (parts.num_worlds, len(ids))
            parts = replace(
                parts,
                shape_ids=np.ascontiguousarray(np.broadcast_to(ids, worlds)),
                body_ids=np.ascontiguousarray(np.broadcast_to(bodies, worlds)),
            )
        soft = bool(self._moved) or any(kind == EDGE for kind, *_ in self._entries)
        if soft and any(texture != parts.skybox for texture in range(len(parts.textures))):
            parts = replace(parts, flags=parts.flags | SceneFlag.TEXTURELESS_SHAPES)
        meshes = [*parts.meshes, *(part.mesh for part in self._moved for _ in range(parts.num_worlds))]
        drawn = sorted([*parts.drawn, *self.drawn])
        coincident = parts.coincident
        if len(coincident):
            coincident = np.pad(coincident, (0, len(types) - len(coincident)), constant_values=-1)
        bare = {int(self._first[6]) + place for place, kind in enumerate(self._decor) if not kind.casts}
        return replace(
            parts,
            shape_types=types,
            shape_bodies=bodies,
            coincident=coincident,
            drawn=drawn,
            casting=[column for column in drawn if column not in bare] if bare else None,
            meshes=meshes,
        )

    def extras(self) -> VisualGeoms:
        rows = np.r_[np.arange(len(self._types)), [row for _, _, row in self._more]].astype(np.int64)
        entries = np.array(self._entries, np.int32).reshape(-1, 4)
        return VisualGeoms(
            num_columns=len(rows),
            entries=entries,
            radii=np.array(self._radii, np.float32),
            lengths=np.array([self._lengths.get(entry, 0.0) for entry in range(len(self._entries))], np.float32),
            crank_colors=colors_of_cranks(self._mjm),
            up=_up(self._mjm),
            num_points_of_string=self._string_points,
            slices=self._slices,
            types=self._parts.shape_types,
            offsets=np.concatenate((np.zeros((1, 3)), self._mjm.mesh_pos)).astype(np.float32),
            turns=np.stack([np.eye(3), *map(matrix_of, self._mjm.mesh_quat)]).astype(np.float32),
            held=find_limited_tendons(self._mjm, entries),
            sizes=self._sizes[rows],
            materials=self._materials[rows],
            colors=self._colors[rows],
            assets=self._assets[rows],
            rows=rows,
            moved=self._moved,
            num_points=self._points,
            num_skin_vertices=self._mjm.nskinvert,
            bonds=bone_weights_of(self._mjm) if any(part.of_skin for part in self._moved) else no_bone_weights(),
            num_decor=len(self._decor),
        )

    def _read_sites(self) -> None:
        mjm = self._mjm
        meshes = getattr(mjm, "site_dataid", np.full(mjm.nsite, -1))  # older versions have no sites that are meshes
        for site in range(mjm.nsite):
            column = self._column(1, site, mjm.site_group, mjm.site_rgba, mjm.site_matid)
            if column < 0:
                continue
            self._types[column], self._bodies[column] = mjm.site_type[site], mjm.site_bodyid[site]
            self._sizes[column], self._assets[column] = mjm.site_size[site], meshes[site]
            stands = int(meshes[site]) + 1 if mjm.site_type[site] == MESH and VERSION >= IN_FRAMES else 0
            self._add((MARK, column, site, stands), column)

    def _read_tendons(self) -> None:
        mjm = self._mjm
        wrap = mujoco.mjtWrap
        for tendon in range(mjm.ntendon):
            first, count = int(mjm.tendon_adr[tendon]), int(mjm.tendon_num[tendon])
            path = mjm.wrap_type[first : first + count]
            if (path == wrap.mjWRAP_JOINT).any():  # a tendon of joints is no line
                continue
            row = self._column(2, tendon, mjm.tendon_group, mjm.tendon_rgba, mjm.tendon_matid)
            if row < 0:
                continue
            length = string_length(mjm, tendon)
            if length > 0.0:
                for segment in range(self._string_points - 1):
                    column = self._beyond(CAPSULE, row)
                    self._lengths[len(self._entries)] = length
                    self._add((STRING, column, tendon, segment), column, float(mjm.tendon_width[tendon]))
                continue
            around = int(np.isin(path, (wrap.mjWRAP_SPHERE, wrap.mjWRAP_CYLINDER)).sum())
            joined = int(((path[1:] != wrap.mjWRAP_PULLEY) & (path[:-1] != wrap.mjWRAP_PULLEY)).sum())
            lines = [(SEGMENT, number) for number in range(joined + (0 if self._slices else around))]
            lines += [(ARC, piece) for piece in range(around * MOST_PIECES) if piece % MOST_PIECES < self._slices]
            for kind, number in lines:
                column = self._beyond(CAPSULE, row)
                self._add((kind, column, tendon, number), column, float(mjm.tendon_width[tendon]))

    def _read_flexes(self, start: mujoco.MjData) -> None:
        mjm = self._mjm
        for flex in range(mjm.nflex):
            row = self._column(3, flex, mjm.flex_group, mjm.flex_rgba, mjm.flex_matid)
            if row < 0:
                continue
            vertex, radius = int(mjm.flex_vertadr[flex]), float(mjm.flex_radius[flex])
            if mjm.flex_dim[flex] == 1:
                first = int(mjm.flex_edgeadr[flex])
                for a, b in mjm.flex_edge[first : first + mjm.flex_edgenum[flex]]:
                    column = self._beyond(CYLINDER, row)
                    self._add((EDGE, column, vertex + int(a), vertex + int(b)), column, radius)
            else:
                self._move(row, *flex_surface(mjm, start, flex), of_skin=False)

    def _read_skins(self) -> None:
        mjm = self._mjm
        for skin in range(mjm.nskin):
            row = self._column(4, skin, mjm.skin_group, mjm.skin_rgba, mjm.skin_matid)
            if row >= 0:
                self._move(row, *skin_surface(mjm, skin), of_skin=True)

    def _read_cranks(self) -> None:
        mjm, radius = self._mjm, radius_of_rods(self._mjm)
        for drive in cranks_of(mjm):
            row, (pin, slider) = int(self._first[5] + drive), map(int, mjm.actuator_trnid[drive])
            self._types[row], self._colors[row] = CYLINDER, colors_of_cranks(mjm)[0]
            for kind, column, thick in ((ROD, row, radius), (CRANK, self._beyond(CAPSULE, row), 0.5 * radius)):
                self._lengths[len(self._entries)] = float(mjm.actuator_cranklength[drive])
                self._add((kind, column, slider, pin), column, thick)

    def _read_decor(self) -> None:
        for place, kind in enumerate(self._decor):
            column = int(self._first[6]) + place
            self._types[column], self._materials[column] = kind.type, self._mjm.nmat + place
            self._colors[column] = (0.0, 0.0, 0.0, 0.5 if kind.transparent else 1.0)
            self._add((COPY, column, self._mjm.ngeom + place, 0), column)

    def _move(self, row: int, mesh: Mesh, hull: Shell, shading: FaceShading, of_skin: bool) -> None:
        hull = replace(hull, first_point=self._points)
        self._points += hull.num_vertices * (2 if hull.both else 1)
        self._types[row] = MESH
        self._moved.append(Moved(row, mesh, hull, of_skin, shading))
        self.drawn.append(row)

    def _column(self, kind: int, index: int, group: np.ndarray, rgba: np.ndarray, material: np.ndarray) -> int:
        """The column of something, or -1 if it is not to be seen."""
        color = tuple(float(value) for value in rgba[index])
        own = int(material[index])
        by_material = own >= 0 and color == DEFAULT_COLOR
        if min(max(int(group[index]), 0), 5) not in self._shown[kind] or (color[3] <= 0.0 and not by_material):
            return -1
        column = int(self._first[kind]) + index
        self._colors[column], self._materials[column] = color, own
        return column

    def _beyond(self, kind: int, row: int) -> int:
        """Another column of the thing whose own is ``row``."""
        self._more.append((kind, row, row))
        return len(self._types) + len(self._more) - 1

    def _add(self, entry: tuple[int, int, int, int], column: int, radius: float = 0.0) -> None:
        self._entries.append(entry)
        self._radii.append(radius)
        self.drawn.append(column)


def _up(mjm: mujoco.MjModel) -> np.ndarray:
    gravity = np.array(mjm.opt.gravity)
    return -gravity / max(float(np.linalg.norm(gravity)), 1e-15)
