"""Smooth edges: what they change, and what they must leave alone."""

import itertools
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from edge_scenes import LIT, camera

import warpcam as wc
from warpcam.kernels.passes.antialiasing import SAMPLES

SQUARE = '<geom type="box" size="0.5 0.5 0.01" euler="0 0 {turn}" rgba="1 1 1 1"/>'


def square(turn: float = 20.0) -> mujoco.MjModel:
    """A white square, evenly lit, on black."""
    return scenes.compile_xml(SQUARE.format(turn=turn), more=LIT)


def covered(turn: float, size: int, fine: int = 32) -> np.ndarray:
    """Compute the part of each pixel that the square covers, (size, size), by brute force."""
    rays = scenes.pixel_rays(size * fine, size * fine, 60.0)
    x, y = (rays[..., k] * (2.0 - 0.01) for k in (0, 1))
    angle = turn * scenes.DEGREE
    a, b = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    inside = (np.abs(a) < 0.5) & (np.abs(b) < 0.5)
    return inside.reshape(size, fine, size, fine).mean(axis=(1, 3))


@pytest.mark.parametrize("turn", [3.0, 7.0, 20.0, 45.0])
def test_an_edge_shows_how_much_is_covered(device: wp.Device, turn: float) -> None:
    mjm = square(turn)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    plain, smooth = (scenes.look(scene, camera(samples))["rgb"][0, ..., 0] / 255.0 for samples in (1, 4))
    truth = covered(turn, 32)
    assert set(np.unique(plain)) == {0.0, 1.0}
    assert np.abs(smooth - truth).mean() < 0.5 * np.abs(plain - truth).mean()
    assert np.abs(smooth - truth).max() < 0.4
    quarters = 4.0 * smooth
    assert np.abs(quarters - np.rint(quarters)).max() < 0.02


def test_samples_lie_where_the_views_say(device: wp.Device) -> None:
    """The mean of the samples is the mean of four images whose principal point is moved the other way."""
    mjm = square()
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    smooth = scenes.look(scene, camera(4))["rgb"][0].astype(np.float64)
    renderer = wc.Renderer(scene, [camera(1)])
    width = 2.0 * np.tan(30.0 * scenes.DEGREE) * 1.99 / 32.0  # of a pixel on the square [m]
    total = np.zeros_like(smooth)
    for right, down in SAMPLES[4]:
        renderer.camera("eye").position[0] = torch.tensor((right * width, -down * width, 2.0))
        total += renderer.render()["eye"]["rgb"][0].cpu().numpy()
    assert np.abs(smooth - total / 4.0).max() <= 1.0


def mean_of_samples(scene: wc.Scene) -> np.ndarray:
    """Return the mean of four images whose principal point is moved to the samples, (size, size, 3)."""
    focal = 16.0 / np.tan(30.0 * scenes.DEGREE)
    lenses = [wc.Pinhole(fx=focal, cx=16.0 - right, cy=16.0 - down) for right, down in SAMPLES[4]]
    return np.mean([scenes.look(scene, camera(1, lens=lens))["rgb"][0] for lens in lenses], axis=0)


def test_what_covers_most_of_a_pixel_has_edges(device: wp.Device) -> None:
    """Edges are those of transparent shapes, and with other shapes those of what lies behind them."""
    under = '<geom type="box" size="0.3 0.3 0.01" pos="0.2 0.1 -0.02" euler="0 0 50" rgba="0 1 0 1"/>'
    for alpha in (0.1, 0.5, 0.9):
        mjm = scenes.compile_xml(SQUARE.format(turn=20).replace("1 1 1 1", f"1 1 1 {alpha}") + under, more=LIT)
        scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
        plain, smooth = (scenes.look(scene, camera(samples))["rgb"][0].astype(float) for samples in (1, 4))
        truth = mean_of_samples(scene)
        before, off = (np.square(image - truth).mean(axis=(0, 1)) for image in (plain, smooth))
        # the square is all of what is red, most of what is green is what lies behind
        channel = 1 if alpha < 0.3 else 0
        assert off[channel] < 0.2 * before[channel]


