"""Model fields that differ between worlds, written in place, are seen at the next render."""

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc

WORLDS = 3
OUTPUTS = ("depth", "segmentation", "albedo")
SIZE = 32
TWO = """
<mesh name="small" vertex="-1 -1 -1 1 -1 -1 -1 1 -1 1 1 -1 -1 -1 1 1 -1 1 -1 1 1 1 1 1" scale="0.2 0.2 0.2"/>
<mesh name="large" vertex="-1 -1 -1 1 -1 -1 -1 1 -1 1 1 -1 -1 -1 1 1 -1 1 -1 1 1 1 1 1" scale="0.6 0.6 0.6"/>
<material name="red" rgba="1 0 0 1"/><material name="blue" rgba="0 0 1 1"/>
"""
WORLD = """
<camera name="angle" pos="0 0 4" fovy="40"/>
<camera name="sensor" pos="0 0 4" sensorsize="0.02 0.02" resolution="32 32" focal="0.02 0.02"/>
<geom name="ball" type="sphere" size="0.5" pos="-0.7 0 0" rgba="0.2 0.4 0.6 1"/>
<geom name="mesh" type="mesh" mesh="small" pos="0.7 0 0" material="red"/>
"""
BATCHED = ("geom_size", "geom_rgba", "geom_dataid", "geom_matid", "mat_rgba", "cam_fovy", "cam_intrinsic")


class Bench:
    """Three worlds, and a renderer of both cameras that has drawn them once."""

    def __init__(self, batch: bool = True):
        self.mjm = scenes.compile_xml(WORLD, assets=TWO)
        self.m, self.d = scenes.put(self.mjm, WORLDS, batch=dict.fromkeys(BATCHED, WORLDS) if batch else None)
        cameras = [wc.Camera(name, width=SIZE, height=SIZE, outputs=OUTPUTS) for name in ("angle", "sensor")]
        self.renderer = wc.Renderer(wc.from_mujoco_warp(self.mjm, self.m, self.d), cameras)
        self.before = self.draw()

    def draw(self) -> dict[str, dict[str, np.ndarray]]:
        return {name: scenes.on_host(images) for name, images in self.renderer.render().items()}

    def pixels(self, images: dict, geom: str, camera: str = "angle") -> list[int]:
        """Count the pixels of each world that show the geom."""
        return (images[camera]["segmentation"] == self.mjm.geom(geom).id).sum(axis=(1, 2)).tolist()


@pytest.fixture
def bench(device: wp.Device) -> Bench:
    del device  # Warp's current one
    return Bench()


def test_size(bench: Bench) -> None:
    scenes.write(bench.m.geom_size, (1, bench.mjm.geom("ball").id, 0), 0.25)
    scenes.write(bench.m.geom_size, (2, bench.mjm.geom("ball").id, 0), 1.0)
    first, second, third = bench.pixels(bench.draw(), "ball")
    assert first == bench.pixels(bench.before, "ball")[0]
    assert second == pytest.approx(first / 4, rel=0.2)
    assert third > 2 * first


def test_colour_and_transparency(bench: Bench) -> None:
    ball = bench.mjm.geom("ball").id
    scenes.write(bench.m.geom_rgba, (1, ball), (1.0, 0.0, 0.0, 1.0))
    scenes.write(bench.m.geom_rgba, (2, ball, 3), 0.0)
    images = bench.draw()["angle"]
    shown = [np.unique(images["albedo"][world][images["segmentation"][world] == ball], axis=0) for world in range(3)]
    assert shown[0].tolist() == [[51, 102, 153]]
    assert shown[1].tolist() == [[255, 0, 0]]
    assert len(shown[2]) == 0


def test_mesh(bench: Bench) -> None:
    scenes.write(bench.m.geom_dataid, (1, bench.mjm.geom("mesh").id), bench.mjm.mesh("large").id)
    scenes.write(bench.m.geom_dataid, (2, bench.mjm.geom("mesh").id), -1)
    first, second, third = bench.pixels(bench.draw(), "mesh")
    assert first == bench.pixels(bench.before, "mesh")[0] > 0
    assert second > 4 * first
    assert third == 0


def test_material(bench: Bench) -> None:
    mesh = bench.mjm.geom("mesh").id
    scenes.write(bench.m.geom_matid, (1, mesh), bench.mjm.material("blue").id)
    scenes.write(bench.m.mat_rgba, (2, bench.mjm.material("red").id), (0.0, 1.0, 0.0, 1.0))
    images = bench.draw()["angle"]
    for world, colour in enumerate(([255, 0, 0], [0, 0, 255], [0, 255, 0])):
        shown = images["albedo"][world][images["segmentation"][world] == mesh]
        assert np.unique(shown, axis=0).tolist() == [colour]


