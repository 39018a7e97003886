"""Projection of points and its inverse: against OpenCV, against published formulas, and against what is traced."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from custom_ray_tables import HEIGHT, WIDTH
from lens_samples import BACKWARD, BENT, LENSES, PIXELS, published
from ray_table_scenes import camera, rendered

import warpcam as wc
from warpcam.accel import ray_tables
from warpcam.core.torch_interop import device_of

SIZE = {"width": WIDTH, "height": HEIGHT}
PUBLISHED = (
    "KannalaBrandt",
    "FTheta forward",
    "ThinPrismFisheye",
    "RadTanThinPrismFisheye",
    "Omnidirectional",
    "DoubleSphere",
    "ExtendedUnified",
    "Equirectangular",
)


def centres() -> torch.Tensor:
    """Middles of the pixels, (height, width, 2)."""
    row, column = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    return torch.tensor(np.stack([column, row], axis=-1))


def points_ahead(count: int = 400, most: float = 1.0, seed: int = 0) -> torch.Tensor:
    """Points up to ``most`` as far aside as they are ahead."""
    random = np.random.default_rng(seed)
    ahead = random.uniform(0.5, 4.0, count)
    aside = random.uniform(-most, most, (count, 2)) * ahead[:, None]
    return torch.tensor(np.concatenate([aside, -ahead[:, None]], axis=1))


@pytest.mark.parametrize(
    "coefficients",
    [
        (-0.2, 0.05, 0.001, -0.002),
        (-0.2, 0.05, 0.001, -0.002, 0.01),
        (-0.1, 0.02, 0.001, -0.002, 0.003, 0.05, 0.01, 0.002),
        (-0.1, 0.02, 0.001, -0.002, 0.003, 0.05, 0.01, 0.002, 0.002, -0.001, 0.003, 0.001),
        (-0.1, 0.02, 0.001, -0.002, 0.003, 0.05, 0.01, 0.002, 0.002, -0.001, 0.003, 0.001, 0.03, -0.05),
    ],
)
def test_distorted_is_opencvs(coefficients: tuple[float, ...]) -> None:
    cv2 = pytest.importorskip("cv2")
    points = points_ahead()
    matrix = np.array([[410.0, 0.0, 320.0], [0.0, 405.0, 240.0], [0.0, 0.0, 1.0]])
    turned = points.numpy() * (1.0, -1.0, -1.0)
    theirs = cv2.projectPoints(turned, np.zeros(3), np.zeros(3), matrix, np.array(coefficients))[0][:, 0] + 0.5
    lens = wc.Distorted(fx=410.0, fy=405.0, cx=320.5, cy=240.5, coefficients=coefficients)
    pixels = lens.project(points)
    np.testing.assert_allclose(pixels.numpy(), theirs, atol=1e-9)
    np.testing.assert_allclose(lens.unproject(pixels, -points[:, 2]).numpy(), points.numpy(), atol=1e-6)


@pytest.mark.parametrize("k", [(0.0, 0.0, 0.0, 0.0), (0.012, -0.003, 0.0005, 0.0001)])
def test_fisheye_is_opencvs(k: tuple[float, ...]) -> None:
    cv2 = pytest.importorskip("cv2")
    points = points_ahead(most=4.0)
    matrix = np.array([[310.0, 0.0, 320.0], [0.0, 305.0, 240.0], [0.0, 0.0, 1.0]])
    turned = points.numpy()[:, None] * (1.0, -1.0, -1.0)
    theirs = cv2.fisheye.projectPoints(turned, np.zeros(3), np.zeros(3), matrix, np.array(k))[0][:, 0] + 0.5
    pixels = {"cx": 320.5, "cy": 240.5}
    distances = 305.0 * np.array([1.0, *k])
    forward = np.stack([0.0 * distances, distances], axis=1).reshape(-1)
    for lens in (
        wc.Fisheye(fx=310.0, fy=305.0, k=k, **pixels),
        wc.KannalaBrandt((1.0, *k), mu=310.0, mv=305.0, **pixels),
        wc.FTheta(forward=forward, linear=(310.0 / 305.0, 0.0, 0.0), **pixels),
        wc.ThinPrismFisheye(fx=310.0, fy=305.0, coefficients=(k[0], k[1], 0.0, 0.0, k[2], k[3], 0.0, 0.0), **pixels),
        wc.RadTanThinPrismFisheye(fx=310.0, fy=305.0, coefficients=(*k, *np.zeros(8)), **pixels),
    ):
        pixels_of = lens.project(points)
        np.testing.assert_allclose(pixels_of.numpy(), theirs, atol=1e-9, err_msg=type(lens).__name__)
        back = lens.unproject(pixels_of, distance=points.norm(dim=-1))
        np.testing.assert_allclose(back.numpy(), points.numpy(), atol=1e-6, err_msg=type(lens).__name__)


@pytest.mark.parametrize("name", PUBLISHED)
def test_formulas_are_those_published(name: str) -> None:
    points = points_ahead(most=1.5, seed=3)
    pixels = LENSES[name]().project(points, **SIZE).numpy()
    seen = np.isfinite(pixels).all(axis=-1)
    assert seen.mean() > 0.9
    np.testing.assert_allclose(pixels[seen], published(name, points.numpy())[seen], atol=1e-9)


def test_angle_is_the_polynomial_of_the_distance() -> None:
    lens = wc.FTheta(backward=BACKWARD, cx=23.0, cy=13.0)
    distance = torch.linspace(0.0, 30.0, 61, dtype=torch.float64)
    rays = lens.unproject(torch.stack([23.0 + 0.6 * distance, 13.0 - 0.8 * distance], dim=-1)).numpy()
    angle = np.polynomial.polynomial.polyval(distance.numpy(), BACKWARD)
    expected = np.stack([0.6 * np.sin(angle), 0.8 * np.sin(angle), -np.cos(angle)], axis=-1)
    np.testing.assert_allclose(rays, expected, atol=1e-12)


@pytest.mark.parametrize("name", LENSES)
def test_pixels_lead_to_points_and_back(name: str) -> None:
    random = np.random.default_rng(7)
    pixels = torch.tensor(random.uniform((0.0, 0.0), (WIDTH, HEIGHT), (5, 80, 2)))
    lens = LENSES[name]()
    rays = lens.unproject(pixels, **SIZE)
    seen = rays.isfinite().all(dim=-1)
    assert seen.float().mean() > 0.5
    assert (rays.isnan().any(dim=-1) == ~seen).all()
    np.testing.assert_allclose(rays[seen].norm(dim=-1).numpy(), 1.0, atol=1e-12)
    distance = torch.tensor(random.uniform(0.5, 3.0, (5, 80)))
    points = lens.unproject(pixels, distance=distance, **SIZE)
    np.testing.assert_allclose(lens.project(points, **SIZE)[seen].numpy(), pixels[seen].numpy(), atol=1e-5)
    assert lens.project(points, **SIZE)[~seen].isnan().all()
    planar = lens.unproject(pixels, -points[..., 2], **SIZE)
    flat = rays[..., 2].abs() < 1e-3  # a ray at right angles to the axis is anywhere at its depth
    np.testing.assert_allclose(planar[seen & ~flat].numpy(), points[seen & ~flat].numpy(), atol=1e-6)
    single = lens.unproject(pixels.float(), **SIZE)
    assert single.dtype is torch.float32
    np.testing.assert_allclose(single[seen].numpy(), rays[seen].numpy(), atol=1e-4)


@pytest.mark.parametrize("name", [name for name in LENSES if name not in ("Pinhole", "Orthographic")])
def test_centres_of_pixels_look_along_the_ray_table(name: str) -> None:
    lens = LENSES[name]()
    table = ray_tables.unit(lens.rays(WIDTH, HEIGHT, 1, "lens")[0])
    rays = torch.nan_to_num(lens.unproject(centres(), **SIZE), nan=0.0).numpy()
    np.testing.assert_allclose(rays, table, atol=1e-12)


@pytest.mark.parametrize("name", LENSES)
def test_points_that_are_traced_come_to_their_pixels(name: str, device: wp.Device) -> None:
    """The images ``points``, ``depth`` and ``distance`` are those of the formulas, in the camera's frame."""
    mjm = scenes.compile_xml('<geom type="box" size="3 2.5 2"/><geom size=".4" pos=".2 .3 1.4"/>')
    mjm.geom_pos[0] = 0.0
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    lens = LENSES[name]()
    outside = {"position": (0.3, -0.2, 6.0), "rotation": (0.99, 0.03, -0.05, 0.1)}
    seen = rendered(scene, camera(lens, outputs=("points", "depth", "distance"), **outside))[0]
    turn, position = scenes.matrix(outside["rotation"]), np.asarray(outside["position"])
    hit = np.isfinite(seen["distance"])
    local = torch.tensor((np.where(hit, seen["points"], 0.0) - position) @ turn, device=device_of(device))
    hit = torch.tensor(hit[..., 0], device=local.device)
    assert hit.float().mean() > 0.02
    pixels = lens.project(local, **SIZE)
    assert pixels.device == local.device and pixels.dtype == local.dtype
    assert (pixels - centres().to(local.device))[hit].abs().max() < 2e-3
    for kind in ("depth", "distance"):
        image = torch.tensor(seen[kind], device=local.device)
        found = lens.unproject(centres().to(local.device), **{kind: image}, **SIZE)
        assert (found - local)[hit].abs().max() < 2e-4, kind