def test_a_sample_has_the_colour_of_its_face(device: wp.Device) -> None:
    """Two faces of a mesh meet at about the same depth; each sample is lit as its own face is turned."""
    corners = [(x, y, z) for y, z in ((-0.6, -0.6), (0.0, 0.0), (0.6, -0.6)) for x in (-0.7, 0.7)]
    roof = " ".join(str(number) for corner in corners for number in corner)
    mjm = scenes.compile_xml(
        '<geom type="mesh" mesh="roof" euler="0 0 23" rgba="1 1 1 1"/><light directional="true" dir="0.5 1 -1"/>',
        assets=f'<mesh name="roof" vertex="{roof}" face="0 1 3 0 3 2 2 3 5 2 5 4" inertia="shell"/>',
        more='<visual><headlight ambient="0.1 0.1 0.1" diffuse="0 0 0" specular="0 0 0"/></visual>',
    )
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    smooth, plain = (scenes.look(scene, camera(samples))["rgb"][0].astype(float) for samples in (4, 1))
    off, before = (np.square(image - mean_of_samples(scene)) for image in (smooth, plain))
    assert off.mean() < 0.001 * before.mean()


def level(depth: np.ndarray, pinhole: bool) -> np.ndarray:
    """Evaluate a function that is linear in the image of a plane."""
    with np.errstate(divide="ignore"):
        return 1.0 / depth if pinhole else depth


# Of native/antialiasing/edge_test.h.
COLOR_TOLERANCE, TOLERANCE_WITHIN, TOLERANCE_OF_SIDES, NORMAL_WEIGHT = 12, 24, 32, 2.0


def edges_of(
    depth: np.ndarray, shape: np.ndarray, rgb: np.ndarray, sided: np.ndarray, width: float, pinhole: bool
) -> np.ndarray:
    """Return which samples of each pixel are to be traced, (size, size, 4): ``width`` is a pixel's.

    All of a bent surface. If another shape is beside the pixel, those in whose triangle of pixels it is. But only where
    the colours of the pixels that a sample lies among differ from its own. Beside another shape also those in whose
    triangle there is none, if its colours differ by more, of shapes that have sides.
    """
    edges = np.zeros((*shape.shape, 4), bool)
    last = len(shape) - 1
    for i, j in np.ndindex(*shape.shape):
        rows = [[(i - 1, j), (i, j), (i + 1, j)], [(i, j - 1), (i, j), (i, j + 1)]]
        whole = [row for row in rows if all(0 <= min(at) and max(at) <= last for at in row)]
        if any(shape[np.clip(at, 0, last)[0], np.clip(at, 0, last)[1]] != shape[i, j] for row in rows for at in row):
            for k, (right, down) in enumerate(SAMPLES[4]):
                across = np.clip((i + np.sign(down), j + np.sign(right)), 0, last).astype(int)
                beside = (across[0], j) if abs(down) > abs(right) else (i, across[1])
                edges[i, j, k] = any(shape[at] != shape[i, j] for at in (beside, tuple(across)))
        elif shape[i, j] >= 0:
            for row in whole:
                before, here, after = (level(depth[at], pinhole) for at in row)
                edges[i, j] |= abs((before + after - 2.0 * here) / (here if pinhole else 1.0)) > width
        beside_another = any(shape[tuple(np.clip(at, 0, last))] != shape[i, j] for row in rows for at in row)
        for k, (right, down) in enumerate(SAMPLES[4]):
            y, x = np.clip((i + np.sign(down), j + np.sign(right)), 0, last).astype(int)
            differences = [np.abs(rgb[at].astype(int) - rgb[i, j]).max() for at in ((y, j), (i, x), (y, x))]
            edges[i, j, k] &= max(differences) > (COLOR_TOLERANCE if beside_another else TOLERANCE_WITHIN)
            lies_in = [(y, x), (y, j) if abs(down) > abs(right) else (i, x)]
            if (
                beside_another
                and shape[i, j] >= 0
                and sided[shape[i, j]]
                and all(shape[at] == shape[i, j] for at in lies_in)
            ):
                edges[i, j, k] |= any(
                    np.abs(rgb[at].astype(int) - rgb[i, j]).max() > TOLERANCE_OF_SIDES for at in lies_in
                )
    return edges


DEPTH_WEIGHT = 8.0  # of native/antialiasing/edge_test.h


