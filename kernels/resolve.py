"""From the visibility buffer to images: one kernel per camera writes every output that was asked for."""

import functools
from collections.abc import Mapping
from typing import Any

import warp as wp

from .facet import facet_corner, facet_weight, make_facet
from .launch import Group, Stage
from .launch import record as record_stage
from .mapping import make_mapping
from .pack import to_byte
from .shade import clip, make_illuminate
from .surface import make_finish, make_surface
from .tables import Tables
from .texture import is_2d, is_texture, sample_2d, sample_cube
from .types import HEIGHT_FIELD, MESH, Background, HeightFields, Lights, Materials, Meshes, Shapes, Textures, View

# The outputs made here, with the dtype and the number of channels of their arrays (world, height, width, channels).
OUTPUTS: Mapping[str, tuple[type, int]] = {
    "rgb": (wp.uint8, 3),
    "rgba": (wp.uint8, 4),
    "hdr": (wp.float32, 3),
    "distance": (wp.float32, 1),
    "normals": (wp.float32, 3),
    "points": (wp.float32, 3),
    "bodies": (wp.int32, 1),
    "albedo": (wp.uint8, 3),
}

# Threads of a CUDA block, and how many blocks a multiprocessor is to hold: at most 128 registers a thread.
THREADS = 128
BLOCKS = 4


@wp.struct
class Frame:
    """One camera's visibility in all worlds: what the kernel reads."""

    views: wp.array(dtype=View)  # (world,)
    mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
    depth: wp.array(dtype=wp.float32)  # (pixel,) planar depth [m]
    shape: wp.array(dtype=wp.int32)  # (pixel,) or -1 where nothing was hit
    face: wp.array(dtype=wp.int32)  # (pixel,) see surface.py
    shadow: wp.array(dtype=wp.int32)  # (pixel,) bit l: light l does not reach the pixel; empty without shadows
    width: wp.int32
    height: wp.int32
    horizon: wp.float32  # see facet.py [m]


@wp.struct
class Images:
    """What the kernel writes, (pixel, channel) each; empty where it was not asked for."""

    rgb: wp.array2d(dtype=wp.uint8)
    rgba: wp.array2d(dtype=wp.uint8)
    hdr: wp.array2d(dtype=wp.float32)
    distance: wp.array2d(dtype=wp.float32)
    normals: wp.array2d(dtype=wp.float32)
    points: wp.array2d(dtype=wp.float32)
    bodies: wp.array2d(dtype=wp.int32)
    albedo: wp.array2d(dtype=wp.uint8)


@wp.func
def write_vec3(values: wp.array2d(dtype=wp.float32), pixel: wp.int32, value: wp.vec3):
    """Write the three channels of one pixel."""
    for k in range(3):
        values[pixel, k] = value[k]


@wp.func
def write_color(values: wp.array2d(dtype=wp.uint8), pixel: wp.int32, color: wp.vec3):
    """Write the three colour channels of one pixel, clipped to [0, 1]."""
    for k in range(3):
        values[pixel, k] = to_byte(color[k])


