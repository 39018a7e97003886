"""Horizon maps of meshes spare rays and change no image."""

import mesh_surfaces
import mujoco
import newton
import numpy as np
import pytest
import scenes
import warp as wp
from newton_scenes import eye, finalize, pose

import warpcam as wc
import warpcam.scene.scene
from warpcam.kernels.build import horizon_maps

LIGHTS = [
    wc.Light(kind="directional", direction=(0.9, 0.5, -0.4)),
    wc.Light(kind="directional", direction=(0.2, 0.3, -1.0)),
    wc.Light(kind="spot", position=(1.2, -0.7, 1.2), direction=(-0.8, 0.5, -0.4), cutoff=90.0),
]
TURNED = {
    "as it is": ((1.0, 1.0, 1.0), None),
    "turned": ((1.0, 1.0, 1.0), (0.2, -0.1, 0.7, 0.6)),
    "flat": ((1.6, 0.7, 0.3), (0.0, 0.1, 0.4, 1.0)),
    "steep": ((0.5, 0.8, 3.0), (0.1, 0.1, -0.8, 0.7)),
    "mirrored": ((-1.2, 0.8, 1.5), (0.1, 0.0, 0.3, 0.9)),
    "upside down": ((1.0, 1.4, -1.2), (0.0, 0.2, 0.9, 0.5)),
}


def furrows(count: int = 14) -> newton.Mesh:
    """A closed block whose top goes up and down, so that much of it is dark under low light."""
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, count + 1), np.linspace(-0.5, 0.5, count + 1), indexing="ij")
    height = 0.12 * np.abs(np.mod(5.0 * u + 1.0 * v, 2.0) - 1.0) + 0.05 * np.sin(7.0 * v)
    inside = (np.abs(u) < 0.499) & (np.abs(v) < 0.499)
    top = np.stack((u, v, np.where(inside, height, -0.2)), axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    corner = (i * (count + 1) + j).ravel()
    right, up, both = corner + count + 1, corner + 1, corner + count + 2
    faces = np.concatenate([np.stack([corner, right, both], 1), np.stack([corner, both, up], 1)])
    below = np.array([(0, count, count * (count + 2)), (0, count * (count + 2), count * (count + 1))])
    return newton.Mesh(top.astype(np.float32), np.concatenate([faces, below]).ravel(), compute_inertia=False)


@pytest.mark.parametrize("turned", TURNED)
def test_horizons_change_no_image(device: wp.Device, turned: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if not horizon_maps.uses_horizon_maps(device):
        pytest.skip("scenes of this device have no horizons")
    scale, rotation = TURNED[turned]
    builder = newton.ModelBuilder()
    builder.add_shape_mesh(-1, mesh=furrows(), scale=scale, xform=pose(0.0, 0.0, 0.6, rotation))
    builder.add_shape_mesh(-1, mesh=furrows(), scale=(0.3, 0.4, 0.5), xform=pose(-0.2, -0.3, 1.5, rotation))
    model, state = finalize(builder, device)

    def images(shadows: bool) -> np.ndarray:
        position = (0.2, -0.9, 1.7)
        rotation = scenes.looking(position, (0.0, 0.0, 0.7))
        camera = eye(outputs=("hdr",), shadows=shadows, position=position, rotation=rotation)
        lit = [wc.from_newton(model, state, lights=[light], ambient=(0.0, 0.0, 0.0)) for light in LIGHTS]
        return np.concatenate([scenes.look(scene, camera)["hdr"] for scene in lit])

    spared = images(shadows=True)
    monkeypatch.setattr(horizon_maps, "uses_horizon_maps", lambda device: False)
    walked = images(shadows=True)
    np.testing.assert_array_equal(spared, walked)
    assert (walked != images(shadows=False)).any(axis=-1).mean() > 0.01


@pytest.mark.parametrize("light", ["spot", "directional"])
@pytest.mark.parametrize("names", [("cup",), ("torus", "ball")])
@pytest.mark.parametrize("turned", ["as it is", "turned"])
def test_occluder_boxes_change_no_image(
    device: wp.Device, light: str, names: tuple[str, ...], turned: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo's: only there any face stops light, from whichever side."""
    if not horizon_maps.uses_horizon_maps(device):
        pytest.skip("scenes of this device have no occluder boxes")
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(9.0, 9.0, 0.1))
    for number, name in enumerate(names):
        points, faces = mesh_surfaces.CLOSED[name]()
        spec.add_mesh(name=name, uservert=points.ravel().astype(float), userface=faces.ravel())
        place = {"pos": (1.6 * number, 0.3, 1.3 + number), "quat": (1.0, 0.3, -0.2, 0.4 * (turned != "as it is"))}
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **place)
    for way in ((0.6, 0.4, -1.0), (-0.5, 0.7, -0.8), (0.1, -0.2, -1.0)):
        kind = mujoco.mjtLightType.mjLIGHT_SPOT if light == "spot" else mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        position = -4.0 * np.array(way) + (0.0, 0.0, 1.0)
        spec.worldbody.add_light(type=kind, pos=position, dir=way, cutoff=60.0, diffuse=(0.3, 0.3, 0.3))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def images(shadows: bool) -> np.ndarray:
        position = (0.4, -5.0, 4.0)
        rotation = scenes.looking(position, (0.5, 0.3, 0.7))
        camera = eye(outputs=("rgb",), shadows=shadows, position=position, rotation=rotation)
        image: np.ndarray = scenes.look(wc.from_mujoco(model, data, device=device), camera)["rgb"]
        return image

    spared = images(shadows=True)
    monkeypatch.setattr(warpcam.scene.scene, "FEW_MESHES", 0)
    walked = images(shadows=True)
    np.testing.assert_array_equal(spared, walked)
    assert (walked != images(shadows=False)).any(axis=-1).mean() > 0.02