def shown_pixel(
    at: tuple[int, int],
    offset: tuple[float, float],
    hit: tuple[float, int, np.ndarray],
    plain: dict[str, np.ndarray],
    normal_cost: Callable[[int, np.ndarray, np.ndarray], float],
    sided: np.ndarray,
    width: float,
    pinhole: bool,
) -> tuple[int, int]:
    """Whose colour a sample has: of all nine pixels around, every one tried that has a colour of its own."""
    depth, shape, rgb = plain["depth"].astype(float), plain["segmentation"], plain["rgb"].astype(int)

    def aside(one: tuple[int, int]) -> float:
        return (one[0] - at[0] - offset[1]) ** 2 + (one[1] - at[1] - offset[0]) ** 2

    def cost_of(one: tuple[int, int]) -> float:
        apart = abs(depth[one] - hit[0]) / (DEPTH_WEIGHT * width * (hit[0] if pinhole else 1.0))
        return aside(one) + apart + NORMAL_WEIGHT * normal_cost(hit[1], plain["normals"][one], hit[2])

    around = itertools.product(*(range(max(c - 1, 0), min(c + 2, len(shape))) for c in at))
    alike = sorted((one for one in around if shape[one] == hit[1]), key=aside)
    if hit[1] < 0 or not sided[hit[1]]:
        return alike[0] if alike else at
    chosen = None
    for one in alike:
        if chosen is None or (
            np.abs(rgb[one] - rgb[chosen]).max() > COLOR_TOLERANCE and cost_of(one) < cost_of(chosen)
        ):
            chosen = one
    return chosen or at


EVERY_TYPE = "".join(
    scenes.geom_xml(kind, more=f'pos="{0.9 * (k % 3) - 0.9} {0.9 * (k // 3) - 0.9} 0" euler="20 30 40"')
    for k, kind in enumerate(scenes.TYPES)
)
SOLIDS = "".join(
    f'<geom type="{kind}" size="{" ".join(map(str, scenes.SIZES[kind]))}" euler="20 30 {40 + 10 * k}" '
    f'pos="{0.9 * (k % 3) - 0.9} {0.9 * (k // 3) - 0.9} 0"/>'
    for k, kind in enumerate(
        ("sphere", "box", "capsule", "cylinder", "ellipsoid", "box", "cylinder", "box", "cylinder")
    )
)


def spheres(across: int) -> str:
    """Build rows of spheres that touch each other, as many rows as spheres; more than 127 have ids of two bytes."""
    size = 3.4 / across
    return "".join(
        f'<geom type="sphere" size="{0.6 * size}" '
        f'pos="{size * (k % across) - 1.7} {size * (k // across) - 1.7} {0.01 * (k % 7)}"/>'
        for k in range(across * across)
    )


@pytest.mark.parametrize("pinhole", [True, False])
@pytest.mark.parametrize(
    "world", [EVERY_TYPE, SOLIDS, spheres(11), spheres(17)], ids=["every type", "solids", "121", "289"]
)
def test_every_pixel_is_as_by_brute_force(device: wp.Device, world: str, pinhole: bool) -> None:
    size, focal, height = 32, 28.0, 4.2
    mjm = scenes.compile_xml(world, assets=scenes.ASSETS)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    width = 1.0 / focal if pinhole else height / size

    def look(right: float, down: float, samples: int = 1) -> dict[str, np.ndarray]:
        settings: dict[str, object] = {
            "position": (0.0, 0.0, 3.5),
            "outputs": ("rgb", "depth", "segmentation", "normals"),
        }
        if pinhole:
            settings["lens"] = wc.Pinhole(fx=focal, cx=0.5 * size - right, cy=0.5 * size - down)
        else:
            settings |= {"lens": wc.Orthographic(height=height), "position": (right * width, -down * width, 3.5)}
        return {name: image[0] for name, image in scenes.look(scene, camera(samples, **settings)).items()}

    smooth, plain = look(0.0, 0.0, 4)["rgb"].astype(int), look(0.0, 0.0)
    samples = [look(*offset) for offset in SAMPLES[4]]
    depth, shape = plain["depth"].astype(float), plain["segmentation"]
    expected = plain["rgb"].astype(float)
    kinds = [mujoco.mjtGeom(kind) for kind in mjm.geom_type]
    axes = scenes.forward(mjm).geom_xmat.reshape(-1, 3, 3)[..., 2]

    def normal_cost(number: int, one: np.ndarray, other: np.ndarray) -> float:
        if kinds[number] == mujoco.mjtGeom.mjGEOM_MESH:
            return 1.0 - one @ other
        if kinds[number] == mujoco.mjtGeom.mjGEOM_CYLINDER:
            return float((abs(axes[number] @ one) > 0.5) != (abs(axes[number] @ other) > 0.5))
        return float(kinds[number] == mujoco.mjtGeom.mjGEOM_BOX and one @ other < 0.5)

    sided = np.isin(mjm.geom_type, [getattr(mujoco.mjtGeom, f"mjGEOM_{name}") for name in ("MESH", "BOX", "CYLINDER")])
    bent = sided | (mjm.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)
    tried, hidden = 0, np.zeros((size, size), bool)
    traced = edges_of(depth, shape, plain["rgb"], sided, width, pinhole)
    for at in zip(*np.nonzero(traced.any(-1)), strict=True):
        around = shape[tuple(slice(max(c - 1, 0), c + 2) for c in at)]
        hits = [(sample["depth"][at], sample["segmentation"][at], sample["normals"][at]) for sample in samples]
        # of what lies between the centres of all pixels around samples see what is behind
        hidden[at] = any(number not in around for _, number, _ in hits)
        chosen = [
            shown_pixel(at, offset, hit, plain, normal_cost, bent, width, pinhole) if needed else at
            for offset, hit, needed in zip(SAMPLES[4], hits, traced[at], strict=True)
        ]
        expected[at] = np.mean([plain["rgb"][one] for one in chosen], axis=0)
        tried += 1
    assert tried > 0.1 * size * size and hidden.sum() < 0.1 * tried
    off = np.abs(smooth - np.floor(expected + 0.5)).max(-1)[~hidden]
    # where two pixels tie, or a ray ends at a silhouette, rounding decides
    assert (off > 0).mean() < 0.004, f"{(off > 0).sum()} pixels of {tried} with edges differ"


