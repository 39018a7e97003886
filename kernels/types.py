"""The structs that cross a launch.

A field whose shape begins with ``(world*, ...)`` has a leading dimension of any length n >= 1 and is read at
``world % n``: length 1 is one value shared by all worlds. Indices of -1 mean "none". Lengths are metres,
angles radians, colours linear factors in [0, 1] unless said otherwise.
"""

import warp as wp

# Shape types: the values of MuJoCo's mjtGeom, whose vocabulary other sources are translated to.
PLANE = 0
HEIGHT_FIELD = 1
SPHERE = 2
CAPSULE = 3
ELLIPSOID = 4
CYLINDER = 5
BOX = 6
MESH = 7
# Beyond MuJoCo's.
CONE = 8  # tip at +z
BARREL = 9  # a cylinder whose side is bent outwards in an arc
NUM_TYPES = 10
SPLATS = 10  # a cloud of Gaussians: never among the drawn shapes, which the trace sees; see Splats

# Light types.
LIGHT_SPOT = 0
LIGHT_DIRECTIONAL = 1

# What lights of physically based scenes look like from afar; those that are directional are none of these.
FORM_POINT = 0
FORM_SPHERE = 1
FORM_DISK = 2
FORM_RECTANGLE = 3
FORM_CYLINDER = 4

UNLIT = -1.0  # reflectance of a physically based material that shows its colour whatever the light is

# Roles of a material's textures: places in Materials.texture. The values are those of MuJoCo's mjtTextureRole.
ROLE_COLOR = 1
ROLE_NORMAL = 5  # x, y, z in [-1, 1] as 0 to 255; x along u, y along v, which is up
ROLE_OPACITY = 6  # red: opacity; not of cut-outs, whose maps only Meshes.masks has
ROLE_EMISSION = 7  # display values
ROLE_PACKED = 9  # red: share of the light from all around that arrives, green: roughness, blue: metalness
NUM_ROLES = 10

SKY_TERMS = 9  # of spherical harmonics of order 2; see native/shading/environment.h

# Texture kinds.
TEXTURE_2D = 0
TEXTURE_CUBE = 1


@wp.struct
class Shapes:
    """Visible shapes: a table over worlds and shapes.

    ``shape`` is the source's own id (a MuJoCo geom id), or a column whose ids in each world are in ``ids``.
    """

    drawn: wp.array(dtype=wp.int32)  # (drawn,) ids of the shapes that may be visible, ascending
    places: wp.array(dtype=wp.int32)  # (shape,) where the shape stands in `drawn`, or -1
    types: wp.array(dtype=wp.int32)  # (shape,) one of the shape types above
    bodies: wp.array(dtype=wp.int32)  # (shape,) id of the body the shape is fixed to
    # (shape,) the next of those that stand where it does, around to the first, or -1; empty: COINCIDENT is not among
    # the scene's flags
    coincident: wp.array(dtype=wp.int32)
    ids: wp.array2d(dtype=wp.int32)  # (world, shape) the source's id, -1 where a world has none; empty: as `shape`
    body_ids: wp.array2d(dtype=wp.int32)  # (world, shape) likewise, instead of `bodies`
    positions: wp.array2d(dtype=wp.vec3)  # (world, shape) world frame [m]; NaN hides the shape's world
    # (world, shape) columns are the shape's axes in the world frame; zeros are a fault of a world that draws the shape
    rotations: wp.array2d(dtype=wp.mat33)
    # (world*, shape) sphere r; capsule, cylinder and cone (r, half length along z); barrel (r of its ends, half
    # length, r of its arc or 0 for a straight side); ellipsoid and box half extents; plane half widths
    # in x and y, 0 = infinite; meshes and height fields: scales along their axes if PER_SHAPE_SCALE is among
    # the scene's flags, else not read [m]. A size of which nothing is above 0 is a fault as zeros of a rotation are
    sizes: wp.array2d(dtype=wp.vec3)
    assets: wp.array2d(dtype=wp.int32)  # (world*, shape) index of the mesh or height field; -1 draws nothing
    materials: wp.array2d(dtype=wp.int32)  # (world*, shape) index into Materials, or -1
    # (world*, shape) RGBA; how it meets the material: load_material() of native/shading/resolved_material.h
    colors: wp.array2d(dtype=wp.vec4)


