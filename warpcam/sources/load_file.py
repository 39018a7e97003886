"""Reader of a file, chosen by the file's extension."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, Limits
from warpcam.scene.file_scene import DrivenScene
from warpcam.scene.layers import check_tristate
from warpcam.scene.scene import Scene
from warpcam.scene.validation import check_num_worlds, check_unit
from warpcam.sources.common.formats import MESHES, MUJOCO, USD
from warpcam.sources.common.optional import import_source
from warpcam.sources.common.scene_graph import SceneGraph
from warpcam.sources.common.splats import Splats
from warpcam.sources.robots.packages import check_packages


def load(
    path: Any,
    num_worlds: int,
    device: Any,
    meters_per_unit: float | None,
    up_axis: str | None,
    textures: Mapping[str, Any],
    transparency: bool | None = None,
    packages: Mapping[str, Any] | None = None,
    trusted: bool = False,
    search_paths: Sequence[Any] = (),
    limits: Limits | None = None,
    add: Callable[[SceneGraph], None] | None = None,
    splats: Sequence[Splats] = (),
) -> Scene:
    """See ``warpcam.load``; ``add`` adds to what a file of meshes has before a scene is made of it."""
    if not isinstance(path, str | Path):
        raise WarpcamError(f"load: path must be a path, got {type(path).__name__}")
    file = Path(path)
    kind = file.suffix.lower()
    if kind not in (*USD, *MESHES, *MUJOCO):
        raise WarpcamError(f"load: {str(path)!r} came; known are {', '.join((*MUJOCO, *USD, *MESHES))}")
    if not file.is_file():
        raise WarpcamError(f"load: there is no file {str(path)!r}")
    check_num_worlds(num_worlds)
    if up_axis not in ("Z", None):
        raise WarpcamError(f'up_axis must be "Z", or None for the file\'s own axes, got {up_axis!r}')
    check_unit(meters_per_unit)
    check_tristate("transparency", transparency)
    if packages and kind != ".urdf":
        raise WarpcamError(f"load: packages is for .urdf files, not for {kind} files")
    if splats and kind not in MUJOCO:
        raise WarpcamError(f"load: splats is for {', '.join(MUJOCO)} files, not for {kind} files")
    folders = check_packages(packages, "load")
    access = FileAccess(file, trusted, search_paths, limits)
    if kind in USD:
        return load_stage(
            file,
            num_worlds,
            device=device,
            textures=textures,
            access=access,
            meters_per_unit=meters_per_unit,
            up_axis=up_axis,
            transparency=transparency,
        )
    if kind in MUJOCO:
        for name, value in (("meters_per_unit", meters_per_unit), ("textures", textures)):
            if value:
                raise WarpcamError(f"load: {name} is not for {kind} files")
        from warpcam.sources.mujoco import batch_file

        put = batch_file.load(
            file, num_worlds=int(num_worlds), seed=None, device=resolve(device), packages=folders, access=access
        )
        worlds: Scene = import_source("mujoco.device").load(
            put.host, put.model, put.data, (0, 1, 2), transparency=transparency, splats=splats
        )
        return worlds
    try:
        reader = import_module("warpcam.sources.files.mesh_file")
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and {kind} files need it: pip install 'warpcam[meshes]'"
        ) from None
    scene: Scene = reader.load(
        file,
        int(num_worlds),
        device=device,
        meters_per_unit=meters_per_unit,
        up_axis=up_axis,
        textures=textures,
        transparency=transparency,
        access=access,
        add=add,
    )
    return scene


def load_stage(
    path_or_stage: Any,
    num_worlds: int,
    *,
    device: Any,
    textures: Mapping[str, Any],
    access: FileAccess,
    meters_per_unit: float | None = None,
    up_axis: str | None = "Z",
    transparency: bool | None = None,
) -> DrivenScene:
    """A stage that may open what ``access`` says; arguments as ``warpcam.from_usd`` has them."""
    scene: DrivenScene = import_source("usd.source", "usd").load(
        path_or_stage,
        num_worlds,
        device=device,
        meters_per_unit=meters_per_unit,
        up_axis=up_axis,
        textures=textures,
        transparency=transparency,
        time=None,
        purposes=("default", "render"),
        double_sided=None,
        semantics=None,
        exposure=None,
        access=access,
    )
    return scene
