"""Memory: only for what was asked for, told before it is taken, and shared between cameras and groups of worlds."""

import functools
import gc
from pathlib import Path
from types import SimpleNamespace

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp
from allocation_ledger import Ledger
from scratch import scratch_of
from small_scene import GLASS, MIRROR, camera, scene_of

import warpcam as wc
from warpcam.kernels.plan import launches
from warpcam.kernels.runtime.flatten import flatten
from warpcam.outputs import OUTPUTS
from warpcam.render import memory, scratch_memory

CAMERAS_MORE = '<camera name="left" pos="-4 0 1"/><camera name="right" pos="4 0 1"/>'
DOCS = Path(__file__).resolve().parents[2] / "docs" / "memory.md"
LIT = {"rgb", "rgba", "hdr"}
RAYS = np.ones((16, 16, 3))
FACED = {*LIT, "normals", "albedo", "faces", "barycentrics"}
FLOWS = {"flow", "flow_valid"}
TRACED = {"depth", "segmentation", "distance", "points", "bodies", "instances", "semantics", *FLOWS}


one_scene_of = functools.cache(scene_of)  # for tests that only ask what it would take


def scratch_by_the_docs(device: wp.Device, num_worlds: int, cameras: list[wc.Camera], layers: str = "") -> float:
    """The formula of docs/memory.md, for a scene of meshes and lights with at most 127 shapes."""
    shape, face = (1, 2) if device.is_cuda else (4, 4)
    images, largest = 0, 0.0
    for each in cameras:
        for name in each.outputs:
            bytes_a_pixel = OUTPUTS[name].channels * (1 if OUTPUTS[name].dtype is wp.uint8 else 4)
            images += num_worlds * each.width * each.height * bytes_a_pixel
    bound, all_fit = max(images // 2, 32 * 2**20), 40 * 2**20 if images // 2 <= 32 * 2**20 else 0
    for each in cameras:
        outputs, buffers = set(each.outputs), []  # bytes a pixel of each
        if outputs - TRACED:
            apart = GLASS in layers and bool(outputs & LIT)
            buffers += [4] * (apart or "depth" not in outputs) + [shape] * (apart or "segmentation" not in outputs)
            buffers += [4, shape, face] * (MIRROR in layers and bool(outputs & LIT))
            buffers += [face] * bool(outputs & FACED) + [1] * (each.shadows and bool(outputs & LIT))
        one, every = (
            sum(-(-worlds * each.width * each.height * size // 256) * 256 for size in buffers)
            for worlds in (1, num_worlds)
        )
        largest = max(largest, every if every <= all_fit else min(every, max(bound, one)))
    return largest


def past_by_the_docs(num_worlds: int, num_shapes: int, cameras: list[wc.Camera]) -> int:
    """Compute the history's memory for scenes with meshes none of which moves."""
    asking = [each for each in cameras if FLOWS & set(each.outputs)]
    pixels = sum(-(-each.width // 8) * 8 * each.height for each in asking if "flow_valid" in each.outputs)
    shapes = num_shapes * (64 * bool(asking) + 64 * len(asking))
    return num_worlds * (8 * pixels + shapes + 76 * len(asking) + bool(asking))


SETS = (
    ("depth", "segmentation"),
    ("rgb",),
    ("rgb", "depth"),
    ("normals",),
    ("distance",),
    ("bodies",),
    ("instances", "semantics"),
    ("flow", "flow_valid"),
    tuple(OUTPUTS),
)


@pytest.mark.parametrize("shadows", [False, True])
@pytest.mark.parametrize("outputs", SETS, ids="+".join)
@pytest.mark.parametrize(("num_worlds", "width"), [(2, 24), (1000, 64), (8192, 64), (301, 512), (4, 2048)])
def test_scratch_follows_the_formula(
    num_worlds: int, width: int, outputs: tuple[str, ...], shadows: bool, device: wp.Device
) -> None:
    scene = one_scene_of(device.alias, num_worlds)
    cameras = [
        camera(width=width, height=width, outputs=outputs, shadows=shadows),
        camera("side", width=width, height=48, outputs=("segmentation",)),
    ]
    told = wc.estimate_memory(scene, cameras)
    assert told.scratch == scratch_by_the_docs(device, num_worlds, cameras)
    assert told.past == past_by_the_docs(num_worlds, 3, cameras)
    images = sum(sum(each.values()) for each in told.images.values())
    if images > 2 * scratch_memory.ALWAYS_ALLOWED:
        one_world = (9 if device.is_cuda else 14) * width * width  # which has room whatever the images take
        assert told.total <= images + max(0.5 * images, one_world) + told.past + num_worlds * 1000


@pytest.mark.parametrize("layers", [MIRROR, GLASS, MIRROR + GLASS], ids=["mirror", "glass", "both"])
@pytest.mark.parametrize("outputs", [("depth",), ("rgb",), ("rgb", "depth"), tuple(OUTPUTS)], ids="+".join)
def test_scratch_of_layers_follows_the_formula(outputs: tuple[str, ...], layers: str, device: wp.Device) -> None:
    for num_worlds, width in ((2, 24), (8192, 64)):
        scene = one_scene_of(device.alias, num_worlds, layers)
        cameras = [camera(width=width, height=width, outputs=outputs, shadows=True)]
        told = wc.estimate_memory(scene, cameras)
        assert told.scratch == scratch_by_the_docs(device, num_worlds, cameras, layers)
        lit = bool(set(outputs) & LIT)
        assert told.worlds == num_worlds * (10 + 84 + 124 * (MIRROR in layers and lit))


def test_what_a_camera_has_of_its_own_follows_the_formula() -> None:
    own = {"position": (0, 0, 4), "lens": wc.Pinhole(fovy=50.0)}
    for options, once, each in (
        ({}, 0, 0),
        (own, 0, 28 + 4),
        (own | {"lens": wc.Pinhole(fx=30.0)}, 0, 28 + 16),
        ({"exposure": 0.0}, 0, 16),
        ({"gain": 1.0}, 0, 16),
        (own | {"exposure": 0.0, "gain": 1.0, "background": np.zeros((3, 3))}, 4, 28 + 4 + 16 + 12),
        ({"lens": wc.Fisheye(fovy=90.0)}, 16 * 16 * 8 + 2 * 4 * 16 + 16, 0),
        ({"lens": wc.Rays(RAYS, origins=RAYS)}, 16 * 16 * 32 + 2 * 4 * 32 + 32, 0),
        ({"lens": wc.Rays(RAYS, origins=np.stack([RAYS] * 3))}, 0, 16 * 16 * 32 + 2 * 4 * 32 + 32),
    ):
        told = wc.estimate_memory(scene_of("cpu", 3), [camera(width=16, height=16, **options)])
        assert told.worlds == 3 * (10 + 84 + each) + once, options


def test_images_take_their_shape_times_their_type() -> None:
    scene = scene_of("cpu", 3)
    told = wc.estimate_memory(scene, [camera(outputs=tuple(OUTPUTS))])
    tensors = wc.Renderer(scene, [camera(outputs=tuple(OUTPUTS))]).images["top"]
    assert told.images == {"top": {name: tensor.nbytes for name, tensor in tensors.items()}}


CAMERAS = {
    "depth": [{"outputs": ("depth",)}],
    "rgb": [{"outputs": ("rgb",), "shadows": True}],
    "two": [
        {"outputs": ("rgb", "segmentation"), "lens": wc.Pinhole(fx=30.0)},
        {"name": "side", "outputs": ("normals", "albedo"), "width": 50},
    ],
    "flow": [
        {"outputs": ("flow",), "lens": wc.Pinhole(fx=30.0)},
        {"name": "side", "outputs": ("flow", "flow_valid"), "width": 50},
    ],
    "own": [
        {"outputs": tuple(OUTPUTS), "position": (0, 0, 4), "lens": wc.Pinhole(fovy=50.0), "parent": 1, "shadows": True},
        {"name": "plain", "lens": wc.Orthographic(height=3.0), "position": (0, 0, 4)},
    ],
    "exposed": [
        {"exposure": 0.5, "background": np.zeros((40, 3))},
        {"name": "side", "gain": 2.0, "background": np.ones((40, 3)), "lens": wc.Fisheye(fovy=120.0)},
    ],
    "finer": [
        {"antialiasing": 16, "outputs": ("rgb", "hdr", "depth"), "shadows": True},
        {"name": "side", "antialiasing": 8, "lens": wc.Fisheye(fovy=120.0)},
    ],
    "not all bodies": [
        {"exclude_bodies": 1, "outputs": ("rgb", "flow")},
        {"name": "side", "exclude_bodies": (1, 2), "outputs": ("depth",)},
    ],
}


@pytest.mark.parametrize("layers", ["", MIRROR + GLASS], ids=["one layer", "more"])
@pytest.mark.parametrize("which", CAMERAS)
def test_what_is_told_is_what_is_allocated(
    which: str, layers: str, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_ledger(scene_of(device, 40, layers), [camera(**options) for options in CAMERAS[which]], device, monkeypatch)


@pytest.mark.parametrize("outputs", [("depth",), ("flow",), ("flow", "flow_valid"), ("depth", "normals")], ids="+".join)
def test_what_is_told_is_what_is_allocated_where_shapes_are_listed_ahead(
    outputs: tuple[str, ...], device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    mjm = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><camera name="top" pos="0 0 5"/><geom size=".6"/><geom type="plane" size="3 3 1"/>'
        "</worldbody></mujoco>"
    )
    with wp.ScopedDevice(device):
        scene = wc.from_mujoco_warp(mjm, mjw.put_model(mjm), mjw.put_data(mjm, mujoco.MjData(mjm), nworld=40))
    told = check_ledger(scene, [camera(width=16, height=8, outputs=outputs)], device, monkeypatch)
    lists = 1568 + 320 * ("normals" in outputs)
    assert told.worlds == 40 * (10 + 84 + lists * device.is_cuda)


def check_ledger(
    scene: wc.Scene, cameras: list[wc.Camera], device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> memory.Memory:
    told = wc.estimate_memory(scene, cameras)
    wc.Renderer(scene, cameras).render()  # what Warp loads once is loaded
    gc.collect()
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    renderer = wc.Renderer(scene, cameras)
    gc.collect()
    assert ledger.held == told.total == renderer.memory.total
    renderer.render()
    renderer.render(worlds=[1])
    gc.collect()
    assert ledger.held == told.total
    return told


def test_the_table_names_every_image_and_the_total() -> None:
    told = wc.estimate_memory(scene_of("cpu", 2), [camera(outputs=("rgb", "depth"))])
    text = str(told)
    assert "'top' rgb" in text
    assert "'top' depth" in text
    assert f"{told.total / 1e6:,.3f} MB" in text.splitlines()[-1]


def test_the_table_of_the_docs_is_what_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its numbers are those of a GPU."""
    id_dtypes, card = launches.id_dtypes, SimpleNamespace(is_cuda=True)
    monkeypatch.setattr(launches, "id_dtypes", lambda tables, device: id_dtypes(tables, card))
    scene, four = one_scene_of("cpu", 8192, CAMERAS_MORE), ("top", "side", "left", "right")
    both = ("rgb", "depth")
    asked = [
        [camera(width=64, height=64, outputs=("depth", "segmentation"))],
        [camera(width=64, height=64)],
        [camera(width=64, height=64, shadows=True)],
        [camera(width=64, height=64, outputs=both, shadows=True)],
        [camera(name, 64, 64, outputs=both, shadows=True) for name in four],
        [camera(width=64, height=64, outputs=("depth", "segmentation", "normals"))],
    ]
    table = DOCS.read_text().split("| 8192 worlds with meshes")[1].splitlines()[2:]
    for cameras, row in zip(asked, table[: len(asked)], strict=True):  # the last row is aloha's
        told = wc.estimate_memory(scene, cameras)
        images = sum(sum(each.values()) for each in told.images.values())
        assert row.split(" | ")[1:] == [
            f"{number / 1e6:,.0f} MB{end}" for number, end in ((images, ""), (told.scratch, ""), (told.total, " |"))
        ], row


def test_more_than_is_free_is_an_error_before_anything_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of("cpu", 2)
    needed = wc.estimate_memory(scene, [camera()]).total
    monkeypatch.setattr(memory, "free_bytes", lambda device: needed - 1)
    ledger = Ledger(scene.device.default_allocator)
    monkeypatch.setattr(scene.device, "default_allocator", ledger)
    with pytest.raises(wc.WarpcamError, match=f"{needed:,} bytes are needed, {needed - 1:,} are free on cpu"):
        wc.Renderer(scene, [camera()])
    assert ledger.held == 0
    monkeypatch.setattr(memory, "free_bytes", lambda device: needed)
    wc.Renderer(scene, [camera()])


def test_scratch_of_more_bytes_than_a_dimension_counts() -> None:
    scene = one_scene_of("cpu", 2)
    large = camera(width=20000, height=20000, outputs=("hdr", "normals", "points"))
    block = scratch_of({"large": large}, scene.tables(), scene.device)
    assert block.size > 2**31
    block.allocate()  # never written to: nothing is taken but addresses
    places = [each.buffers["buffer face"] for phase in block.phases(None) for each in phase]
    assert len(places) == 1 and places[0].shape == (2, 20000, 20000, 1)


def test_images_of_more_numbers_than_a_dimension_counts() -> None:
    """Images begin where they are, and have a number for each pixel."""
    here = wp.zeros(1, dtype=wp.uint8, device="cpu")
    large = wp.array(ptr=here.ptr, shape=(2**14, 2**8, 2**8, 3), dtype=wp.uint8, device="cpu")
    small = wp.zeros((2, 3, 4, 3), dtype=wp.float32, device="cpu")
    assert flatten(large).ptr == here.ptr and flatten(large).shape == (2**30,)
    assert flatten(small).ptr == small.ptr and flatten(small).shape == (72,)


def test_free_memory_is_known(device: wp.Device) -> None:
    free = memory.free_bytes(device)
    assert free is None or free > 2**20


def test_8192_worlds_of_aloha_with_four_cameras_are_told_what_they_take() -> None:
    cases = pytest.importorskip("warpcam.benchmarks.cases")
    problem = pytest.importorskip("warpcam.benchmarks.problem")
    mjm = problem.compile_case(cases.CASES["aloha_pot"])
    with wp.ScopedDevice("cpu"):  # without room for contacts
        m, d = mjw.put_model(mjm), mjw.make_data(mjm, nworld=8192, naconmax=1, naccdmax=1, njmax=1)
    scene = wc.from_mujoco_warp(mjm, m, d, reflections=False, transparency=False)
    for outputs in (("depth", "segmentation"), ("rgb", "depth", "segmentation")):
        cameras = [camera(name, 64, 64, outputs=outputs, shadows=True) for name in cases.ALOHA_CAMERAS]
        told = wc.estimate_memory(scene, cameras)
        images = sum(sum(each.values()) for each in told.images.values())
        assert images == 8192 * 4 * 64 * 64 * (8 + 3 * ("rgb" in outputs))
        assert told.scratch == scratch_by_the_docs(scene.device, 8192, cameras)
        assert told.total == images + told.scratch + 8192 * (10 + 4 * 84)
        assert told.total < 1.5 * images < 3e9  # of the 24e9 bytes and more that a card has
