"""Groups of worlds: one after another, in chains or in turns they make the images that all worlds together make."""

import itertools
from typing import Any

import numpy as np
import pytest
import warp as wp
from scratch import scratch_of
from small_scene import GLASS, MIRROR, camera, scene_of

import warpcam as wc
from warpcam.kernels.plan import launches
from warpcam.outputs import OUTPUTS
from warpcam.render import recordings, scratch_memory
from warpcam.render import renderer as rendering

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
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
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


class Interleaved(recordings.FrameGraph):
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
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
    monkeypatch.setattr(recordings, "FrameGraph", Interleaved)
    monkeypatch.setattr(Interleaved, "backwards", backwards)
    made: list[Any] = []

    def in_chains(self: wc.Renderer, tables: Any, images: Any) -> Any:
        made.append(self._scratch.chains(images, rendering.CHAINS))
        return made[-1]

    monkeypatch.setattr(wc.Renderer, "_is_large", lambda self, pixels: True)
    monkeypatch.setattr(wc.Renderer, "_chains", in_chains)
    chained = wc.Renderer(scene, cameras)
    assert [len(chain) > 1 for chain in made[0]] == [True] * rendering.CHAINS
    chained.render()
    for _ in range(2):
        for key, images in chained.render().items():
            for name, tensor in images.items():
                np.testing.assert_array_equal(tensor.cpu().numpy(), expected[key][name].cpu().numpy(), err_msg=name)


def borrows(phases: list[Any], renderer: wc.Renderer) -> bool:
    """Return whether a buffer of some round lies in an image of a later round of its phase."""
    for first, *others in phases:
        for buffer, later in itertools.product([b for p in first for b in starts(p)], itertools.chain(*others)):
            for name in renderer.images[later.camera]:
                image = renderer.array(later.camera, name)
                begin, end = (image.ptr + world * image.strides[0] for world in (later.worlds.start, later.worlds.stop))
                if begin <= buffer < end:
                    return True
    return False


def starts(portion: Any) -> list[int]:
    return [buffer.ptr + portion.worlds.start * buffer.strides[0] for buffer in portion.buffers.values()]


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
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
    monkeypatch.setattr(wc.Renderer, "_is_large", lambda self, pixels: True)
    monkeypatch.setattr(recordings, "FrameGraph", Interleaved)
    monkeypatch.setattr(Interleaved, "backwards", backwards)
    made: list[Any] = []

    def counted(self: wc.Renderer, phases: Any, images: Any) -> Any:
        late = {key: target.plan.late for key, target in self._passes.items()}
        made.append((len(phases), self._scratch.phases_of_rounds(images, late, rendering.ROUNDS)))
        return made[-1][1]

    monkeypatch.setattr(wc.Renderer, "_fewer", counted)
    turned = wc.Renderer(scene, cameras)
    [(plain, phases)] = made
    assert len(phases) <= plain
    assert max(map(len, phases)) == rendering.ROUNDS
    assert borrows(phases, turned) == (more != GLASS)
    turned.render()
    for _ in range(2):
        for key, images in turned.render().items():
            for name, tensor in images.items():
                np.testing.assert_array_equal(tensor.cpu().numpy(), expected[key][name].cpu().numpy(), err_msg=name)


def test_turns_are_taken_where_they_make_phases_fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
    monkeypatch.setattr(launches, "id_dtypes", lambda *_: (wp.int8, wp.uint16))  # as on a GPU
    renderer = wc.Renderer(scene_of("cpu", 500), [camera(outputs=("rgb",))])
    images = {"top": {"rgb": renderer.array("top", "rgb")}}
    plain = [[portions] for portions in renderer._scratch.phases(images)]
    fewer = renderer._fewer(plain, images)
    assert len(fewer) < len(plain)
    assert {len(turns) for turns in fewer} == {rendering.ROUNDS}
    assert renderer._fewer(plain[:1], images) == plain[:1]


@pytest.mark.parametrize("wave", [1, 8, 25, 90])
def test_groups_are_whole_waves_where_images_are_smoothed_in_place(wave: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
    monkeypatch.setattr(launches, "id_dtypes", lambda *_: (wp.int8, wp.uint16))  # as on a GPU
    renderer = wc.Renderer(scene_of("cpu", 500), [camera(outputs=("rgb",))])
    images = {"top": {"rgb": renderer.array("top", "rgb")}}
    sizes = {}
    for step in (1, wave):
        monkeypatch.setattr(scratch_memory.Scratch, "wave", lambda self, key, step=step: step)
        phases = [portion.worlds for (portion,) in renderer._scratch.phases(images)]
        assert [world for worlds in phases for world in worlds] == list(range(500))
        sizes[step] = [len(worlds) for worlds in phases]
    assert len(sizes[wave]) <= len(sizes[1])
    if wave == 90:  # these would be one more
        assert sizes[90] == sizes[1] and any(size % 90 for size in sizes[1][:-1])
    else:
        assert not any(size % wave for size in sizes[wave][:-1])


def test_parts_are_whole_waves() -> None:
    assert scratch_memory.cuts_in_waves(3168, 3, 528) == [0, 1056, 2112, 3168]
    assert scratch_memory.cuts_in_waves(2112, 3, 528) == [0, 1056, 1584, 2112]
    assert scratch_memory.cuts_in_waves(1328, 3, 528) == [0, 528, 1056, 1328]
    assert scratch_memory.cuts_in_waves(500, 3, 528) == [0, 500]
    assert scratch_memory.cuts_in_waves(10, 3, 1) == [0, 4, 7, 10]


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_what_a_turn_needs_lies_in_no_image_that_is_there(turns: int) -> None:
    tables = scene_of("cpu", 23).tables()
    cameras = {"top": camera(outputs=("rgb", "depth"), shadows=True), "side": camera("side", shadows=True)}
    images = {
        key: {name: wp.empty((23, 20, 24, 4), dtype=OUTPUTS[name].dtype) for name in each.outputs}
        for key, each in cameras.items()
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scratch_memory, "ALWAYS_ALLOWED", 24 * 20 * 4 * 3)
        block = scratch_of(cameras, tables, wp.get_device("cpu"))
    block.allocate()
    late = {"top": ["rgb"], "side": ["rgb"]}
    drawn: set[tuple[str | int, str, int]] = set()  # images that are there
    for phase in block.phases_of_rounds(images, late, turns):
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
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", 1)
    camera_of_few = camera(outputs=("rgb",), shadows=True)
    tables = scene_of("cpu", 2).tables()
    assert scratch_of({"top": camera_of_few}, tables, wp.get_device("cpu")).chains({}, rendering.CHAINS) is None


def test_groups_of_worlds_may_be_captured(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", 1)
    renderer = wc.Renderer(scene_of(device, 5), [camera(outputs=("rgb", "normals"), shadows=True)])
    expected = {name: tensor.clone() for name, tensor in renderer.render()["top"].items()}
    with wp.ScopedCapture(device) as capture:
        renderer.render()
    for tensor in renderer.images["top"].values():
        tensor.zero_()
    wp.capture_launch(capture.graph)
    for name, tensor in renderer.images["top"].items():
        np.testing.assert_array_equal(tensor.cpu().numpy(), expected[name].cpu().numpy())