@pytest.mark.parametrize("name", LENSES)
def test_no_place_and_no_number_are_not_seen(name: str) -> None:
    points = torch.tensor([[0.0, 0.0, 0.0], [np.nan, 0.0, -1.0], [0.1, 0.1, np.nan], [0.1, 0.1, -1.0]])
    pixels = LENSES[name]().project(points, **SIZE)
    if name not in ("Orthographic", "Rays with origins"):  # whose rays do not begin there
        assert pixels[0].isnan().all()
    assert pixels[1:3].isnan().any(dim=-1).all() and pixels[3].isfinite().all()
    rays = LENSES[name]().unproject(torch.tensor([[np.nan, 3.0], [22.6, 13.2]]), **SIZE)
    assert rays[0].isnan().any() and rays[1].isfinite().all()


@pytest.mark.parametrize("name", ["Pinhole", "Orthographic", "Distorted"])
def test_points_behind_are_not_seen(name: str) -> None:
    points = torch.tensor([[0.0, 0.0, 1.0], [0.2, 0.1, 0.5]])
    assert LENSES[name]().project(points, **SIZE).isnan().all()


@pytest.mark.parametrize(
    ("lens", "last"),
    [
        (wc.Fisheye(fx=10.0, cx=0.0, cy=0.0, max_fov=200.0), np.radians(100.0)),
        (wc.Fisheye(fx=10.0, cx=0.0, cy=0.0, k=(-0.1, 0.0, 0.0, 0.0)), np.sqrt(1.0 / 0.3)),
        (wc.KannalaBrandt((10.0, -1.0), cx=0.0, cy=0.0), np.sqrt(10.0 / 3.0)),
        (wc.FTheta(forward=(0.0, 10.0, -2.0), cx=0.0, cy=0.0), 2.5),
        (wc.FTheta(backward=(0.0, 0.1, -0.001), cx=0.0, cy=0.0), 2.5),
        (wc.FTheta(backward=(0.0, 0.1), cx=0.0, cy=0.0, max_fov=90.0), np.radians(45.0)),
        (wc.ThinPrismFisheye(fx=10.0, cx=0.0, cy=0.0, coefficients=(-0.1, *np.zeros(7))), np.sqrt(1.0 / 0.3)),
        (wc.RadTanThinPrismFisheye(fx=10.0, cx=0.0, cy=0.0, coefficients=(-0.1, *np.zeros(11))), np.sqrt(1.0 / 0.3)),
        (wc.Distorted(fx=10.0, cx=0.0, cy=0.0, coefficients=(-0.3, 0.0, 0.0, 0.0)), np.arctan(np.sqrt(1.0 / 0.9))),
        (wc.Omnidirectional(2.0, fx=10.0, cx=0.0, cy=0.0), np.arccos(-0.5)),
        (wc.Omnidirectional(0.5, fx=10.0, cx=0.0, cy=0.0), np.arccos(-0.5)),
        (wc.DoubleSphere(0.0, 0.6, fx=10.0, cx=0.0, cy=0.0), np.arccos(-2.0 / 3.0)),
        (wc.DoubleSphere(-0.3, 0.7, fx=10.0, cx=0.0, cy=0.0), None),
        (wc.ExtendedUnified(0.25, 1.0, fx=10.0, cx=0.0, cy=0.0), np.arccos(-1.0 / 3.0)),
    ],
)
def test_nothing_is_seen_beyond_the_reach_of_a_formula(lens: wc.Lens, last: float | None) -> None:
    """A pixel is given to one direction at most, and each direction that is given one is the pixel's."""
    angle = torch.linspace(0.0, 3.1, 3101, dtype=torch.float64)
    points = torch.stack([0.6 * torch.sin(angle), 0.8 * torch.sin(angle), -torch.cos(angle)], dim=-1)
    pixels = lens.project(points)
    seen = pixels.isfinite().all(dim=-1)
    assert 0.1 < seen.double().mean() < 1.0
    assert (seen[1:] <= seen[:-1]).all()  # up to an angle, and none beyond
    if last is not None:
        assert abs(float(angle[seen].max()) - last) < 0.02
    radius = pixels[seen].norm(dim=-1)
    assert (radius[1:] > radius[:-1]).all()
    np.testing.assert_allclose(lens.unproject(pixels)[seen].numpy(), points[seen].numpy(), atol=1e-4)


