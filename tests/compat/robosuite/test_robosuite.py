"""robosuite's camera observations through ``warpcam.compat.robosuite``, against those of its own context."""

import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import fast_compile
import numpy as np
import pytest
from PIL import Image

import warpcam as wc
from warpcam.accel import bvh4
from warpcam.compat.robosuite import renderer as ours

pytest.importorskip(
    "robosuite", reason="robosuite needs an environment of its own: see 'robosuite' in .ci/run", exc_type=ImportError
)
pytestmark = pytest.mark.filterwarnings("ignore")  # robosuite and what it imports warn of their own use

SIZE = 128
CAMERAS = ("agentview", "robot0_eye_in_hand")
OF_ALL_KINDS = ("Door", "PickPlace", "ToolHang", "TwoArmPegInHole", "TwoArmTransport", "Wipe")
FINE = {"numslices": 250, "numstacks": 50}  # what is round has no facets
KINDS = ("instance", "class", "element")


def make(task: str, **options: Any) -> Any:
    import robosuite

    two_armed = task.startswith("TwoArm")
    return robosuite.make(
        task, robots=["Panda", "Panda"] if two_armed else "Panda", has_renderer=False, seed=3,
        **{"has_offscreen_renderer": True, "use_camera_obs": True} | options,
    )  # fmt: skip


@pytest.fixture
def installed() -> Iterator[None]:
    ours.install()
    yield
    ours.uninstall()


@pytest.fixture(scope="module")
def lift() -> Iterator[Any]:
    ours.install()
    env = make(
        "Lift", camera_names=list(CAMERAS), camera_heights=SIZE, camera_widths=SIZE, camera_depths=True,
        camera_segmentations=list(KINDS),
    )  # fmt: skip
    env.reset()
    for _ in range(3):
        env.step(np.full(env.action_dim, 0.3))
    yield env
    ours.uninstall()


def edges(ids: np.ndarray) -> np.ndarray:
    padded = np.pad(ids, 1, mode="edge")
    around = [padded[i : i + SIZE, j : j + SIZE] for i in range(3) for j in range(3)]
    return (np.stack(around) != ids).any(axis=0)


def psnr(one: np.ndarray, two: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.square((one.astype(float) - two) / 255.0).mean()))