@pytest.mark.parametrize(("levels", "smoothed"), [(COLOR_TOLERANCE - 2, False), (COLOR_TOLERANCE + 3, True)])
@pytest.mark.parametrize("output", ["rgb", "rgba", "hdr"])
def test_faint_edges_are_left(device: wp.Device, levels: int, smoothed: bool, output: str) -> None:
    """Nothing is traced if colours differ by few levels: a mean is then off by no more than half of them."""
    grey, other = 0.4, 0.4 + levels / 255.0
    mjm = scenes.compile_xml(
        f'<geom type="box" size="9 9 0.01" pos="0 0 -0.02" rgba="{grey} {grey} {grey} 1"/>'
        + SQUARE.format(turn=20).replace("1 1 1 1", f"{other} {other} {other} 1"),
        more=LIT,
    )
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    plain, smooth = (scenes.look(scene, camera(samples, outputs=(output,)))[output][0] for samples in (1, 4))
    plain_levels, smooth_levels = (len(np.unique(np.round(image[..., 0], 4))) for image in (plain, smooth))
    assert plain_levels == 2
    assert (smooth_levels > 2) == smoothed


@pytest.mark.parametrize(("turn", "height"), [(45.0, 1.0), (20.0, 0.8), (0.0, 0.92)])
def test_edges_run_out_of_the_image(device: wp.Device, turn: float, height: float) -> None:
    """Over all four borders, or along them: what lies outside is never asked for its colour."""
    mjm = square(turn)
    for side in (32, 37):
        with wp.ScopedDevice(device):
            scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 3))
            view = {"position": (0.0, 0.0, height), "width": side, "height": side}
            rgb, rgba, hdr = (
                scenes.look(scene, camera(4, outputs=(name,), **view))[name] for name in ("rgb", "rgba", "hdr")
            )
        assert np.array_equal(rgb, rgba[..., :3])
        assert np.abs(rgb - 255.0 * hdr).max() <= 1.0
        assert (rgb == rgb[:1]).all() and len(np.unique(rgb)) > (2 if turn else 1)


def test_all_else_is_of_the_centre(device: wp.Device) -> None:
    mjm = scenes.compile_xml(EVERY_TYPE, assets=scenes.ASSETS)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    outputs = ("rgb", "rgba", "hdr", "depth", "segmentation", "normals", "albedo", "points")
    plain, smooth = (
        scenes.look(scene, camera(samples, outputs=outputs, position=(0.0, 0.0, 3.5), shadows=True))
        for samples in (1, 4)
    )
    for name in outputs:
        same = np.array_equal(plain[name], smooth[name])
        assert same == (name not in ("rgb", "rgba", "hdr")), name
    inside = np.ones((32, 32), bool)
    ids = plain["segmentation"][0]
    for axis in (0, 1):
        inside &= (np.roll(ids, 1, axis) == ids) & (np.roll(ids, -1, axis) == ids)
    assert (plain["rgb"][0] == smooth["rgb"][0]).all(-1)[inside].mean() > 0.8
    assert np.array_equal(smooth["rgb"][..., :3], smooth["rgba"][..., :3])
    assert np.abs(smooth["rgb"] / 255.0 - np.clip(smooth["hdr"], 0.0, 1.0)).mean() < 0.01


