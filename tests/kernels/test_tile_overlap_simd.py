"""Whole tiles and whole nodes on a CPU, against parts of them."""

import numpy as np
import warp as wp
from native_kernel import native_kernel
from scenes import ASSETS, TYPES, compile_xml, forward, geom_xml, look, looking, own_camera

import warpcam as wc


@wp.func_native("""
    using namespace warpcam;
    Int4 numbers;
    for (int k = 0; k < 4; ++k)
        numbers[k] = wp::index(given, 4 * i + k);
    const Int4 order = sorted4(numbers), picked = pick4(Int4 { 10, 20, 30, 40 }, order);
    for (int k = 0; k < 4; ++k) {
        wp::index(ordered, 4 * i + k) = order[k];
        wp::index(chosen, 4 * i + k) = picked[k];
    }
""")
def sort_four(
    given: wp.array(dtype=wp.int32), i: wp.int32, ordered: wp.array(dtype=wp.int32), chosen: wp.array(dtype=wp.int32)
): ...


@native_kernel("accel/bvh4_simd.h")
def sort_fours(given: wp.array(dtype=wp.int32), ordered: wp.array(dtype=wp.int32), chosen: wp.array(dtype=wp.int32)):
    sort_four(given, wp.tid(), ordered, chosen)


def test_children_wait_in_their_order():
    """The farthest lowest, those that are missed, -1, behind all; a key's two lowest bits name the child."""
    random = np.random.default_rng(0)
    keys = random.integers(0, 2**28, (512, 4), dtype=np.int32) << 2 | random.permuted(
        np.tile(np.arange(4), (512, 1)), axis=1
    )
    keys[random.uniform(size=keys.shape) < 0.4] = -1
    ordered, chosen = (wp.zeros(keys.size, dtype=wp.int32, device="cpu") for _ in range(2))
    given = wp.array(keys.astype(np.int32).ravel(), dtype=wp.int32, device="cpu")
    wp.launch(sort_fours, len(keys), [given, ordered, chosen], device="cpu")
    expected = -np.sort(-keys, axis=1)
    np.testing.assert_array_equal(ordered.numpy().reshape(keys.shape), expected)
    np.testing.assert_array_equal(chosen.numpy().reshape(keys.shape), 10 * (1 + (expected & 3)))


def test_tiles_at_the_edge_are_as_those_inside(device: wp.Device) -> None:
    """A smaller image is the corner of a larger one, whose tiles are not cut off there."""
    shapes = "".join(
        f'<body pos="{1.3 * (k % 4) - 2} {1.3 * (k // 4) - 1} {0.3 * (k % 3)}">{geom_xml(kind)}</body>'
        for k, kind in enumerate(kind for kind in TYPES if kind not in ("plane", "hfield"))
    )
    floor = '<geom type="plane" size="0 0 1" pos="0 0 -1"/><light pos="1 -1 5" dir="-.2 .2 -1"/>'
    mjm = compile_xml(floor + shapes, assets=ASSETS)
    scene = wc.from_mujoco(mjm, forward(mjm), device=device)
    position = (0.5, -4.0, 4.0)
    pose = {"position": position, "rotation": looking(position, (0.0, 0.3, 0.0))}
    outputs = ("depth", "distance", "segmentation", "normals", "rgb")

    def seen(width: int, height: int) -> dict[str, np.ndarray]:
        lens = wc.Pinhole(fx=34.0, cx=20.0, cy=14.0)
        settings = {"width": width, "height": height, "outputs": outputs, "shadows": True}
        return look(scene, own_camera(lens=lens, **settings, **pose))

    whole, part = seen(40, 28), seen(37, 26)
    assert len(np.unique(whole["segmentation"])) > 6
    for name, image in part.items():
        np.testing.assert_allclose(image, whole[name][:, :26, :37], rtol=0, atol=1 if name == "rgb" else 0)
