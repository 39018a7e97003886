"""Looking up textures: a colour at a place, filtered over the footprint of a pixel.

Filtering is trilinear: bilinear in the two mipmap levels around log2 of the footprint's longer side, as OpenGL's
LINEAR_MIPMAP_LINEAR. 2-D textures repeat; a cube's faces are joined along their edges.
"""

import warp as wp

from .types import TEXTURE_2D, Textures


@wp.func
def texel(textures: Textures, index: wp.int32) -> wp.vec3:
    """The colour of one texel, each channel 0 to 255."""
    packed = textures.texels[index]
    red = wp.float32(wp.int32(packed & wp.uint32(0xFF)))
    green = wp.float32(wp.int32((packed >> wp.uint32(8)) & wp.uint32(0xFF)))
    blue = wp.float32(wp.int32((packed >> wp.uint32(16)) & wp.uint32(0xFF)))
    return wp.vec3(red, green, blue)


@wp.func
def wrap(index: wp.int32, size: wp.int32) -> wp.int32:
    """``index`` modulo ``size``, never negative: whatever came in, a texel inside the image comes out."""
    inside = index % size
    if inside < 0:
        inside += size
    return inside


@wp.func
def level_of_detail(ddx: wp.vec2, ddy: wp.vec2, levels: wp.int32) -> wp.float32:
    """Mipmap level, 0 to ``levels - 1``, for the steps in texels to the next pixel right and down."""
    longer = wp.max(wp.dot(ddx, ddx), wp.dot(ddy, ddy))
    level = wp.float32(0.0)
    if longer > 1.0:  # false for NaN too
        level = wp.min(0.5 * wp.log2(wp.min(longer, 1.0e30)), wp.float32(levels - 1))
    return level


@wp.func
def bilinear_2d(textures: Textures, start: wp.int32, width: wp.int32, height: wp.int32, uv: wp.vec2) -> wp.vec3:
    """Colour, 0 to 255, at ``uv`` of the level whose first texel is ``start``."""
    x = (uv[0] - wp.floor(uv[0])) * wp.float32(width) - 0.5
    y = (uv[1] - wp.floor(uv[1])) * wp.float32(height) - 0.5
    left = wp.floor(x)
    top = wp.floor(y)
    i0 = wrap(wp.int32(left), width)
    j0 = wrap(wp.int32(top), height)
    i1 = wrap(i0 + 1, width)
    j1 = wrap(j0 + 1, height)
    above = wp.lerp(texel(textures, start + j0 * width + i0), texel(textures, start + j0 * width + i1), x - left)
    below = wp.lerp(texel(textures, start + j1 * width + i0), texel(textures, start + j1 * width + i1), x - left)
    return wp.lerp(above, below, y - top)


