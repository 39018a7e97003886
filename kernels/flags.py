"""Bits of the kernels' template parameters. The enums of native/ have the same names and values."""

from collections.abc import Iterable
from enum import IntEnum, IntFlag

from warpcam.kernels import types


class GeometryFlag(IntFlag):
    """Shape types among the drawn shapes: bit t is type t of types.py. native/shapes/shape_types.h, ShapeType."""

    PLANE = 1 << types.PLANE
    HEIGHT_FIELD = 1 << types.HEIGHT_FIELD
    SPHERE = 1 << types.SPHERE
    CAPSULE = 1 << types.CAPSULE
    ELLIPSOID = 1 << types.ELLIPSOID
    CYLINDER = 1 << types.CYLINDER
    BOX = 1 << types.BOX
    MESH = 1 << types.MESH
    CONE = 1 << types.CONE
    BARREL = 1 << types.BARREL
    SPLATS = 1 << types.SPLATS  # clouds of Gaussians: never among the drawn shapes, which the trace sees


class SceneFlag(IntFlag):
    """Features of a scene that the kernels of its shapes are compiled for."""

    PER_SHAPE_SCALE = 1 << 0  # the sizes of meshes and height fields are scales
    TWO_SIDED = 1 << 1  # faces of some meshes are seen from behind, too
    ALPHA_TESTED = 1 << 2  # maps of opacity say which parts of meshes are there
    SHADING_BACKS = 1 << 3  # of shadows: faces of meshes cast them whichever side is lit
    DEFORMING_MESHES = 1 << 4  # vertices of meshes move: most faces lie in no cache
    TRANSPARENT_CASTERS = 1 << 5  # of shadows: some shapes may be seen through
    TEXTURE_FROM_ABOVE = 1 << 6  # 2-D textures lie as before MuJoCo 3.12: native/shading/texture_mapping.h
    TEXTURELESS_SHAPES = 1 << 7  # textures do not show on some shapes: native/shading/appearance.h
    # of launches: blocks in the middle of all images come before the rest: native/camera/shape_setup.h
    MIDDLE_FIRST = 1 << 8
    HAS_OCCLUDER_BOXES = 1 << 9  # of shadows: meshes have boxes that stop light
    PROJECTED = 1 << 10  # 2-D textures lie as Newton lays them: native/shading/texture_mapping.h
    TRIPLANAR = 1 << 11  # beside PROJECTED: along all three axes, blended
    TEXTURE_ALPHA = 1 << 12  # textures have an alpha, which counts on what is transparent
    # normals of meshes are written as light takes them, as Newton's camera does: native/geometry/surface_interaction.h
    LIT_NORMALS = 1 << 13
    COINCIDENT = 1 << 14  # shapes of MuJoCo's stand in the same place: native/shading/appearance.h
    # outputs that are not lit see planes from behind, too: native/camera/shape_setup.h
    PLANES_FROM_BEHIND = 1 << 15
    # of shadows: a light without an ambient part gives nothing to what is turned away from it
    BACKS_UNLIT = 1 << 16


NO_SCENE_FLAGS = SceneFlag(0)
# Features that only colours and normals depend on.
APPEARANCE_FLAGS = (
    SceneFlag.TEXTURE_FROM_ABOVE
    | SceneFlag.TEXTURELESS_SHAPES
    | SceneFlag.PROJECTED
    | SceneFlag.TRIPLANAR
    | SceneFlag.TEXTURE_ALPHA
    | SceneFlag.LIT_NORMALS
    | SceneFlag.COINCIDENT
)
# Shapes that rays walk through.
TRAVERSED = GeometryFlag.MESH | GeometryFlag.HEIGHT_FIELD


class Lens(IntEnum):
    """Projections: native/camera/shape_record.h, Lens."""

    PINHOLE = 0
    ORTHOGRAPHIC = 1
    RAYS = 2  # a table of rays
    RAY_TABLE_WITH_ORIGINS = 3


class TraceFlag(IntFlag):
    """Outputs and variants of the trace: native/traversal/trace_outputs.h, Output, and FlowOutput of native/flow/."""

    DEPTH = 1
    SHAPE = 2
    FACE = 4
    DISTANCE = 8
    POINTS = 16
    BODIES = 32
    NORMAL = 64
    WIDTH_MULTIPLE_OF_4 = 128
    NO_PARTIAL_TILES = 256  # no tile reaches over the image's edges
    LISTED_AHEAD = 512  # shapes have been listed: native/traversal/visibility_listed.h
    IDS = 1 << 16  # ids by world
    BY_WORLD = 1 << 17  # bodies have ids by world, too
    INSTANCES = 1 << 18
    SEMANTICS = 1 << 19
    OPAQUE = 1 << 20  # transparent shapes are left out
    TRACE_ALBEDO = 1 << 21  # albedo is written, too: native/shading_pass/visibility_albedo.h
    IN_VIEW = 1 << 22  # the shapes in view have been listed: native/traversal/shapes_in_view.h
    PROJECTED_FACES = 1 << 23  # of moving meshes: native/traversal/projected_faces.h
    FLOW = 1 << 24
    FLOW_VALID = 1 << 25
    FLOW_MOVES = 1 << 26  # some meshes move
    FLOW_COMPACT = 1 << 27  # the history has 16 bits a pixel
    FLOW_LISTED = 1 << 28  # motions are composed by the trace or by the stage of views
    FLOW_WHOLE = 1 << 29  # a block draws a whole image
    FLOW_NEAR = 1 << 30  # shared memory has room for the previous words


