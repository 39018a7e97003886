"""Memory: only for what was asked for, told before it is taken, and shared between cameras and groups of worlds."""

import functools
import gc
import itertools
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

import warpcam as wc
from warpcam import memory, scratch
from warpcam import renderer as rendering
from warpcam.outputs import OUTPUTS

MODEL = """
<mujoco>
  <asset>
    <material name="mirror" reflectance=".5"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1  1 1 0"/>
  </asset>
  <worldbody>
    <light pos="1 1 4" dir="-1 -1 -4"/>
    <camera name="top" pos="0 0 5" fovy="60"/>
    <camera name="side" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/>
    <body pos="0 0 1"><freejoint/><geom size=".6" rgba="1 0 0 1"/></body>
    <body pos="-1 1 1"><freejoint/><geom type="mesh" mesh="wedge"/></body>
    <geom type="box" size="3 3 .1" pos="0 0 -.5"/>
  </worldbody>
</mujoco>
"""
CAMERAS_MORE = '<camera name="left" pos="-4 0 1"/><camera name="right" pos="4 0 1"/>'
DOCS = Path(__file__).resolve().parents[1] / "docs" / "memory.md"
LIT = {"rgb", "rgba", "hdr"}
FACED = {*LIT, "normals", "albedo"}
FLOWS = {"flow", "flow_valid"}
TRACED = {"depth", "segmentation", "distance", "points", "bodies", "instances", "semantics", *FLOWS}


def scene_of(device: Any, num_worlds: int, more: str = "") -> wc.Scene:
    """The model in worlds whose ball is each at another place."""
    mjm = mujoco.MjModel.from_xml_string(MODEL.replace("</worldbody>", more + "</worldbody>"))
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=num_worlds)
    positions = d.geom_xpos.numpy()
    positions[:, mjm.geom_bodyid.tolist().index(1), 0] += np.linspace(-1.0, 1.0, num_worlds)
    d.geom_xpos.assign(positions)
    return wc.from_mujoco_warp(mjm, m, d)


one_scene_of = functools.cache(scene_of)  # for tests that only ask what it would take


def camera(name: str = "top", width: int = 24, height: int = 20, **options: Any) -> wc.Camera:
    return wc.Camera(name, width=width, height=height, **options)


MIRROR = '<geom type="plane" size="9 9 .1" pos="0 0 -1" material="mirror"/>'
GLASS = '<geom size=".2" pos="1 -1 1" rgba="1 1 1 .5"/>'


