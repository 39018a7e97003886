"""Constant parts of a MuJoCo model, and the names of those that change."""

import functools
import logging
import operator
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from warpcam.accel.heightfields import HeightField
from warpcam.accel.meshes import Mesh, face_normals
from warpcam.core.errors import WarpcamError
from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.types import BOX, LIGHT_DIRECTIONAL, LIGHT_SPOT, MESH, PLANE
from warpcam.scene.source import SceneCamera, SceneDescription
from warpcam.sources.mujoco.physical import has_maps, physical_arrays
from warpcam.textures.pack import TextureImage

VERSION = tuple(int(part) for part in mujoco.__version__.split(".")[:2])
NUM_GROUPS = 6
# Layers nearer than this part of a texel of its map do not shade each other in MuJoCo's renderer, which moves what it
# draws there away from the light: by so much where that faces it, and by more on slopes.
APART = 0.25
SHOWN = (0, 1, 2)  # groups, unless told
KINDS = ("geoms", "sites", "tendons", "flexes", "skins")
DRAWN = (*KINDS, "actuators")  # what may be drawn; the last have no groups
Groups = Collection[int] | Mapping[str, Collection[int]]
REVISED = (3, 12)  # the version from which on MuJoCo draws textures on shapes, and point lights, as it does now
GLOBAL_AMBIENT = 0.3  # of a scene without lights
QUADS = 4  # along a side of a box: BOX_CELLS of kernels/native/shading/gouraud.h
SMOOTH_BELOW = 0.8  # cosine to the face's normal under which MuJoCo takes that instead of the vertex's

# Where MuJoCo and MuJoCo-Warp keep each live array: in the data, or in the model.
DATA_NAMES: Mapping[str, str] = {
    "shape_positions": "geom_xpos",
    "shape_rotations": "geom_xmat",
    "light_positions": "light_xpos",
    "light_directions": "light_xdir",
    "body_positions": "xpos",
    "body_rotations": "xmat",
    "camera_positions": "cam_xpos",
    "camera_rotations": "cam_xmat",
}
MODEL_NAMES: Mapping[str, str] = {
    "shape_sizes": "geom_size",
    "shape_assets": "geom_dataid",
    "shape_materials": "geom_matid",
    "shape_colors": "geom_rgba",
    "material_color": "mat_rgba",
    "material_emission": "mat_emission",
    "material_specular": "mat_specular",
    "material_shininess": "mat_shininess",
    "material_texture": "mat_texid",
    "material_texture_repeat": "mat_texrepeat",
    "material_texture_uniform": "mat_texuniform",
    "light_types": "light_type",
    "light_active": "light_active",
    "light_casts_shadow": "light_castshadow",
    "light_attenuation": "light_attenuation",
    "light_cutoff": "light_cutoff",
    "light_exponent": "light_exponent",
    "light_ambient": "light_ambient",
    "light_diffuse": "light_diffuse",
    "light_specular": "light_specular",
    "camera_fovy": "cam_fovy",
    "camera_intrinsics": "cam_intrinsic",
}


def check_model(mjm: Any, name: str) -> None:
    if not isinstance(mjm, mujoco.MjModel):
        raise WarpcamError(f"{name} must be a mujoco.MjModel, got {type(mjm).__name__}")