@pytest.mark.parametrize("name", ["Fisheye", "KannalaBrandt", "FTheta forward", "Equirectangular"])
def test_straight_behind(name: str) -> None:
    lenses: dict[str, wc.Lens] = {
        "Fisheye": wc.Fisheye(fx=4.0),
        "KannalaBrandt": wc.KannalaBrandt((4.0,)),
        "FTheta forward": wc.FTheta(forward=(0.0, 4.0)),
        "Equirectangular": wc.Equirectangular(),
    }
    behind = torch.tensor([[0.0, 0.0, 1.0], [1e-3, 0.0, 1.0]], dtype=torch.float64)
    pixels = lenses[name].project(behind, **SIZE)
    if name != "Equirectangular":  # a circle, and no place
        assert pixels[0].isnan().all()
    assert pixels[1].isfinite().all()
    back = lenses[name].unproject(pixels[1:], **SIZE)
    np.testing.assert_allclose(back.numpy(), (behind[1:] / behind[1:].norm()).numpy(), atol=1e-9)


def test_panoramas_of_a_part() -> None:
    lens = wc.Equirectangular(fovx=90.0, fovy=60.0)
    table = lens.rays(WIDTH, HEIGHT, 1, "lens")[0]
    assert table.any(axis=-1).all()
    azimuth = np.degrees(np.arctan2(table[..., 0], -table[..., 2]))
    np.testing.assert_allclose(azimuth[5], (np.arange(WIDTH) + 0.5) * 2.0 - 45.0, atol=1e-9)
    aside = torch.tensor([[1.0, 0.0, -0.9], [1.0, 0.0, -1.1], [0.0, 1.0, -1.0]])
    seen = lens.project(aside, **SIZE).isfinite().all(dim=-1)
    assert seen.tolist() == [False, True, False]