def scratch_by_the_docs(num_worlds: int, cameras: list[wc.Camera], layers: str = "") -> float:
    """The formula of docs/memory.md, for a scene of meshes and lights with at most 127 shapes."""
    images, largest = 0, 0.0
    for each in cameras:
        for name in each.outputs:
            bytes_a_pixel = OUTPUTS[name].channels * (1 if OUTPUTS[name].dtype is wp.uint8 else 4)
            images += num_worlds * each.width * each.height * bytes_a_pixel
    bound = max(images // 2, 32 * 2**20)
    for each in cameras:
        outputs, buffers = set(each.outputs), []  # bytes a pixel of each
        if outputs - TRACED:
            apart = GLASS in layers and bool(outputs & LIT)
            buffers += [4] * (apart or "depth" not in outputs) + [1] * (apart or "segmentation" not in outputs)
            buffers += [4, 1, 2] * (MIRROR in layers and bool(outputs & LIT))
            buffers += [2] * bool(outputs & FACED) + [1] * (each.shadows and bool(outputs & LIT))
        one, every = (
            sum(-(-worlds * each.width * each.height * size // 256) * 256 for size in buffers)
            for worlds in (1, num_worlds)
        )
        largest = max(largest, min(every, max(bound, one)))
    return largest


def past_by_the_docs(num_worlds: int, num_shapes: int, cameras: list[wc.Camera]) -> int:
    """The same, for scenes with meshes none of which moves."""
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
    assert told.scratch == scratch_by_the_docs(num_worlds, cameras)
    assert told.past == past_by_the_docs(num_worlds, 3, cameras)
    images = sum(sum(each.values()) for each in told.images.values())
    if images > 2 * scratch.ALWAYS_ALLOWED:
        one_world = 9 * width * width  # which has room whatever the images take
        assert told.total <= images + max(0.5 * images, one_world) + told.past + num_worlds * 1000


@pytest.mark.parametrize("layers", [MIRROR, GLASS, MIRROR + GLASS], ids=["mirror", "glass", "both"])
@pytest.mark.parametrize("outputs", [("depth",), ("rgb",), ("rgb", "depth"), tuple(OUTPUTS)], ids="+".join)
def test_scratch_of_layers_follows_the_formula(outputs: tuple[str, ...], layers: str, device: wp.Device) -> None:
    for num_worlds, width in ((2, 24), (8192, 64)):
        scene = one_scene_of(device.alias, num_worlds, layers)
        cameras = [camera(width=width, height=width, outputs=outputs, shadows=True)]
        told = wc.estimate_memory(scene, cameras)
        assert told.scratch == scratch_by_the_docs(num_worlds, cameras, layers)
        lit = bool(set(outputs) & LIT)
        assert told.worlds == num_worlds * (10 + 84 + 124 * (MIRROR in layers and lit))


def test_images_take_their_shape_times_their_type() -> None:
    scene = scene_of("cpu", 3)
    told = wc.estimate_memory(scene, [camera(outputs=tuple(OUTPUTS))])
    tensors = wc.Renderer(scene, [camera(outputs=tuple(OUTPUTS))]).images["top"]
    assert told.images == {"top": {name: tensor.nbytes for name, tensor in tensors.items()}}


class Ledger:
    """Stands in for a Warp allocator and counts the bytes that are held."""

    def __init__(self, allocator: Any):
        self._allocator = allocator
        self.held = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._allocator, name)

    def allocate(self, size: int) -> int:
        self.held += size
        return int(self._allocator.allocate(size))

    def deallocate(self, pointer: int, size: int) -> None:
        self.held -= size
        self._allocator.deallocate(pointer, size)


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
}


@pytest.mark.parametrize("layers", ["", MIRROR + GLASS], ids=["one layer", "more"])
@pytest.mark.parametrize("which", CAMERAS)
def test_what_is_told_is_what_is_allocated(
    which: str, layers: str, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_of(device, 40, layers)
    cameras = [camera(**options) for options in CAMERAS[which]]
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


def test_the_table_names_every_image_and_the_total() -> None:
    told = wc.estimate_memory(scene_of("cpu", 2), [camera(outputs=("rgb", "depth"))])
    text = str(told)
    assert "'top' rgb" in text
    assert "'top' depth" in text
    assert f"{told.total / 1e6:,.3f} MB" in text.splitlines()[-1]


def test_the_table_of_the_docs_is_what_is_told() -> None:
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


def test_free_memory_is_known(device: wp.Device) -> None:
    free = memory.free_bytes(device)
    assert free is None or free > 2**20


# More shapes than one pass of the trace lists.
CROWD = "".join(f'<geom size=".1" pos="{i % 20 * 0.2 - 1.9} {i // 20 * 0.2 - 1.4} 0"/>' for i in range(280))


@pytest.mark.parametrize("crowd", ["", CROWD, MIRROR + GLASS], ids=["few", "crowd", "layers"])
@pytest.mark.parametrize("outputs", [("rgb",), ("normals", "depth"), ("segmentation",), tuple(OUTPUTS)], ids="+".join)
def test_groups_of_worlds_make_the_same_images(
    outputs: tuple[str, ...], crowd: str, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    num_worlds = 11
    scene = scene_of(device, num_worlds, crowd)
    cameras = [
        camera(outputs=outputs, shadows=True),
        camera("side", width=17, height=9, outputs=("rgb",), shadows=True),
    ]
    whole = wc.Renderer(scene, cameras)
    whole.render()  # the first frame knows no flow
    expected = {key: {n: t.clone() for n, t in images.items()} for key, images in whole.render().items()}
    monkeypatch.setattr(scratch, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
    grouped = wc.Renderer(scene, cameras)
    assert grouped.memory.scratch <= whole.memory.scratch
    if outputs == ("rgb",):
        assert grouped.memory.scratch < whole.memory.scratch / 3
    grouped.render()
    for _ in range(2):
        for key, images in grouped.render().items():
            for name, tensor in images.items():
                np.testing.assert_array_equal(tensor.cpu().numpy(), expected[key][name].cpu().numpy(), err_msg=name)
    for tensor in grouped.images["top"].values():
        tensor.fill_(7)
    grouped.render(worlds=[0, 7])
    for name, tensor in grouped.images["top"].items():
        assert (tensor[1:7] == 7).all()
        np.testing.assert_array_equal(tensor[[0, 7]].cpu().numpy(), expected["top"][name][[0, 7]].cpu().numpy())


class Interleaved(rendering.Frame):
    """Chains that run beside each other, as they may on a GPU: a stage of each in turn, or one chain after another."""

    backwards = False

    def launch(self, stream: wp.Stream | None = None) -> None:
        for chains in self.phases:
            order = chains[::-1] if self.backwards else chains
            turns = order if self.backwards else itertools.zip_longest(*order)
            for stage in itertools.chain(*turns):
                if stage is not None:
                    stage.launch(stream)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("outputs", [("rgb",), ("rgb", "depth", "flow")], ids="+".join)
def test_groups_in_chains_beside_each_other_make_the_same_images(
    outputs: tuple[str, ...], backwards: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_of("cpu", 23, CROWD)
    cameras = [
        camera(outputs=outputs, shadows=True),
        camera("side", width=17, height=9, outputs=("rgb",), shadows=True),
    ]
    whole = wc.Renderer(scene, cameras)
    whole.render()
    expected = {key: {n: t.clone() for n, t in images.items()} for key, images in whole.render().items()}
    monkeypatch.setattr(scratch, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
    monkeypatch.setattr(rendering, "Frame", Interleaved)
    monkeypatch.setattr(Interleaved, "backwards", backwards)
    made: list[Any] = []

    def in_chains(self: wc.Renderer, tables: Any, images: Any) -> Any:
        made.append(self._scratch.chains(images, rendering.PARTS))
        return made[-1]

    monkeypatch.setattr(wc.Renderer, "_is_large", lambda self, pixels: True)
    monkeypatch.setattr(wc.Renderer, "_chains", in_chains)
    chained = wc.Renderer(scene, cameras)
    assert [len(chain) > 1 for chain in made[0]] == [True] * rendering.PARTS
    chained.render()
    for _ in range(2):
        for key, images in chained.render().items():
            for name, tensor in images.items():
                np.testing.assert_array_equal(tensor.cpu().numpy(), expected[key][name].cpu().numpy(), err_msg=name)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("more", ["", MIRROR, GLASS], ids=["", "mirror", "glass"])
@pytest.mark.parametrize("outputs", [("rgb",), ("rgb", "depth", "normals"), ("hdr", "albedo", "flow")], ids="+".join)
def test_groups_that_are_coloured_in_turns_make_the_same_images(
    outputs: tuple[str, ...], more: str, backwards: bool, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_of(device, 23, more)
    cameras = [
        camera(outputs=outputs, shadows=True, antialiasing=4 if "normals" in outputs else 1),
        camera("side", width=17, height=9, outputs=("rgb",), shadows=True),
    ]
    whole = wc.Renderer(scene, cameras)
    whole.render()
    expected = {key: {n: t.clone() for n, t in images.items()} for key, images in whole.render().items()}
    monkeypatch.setattr(scratch, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
    monkeypatch.setattr(wc.Renderer, "_is_large", lambda self, pixels: True)
    monkeypatch.setattr(rendering, "Frame", Interleaved)
    monkeypatch.setattr(Interleaved, "backwards", backwards)
    made: list[Any] = []

    def counted(self: wc.Renderer, phases: Any, images: Any) -> Any:
        late = {key: target.late_images for key, target in self._targets.items()}
        made.append((len(phases), self._scratch.phases_of_turns(images, late, rendering.TURNS)))
        return made[-1][1]

    monkeypatch.setattr(wc.Renderer, "_fewer", counted)
    turned = wc.Renderer(scene, cameras)
    [(plain, phases)] = made
    assert len(phases) <= plain
    assert max(map(len, phases)) == rendering.TURNS
    turned.render()
    for _ in range(2):
        for key, images in turned.render().items():
            for name, tensor in images.items():
                np.testing.assert_array_equal(tensor.cpu().numpy(), expected[key][name].cpu().numpy(), err_msg=name)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_what_a_turn_needs_lies_in_no_image_that_is_there(turns: int) -> None:
    tables = scene_of("cpu", 23).tables()
    cameras = {"top": camera(outputs=("rgb", "depth"), shadows=True), "side": camera("side", shadows=True)}
    images = {
        key: {name: wp.empty((23, 20, 24, 4), dtype=OUTPUTS[name].dtype) for name in each.outputs}
        for key, each in cameras.items()
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scratch, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
        block = scratch.Scratch(cameras, tables, wp.get_device("cpu"))
    block.allocate()
    late = {"top": ["rgb"], "side": ["rgb"]}
    drawn: set[tuple[str | int, str, int]] = set()  # images that are there
    for phase in block.phases_of_turns(images, late, turns):
        portions = [portion for turn in phase for portion in turn]
        drawn |= {(p.camera, "depth", world) for p in portions if p.camera == "top" for world in p.worlds}
        taken: list[tuple[int, int]] = []
        for turn in phase:
            drawn |= {(portion.camera, "rgb", world) for portion in turn for world in portion.worlds}
            for portion in turn:
                for buffer in portion.buffers.values():
                    start = buffer.ptr + portion.worlds.start * buffer.strides[0]
                    taken.append((start, start + len(portion.worlds) * buffer.strides[0]))
                    for key, name, world in drawn:
                        image = images[key][name]
                        begin = image.ptr + world * image.strides[0]
                        assert taken[-1][1] <= begin or begin + image.strides[0] <= taken[-1][0]
        taken.sort()
        assert all(end <= begin for (_, end), (begin, _) in itertools.pairwise(taken))
    assert len(drawn) == 3 * 23


def test_no_chains_where_their_share_has_no_room_for_a_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch, "ALWAYS_ALLOWED", 1)
    camera_of_few = camera(outputs=("rgb",), shadows=True)
    tables = scene_of("cpu", 2).tables()
    assert scratch.Scratch({"top": camera_of_few}, tables, wp.get_device("cpu")).chains({}, rendering.PARTS) is None


def test_groups_of_worlds_may_be_captured(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch, "ALWAYS_ALLOWED", 1)
    renderer = wc.Renderer(scene_of(device, 5), [camera(outputs=("rgb", "normals"), shadows=True)])
    expected = {name: tensor.clone() for name, tensor in renderer.render()["top"].items()}
    with wp.ScopedCapture(device) as capture:
        renderer.render()
    for tensor in renderer.images["top"].values():
        tensor.zero_()
    wp.capture_launch(capture.graph)
    for name, tensor in renderer.images["top"].items():
        np.testing.assert_array_equal(tensor.cpu().numpy(), expected[name].cpu().numpy())


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
        assert told.scratch == scratch_by_the_docs(8192, cameras)
        assert told.total == images + told.scratch + 8192 * (10 + 4 * 84)
        assert told.total < 1.5 * images < 3e9  # of the 24e9 bytes and more that a card has