@wp.struct
class Meshes:
    """Triangle meshes in their own frames, shared by all worlds, all in the same few arrays."""

    bounds_min: wp.array(dtype=wp.vec3)  # (mesh,) corner of the bounding box [m]
    bounds_max: wp.array(dtype=wp.vec3)  # (mesh,)
    node_start: wp.array(dtype=wp.int32)  # (mesh,) row of its root node in `nodes`
    face_start: wp.array(dtype=wp.int32)  # (mesh,) row of its first face in `faces`
    num_faces: wp.array(dtype=wp.int32)  # (mesh,) in `faces`, as often as they stand there
    # (row,) a node of the 4-wide tree. On a CPU 7 rows: lower x, y, z and upper x, y, z of four children, then the four
    # children as int bits: a node's index, or -(first_face * 16 + count) - 1 for a leaf; both relative to the mesh.
    # On CUDA 4 rows: x, y, z of four children, lower bounds in the lower halves of the words and upper bounds in the
    # upper ones, as 32760ths of the mesh's greatest coordinate and 32768 for 0; then the children. In scenes where
    # meshes move 8 rows, of each child lower x, y, z and the child; upper x, y, z and nothing. An absent child has all
    # its bounds at 1e30, or lower ones above the upper ones, and no faces.
    nodes: wp.array(dtype=wp.vec4)
    # (row,) a face is 3 rows, its corners, counterclockwise seen from the front; in leaf order, and
    # once for each leaf that it stands in. The fourth component holds int bits: of the first row the face's index among
    # the mesh's faces as they were given, of the second that of its back, with corners 0, 2, 1, if it has one, else 0;
    # of the third of faces with a back 1 where both sides are flat and `normals` does not have them; in scenes without
    # such faces, and where no mesh moves, the face's horizon: see native/accel/horizon_map.h.
    faces: wp.array(dtype=wp.vec4)
    # Shading data, by corner of the faces as given: corner 3 * (corner_start + face) + k.
    corner_start: wp.array(dtype=wp.int32)  # (mesh,) first face in the two arrays below
    normals: wp.array(dtype=wp.vec3)  # (corner,) unit, mesh frame
    uvs: wp.array(dtype=wp.vec2)  # (corner,) texture coordinates, v up; only read where has_uvs
    # (mesh,) 1 where the mesh has texture coordinates, else 0. If TEXTURELESS_SHAPES is among the scene's flags also
    # 2: it has, and no texture is `texture_uniform`; and -1: it has none, and shows no texture
    has_uvs: wp.array(dtype=wp.int32)
    # (mesh * 128,) boxes that stop light and an outline, see native/shadow/occluder_boxes.h; empty where shadows do not
    # need them
    occluder_boxes: wp.array(dtype=wp.vec4)
    # Only where ALPHA_TESTED is among the scene's flags. (mesh,) as int bits first texel, width and height of the map
    # of its opacity, in red, or zeros; least opacity at which it is there
    masks: wp.array(dtype=wp.vec4)
    mask_texels: wp.array(dtype=wp.uint32)  # those of Textures


@wp.struct
class HeightFields:
    """Terrain: a grid of heights over a box, with sides and a base, and what the trace walks it by."""

    size: wp.array(dtype=wp.vec4)  # (hfield,) half width x, half width y, height of 1.0, depth of the base [m]
    rows: wp.array(dtype=wp.int32)  # (hfield,) samples along y
    columns: wp.array(dtype=wp.int32)  # (hfield,) samples along x
    height_start: wp.array(dtype=wp.int32)  # (hfield,) first sample in `heights`
    heights: wp.array(dtype=wp.float32)  # (sample,) row-major, y then x, [m]
    # (row,) what the trace walks by; a field is 2 rows: cells per metre along x and y, greatest height, and as int bits
    # levels; as int bits cells along x and y, first entry in `peaks`, first entry in `cells`.
    # Levels: the least number of which 2^levels is not less than the cells along either side.
    grids: wp.array(dtype=wp.vec4)
    # (cell,) row-major, y then x: height h of the lowest corner, rises a and b along x and y, fold c; at (u, v) in the
    # cell, each in [0, 1], the ground's height is h + a u + b v + c max(u - v, 0) [m]
    cells: wp.array(dtype=wp.vec4)
    # (entry,) greatest height of the blocks of 2^level cells a side, (row, ceil(cells along x / 2)): block (r, c) of a
    # level lies at row 2^(levels - level) + r, column c [m]
    peaks: wp.array(dtype=wp.float32)