PER_WORLD: dict[str, tuple[Callable[..., wc.Lens], dict[str, Any]]] = {
    "Pinhole": (wc.Pinhole, {"fx": [20.0, 21.0, 22.0]}),
    "Pinhole of an angle": (wc.Pinhole, {"fovy": [50.0, 60.0, 70.0]}),
    "Orthographic": (wc.Orthographic, {"height": [2.0, 2.5, 3.0]}),
    "Fisheye": (wc.Fisheye, {"fx": 21.0, "k": [BENT, (0.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0)]}),
    "KannalaBrandt": (wc.KannalaBrandt, {"coefficients": [(20.0, 1.0), (21.0, 0.5), (22.0, 0.0)]}),
    "FTheta": (wc.FTheta, {"backward": [(0.0, 0.05), (0.0, 0.06), (0.0, 0.07)]}),
    "Distorted": (wc.Distorted, {"fx": 20.0, "coefficients": [(-0.1, 0.02, 0.0, 0.0)] * 2 + [(0.1, 0.0, 0.01, 0.0)]}),
    "ThinPrismFisheye": (wc.ThinPrismFisheye, {"fx": [20.0, 21.0, 22.0], "coefficients": np.full((3, 8), 0.001)}),
    "RadTanThinPrismFisheye": (wc.RadTanThinPrismFisheye, {"fx": [20.0, 21.0, 22.0]}),
    "Omnidirectional": (wc.Omnidirectional, {"xi": [0.5, 0.9, 1.3], "fx": 20.0}),
    "DoubleSphere": (wc.DoubleSphere, {"xi": [0.0, 0.1, -0.2], "alpha": 0.6, "fx": 20.0}),
    "ExtendedUnified": (wc.ExtendedUnified, {"alpha": 0.6, "beta": [1.0, 1.1, 0.9], "fx": 20.0}),
    "Equirectangular": (wc.Equirectangular, {"fovx": [360.0, 180.0, 90.0]}),
    "Rays": (wc.Rays, {"directions": wc.Fisheye(fovy=np.array([90.0, 120.0, 150.0])).rays(WIDTH, HEIGHT, 3, "lens")}),
}


