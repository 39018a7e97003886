"""Triangle meshes: checked and packed into the few arrays that the kernels read."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warpcam.accel.bvh4 import Bvh4, build_bvh4s
from warpcam.accel.occluder_boxes import FEW_FACES, are_worth, pack_occluder_boxes
from warpcam.core.errors import WarpcamError
from warpcam.core.lru_cache import LruCache, key_of
from warpcam.kernels.build import horizon_maps, occluder_boxes
from warpcam.kernels.runtime.compile import compile_in_background
from warpcam.kernels.runtime.launch import BLOCK_DIM
from warpcam.kernels.types import Meshes, Textures

MAX_ROWS = 2**31 - 1
BOUNDS, MIDDLE_BOUND = 32760, 32768  # as in native/accel/bvh4.h: steps of an extent, and the plane through 0
ABSENT = np.float32(1e30)  # all bounds of a child that is not there
CACHE_BYTES = 2**27  # bytes of trees, for the next scene that has those meshes, too

_cache: LruCache[Bvh4] = LruCache(CACHE_BYTES, lambda tree: tree.nodes.nbytes + tree.faces.nbytes)


@dataclass(frozen=True, eq=False)
class Mesh:
    """One mesh as a source gives it.

    Attributes:
        name: For error messages.
        vertices: (vertex, 3) float32, in the frame that the shape's pose places [m].
        faces: (face, 3) int32, indices of vertices, counterclockwise seen from the front.
        normals: (face, 3, 3) float32, a unit normal for each corner; None for flat faces.
        uvs: (face, 3, 2) float32, a texture coordinate for each corner, v up; None if there are none.
        moves: Whether its corners will be moved: then it has rows of its own, with the tree of where they are now.
        two_sided: Whether the second half of the faces is the first seen from behind, corners 0, 2, 1 of each. The tree
            holds the first.
        mask: Index of the texture whose red is its opacity, or -1; only with ``uvs``.
        least: Opacity below which it is not there.
        bare: Whether it shows textures by ``uvs`` alone, as often as materials say but never by the metre.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None
    moves: bool = False
    mask: int = -1
    least: float = 0.0
    two_sided: bool = False
    bare: bool = False

    @property
    def mapped(self) -> int:
        """Return the kind of the mesh's texture coordinates: see ``kernels.types.Meshes.has_uvs``."""
        if self.bare:
            return -1 if self.uvs is None else 2
        return int(self.uvs is not None)

    @property
    def fronts(self) -> np.ndarray:
        """Faces without those that are the backs of others."""
        return self.faces[: len(self.faces) // 2] if self.two_sided else self.faces


def pack_meshes(
    meshes: Sequence[Mesh], device: wp.Device, shut: bool = False, ahead: Sequence[tuple[wp.Kernel, int]] = ()
) -> tuple[Meshes, int]:
    """Build the tree of every mesh and put all of them on ``device``. Equal meshes share their rows.

    Args:
        shut: Whether they are to have occluder boxes, where they can.
        ahead: What else is compiled for a CUDA device meanwhile, each with the threads in a block.

    Returns:
        The meshes, and how many faces the largest of them has in its leaves.

    Raises:
        WarpcamError: A mesh cannot be used; the message names it.
    """
    places: dict[tuple[bytes, ...], tuple[int, int]] = {}  # by content: first rows of nodes and faces
    built: dict[tuple[bytes, ...], int] = {}  # by content: place among the trees
    bounded = horizon_maps.uses_horizon_maps(device) and not any(mesh.moves or mesh.two_sided for mesh in meshes)
    shut = shut and bounded
    finders = [(kernel, BLOCK_DIM) for kernel in _finders(meshes, shut)] if bounded else []
    with compile_in_background([*finders, *ahead], device):
        whole = _trees(meshes)
    trees: list[tuple[np.ndarray, np.ndarray]] = []
    holders: list[int] = []  # the first mesh of each
    node_start, face_start, num_faces, corner_start = [], [], [], []
    bounds_min = np.zeros((len(meshes), 3), np.float32)
    bounds_max = np.full((len(meshes), 3), -1.0, np.float32)
    normals, uvs = [], []
    node_rows = face_rows = corners = 0
    moving = any(mesh.moves for mesh in meshes)
    for index, (mesh, tree) in enumerate(zip(meshes, whole, strict=True)):
        key = (mesh.vertices.tobytes(), mesh.faces.tobytes(), b"two-sided" * mesh.two_sided)
        if key not in built:
            nodes = tree.nodes
            if device.is_cuda:
                nodes = child_by_child(nodes) if moving else _short(nodes, _extent(mesh))
            built[key] = len(trees)
            trees.append((nodes, _with_backs(tree.faces, len(mesh.fronts)) if mesh.two_sided else tree.faces))
        elif mesh.moves or key not in places:
            trees.append(trees[built[key]])
        if len(holders) < len(trees):
            holders.append(index)
        place = places.get(key)
        if mesh.moves or place is None:
            place = (node_rows, face_rows)
            node_rows += len(trees[-1][0])
            face_rows += len(trees[-1][1])
        if not mesh.moves:
            places[key] = place
        node_start.append(place[0])
        face_start.append(place[1])
        num_faces.append(len(tree.faces) // 3)
        corner_start.append(corners)
        corners += len(mesh.faces)
        if len(mesh.faces):
            used = mesh.vertices[mesh.faces.reshape(-1)]
            bounds_min[index], bounds_max[index] = used.min(axis=0), used.max(axis=0)
        normals.append(_normals(mesh))
        uvs.append(_uvs(mesh))
        if max(node_rows, face_rows, 3 * corners) > MAX_ROWS:
            raise WarpcamError(f"meshes: up to mesh '{mesh.name}' they have {corners} faces; all must fit 2^31 rows")

    packed = Meshes()
    packed.bounds_min = wp.array(bounds_min, dtype=wp.vec3, device=device)
    packed.bounds_max = wp.array(bounds_max, dtype=wp.vec3, device=device)
    packed.node_start = _integers(node_start, device)
    packed.face_start = _integers(face_start, device)
    packed.num_faces = _integers(num_faces, device)
    packed.corner_start = _integers(corner_start, device)
    packed.nodes = wp.array(_joined([tree[0] for tree in trees], 4), dtype=wp.vec4, device=device)
    packed.faces = wp.array(_joined([tree[1] for tree in trees], 4), dtype=wp.vec4, device=device)
    packed.normals = wp.array(_joined(normals, 3), dtype=wp.vec3, device=device)
    packed.uvs = wp.array(_joined(uvs, 2), dtype=wp.vec2, device=device)
    packed.has_uvs = _integers([mesh.mapped for mesh in meshes], device)
    if bounded:
        sizes = [len(rows) // 3 for _, rows in trees]
        horizon_maps.build_horizon_maps(packed, np.repeat(np.array(holders, np.int32), sizes), device)
        if shut and are_worth(faces := [rows for _, rows in trees]):
            packed.occluder_boxes = pack_occluder_boxes(packed, faces, holders, device)
    return packed, max((len(rows) // 3 for _, rows in trees), default=0)


def pack_masks(meshes: Sequence[Mesh], textures: Textures, packed: Meshes, device: wp.Device) -> bool:
    """Tell the kernels which parts of which meshes are there, if the textures of some meshes' opacity say so."""
    if all(mesh.mask < 0 for mesh in meshes):
        return False
    places = np.stack([array.numpy() for array in (textures.start, textures.width, textures.height)], axis=1)
    rows = np.zeros((len(meshes), 4), np.float32)
    for row, mesh in zip(rows, meshes, strict=True):
        if mesh.mask >= 0 and mesh.uvs is not None:
            row[:3], row[3] = places[mesh.mask].astype(np.int32).view(np.float32), mesh.least
    packed.masks = wp.array(rows, dtype=wp.vec4, device=device)
    packed.mask_texels = textures.texels
    return True


def _finders(meshes: Sequence[Mesh], shut: bool) -> list[wp.Kernel]:
    """The kernels that look for horizons and, where they may be worth it, for occluder boxes."""
    few = all(len(mesh.faces) < FEW_FACES for mesh in meshes)
    return ([horizon_maps.kernel()] if meshes else []) + ([occluder_boxes.kernel()] if shut and not few else [])


def _trees(meshes: Sequence[Mesh]) -> list[Bvh4]:
    """The tree of each mesh, in their order."""
    contents = [key_of(np.asarray(mesh.vertices), np.asarray(mesh.fronts)) for mesh in meshes]
    named = dict(zip(contents, meshes, strict=True))
    trees = {content: tree for content in named if (tree := _cache.find(content)) is not None}
    new = [content for content in named if content not in trees]
    built = build_bvh4s([(named[content].vertices, named[content].fronts, named[content].name) for content in new])
    for content, tree in zip(new, built, strict=True):
        trees[content] = tree
        _cache.keep(content, tree)
    return [trees[content] for content in contents]


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals, (face, 3) float32; z where a face has no area."""
    corners = vertices[faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return np.where(length > 0.0, cross / np.where(length > 0.0, length, 1.0), (0.0, 0.0, 1.0)).astype(np.float32)


def _extent(mesh: Mesh) -> float:
    """The greatest magnitude of a coordinate of its faces."""
    return float(np.abs(mesh.vertices[mesh.faces]).max(initial=0.0))


def _short(nodes: np.ndarray, extent: float) -> np.ndarray:
    """Rows of nodes as CUDA reads them, (4 * node, 4), from those of build_bvh4s: see ``Meshes.nodes``."""
    by_bound = nodes.reshape(-1, 7, 4)
    cell = (extent or 1.0) / BOUNDS
    # one step more on each side, as rays round by less than one
    lower = np.floor(by_bound[:, 0:3].astype(np.float64) / cell) - 1.0
    upper = np.ceil(by_bound[:, 3:6].astype(np.float64) / cell) + 1.0
    absent = by_bound[:, 0:3] == ABSENT
    lower[absent], upper[absent] = MIDDLE_BOUND - 1.0, -MIDDLE_BOUND
    rows = np.empty((len(by_bound), 4, 4), np.int32)
    low, high = ((bounds + MIDDLE_BOUND).astype(np.uint32) for bounds in (lower, upper))
    rows[:, :3] = (low | high << np.uint32(16)).view(np.int32)
    rows[:, 3] = by_bound[:, 6].view(np.int32)
    rows[:, 3][rows[:, 3] == 0] = -1  # a leaf without faces
    return rows.view(np.float32).reshape(-1, 4)


def child_by_child(nodes: np.ndarray) -> np.ndarray:
    """Convert nodes to the layout of scenes with moving meshes."""
    by_bound = nodes.reshape(-1, 7, 4)
    by_child = np.zeros((len(by_bound), 4, 2, 4), np.float32)
    by_child[:, :, 0, :3] = by_bound[:, 0:3].transpose(0, 2, 1)
    by_child[:, :, 1, :3] = by_bound[:, 3:6].transpose(0, 2, 1)
    by_child.view(np.int32)[:, :, 0, 3] = by_bound.view(np.int32)[:, 6]  # bits, some of them those of NaNs
    return by_child.reshape(-1, 4)


def _with_backs(rows: np.ndarray, num_fronts: int) -> np.ndarray:
    """Rows of faces, each of which says what its back is: see ``Meshes.faces``."""
    marked = rows.copy().reshape(-1, 3, 4)
    marked.view(np.int32)[:, 1, 3] = marked.view(np.int32)[:, 0, 3] + num_fronts
    return marked.reshape(-1, 4)


def _normals(mesh: Mesh) -> np.ndarray:
    if mesh.moves:
        return np.zeros((3 * len(mesh.faces), 3), np.float32)
    if mesh.normals is None:
        return np.repeat(face_normals(mesh.vertices, mesh.faces), 3, axis=0)
    return _corner_values(mesh, "normals", mesh.normals, 3)


def _uvs(mesh: Mesh) -> np.ndarray:
    if mesh.uvs is None:  # one row for each corner all the same, so that corners count alike in both arrays
        return np.zeros((3 * len(mesh.faces), 2), np.float32)
    return _corner_values(mesh, "uvs", mesh.uvs, 2)


def _corner_values(mesh: Mesh, what: str, values: np.ndarray, width: int) -> np.ndarray:
    if values.shape != (len(mesh.faces), 3, width):
        raise WarpcamError(
            f"mesh '{mesh.name}': {what} must have shape ({len(mesh.faces)}, 3, {width}), got {values.shape}"
        )
    if not np.isfinite(values).all():
        face = int(np.argmin(np.isfinite(values).all(axis=(1, 2))))
        raise WarpcamError(f"mesh '{mesh.name}': {what} must be finite, got {values[face].tolist()} at face {face}")
    return values.reshape(-1, width)


def _joined(parts: Sequence[np.ndarray], width: int) -> np.ndarray:
    return np.concatenate([np.zeros((0, width), np.float32), *parts])


def _integers(values: Sequence[int], device: wp.Device) -> wp.array:
    return wp.array(np.asarray(values, np.int32), dtype=wp.int32, device=device)