@wp.struct
class Materials:
    """Materials of surfaces. MuJoCo's material, which other sources are translated to."""

    color: wp.array2d(dtype=wp.vec4)  # (world*, material) RGBA
    emission: wp.array2d(dtype=wp.float32)  # (world*, material) factor of the surface's own colour
    specular: wp.array2d(dtype=wp.float32)  # (world*, material)
    shininess: wp.array2d(dtype=wp.float32)  # (world*, material) in [0, 1]; the exponent is 128 times it
    # (world*, material, role) index into Textures or -1; physically based scenes have NUM_ROLES, others 2
    texture: wp.array3d(dtype=wp.int32)
    texture_repeat: wp.array2d(dtype=wp.vec2)  # (world*, material)
    texture_uniform: wp.array2d(dtype=wp.bool)  # (world*, material) repeat per metre instead of per shape


@wp.struct
class Textures:
    """Images with their mipmaps, packed one after another."""

    kind: wp.array(dtype=wp.int32)  # (texture,) TEXTURE_2D or TEXTURE_CUBE (also skyboxes)
    width: wp.array(dtype=wp.int32)  # (texture,) of level 0 [pixels]
    height: wp.array(dtype=wp.int32)  # (texture,) of level 0, of one face for cubes [pixels]
    levels: wp.array(dtype=wp.int32)  # (texture,) number of mipmap levels
    start: wp.array(dtype=wp.int32)  # (texture,) first texel in `texels`
    # (texel,) R | G << 8 | B << 16 | A << 24, display values. Level after level; a level of a cube holds its six
    # faces, +x -x +y -y +z -z, one after another; rows from the top of the image.
    texels: wp.array(dtype=wp.uint32)
    atlases: wp.array(dtype=wp.uint64)  # (texture,) CUDA's texture object of its mip atlas; 0: none
    mips: wp.array(dtype=wp.uint64)  # (texture,) the same of a mipmapped one


@wp.struct
class Lights:
    """Lights of the scene, and the headlight that moves with each camera."""

    types: wp.array2d(dtype=wp.int32)  # (world*, light) LIGHT_SPOT or LIGHT_DIRECTIONAL; others give no light
    active: wp.array2d(dtype=wp.bool)  # (world*, light)
    casts_shadow: wp.array2d(dtype=wp.bool)  # (world*, light)
    positions: wp.array2d(dtype=wp.vec3)  # (world, light) world frame [m]
    directions: wp.array2d(dtype=wp.vec3)  # (world, light) from the light outwards, world frame, unit
    attenuation: wp.array2d(dtype=wp.vec3)  # (world*, light) constant, linear, quadratic; spot lights only
    cutoff: wp.array2d(dtype=wp.float32)  # (world*, light) half angle of a spot [degrees]
    exponent: wp.array2d(dtype=wp.float32)  # (world*, light) falloff of a spot
    ambient: wp.array2d(dtype=wp.vec3)  # (world*, light)
    diffuse: wp.array2d(dtype=wp.vec3)  # (world*, light)
    specular: wp.array2d(dtype=wp.vec3)  # (world*, light)
    headlight: wp.array(dtype=wp.vec3)  # (3,) ambient, diffuse, specular of the headlight; zeros when it is off
    global_ambient: wp.float32  # light that is everywhere
    # How far shadows reach: native/shadow/light_space.h, MapSize.
    shadow_width: wp.float32  # half the width of what a directional light sees [m]; 0: shadows reach everywhere
    shadow_near: wp.float32  # nothing nearer to a light casts a shadow [m]
    shadow_scale: wp.float32  # half the angle of what a spot sees, as part of its cutoff
    shadow_gap: wp.float32  # no single face nearer to a surface shades it, as a part of half the width of what it sees


@wp.struct
class EnvironmentMaps:
    """Images of light from all around, in float, and which of them each world has: native/shading/environment_map.h."""

    texels: wp.array(dtype=wp.vec4)  # (texel,) linear radiance of all images and maps, one after another
    layouts: wp.array(dtype=wp.int32)  # (image * ENVIRONMENT_NUMBERS,) where the parts of each begin, and their sizes
    # sums of the shares of an image's rows, 0 first, and of each row's texels; empty where no paths draw them
    sums: wp.array(dtype=wp.float32)
    # (world, ENVIRONMENT_ROWS) the axes of the image in the world: middle, left, up; and the factor of its light. w of
    # the first is the image's number, or -1
    rows: wp.array2d(dtype=wp.vec4)