@pytest.mark.parametrize("name", PER_WORLD)
def test_lenses_of_each_world(name: str) -> None:
    kind, values = PER_WORLD[name]
    together = kind(**values)
    points = torch.stack([points_ahead(30, 0.4, seed) for seed in range(3)]).reshape(3, 5, 6, 3)
    pixels = together.project(points, **SIZE)
    rays = together.unproject(pixels, distance=points.norm(dim=-1), **SIZE)
    assert pixels.shape == (3, 5, 6, 2) and pixels.isfinite().float().mean() > 0.9
    for world in range(3):
        alone = kind(**{key: one[world] if len(np.shape(one)) else one for key, one in values.items()})
        assert torch.equal(alone.project(points[world], **SIZE).nan_to_num(), pixels[world].nan_to_num())
        seen = pixels[world].isfinite().all(dim=-1)
        back = alone.unproject(pixels[world], distance=points[world].norm(dim=-1), **SIZE)
        np.testing.assert_allclose(rays[world][seen].numpy(), back[seen].numpy(), atol=1e-12)
    with pytest.raises(wc.WarpcamError, match=r"project: the lens differs by world, and needs the shape \(world, ..."):
        together.project(points[0, 0, 0], **SIZE)
    with pytest.raises(wc.WarpcamError, match=r"must have shape .*got \(3,"):
        together.project(points[:2], **SIZE)


def test_numbers_in_any_form() -> None:
    lens = wc.Fisheye(**PIXELS, k=BENT)
    expected = lens.project(torch.tensor([[0.5, 0.2, -1.0]]))
    for points in (
        [[0.5, 0.2, -1.0]],
        np.array([[0.5, 0.2, -1.0]]),
        wp.array([[0.5, 0.2, -1.0]], dtype=float, device="cpu"),
    ):
        assert torch.allclose(lens.project(points).float(), expected, atol=1e-4)
    whole = lens.project(torch.tensor([[0, 0, -1]]))
    assert whole.dtype is torch.float32 and whole.tolist() == [[PIXELS["cx"], PIXELS["cy"]]]
    half = lens.project(torch.tensor([[0.0, 0.0, -1.0]], dtype=torch.bfloat16))
    assert half.dtype is torch.bfloat16
    assert lens.project(torch.zeros(0, 3)).shape == (0, 2)


