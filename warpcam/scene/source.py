"""Interface between sources and scenes: a scene's parts, its live arrays, and the stages that update them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
import warp as wp

from warpcam.accel.gaussians import GaussianCloud
from warpcam.accel.heightfields import HeightField
from warpcam.accel.meshes import Mesh
from warpcam.camera.lens import Projection
from warpcam.kernels.flags import NO_SCENE_FLAGS, SceneFlag
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import NUM_ROLES, Meshes, Textures
from warpcam.scene.layers import Layers
from warpcam.textures.pack import TextureImage


@dataclass(frozen=True)
class SceneCamera:
    """A camera that the source has.

    Attributes:
        name: "" if it has none.
        projection: "pinhole" or "orthographic".
        sensor: Width and height of the sensor, in the unit of the camera's intrinsics. None: the camera has a field
            of view instead, or what it spans. Focal lengths of an orthographic camera are so many units a metre.
        square: Pixels are square: the sensor's height follows from its width and the image's shape.
        clipping: Nearest and farthest planar depth that it sees [m]; None: all.
    """

    name: str
    projection: Projection = "pinhole"
    sensor: tuple[float, float] | None = None
    square: bool = False
    clipping: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """Constant parts of a scene.

    Attributes:
        num_worlds: At least 1.
        shape_types: (shape,) int32, constants of ``kernels/types.py``.
        shape_bodies: (shape,) int32.
        drawn: ids of the shapes that may be seen, ascending.
        bodies: Name of each body, "" if it has none.
        cameras: The source's cameras.
        num_materials: Rows of the material arrays.
        num_lights: Rows of the light arrays.
        meshes: What ``shape_assets`` counts for meshes.
        height_fields: What ``shape_assets`` counts for height fields.
        textures: What ``material_textures`` counts.
        skybox: Index of the texture behind everything, or -1.
        horizon: How far the source's own renderer draws endless planes [m]; 0 if it has none.
        shadow_map: How far the source's own renderer draws shadows: half the width of what a directional light sees
            [m], the distance from a light that they begin at [m], half the angle of what a spot sees, as part of its
            cutoff, and nearer than which single faces shade nothing, as part of half the width. Zeros: everywhere.
        shape_instances: (shape,) or (world or 1, shape) int32, which replicated thing each is part of, or -1; None if
            nobody knows.
        shape_semantics: Likewise its label's number, 0 for none.
        shape_ids: (world, shape) int32, what the source calls a shape in each world, -1 where a world lacks it; None
            where it is called the same in all: by its place here.
        body_ids: (world, shape) int32, with ``shape_ids``: the same of its body, instead of ``shape_bodies``.
        body_labels: What the user may call a body beside its name in ``bodies``; ``body_places`` says which of these
            it is. None: nothing else.
        body_places: (label,) int32.
        flags: How its textures and normals are drawn, ``kernels.flags.APPEARANCE_FLAGS`` or some of them.
        coincident: With COINCIDENT among ``flags`` (shape,) int32: see ``kernels.types.Shapes``.
        scaled: Whether the sizes of meshes and height fields are scales along their axes.
        physical: Whether it is lit as metallic-roughness materials are, in linear light, instead of as MuJoCo does it.
        unlit: Whether it has no lights, for which its headlight stands in.
        backs_shade: Whether in such a scene meshes that are seen from one side cast shadows from both.
        maps: In such a scene, whether some material has more than the texture of its colour.
        transmissive: In such a scene, names of the materials that let light through as glass does; only paths of light
            draw that.
        as_physical: Gives for a device the arrays of ``kernels.types.Physical`` but its lights, by name, with which a
            scene that is not physical may be lit so; None where there are none. ``maps`` counts then, too.
        layers: What needs more than one layer: mirrors, transparent shapes, haze.
        objects: (id + 1, 2) int32, what the source calls each id of ``segmentation``; the last row is for -1. None: the
            ids say all.
        casting: Those of ``drawn`` that cast shadows, ascending; None: all of them.
        clouds: What ``shape_assets`` counts for shapes of type SPLATS, none of which is in ``drawn``.
        splat_counts: (place,), how many of ``clouds`` each shape that a user added chooses from, see ``SPLAT_ARRAYS``.
        opaque_splats: Whether clouds are drawn as MuJoCo-Warp draws them: see ``kernels.flags.SplatFlag``.
        splat_limits: See ``kernels.scene_tables.SceneTables``; None where clouds are seen through.
        lend_textures: Called with the packed ``textures`` before the first frame, for sources that paint some of them.
    """

    num_worlds: int
    shape_types: np.ndarray
    shape_bodies: np.ndarray
    drawn: Sequence[int]
    bodies: Sequence[str]
    cameras: Sequence[SceneCamera]
    num_materials: int
    num_lights: int
    meshes: Sequence[Mesh]
    height_fields: Sequence[HeightField]
    textures: Sequence[TextureImage]
    skybox: int = -1
    horizon: float = 0.0
    shadow_map: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    shape_instances: np.ndarray | None = None
    shape_semantics: np.ndarray | None = None
    shape_ids: np.ndarray | None = None
    body_ids: np.ndarray | None = None
    body_labels: Sequence[str] | None = None
    body_places: np.ndarray | None = None
    flags: SceneFlag = NO_SCENE_FLAGS
    coincident: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    scaled: bool = False
    physical: bool = False
    unlit: bool = False
    backs_shade: bool = False
    maps: bool = False
    transmissive: Sequence[str] = ()
    as_physical: Callable[[wp.Device], Mapping[str, wp.array]] | None = None
    layers: Layers = field(default_factory=Layers)
    objects: np.ndarray | None = None
    casting: Sequence[int] | None = None
    clouds: Sequence[GaussianCloud] = ()
    splat_counts: Sequence[int] = ()
    opaque_splats: bool = False
    splat_limits: wp.array | None = None
    lend_textures: Callable[[Textures], None] = lambda textures: None

    def bodies_of_shapes(self) -> np.ndarray:
        """Body of each shape as a place in ``bodies``, (world or 1, shape) int32; -1 for none, -2 for no shape."""
        if self.body_ids is None or self.body_places is None or self.shape_ids is None:
            return np.asarray(self.shape_bodies, np.int32)[None]
        return np.where(self.shape_ids == -1, -2, np.append(self.body_places, -1)[self.body_ids]).astype(np.int32)

    def ids_of_shapes(self, output: str) -> np.ndarray:
        """What an image of ids shows for each shape, (world or 1, shape) int32; -1 for none, or no shape.

        Args:
            output: "segmentation", "bodies", "instances" or "semantics".
        """
        count, bodies = len(self.shape_types), self.shape_bodies if self.body_ids is None else self.body_ids
        tables = {
            "segmentation": np.arange(count) if self.shape_ids is None else self.shape_ids,
            "bodies": bodies,
            "instances": np.full(count, -1) if self.shape_instances is None else self.shape_instances,
            "semantics": np.zeros(count) if self.shape_semantics is None else self.shape_semantics,
        }
        found = np.atleast_2d(tables[output])
        return np.where(False if self.shape_ids is None else self.shape_ids == -1, -1, found).astype(np.int32)


@dataclass(frozen=True)
class LiveArray:
    """One live array of a source: (world, row), or (n, row) with any n >= 1, read at ``world % n``."""

    dtype: Any
    rows: str  # what its second dimension counts
    every_world: bool = False
    more: tuple[int, ...] = ()  # further dimensions, at least this long


# The arrays that a source keeps up to date. Meanings and units are those of the fields in kernels/types.py.
LIVE_ARRAYS: Mapping[str, LiveArray] = {
    "shape_positions": LiveArray(wp.vec3, "shapes", every_world=True),
    "shape_rotations": LiveArray(wp.mat33, "shapes", every_world=True),
    "shape_sizes": LiveArray(wp.vec3, "shapes"),
    "shape_assets": LiveArray(wp.int32, "shapes"),
    "shape_materials": LiveArray(wp.int32, "shapes"),
    "shape_colors": LiveArray(wp.vec4, "shapes"),
    "material_color": LiveArray(wp.vec4, "materials"),
    "material_emission": LiveArray(wp.float32, "materials"),
    "material_specular": LiveArray(wp.float32, "materials"),
    "material_shininess": LiveArray(wp.float32, "materials"),
    "material_texture": LiveArray(wp.int32, "materials", more=(2,)),
    "material_texture_repeat": LiveArray(wp.vec2, "materials"),
    "material_texture_uniform": LiveArray(wp.bool, "materials"),
    "light_types": LiveArray(wp.int32, "lights"),
    "light_active": LiveArray(wp.bool, "lights"),
    "light_casts_shadow": LiveArray(wp.bool, "lights"),
    "light_positions": LiveArray(wp.vec3, "lights", every_world=True),
    "light_directions": LiveArray(wp.vec3, "lights", every_world=True),
    "light_attenuation": LiveArray(wp.vec3, "lights"),
    "light_cutoff": LiveArray(wp.float32, "lights"),
    "light_exponent": LiveArray(wp.float32, "lights"),
    "light_ambient": LiveArray(wp.vec3, "lights"),
    "light_diffuse": LiveArray(wp.vec3, "lights"),
    "light_specular": LiveArray(wp.vec3, "lights"),
    "body_positions": LiveArray(wp.vec3, "bodies", every_world=True),
    "body_rotations": LiveArray(wp.mat33, "bodies", every_world=True),
    "camera_positions": LiveArray(wp.vec3, "cameras", every_world=True),
    "camera_rotations": LiveArray(wp.mat33, "cameras", every_world=True),
    "camera_fovy": LiveArray(wp.float32, "cameras"),  # [degrees]; orthographic: vertical extent [m]
    "camera_intrinsics": LiveArray(wp.vec4, "cameras"),  # focal lengths, principal point off the centre [sensor's unit]
}

# Those that physically based scenes have beside: of Physical in kernels/types.py.
PBR_LIVE_ARRAYS: Mapping[str, LiveArray] = {
    "material_roughness": LiveArray(wp.float32, "materials"),
    "material_metallic": LiveArray(wp.float32, "materials"),
    "material_reflectance": LiveArray(wp.float32, "materials"),
    "material_emissive": LiveArray(wp.vec3, "materials"),
    "material_transmission": LiveArray(wp.float32, "materials"),
    "light_forms": LiveArray(wp.int32, "lights"),
    "light_sizes": LiveArray(wp.vec3, "lights"),
    "light_rotations": LiveArray(wp.mat33, "lights", every_world=True),
    "sky": LiveArray(wp.vec3, "terms of the sky"),
}

# Those that scenes with clouds of the user's have beside.
SPLAT_ARRAYS: Mapping[str, LiveArray] = {
    "splat_choice": LiveArray(wp.int32, "splats", every_world=True),  # which of its clouds is there, or -1 for none
}


def live_arrays_of(parts: SceneDescription) -> Mapping[str, LiveArray]:
    """The arrays that a source of such parts has."""
    splats = SPLAT_ARRAYS if parts.splat_counts else {}
    if not parts.physical:
        return {**LIVE_ARRAYS, **splats}
    texture = (
        replace(LIVE_ARRAYS["material_texture"], more=(NUM_ROLES,)) if parts.maps else LIVE_ARRAYS["material_texture"]
    )
    return {**LIVE_ARRAYS, **PBR_LIVE_ARRAYS, "material_texture": texture, **splats}


class ColorBlend(Protocol):
    """Blending of shapes' colours in the stages of a source."""

    def without_blend(self, colors: np.ndarray) -> np.ndarray:
        """Return the source's colours, (world*, shape, 4), without the blending."""

    def blend(self, painted: wp.array) -> tuple[Stage, ...]:
        """Return the stages that blend other colours, (world, shape).

        These colours are written each frame after the source's stages.
        """


