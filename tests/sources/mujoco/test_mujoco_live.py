"""Changes of a model that MuJoCo's own renderer follows are seen at the next render of ``from_mujoco``."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

MODEL = """
<mujoco><worldbody>
  <geom size=".3" rgba="0 1 0 1"/>
  <site name="a" pos=".6 0 0" size=".2" rgba="1 0 0 1"/>
  <site name="b" pos="-.6 0 0" size=".2" rgba="0 0 1 1"/>
</worldbody></mujoco>
"""


def colors(device: wp.Device, changed: object) -> list[set[tuple[int, ...]]]:
    """Return the pixels' colours before and after a change of the model."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = scenes.forward(model)
    scene = wc.from_mujoco(model, [data, data], device=device)
    renderer = wc.Renderer(scene, [scenes.own_camera(position=(0.0, 0.0, 3.0), outputs=("albedo",))])
    found = []
    for _ in range(2):
        image = scenes.on_host(renderer.render()["eye"])["albedo"]
        assert (image[0] == image[1]).all()
        found.append({tuple(pixel) for pixel in np.unique(image.reshape(-1, 3), axis=0).tolist()})
        changed(model)
    return found


def test_sites_change_their_colour(device: wp.Device) -> None:
    def change(model: mujoco.MjModel) -> None:
        model.site("a").rgba[:] = (1, 1, 0, 1)

    assert colors(device, change) == [
        {(0, 0, 0), (0, 255, 0), (255, 0, 0), (0, 0, 255)},
        {(0, 0, 0), (0, 255, 0), (255, 255, 0), (0, 0, 255)},
    ]


@pytest.mark.parametrize("alpha", [0.0, -1.0])
def test_sites_vanish(device: wp.Device, alpha: float) -> None:
    def change(model: mujoco.MjModel) -> None:
        model.site("b").rgba[3] = alpha

    assert colors(device, change)[1] == {(0, 0, 0), (0, 255, 0), (255, 0, 0)}


def test_groups_of_each_kind(device: wp.Device) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = scenes.forward(model)

    def kinds(groups: object) -> set[int]:
        scene = wc.from_mujoco(model, data, groups=groups, device=device)
        seen = scenes.look(scene, scenes.own_camera(position=(0.0, 0.0, 3.0), outputs=("segmentation",)))
        return set(np.unique(scene.objects[seen["segmentation"], 1]).tolist())

    assert kinds((0, 1, 2)) == kinds({}) == {-1, 5, 6}
    assert kinds({"sites": (3,)}) == {-1, 5}
    assert kinds({"geoms": ()}) == {-1, 6}
    with pytest.raises(wc.WarpcamError, match="groups: 'site' came; allowed are geoms, sites"):
        kinds({"site": (1,)})
    with pytest.raises(wc.WarpcamError, match="groups must be geom groups, numbers from 0 to 5"):
        kinds({"sites": (7,)})