@wp.struct
class Physical:
    """Tables of physically based scenes beside Materials and Lights, whose colours have another meaning here.

    A light's diffuse and specular colours are what a white surface that faces it shows: of a directional light
    anywhere, of a point as its attenuation has it; of lights of a size they are its radiance. All of it linear.
    """

    plain: Lights
    roughness: wp.array2d(dtype=wp.float32)  # (world*, material) in [0, 1]
    metallic: wp.array2d(dtype=wp.float32)  # (world*, material) in [0, 1]
    # (world*, material) of what is no metal, for light that falls straight; below 0: UNLIT
    reflectance: wp.array2d(dtype=wp.float32)
    emissive: wp.array2d(dtype=wp.vec3)  # (world*, material) linear, added to what Materials.emission gives
    # (world*, material) share of what is not reflected that goes through, as in glass; only paths of light follow it
    transmission: wp.array2d(dtype=wp.float32)
    forms: wp.array2d(dtype=wp.int32)  # (world*, light) one of the forms above
    # (world*, light) point (radius of its bulb, which softens shadows alone, -, -); sphere and disk (radius, -, -);
    # rectangle (half width, half height, -); cylinder (radius, half length, -) [m]; directional lights (squared
    # sine of the angle from the middle to the edge, -, -)
    sizes: wp.array2d(dtype=wp.vec3)
    rotations: wp.array2d(dtype=wp.mat33)  # (world, light) columns are its axes; widths and lengths are along x
    # (world*, SKY_TERMS + 1) radiance from all around, linear: see native/shading/environment.h; last the factor of the
    # sky's image
    sky: wp.array2d(dtype=wp.vec3)
    environments: EnvironmentMaps  # of scenes that are lit by such; else empty


@wp.struct
class View:
    """One camera in one world, as the trace wants it. Written by the views kernel each frame."""

    origin: wp.vec3  # centre of projection, world frame [m]; NaN gives the background
    rotation: wp.mat33  # columns right, up, backward in the world frame
    # Pixel (i, j), column and row from the top left, sees along (x, y, -1) from the origin, with
    # x = (i + 0.5 - center[0]) * scale[0] and y = (center[1] - j - 0.5) * scale[1].
    # Orthographic: from (x, y, 0) along (0, 0, -1) instead, x and y in metres.
    # A lens that is a table of rays has its address and size here instead, as bits: native/camera/ray_table.h.
    scale: wp.vec2
    center: wp.vec2  # principal point [pixels]
    near: wp.float32  # nothing nearer than this is seen: planar depth [m]
    far: wp.float32  # nothing farther is seen [m]; may be infinite
    miss: wp.float32  # depth where nothing is hit


@wp.struct
class Background:
    """Colour of pixels that hit nothing."""

    color: wp.vec3  # display colour
    skybox: wp.int32  # index of a cube texture, or -1


@wp.struct
class Splats:
    """Clouds of Gaussians in their own frames, shared by all worlds, and which shapes are such clouds."""

    columns: wp.array(dtype=wp.int32)  # (n,) shapes whose `assets` count clouds and whose `sizes` are scales along axes
    # (cloud,) as int bits its first node and its first Gaussian; greatest coordinate of its box [m]; squared distance
    # from a Gaussian's centre where the least response is reached [standard deviations]
    clouds: wp.array(dtype=wp.vec4)
    # (row,) a node of the tree over Gaussians is 8 rows, as Meshes.nodes has them on CUDA, here on every device
    nodes: wp.array(dtype=wp.vec4)
    # (row,) a Gaussian is 4 rows, in leaf order: three rows of the matrix that takes its ellipsoid, outside of which it
    # is not seen, to the unit sphere, each with one coordinate of the centre; display colour, opacity
    gaussians: wp.array(dtype=wp.vec4)
    # (row,) coefficients of the harmonics of a Gaussian, red, green, blue, are `harmonic_rows` rows, in the order of
    # `gaussians`; the first has beside them as int bits how many there are, 0, 3, 8 or 15, and 16 where the sum of all
    # is linear light; 0 where no cloud has any. With them the display colour is the part of all rays
    harmonics: wp.array(dtype=wp.vec4)
    harmonic_rows: wp.int32
    # (gaussian,) place of each in the arrays that clouds were given as, of all clouds one after another; empty where
    # their Gaussians never change
    order: wp.array(dtype=wp.int32)
    bits: wp.int32  # of 32: what is below names a Gaussian within its cloud, what is above the place in `columns`
