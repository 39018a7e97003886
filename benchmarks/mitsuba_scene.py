"""A world of a MuJoCo scene for Mitsuba 3: meshes and planes, materials with maps, suns and a skybox."""

from typing import Any

import mujoco
import numpy as np

from warpcam.benchmarks.problem import Problem
from warpcam.core.color import srgb_to_linear
from warpcam.core.errors import WarpcamError

ROLE, GEOM = mujoco.mjtTextureRole, mujoco.mjtGeom
SKY = 256  # rows of the image of the sky


class Loaded:
    """A scene that is loaded, and how it is rendered."""

    def __init__(self, mi: Any, scene: Any, samples: int) -> None:
        self._mi, self._scene, self._samples, self._image = mi, scene, samples, None

    def render(self) -> None:
        import drjit as dr

        self._image = self._mi.render(self._scene, spp=self._samples)
        dr.eval(self._image)
        dr.sync_thread()

    def picture(self) -> np.ndarray:
        """Display values, (height, width, 3) uint8."""
        bitmap = self._mi.Bitmap(self._image)
        return np.array(bitmap.convert(self._mi.Bitmap.PixelFormat.RGB, self._mi.Struct.Type.UInt8, True))


def load(problem: Problem, samples: int, depth: int) -> Loaded:
    """The first world as it is now, on CUDA or LLVM as the problem's device is.

    Raises:
        ImportError: Mitsuba is not installed.
        WarpcamError: The scene has geoms that are neither meshes nor planes, or lights that are not suns.
    """
    import mitsuba as mi

    mi.set_variant("cuda_ad_rgb" if problem.d.qpos.device.is_cuda else "llvm_ad_rgb")
    mjm = problem.mjm
    parts: dict[str, Any] = {f"geom{k}": shape(mi, problem, k) for k in problem.drawn_geoms()}
    for k in range(mjm.nlight):
        parts[f"light{k}"] = light(problem, k)
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    parts["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(skybox(mjm)), "to_world": upright}
    integrator = {"type": "path", "max_depth": depth + 1, "rr_depth": depth}  # Mitsuba counts the lights, too
    scene = mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor(mi, problem), **parts})
    return Loaded(mi, scene, samples)


def transform(mi: Any, position: np.ndarray, rotation: np.ndarray) -> Any:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.reshape(3, 3), position
    return mi.ScalarTransform4f(matrix)


def sensor(mi: Any, problem: Problem) -> dict[str, Any]:
    camera = problem.camera_ids[0]
    place = transform(mi, problem.d.cam_xpos.numpy()[0, camera], problem.d.cam_xmat.numpy()[0, camera])
    film = {"type": "hdrfilm", "width": problem.width, "height": problem.height, "rfilter": {"type": "box"}}
    fovy = float(problem.mjm.cam_fovy[camera])
    to_world = place @ mi.ScalarTransform4f().rotate([0, 1, 0], 180)  # Mitsuba's look along +z
    return {"type": "perspective", "fov": fovy, "fov_axis": "y", "to_world": to_world, "film": film}


def shape(mi: Any, problem: Problem, geom: int) -> Any:
    mjm = problem.mjm
    place = transform(mi, problem.d.geom_xpos.numpy()[0, geom], problem.d.geom_xmat.numpy()[0, geom])
    look = bsdf(mi, mjm, int(mjm.geom_matid[geom]))
    if mjm.geom_type[geom] == GEOM.mjGEOM_PLANE:
        x, y = (float(half) for half in mjm.geom_size[geom, :2])
        return {"type": "rectangle", "to_world": place @ mi.ScalarTransform4f().scale([x, y, 1.0]), "bsdf": look}
    if mjm.geom_type[geom] != GEOM.mjGEOM_MESH:
        raise WarpcamError(f"mitsuba: geom {geom} must be a mesh or a plane, got type {mjm.geom_type[geom]}")
    return mesh(mi, mjm, int(mjm.geom_dataid[geom]), place, look)