def test_field_of_view(bench: Bench) -> None:
    scenes.write(bench.m.cam_fovy, (1, 0), 80.0)
    images = bench.draw()
    first, second, third = bench.pixels(images, "ball")
    assert first == third
    # Areas are as the squares of tan(fovy / 2).
    assert second / first == pytest.approx((np.tan(np.radians(20)) / np.tan(np.radians(40))) ** 2, rel=0.25)
    assert np.array_equal(images["sensor"]["depth"], bench.before["sensor"]["depth"])


def test_intrinsics(bench: Bench) -> None:
    scenes.write(bench.m.cam_intrinsic, (1, 1), (0.04, 0.04, 0.0, 0.0))
    scenes.write(bench.m.cam_intrinsic, (2, 1, 2), 0.02 * 4 / SIZE)  # the principal point, by 4 pixels
    images = bench.draw()
    seen, before = images["sensor"]["segmentation"], bench.before["sensor"]["segmentation"]
    assert np.array_equal(seen[0], before[0])
    assert (seen[1] >= 0).sum() > (seen[0] >= 0).sum()
    moved = [np.argwhere(image == bench.mjm.geom("ball").id)[:, 1].max() for image in (seen[0], seen[2])]
    assert abs(int(moved[1]) - int(moved[0])) == 4
    assert np.array_equal(images["angle"]["depth"], bench.before["angle"]["depth"])


def test_arrays_that_are_replaced(bench: Bench) -> None:
    """Put another array in the place of the model's, as mjlab's ``expand_model_fields`` does."""
    plain = Bench(batch=False)
    sizes = np.repeat(plain.m.geom_size.numpy(), WORLDS, axis=0)
    sizes[1, plain.mjm.geom("ball").id, 0] = 0.25
    plain.m.geom_size = wp.array(sizes, dtype=wp.vec3, device=plain.d.geom_xpos.device)
    first, second, third = plain.pixels(plain.draw(), "ball")
    assert first == third == bench.pixels(bench.before, "ball")[0]
    assert second < 0.5 * first


def test_own_cameras(device: wp.Device) -> None:
    """Pose and lens of one's own camera: given for each world, and written later."""
    mjm = scenes.compile_xml('<geom type="box" size="9 9 1"/>')
    heights = np.array([2.0, 3.0, 4.0])
    camera = scenes.own_camera(
        position=np.stack((0 * heights, 0 * heights, heights), axis=1), lens=wc.Pinhole(fovy=heights * 10.0)
    )
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, *scenes.put(mjm, 3)), [camera])
    depth = renderer.render()["eye"]["depth"]
    assert [float(depth[world].mean()) for world in range(3)] == pytest.approx(heights - 1.0, abs=1e-6)
    live = renderer.camera("eye")
    live.position[1, 2] = 6.0
    live.rotation[2] = torch.tensor((0.0, 1.0, 0.0, 0.0))  # looks up
    live.near[0] = 2.0
    renderer.render()
    assert float(depth[1].mean()) == pytest.approx(5.0, abs=1e-6)
    assert torch.isinf(depth[2]).all()
    assert torch.isinf(depth[0]).all()
    assert live.position.device == depth.device == torch.device(wp.device_to_torch(device))


def test_cameras_on_bodies_follow(device: wp.Device) -> None:
    mjm = scenes.compile_xml(
        '<geom type="box" size="9 9 1"/><body name="arm" pos="0 0 5"><joint type="slide"/>'
        '<geom type="sphere" size="0.1" pos="0 0 1"/></body>'
    )
    mjds = [scenes.forward(mjm) for _ in range(3)]
    for world, mjd in enumerate(mjds):
        mjd.qpos[:] = world
    scene = wc.from_mujoco(mjm, mjds, device=device)
    renderer = wc.Renderer(scene, [scenes.own_camera(parent="arm", position=(0, 0, -0.5))])
    depth = renderer.render()["eye"]["depth"]
    assert depth.mean(dim=(1, 2, 3)).tolist() == pytest.approx([3.5, 3.5, 3.5], abs=1e-6)  # nothing is guessed
    renderer.render(forward=True)
    assert depth.mean(dim=(1, 2, 3)).tolist() == pytest.approx([3.5, 4.5, 5.5], abs=1e-6)
    mujoco.mj_resetData(mjm, mjds[2])
    renderer.render(forward=True)
    assert depth.mean(dim=(1, 2, 3)).tolist() == pytest.approx([3.5, 4.5, 3.5], abs=1e-6)
