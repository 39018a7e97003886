"""Images whose edges are smoothed where they were lit are those that go through a buffer of their colours."""

import itertools

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import edges


def crowd(across: int) -> tuple[str, str]:
    """Tetrahedra of all colours beside each other, each turned its own way, and their mesh."""
    random = np.random.default_rng(0)
    places = np.linspace(-1.05, 1.05, across)
    turns, colors = random.uniform(0.0, 360.0, (across, across, 3)), random.uniform(0.2, 1.0, (across, across, 3))
    bodies = "".join(
        '<geom type="mesh" mesh="corner" pos="{} {} 0" euler="{} {} {}" rgba="{} {} {} 1"/>'.format(
            x, y, *turns[i, j], *colors[i, j]
        )
        for (i, x), (j, y) in itertools.product(enumerate(places), enumerate(places))
    )
    return bodies, '<mesh name="corner" vertex="0 0 0 0.08 0 0 0 0.08 0 0 0 0.08"/>'


BESIDE = """<geom type="plane" size="0 0 1" pos="0 0 -0.3" material="mirror"/>
  <geom size="0.3" pos="0.2 0 0.2" rgba="0.3 0.5 1 0.4"/>"""


# Of numbers of shapes the second is more than a block lists before it knows the edges, the third has more edges than it
# lists at once. Each comes with all outputs and both sizes.
OUTPUTS = (("rgb",), ("rgb", "rgba", "depth"), ("rgba", "hdr"))


@pytest.mark.parametrize(
    ("across", "size", "outputs"),
    [
        (across, (42, 64)[(i + j) % 2], outputs)
        for i, across in enumerate((4, 10, 19))
        for j, outputs in enumerate(OUTPUTS)
    ],
)
def test_images_smoothed_in_place_are_the_same(
    device: wp.Device, across: int, size: int, outputs: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies, mesh = crowd(across)
    if across == 4:
        bodies, mesh = bodies + BESIDE, mesh + '<material name="mirror" reflectance="0.4"/>'
    mjm = scenes.compile_xml(bodies, assets=mesh)
    with wp.ScopedDevice(device):
        scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 3))
    settings = {"position": (0.0, 0.0, 2.0), "outputs": outputs, "width": size, "height": size}
    images, scratch = [], []
    for worlds in (10**9, 0):  # that there must be for each multiprocessor
        monkeypatch.setattr(edges, "WORTH_PLACE", worlds)
        renderer = wc.Renderer(scene, [scenes.own_camera(**settings, antialiasing=4)])
        for _ in range(2):
            renderer.render()
        renderer.render(worlds=[1])
        images.append({name: renderer.array("eye", name).numpy().copy() for name in outputs})
        scratch.append(renderer.memory.scratch)
    spared = sum({"rgb": 3, "rgba": 4}.get(name, 0) for name in outputs) * 3 * size * size
    spared = spared if device.is_cuda and "hdr" not in outputs else 0
    assert scratch[0] - scratch[1] == pytest.approx(spared, abs=1024)
    for name in outputs:
        np.testing.assert_array_equal(images[0][name], images[1][name], err_msg=name)
    if (across, size) == (19, 64):
        plain = wc.Renderer(scene, [scenes.own_camera(**settings)])
        plain.render()
        shown = plain.array("eye", outputs[0]).numpy()
        assert (images[0][outputs[0]] != shown).any(-1)[0].sum() > 1632


@pytest.mark.parametrize("outputs", [("rgb",), ("rgb", "rgba", "depth")], ids="+".join)
@pytest.mark.parametrize(("width", "height"), [(90, 70), (130, 34), (71, 68)])
def test_colours_loaded_by_words_are_those_loaded_one_by_one(
    device: wp.Device, width: int, height: int, outputs: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Several regions an image, whose rows begin anywhere in a word.
    if not device.is_cuda:
        pytest.skip("a CPU loads colours one by one")
    bodies, mesh = crowd(10)
    mjm = scenes.compile_xml(bodies, assets=mesh)
    with wp.ScopedDevice(device):
        scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 3))
    settings = {"position": (0.0, 0.0, 2.0), "outputs": outputs, "width": width, "height": height}
    images = []
    for by_words in (True, False):
        if not by_words:
            monkeypatch.setattr(edges, "_by_words", lambda *_: False)
        renderer = wc.Renderer(scene, [scenes.own_camera(**settings, antialiasing=4)])
        renderer.render()
        images.append({name: renderer.array("eye", name).numpy().copy() for name in outputs})
    for name in outputs:
        np.testing.assert_array_equal(images[0][name], images[1][name], err_msg=name)
    plain = wc.Renderer(scene, [scenes.own_camera(**settings)])
    assert (images[0]["rgb"] != plain.render()["eye"]["rgb"].cpu().numpy()).any(-1).sum() > 300
