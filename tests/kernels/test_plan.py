"""Plans of frames: which kernels a scene, a camera and a device ask for. Nothing is compiled."""

from dataclasses import FrozenInstanceError, replace
from itertools import product
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp
from sphere_scenes import Simulation

from warpcam.kernels import types
from warpcam.kernels.flags import (
    NO_SCENE_FLAGS,
    NO_SHADING_FLAGS,
    GeometryFlag,
    ImageFlag,
    Lens,
    SceneFlag,
    ShadingFlag,
    TraceFlag,
)
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.plan import edges, frame, launches, shading, shadow, trace, words
from warpcam.kernels.plan.passes import PASSES, pass_of, register
from warpcam.kernels.plan.request import BUFFER, ImageRequest
from warpcam.kernels.runtime.compile import NATIVE
from warpcam.kernels.runtime.launch import Group, MeshReads
from warpcam.kernels.scene_tables import SceneTables

CPU: Any = SimpleNamespace(is_cuda=False, is_cpu=True)
CARD: Any = SimpleNamespace(is_cuda=True, is_cpu=False, sm_count=132)
ALL = Group.of_all(8192)
REQUEST = ImageRequest(64, 64, "pinhole", ("rgb",))
NONE, ONE = SimpleNamespace(size=0), SimpleNamespace(size=1)


def scene(*shape_types: int, shapes: int = 20, flags: SceneFlag = NO_SCENE_FLAGS, **other: Any) -> SceneTables:
    drawn = SimpleNamespace(drawn=SimpleNamespace(shape=(shapes,)))
    tables = SceneTables(
        shapes=drawn, meshes=SimpleNamespace(occluder_boxes=None), height_fields=None, materials=None, textures=None,
        lights=None, background=None, num_worlds=8192, num_drawn=shapes, num_lights=1,
        shape_types=frozenset(shape_types or (types.SPHERE,)), num_shapes=shapes, num_faces=0, has_materials=True,
        has_textures=False, has_skybox=False, flags=flags,
    )  # fmt: skip
    return replace(tables, **other)


def traced(tables: SceneTables, device: Any, *images: str, **other: Any) -> trace.TraceKey:
    images = images or ("depth", "shape")
    return trace.plan_trace(tables, REQUEST, device, ALL, images=images, flags=NO_SHADING_FLAGS, **other).key


def test_keys_are_frozen_and_equal_by_value() -> None:
    key = traced(scene(), CPU)
    assert key == traced(scene(), CPU)
    assert hash(key) == hash(traced(scene(), CPU))
    with pytest.raises(FrozenInstanceError):
        key.capacity = 3  # type: ignore[misc]


def test_scenes_of_similar_sizes_share_kernels() -> None:
    assert traced(scene(shapes=17), CARD) == traced(scene(shapes=32), CARD)
    assert traced(scene(shapes=33), CARD) != traced(scene(shapes=32), CARD)


@pytest.mark.parametrize(
    ("fewer", "more", "shared"), [(1, 64, True), (65, 256, True), (257, 5000, True), (64, 65, False)]
)
def test_lists_of_a_cpu_have_few_sizes(fewer: int, more: int, shared: bool) -> None:
    assert (traced(scene(shapes=fewer), CPU).capacity == traced(scene(shapes=more), CPU).capacity) == shared


@pytest.mark.parametrize(("fewer", "more", "shared"), [(1, 64, True), (65, 384, True), (64, 65, False)])
def test_shadow_lists_of_a_cpu_have_few_sizes(fewer: int, more: int, shared: bool) -> None:
    def key(shapes: int) -> shadow.ShadowKey:
        return shadow.plan_shadow(scene(shapes=shapes), REQUEST, CPU, ALL).key

    assert (key(fewer) == key(more)) == shared


def test_a_trace_knows_nothing_of_appearance_unless_it_writes_albedo() -> None:
    tables = scene(flags=SceneFlag.TEXTURE_FROM_ABOVE | SceneFlag.TWO_SIDED)
    assert traced(tables, CARD).types.scene == SceneFlag.TWO_SIDED
    assert SceneFlag.TEXTURE_FROM_ABOVE in traced(tables, CARD, "depth", "albedo").types.scene
    flags = ShadingFlag.HAS_MATERIALS
    plain = trace.plan_trace(tables, REQUEST, CARD, ALL, images=("depth",), flags=flags).key
    assert plain.flags == NO_SHADING_FLAGS