class Source(Protocol):
    """Reader of one simulator."""

    device: wp.Device
    parts: SceneDescription
    live_on_device: bool  # False: refresh() copies from the host

    @property
    def color_blend(self) -> ColorBlend | None:
        """None where colours are as they are held."""

    def arrays(self) -> Mapping[str, wp.array]:
        """The live arrays by the names in ``LIVE_ARRAYS``, and "headlight", (3,) vec3: as they are now."""

    def user_owned(self, field: str) -> bool:
        """Return whether nobody but the user writes that array: neither a frame's stages nor a copy from the host."""

    def user_name(self, field: str) -> str:
        """Return the user's name of an array, for error messages."""

    def global_ambient(self) -> float:
        """Light that is everywhere."""

    def clock(self) -> wp.array | None:
        """Time in each world [s], (world,) float32; None where the simulator keeps none."""

    def refresh(self) -> None:
        """Bring the arrays up to date with a state on the host."""

    def kernels(self) -> Sequence[wp.Kernel]:
        """Return the kernels of the stages that are known before meshes are built.

        They are compiled in the background.
        """

    def stages(self, meshes: Meshes) -> tuple[Stage, ...]:
        """Return the stages that update the arrays of the last ``arrays()`` and moving meshes on the device.

        At the head of each frame. The same tuple as long as it is to do the same. The state that is read may be another
        one from call to call.
        """

    def bind(self, state: Any) -> None:
        """Read another state of the same simulation from now on."""

    def forward(self) -> None:
        """Have the simulator compute poses from its state."""
