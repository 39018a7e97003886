"""MuJoCo's materials and lights as physically based ones, for the looks "pbr" and "path"."""

import logging
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
import warp as wp

from warpcam.core.color import srgb_to_linear
from warpcam.kernels.types import FORM_POINT, ROLE_EMISSION, ROLE_NORMAL, ROLE_OPACITY, ROLE_PACKED, SKY_TERMS
from warpcam.textures.pack import TextureImage
from warpcam.textures.panorama import NORMS

MAPPED = (ROLE_NORMAL, ROLE_OPACITY, ROLE_EMISSION, ROLE_PACKED)  # roles of textures that are read beside the colour's
UNREAD = {2: "occlusion", 3: "roughness", 4: "metallic", 6: "opacity"}  # roles; a packed map has the first three
STRAIGHT = 0.08  # reflectance at normal incidence of a material whose `specular` is 1


def has_maps(mjm: mujoco.MjModel) -> bool:
    """Whether some material has more than the texture of its colour."""
    return bool(mjm.nmat) and bool((mjm.mat_texid[:, MAPPED] >= 0).any())


def physical_arrays(
    mjm: mujoco.MjModel, textures: Sequence[TextureImage], skybox: int, worlds: int, lights: int, device: wp.Device
) -> Mapping[str, wp.array]:
    """Return the arrays of ``kernels.types.Physical`` but its lights.

    Metalness and roughness are the material's layers where it has them; else it is no metal, and as rough as the facets
    whose highlight falls off as its shininess says: alpha^2 = 2 / (exponent + 2), with the exponent 128 * shininess.
    ``specular`` is the reflectance at normal incidence over 0.08. What shines has ``Materials.emission``, nothing here.
    ``bulbradius`` of lights that have a place softens their shadows.

    Args:
        mjm: The host's model.
        textures: Those of the scene.
        skybox: Index of the one behind everything, which lights the scene, or -1.
        worlds: Number of worlds.
        lights: Number of lights.
        device: Where the arrays lie.
    """
    if mjm.nmat:
        for role, name in UNREAD.items():
            if (mjm.mat_texid[:, role] >= 0).any():
                told = "a material has a layer of the role %s, which is not read; a packed map (orm) is"
                logging.getLogger("warpcam").warning(told, name)
    exponent = 128.0 * np.clip(mjm.mat_shininess, 0.0, 1.0)
    rough = np.where(mjm.mat_roughness >= 0.0, mjm.mat_roughness, (2.0 / (exponent + 2.0)) ** 0.25)
    sky = np.zeros((SKY_TERMS + 1, 3))
    if skybox >= 0:
        sky[:SKY_TERMS], sky[-1] = _terms_of_cube(textures[skybox].pixels), 1.0
    numbers = {
        "roughness": rough,
        "metallic": np.maximum(mjm.mat_metallic, 0.0),
        "reflectance": np.clip(STRAIGHT * mjm.mat_specular, 0.0, 1.0),
        "transmission": np.zeros(mjm.nmat),
    }
    found = {
        name: wp.array(np.asarray(rows, np.float32)[None], dtype=wp.float32, device=device)
        for name, rows in numbers.items()
    }
    sizes = np.zeros((lights, 3))
    local = mjm.light_type != mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sizes[: mjm.nlight, 0] = np.where(local, np.maximum(mjm.light_bulbradius, 0.0), 0.0)
    vectors = {"emissive": np.zeros((mjm.nmat, 3)), "sky": sky, "sizes": sizes}
    found |= {
        name: wp.array(np.asarray(rows, np.float32).reshape(1, -1, 3), dtype=wp.vec3, device=device)
        for name, rows in vectors.items()
    }
    found["forms"] = wp.full((1, lights), FORM_POINT, dtype=wp.int32, device=device)
    upright = np.broadcast_to(np.eye(3, dtype=np.float32), (worlds, lights, 3, 3))
    found["rotations"] = wp.array(np.ascontiguousarray(upright), dtype=wp.mat33, ndim=2, device=device)
    return found


def _terms_of_cube(pixels: np.ndarray) -> np.ndarray:
    """Terms of a skybox, (SKY_TERMS, 3): see native/shading/environment.h.

    Args:
        pixels: (6 * side, side, 3 or 4) uint8 display values, faces +x -x +y -y +z -z; its y axis is the world's z.
    """
    side = pixels.shape[1]
    at = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    s, t = np.meshgrid(at, at)
    one = np.ones_like(s)
    faces = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    place = np.array(faces).transpose(0, 2, 3, 1)
    square = (place**2).sum(axis=-1, keepdims=True)
    weight = (2.0 / side) ** 2 / square**1.5
    x, z, y = np.moveaxis(place / np.sqrt(square), -1, 0)
    y = -y
    basis = np.stack((np.ones_like(x), x, y, z, x * y, y * z, 3.0 * z**2 - 1.0, x * z, x**2 - y**2))
    light = srgb_to_linear(pixels[..., :3].reshape(6, side, side, 3) / 255.0)
    return NORMS[:, None] * np.einsum("tfij,fijc->tc", basis, weight * light)