def test_scenes_of_a_set_of_shape_types_share_kernels_of_a_cpu_alone() -> None:
    assert traced(scene(types.SPHERE), CPU) == traced(scene(types.BOX, types.PLANE), CPU)
    assert traced(scene(types.SPHERE), CPU) != traced(scene(types.CONE), CPU)
    assert traced(scene(types.SPHERE), CARD).types.geometry == GeometryFlag.SPHERE


def test_outputs_of_a_trace_are_its_flags() -> None:
    key = traced(scene(), CARD, "depth", "points", "instances", "ids")
    images = key.outputs & (trace.OPTIONAL | TraceFlag.NORMAL)
    assert images == TraceFlag.DEPTH | TraceFlag.POINTS | TraceFlag.INSTANCES | TraceFlag.IDS
    assert traced(scene(), CPU, "flow").outputs & ~trace.OPTIONAL == TraceFlag.FLOW | TraceFlag.FLOW_COMPACT
    assert TraceFlag.OPAQUE in traced(scene(), CPU, opaque=True).outputs


@pytest.mark.parametrize("by_world", [False, True])
def test_traces_of_a_cpu_share_a_kernel_whichever_images_they_write(by_world: bool) -> None:
    tables = scene(ids_by_world=by_world)
    images = [("depth",), ("shape",), ("distance", "points"), ("bodies", "ids"), ("instances", "semantics"), ("face",)]
    assert len({traced(tables, CPU, *some) for some in images}) == 1
    assert len({traced(tables, CARD, *some) for some in images}) == len(images)
    assert len({traced(tables, CPU, *some, opaque=True) for some in (("depth",), ("depth", "shape", "face"))}) == 1
    assert traced(tables, CPU, "normals") != traced(tables, CPU, "depth") != traced(tables, CPU, "flow")


@pytest.mark.parametrize(
    ("shapes", "faces", "ids", "stored"),
    [(127, 2**16 - 1, wp.int8, wp.uint16), (128, 2**16, wp.int16, wp.int32), (2**15 + 1, 0, wp.int32, wp.uint16)],
)
def test_ids_and_faces_have_one_type_on_a_cpu_and_small_ones_on_a_card(
    shapes: int, faces: int, ids: Any, stored: Any
) -> None:
    tables = scene(num_shapes=shapes, num_faces=faces)
    assert launches.id_dtypes(tables, CARD) == (ids, stored)
    assert launches.id_dtypes(tables, CPU) == (wp.int32, wp.int32)


def test_a_cpu_is_told_nothing_of_the_images_size() -> None:
    size = TraceFlag.WIDTH_MULTIPLE_OF_4 | TraceFlag.NO_PARTIAL_TILES | TraceFlag.FLOW_WHOLE
    assert not traced(scene(), CPU, "points").outputs & size
    assert traced(scene(), CARD, "points").outputs & size == size


def test_registers_are_bounded_by_what_a_scene_has() -> None:
    assert traced(scene(), CARD).blocks == 10
    assert traced(scene(types.HEIGHT_FIELD), CARD).blocks == 8
    assert traced(scene(types.MESH, flags=SceneFlag.DEFORMING_MESHES), CARD).blocks == 6
    assert traced(scene(types.MESH, shapes=100), CARD).blocks <= 6


@pytest.mark.parametrize(("shapes", "many"), [(384, False), (385, True), (2**20 + 1, False)])
def test_many_casters_have_a_kernel_of_their_own(shapes: int, many: bool) -> None:
    key = shadow.plan_shadow(scene(shapes=shapes), REQUEST, CARD, ALL).key
    assert key.many_casters == many
    with_meshes = [shadow.plan_shadow(scene(types.MESH, shapes=shapes), REQUEST, device, ALL) for device in (CARD, CPU)]
    assert [planned.key.many_casters for planned in with_meshes] == [False, many]


def test_backs_of_meshes_shade() -> None:
    key = shadow.plan_shadow(scene(types.MESH), REQUEST, CARD, ALL).key
    assert SceneFlag.SHADING_BACKS in key.types.scene
    key = shadow.plan_shadow(scene(types.MESH, physical=object()), REQUEST, CARD, ALL).key
    assert SceneFlag.SHADING_BACKS not in key.types.scene


