"""A scene as a file tells it: a tree of frames and what hangs on it. Readers make it for ``scene_graph_source.py``.

Everything is in the file's own units and axes but for what the root's frame does to it: below it are metres.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from warpcam.camera.lens import Projection
from warpcam.scene.source import SceneCamera
from warpcam.scene.validation import check_semantics
from warpcam.sources.common.geometry import Geometry
from warpcam.textures.pack import TextureImage


@dataclass(eq=False)
class FrameNode:
    """A frame.

    Attributes:
        name: Its path: unique.
        parent: Index of the frame above, less than its own; -1 for the root.
        local: (4, 4) float64, to the parent's frame.
        resets: ``local`` leads to the root's frame instead.
        visible: Whether what is here and below is seen, as far as this frame has a say.
        moves: ``local`` or ``visible`` may change with time.
        body: It is a body of its own.
        instance: Index of the replicated thing that it is part of, or -1.
        labels: Semantic labels, the frame's own or those of a frame above.
    """

    name: str
    parent: int
    local: np.ndarray
    resets: bool = False
    visible: bool = True
    moves: bool = False
    body: bool = False
    instance: int = -1
    labels: tuple[str, ...] = ()


@dataclass(eq=False)
class ShapeInstance:
    """A shape.

    Attributes:
        name: Its path; unique.
        node: Its frame.
        geometry: Its geometry there; things that look alike share it.
        material: Index of its look, or -1.
        color: RGBA, linear; None for its look's.
    """

    name: str
    node: int
    geometry: Geometry
    material: int = -1
    color: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Material:
    """A metallic-roughness material. Colours are linear.

    Attributes:
        name: Its path.
        color: RGB, a factor of its texture.
        opacity: 1 is opaque; with a map of it 1.
        roughness: In [0, 1]; a factor of its map, as are the next two.
        metallic: In [0, 1].
        reflectance: Where light falls straight, of what is no metal: 0.04 for an index of refraction of 1.5.
        transmission: Share of what is not reflected that goes through as in glass, in [0, 1]; only for paths of light.
        emission: RGB.
        texture: Index of the image of its colour, or -1.
        normals: Index of the map of its normals, or -1; see ``kernels/types.py``, ROLE_NORMAL.
        packed: Index of the map of occlusion, roughness and metalness, or -1; ROLE_PACKED.
        emission_texture: Index of the image of what it emits, or -1.
        opacity_map: Index of the map of its opacity, or -1; ROLE_OPACITY. Only meshes with texture coordinates show it.
        cutoff: What is less opaque is not there, all else is solid; 0 for none.
        wrap: Of the textures, along u and v.
        unlit: It shows its colour whatever the light is, and reflects nothing.
    """

    name: str
    color: tuple[float, float, float] = (0.18, 0.18, 0.18)
    opacity: float = 1.0
    roughness: float = 0.5
    metallic: float = 0.0
    reflectance: float = 0.04
    transmission: float = 0.0
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    texture: int = -1
    normals: int = -1
    packed: int = -1
    emission_texture: int = -1
    opacity_map: int = -1
    cutoff: float = 0.0
    wrap: tuple[str, str] = ("repeat", "repeat")
    unlit: bool = False

    @property
    def maps(self) -> tuple[int, ...]:
        """Maps of the material, without the map of its colour."""
        return self.normals, self.packed, self.emission_texture, self.opacity_map


@dataclass(frozen=True, eq=False)
class LightNode:
    """A light. It shines along its frame's -z.

    Attributes:
        name: Its path.
        node: Its frame.
        kind: "distant", "dome", or "local".
        strength: RGB, linear: for each square unit of irradiance a white surface sends back 1 / pi of it, and that is
            what is counted here: of a distant light anywhere, of a dome on a surface that sees all of it, of a local
            one a metre away on its axis.
        near: A local light's square size [m^2]: its strength is strength / (distance^2 + near).
        one_sided: A local light shines to one side only.
        cone: Half angle of its cone [degrees], 180 for none.
        active: Whether it is on.
        casts_shadow: Whether it casts shadows.
        form: What a local light is: "point", "sphere", "disk", "rectangle" or "cylinder".
        size: As ``Physical.sizes`` in ``kernels/types.py``.
        seen: Area that a local light shows [m^2].
        diffuse: A factor of what it gives to matt surfaces.
        specular: A factor of its highlights.
        terms: (SKY_TERMS, 3) radiance of a dome; see ``native/shading/environment.h``.
        image_gain: From a dome's image to its radiance; zeros without one.
    """

    name: str
    node: int
    kind: str
    strength: tuple[float, float, float]
    near: float = 0.0
    one_sided: bool = False
    cone: float = 180.0
    active: bool = True
    casts_shadow: bool = True
    form: str = "point"
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seen: float = 0.0
    diffuse: float = 1.0
    specular: float = 1.0
    terms: np.ndarray | None = None
    image_gain: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class CameraNode:
    """A camera, looking along its frame's -z.

    Attributes:
        name: Its path.
        node: Its frame.
        projection: "pinhole" or "orthographic".
        focal: Its focal length, in widths of its sensor; of an orthographic one its reciprocal width [1/m].
        offset: Of its sensor's middle to the right and up, in widths of its sensor.
        clipping: Nearest and farthest planar depth [m], or None.
    """

    name: str
    node: int
    projection: Projection
    focal: float
    offset: tuple[float, float] = (0.0, 0.0)
    clipping: tuple[float, float] | None = None

    def camera(self) -> SceneCamera:
        return SceneCamera(self.name, self.projection, sensor=(1.0, 1.0), square=True, clipping=self.clipping)


@dataclass(eq=False)
class SceneGraph:
    """All of a file."""

    source: str  # for messages
    nodes: list[FrameNode]
    items: list[ShapeInstance] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    textures: list[TextureImage] = field(default_factory=list)
    texture_names: list[str] = field(default_factory=list)
    lights: list[LightNode] = field(default_factory=list)
    cameras: list[CameraNode] = field(default_factory=list)
    instances: list[str] = field(default_factory=list)
    skybox: int = -1
    at_time: Callable[[float], None] | None = None  # brings all of it to a time of the file

    def worlds(self) -> np.ndarray:
        """The frames in the world, (node, 4, 4) float64 [m]."""
        matrices = np.empty((len(self.nodes), 4, 4))
        for index, node in enumerate(self.nodes):
            above = 0 if node.resets else node.parent
            with np.errstate(invalid="ignore", over="ignore"):  # what is not finite stays so, all the way down
                matrices[index] = node.local if node.parent < 0 else matrices[above] @ node.local
        return matrices

    def worlds_of(self, node: int) -> np.ndarray:
        """One frame in the world, (4, 4) float64 [m]."""
        entry = self.nodes[node]
        if entry.parent < 0:
            return entry.local
        return self.worlds_of(0 if entry.resets else entry.parent) @ entry.local

    def seen(self) -> np.ndarray:
        """Return which frames are visible, with all frames above them, (node,) bool."""
        visible = np.empty(len(self.nodes), bool)
        for index, node in enumerate(self.nodes):
            visible[index] = node.visible and (node.parent < 0 or visible[node.parent])
        return visible

    def moving(self) -> np.ndarray:
        """Return which frames may move over time, (node,) bool."""
        moving = np.zeros(len(self.nodes), bool)
        for index, node in enumerate(self.nodes):
            moving[index] = node.moves or (node.parent >= 0 and moving[node.parent])
        return moving

    def bodies(self) -> list[int]:
        """Return the body of each frame.

        Bodies are numbered in the order of the frames that are one; the root is one.
        """
        bodies: list[int] = []
        count = 0
        for index, node in enumerate(self.nodes):
            own = index == 0 or node.body
            bodies.append(count if own else bodies[node.parent] if node.parent >= 0 else 0)
            count += own
        return bodies

    def numbered(self, labels: Mapping[str, int] | None) -> dict[str, int]:
        """The user's label map, or all labels there are from 1 on, in alphabetical order."""
        if labels is None:
            return {name: 1 + place for place, name in enumerate(sorted({x for n in self.nodes for x in n.labels}))}
        return check_semantics(labels)


def middle_of(items: Sequence[ShapeInstance], worlds: np.ndarray) -> np.ndarray:
    """Return the mean position of shapes, infinite ones aside, (3,) [m].

    ``worlds`` are the nodes' frames, (node, 4, 4).
    """
    corners = [np.zeros((0, 3))]
    for item in items:
        matrix = worlds[item.node]
        fit = item.geometry.transformed(matrix[:3, :3]) if np.isfinite(matrix).all() else None
        if fit is not None and fit.mesh is not None:
            vertices = fit.mesh.vertices
            box = np.stack((vertices.min(axis=0), vertices.max(axis=0)))
            corners.append(matrix[:3, 3] + box @ fit.rotation.T)
        elif fit is not None:
            corners.append(matrix[None, :3, 3])
    points = np.concatenate(corners)
    return 0.5 * (points.min(axis=0) + points.max(axis=0)) if len(points) else np.zeros(3)