def test_worlds_keep_their_own_edges(device: wp.Device) -> None:
    """Many worlds are as one by one, also where only some are drawn."""
    mjm = square()
    turned = []
    for turn in (0.0, 10.0, 30.0):
        mjd = scenes.forward(mjm)
        mujoco.mju_euler2Quat(mjm.geom_quat[0], (0.0, 0.0, turn * scenes.DEGREE), "xyz")
        mujoco.mj_forward(mjm, mjd)
        turned.append(mjd)
    alone = [scenes.look(wc.from_mujoco(mjm, mjd, device=device), camera(4))["rgb"][0] for mjd in turned]
    renderer = wc.Renderer(wc.from_mujoco(mjm, turned, device=device), [camera(4)])
    together = renderer.render()["eye"]["rgb"].cpu().numpy().copy()
    assert all(np.array_equal(one, image) for one, image in zip(alone, together, strict=True))
    for mjd in turned:
        mjd.geom_xpos[0] = (0.2, 0.0, 0.0)
    some = renderer.render(worlds=[1])["eye"]["rgb"].cpu().numpy()
    assert np.array_equal(some[0], together[0]) and np.array_equal(some[2], together[2])
    assert not np.array_equal(some[1], together[1])


@pytest.mark.parametrize("world", [SOLIDS, spheres(11)], ids=["solids", "121"])
def test_images_are_the_same_in_parts_of_any_size(device: wp.Device, world: str) -> None:
    """With few worlds GPU blocks draw small regions, with many large ones, which show more shapes than fit."""
    mjm = scenes.compile_xml(world)
    with wp.ScopedDevice(device):
        alone, *others = (
            scenes.look(
                wc.from_mujoco_warp(mjm, *scenes.put(mjm, worlds)),
                camera(4, position=(0.0, 0.0, 3.5), outputs=("rgb", "hdr"), width=side, height=side),
            )
            for side in (32, 45)
            for worlds in (1, 2, 10 * device.sm_count if device.is_cuda else 3)
        )
    for one, other in ((alone, others[0]), (alone, others[1]), (others[2], others[3]), (others[2], others[4])):
        assert (one["rgb"] == other["rgb"]).all()
        assert np.abs(one["hdr"] - other["hdr"]).max() < 1.0e-5  # lit by other kernels


def test_frames_are_the_same_again(device: wp.Device) -> None:
    """Rays of a GPU's warp test faces for each other, in an order that differs from frame to frame."""
    turns, rows = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False), np.linspace(0.02, np.pi - 0.02, 40))
    out = 0.5 + 0.04 * np.sin(9.0 * turns) * np.sin(11.0 * rows)
    points = np.stack([np.cos(turns) * np.sin(rows), np.sin(turns) * np.sin(rows), np.cos(rows)], -1) * out[..., None]
    number = np.arange(turns.size).reshape(turns.shape)
    beside = np.roll(number, -1, axis=1)
    upper = np.stack([number[:-1], number[1:], beside[:-1]], -1)
    lower = np.stack([beside[:-1], number[1:], beside[1:]], -1)
    faces = np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])
    words = [" ".join(map(str, np.round(one.ravel(), 6))) for one in (points, faces)]
    balls = "".join(
        f'<geom type="mesh" mesh="bumps" pos="{0.35 * k - 0.7} {0.3 * (k % 3) - 0.3} {0.1 * (k % 2)}" '
        f'rgba="{0.2 * k} 1 {1.0 - 0.2 * k} 1"/>'
        for k in range(5)
    )
    mjm = scenes.compile_xml(balls, assets=f'<mesh name="bumps" vertex="{words[0]}" face="{words[1]}"/>')
    with wp.ScopedDevice(device):
        scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 256 if device.is_cuda else 1))
        renderer = wc.Renderer(scene, [camera(4, position=(0.0, 0.0, 3.0), width=64, height=64)])
        first, *others = (renderer.render()["eye"]["rgb"].cpu().numpy().copy() for _ in range(4))
    assert (first == first[:1]).all() and all(np.array_equal(first, other) for other in others)


@pytest.mark.parametrize("samples", [0, 2, 3, 32, True, None, "4"])
def test_other_numbers_are_refused(samples: object) -> None:
    with pytest.raises(wc.WarpcamError, match=r"antialiasing is .*; allowed are 1, 4"):
        camera(samples)  # type: ignore[arg-type]