@pytest.mark.parametrize(("width", "strips"), [(64, True), (60, True), (62, False)])
def test_planes_are_shaded_by_strips_where_four_pixels_are_stored_at_once(width: int, strips: bool) -> None:
    tables = scene(types.PLANE, types.BOX)
    request = ImageRequest(width, 64, "pinhole", ("rgb",))
    plan = shading.plan_shading(tables, request, CARD, ALL, outputs=("rgb",), shadows=False)
    assert (ShadingFlag.PLANE_STRIPS in plan.key.flags) == strips
    shadowed = shading.plan_shading(
        scene(types.PLANE, num_lights=8), request, CARD, ALL, outputs=("rgb",), shadows=True
    )
    assert (ShadingFlag.PLANE_STRIPS in shadowed.key.flags) == strips
    assert (ShadingFlag.WHOLE_REGIONS in plan.key.flags) == (width == 64)
    assert plan.key.images == ImageFlag.RGB
    assert plan.key.blocks == (6 if strips else 5)
    on_cpu = shading.plan_shading(tables, request, CPU, ALL, outputs=("rgb",), shadows=False)
    assert not on_cpu.key.flags & (ShadingFlag.PLANE_STRIPS | ShadingFlag.STORE_QUADS | ShadingFlag.WHOLE_REGIONS)


@pytest.mark.parametrize(
    ("facts", "shadows", "general"),
    [
        ({"num_lights": 3}, True, False),
        ({"num_lights": 4}, True, True),
        ({"num_lights": 8}, False, False),
        ({"general_planes": True}, False, True),
        ({"world_overrides": SimpleNamespace(texture_offsets=NONE, skyboxes=NONE, exposures=ONE)}, False, True),
    ],
)
def test_kernels_of_strips_are_for_the_planes_of_the_scene(facts: dict[str, Any], shadows: bool, general: bool) -> None:
    tables, request = scene(types.PLANE, **facts), ImageRequest(64, 64, "pinhole", ("rgb",))
    key = shading.plan_shading(tables, request, CARD, ALL, outputs=("rgb",), shadows=shadows).key
    assert (ShadingFlag.GENERAL_PLANES in key.flags) == general
    tables = replace(tables, shape_types=frozenset((types.BOX,)))
    key = shading.plan_shading(tables, request, CARD, ALL, outputs=("rgb",), shadows=shadows).key
    assert ShadingFlag.GENERAL_PLANES not in key.flags


def test_colours_of_few_shapes_share_a_kernel_of_a_cpu() -> None:
    def key(device: Any, *outputs: str, shapes: int = 20, **other: Any) -> shading.ShadingKey:
        tables = scene(shapes=shapes, **other)
        return shading.plan_shading(tables, REQUEST, device, ALL, outputs=outputs, shadows=False).key

    looks = [
        {"has_materials": materials, "has_textures": textures, "has_skybox": skybox}
        for materials, textures, skybox in product((False, True), repeat=3)
    ]
    assert len({key(CPU, "rgb", shapes=shapes, **look) for look in looks for shapes in (1, 64)}) == 2  # textures
    assert len({key(CPU, "rgb", physical=object(), **look) for look in looks}) == 4  # textures, skybox
    assert len({key(CPU, "rgb", shapes=65, **look) for look in looks}) == len(looks)
    assert len({key(CARD, "rgb", **look) for look in looks}) == len(looks)
    assert len({key(CPU, "albedo", **look) for look in looks}) == 4


def test_edges_are_smoothed_in_place_where_worlds_fill_the_device() -> None:
    def key(tables: SceneTables) -> edges.EdgeKey:
        request = replace(REQUEST, antialiasing=4)
        return edges.plan_edges(tables, request, CARD, ALL, byte_ids=True).key

    assert key(scene(types.MESH)).in_place
    assert key(scene(types.MESH)).threads == edges.THREADS_IN_PLACE
    assert not key(scene(types.MESH, num_worlds=100)).in_place
    assert not key(scene()).in_place


def test_a_key_in_words_names_flags() -> None:
    key = traced(scene(types.MESH, types.PLANE, flags=SceneFlag.TWO_SIDED), CARD)
    assert key.types.geometry == GeometryFlag.PLANE | GeometryFlag.MESH
    assert key.lens is Lens.PINHOLE
    line = words.describe("trace", key)
    for word in ("trace:", "PLANE MESH TWO_SIDED", "PINHOLE", "DEPTH SHAPE", "64x64", "several no", "blocks 8 on"):
        assert word in line


def planned(*outputs: str, device: Any = CARD, of: SceneTables | None = None, **request: Any) -> frame.FramePlan:
    tables = scene(types.MESH) if of is None else of
    return frame.plan_frame(tables, ImageRequest(64, 64, "pinhole", outputs, **request), device)


