"""Reading of MuJoCo's abstract scene."""

import copy
import itertools

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.compat.mujoco import Renderer, mjv_scene

XML = """
<mujoco>
  <worldbody>
    <light pos="0 0 3" dir=".2 .1 -1" directional="true"/>
    <geom type="plane" size="2 2 .1" rgba=".6 .6 .7 1"/>
    <geom type="box" size=".2 .15 .25" pos="0 0 .5" rgba="1 .5 .2 1"/>
    <geom size=".2" pos=".5 0 .3" rgba="0 .5 1 1"/>
    <camera name="fixed" pos="0 -2 1" xyaxes="1 0 0 0 .5 1"/>
  </worldbody>
</mujoco>
"""


def made() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def ours(model: mujoco.MjModel, device: wp.Device) -> Renderer:
    return Renderer(model, 48, 64, device=device)


def test_all_fields_of_geoms_and_lights_are_read() -> None:
    """All fields of this version of MuJoCo are read; other bytes may follow a field of one byte."""
    model, data = made()
    with Renderer(model, 48, 64, device="cpu") as renderer:
        renderer.update_scene(data, "fixed")
        scene = renderer.scene
        scene.geoms[1].label = "here"
        copies = ((scene.geoms, mjv_scene.geoms_of(scene)), (scene.lights, mjv_scene.lights_of(scene)))
        assert [len(copy) for _, copy in copies] == [scene.ngeom, scene.nlight] and scene.nlight > 1
        for structs, items in copies:
            names = [name for name in dir(structs[0]) if not name.startswith("_")]
            assert set(names) == set(items.dtype.names or ())
            for struct, item in zip(structs, items, strict=False):
                for name in set(names) - {"transparent"}:
                    value = getattr(struct, name)
                    if name == "label":
                        assert bytes(item[name]).split(b"\0")[0].decode() == value
                    else:
                        np.testing.assert_array_equal(item[name], value, err_msg=name)


def test_what_is_written_is_seen_as_another() -> None:
    """Write to the first geom, to one between and to the last."""
    model, data = made()
    with Renderer(model, 48, 64, device="cpu") as renderer:
        renderer.update_scene(data, "fixed")
        scene = renderer.scene
        for structs, count, read in (
            (scene.geoms, scene.ngeom, mjv_scene.geoms_of),
            (scene.lights, scene.nlight, mjv_scene.lights_of),
        ):
            before = read(scene)
            names = [name for name in dir(structs[0]) if not name.startswith("_")]
            for index, name in itertools.product({0, count // 2, count - 1}, names):
                struct = structs[index]
                value = copy.copy(getattr(struct, name))
                if isinstance(value, np.ndarray):
                    getattr(struct, name)[...] = value + 1
                else:
                    setattr(struct, name, "a" if name == "label" else not value if value in (0, 1) else value + 1)
                assert not mjv_scene.same_all(before, read(scene))
                assert np.flatnonzero(~mjv_scene.same(before, read(scene))).tolist() == [index]
                if isinstance(value, np.ndarray):
                    getattr(struct, name)[...] = value
                else:
                    setattr(struct, name, value)
            assert mjv_scene.same_all(before[:count], read(scene)) or "label" in names
        assert (renderer.render() == renderer.render()).all()


def test_it_is_seen_twice_or_not_at_all(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data, "fixed")
        first = renderer.render()
        renderer.scene.stereo = 1
        with pytest.raises(wc.WarpcamError, match=r"scene\.stereo is 1.* allowed is 0"):
            renderer.render()
        renderer.scene.stereo = 0
        for eye in renderer.scene.camera:
            eye.pos[2] += 0.2
        assert (renderer.render() != first).any()


def test_another_frame_is_refused_and_the_same_is_not(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data, "fixed")
        first, scene = renderer.render(), renderer.scene
        scene.enabletransform = 1
        assert (renderer.render() == first).all()
        scene.rotate[0] = -1.0  # the same turn
        assert (renderer.render() == first).all()
        for name, value in (("translate", (0, 0.5, 0)), ("rotate", (0, 1, 0, 0)), ("scale", 2.0)):
            before = copy.copy(getattr(scene, name))
            setattr(scene, name, value)
            with pytest.raises(wc.WarpcamError, match=r"scene\.enabletransform is 1 with .* allowed is 0"):
                renderer.render()
            scene.enabletransform = 0
            assert (renderer.render() == first).all()
            scene.enabletransform = 1
            setattr(scene, name, before)
