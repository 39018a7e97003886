"""Surfaces that MuJoCo bends: those of flexes and of skins, as meshes whose vertices move."""

import mujoco
import numpy as np

from warpcam.accel.meshes import Mesh
from warpcam.kernels.update.refit import FaceShading
from warpcam.kernels.update.skinning import Shell


def flex_surface(mjm: mujoco.MjModel, start: mujoco.MjData, flex: int) -> tuple[Mesh, Shell, FaceShading]:
    """Build a flex's surface as MuJoCo draws it.

    It is sheets on both sides with their rims closed, or the shell of a solid flex.
    """
    dim, vertex, count = int(mjm.flex_dim[flex]), int(mjm.flex_vertadr[flex]), int(mjm.flex_vertnum[flex])
    radius = float(mjm.flex_radius[flex])
    first, number = int(mjm.flex_shelldataadr[flex]), int(mjm.flex_shellnum[flex])
    shell = mjm.flex_shell[first : first + number * dim].reshape(-1, dim)
    vertices = start.flexvert_xpos[vertex : vertex + count]
    name = f"flex {mujoco.mj_id2name(mjm, mujoco.mjtObj.mjOBJ_FLEX, flex) or flex}"

    def shading(count: int) -> FaceShading:
        return FaceShading(num_flat=count, offset=radius) if mjm.flex_flatskin[flex] else FaceShading(num_smooth=count)

    texture = None
    if mjm.flex_texcoordadr[flex] >= 0:
        texture = mjm.flex_texcoord[mjm.flex_texcoordadr[flex] :]
    if dim == 3:
        hull = Shell(shell, count, radius, by_area=False, first_vertex=vertex, first_point=0, both=False)
        mesh = _mesh(name, vertices + radius * _normals(vertices, shell), shell, texture, shell)
        return mesh, hull, shading(len(shell))
    first, number = int(mjm.flex_elemdataadr[flex]), int(mjm.flex_elemnum[flex])
    sheet = mjm.flex_elem[first : first + 3 * number].reshape(-1, 3)
    mapped = mjm.flex_elemtexcoord[first : first + 3 * number].reshape(-1, 3)
    a, b = shell[:, 0], shell[:, 1]
    back = np.array((0, 2, 1))
    faces = np.concatenate(
        (
            sheet,
            sheet[:, back] + count,
            np.stack((a, b + count, b), axis=1),
            np.stack((b + count, a, a + count), axis=1),
        )
    )
    corners = np.concatenate((mapped, mapped[:, back], np.stack((a, b, b), axis=1), np.stack((b, a, a), axis=1)))
    normals = radius * _normals(vertices, sheet)
    mesh = _mesh(name, np.concatenate((vertices + normals, vertices - normals)), faces, texture, corners)
    hull = Shell(sheet, count, radius, by_area=False, first_vertex=vertex, first_point=0, both=True)
    return mesh, hull, shading(2 * number)


def skin_surface(mjm: mujoco.MjModel, skin: int) -> tuple[Mesh, Shell, FaceShading]:
    """A skin as its bones hold it at first: what its bones move is its vertices."""
    first, count = int(mjm.skin_vertadr[skin]), int(mjm.skin_vertnum[skin])
    start = int(mjm.skin_faceadr[skin])
    faces = mjm.skin_face[start : start + mjm.skin_facenum[skin]]
    texture = None
    if mjm.skin_texcoordadr[skin] >= 0:
        texture = mjm.skin_texcoord[mjm.skin_texcoordadr[skin] :]
    hull = Shell(
        faces=faces, num_vertices=count, offset=float(mjm.skin_inflate[skin]), by_area=True, first_vertex=first,
        first_point=0, both=False,
    )  # fmt: skip
    name = f"skin {mjm.skin(skin).name or skin}"
    return (
        _mesh(name, mjm.skin_vert[first : first + count], faces, texture, faces),
        hull,
        FaceShading(num_smooth=len(faces)),
    )


def _mesh(name: str, vertices: np.ndarray, faces: np.ndarray, texture: np.ndarray | None, corners: np.ndarray) -> Mesh:
    uvs = None
    if texture is not None:
        # Shells and rims look by vertex, of which there may be more than coordinates: MuJoCo reads on beyond them.
        uvs = texture[np.minimum(corners, len(texture) - 1)].astype(np.float32)
        uvs[..., 1] = 1.0 - uvs[..., 1]  # MuJoCo's v counts from the image's first row
    return Mesh(
        name, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32), uvs=uvs, moves=True,
        bare=True,
    )  # fmt: skip


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the normal of each vertex, the mean of its faces' normals, (vertex, 3)."""

    def unit(vectors: np.ndarray) -> np.ndarray:
        return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-15)

    corners = vertices[faces]
    flat = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, faces[:, corner], flat)
    return unit(sums)
