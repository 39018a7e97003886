"""``update_scene`` takes the model as it is then, as it takes the state."""

import copy
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import warp as wp
from mjv_geom_scene import XML, made

from warpcam.compat.mujoco import Renderer

WIDTH, HEIGHT = 96, 72
CHANGES: dict[str, Callable[[mujoco.MjModel], object]] = {
    "colours": lambda m: m.geom_rgba.__setitem__((slice(None), slice(0, 3)), 0.2),
    "sizes": lambda m: m.geom_size.__setitem__(2, 0.4),
    "groups": lambda m: m.geom_group.__setitem__(2, 4),
    "materials": lambda m: m.geom_matid.__setitem__(1, 0),
    "repeats": lambda m: m.mat_texrepeat.__setitem__(slice(None), 3.0),
    "lights": lambda m: m.light_diffuse.__setitem__(slice(None), 0.1),
    "headlight": lambda m: m.vis.headlight.ambient.__setitem__(slice(None), 1.0),
    "no headlight": lambda m: setattr(m.vis.headlight, "active", 0),
    "sites": lambda m: m.site_size.__setitem__(0, 0.2),
}


def looks() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(XML.replace('name="floor"', 'name="floor" material="checked"'))
    model.geom_rgba[0] = 0.5, 0.5, 0.5, 1.0
    model.geom_rgba[1] = 0.5, 0.5, 0.5, 1.0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_written_to_the_model_is_seen_at_the_next_update(device: wp.Device, name: str) -> None:
    model, data = looks()
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        renderer.update_scene(data, "fixed")
        before = renderer.render()
        CHANGES[name](model)
        assert (renderer.render() == before).all()
        renderer.update_scene(data, "fixed")
        after = renderer.render()
    assert (np.abs(before.astype(int) - after).max(axis=-1) > 16).mean() > 0.005
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        renderer.update_scene(data, "fixed")
        assert (renderer.render() == after).all(), "as if it had always been like that"


def test_geoms_of_another_look_are_added(device: wp.Device) -> None:
    """Add geoms as videos of several environments do, each with colours of its own."""
    model, data = made()
    pictures = []
    for changed in (False, True):
        own = copy.copy(model)
        with Renderer(own, HEIGHT, WIDTH, device=device) as renderer:
            renderer.update_scene(data, "fixed")
            if changed:
                own.geom_rgba[:, :3] = own.geom_rgba[:, 2::-1]
            none = mujoco.MjvPerturb()
            dynamic = int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
            other = mujoco.MjData(own)
            other.qpos[:] = data.qpos
            other.qpos[2] += 0.7
            mujoco.mj_forward(own, other)
            mujoco.mjv_addGeoms(own, other, mujoco.MjvOption(), none, dynamic, renderer.scene)
            pictures.append(renderer.render())
    off = np.abs(pictures[0].astype(int) - pictures[1]).max(axis=-1) > 24
    assert 0.005 < off.mean() < 0.1, "of what was added, and of nothing else"
    assert off[: HEIGHT // 2].sum() > 3 * off[HEIGHT // 2 :].sum()