def read(context: Any, camera: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    context.render(SIZE, SIZE, camera)
    color, depth = context.read_pixels(SIZE, SIZE, depth=True)
    context.render(SIZE, SIZE, camera, segmentation=True)
    return color, depth, context.read_pixels(SIZE, SIZE, segmentation=True)


def has_its_own_context() -> bool:
    return os.environ.get("MUJOCO_GL") == "osmesa"


def needs_its_own_context() -> None:
    if not has_its_own_context():
        pytest.skip(
            "robosuite's own context needs a library on a machine without a display: apt-get install libosmesa6"
        )


def by_its_own_context(sim: Any, look: Callable[[Any], Any], **quality: int) -> Any:
    """Return what ``look`` makes of robosuite's own context of that quality, which does not outlast it."""
    from robosuite.utils import binding_utils

    mine, settings = sim._render_context_offscreen, sim.model.vis.quality
    shipped = {name: getattr(settings, name) for name in quality}
    theirs = sim._render_context_offscreen = None
    try:
        for name, value in quality.items():
            setattr(settings, name, value)
        theirs = ours._originals[binding_utils](sim, -1)
        theirs.vopt.geomgroup[:] = mine.vopt.geomgroup
        for name, value in shipped.items():  # some of which ours is drawn with, too
            setattr(settings, name, value)
        return look(theirs)
    finally:
        theirs = None
        sim.add_render_context(mine)
        gc.collect()


def test_images_are_those_of_its_own_context(lift: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    needs_its_own_context()
    mine, view_of = lift.sim._render_context_offscreen, ours.view_of

    def compare(theirs: Any) -> None:
        for camera in range(lift.sim.model.ncam):
            expected, seen = read(theirs, camera), read(mine, camera)
            assert psnr(expected[0], seen[0]) > 32.0
            same = (expected[2] == seen[2]).all(axis=-1)
            inside = ~edges(expected[2][..., 1] * 100 + expected[2][..., 0])
            print(f"{lift.sim.model.camera_id2name(camera)}: ids {same.mean():.3%}, {(~same[inside]).sum()} inside")
            assert same[inside].all() and same.mean() > 0.99
        # Depth of several samples is that of the first, which Mesa has here.
        monkeypatch.setattr(ours, "view_of", lambda *scene: moved(view_of(*scene), -2 / 16 / SIZE, -6 / 16 / SIZE))
        compare_depths(theirs, mine)

    by_its_own_context(lift.sim, compare, **FINE)


def moved(view: Any, right: float, up: float) -> Any:
    """The view by these parts of an image's width and height beside it."""
    x, y = right * (view.right - view.left), up * (view.top - view.bottom)
    return replace(view, left=view.left + x, right=view.right + x, bottom=view.bottom + y, top=view.top + y)


def compare_depths(theirs: Any, mine: Any) -> None:
    """Compare the depth buffers of all cameras, and their metres, away from edges."""
    model = mine.model
    near, far = (model.stat.extent * getattr(model.vis.map, name) for name in ("znear", "zfar"))
    for camera in range(model.ncam):
        (_, *expected), (_, *seen) = read(theirs, camera), read(mine, camera)
        for one, two in zip(expected, seen, strict=True):
            assert (one.dtype, one.shape) == (two.dtype, two.shape)
        inside = (expected[1] == seen[1]).all(axis=-1) & ~edges(expected[1][..., 1] * 100 + expected[1][..., 0])
        assert inside.mean() > 0.6
        off = np.abs(expected[0] - seen[0])[inside]
        one, two = (1.0 - depth[inside].astype(float) * (1.0 - near / far) for depth in (expected[0], seen[0]))
        wrong = (off > 1e-4).mean(), (np.abs(one / two - 1.0) > 1e-4).mean()
        print(f"{model.camera_id2name(camera)}: {wrong[0]:.3%} of the pixels of the buffer, {wrong[1]:.3%} of metres")
        assert max(wrong) < 2e-3, "but for edges inside of a mesh"


def test_depth_looks_through_what_is_transparent(installed: None) -> None:
    """Depth is that of the buffer that robosuite's own context reads: the bins have markers of where objects belong."""
    env = make("PickPlaceMilk", camera_names="agentview", camera_heights=32, camera_widths=32)
    env.reset()
    context, marker = env.sim._render_context_offscreen, env.sim.model.geom_name2id("VisualMilk_g0")
    color, depth, ids = read(context, env.sim.model.camera_name2id("agentview"))
    seen = ids[..., 1] == marker
    assert seen.sum() > 10 and env.sim.model._model.geom_rgba[marker, 3] < 0.995
    extent, limits = env.sim.model.stat.extent, env.sim.model.vis.map
    near, far = limits.znear * extent, limits.zfar * extent
    along = near / (1.0 - depth[seen] * (1.0 - near / far))
    context.render(SIZE, SIZE, segmentation=True)
    solid = context.read_pixels(SIZE, SIZE, depth=True, segmentation=True)[1]
    assert (along > near / (1.0 - solid[seen] * (1.0 - near / far)) + 0.01).all() and color.any()
    env.close()


def test_every_camera_key(lift: Any) -> None:
    observations = lift._get_observations(force_update=True)
    for camera in CAMERAS:
        color, depth = observations[f"{camera}_image"], observations[f"{camera}_depth"]
        assert (color.dtype, color.shape) == (np.uint8, (SIZE, SIZE, 3)) and len(np.unique(color)) > 20
        assert (depth.dtype, depth.shape) == (np.float32, (SIZE, SIZE, 1)) and 0.0 < depth.min() < depth.max() <= 1.0
        for kind in KINDS:
            ids = observations[f"{camera}_segmentation_{kind}"]
            assert (ids.dtype, ids.shape) == (np.int32, (SIZE, SIZE, 1)) and len(np.unique(ids)) > 1
        element = observations[f"{camera}_segmentation_element"]
        cube = lift.sim.model.geom_name2id("cube_g0_vis")
        if (element == cube).any():
            numbers = {name: number + 1 for number, name in enumerate(lift.model.instances_to_ids)}
            assert (observations[f"{camera}_segmentation_instance"][element == cube] == numbers["cube"]).all()


def test_one_picture_a_state_and_camera(lift: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Colour, depth and three kinds of ids of a camera are five calls there and one here."""
    lift._get_observations(force_update=True)
    frames: list[Any] = []
    render = wc.Renderer.render
    monkeypatch.setattr(wc.Renderer, "render", lambda *a, **k: frames.append(a) or render(*a, **k))
    lift.step(np.full(lift.action_dim, 0.2))
    assert len(frames) == len(CAMERAS)
    for _ in range(2):  # after a step the state is a later one
        lift._get_observations(force_update=True)
        assert len(frames) == 2 * len(CAMERAS)
    lift.sim.model.geom_rgba[lift.sim.model.geom_name2id("cube_g0_vis")] = (0, 1, 0, 1)
    lift._get_observations(force_update=True)
    assert len(frames) == 3 * len(CAMERAS), "a change of colour is a change"


def test_conventions(lift: Any) -> None:
    image = lift.sim.render(width=SIZE, height=SIZE, camera_name="agentview")
    from robosuite import macros

    assert macros.IMAGE_CONVENTION == "opengl"
    assert (lift._get_observations(force_update=True)["agentview_image"] == image).all()
    context = lift.sim._render_context_offscreen
    table = lift.sim.model.geom_name2id("table_visual")
    context.render(SIZE, SIZE, lift.sim.model.camera_name2id("frontview"), segmentation=True)
    ids = context.read_pixels(SIZE, SIZE, segmentation=True)
    rows = np.nonzero((ids[..., 1] == table).any(axis=1))[0]
    floor = np.nonzero((ids[..., 1] == lift.sim.model.geom_name2id("floor")).any(axis=1))[0]
    assert floor.min() < rows.min(), "the bottom row is first"
    with pytest.raises(wc.WarpcamError, match="render had width 128, height 128, segmentation True"):
        context.read_pixels(SIZE, SIZE)


def test_cameras_that_see_nothing_are_named(lift: Any) -> None:
    context = lift.sim._render_context_offscreen
    with pytest.raises(
        wc.WarpcamError, match=rf"camera_id 99 came; the model has cameras 0 to {lift.sim.model.ncam - 1}"
    ):
        context.render(SIZE, SIZE, 99)
    context.render(SIZE, SIZE, 0)


def test_projections_of_camera_utils(lift: Any) -> None:
    """A pixel, with its depth in metres, is where its geom is."""
    pytest.importorskip("h5py", reason="camera_utils imports h5py: pip install h5py")
    from robosuite.utils import camera_utils

    color, depth = lift.sim.render(width=SIZE, height=SIZE, camera_name="agentview", depth=True)
    metres = camera_utils.get_real_depth_map(lift.sim, depth)[::-1]
    ids = camera_utils.get_camera_segmentation(lift.sim, "agentview", SIZE, SIZE)[..., 1]
    cube = lift.sim.model.geom_name2id("cube_g0_vis")
    pixels = np.argwhere(ids == cube)
    assert len(pixels) > 20
    to_pixel = camera_utils.get_camera_transform_matrix(lift.sim, "agentview", SIZE, SIZE)
    center, half = lift.sim.data.geom_xpos[cube], lift.sim.model.geom_size[cube]
    row, column = camera_utils.project_points_from_world_to_camera(center, to_pixel, SIZE, SIZE)
    assert np.abs((row, column) - pixels.mean(axis=0)).max() < 1.5
    eye = camera_utils.get_camera_extrinsic_matrix(lift.sim, "agentview")
    along = (np.linalg.inv(eye) @ (*center, 1.0))[2]
    assert np.abs(metres[ids == cube] - along).max() < 1.1 * np.linalg.norm(half) and color.shape == (SIZE, SIZE, 3)


def test_a_hard_reset_builds_no_mesh(lift: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    lift.reset()
    builds: list[int] = []
    build = bvh4.bvh4_build.build
    monkeypatch.setattr(bvh4.bvh4_build, "build", lambda *mesh: builds.append(len(mesh[1])) or build(*mesh))
    model = lift.sim.model._model
    lift.reset()
    assert lift.sim.model._model is not model, "not a hard reset"
    assert builds == []


def test_observables_without_patching() -> None:
    from robosuite.environments import base
    from robosuite.utils import binding_utils

    assert base.MjRenderContextOffscreen is binding_utils.MjRenderContextOffscreen
    env = make("Lift", has_offscreen_renderer=False, use_camera_obs=False)
    given = ours.observables(
        env, "agentview", camera_heights=48, camera_widths=64, camera_depths=True, camera_segmentations=KINDS
    )
    names = ["agentview_image", "agentview_depth", *(f"agentview_segmentation_{kind}" for kind in KINDS)]
    assert list(given) == names
    for _ in range(2):
        observations = env.reset()
        shapes = {name: observations[name].shape for name in names}
        assert shapes == {name: (48, 64, 3 if name == "agentview_image" else 1) for name in names}
        assert observations["agentview_image"].std() > 10.0
        after = env.step(np.ones(env.action_dim))[0]
        assert (after["agentview_image"] != observations["agentview_image"]).any()
    with pytest.raises(AssertionError, match="already associated"):
        ours.observables(env, "agentview")
    with pytest.raises(wc.WarpcamError, match="camera_segmentations: 'geom' came; allowed are instance"):
        ours.observables(env, "agentview", camera_segmentations="geom")
    with pytest.raises(wc.WarpcamError, match="camera_widths: 2 came for 3 cameras"):
        ours.observables(env, ["agentview", "frontview", "birdview"], camera_widths=[32, 64])


def test_observables_take_what_the_environment_has_for_each_camera() -> None:
    env = make(
        "Lift", has_offscreen_renderer=False, use_camera_obs=False, camera_names=["agentview", "frontview"],
        camera_heights=[16, 24], camera_widths=[32, 40], camera_depths=[False, True],
    )  # fmt: skip
    assert ours.observables(env, []) == {}
    given = ours.observables(env, "frontview", add=False)
    assert list(given) == ["frontview_image", "frontview_depth"]
    assert given["frontview_depth"]._sensor({}).shape == (24, 40, 1)
    turned = ours.observables(env, ["frontview", "agentview"], add=False)
    assert list(turned) == ["frontview_image", "frontview_depth", "agentview_image"]
    assert turned["agentview_image"]._sensor({}).shape == (16, 32, 3)
    with pytest.raises(wc.WarpcamError, match="camera_heights: 2 came for 1 cameras"):
        ours.observables(env, "birdview")


@pytest.mark.parametrize("convention", ["opengl", "opencv"])
def test_both_ways_see_the_same(installed: None, convention: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from robosuite import macros

    monkeypatch.setattr(macros, "IMAGE_CONVENTION", convention)
    env = make("Lift", camera_names="agentview", camera_heights=64, camera_widths=64, camera_depths=True,
               camera_segmentations=list(KINDS))  # fmt: skip
    given = ours.observables(env, "agentview", camera_segmentations=list(KINDS), add=False)
    expected = env.reset()
    for name, observable in given.items():
        seen = observable._sensor({})
        assert seen.dtype == expected[name].dtype and (seen == expected[name]).all(), name
    from_below = env.sim.render(width=64, height=64, camera_name="agentview")
    assert (expected["agentview_image"] == (from_below if convention == "opengl" else from_below[::-1])).all()


def tasks() -> list[str]:
    import robosuite

    return sorted(robosuite.ALL_ENVIRONMENTS)


@pytest.mark.parametrize("task", tasks())
def test_every_task(installed: None, task: str) -> None:
    """Depth as its own context has it with one sample a pixel, colours with its antialiasing as shipped."""
    env = make(
        task, camera_names="agentview", camera_heights=SIZE, camera_widths=SIZE, camera_depths=True, hard_reset=False
    )
    first = env.reset()["agentview_image"]
    sim, mine = env.sim, env.sim._render_context_offscreen
    if has_its_own_context():
        camera = sim.model.camera_name2id("agentview")
        assert sim.model.vis.quality.offsamples == 4
        noise = psnr(by_its_own_context(sim, lambda theirs: read(theirs, camera)[0]), first)
        print(f"{task}: {noise:.2f} dB")
        assert noise >= 32.0
        if task in OF_ALL_KINDS:
            by_its_own_context(sim, lambda theirs: compare_depths(theirs, mine), offsamples=0, **FINE)
    random = np.random.default_rng(0)
    for _ in range(6):
        observations = env.step(random.uniform(-1, 1, env.action_dim))[0]
        assert observations["agentview_image"].std() > 5.0 and observations["agentview_depth"].std() > 0.0
    assert (observations["agentview_image"] != first).any()
    env.close()


def test_the_example(tmp_path: Path) -> None:
    example = Path(__file__).parents[3] / "examples" / "robosuite_images.py"
    command = [sys.executable, fast_compile.__file__, str(example)]
    done = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert "agentview_segmentation_instance (256, 256, 1)" in done.stdout, done.stderr[-2000:]
    assert np.asarray(Image.open(tmp_path / "robosuite.png")).shape == (256, 512, 3)
