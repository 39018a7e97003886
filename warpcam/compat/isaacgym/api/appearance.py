"""Calls about what bodies look like: segmentation ids, colours, textures, and lights."""

from typing import Any

import numpy as np

from warpcam.compat.common.scalars import whole
from warpcam.compat.isaacgym.api.enums import INVALID_HANDLE, MeshType, check_segment, one_of
from warpcam.compat.isaacgym.api.math_types import Vec3
from warpcam.compat.isaacgym.cameras.appearance import MAX_LIGHTS, DirectionalLight
from warpcam.compat.isaacgym.physics.environments import COLLIDES, VISIBLE, Actor, Env
from warpcam.compat.isaacgym.physics.simulation import Sim, env_of, sim_of
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, read_named
from warpcam.sources.common.images import UnreadableError, decoded

FLAGS = {
    MeshType.MESH_NONE: 0,
    MeshType.MESH_COLLISION: COLLIDES,
    MeshType.MESH_VISUAL: VISIBLE,
    MeshType.MESH_VISUAL_AND_COLLISION: COLLIDES | VISIBLE,
}


class AppearanceCalls:
    """See ``Gym``."""

    def set_rigid_body_segmentation_id(self, env: Env, actor: int, body: int, segmentation_id: int) -> None:
        """Set the value of ``IMAGE_SEGMENTATION`` for a body."""
        where = "set_rigid_body_segmentation_id"
        found = env_of(env, where).actor(actor, where)
        check_segment(segmentation_id, where)
        found.segments[found.body(body, where)] = int(segmentation_id)
        env.sim.appearance.changed += 1

    def get_rigid_body_segmentation_id(self, env: Env, actor: int, body: int) -> int:
        where = "get_rigid_body_segmentation_id"
        found = env_of(env, where).actor(actor, where)
        return int(found.segments[found.body(body, where)])

    def set_rigid_body_color(self, env: Env, actor: int, body: int, mesh_type: MeshType, color: Vec3) -> None:
        """Paint shapes of a body; a texture stays, and is multiplied by the colour.

        Args:
            env: The environment.
            actor: Handle.
            body: Index in the actor.
            mesh_type: Which of its shapes.
            color: Display colour in [0, 1].
        """
        found, shapes = _shapes(env, actor, body, mesh_type, "set_rigid_body_color")
        values = _numbers(color, "set_rigid_body_color: color")
        if not all(0.0 <= value <= 1.0 for value in values):
            raise WarpcamError(f"set_rigid_body_color: color must be in [0, 1], got {color!r}")
        found.colors[shapes] = values
        env.sim.appearance.changed += 1

    def get_rigid_body_color(self, env: Env, actor: int, body: int, mesh_type: MeshType) -> Vec3:
        """Return the colour of the first of those shapes."""
        found, shapes = _shapes(env, actor, body, mesh_type, "get_rigid_body_color")
        if not len(shapes):
            raise WarpcamError(f"get_rigid_body_color: body {body} of {found.name!r} has no {MeshType(mesh_type).name}")
        return Vec3(*found.colors[shapes[0]].tolist())

    def set_rigid_body_texture(self, env: Env, actor: int, body: int, mesh_type: MeshType, texture: int) -> None:
        """Put a texture on shapes of a body.

        The first of a shape, or the first use of a texture that is newer than the scene, builds it again at the next
        render; from then on it is a number that changes.
        """
        found, shapes = _shapes(env, actor, body, mesh_type, "set_rigid_body_texture")
        looks = env.sim.appearance
        if not _is_there(texture, looks.textures):
            known = ", ".join(map(str, looks.textures)) or "none"
            raise WarpcamError(f"set_rigid_body_texture: texture {texture!r} came, there are {known}")
        if len(shapes):
            found.textures[shapes] = texture
            looks.textured += 1

    def get_rigid_body_texture(self, env: Env, actor: int, body: int, mesh_type: MeshType) -> int:
        """Return the texture of the first of those shapes; INVALID_HANDLE for none."""
        found, shapes = _shapes(env, actor, body, mesh_type, "get_rigid_body_texture")
        return int(found.textures[shapes[0]]) if len(shapes) else INVALID_HANDLE

    def reset_actor_materials(self, env: Env, actor: int, mesh_type: MeshType) -> None:
        """Colours and textures as the asset has them."""
        where = "reset_actor_materials"
        found = env_of(env, where).actor(actor, where)
        chosen = FLAGS[one_of(MeshType, mesh_type, f"{where}: mesh type")]
        flags = np.asarray(found.asset.builder.shape_flags, np.int64)
        found.reset_looks(np.flatnonzero(flags & chosen))
        env.sim.appearance.changed += 1
        env.sim.appearance.textured += 1

    def create_texture_from_file(self, sim: Sim, path: str) -> int:
        """Read an image; its handle."""
        try:
            pixels = decoded(
                read_named(path, None, "create_texture_from_file"), FileAccess(None, trusted=True), str(path)
            )
        except WarpcamError:
            raise
        except (TypeError, OSError, UnreadableError) as error:
            raise WarpcamError(f"create_texture_from_file: {str(path)!r} cannot be read: {error}") from error
        shown = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels[..., :3]
        return _texture(sim_of(sim, "create_texture_from_file"), shown)

    def create_texture_from_buffer(self, sim: Sim, width: int, height: int, pixels: np.ndarray) -> int:
        """An image of one's own, RGBA, uint8 of (height, 4 width) or as many numbers; its handle."""
        where = "create_texture_from_buffer"
        array = np.asarray(pixels)
        for name, size in (("width", width), ("height", height)):
            if (whole(size) or 0) < 1:
                raise WarpcamError(f"{where}: {name} must be a whole number of pixels, at least 1, got {size!r}")
        width, height = int(width), int(height)
        if array.dtype != np.uint8 or array.size != 4 * width * height or not array.size:
            raise WarpcamError(
                f"{where}: {4 * width * height} numbers of uint8 are needed, got {array.size} of {array.dtype}"
            )
        return _texture(sim_of(sim, where), array.reshape(height, width, 4)[..., :3])

    def free_texture(self, sim: Sim, texture: int) -> None:
        """Forget a texture, which nothing may have any more."""
        sim = sim_of(sim, "free_texture")
        if not _is_there(texture, sim.appearance.textures):
            raise WarpcamError(f"free_texture: there is no texture {texture!r}")
        for env in sim.envs:
            for actor in env.actors:
                if (actor.textures == texture).any():
                    raise WarpcamError(
                        f"free_texture: texture {texture} is on actor {actor.name!r} of environment {env.index}; "
                        "reset_actor_materials takes it off"
                    )
        del sim.appearance.textures[texture]

    def set_light_parameters(self, sim: Sim, index: int, intensity: Vec3, ambient: Vec3, direction: Vec3) -> None:
        """A directional light, seen from the next render on.

        Args:
            sim: The simulation.
            index: 0 to 3. Only 0 is there at first.
            intensity: What a white surface shows that faces it, linear.
            ambient: What all surfaces show of it, whichever way they face.
            direction: From the scene to the light, of any length; with 0 its intensity goes nowhere.
        """
        sim = sim_of(sim, "set_light_parameters")
        if isinstance(index, bool) or index not in range(MAX_LIGHTS):
            raise WarpcamError(f"set_light_parameters: index must be 0 to {MAX_LIGHTS - 1}, got {index!r}")
        toward = _numbers(direction, "set_light_parameters: direction")
        light = _numbers(intensity, "set_light_parameters: intensity")
        everywhere = _numbers(ambient, "set_light_parameters: ambient")
        for name, values, came in (("intensity", light, intensity), ("ambient", everywhere, ambient)):
            if min(values) < 0.0:
                raise WarpcamError(f"set_light_parameters: {name} must not be negative, got {came!r}")
        sim.appearance.lamps[int(index)] = DirectionalLight(light, everywhere, toward)
        sim.appearance.lit += 1


def _shapes(env: Any, actor: Any, body: Any, mesh_type: Any, where: str) -> tuple[Actor, np.ndarray]:
    """Places of those shapes in their actor."""
    found = env_of(env, where).actor(actor, where)
    flags = FLAGS[one_of(MeshType, mesh_type, f"{where}: mesh type")]
    return found, found.asset.shapes_of(found.body(body, where), flags)


def _is_there(texture: Any, textures: Any) -> bool:
    return whole(texture) in textures


def _numbers(value: Any, where: str) -> tuple[float, ...]:
    """Three finite numbers."""
    try:
        numbers = tuple(float(number) for number in value)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise WarpcamError(f"{where} must be a Vec3 of finite numbers, got {value!r}")
    return numbers


def _texture(sim: Sim, pixels: np.ndarray) -> int:
    handle = sim.appearance.next_texture
    sim.appearance.next_texture += 1
    sim.appearance.textures[handle] = np.ascontiguousarray(pixels)
    return handle
