"""Public names of the classes and calls that front ends stand for: each is offered, or its page says what it is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest
from public_names import public_names

PAGES = Path(__file__).parents[2] / "docs" / "compat"


def page(name: str) -> str:
    return (PAGES / f"{name}.md").read_text()


def of_mujoco() -> tuple[Any, Any]:
    from warpcam.compat.mujoco import Renderer

    return mujoco.Renderer, Renderer


def of_mujocos_context() -> tuple[Any, Any]:
    from warpcam.compat.mujoco.upload_calls import Context

    if not hasattr(mujoco, "GLContext"):
        pytest.skip("MuJoCo has no GLContext where MUJOCO_GL is 'disable'")
    return mujoco.GLContext, Context


def of_gymnasium() -> tuple[Any, Any]:
    theirs = pytest.importorskip("gymnasium.envs.mujoco.mujoco_rendering", reason="pip install 'gymnasium[mujoco]'")
    from warpcam.compat import gymnasium as ours

    ours.uninstall()
    return theirs.OffScreenViewer, ours.OffScreenViewer


@pytest.mark.parametrize("classes", [of_mujoco, of_mujocos_context, of_gymnasium])
def test_what_the_original_has_is_there(classes: Callable[[], tuple[Any, Any]]) -> None:
    theirs, ours = classes()
    assert public_names(theirs) - public_names(ours) == set()


def test_of_mujoco_warps_context_what_is_not_there_is_refused_by_name() -> None:
    """Trees, rays, registries of meshes and textures; none of them is a plain AttributeError."""
    import mujoco_warp

    from warpcam.compat import mujoco_warp as ours

    rc = ours.create_render_context(mujoco.MjModel.from_xml_string("<mujoco/>"))
    names = {name for name in mujoco_warp.RenderContext.__dataclass_fields__ if not name.startswith("_")}
    for name in sorted(names - set(vars(rc))):
        with pytest.raises(AttributeError, match=f"warpcam's render context has no '{name}': there is no bounding"):
            getattr(rc, name)
    offered = {"nrender", "cam_res", "rgb_data", "rgb_adr", "depth_data", "seg_data", "enabled_geom_ids", "bvh_ngeom"}
    assert offered <= names & set(vars(rc))


@pytest.mark.parametrize("name", ["SensorCamera", "SensorTiledCamera"])
def test_newtons_page_names_what_the_sensors_have(name: str) -> None:
    """By itself, or as one of a family that ends in ``*``."""
    sensors = pytest.importorskip("newton.sensors", reason="pip install 'warpcam[newton]'")
    from warpcam.compat import newton as ours

    theirs, text = getattr(sensors, name), page("newton")
    families = ("allocate_image_", "compute_camera_rays_")
    names = {each for each in dir(theirs) if not each.startswith("_")}
    assert names <= set(dir(getattr(ours, name)))
    unnamed = {each for each in names if f"`{each}`" not in text and not each.startswith(families)}
    assert all(f"`{family}*`" in text for family in families)
    assert unnamed == set()