@wp.func
def sample_2d(textures: Textures, texture: wp.int32, uv: wp.vec2, ddx: wp.vec2, ddy: wp.vec2) -> wp.vec3:
    """Colour in [0, 1] of a 2-D texture.

    Args:
        textures: All textures.
        texture: Which of them.
        uv: (0, 0) is the image's top left corner, (1, 1) its bottom right; repeats beyond.
        ddx: Change of ``uv`` from this pixel to the next on the right.
        ddy: Change of ``uv`` from this pixel to the next below.
    """
    width = textures.width[texture]
    height = textures.height[texture]
    levels = textures.levels[texture]
    start = textures.start[texture]
    size = wp.vec2(wp.float32(width), wp.float32(height))
    detail = level_of_detail(wp.cw_mul(ddx, size), wp.cw_mul(ddy, size), levels)
    level = wp.int32(detail)
    for _step in range(level):
        start += width * height
        width = wp.max(width // 2, 1)
        height = wp.max(height // 2, 1)
    color = bilinear_2d(textures, start, width, height, uv)
    blend = detail - wp.float32(level)
    if blend > 0.0:  # then there is a next level: detail is at most levels - 1
        start += width * height
        coarse = bilinear_2d(textures, start, wp.max(width // 2, 1), wp.max(height // 2, 1), uv)
        color = wp.lerp(color, coarse, blend)
    return color / 255.0


@wp.func
def cube_face(direction: wp.vec3) -> wp.int32:
    """The face of the cube that ``direction`` points at: 0 to 5 for +x -x +y -y +z -z."""
    x = wp.abs(direction[0])
    y = wp.abs(direction[1])
    z = wp.abs(direction[2])
    face = wp.int32(0)
    if x >= y and x >= z:
        face = wp.where(direction[0] < 0.0, 1, 0)
    elif y >= z:
        face = wp.where(direction[1] < 0.0, 3, 2)
    else:
        face = wp.where(direction[2] < 0.0, 5, 4)
    return face


@wp.func
def to_face(face: wp.int32, v: wp.vec3) -> wp.vec3:
    """``v`` in a face's own axes: right and down in its image, and outwards. The faces' axes are OpenGL's."""
    turned = wp.vec3(-v[2], -v[1], v[0])
    if face == 1:
        turned = wp.vec3(v[2], -v[1], -v[0])
    elif face == 2:
        turned = wp.vec3(v[0], v[2], v[1])
    elif face == 3:
        turned = wp.vec3(v[0], -v[2], -v[1])
    elif face == 4:
        turned = wp.vec3(v[0], -v[1], v[2])
    elif face == 5:
        turned = wp.vec3(-v[0], -v[1], -v[2])
    return turned


@wp.func
def from_face(face: wp.int32, v: wp.vec3) -> wp.vec3:
    """The inverse of ``to_face``."""
    turned = wp.vec3(v[2], -v[1], -v[0])
    if face == 1:
        turned = wp.vec3(-v[2], -v[1], v[0])
    elif face == 2:
        turned = wp.vec3(v[0], v[2], v[1])
    elif face == 3:
        turned = wp.vec3(v[0], -v[2], -v[1])
    elif face == 4:
        turned = wp.vec3(v[0], -v[1], v[2])
    elif face == 5:
        turned = wp.vec3(-v[0], -v[1], -v[2])
    return turned


@wp.func
def cube_texel(
    textures: Textures, start: wp.int32, size: wp.int32, face: wp.int32, i: wp.int32, j: wp.int32
) -> wp.vec3:
    """A texel of a cube, up to one beyond the face's edge: then the one there on the neighbouring face."""
    other = face
    column = i
    row = j
    if i < 0 or j < 0 or i >= size or j >= size:
        half = 0.5 * wp.float32(size)
        place = wp.vec3((wp.float32(i) + 0.5) / half - 1.0, (wp.float32(j) + 0.5) / half - 1.0, 1.0)
        direction = from_face(face, place)
        other = cube_face(direction)
        place = to_face(other, direction)
        column = wp.int32((place[0] / place[2] + 1.0) * half)
        row = wp.int32((place[1] / place[2] + 1.0) * half)
    column = wp.clamp(column, 0, size - 1)
    row = wp.clamp(row, 0, size - 1)
    return texel(textures, start + (other * size + row) * size + column)


@wp.func
def bilinear_cube(textures: Textures, start: wp.int32, size: wp.int32, face: wp.int32, st: wp.vec2) -> wp.vec3:
    """Colour, 0 to 255, at ``st`` of a face, in the level whose first texel is ``start``."""
    x = st[0] * wp.float32(size) - 0.5
    y = st[1] * wp.float32(size) - 0.5
    left = wp.floor(x)
    top = wp.floor(y)
    i = wp.clamp(wp.int32(left), -1, size - 1)
    j = wp.clamp(wp.int32(top), -1, size - 1)
    above = wp.lerp(
        cube_texel(textures, start, size, face, i, j), cube_texel(textures, start, size, face, i + 1, j), x - left
    )
    below = wp.lerp(
        cube_texel(textures, start, size, face, i, j + 1),
        cube_texel(textures, start, size, face, i + 1, j + 1),
        x - left,
    )
    return wp.lerp(above, below, y - top)


@wp.func
def sample_cube(textures: Textures, texture: wp.int32, direction: wp.vec3, ddx: wp.vec3, ddy: wp.vec3) -> wp.vec3:
    """Colour in [0, 1] of a cube texture.

    Args:
        textures: All textures.
        texture: Which of them.
        direction: From the cube's middle, of any length.
        ddx: Change of ``direction`` from this pixel to the next on the right.
        ddy: Change of ``direction`` from this pixel to the next below.
    """
    size = textures.width[texture]
    levels = textures.levels[texture]
    start = textures.start[texture]
    face = cube_face(direction)
    place = to_face(face, direction)
    outwards = wp.max(place[2], 1.0e-20)
    st = wp.vec2(0.5 * (place[0] / outwards + 1.0), 0.5 * (place[1] / outwards + 1.0))
    right = to_face(face, ddx)
    down = to_face(face, ddy)
    scale = 0.5 * wp.float32(size) / (outwards * outwards)
    detail = level_of_detail(
        scale * wp.vec2(right[0] * outwards - place[0] * right[2], right[1] * outwards - place[1] * right[2]),
        scale * wp.vec2(down[0] * outwards - place[0] * down[2], down[1] * outwards - place[1] * down[2]),
        levels,
    )
    level = wp.int32(detail)
    for _step in range(level):
        start += 6 * size * size
        size = wp.max(size // 2, 1)
    color = bilinear_cube(textures, start, size, face, st)
    blend = detail - wp.float32(level)
    if blend > 0.0:
        coarse = bilinear_cube(textures, start + 6 * size * size, wp.max(size // 2, 1), face, st)
        color = wp.lerp(color, coarse, blend)
    return color / 255.0


@wp.func
def is_texture(textures: Textures, texture: wp.int32) -> wp.bool:
    """Whether ``texture`` names a texture: indices can be written by the user at any time."""
    return texture >= 0 and texture < textures.kind.shape[0]


@wp.func
def is_2d(textures: Textures, texture: wp.int32) -> wp.bool:
    """Whether it is a 2-D texture, not a cube."""
    return textures.kind[texture] == TEXTURE_2D