def read_description(
    mjm: mujoco.MjModel, num_worlds: int, groups: Groups, geoms: Collection[int] | None = None
) -> SceneDescription:
    """The static parts of a model.

    Args:
        mjm: The host's model.
        num_worlds: How many worlds of it there are.
        groups: Groups that are drawn, 0 to 5; of all kinds, or of each by its name. What is of a group beyond is of 0
            or 5, as in MuJoCo's renderer.
        geoms: Ids of the geoms that are drawn, whatever their groups are.
    """
    if geoms is None:
        geoms = np.flatnonzero(np.isin(np.clip(mjm.geom_group, 0, NUM_GROUPS - 1), groups_by_kind(groups)["geoms"]))
    types = mjm.geom_type.astype(np.int32)
    types[types == mujoco.mjtGeom.mjGEOM_SDF] = MESH  # drawn as the mesh it was made from
    quads = int(mjm.vis.quality.numquads)
    if quads != QUADS and (types[np.asarray(geoms, np.int64)] == BOX).any():
        told = "numquads is %d in visual/quality; boxes are lit at the corners of %d quads a side"
        logging.getLogger("warpcam").warning(told, quads, QUADS)
    textures = [_texture(mjm, index) for index in range(mjm.ntex)]
    coincident = _coincident(mjm, geoms)
    skyboxes = np.flatnonzero(mjm.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    skybox = int(skyboxes[0]) if len(skyboxes) else -1
    return SceneDescription(
        num_worlds=num_worlds,
        shape_types=types,
        shape_bodies=mjm.geom_bodyid.astype(np.int32),
        drawn=[int(geom) for geom in geoms],
        bodies=[mjm.body(index).name for index in range(mjm.nbody)],
        cameras=[_camera(mjm, index) for index in range(mjm.ncam)],
        num_materials=mjm.nmat,
        num_lights=mjm.nlight,
        meshes=[_mesh(mjm, index) for index in range(mjm.nmesh)],
        height_fields=[_height_field(mjm, index) for index in range(mjm.nhfield)],
        textures=textures,
        flags=_flags(textures) | (SceneFlag.COINCIDENT if len(coincident) else SceneFlag(0)),
        coincident=coincident,
        skybox=skybox,
        maps=has_maps(mjm),
        as_physical=functools.partial(physical_arrays, mjm, textures, skybox, num_worlds, mjm.nlight),
        horizon=float(mjm.vis.map.zfar * mjm.stat.extent),
        shadow_map=(
            float(mjm.vis.map.shadowclip * mjm.stat.extent),
            float(mjm.vis.map.znear * mjm.stat.extent),
            float(mjm.vis.map.shadowscale),
            APART * 2.0 / max(int(mjm.vis.quality.shadowsize), 1),
        ),
    )


def _coincident(mjm: mujoco.MjModel, geoms: Collection[int]) -> np.ndarray:
    """(geom,) the next of those that stand where it does, in a ring, -1 for all others; empty if there are none.

    Robots whose meshes are there twice, to be seen and to collide. Not planes, whose corners are lit for all images.
    """
    places: dict[tuple[Any, ...], list[int]] = {}
    for geom in map(int, geoms):
        if mjm.geom_type[geom] != PLANE:
            numbers = (values[geom].tobytes() for values in (mjm.geom_pos, mjm.geom_quat, mjm.geom_size))
            kind = mjm.geom_bodyid[geom], mjm.geom_type[geom], mjm.geom_dataid[geom]
            places.setdefault((*kind, *numbers), []).append(geom)
    rings = [ring for ring in places.values() if len(ring) > 1]
    following = np.full(mjm.ngeom if rings else 0, -1, np.int32)
    for ring in rings:
        following[ring] = np.roll(ring, -1)
    return following


def headlight(mjm: mujoco.MjModel) -> np.ndarray:
    """Ambient, diffuse and specular of the light that moves with each camera, (3, 3) float32; zeros when it is off.

    What MuJoCo's renderer cannot place, as point lights, it leaves out from 3.12 on; up to there it adds to this.
    """
    light = mjm.vis.headlight
    colors = np.array((light.ambient, light.diffuse, light.specular), np.float32)
    colors *= bool(light.active)
    for index in _unplaced(mjm):
        colors += (mjm.light_ambient[index], mjm.light_diffuse[index], mjm.light_specular[index])
    return colors


def global_ambient(mjm: mujoco.MjModel) -> float:
    """MuJoCo lights a scene evenly that has no light at all; the shading looks whether other lights are on."""
    return 0.0 if mjm.vis.headlight.active or len(_unplaced(mjm)) else GLOBAL_AMBIENT


def _unplaced(mjm: mujoco.MjModel) -> np.ndarray:
    """Lights that are neither directional nor spots but are seen all the same."""
    if VERSION >= REVISED:
        return np.zeros(0, np.int64)
    placed = np.isin(mjm.light_type, (LIGHT_SPOT, LIGHT_DIRECTIONAL))
    return np.flatnonzero(~placed & (np.asarray(mjm.light_active) != 0))


def groups_by_kind(groups: Any) -> Mapping[str, list[int]]:
    """The groups that are drawn of each kind of thing."""
    if not isinstance(groups, Mapping):
        return dict.fromkeys(KINDS, _check_groups(groups))
    for kind in groups:
        if kind not in KINDS:
            raise WarpcamError(f"groups: {kind!r} came; allowed are {', '.join(KINDS)}")
    return {kind: _check_groups(groups.get(kind, SHOWN)) for kind in KINDS}


def _check_groups(groups: Any) -> list[int]:
    try:
        groups = groups if isinstance(groups, str) else list(groups)
        numbers = [NUM_GROUPS if isinstance(group, bool | np.bool_) else operator.index(group) for group in groups]
    except TypeError:
        numbers = [NUM_GROUPS]
    if any(not 0 <= number < NUM_GROUPS for number in numbers):
        raise WarpcamError(f"groups must be geom groups, numbers from 0 to {NUM_GROUPS - 1}, got {groups!r}")
    return numbers


def _camera(mjm: mujoco.MjModel, index: int) -> SceneCamera:
    orthographic = mjm.cam_projection[index] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
    width, height = (float(side) for side in mjm.cam_sensorsize[index])
    return SceneCamera(
        name=mjm.camera(index).name,
        projection="orthographic" if orthographic else "pinhole",
        sensor=(width, height) if height > 0.0 and not orthographic else None,
    )


def _mesh(mjm: mujoco.MjModel, index: int) -> Mesh:
    def rows(values: np.ndarray, start: np.ndarray, count: np.ndarray) -> np.ndarray:
        return values[start[index] : start[index] + count[index]]

    name = mjm.mesh(index).name or str(index)
    vertices = np.ascontiguousarray(rows(mjm.mesh_vert, mjm.mesh_vertadr, mjm.mesh_vertnum), np.float32)
    faces = np.ascontiguousarray(rows(mjm.mesh_face, mjm.mesh_faceadr, mjm.mesh_facenum), np.int32)
    _check_corners(name, "face", faces, len(vertices))
    if not np.isfinite(vertices).all():
        raise WarpcamError(f"mesh '{name}': mesh_vert must be finite")
    normal = rows(mjm.mesh_normal, mjm.mesh_normaladr, mjm.mesh_normalnum)
    facenormal = rows(mjm.mesh_facenormal, mjm.mesh_faceadr, mjm.mesh_facenum)
    _check_corners(name, "facenormal", facenormal, len(normal))
    normals = normal[facenormal].astype(np.float32)
    uvs = None
    if mjm.mesh_texcoordadr[index] >= 0:
        texcoord = rows(mjm.mesh_texcoord, mjm.mesh_texcoordadr, mjm.mesh_texcoordnum)
        facetexcoord = rows(mjm.mesh_facetexcoord, mjm.mesh_faceadr, mjm.mesh_facenum)
        _check_corners(name, "facetexcoord", facetexcoord, len(texcoord), least=-1)
        missing = (facetexcoord < 0).any(axis=1)  # such a face is projected on, as a mesh without coordinates is
        if not missing.all():
            uvs = texcoord[facetexcoord].astype(np.float32)
            uvs[missing] = _projected(mjm, index, vertices[faces[missing]])
            uvs[..., 1] = 1.0 - uvs[..., 1]  # MuJoCo's v counts from the image's first row
    if uvs is None:
        flat = face_normals(vertices, faces)[:, None, :]
        smooth = np.sum(normals * flat, axis=-1, keepdims=True) >= SMOOTH_BELOW
        normals = np.where(smooth, normals, flat)
    return Mesh(name, vertices, faces, normals, uvs)


def _projected(mjm: mujoco.MjModel, index: int, corners: np.ndarray) -> np.ndarray:
    """Return the texture coordinates of corners (n, 3, 3) along z, for textures that do not repeat."""
    geoms = (mjm.geom_type == int(mujoco.mjtGeom.mjGEOM_MESH)) & (mjm.geom_dataid == index)
    half = mjm.geom_size[np.argmax(geoms), :2] if geoms.any() else np.ones(2)
    return 0.5 * corners[..., :2] / half * (1.0, -1.0) - 0.5


def _check_corners(name: str, what: str, indices: np.ndarray, count: int, least: int = 0) -> None:
    bad = (indices < least) | (indices >= count)
    if bad.any():
        face = int(np.argmax(bad.any(axis=1)))
        raise WarpcamError(
            f"mesh '{name}': mesh_{what} must be indices from {least} to {count - 1}, got {indices[face].tolist()} "
            f"at face {face}"
        )


def _height_field(mjm: mujoco.MjModel, index: int) -> HeightField:
    x, y, top, base = (float(size) for size in mjm.hfield_size[index])
    rows, columns, start = int(mjm.hfield_nrow[index]), int(mjm.hfield_ncol[index]), int(mjm.hfield_adr[index])
    samples = mjm.hfield_data[start : start + rows * columns].reshape(rows, columns)
    return HeightField(mjm.hfield(index).name or str(index), samples.astype(np.float32) * top, (x, y), top, base)


def _flags(textures: Sequence[TextureImage]) -> SceneFlag:
    """Return the flags of texture mapping."""
    flat = [texture.pixels for texture in textures if texture.kind == "2d"]
    flags = SceneFlag.TEXTURE_FROM_ABOVE if VERSION < REVISED and flat else SceneFlag(0)
    if any(pixels.shape[-1] == 4 and pixels[..., 3].min() < 255 for pixels in flat):
        flags |= SceneFlag.TEXTURE_ALPHA
    return flags


def _texture(mjm: mujoco.MjModel, index: int) -> TextureImage:
    start, coded = int(mjm.tex_adr[index]), int(mjm.tex_colorspace[index])
    if start >= 0:
        height, width, channels = (int(size[index]) for size in (mjm.tex_height, mjm.tex_width, mjm.tex_nchannel))
        pixels = np.asarray(mjm.tex_data[start : start + height * width * channels]).reshape(height, width, channels)
        if channels not in (3, 4):  # MuJoCo's renderer leaves it out, too
            name = mjm.tex(index).name or str(index)
            logging.getLogger("warpcam").warning("texture '%s' has %d channels and is not shown", name, channels)
            return TextureImage("2d", np.full((1, 1, 3), 255, np.uint8))
    else:  # kept in its file, as with the compiler's passthrough
        pixels, coded = mujoco.mj_loadTexture(mjm, index)
        height, width, channels = pixels.shape
    srgb = coded == int(mujoco.mjtColorSpace.mjCOLORSPACE_SRGB)
    if channels == 2:  # grey and alpha
        pixels = np.concatenate((np.repeat(pixels[..., :1], 3, axis=-1), pixels[..., 1:]), axis=-1)
    if mjm.tex_type[index] == mujoco.mjtTexture.mjTEXTURE_2D:
        return TextureImage("2d", pixels, srgb)
    faces = pixels.reshape(6, width, width, -1) if height == 6 * width else pixels
    return TextureImage("cube", faces)  # of these MuJoCo's renderer does not ask how they are coded