class ImageFlag(IntFlag):
    """Images of the shading pass: native/shading/appearance.h, ImageBit."""

    RGB = 1
    RGBA = 2
    HDR = 4
    NORMALS = 8
    ALBEDO = 16


class ShadingFlag(IntFlag):
    """Features of a scene and an image that shading is compiled for: native/shading/appearance.h, world_overrides.h."""

    HAS_MATERIALS = 1
    HAS_TEXTURES = 2
    HAS_SKYBOX = 4
    HAS_SHADOWS = 8
    STORE_QUADS = 16  # the image's width is a multiple of 4
    WHOLE_REGIONS = 32  # the image has no part of a region
    SEPARATE_PLANE_PATH = 64  # few shapes and no meshes: room to draw floors apart and for lookups on atlases
    PLANE_STRIPS = 128  # floors may be drawn by strips: native/shading_pass/plane_strips.h
    MIRROR_VIEW = 1 << 8  # the view is the one from behind the mirror
    HAS_MIRROR = 1 << 9  # the images hold what is seen from there
    HAS_TRANSPARENT = 1 << 10  # some shapes may be transparent
    HAS_HAZE = 1 << 11
    PHYSICAL = 1 << 12  # lit as native/shading/pbr.h does it
    HAS_MAPS = 1 << 13  # some material has more than the texture of its colour
    WRITE_BACK_TRANSPARENT = 1 << 14  # what covers most of a pixel replaces the trace's result there
    GENERAL_PLANES = 1 << 15  # planes are several, end, or are not lit by at most three grey lights; for PLANE_STRIPS
    INDIRECT_LIGHT = 1 << 16  # of PHYSICAL scenes: rays find light from shapes: native/occlusion/indirect_rays.h
    HAS_REFLECTIONS = 1 << 17  # what surfaces mirror and what is seen through them: native/occlusion/reflection_rays.h
    # of PHYSICAL scenes: rays tell what share of the light of each light, and of that from all around, reaches a pixel:
    # native/shading/light_visibility.h
    SOFT_SHADOWS = 1 << 18
    AMBIENT_OCCLUSION = 1 << 19
    HAS_OFFSETS = 1 << 20  # textures are moved
    PER_WORLD_BACKGROUND = 1 << 21
    HEADLIGHTS = 1 << 22  # worlds have a headlight of their own
    HAS_EXPOSURE = 1 << 23
    HAS_MIPS = 1 << 24  # each texture but cubes has a mipmapped one; told where floors are looked up by them
    # the curve from light to display colours, native/shading/tone_mapping.h; none of them: light is cut off at white
    REINHARD = 1 << 25
    ACES = 1 << 26
    KHRONOS_NEUTRAL = 1 << 27
    AGX = 1 << 28
    HAS_ENVIRONMENT = 1 << 29  # an image in float lights the scene: native/shading/environment_map.h
    SHOWS_ENVIRONMENT = 1 << 30  # and is behind everything


NO_SHADING_FLAGS = ShadingFlag(0)


class SplatFlag(IntFlag):
    """Images and variants of the blending of Gaussians: native/splats/gaussian_blend.h, SplatOutput."""

    RGB = 1
    RGBA = 2
    HDR = 4
    ALBEDO = 8
    DEPTH = 16
    DISTANCE = 32
    POINTS = 64
    NORMALS = 128
    SHAPE = 256
    BODIES = 512
    INSTANCES = 1024
    SEMANTICS = 2048
    BY_WORLD = 4096
    LINEAR = 8192  # hdr is light; else display values
    EXPOSED = 16384
    SOLID = 32768
    # As MuJoCo-Warp draws clouds: they are the surface where less light comes through than 0.005, and a ray ends there;
    # a Gaussian ends at an alpha of 0.01; ids are those of what is behind
    OPAQUE = 65536
    HARMONICS = 131072  # colours depend on the ray


def geometry_of(shape_types: Iterable[int]) -> GeometryFlag:
    """The flags of a set of shape types."""
    found = GeometryFlag(0)
    for shape_type in shape_types:
        found |= GeometryFlag(1 << shape_type)
    return found
