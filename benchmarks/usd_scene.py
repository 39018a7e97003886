"""A USD stage as a MuJoCo model, so that all renderers draw the same scene: shapes, colours, textures, lights, cameras.

Physical materials become MuJoCo's: base colour and its texture, without roughness, metal and other maps. What moves on
the stage stands still.
"""

import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import warpcam as wc
from warpcam.benchmarks.scenes import GEOM
from warpcam.kernels.types import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE, SPHERE, SPLATS
from warpcam.sources.common import tessellate
from warpcam.sources.common.geometry import RenderShape
from warpcam.sources.common.scene_graph import LightNode, SceneGraph, ShapeInstance

SOLIDS = {
    SPHERE: GEOM.mjGEOM_SPHERE,
    CAPSULE: GEOM.mjGEOM_CAPSULE,
    ELLIPSOID: GEOM.mjGEOM_ELLIPSOID,
    CYLINDER: GEOM.mjGEOM_CYLINDER,
    BOX: GEOM.mjGEOM_BOX,
    PLANE: GEOM.mjGEOM_PLANE,
}
LEAST = 4  # vertices of a mesh


def read(path: Path) -> mujoco.MjSpec:
    scene: Any = wc.load(path, 1, device="cpu", up_axis="Z")
    return Stage(scene._graph_source.graph).spec


class Stage:
    """Turns a stage into a model."""

    def __init__(self, graph: SceneGraph) -> None:
        self.graph, self.frames = graph, graph.worlds()
        self.spec = mujoco.MjSpec()
        self.spec.default.geom.contype = self.spec.default.geom.conaffinity = 0  # nothing is simulated
        self.meshes: dict[int, str] = {}
        self.materials: dict[tuple[int, bytes], str] = {}
        seen = graph.seen()
        left_out = 0
        for item in graph.items:
            fit = item.geometry.transformed(self.frames[item.node, :3, :3]) if seen[item.node] else None
            if fit is not None and fit.type == SPLATS:
                left_out += 1
            elif fit is not None:
                self.add(item, fit)
        if left_out:
            warnings.warn(f"{graph.source}: {left_out} clouds of Gaussians are left out", stacklevel=2)
        for light in graph.lights:
            if light.active and seen[light.node]:
                self.light(light)
        for camera in graph.cameras:
            if camera.projection == "pinhole":
                position, quaternion = placed(self.frames[camera.node])
                fovy = float(np.degrees(2.0 * np.arctan(0.5 / camera.focal)))  # of a square image
                self.spec.worldbody.add_camera(name=camera.name, pos=position, quat=quaternion, fovy=fovy)

    def add(self, item: ShapeInstance, fit: RenderShape) -> None:
        frame = self.frames[item.node].copy()
        frame[:3, :3] = fit.rotation
        position, quaternion = placed(frame)
        geom = self.spec.worldbody.add_geom(pos=position, quat=quaternion, size=fit.size)
        if fit.type in SOLIDS:
            geom.type = SOLIDS[fit.type]
        else:
            geom.type, geom.meshname, geom.size = GEOM.mjGEOM_MESH, self.mesh(fit), (0.0, 0.0, 0.0)
        look = self.graph.materials[item.material] if item.material >= 0 else None
        color = item.color or ((*look.color, look.opacity) if look else (0.18, 0.18, 0.18, 1.0))
        geom.rgba = (*encoded(np.array(color[:3])), color[3])
        if look is not None and look.texture >= 0 and fit.mesh is not None and fit.mesh.uvs is not None:
            geom.material = self.material(look.texture, np.array(geom.rgba))

    def mesh(self, fit: RenderShape) -> str:
        """Name of the shape's mesh, one for all shapes that share it."""
        key = id(fit.mesh) if fit.mesh is not None else id(fit)
        if key not in self.meshes:
            shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            name = self.meshes[key] = f"mesh{len(self.meshes)}"
            mesh = self.spec.add_mesh(name=name, inertia=shell)
            if fit.mesh is None:
                points, faces = tessellate.cone(fit.size[0], fit.size[1])[:2]
                normals = uvs = None
            else:
                points, faces, normals, uvs = fit.mesh.vertices, fit.mesh.faces, fit.mesh.normals, fit.mesh.uvs
            corners = points[np.resize(np.arange(len(points)), max(len(points), LEAST))]
            mesh.uservert, mesh.userface = np.ravel(corners), np.ravel(faces)
            if normals is not None:
                mesh.usernormal, mesh.userfacenormal = np.ravel(normals), np.arange(faces.size, dtype=np.int32)
            if uvs is not None:
                mesh.usertexcoord = np.ravel(uvs * (1.0, -1.0) + (0.0, 1.0))  # MuJoCo's v counts downwards
                mesh.userfacetexcoord = np.arange(faces.size, dtype=np.int32)
        return self.meshes[key]

    def material(self, texture: int, rgba: np.ndarray) -> str:
        key = texture, rgba.tobytes()
        if key not in self.materials:
            name = self.materials[key] = f"look{len(self.materials)}"
            material = self.spec.add_material(name=name, rgba=rgba)
            if self.spec.texture(f"image{texture}") is None:
                pixels = np.asarray(self.graph.textures[texture].pixels)
                pixels = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels[..., :3]
                image = self.spec.add_texture(name=f"image{texture}", type=mujoco.mjtTexture.mjTEXTURE_2D)
                image.height, image.width, image.nchannel = pixels.shape
                image.data = np.ascontiguousarray(pixels).tobytes()
            material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = f"image{texture}"
        return self.materials[key]

    def light(self, light: LightNode) -> None:
        """Add a distant or local light; a dome becomes ambient light."""
        frame, strength = self.frames[light.node], np.array(light.strength)
        if light.kind == "dome":
            self.spec.visual.headlight.ambient = np.clip(strength, 0.0, 0.5)
            return
        kinds = mujoco.mjtLightType
        near = light.kind == "local"
        local = kinds.mjLIGHT_SPOT if light.cone < 90.0 else kinds.mjLIGHT_POINT
        self.spec.worldbody.add_light(
            type=local if near else kinds.mjLIGHT_DIRECTIONAL,
            pos=frame[:3, 3],
            dir=-frame[:3, 2] / np.linalg.norm(frame[:3, 2]),
            diffuse=strength if near else strength / max(1.0, float(strength.max())),
            attenuation=(max(light.near, 1e-3), 0.0, 1.0) if near else (1.0, 0.0, 0.0),
            cutoff=min(light.cone, 90.0),
            castshadow=light.casts_shadow,
        )


def placed(frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and quaternion wxyz of a frame, (4, 4), whose axes may be stretched."""
    u, _, vt = np.linalg.svd(frame[:3, :3])
    rotation = u @ vt
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, (rotation if np.linalg.det(rotation) > 0.0 else -rotation).ravel())
    return frame[:3, 3], quaternion


def encoded(linear: np.ndarray) -> np.ndarray:
    """Encode linear colours in [0, 1] as sRGB."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
