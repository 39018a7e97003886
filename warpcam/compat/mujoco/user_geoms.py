"""Geoms of MuJoCo's abstract scene that are not the model's own.

They are those that MuJoCo or a program adds, or that were written.

Contact points and forces, joints, frames and the like come with the category of decor; what a program adds follows on
what ``mjv_updateScene`` has made.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from warpcam.compat.mujoco import mjv_scene
from warpcam.compat.mujoco.frame_renderer import Style
from warpcam.compat.mujoco.gl_camera import GlCamera
from warpcam.compat.mujoco.screen_lines import line_pieces
from warpcam.core.errors import WarpcamError
from warpcam.kernels.passes.mirrors import OPAQUE_ABOVE
from warpcam.kernels.types import BOX, CAPSULE, CONE, CYLINDER, ELLIPSOID, HEIGHT_FIELD, MESH, PLANE, SPHERE
from warpcam.sources.mujoco.mjv_geoms import MjvGeoms, Pair

GEOM = mujoco.mjtGeom
DECOR = int(mujoco.mjtCatBit.mjCAT_DECOR)
OBJECT = mujoco.mjtObj
ROLE = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
PLACED = int(mujoco.mjtLightType.mjLIGHT_SPOT), int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
HEAD = 1.75  # of an arrow, as wide as this times its shaft
BOXES_WIDTH = 1.5  # of the edges of a box of lines [line widths]
UNLIT = 1024.0  # emission of what light does not change; its colour is as many times darker, so that light adds nothing
NOTHING = tuple(int(getattr(GEOM, f"mjGEOM_{name}")) for name in ("LABEL", "NONE"))
SOFT = tuple(int(getattr(GEOM, f"mjGEOM_{name}")) for name in ("FLEX", "SKIN"))
FROM_STATES = (
    "flexes and skins are drawn of a state, not of a scene: call update_scene(data, camera, scene_option) in place of "
    "mujoco.mjv_updateScene, and write what they show into the model and the data"
)


class UserGeoms:
    """A scene as ``mjv_updateScene`` has just made it.

    Args:
        model: What it was made from.
        scene: The scene.
    """

    def __init__(self, model: mujoco.MjModel, scene: mujoco.MjvScene):
        self._model, self._scene = model, scene
        self._geoms, self._lights = mjv_scene.geoms_of(scene), mjv_scene.lights_of(scene)
        self._soft = mjv_scene.soft_of(scene)

    def drawn(self, view: GlCamera, height: int, style: Style, *, solid: bool) -> tuple[Style, MjvGeoms | None]:
        """Return how to draw the present scene: the style of the model, and the geoms beside it, or None for nothing.

        Args:
            view: From where it is looked at: lines are as wide as pixels.
            height: Of the image [pixels].
            style: How the picture is made.
            solid: For an image of ids, or of depth that MuJoCo draws like one.

        Raises:
            WarpcamError: Something of the scene is not drawn here.
        """
        own, geoms, lights = self._geoms, mjv_scene.geoms_of(self._scene), mjv_scene.lights_of(self._scene)
        some = min(len(own), len(geoms))
        chosen = np.ones(len(geoms), bool)
        chosen[:some] = own["category"][:some] == DECOR
        hidden = np.zeros(0, np.int64)
        if self._soft != mjv_scene.soft_of(self._scene):
            raise WarpcamError(
                f"what the scene holds of flexes and skins was written after update_scene; {FROM_STATES}"
            )
        if some < len(own) or not mjv_scene.same_all(own, geoms[:some]):
            written = np.ones(len(own), bool)
            written[:some] = ~mjv_scene.same(own[:some], geoms[:some])
            written &= own["category"] != DECOR
            numbers = self._numbers(np.flatnonzero(written))
            if numbers is None:
                return drawn_alone(self._model, self._scene, view, height, style, solid=solid)
            chosen[:some] |= written[:some]
            hidden = numbers
        lit = not mjv_scene.same_all(self._lights, lights)
        if not (chosen.any() or len(hidden) or lit):
            return style, None
        reader = _Reader(self._model, geoms, lights, view=view, height=height, style=style, solid=solid)
        return style, reader.read(chosen, hidden, lights if lit else None)

    def _numbers(self, written: np.ndarray) -> np.ndarray | None:
        """Return the numbers of geoms, counted after the model's geoms and sites.

        None if others are among what was written.
        """
        kinds, ids = self._geoms["objtype"][written], self._geoms["objid"][written].astype(np.int64)
        geoms, sites = kinds == int(OBJECT.mjOBJ_GEOM), kinds == int(OBJECT.mjOBJ_SITE)
        soft = np.flatnonzero(np.isin(self._geoms["type"][written], SOFT))
        if len(soft):
            what = OBJECT(int(kinds[soft[0]])).name.removeprefix("mjOBJ_").lower()
            raise WarpcamError(
                f"scene.geoms[{written[soft[0]]}], of a {what}, was written after update_scene; {FROM_STATES}"
            )
        if not (geoms | sites).all():
            return None
        return ids + np.where(sites, self._model.ngeom, 0)


def drawn_alone(
    model: mujoco.MjModel, scene: mujoco.MjvScene, view: GlCamera, height: int, style: Style, *, solid: bool
) -> tuple[Style, MjvGeoms]:
    """Return how to draw a scene of unknown state, such as one that a program made: all geoms stand beside the model.

    The style that is returned draws nothing of the model; see ``UserGeoms.drawn``.
    """
    geoms, lights = mjv_scene.geoms_of(scene), mjv_scene.lights_of(scene)
    bare = replace(style, groups=Style().groups, draw=(), model_transparency=False)
    reader = _Reader(model, geoms, lights, view=view, height=height, style=bare, solid=solid)
    return bare, reader.read(np.ones(len(geoms), bool), np.zeros(0, np.int64), lights)


class _Reader:
    """Makes shapes of geoms."""

    def __init__(
        self,
        model: mujoco.MjModel,
        geoms: np.ndarray,
        lights: np.ndarray,
        view: GlCamera,
        height: int,
        style: Style,
        solid: bool,
    ):
        self._model, self._geoms, self._view, self._height = model, geoms, view, height
        self._solid, self._smooth = solid, style.antialiasing > 1 and not solid
        casting = (lights["castshadow"] != 0) & np.isin(lights["type"], PLACED)
        self._casting = int(casting.sum()) if style.shadows else 0
        self._rows: list[dict[str, np.ndarray]] = []

    def read(self, chosen: np.ndarray, hidden: np.ndarray, lights: np.ndarray | None) -> MjvGeoms:
        geoms = self._geoms
        numbers = geoms["size"], geoms["pos"], geoms["mat"].reshape(-1, 9), geoms["rgba"]
        finite = np.isfinite(np.concatenate(numbers, axis=1)).all(axis=1)
        there = chosen & finite & ~np.isin(geoms["type"], NOTHING)
        labelled = np.flatnonzero(chosen & (geoms["label"][:, 0] != 0))
        if len(labelled):
            label = bytes(geoms["label"][labelled[0]]).split(b"\0")[0].decode(errors="replace")
            raise WarpcamError(f"scene.geoms[{labelled[0]}].label is {label!r}: text is not drawn; allowed is ''")
        for kind in np.unique(geoms["type"][there]).tolist():
            if kind not in READERS:
                what = f"scene.geoms[{np.argmax(there & (geoms['type'] == kind))}].type is {_name(kind)}"
                if kind in SOFT:
                    raise WarpcamError(f"{what}, beside what update_scene has taken; {FROM_STATES}")
                allowed = ", ".join(_name(known) for known in READERS)
                raise WarpcamError(f"{what}, which warpcam does not draw; allowed are {allowed}")
            READERS[kind](self, np.flatnonzero(there & (geoms["type"] == kind)))
        mjv_geoms = self._joined(chosen, hidden, lights)
        mjv_geoms = mjv_geoms.some(mjv_geoms.has_form())
        return mjv_geoms.solid() if self._solid else mjv_geoms.some(mjv_geoms.colors[:, 3] > 0.0)

    def add(self, of: np.ndarray, kind: int, sizes: Any, along: Any = 0.0, flip: bool = False, **more: Any) -> None:
        """Shapes of one type for some geoms.

        Args:
            of: (n,) which geoms.
            kind: Their type.
            sizes: (n, 3).
            along: (n,) how far along the geom's z axis they stand [m].
            flip: Whether they stand the other way up.
            more: Rows of a ``MjvGeoms`` that are others than the geom's.
        """
        geoms = self._geoms[of]
        turns = geoms["mat"] * ((1.0, -1.0, -1.0) if flip else 1.0)
        positions = geoms["pos"] + np.asarray(along).reshape(-1, 1) * geoms["mat"][:, :, 2]
        row = {
            "types": np.full(len(of), kind),
            "positions": positions,
            "rotations": turns,
            "sizes": np.asarray(sizes),
            "assets": np.full(len(of), -1),
            "colors": geoms["rgba"],
            "finishes": np.stack([geoms[name] for name in ("emission", "specular", "shininess")], axis=1),
            "casts": geoms["category"] != DECOR,
            "of": of,
        }
        self._rows.append({**row, **more})

    def _joined(self, chosen: np.ndarray, hidden: np.ndarray, lights: np.ndarray | None) -> MjvGeoms:
        empty = np.zeros(0, np.int64)
        if not self._rows:
            self.add(empty, SPHERE, np.zeros((0, 3)))
        rows = {name: np.concatenate([row[name] for row in self._rows]) for name in self._rows[0]}
        of = rows.pop("of")
        geoms = self._geoms[of]
        reflects = np.isin(rows["types"], (PLANE, BOX)) & (rows["colors"][:, 3] >= OPAQUE_ABOVE)
        textures, repeats, uniform = self._textures(geoms)
        pairs, renamed = self._pairs(of, chosen)
        return MjvGeoms(
            **rows,
            reflectances=np.where(reflects, np.maximum(geoms["reflectance"], 0.0), 0.0),
            textures=textures,
            repeats=repeats,
            uniform=uniform,
            segments=geoms["segid"],
            objects=pairs,
            hidden=hidden,
            renamed=renamed,
            lights=lights,
        )

    def _textures(self, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the textures and repeats of geoms, their own or their materials'."""
        model = self._model
        materials = geoms["matid"]
        given = (materials >= 0) & (materials < model.nmat)
        textures, uniform = np.full(len(geoms), -1), np.zeros(len(geoms), bool)
        repeats = np.ones((len(geoms), 2), np.float32)
        if given.any():
            textures[given] = model.mat_texid[materials[given], ROLE]
            uniform[given] = model.mat_texuniform[materials[given]]
            repeats[given] = model.mat_texrepeat[materials[given]]
        if "texid" in (geoms.dtype.names or ()):
            own = (materials >= 0) & (geoms["texid"] >= 0) & (geoms["texid"] < model.ntex)
            textures[own], uniform[own] = geoms["texid"][own], geoms["texuniform"][own] != 0
            repeats[own] = geoms["texrepeat"][own]
        return textures, repeats, uniform

    def _pairs(self, of: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, list[tuple[Pair, Pair]]]:
        """Return the pairs that images of objects show: geoms that share an id show that of the last one."""
        geoms = self._geoms
        segments = geoms["segid"]
        values, last = np.unique(segments[::-1], return_index=True)
        shown = len(geoms) - 1 - last[np.searchsorted(values, segments)]
        pairs = np.stack((geoms["objid"], geoms["objtype"]), axis=1)
        others = np.flatnonzero(~chosen & (shown != np.arange(len(geoms))) & (segments >= 0))
        renamed = [(tuple(pairs[number].tolist()), tuple(pairs[shown[number]].tolist())) for number in others]
        return pairs[shown[of]], renamed

    def round_size(self, of: np.ndarray) -> np.ndarray:
        """(n,) radius of what is round about its z axis [m]."""
        size, kinds = self._geoms["size"][of], self._geoms["type"][of]
        oval = np.flatnonzero(size[:, 0] != size[:, 1])
        if len(oval):
            number = of[oval[0]]
            raise WarpcamError(
                f"scene.geoms[{number}].size is {size[oval[0]].tolist()}, and its type {_name(kinds[oval[0]])}, which "
                "warpcam draws round; allowed are equal first two sizes"
            )
        return size[:, 0]

    def asset(self, of: np.ndarray, ids: np.ndarray, count: int, what: str) -> np.ndarray:
        wrong = np.flatnonzero(ids >= count)
        if len(wrong):
            number = of[wrong[0]]
            raise WarpcamError(
                f"scene.geoms[{number}].dataid is {self._geoms['dataid'][number]}; the model has {count} {what}"
            )
        return ids

    def lines(self, of: np.ndarray, start: np.ndarray, end: np.ndarray, wide: np.ndarray) -> None:
        """Lines between points (n, 3) in the world frame, so many pixels wide."""
        pixels = wide * self._model.vis.global_.linewidth
        which, middles, turns, sizes = line_pieces(start, end, pixels, self._view, self._height, self._smooth)
        if len(which):
            color = self._geoms["rgba"][of[which]]
            lit = 1.0 + self._casting * (color[:, 3:] >= OPAQUE_ABOVE)  # each such light draws what is solid once more
            bright = np.minimum(color[:, :3] * lit, 1.0) / UNLIT
            finishes = np.tile(np.array((UNLIT, 0.0, 0.0), np.float32), (len(which), 1))
            self.add(
                of[which], BOX, sizes, positions=middles, rotations=turns, finishes=finishes,
                colors=np.concatenate((bright, color[:, 3:]), axis=1), casts=np.zeros(len(which), bool),
            )  # fmt: skip


