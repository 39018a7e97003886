"""Colours that depend on the direction of the ray: spherical harmonics of degrees 1 to 3."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.core.color import encoded_beyond
from warpcam.sources.common.gaussian_cloud import BASE, cloud_of_ply

special = pytest.importorskip("scipy.special")
STEP = 1.0 / 255.0
COUNTS = {1: 3, 2: 8, 3: 15}
FOVY = 40.0


def basis(degree: int, order: int, directions: np.ndarray) -> np.ndarray:
    """A real spherical harmonic with the phase of Condon and Shortley, of unit vectors (..., 3)."""
    polar, azimuth = np.arccos(directions[..., 2]), np.arctan2(directions[..., 1], directions[..., 0])
    value = special.sph_harm_y(degree, abs(order), polar, azimuth)
    if order == 0:
        return np.real(value)
    return np.sqrt(2.0) * (np.real(value) if order > 0 else np.imag(value))


def colors(constant: np.ndarray, harmonics: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The display colour, (..., 3)."""
    total = np.broadcast_to(constant, directions.shape).copy()
    pairs = [(degree, order) for degree in (1, 2, 3) for order in range(-degree, degree + 1)]
    for (degree, order), coefficient in zip(pairs, harmonics, strict=False):
        total += basis(degree, order, directions)[..., None] * coefficient
    return np.maximum(total, 0.0)


def opaque(**more: Any) -> dict[str, Any]:
    """A Gaussian that fills the picture: its alpha is 1 there to a step in 255."""
    return {"positions": np.zeros((1, 3)), "scales": np.full((1, 3), 50.0), **more}


def see(device: wp.Device, splats: Any) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Images from 4 m along -y, and the rays' unit directions in the world."""
    mjm = scenes.compile_xml('<camera name="eye" pos="0 -4 0" xyaxes="1 0 0 0 0 1" fovy="40"/>')
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), splats=splats, device=device)
    camera = wc.Camera("eye", width=33, height=25, outputs=("rgb", "albedo", "depth"))
    images = {name: image[0] for name, image in scenes.look(scene, camera).items()}
    directions = scenes.pixel_rays(33, 25, FOVY) @ np.array(((1, 0, 0), (0, 0, 1), (0, -1, 0)))
    return images, directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_each_degree(device: wp.Device, degree: int) -> None:
    """The cloud is turned, and its colours with it."""
    random = np.random.default_rng(degree)
    harmonics = 0.3 * random.normal(size=(COUNTS[degree], 3))
    constant = np.array((0.4, 0.5, 0.6))
    quaternion = random.normal(size=4)
    splats = wc.Splats(opaque(colors=[constant], harmonics=harmonics[None]), rotation=quaternion, scale=2.0)
    images, directions = see(device, splats)
    expected = np.clip(colors(constant, harmonics, directions @ scenes.matrix(quaternion)), 0.0, 1.0)
    assert expected.std(axis=(0, 1)).max() > 0.03
    for name in ("rgb", "albedo"):
        assert np.abs(images[name] * STEP - expected).max() < 2.5 * STEP


def test_degrees_mix(device: wp.Device) -> None:
    """A cloud without harmonics beside one with them, and one of linear light."""
    harmonics = 0.2 * np.random.default_rng(0).normal(size=(1, 8, 3))
    constant = np.array((0.4, 0.5, 0.6))
    clouds = [opaque(colors=[constant]), opaque(colors=[constant], harmonics=harmonics)]
    plain, _ = see(device, wc.Splats(clouds))
    same, _ = see(device, wc.Splats(clouds[0]))  # in a scene whose kernel knows of no harmonics
    assert np.array_equal(plain["rgb"], same["rgb"])
    assert np.abs(plain["rgb"] * STEP - constant).max() < 2.0 * STEP
    colored, directions = see(device, wc.Splats(clouds, choice=1))
    assert np.abs(colored["rgb"] * STEP - colors(constant, harmonics[0], directions)).max() < 2.5 * STEP