def mesh(mi: Any, mjm: mujoco.MjModel, index: int, place: Any, look: dict[str, Any]) -> Any:
    """The mesh with each corner of its faces on its own."""

    def corners(values: np.ndarray, start: np.ndarray, faces: np.ndarray) -> np.ndarray:
        rows = slice(mjm.mesh_faceadr[index], mjm.mesh_faceadr[index] + mjm.mesh_facenum[index])
        return np.asarray(values[start[index] + faces[rows].ravel()], np.float32)

    matrix = np.array(place.matrix, np.float32)[:3]
    points = corners(mjm.mesh_vert, mjm.mesh_vertadr, mjm.mesh_face) @ matrix[:, :3].T + matrix[:, 3]
    normals = corners(mjm.mesh_normal, mjm.mesh_normaladr, mjm.mesh_facenormal) @ matrix[:, :3].T
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(look)
    found = mi.Mesh("mesh", len(points), len(points) // 3, has_vertex_normals=True, has_vertex_texcoords=True,
                    props=properties)  # fmt: skip
    values = mi.traverse(found)
    values["vertex_positions"], values["vertex_normals"] = points.ravel(), normals.ravel()
    values["vertex_texcoords"] = corners(mjm.mesh_texcoord, mjm.mesh_texcoordadr, mjm.mesh_facetexcoord).ravel()
    values["faces"] = np.arange(len(points), dtype=np.uint32)
    values.update()
    return found


def bsdf(mi: Any, mjm: mujoco.MjModel, material: int) -> dict[str, Any]:
    """A principled material; what shines by itself is left out, as only faces of one radiance are lights."""

    def bitmap(image: np.ndarray, raw: bool) -> dict[str, Any]:
        return {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(image)), "raw": raw}

    found: dict[str, Any] = {"type": "principled", "specular": float(mjm.mat_specular[material])}
    color = texture(mjm, material, ROLE.mjTEXROLE_RGB)
    if color is None:
        linear = srgb_to_linear(mjm.mat_rgba[material, :3])
        found["base_color"] = {"type": "rgb", "value": [float(x) for x in linear]}
    else:
        found["base_color"] = bitmap(color, False)
    orm = texture(mjm, material, ROLE.mjTEXROLE_ORM)
    for channel, (name, factor) in enumerate(
        (("roughness", mjm.mat_roughness[material]), ("metallic", mjm.mat_metallic[material])), start=1
    ):
        if orm is None:
            found[name] = float(max(factor, 0.0))
        else:
            found[name] = bitmap(np.rint(max(factor, 0.0) * orm[..., channel : channel + 1]).astype(np.uint8), True)
    normal = texture(mjm, material, ROLE.mjTEXROLE_NORMAL)
    one = found if normal is None else {"type": "normalmap", "normalmap": bitmap(normal, True), "bsdf": found}
    return {"type": "twosided", "bsdf": one}


def texture(mjm: mujoco.MjModel, material: int, role: mujoco.mjtTextureRole) -> np.ndarray | None:
    """Texels of a layer, (row, column, channel) uint8, or None."""
    index = int(mjm.mat_texid[material, int(role)])
    return None if index < 0 else texels(mjm, index)


def texels(mjm: mujoco.MjModel, index: int) -> np.ndarray:
    shape = (int(mjm.tex_height[index]), int(mjm.tex_width[index]), int(mjm.tex_nchannel[index]))
    start = int(mjm.tex_adr[index])
    return np.array(mjm.tex_data[start : start + int(np.prod(shape))]).reshape(shape)


def light(problem: Problem, index: int) -> dict[str, Any]:
    mjm = problem.mjm
    if mjm.light_type[index] != mujoco.mjtLightType.mjLIGHT_DIRECTIONAL:
        raise WarpcamError(f"mitsuba: light {index} must be directional, got type {mjm.light_type[index]}")
    direction = [float(x) for x in problem.d.light_xdir.numpy()[0, index]]
    irradiance = [float(np.pi * x) for x in mjm.light_diffuse[index]]  # a white surface shows `diffuse`
    return {"type": "directional", "direction": direction, "irradiance": {"type": "rgb", "value": irradiance}}


def skybox(mjm: mujoco.MjModel) -> np.ndarray:
    """Linear radiance by direction, (SKY, 2 SKY, 3) float32, of a skybox that is the same all around."""
    found = np.flatnonzero(mjm.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    if not found.size:
        return np.zeros((SKY, 2 * SKY, 3), np.float32)
    faces = texels(mjm, int(found[0]))[..., :3].astype(np.float64) / 255.0
    side = faces.shape[1]
    up = np.pi * (0.5 - (np.arange(SKY) + 0.5) / SKY)
    slope = np.tan(up)
    front = 4 * side + (0.5 - 0.5 * np.clip(slope, -1.0, 1.0)) * side
    above = 2 * side + (0.5 + 0.5 / np.maximum(np.abs(slope), 1.0)) * side
    rows = np.where(np.abs(slope) <= 1.0, front, np.where(slope > 0.0, above, above + side))
    colors = faces[np.minimum(rows.astype(int), faces.shape[0] - 1), side // 2]
    return np.repeat(srgb_to_linear(colors)[:, None].astype(np.float32), 2 * SKY, axis=1)