def _ball(reader: _Reader, of: np.ndarray) -> None:
    size = reader._geoms["size"][of]
    round_ones = (size == size[:, :1]).all(axis=1)
    reader.add(of[round_ones], SPHERE, size[round_ones])
    reader.add(of[~round_ones], ELLIPSOID, size[~round_ones])


def _as_it_is(kind: int) -> Callable[[_Reader, np.ndarray], None]:
    return lambda reader, of: reader.add(of, kind, reader._geoms["size"][of])


def _upright(kind: int) -> Callable[[_Reader, np.ndarray], None]:
    def read(reader: _Reader, of: np.ndarray) -> None:
        _round(reader, of, kind, reader._geoms["size"][of, 2])

    return read


def _round(reader: _Reader, of: np.ndarray, kind: int, half: np.ndarray, wide: float = 1.0, **more: Any) -> None:
    """Something of half a length about the z axis."""
    radius = reader.round_size(of) * wide
    reader.add(of, kind, np.stack((radius, half, np.zeros(len(of))), axis=1), **more)


def _plane(reader: _Reader, of: np.ndarray) -> None:
    """Return the size of a plane: the model's may be infinite; another without a size is not drawn."""
    geoms = reader._geoms[of]
    of = of[(geoms["dataid"] >= 0) | (geoms["size"][:, :2] > 0.0).all(axis=1)]
    reader.add(of, PLANE, reader._geoms["size"][of])


