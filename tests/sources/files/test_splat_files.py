"""Splats of USD stages and PLY files: as Newton's source draws the same, moved and stretched."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
pytest.importorskip("pxr.UsdVol")
pytest.importorskip("trimesh")
import splat_scenes  # noqa: E402, newton may be missing
from pxr import Gf, Usd, UsdGeom, UsdVol, Vt  # noqa: E402
from splat_scenes import Placed, eye, nothing, random_gaussians, reference  # noqa: E402

from warpcam.sources.common.gaussian_cloud import MIN_RESPONSE  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
CLOUD = random_gaussians(120, seed=11, least=MIN_RESPONSE, size=0.2)
CAMERA = eye(outputs=("hdr", "rgb", "depth", "segmentation", "normals", "instances"))


def stage_of(cloud: Any, matrix: np.ndarray, degree: int = 1, half: bool = False) -> Usd.Stage:
    """Metres, z up; coefficients beyond the first are 0."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    prim = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/garden").GetPrim()
    UsdGeom.Xformable(prim).AddTransformOp().Set(Gf.Matrix4d(matrix.T.tolist()))
    harmonics = np.full((cloud.count, (degree + 1) ** 2, 3), 0.0, np.float32)
    harmonics[:, 0] = cloud.sh_coeffs[:, :3]
    quaternions = [Gf.Quatf(*map(float, (w, x, y, z))) for x, y, z, w in cloud.rotations]
    prim.GetAttribute("positions").Set(Vt.Vec3fArray.FromNumpy(cloud.positions))
    prim.GetAttribute("orientations").Set(Vt.QuatfArray(quaternions))
    prim.GetAttribute("scales").Set(Vt.Vec3fArray.FromNumpy(cloud.scales))
    prim.GetAttribute("opacities").Set(Vt.FloatArray.FromNumpy(cloud.opacities))
    prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(degree)
    name = "radiance:sphericalHarmonicsCoefficients"
    if half:
        prim.GetAttribute(f"{name}h").Set(Vt.Vec3hArray.FromNumpy(harmonics.reshape(-1, 3).astype(np.float16)))
    else:
        prim.GetAttribute(name).Set(Vt.Vec3fArray.FromNumpy(harmonics.reshape(-1, 3)))
    return stage


def write_ply(path: Path, cloud: Any, form: str) -> None:
    """Write a file as training does: logarithms of scales, logits of opacities."""
    opacities = np.clip(cloud.opacities.astype(np.float64), 1e-6, 1.0 - 1e-6)
    columns = {
        **dict(zip("xyz", cloud.positions.T, strict=True)),
        **{f"f_dc_{k}": cloud.sh_coeffs[:, k] for k in range(3)},
        **{f"f_rest_{k}": np.zeros(cloud.count) for k in range(9)},
        "opacity": np.log(opacities / (1.0 - opacities)),
        **{f"scale_{k}": np.log(cloud.scales[:, k]) for k in range(3)},
        **{f"rot_{k}": cloud.rotations[:, (3, 0, 1, 2)[k]] for k in range(4)},
    }
    head = ["ply", f"format {form} 1.0", f"element vertex {cloud.count}"]
    head += [*(f"property float {name}" for name in columns), "end_header", ""]
    rows = np.stack(list(columns.values()), axis=1)
    text = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())
    data = text.encode() if form == "ascii" else rows.astype("<f4" if "little" in form else ">f4").tobytes()
    path.write_bytes("\n".join(head).encode() + data)


def check(seen: dict[str, np.ndarray], expected: dict[str, np.ndarray], tolerance: float = 1e-3) -> None:
    assert np.abs(splat_scenes.shown(seen)["hdr"][0] - expected["hdr"]).max() < tolerance
    sure = expected["halves"] > 0.01
    assert (seen["segmentation"][0] == expected["segmentation"])[sure].all()
    finite = sure & np.isfinite(expected["depth"])
    assert finite.sum() > 50
    assert seen["depth"][0][finite] == pytest.approx(expected["depth"][finite], rel=1e-3)


