"""Scenes that a program fills by ``mujoco.mjv_updateScene`` itself, drawn as ``mujoco.Renderer`` draws them."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from mjv_geom_scene import XML, judging

import warpcam as wc
from warpcam.compat.mujoco import Renderer

WIDTH, HEIGHT = 96, 72
ALL, STATIC, DYNAMIC = (int(getattr(mujoco.mjtCatBit, f"mjCAT_{name}")) for name in ("ALL", "STATIC", "DYNAMIC"))
TENDON = (
    '<tendon><spatial width=".04" rgba=".9 .1 .8 1"><site site="mark"/><site site="away"/></spatial></tendon><actuator>'
)
CLOTH = '<flexcomp name="cloth" type="grid" dim="2" count="3 3 1" spacing=".2 .2 .2" pos="0 0 1" radius=".02"/>'
SKIN = (
    '<deformable><skin name="skin" vertex="0 0 1 .5 0 1 0 .5 1" face="0 1 2"><bone body="turning" '
    'bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></deformable>'
)
SOFT = {"flex": XML.replace("<camera", CLOTH + "<camera"), "skin": XML.replace("<actuator>", SKIN + "<actuator>")}


def stated(xml: str = XML.replace("<actuator>", TENDON)) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml.replace('<body pos="-.4', '<body name="turning" pos="-.4'))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def moved(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:3] += (-0.5, 0.3, 0.6)
    data.qpos[7] = 1.2
    mujoco.mj_forward(model, data)
    return data


def fixed() -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type, camera.fixedcamid = int(mujoco.mjtCamera.mjCAMERA_FIXED), 0
    return camera


def free() -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.2, 0.1, 0.3), 3.0, 60.0, -30.0
    return camera


def fill(
    renderer: Any,
    data: mujoco.MjData,
    option: mujoco.MjvOption | None = None,
    camera: mujoco.MjvCamera | None = None,
    categories: int = ALL,
    perturb: mujoco.MjvPerturb | None = None,
) -> None:
    camera, option = camera or fixed(), option or mujoco.MjvOption()
    mujoco.mjv_updateScene(renderer.model, data, option, perturb, camera, categories, renderer.scene)


def option(*flags: str, off: str = "", **groups: tuple[int, ...]) -> mujoco.MjvOption:
    chosen = mujoco.MjvOption()
    for flag in flags:
        chosen.flags[getattr(mujoco.mjtVisFlag, f"mjVIS_{flag}")] = True
    if off:
        chosen.flags[getattr(mujoco.mjtVisFlag, f"mjVIS_{off}")] = False
    for name, numbers in groups.items():
        getattr(chosen, name)[:] = np.isin(np.arange(6), numbers)
    return chosen


def dragging() -> mujoco.MjvPerturb:
    perturb = mujoco.MjvPerturb()
    perturb.select, perturb.active = 1, int(mujoco.mjtPertBit.mjPERT_TRANSLATE)
    perturb.refpos[:], perturb.refselpos[:], perturb.scale = (0.2, -0.2, 1.0), (0.2, -0.2, 1.0), 1.0
    return perturb


WAYS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "from elsewhere": {"camera": free()},
    "what moves": {"categories": DYNAMIC},
    "what does not": {"categories": STATIC},
    "transparent": {"option": option("TRANSPARENT")},
    "contacts and joints": {"option": option("CONTACTPOINT", "CONTACTFORCE", "JOINT")},
    "no tendons": {"option": option(off="TENDON")},
    "no geoms": {"option": option(geomgroup=())},
    "dragged": {"perturb": dragging()},
}


@pytest.fixture(scope="module")
def judge() -> Iterator[Any]:
    yield from judging(stated()[0], HEIGHT, WIDTH)


@pytest.fixture(scope="module")
def kept() -> dict[str, Renderer]:
    return {}


@pytest.fixture
def ours(device: wp.Device, kept: dict[str, Renderer]) -> Renderer:
    """Make a renderer that never had a state."""
    if device.alias not in kept:
        kept[device.alias] = Renderer(stated()[0], HEIGHT, WIDTH, device=device)
    return kept[device.alias]


def in_mode(renderer: Any, mode: str) -> np.ndarray:
    renderer.disable_depth_rendering()
    renderer.disable_segmentation_rendering()
    if mode:
        getattr(renderer, f"enable_{mode}_rendering")()
    return renderer.render()


def differ(one: np.ndarray, two: np.ndarray) -> float:
    """The part of all pixels that are not the same."""
    if one.dtype == np.uint8:
        return float((np.abs(one.astype(int) - two).max(axis=-1) > 24).mean())
    if one.dtype == np.float32:
        return float((np.abs(one / two - 1.0) > 0.02).mean())
    return float((one != two).any(axis=-1).mean())


@pytest.mark.parametrize("way", WAYS)
def test_what_a_program_filled_in_is_drawn(ours: Renderer, judge: Any, way: str) -> None:
    if judge is None:
        pytest.skip("MuJoCo's own renderer needs a library: apt-get install libosmesa6")
    data = stated()[1]
    for renderer in (ours, judge):
        fill(renderer, data, **WAYS[way])
    for mode in ("", "depth", "segmentation"):
        theirs, own = in_mode(judge, mode), in_mode(ours, mode)
        assert len(np.unique(theirs)) > 2
        assert differ(theirs, own) < 0.01, mode


@pytest.mark.parametrize("way", [way for way, given in WAYS.items() if given.keys() <= {"option", "camera"}])
def test_it_is_as_update_scene_draws_it(ours: Renderer, device: wp.Device, way: str) -> None:
    """Compare with update_scene() where both can draw the scene."""
    given, data = WAYS[way], stated()[1]
    fill(ours, data, **given)
    with Renderer(ours.model, HEIGHT, WIDTH, device=device) as other:
        other.update_scene(data, given.get("camera", "fixed"), given.get("option"))
        for mode in ("", "depth", "segmentation"):
            assert differ(in_mode(other, mode), in_mode(ours, mode)) < 0.002, mode


def test_it_is_of_the_state_it_was_filled_from(ours: Renderer) -> None:
    data = stated()[1]
    fill(ours, data)
    first = in_mode(ours, "")
    data.geom_xpos[:] = 0.0
    assert (ours.render() == first).all()
    fill(ours, moved(ours.model))
    assert differ(ours.render(), first) > 0.02


def test_after_update_scene_it_is_drawn_anew(ours: Renderer, device: wp.Device) -> None:
    """Tendons, too, which have no place of their own beside the model."""
    fill(ours, moved(ours.model))
    with Renderer(ours.model, HEIGHT, WIDTH, device=device) as other:
        other.update_scene(stated()[1], "fixed")
        before = other.render()
        fill(other, moved(ours.model))
        for mode in ("", "depth", "segmentation"):
            assert differ(in_mode(other, mode), in_mode(ours, mode)) < 0.002, mode
        other.update_scene(stated()[1], "fixed")
        assert (in_mode(other, "") == before).all()


def test_what_is_written_of_a_tendon_is_drawn(device: wp.Device, judge: Any) -> None:
    if judge is None:
        pytest.skip("MuJoCo's own renderer needs a library: apt-get install libosmesa6")
    model, data = stated()
    pictures = []
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        for one in (judge, renderer):
            one.update_scene(data, "fixed")
            before = in_mode(one, "")
            kind = int(mujoco.mjtObj.mjOBJ_TENDON)
            part = next(geom for geom in one.scene.geoms[: one.scene.ngeom] if geom.objtype == kind)
            part.rgba[:] = 0.1, 1.0, 0.1, 1.0
            pictures.append(one.render())
            assert differ(before, pictures[-1]) > 0.005
    assert differ(*pictures) < 0.004


def test_without_a_camera_it_is_refused(device: wp.Device) -> None:
    model, data = stated()
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        assert not renderer.render().any(), "nothing was put into it"
        mujoco.mjv_addGeoms(model, data, mujoco.MjvOption(), mujoco.MjvPerturb(), ALL, renderer.scene)
        with pytest.raises(wc.WarpcamError, match=r"scene has \d+ geoms and a camera without a field of view; call"):
            renderer.render()
        mujoco.mjv_updateCamera(model, data, fixed(), renderer.scene)
        assert renderer.render().any()


@pytest.mark.parametrize("kind", SOFT)
def test_what_is_drawn_of_a_state_alone_is_refused(device: wp.Device, kind: str) -> None:
    """Also where its geoms are the same as before, and only its points have moved."""
    model, data = stated(SOFT[kind])
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        fill(renderer, data)
        name = f"mjGEOM_{kind.upper()}"
        with pytest.raises(wc.WarpcamError, match=rf"geoms\[\d+\]\.type is {name}, .* call update_scene\(data"):
            renderer.render()
        renderer.update_scene(data, "fixed")
        first = renderer.render()
        fill(renderer, data)
        assert (renderer.render() == first).all(), "it is the same state"
        data.qpos[7:] += 0.4
        mujoco.mj_forward(model, data)
        fill(renderer, data)
        with pytest.raises(
            wc.WarpcamError, match=r"flexes and skins was written after update_scene; .* call update_sc"
        ):
            renderer.render()
        renderer.update_scene(data, "fixed")
        assert (renderer.render() != first).any()
