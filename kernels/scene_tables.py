"""The scene as the kernels see it, and the facts they are specialised on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from warpcam.kernels.flags import NO_SCENE_FLAGS, SceneFlag
from warpcam.kernels.layers import LayerTables


@dataclass(frozen=True, eq=False)
class SceneTables:
    """Warp structs of one scene (see types.py) and the host facts that choose what is compiled.

    The struct fields are instances of the structs in types.py.
    """

    shapes: Any
    meshes: Any
    height_fields: Any
    materials: Any
    textures: Any
    lights: Any
    background: Any
    num_worlds: int
    num_drawn: int  # length of shapes.drawn
    num_lights: int
    shape_types: frozenset[int]  # types among the drawn shapes
    num_shapes: int  # ids are below this
    num_faces: int  # of the largest mesh, as it is stored, or of the largest height field, two a cell
    has_materials: bool
    has_textures: bool  # some material can show a texture
    has_skybox: bool
    flags: SceneFlag = NO_SCENE_FLAGS  # what is compiled for the scene's shapes beside their types
    has_mips: bool = False  # each texture but cubes has a mipmapped one: Textures.mips
    ids_by_world: bool = False  # shapes and bodies have ids of their own in each world: Shapes.ids
    horizon: float = 0.0  # how far the source's own renderer draws endless planes [m]; 0 if it has none
    planes: tuple[int, ...] = ()  # ids of the planes that are drawn
    general_planes: bool = False  # these are more than an endless grey one in grey light
    physical: Any = None  # Physical, of scenes that are lit as native/shading/pbr.h does it
    has_maps: bool = False  # some material of such a scene has more than the texture of its colour
    backs_shade: bool = False  # in such a scene meshes that are seen from one side cast shadows from both
    has_environment: bool = False  # images in float light such a scene: Physical.environments
    shows_environment: bool = False  # and are behind everything
    splats: Any = None  # clouds of Gaussians, if shapes are such
    # (1,) vec2 where such clouds are solid: where less light than this share comes through, and how many Gaussians of a
    # cloud a ray blends at most; None where they are seen through
    splat_limits: Any = None
    opaque_splats: bool = False  # see SplatFlag.OPAQUE
    moving: tuple[int, ...] = ()  # meshes whose corners move
    moving_faces: int = 0  # of the largest of these, as it is stored
    layers: LayerTables | None = None  # of what one layer cannot show: mirrors, transparent shapes, haze
    world_overrides: Any = None  # WorldOverrides, if worlds have more for themselves than the tables say
    headlights: bool = False  # each world has a headlight of its own: see native/shading/world_overrides.h
    casters: Any = None  # as `shapes`, but of those that are drawn the ones that cast shadows; None: all of them do
    labels: Mapping[str, Any] = field(default_factory=dict)  # (world or 1, shape) int32 of "instances" and "semantics"

    @property
    def first_plane(self) -> int:
        """Id of the first plane that is drawn; -1 if there is none."""
        return self.planes[0] if self.planes else -1