def _mesh(reader: _Reader, of: np.ndarray) -> None:
    of = of[reader._geoms["dataid"][of] >= 0]
    ids = reader._geoms["dataid"][of]
    if (ids % 2).any():
        number = of[np.argmax(ids % 2)]
        raise WarpcamError(f"scene.geoms[{number}].dataid is {ids[np.argmax(ids % 2)]}: hulls are not drawn here")
    assets = reader.asset(of, ids // 2, reader._model.nmesh, "meshes")
    reader.add(of, MESH, reader._geoms["size"][of], assets=assets)


def _height_field(reader: _Reader, of: np.ndarray) -> None:
    of = of[reader._geoms["dataid"][of] >= 0]
    assets = reader.asset(of, reader._geoms["dataid"][of], reader._model.nhfield, "height fields")
    reader.add(of, HEIGHT_FIELD, reader._geoms["size"][of], assets=assets)


def _arrow(head: float) -> Callable[[_Reader, np.ndarray], None]:
    """Half as long as the geom says: a shaft of a third, and a head of a sixth of that."""

    def read(reader: _Reader, of: np.ndarray) -> None:
        length = reader._geoms["size"][of, 2].astype(np.float64)
        _round(reader, of, CYLINDER, length / 6.0, along=length / 6.0)
        _round(reader, of, CONE, length / 12.0, head, along=length * (5.0 / 12.0))

    return read


def _double_arrow(reader: _Reader, of: np.ndarray) -> None:
    length = reader._geoms["size"][of, 2].astype(np.float64)
    _round(reader, of, CYLINDER, length / 3.0)
    for flip in (False, True):
        along = length * (-5.0 / 12.0 if flip else 5.0 / 12.0)
        _round(reader, of, CONE, length / 12.0, HEAD, along=along, flip=flip)


def _line(reader: _Reader, of: np.ndarray) -> None:
    geoms = reader._geoms[of]
    reader.lines(of, geoms["pos"], geoms["pos"] + geoms["size"][:, 2:] * geoms["mat"][:, :, 2], geoms["size"][:, 0])


def _line_box(reader: _Reader, of: np.ndarray) -> None:
    geoms = reader._geoms[of]

    def at(corner: np.ndarray) -> np.ndarray:
        return geoms["pos"] + np.einsum("nij,nj->ni", geoms["mat"], geoms["size"] * corner)

    for start, end in _edges():
        reader.lines(of, at(start), at(end), np.full(len(of), BOXES_WIDTH))


def _edges() -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Return the edges of a box of half width 1."""
    for axis in range(3):
        for side in ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
            yield np.insert(side, axis, -1.0), np.insert(side, axis, 1.0)


def _name(kind: int) -> str:
    try:
        return GEOM(kind).name
    except ValueError:
        return str(kind)


READERS: dict[int, Callable[[_Reader, np.ndarray], None]] = {
    int(GEOM.mjGEOM_PLANE): _plane,
    int(GEOM.mjGEOM_HFIELD): _height_field,
    int(GEOM.mjGEOM_SPHERE): _ball,
    int(GEOM.mjGEOM_CAPSULE): _upright(CAPSULE),
    int(GEOM.mjGEOM_ELLIPSOID): _as_it_is(ELLIPSOID),
    int(GEOM.mjGEOM_CYLINDER): _upright(CYLINDER),
    int(GEOM.mjGEOM_BOX): _as_it_is(BOX),
    int(GEOM.mjGEOM_MESH): _mesh,
    int(GEOM.mjGEOM_SDF): _mesh,
    int(GEOM.mjGEOM_ARROW): _arrow(HEAD),
    int(GEOM.mjGEOM_ARROW1): _arrow(1.0),
    int(GEOM.mjGEOM_ARROW2): _double_arrow,
    int(GEOM.mjGEOM_LINE): _line,
    int(GEOM.mjGEOM_LINEBOX): _line_box,
}