def test_a_plan_is_frozen_and_equal_by_value() -> None:
    plan = planned("rgb", "depth", shadows=True)
    assert plan == planned("rgb", "depth", shadows=True)
    assert hash(plan.passes) == hash(planned("rgb", "depth", shadows=True).passes)
    with pytest.raises(FrozenInstanceError):
        plan.buffers = ()  # type: ignore[misc]


@pytest.mark.parametrize(
    ("outputs", "names", "buffers"),
    [
        (("depth", "segmentation"), ["trace"], set()),
        (("rgb",), ["trace", "shadow", "shading"], {"depth", "shape", "face", "shadow"}),
        (("rgb", "depth", "segmentation"), ["trace", "shadow", "shading"], {"face", "shadow"}),
        (("normals", "depth"), ["trace", "shading"], {"shape", "face"}),
        (("faces",), ["trace", "triangles"], {"depth", "shape", "face"}),
        (("faces", "albedo", "depth"), ["trace", "shading", "triangles"], {"shape", "face"}),
    ],
)
def test_passes_and_buffers_follow_from_the_outputs(
    outputs: tuple[str, ...], names: list[str], buffers: set[str]
) -> None:
    plan = planned(*outputs, shadows=True)
    assert [each.name for each in plan.passes] == names
    assert {name for name, _ in plan.buffers} == {BUFFER + name for name in buffers}
    written = {name for each in plan.passes for _, name in each.arrays}
    assert written == set(outputs) | {name for name, _ in plan.buffers}


@pytest.mark.parametrize(
    ("of", "request_", "lists"),
    [
        (scene(types.MESH, shapes=128), {}, False),
        (scene(types.MESH, shapes=129), {}, True),
        (scene(types.MESH, shapes=2**16 + 1), {}, False),
        (scene(types.MESH, shapes=300), {"lens": "rays"}, False),
        (scene(types.MESH, shapes=300), {"outputs": ("depth", "flow")}, False),
        (scene(types.BOX, shapes=300), {}, False),
        (scene(types.BOX, shapes=300), {"width": 256, "height": 256}, True),
    ],
)
def test_traces_of_many_shapes_choose_from_those_in_view(
    of: SceneTables, request_: dict[str, Any], lists: bool
) -> None:
    asked = ImageRequest(**{"width": 64, "height": 64, "lens": "pinhole", "outputs": ("depth",), **request_})
    plan = frame.plan_frame(of, asked, CARD)
    assert ("shapes in view" in [each.name for each in plan.passes]) == lists
    (key,) = [each.key for each in plan.passes if each.name == "trace"]
    assert bool(key.outputs & TraceFlag.IN_VIEW) == lists
    assert not lists or (
        plan.list_rows == (of.num_drawn + 2) // 2 and key.several and "buffer shape" in dict(plan.buffers)
    )
    assert not any(each.name == "shapes in view" for each in frame.plan_frame(of, asked, CPU).passes)


@pytest.mark.parametrize(
    ("worlds", "shapes", "lens", "region"),
    [
        (512, 4, "pinhole", (64, 32)),
        (128, 4, "pinhole", (32, 32)),
        (512, 4, "orthographic", None),
        (512, 250, "pinhole", None),
    ],
)
def test_faces_that_move_are_projected(worlds: int, shapes: int, lens: str, region: tuple[int, int] | None) -> None:
    tables = scene(types.MESH, shapes=shapes, flags=SceneFlag.DEFORMING_MESHES)
    request, group = ImageRequest(64, 64, lens, ("depth",)), Group.of_all(worlds)
    key = trace.plan_trace(tables, request, CARD, group, images=("depth", "shape"), flags=NO_SHADING_FLAGS).key
    assert (TraceFlag.PROJECTED_FACES in key.outputs) == (region is not None)
    assert region in (key.region, None)
    still = replace(tables, flags=NO_SCENE_FLAGS)
    key = trace.plan_trace(still, request, CARD, group, images=("depth", "shape"), flags=NO_SHADING_FLAGS).key
    assert TraceFlag.PROJECTED_FACES not in key.outputs


MOVING = {"size": (64, 64), "lens": "pinhole", "layers": None}
GLASS = SimpleNamespace(has_transparent=True, has_mirrors=False, haze=None, transparent_shapes=ONE)