def test_shapes_of_depth() -> None:
    lens, pixels = wc.Pinhole(**PIXELS), centres()
    flat = lens.unproject(pixels, 2.0)
    assert (flat[..., 2] + 2.0).abs().max() < 1e-12
    for depth in (torch.full((HEIGHT, WIDTH), 2.0), torch.full((HEIGHT, WIDTH, 1), 2.0)):
        assert torch.equal(lens.unproject(pixels, depth), flat)
    assert torch.equal(lens.unproject(pixels, torch.full((4, HEIGHT, WIDTH, 1), 2.0))[2], flat)
    missed = lens.unproject(pixels, torch.tensor([[[np.inf]]]))
    assert missed.isnan().all() and lens.unproject(pixels, -1.0).isnan().all()
    behind = wc.Fisheye(fx=9.0, **{"cx": PIXELS["cx"], "cy": PIXELS["cy"]}).unproject(pixels, -1.0)
    assert (behind[0, 0, 2] - 1.0).abs() < 1e-12 and behind[13, 22].isnan().all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wc.Pinhole(fx=9.0).project([[0.0, 0.0]]), r"Pinhole.project: points must have shape \(..., 3\), got"),
        (lambda: wc.Pinhole(fx=9.0).project("all"), "points must be a tensor of real numbers, got 'all'"),
        (lambda: wc.Pinhole(fx=9.0).project(torch.ones(3, dtype=torch.bool)), "real numbers, got torch.bool"),
        (lambda: wc.Pinhole(fx=9.0).project([0, 0, -1]), "width .pixels. was not given, and is needed without cx"),
        (
            lambda: wc.Pinhole(fx=9.0, cx=1.0).project([0, 0, -1]),
            "height .pixels. was not given, and is needed without",
        ),
        (lambda: wc.Pinhole(fovy=60.0).project([0, 0, -1], width=5), "height .pixels. was not given, .* with fovy"),
        (
            lambda: wc.Fisheye(fovy=60.0).project([0, 0, -1]),
            "Fisheye.project: width .pixels. was not given, .* with fovy",
        ),
        (lambda: wc.Pinhole(fovy=60.0).project([0, 0, -1], width=5, height=0), "height must be a positive number of"),
        (lambda: wc.Orthographic(2.0).unproject([0, 0]), "Orthographic.unproject: width .pixels. was not given"),
        (lambda: wc.Equirectangular().unproject([0, 0]), "Equirectangular.unproject: width .pixels. was not given"),
        (lambda: wc.Orthographic(0.0).unproject([0, 0], **SIZE), "height of the lens must be positive, got 0.0"),
        (lambda: wc.Pinhole(fx=9.0).unproject([0, 0, 0]), r"Pinhole.unproject: pixels must have shape \(..., 2\), got"),
        (lambda: wc.Pinhole(fx=9.0).unproject([0, 0], 1.0, distance=1.0, **SIZE), "both depth and distance came"),
        (
            lambda: wc.Pinhole(fx=9.0).unproject(torch.zeros(4, 2), torch.ones(3), **SIZE),
            r"depth must have shape \(4,\), or one that can be broadcast to \(4, 1\), got \(3,\)",
        ),
        (lambda: wc.Pinhole(fx=9.0).unproject([0, 0], distance="far", **SIZE), "distance must be a tensor of real"),
        (lambda: LENSES["Rays"]().project([0, 0, -1], width=5), "Rays.project: width must be the table's, 45, or None"),
        (lambda: wc.Pinhole(fx=-1.0).project([0, 0, -1], **SIZE), "Pinhole.project: fx must be positive, got -1.0"),
    ],
)
def test_bad_arguments_are_named(call: Callable[[], object], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        call()


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        (lambda: wc.FTheta(), "FTheta: one of the polynomials backward and forward is needed, neither came"),
        (lambda: wc.FTheta(backward=(0, 1), forward=(0, 1)), "backward and forward is needed, both came"),
        (
            lambda: wc.FTheta(backward=(0.1,)),
            r"lens FTheta: backward must have shape \(n,\) or \(1, n\) with n at least 2",
        ),
        (lambda: wc.FTheta(forward=(0.0, -5.0)), "forward: coefficients after the constant: the first that is not 0"),
        (lambda: wc.FTheta(forward=(0.0, 0.0)), "the first that is not 0 must be positive, got"),
        (lambda: wc.FTheta(backward=(4.0, 0.1)), "backward's constant must be below half of max_fov .rad., got 4.0"),
        (lambda: wc.FTheta(backward=(0.0, 0.1), linear=(0.0, 0.0, 0.0)), "linear must have a positive determinant"),
        (lambda: wc.FTheta(backward=(0.0, 0.1), max_fov=0.0), r"max_fov must be in \(0, 360\] degrees, got 0.0"),
        (lambda: wc.KannalaBrandt((1.0,) * 6), r"lens KannalaBrandt: coefficients must have shape \(1,\), \(2,\)"),
        (lambda: wc.KannalaBrandt((-1.0, 2.0)), "coefficients: the first that is not 0 must be positive"),
        (lambda: wc.KannalaBrandt((1.0,), mv=0.0), "mv must be positive, got 0.0"),
        (lambda: wc.ThinPrismFisheye(fx=9.0, coefficients=(0.0,) * 4), r"coefficients must have shape \(8,\) or"),
        (
            lambda: wc.RadTanThinPrismFisheye(fx=9.0, coefficients=(0.0,) * 8),
            r"coefficients must have shape \(12,\) or",
        ),
        (lambda: wc.Distorted(fx=9.0, coefficients=(0.0,) * 13), r"shape \(4,\), \(5,\), \(8,\), \(12,\), \(14,\) or"),
        (lambda: wc.Omnidirectional(-1.0, fx=9.0), "lens Omnidirectional: xi must be at least 0, got -1.0"),
        (lambda: wc.DoubleSphere(0.0, 1.5, fx=9.0), r"lens DoubleSphere: alpha must be in \[0, 1\], got 1.5"),
        (lambda: wc.ExtendedUnified(0.5, 0.0, fx=9.0), "lens ExtendedUnified: beta must be positive, got 0.0"),
        (lambda: wc.Equirectangular(fovy=181.0), r"lens Equirectangular: fovy must be in \(0, 180\] degrees, got 181"),
        (lambda: wc.Equirectangular(fovx=0.0), r"lens Equirectangular: fovx must be in \(0, 360\] degrees, got 0.0"),
    ],
)
def test_bad_lenses_are_named(lens: Callable[[], wc.Lens], message: str) -> None:
    mjm = scenes.compile_xml("")
    with pytest.raises(wc.WarpcamError, match=message):
        wc.Renderer(wc.from_mujoco(mjm, mujoco.MjData(mjm), device="cpu"), [camera(lens())])