@wp.func
def slide(step: wp.vec3, ray: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """``step`` carried along ``ray`` into the plane of ``normal``: how far the hit moves from pixel to pixel."""
    slope = wp.dot(normal, ray)
    if wp.abs(slope) < 1.0e-12 * wp.length(ray):
        return step * 1.0e6
    return step - ray * (wp.dot(normal, step) / slope)


@functools.cache
def make_kernel(outputs: frozenset[str], lens: str, facts: tuple[Any, ...], shadows: bool) -> wp.Kernel:
    """The kernel for one set of outputs, lens and scene facts (``Tables.facts()``)."""
    shape_types, num_lights, has_materials, has_textures, has_skybox = facts
    perspective = lens == "pinhole"
    display = bool(outputs & {"rgb", "rgba"})
    lit = display or "hdr" in outputs
    colored = lit or "albedo" in outputs
    textured = colored and has_materials and has_textures
    surfaced = lit or textured or "normals" in outputs
    has_faces = MESH in shape_types or HEIGHT_FIELD in shape_types
    placed = surfaced or colored or "points" in outputs

    surface_at = make_surface(shape_types)
    finish_of = make_finish(has_materials)
    map_2d, map_cube, has_own_uvs = make_mapping(shape_types)
    facet_at = make_facet(shape_types)
    illuminate = make_illuminate(num_lights, shadows)

    @wp.func
    def background_color(background: Background, textures: Textures, direction: wp.vec3, right: wp.vec3, down: wp.vec3):
        """Colour where nothing is hit. The skybox lies on its side: its y axis is the world's z."""
        color = background.color
        if wp.static(has_skybox):
            if is_texture(textures, background.skybox):
                color = sample_cube(
                    textures,
                    background.skybox,
                    wp.vec3(direction[0], direction[2], -direction[1]),
                    wp.vec3(right[0], right[2], -right[1]),
                    wp.vec3(down[0], down[2], -down[1]),
                )
        return color

    @wp.kernel(module="unique", enable_backward=False, grid_stride=False, launch_bounds=(THREADS, BLOCKS))
    def resolve(
        frame: Frame,
        images: Images,
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        materials: Materials,
        textures: Textures,
        lights: Lights,
        background: Background,
        first: wp.int32,
    ):
        pixel = first + wp.tid()
        pixels = frame.width * frame.height
        world = pixel // pixels
        if frame.mask[world] == wp.uint8(0):
            return
        row = (pixel - world * pixels) // frame.width
        column = pixel - world * pixels - row * frame.width
        view = frame.views[world]
        x = (wp.float32(column) + 0.5 - view.center[0]) * view.scale[0]
        y = (view.center[1] - wp.float32(row) - 0.5) * view.scale[1]
        origin = view.origin
        ray = wp.vec3()
        if wp.static(perspective):
            ray = view.rotation * wp.vec3(x, y, -1.0)
        else:
            origin = origin + view.rotation * wp.vec3(x, y, 0.0)
            ray = view.rotation * wp.vec3(0.0, 0.0, -1.0)
        # What one pixel to the right and one down changes: the ray's direction, or in parallel projection its origin.
        right = view.rotation * wp.vec3(view.scale[0], 0.0, 0.0)
        down = view.rotation * wp.vec3(0.0, -view.scale[1], 0.0)

        shape = frame.shape[pixel]
        if shape < 0:
            if wp.static(colored):
                color = wp.vec3()
                if wp.static(lit):
                    if wp.static(perspective):
                        color = background_color(background, textures, ray, right, down)
                    else:
                        color = background_color(background, textures, ray, wp.vec3(), wp.vec3())
                if wp.static("rgb" in outputs):
                    write_color(images.rgb, pixel, color)
                if wp.static("rgba" in outputs):
                    write_color(images.rgba, pixel, color)
                    images.rgba[pixel, 3] = wp.uint8(0)
                if wp.static("hdr" in outputs):
                    write_vec3(images.hdr, pixel, color)
                if wp.static("albedo" in outputs):
                    write_color(images.albedo, pixel, wp.vec3())
            if wp.static("distance" in outputs):
                images.distance[pixel, 0] = wp.inf
            if wp.static("normals" in outputs):
                write_vec3(images.normals, pixel, wp.vec3())
            if wp.static("points" in outputs):
                write_vec3(images.points, pixel, wp.vec3(wp.inf, wp.inf, wp.inf))
            if wp.static("bodies" in outputs):
                images.bodies[pixel, 0] = -1
            return

        depth = frame.depth[pixel]
        if wp.static("distance" in outputs):
            if wp.static(perspective):
                images.distance[pixel, 0] = depth * wp.length(wp.vec3(x, y, -1.0))
            else:
                images.distance[pixel, 0] = depth
        if wp.static("bodies" in outputs):
            images.bodies[pixel, 0] = shapes.bodies[shape]
        if wp.static(placed):
            position = origin + depth * ray
            if wp.static("points" in outputs):
                write_vec3(images.points, pixel, position)
            if wp.static(surfaced):
                rotation = shapes.rotations[world, shape]
                to_local = wp.transpose(rotation)
                local_ray = to_local * ray
                local = to_local * (origin - shapes.positions[world, shape]) + depth * local_ray
                face = wp.int32(0)
                if wp.static(has_faces):
                    face = frame.face[pixel]
                surface = surface_at(shapes, meshes, fields, world, shape, face, local, local_ray)
                if wp.static("normals" in outputs):
                    normal = rotation * surface.normal
                    if wp.dot(normal, ray) > 0.0:
                        normal = -normal
                    write_vec3(images.normals, pixel, normal)
            if wp.static(colored):
                finish = finish_of(shapes, materials, world, shape)
                texture = wp.vec3(1.0, 1.0, 1.0)
                if wp.static(textured):
                    if is_texture(textures, finish.texture):
                        stretch = wp.where(wp.static(perspective), depth, 1.0)
                        ddx = slide(stretch * (to_local * right), local_ray, surface.normal)
                        ddy = slide(stretch * (to_local * down), local_ray, surface.normal)
                        if is_2d(textures, finish.texture):
                            at = map_2d(shapes, meshes, fields, world, shape, surface, finish)
                            texture = sample_2d(
                                textures,
                                finish.texture,
                                at.uv,
                                wp.vec2(wp.dot(at.du, ddx), wp.dot(at.dv, ddx)),
                                wp.vec2(wp.dot(at.du, ddy), wp.dot(at.dv, ddy)),
                            )
                        elif not has_own_uvs(shapes, meshes, world, shape):
                            into = map_cube(shapes, meshes, fields, world, shape, surface, finish)
                            texture = sample_cube(
                                textures,
                                finish.texture,
                                into.direction,
                                wp.cw_mul(into.scale, ddx),
                                wp.cw_mul(into.scale, ddy),
                            )
                if wp.static("albedo" in outputs):
                    base = wp.vec3(finish.color[0], finish.color[1], finish.color[2])
                    write_color(images.albedo, pixel, wp.cw_mul(clip(base), texture))
                if wp.static(lit):
                    shadow = wp.int32(0)
                    if wp.static(shadows):
                        shadow = frame.shadow[pixel]
                    forward = view.rotation * wp.vec3(0.0, 0.0, -1.0)
                    linear = wp.vec3()
                    shown = wp.vec3()
                    eye = to_local * (view.origin - shapes.positions[world, shape])
                    facet = facet_at(shapes, meshes, fields, world, shape, face, surface, finish, eye, frame.horizon)
                    for corner in range(facet.corners):
                        place = rotation * facet_corner(facet, corner) + shapes.positions[world, shape]
                        normal = surface.shading
                        if wp.static(MESH in shape_types):
                            if shapes.types[shape] == MESH:
                                normal = meshes.normals[surface.corner + corner]
                        light = illuminate(
                            lights, world, place, rotation * normal, view.origin, forward, finish, shadow
                        )
                        weight = facet_weight(facet, corner)
                        linear += weight * light.linear
                        shown += weight * light.display
                    if wp.static("hdr" in outputs):
                        write_vec3(images.hdr, pixel, wp.cw_mul(linear, texture))
                    if wp.static(display):
                        color = wp.cw_mul(shown, texture)
                        if wp.static("rgb" in outputs):
                            write_color(images.rgb, pixel, color)
                        if wp.static("rgba" in outputs):
                            write_color(images.rgba, pixel, color)
                            images.rgba[pixel, 3] = wp.uint8(255)

    return resolve


def record(
    outputs: Mapping[str, wp.array],
    lens: str,
    tables: Tables,
    views: wp.array,
    mask: wp.array,
    depth: wp.array,
    shape: wp.array,
    face: wp.array,
    shadow: wp.array | None,
    width: int,
    height: int,
    device: wp.Device,
    group: Group | None = None,
) -> Stage:
    """Bind the kernel that writes ``outputs`` to one camera's buffers.

    Args:
        outputs: Contiguous arrays (world, height, width, channels) by name; see ``OUTPUTS``.
        lens: "pinhole" or "orthographic".
        tables: The scene.
        views: (world,) of ``View``.
        mask: uint8 (world,); 0 leaves the world's images alone.
        depth: Planar depth [m], float32 (world, height, width).
        shape: Shape ids, int32 (world, height, width), -1 where nothing is hit.
        face: Faces, int32 (world, height, width): of a mesh counted in leaf order, of a height field twice the cell
            plus the triangle (0 below, 1 above the diagonal from low to high row and column), -1 for its sides.
        shadow: int32 (world, height, width); bit l is set where light l is hidden. None: nothing casts shadows.
        width: Of the image [pixels].
        height: Of the image [pixels].
        device: Where everything lies.
        group: Which worlds are drawn; None is all.
    """
    unknown = sorted(set(outputs) - set(OUTPUTS))
    if unknown:
        raise ValueError(f"outputs: {unknown} are not made here; these are: {sorted(OUTPUTS)}")
    frame = Frame()
    frame.views = views
    frame.mask = mask
    frame.depth = depth.flatten()
    frame.shape = shape.flatten()
    frame.face = face.flatten()
    frame.shadow = shadow.flatten() if shadow is not None else wp.empty(0, dtype=wp.int32, device=device)
    frame.width = width
    frame.height = height
    frame.horizon = tables.horizon
    images = Images()
    pixels = tables.num_worlds * width * height
    for name, (dtype, channels) in OUTPUTS.items():
        if name in outputs:
            setattr(images, name, outputs[name].reshape((pixels, channels)))
        else:
            setattr(images, name, wp.empty((0, channels), dtype=dtype, device=device))
    kernel = make_kernel(frozenset(outputs), lens, tables.facts(), shadow is not None)
    worlds = (group or Group.of_all(tables.num_worlds)).worlds
    inputs = [
        frame,
        images,
        tables.shapes,
        tables.meshes,
        tables.height_fields,
        tables.materials,
        tables.textures,
        tables.lights,
        tables.background,
    ]
    unit = width * height
    return record_stage(kernel, len(worlds) * unit, inputs, device, start=worlds.start * unit, block_dim=THREADS)