def columns_of(harmonics: np.ndarray, constant: np.ndarray) -> dict[str, np.ndarray]:
    """One opaque Gaussian as training writes it: of each channel all coefficients, one channel after another."""
    values = {
        **dict.fromkeys("xyz", 0.0), "opacity": 12.0, **{f"scale_{k}": np.log(50.0) for k in range(3)},
        "rot_0": 1.0, **{f"rot_{k}": 0.0 for k in range(1, 4)},
        **{f"f_dc_{k}": (constant[k] - 0.5) / BASE for k in range(3)},
        **{f"f_rest_{k}": value for k, value in enumerate(harmonics.T.ravel())},
    }  # fmt: skip
    return {name: np.array([value], np.float32) for name, value in values.items()}


@pytest.mark.parametrize("degree", [1, 3])
def test_ply(device: wp.Device, tmp_path: Path, degree: int) -> None:
    pytest.importorskip("trimesh")
    harmonics = 0.3 * np.random.default_rng(5).normal(size=(COUNTS[degree], 3))
    constant = np.array((0.4, 0.5, 0.6))
    columns = columns_of(harmonics, constant)
    head = ["ply", "format binary_little_endian 1.0", "element vertex 1"]
    head += [*(f"property float {name}" for name in columns), "end_header", ""]
    path = tmp_path / "cloud.ply"
    path.write_bytes("\n".join(head).encode() + np.concatenate(list(columns.values())).astype("<f4").tobytes())
    images, directions = see(device, wc.Splats(path))
    expected = np.clip(colors(constant, harmonics, directions), 0.0, 1.0)
    assert np.abs(images["rgb"] * STEP - expected).max() < 2.5 * STEP


def test_usd(device: wp.Device) -> None:
    """Linear light: the sum is encoded."""
    pytest.importorskip("pxr.UsdVol")
    from pxr import Gf, Usd, UsdGeom, UsdVol, Vt

    harmonics = 0.1 * np.random.default_rng(6).normal(size=(15, 3))
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    prim = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/garden").GetPrim()
    name = "radiance:sphericalHarmonicsCoefficients"
    prim.GetAttribute("positions").Set(Vt.Vec3fArray([Gf.Vec3f(0.0)]))
    prim.GetAttribute("scales").Set(Vt.Vec3fArray([Gf.Vec3f(50.0)]))
    prim.GetAttribute(name).Set(Vt.Vec3fArray.FromNumpy(np.concatenate((np.zeros((1, 3)), harmonics)).astype("f4")))
    camera = scenes.own_camera(
        width=33, height=25, outputs=("rgb",), lens=wc.Pinhole(fovy=FOVY), position=(0.0, -4.0, 0.0),
        rotation=scenes.looking((0.0, -4.0, 0.0), (0.0, 0.0, 0.0)),
    )  # fmt: skip
    directions = scenes.pixel_rays(33, 25, FOVY) @ np.array(((1, 0, 0), (0, 0, 1), (0, -1, 0)))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    for space in ("", "lin_rec709_scene"):
        if space:
            prim.GetAttribute(name).SetColorSpace(space)
        seen = scenes.look(wc.from_usd(stage, device=device), camera)["rgb"][0] * STEP
        expected = colors(np.full(3, 0.5), harmonics, directions)
        expected = np.clip(encoded_beyond(expected) if space else expected, 0.0, 1.0)
        assert np.abs(seen - expected).max() < 2.5 * STEP


def test_bad_harmonics(device: wp.Device) -> None:
    cloud = opaque(colors=[(0.5, 0.5, 0.5)], harmonics=np.zeros((1, 4, 3)))
    with pytest.raises(wc.WarpcamError, match=r"harmonics must have shape \(1, 3, 8 or 15, 3\), got \(1, 4, 3\)"):
        see(device, wc.Splats(cloud))
    columns = columns_of(np.zeros((4, 3)), np.zeros(3))
    with pytest.raises(wc.WarpcamError, match="have 12 columns f_rest; allowed are 0, 9, 24 and 45"):
        cloud_of_ply("room.ply", columns)
