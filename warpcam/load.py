"""Loaders: a scene from each simulator, from a USD stage, or from a file."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from warpcam.core.file_access import FileAccess, Limits
from warpcam.core.memory_errors import memory_told
from warpcam.kernels.runtime.streams import preserve_cuda_context
from warpcam.scene.file_scene import DrivenScene
from warpcam.scene.layers import check_planes
from warpcam.scene.light import Light
from warpcam.scene.scene import Scene
from warpcam.sources.common.optional import import_source
from warpcam.sources.common.splats import Splats, check_splats


@preserve_cuda_context()
@memory_told("from_mujoco_warp")
def from_mujoco_warp(
    mjm: Any,
    m: Any,
    d: Any,
    *,
    groups: Collection[int] | Mapping[str, Collection[int]] = (0, 1, 2),
    draw: Collection[str] = ("geoms", "sites", "tendons", "flexes", "skins", "actuators"),
    reflections: bool | None = None,
    transparency: bool | None = None,
    planes_from_behind: bool = False,
    splats: Splats | Sequence[Splats] | None = None,
) -> Scene:
    """The worlds of a MuJoCo-Warp simulation, read where they lie: nothing that changes is copied.

    This and the others that make a scene raise ``WarpcamError`` for what they cannot use, by the argument's name.

    What a world may change in ``m`` and ``d`` is seen at the next render: poses, sizes, colours, materials, lights,
    cameras, which mesh a geom shows. Meshes, height fields, textures and the headlight are read once.

    Args:
        mjm: The host's ``mujoco.MjModel``.
        m: The ``mujoco_warp.Model`` put from it.
        d: The ``mujoco_warp.Data``; its device is the scene's.
        groups: Groups that are drawn, of geoms and of all else; or a mapping with those of each kind of ``draw``, but
            ``actuators``, which have none.
        draw: What is drawn, as MuJoCo's own renderer does unless told. ``segmentation`` gives geoms their ids; sites,
            tendons, flexes, skins and, where some are slider-cranks, which alone are drawn, actuators count on from
            there: see ``Scene.objects``.
        reflections: Whether planes and boxes reflect where their materials have reflectance. None: those that do now.
            True: all, whatever material they are given later. False: none, which saves their time.
        transparency: Whether what is drawn is seen through where its colour is partly transparent. None: what is so
            now, and if there is such planes seen from behind. True: all, whatever colour is written later. False: all
            is drawn solid.
        planes_from_behind: Whether depth, ids and all else that is not lit see planes from behind as they see them
            from their front, and colours see them as transparent, as ``mujoco.Renderer`` does. False: planes are seen
            from their front alone, as MuJoCo-Warp's renderer does.
        splats: Clouds of Gaussians in the worlds: see docs/splats.md.
    """
    seen_through = check_planes(transparency, planes_from_behind)
    scene: Scene = import_source("mujoco.device").load(
        mjm,
        m,
        d,
        groups=groups,
        draw=draw,
        reflections=reflections,
        transparency=seen_through,
        planes_from_behind=bool(planes_from_behind),
        splats=check_splats(splats),
    )
    return scene


@preserve_cuda_context()
@memory_told("from_mujoco")
def from_mujoco(
    mjm: Any,
    mjd: Any,
    *,
    groups: Collection[int] | Mapping[str, Collection[int]] = (0, 1, 2),
    draw: Collection[str] = ("geoms", "sites", "tendons", "flexes", "skins", "actuators"),
    device: Any = None,
    reflections: bool | None = None,
    transparency: bool | None = None,
    planes_from_behind: bool = False,
    splats: Splats | Sequence[Splats] | None = None,
) -> Scene:
    """Worlds of classic MuJoCo, copied to the device before each frame.

    Args:
        mjm: The ``mujoco.MjModel``. What changes in it is seen at the next render, but for what is read once: meshes,
            height fields and textures; types, groups and reflectance; projections and sensors of cameras;
            ``vis.map`` and ``vis.quality``; and of what is no geom all but its colour.
        mjd: A ``mujoco.MjData``, or a list with one for each world.
        groups: As ``from_mujoco_warp`` has it.
        draw: What is drawn: see ``from_mujoco_warp``.
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
        reflections: As ``from_mujoco_warp`` has it.
        transparency: As ``from_mujoco_warp`` has it.
        planes_from_behind: As ``from_mujoco_warp`` has it.
        splats: As ``from_mujoco_warp`` has it.
    """
    seen_through = check_planes(transparency, planes_from_behind)
    scene: Scene = import_source("mujoco.host").load(
        mjm,
        mjd,
        groups=groups,
        device=device,
        draw=draw,
        reflections=reflections,
        transparency=seen_through,
        planes_from_behind=bool(planes_from_behind),
        splats=check_splats(splats),
    )
    return scene


@preserve_cuda_context()
@memory_told("from_newton")
def from_newton(
    model: Any,
    state: Any,
    *,
    lights: Sequence[Light] | None = None,
    ambient: Any = (0.2, 0.2, 0.2),
    semantics: Mapping[str, int] | None = None,
    transparency: bool | None = None,
    textures: Sequence[Any] = (),
) -> Scene:
    """The worlds of a Newton simulation, whichever solver moves it, read where they lie.

    What changes in the state and in the model's ``shape_transform``, ``shape_scale``, ``shape_color``,
    ``shape_opacity`` and ``shape_flags`` is seen at the next render; types, meshes, height fields and textures are read
    once. A solver that goes back and forth between two states needs ``scene.bind(state)`` before the next render.

    ``segmentation`` gives Newton's shape index, ``bodies`` its body index, ``instances`` its articulation index. A
    camera's parent is a body's label or index; in every world the camera rides on the body of that name.

    Args:
        model: A ``newton.Model``; its device is the scene's.
        state: A ``newton.State`` of it.
        lights: Newton has none of its own. None is one from above, as in Newton's own renderer. What a world may change
            lies in ``scene.array("light_directions")`` and the like, (world, light).
        ambient: (3,) linear radiance from everywhere.
        semantics: Number of each label in the output ``semantics``: of a shape, a body or an articulation, or some of
            the parts of its path.
        transparency: Whether shapes are seen through where they are partly opaque. None: those that are so in some
            world now; True: all, whatever opacity they are given later; False: none.
        textures: More images, (height, width, 3) uint8, for materials that shapes may be given later: the last ones of
            all, in this order. With them ``scene.array("shape_materials")``, (world, column), may be written in place;
            ``scene.columns`` says which shape stands where.
    """
    scene: Scene = import_source("newton.source", "newton").load(
        model, state, lights=lights, ambient=ambient, semantics=semantics, transparency=transparency, textures=textures
    )
    return scene


def add_urdf(
    builder: Any,
    path: Any,
    *,
    packages: Mapping[str, Any] | None = None,
    trusted: bool = False,
    search_paths: Sequence[Any] = (),
    limits: Limits | None = None,
    **options: Any,
) -> None:
    """Add the robot of a URDF file to a Newton builder, by ``builder.add_urdf``, with meshes as ``load`` reads them.

    Meshes keep the units, colours and textures of their files. A mesh that cannot be read costs its link that shape, or
    shows the link's collision shapes, with a warning.

    Args:
        builder: A ``newton.ModelBuilder``.
        path: The file.
        packages: As ``load`` has it.
        trusted: As ``load`` has it.
        search_paths: As ``load`` has it.
        limits: As ``load`` has it.
        options: Of ``builder.add_urdf``: ``xform``, ``floating`` and the like.
    """
    import_source("newton.urdf", "newton").add(
        builder, path, packages, options, trusted=trusted, search_paths=search_paths, limits=limits
    )


@preserve_cuda_context()
@memory_told("from_usd")
def from_usd(
    path_or_stage: Any,
    num_worlds: int = 1,
    *,
    device: Any = None,
    time: float | None = None,
    purposes: Sequence[str] = ("default", "render"),
    up_axis: str | None = "Z",
    meters_per_unit: float | None = None,
    double_sided: bool | None = None,
    semantics: Mapping[str, int] | None = None,
    textures: Mapping[str, Any] | None = None,
    exposure: float | None = None,
    transparency: bool | None = None,
    trusted: bool = False,
    search_paths: Sequence[Any] = (),
    limits: Limits | None = None,
) -> DrivenScene:
    """A USD stage in many worlds, which share its meshes and textures.

    The scene is in metres and, unless asked otherwise, its z is up, whatever the stage's own units and axes are.

    Args:
        path_or_stage: A .usd, .usda, .usdc or .usdz file, or a ``pxr.Usd.Stage``, which is only read.
        num_worlds: How many.
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
        time: Time code to begin with; None is the stage's first.
        purposes: Of the prims that are drawn: "default", "render", "proxy", "guide".
        up_axis: "Z" turns a stage that has another axis up; None keeps the stage's own axes.
        meters_per_unit: In place of the stage's own.
        double_sided: Whether faces are seen from behind, in place of what each mesh says itself.
        semantics: Number of each label in the output ``semantics``; None numbers all there are from 1 on, by name.
        textures: More images for ``DrivenScene.set_textures``, by names of yours: paths, or arrays
            (height, width, 3) uint8.
        exposure: All light is multiplied by 2 to this; None exposes the middle of the scene.
        transparency: As ``from_newton`` has it.
        trusted: As ``load`` has it. A stage that is given was opened by the caller, and is trusted.
        search_paths: As ``load`` has it; USD looks there for names that do not begin with "./" or "../".
        limits: As ``load`` has it.
    """
    source = Path(path_or_stage) if isinstance(path_or_stage, str | Path) else None
    access = FileAccess(source, trusted or source is None, search_paths, limits, "from_usd")
    scene: DrivenScene = import_source("usd.source", "usd").load(
        path_or_stage,
        num_worlds,
        device=device,
        time=time,
        purposes=purposes,
        up_axis=up_axis,
        meters_per_unit=meters_per_unit,
        double_sided=double_sided,
        semantics=semantics,
        textures={} if textures is None else textures,
        exposure=exposure,
        transparency=transparency,
        access=access,
    )
    return scene


@preserve_cuda_context()
@memory_told("load")
def load(
    path: Any,
    num_worlds: int = 1,
    *,
    device: Any = None,
    meters_per_unit: float | None = None,
    up_axis: str | None = "Z",
    textures: Mapping[str, Any] | None = None,
    transparency: bool | None = None,
    packages: Mapping[str, Any] | None = None,
    trusted: bool = False,
    search_paths: Sequence[Any] = (),
    limits: Limits | None = None,
    splats: Splats | Sequence[Splats] | None = None,
) -> Scene:
    """The scene of a file in many worlds, read by what its name ends in.

    .usd, .usda, .usdc and .usdz are read by ``from_usd``; .glb, .gltf, .obj, .stl and .ply by trimesh, .dae by
    pycollada, MuJoCo's .msh by warpcam. All give a ``DrivenScene``. .xml, .mjb and .urdf are read by MuJoCo, the meshes
    of .urdf as such files alone, and simulated by nobody: a scene as the file has it.

    Args:
        path: The file.
        num_worlds: How many worlds.
        device: Where to render; None is Warp's current device.
        meters_per_unit: In place of what the file says; .obj, .stl, .ply and .msh say nothing and are taken to be in
            metres.
        up_axis: "Z" turns USD, glTF and COLLADA scenes so that z is up; None keeps their own axes. Others are as they
            are, and so are all meshes of a robot.
        textures: More images for ``DrivenScene.set_textures``.
        transparency: As ``from_newton`` has it.
        packages: Folders of ROS packages by their names, for ``package://`` in .urdf files. Other packages are looked
            for in the folders above the file and in ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``.
        trusted: Whether the scene's files may name files anywhere. False: in the scene's folder, its ROS package,
            folders of assets beside it (``../meshes``, ``../textures`` and the like), and ``search_paths``;
            ``WarpcamError`` for a file elsewhere.
        search_paths: More folders that may be opened. What is not found where a file names it is looked for there.
        limits: Sizes of files, images, meshes and counts that are refused; None is ``Limits()``.
        splats: Clouds of Gaussians in the worlds of .xml, .mjb and .urdf files: see docs/splats.md.

    Raises:
        WarpcamError: The file cannot be read, names files that it may not open, or something is over a limit.
    """
    from warpcam.sources import load_file

    return load_file.load(
        path,
        num_worlds,
        device,
        meters_per_unit=meters_per_unit,
        up_axis=up_axis,
        textures={} if textures is None else textures,
        transparency=transparency,
        packages=packages,
        trusted=trusted,
        search_paths=search_paths,
        limits=limits,
        splats=check_splats(splats),
    )
