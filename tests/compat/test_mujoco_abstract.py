"""What a program writes into MuJoCo's abstract scene, from which ``warpcam.compat.mujoco.Renderer`` does not draw."""

import copy
import itertools

import mujoco
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam.compat.mujoco import Renderer

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


def test_geoms_of_the_users_own_are_refused(device: wp.Device) -> None:
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data)
        renderer.scene.ngeom += 1
        with pytest.raises(wc.WarpcamError, match=r"scene.ngeom is \d+, but update_scene had made \d+"):
            renderer.render()


def test_what_is_written_into_the_scene_is_refused(device: wp.Device) -> None:
    """But for its camera and its flags it is not what is drawn from."""
    model, data = made()

    def paint(scene: mujoco.MjvScene) -> None:
        scene.geoms[scene.ngeom - 1].rgba[0] = 0.123

    def push(scene: mujoco.MjvScene) -> None:
        scene.geoms[1].pos[2] += 0.1

    def dim(scene: mujoco.MjvScene) -> None:
        scene.lights[scene.nlight - 1].diffuse[:] = 0.0

    def unshade(scene: mujoco.MjvScene) -> None:
        scene.lights[scene.nlight - 1].castshadow ^= 1

    def darken(scene: mujoco.MjvScene) -> None:
        scene.nlight -= 1

    with ours(model, device) as renderer:
        renderer.update_scene(data, "fixed")
        first = renderer.render()
        for write in (paint, push, dim, unshade, darken):
            renderer.update_scene(data, "fixed")
            write(renderer.scene)
            with pytest.raises(wc.WarpcamError, match="geoms or lights were written after update_scene"):
                renderer.render()
            renderer.update_scene(data, "fixed")  # MuJoCo makes them anew
            assert (renderer.render() == first).all()
        renderer.scene.stereo = 1
        with pytest.raises(wc.WarpcamError, match=r"scene\.stereo is 1.* allowed is 0"):
            renderer.render()
        renderer.scene.stereo = 0
        for eye in renderer.scene.camera:
            eye.pos[2] += 0.2
        assert (renderer.render() != first).any()


def test_every_field_of_the_scenes_geoms_and_lights_is_looked_at(device: wp.Device) -> None:
    """Of the first, of one between and of the last; those that this version of MuJoCo has."""
    model, data = made()
    with ours(model, device) as renderer:
        renderer.update_scene(data, "fixed")
        scene = renderer.scene
        assert scene.ngeom > 2 and scene.nlight > 1
        for structs, count in ((scene.geoms, scene.ngeom), (scene.lights, scene.nlight)):
            names = [name for name in dir(structs[0]) if not name.startswith("_")]
            assert {"pos", "type"} < set(names)
            for index, name in itertools.product({0, count // 2, count - 1}, names):
                struct = structs[index]
                value = copy.copy(getattr(struct, name))
                if isinstance(value, np.ndarray):
                    getattr(struct, name)[...] = value + 1
                else:
                    setattr(struct, name, "a" if name == "label" else not value if value in (0, 1) else value + 1)
                with pytest.raises(wc.WarpcamError, match="geoms or lights were written after update_scene"):
                    renderer.render()
                if isinstance(value, np.ndarray):
                    getattr(struct, name)[...] = value
                else:
                    setattr(struct, name, value)
        renderer.render()  # all are as they were


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