def matrix_of(rotation: tuple[float, ...], scale: Any, position: tuple[float, ...]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = splat_scenes.matrix(rotation) @ np.diag(scale)
    matrix[:3, 3] = position
    return matrix


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (0.6, 1.3, 0.9), (-0.8, 0.8, 0.8)])
def test_a_stage(device: wp.Device, scale: tuple[float, ...], half: bool) -> None:
    placed = Placed(CLOUD, (0.2, 0.5, 0.1), (0.2, 0.3, -0.1, 0.9), scale)
    scene = wc.from_usd(stage_of(CLOUD, matrix_of(placed.rotation, scale, placed.position), half=half), device=device)
    check(scenes.look(scene, CAMERA), reference([placed], CAMERA, nothing(CAMERA)), 0.01 if half else 1e-3)


def test_a_shear_is_baked(device: wp.Device) -> None:
    """Against a cloud of Gaussians with the sheared ones' covariances."""
    shear = np.eye(4)
    shear[0, 2], shear[1, 0] = 0.7, -0.3
    seen = scenes.look(wc.from_usd(stage_of(CLOUD, shear), device=device), CAMERA)
    axes = np.stack([splat_scenes.matrix(q) for q in CLOUD.rotations]) * CLOUD.scales[:, None, :]
    u, sizes, _ = np.linalg.svd(shear[:3, :3] @ axes)
    u[np.linalg.det(u) < 0.0] *= -1.0
    turned = [wp.quat_from_matrix(wp.mat33(m.astype(np.float32))) for m in u]
    baked = newton.Gaussian(
        CLOUD.positions @ shear[:3, :3].T,
        np.array([list(q) for q in turned]),
        sizes,
        CLOUD.opacities,
        CLOUD.sh_coeffs,
        min_response=MIN_RESPONSE,
    )
    check(seen, reference([Placed(baked)], CAMERA, nothing(CAMERA)))


def test_instances_share_a_cloud_and_poses_are_driven(device: wp.Device) -> None:
    stage = stage_of(CLOUD, np.eye(4))
    scene = wc.from_usd(stage, num_worlds=2, device=device)
    renderer = wc.Renderer(scene, [CAMERA])
    poses = np.zeros((2, 1, 7), np.float32)
    poses[..., 3] = 1.0
    poses[1, 0, :3] = (0.3, 1.0, 0.2)
    scene.set_poses(["/garden"], poses)
    seen = scenes.on_host(renderer.render()["eye"])
    for world, position in enumerate(((0.0, 0.0, 0.0), (0.3, 1.0, 0.2))):
        expected = reference([Placed(CLOUD, position)], CAMERA, nothing(CAMERA))
        check({name: image[world : world + 1] for name, image in seen.items()}, expected)
    scene.set_visible(["/garden"], np.array([[1], [0]], np.uint8))
    seen = scenes.on_host(renderer.render()["eye"])
    assert (seen["segmentation"][0] == 0).any() and (seen["segmentation"][1] == -1).all()


@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_a_ply_file(device: wp.Device, tmp_path: Path, form: str) -> None:
    write_ply(tmp_path / "garden.ply", CLOUD, form)
    seen = scenes.look(wc.load(tmp_path / "garden.ply", device=device), CAMERA)
    check(seen, reference([Placed(CLOUD)], CAMERA, nothing(CAMERA)))


def test_arrays_that_differ_in_length_are_named(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    stage = stage_of(CLOUD, np.eye(4))
    UsdGeom.Cube.Define(stage, "/box")
    stage.GetPrimAtPath("/garden").GetAttribute("scales").Set(Vt.Vec3fArray([(1, 1, 1)]))
    with caplog.at_level("WARNING", logger="warpcam"):
        wc.from_usd(stage, device=device)
    assert "has splats whose arrays are empty or differ in length" in caplog.text
    assert "/garden" in caplog.text