def reads(*outputs: str, faces: int = 10_000, device: Any = CARD, **request: Any) -> list[MeshReads]:
    """What the passes of images with so many pixels read of a mesh that moves."""
    size, lens, layers = (request.pop(name, given) for name, given in MOVING.items())
    flags, moving = SceneFlag.DEFORMING_MESHES, {"moving": (0,), "moving_faces": faces}
    tables = scene(types.MESH, flags=flags, layers=layers, **moving)
    plan = frame.plan_frame(tables, ImageRequest(*size, lens, outputs, **request), device)
    return [each.reads for each in (*(plan.fine.passes if plan.fine else ()), *plan.passes)]


def test_projected_faces_need_no_trees() -> None:
    faces, normals, trees = MeshReads
    assert reads("depth", "segmentation") == [faces]
    assert reads("depth", "segmentation", device=CPU) == [trees]
    assert reads("depth", lens="orthographic") == [trees]
    assert reads("rgb", "depth") == [faces, normals]
    assert reads("rgb", "faces") == [faces, normals, normals]
    assert reads("rgb", "depth", shadows=True) == [faces, trees, normals]
    assert reads("rgb", antialiasing=4)[-1] == trees
    assert reads("rgb", antialiasing=8) == [faces, normals, trees, faces]  # the last are means
    assert reads("rgb", layers=GLASS)[-1] == trees
    assert trees in reads("rgb", ambient_occlusion=True)


@pytest.mark.parametrize(
    ("size", "faces", "projects"),
    [
        ((64, 64), 20_480, True),
        ((64, 64), 20_481, False),  # of a region of 64x32 pixels
        ((64, 37), 10 * 64 * 8, True),  # the last one has 8 rows of tiles
        ((64, 37), 10 * 64 * 8 + 1, False),
        ((16, 12), 10 * 16 * 12, True),
        ((16, 12), 10 * 16 * 12 + 1, False),
    ],
)
def test_trees_are_left_alone_where_each_region_projects_all_faces(
    size: tuple[int, int], faces: int, projects: bool
) -> None:
    assert reads("depth", size=size, faces=faces) == [MeshReads.FACES if projects else MeshReads.TREES]
    header = (NATIVE / "traversal" / "projected_faces.h").read_text()
    assert f"MOST_FACES_A_PIXEL = {trace.PROJECTED_FACES};" in header


def test_smooth_edges_have_a_pass_and_a_buffer_unless_in_place() -> None:
    many, few = planned("rgb", antialiasing=4), planned("rgb", antialiasing=4, of=scene(types.MESH, num_worlds=100))
    assert many.in_place and not few.in_place
    assert [each.name for each in few.passes] == ["trace", "shading", "smooth edges"]
    assert "buffer lit rgb" in dict(few.buffers)
    assert "buffer lit rgb" not in dict(many.buffers)


def test_buffers_of_a_plan_do_not_depend_on_the_group() -> None:
    tables, request = scene(types.MESH), ImageRequest(64, 64, "pinhole", ("rgb",), shadows=True)
    large, small = (frame.plan_frame(tables, request, CARD, Group.of_all(count)) for count in (8192, 8))
    assert large.buffers == small.buffers
    assert large.keys != small.keys
    assert set(frame.merged([large, small]).keys) == {*large.keys, *small.keys}


@pytest.mark.parametrize("name", sorted(name for name, output in OUTPUTS.items() if output.trace is None))
def test_each_derived_output_has_one_pass(name: str) -> None:
    assert [one.name for one in PASSES.values() if name in one.writes] == [pass_of(name).name]


def test_an_output_that_no_pass_derives_is_named() -> None:
    with pytest.raises(ValueError, match="no pass derives 'flow'; derived are albedo, barycentrics"):
        pass_of("flow")


def test_a_pass_is_registered_once() -> None:
    with pytest.raises(ValueError, match="a pass 'trace' is there already"):
        register("trace")(lambda planned, frame: None)
    with pytest.raises(ValueError, match=r"outputs \['rgb'\] of 'mine' are derived by another pass"):
        register("mine", writes=("rgb",))(lambda planned, frame: None)
    assert "mine" not in PASSES


def test_a_renderer_tells_its_plan() -> None:
    renderer = Simulation("cpu").renderer(("depth",))
    plans = renderer.plan
    assert list(plans) == ["top"]
    (key,) = plans["top"].keys
    assert isinstance(key, trace.TraceKey)
    assert TraceFlag.DEPTH in key.outputs
    assert str(plans["top"]).splitlines() == ["views", words.describe("trace", key)]
