"""Flow of all that moves: every type of shape, meshes whose corners move, particles, clouds; from every source."""

from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import visual_geom_scenes
import warp as wp
from allocation_ledger import Ledger
from flow_cases import HEIGHT, LENSES, WIDTH, Moving, expected, pixels_of

import warpcam as wc
from warpcam.kernels.plan import trace

EXACT = 1e-3  # pixels


def eye(position: Any, target: Any, **options: Any) -> wc.Camera:
    settings = {"width": WIDTH, "height": HEIGHT, "lens": LENSES["pinhole"]}
    return scenes.own_camera(position=position, rotation=scenes.looking(position, target), **{**settings, **options})


def flow_of(camera: wc.Camera, points: np.ndarray, before: np.ndarray) -> np.ndarray:
    """The flow of points (height, width, 3) that were elsewhere, likewise; for a camera that rests."""
    state = {"position": np.array([camera.position]), "rotation": np.array([camera.rotation]), "fovy": np.array([60.0])}
    size = (camera.width, camera.height)
    return pixels_of(points.astype(np.float64), state, 0, size) - pixels_of(before.astype(np.float64), state, 0, size)


@pytest.mark.parametrize("kind", scenes.TYPES)
def test_every_type_of_shape(kind: str, device: wp.Device) -> None:
    body = scenes.geom_xml(kind, more='pos="0 0 -2" euler="20 30 0"')
    moving = Moving(world=body, assets=scenes.ASSETS, outputs=("flow", "flow_valid", "depth", "segmentation", "points"))
    moving.see()
    seen = moving.see()
    hit = seen["segmentation"] >= 0
    assert hit.sum() > 50 and not seen["flow"].any()
    np.testing.assert_array_equal(seen["flow_valid"] == 1, hit)
    then = moving.state()
    moving.move(0, by=(0.1, 0.05, -0.1), turned=(0.05, 0.02, 0.2))
    seen = moving.see()
    truth = expected(seen, moving.state(), then)
    assert np.abs(truth).max() > 1.0
    np.testing.assert_allclose(seen["flow"][0], truth, atol=EXACT)
    assert seen["flow_valid"][seen["segmentation"] >= 0].mean() > 0.6


def places(seen: dict[str, np.ndarray], world: int) -> np.ndarray:
    """Points of what is seen, (height, width, 3) float64; anywhere where nothing is."""
    points = seen["points"][world].astype(np.float64)
    return np.where(np.isfinite(points), points, 0.0)


SHEAR = np.array(((1.02, 0.05, 0.0), (-0.03, 0.97, 0.02), (0.04, 0.0, 1.0)))


def soft_worlds(device: wp.Device, num_worlds: int = 2) -> tuple[Any, Any]:
    newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
    import newton_scenes

    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.cloth(), num_worlds)
    builder.add_ground_plane()
    return newton_scenes.finalize(builder, device)


@pytest.mark.filterwarnings("ignore")
def test_cloth_and_jelly_and_particles_of_newton(device: wp.Device) -> None:
    model, state = soft_worlds(device)
    camera = eye((0.2, -1.8, 2.3), (0.2, 0.0, 0.9), outputs=("flow", "flow_valid", "points", "segmentation"))
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [camera])
    images = renderer.render()["eye"]
    still = scenes.on_host(renderer.render()["eye"])
    assert not still["flow"].any()
    np.testing.assert_array_equal(still["flow_valid"] == 1, still["segmentation"] != -1)
    # All particles of one world moved as one affine map has it: so is what lies between them.
    start = model.particle_world.numpy() == 1
    shift = np.array((0.05, -0.03, 0.04))
    points = state.particle_q.numpy().copy()
    points[start] = points[start] @ SHEAR.T + shift
    state.particle_q.assign(points)
    renderer.render()
    seen = scenes.on_host(images)
    assert not seen["flow"][0].any()
    cloth = np.isin(seen["segmentation"][1], (-3,))
    place = places(seen, 1)
    truth = flow_of(camera, place, (place - shift) @ np.linalg.inv(SHEAR).T)
    assert cloth.sum() > 100 and np.abs(truth[cloth]).max() > 1.0
    np.testing.assert_allclose(seen["flow"][1][cloth], truth[cloth], atol=EXACT)
    assert seen["flow_valid"][1][cloth].mean() > 0.75
    ball = seen["segmentation"][1] == -2  # particles do not turn
    assert ball.any() and np.abs(seen["flow"][1][ball]).max() > 0.3
    again = scenes.on_host(renderer.render()["eye"])
    assert not again["flow"].any()


@pytest.mark.filterwarnings("ignore")
def test_soft_worlds_that_are_not_drawn_keep_their_last_frame(device: wp.Device) -> None:
    model, state = soft_worlds(device)
    camera = eye((0.0, -3.0, 3.0), (0.0, 0.0, 0.8), outputs=("flow", "flow_valid"))
    renderer, fresh = (wc.Renderer(wc.from_newton(model, state), [camera]) for _ in range(2))
    renderer.render()
    fresh.render()
    points = state.particle_q.numpy().copy()
    for step in range(2):
        state.particle_q.assign(points + np.float32((0.03, 0.01, 0.02)) * (step + 1))
        renderer.render(worlds=[0] if step == 0 else None)
    seen, both = scenes.on_host(renderer.images["eye"]), scenes.on_host(fresh.render()["eye"])
    np.testing.assert_array_equal(seen["flow"][1], both["flow"][1])
    np.testing.assert_array_equal(seen["flow_valid"][1], both["flow_valid"][1])
    assert np.abs(seen["flow"][0]).max() < 0.7 * np.abs(both["flow"][0]).max()


@pytest.mark.parametrize("name", ["cloth", "solid", "skin", "line"])
def test_flexes_and_skins_of_mujoco(name: str, device: wp.Device) -> None:
    mjm, mjd = visual_geom_scenes.bent(name)
    scene = wc.from_mujoco(mjm, mjd)
    camera = eye((0.2, -1.6, 1.2), (0.0, 0.0, 0.0), outputs=("flow", "flow_valid", "points", "segmentation"))
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    still = scenes.on_host(renderer.render()["eye"])
    assert not still["flow"].any()
    np.testing.assert_array_equal(still["flow_valid"] == 1, still["segmentation"] >= 0)
    shift = np.array((0.06, 0.02, 0.04))
    if name == "skin":
        mjd.xpos[:] += shift
    else:
        mjd.flexvert_xpos[:] += shift
    seen = scenes.on_host(renderer.render()["eye"])
    place = places(seen, 0)
    truth = flow_of(camera, place, place - shift)
    soft = seen["segmentation"][0] >= mjm.ngeom
    assert soft.sum() > 15 and np.abs(truth[soft]).max() > 0.5
    np.testing.assert_allclose(seen["flow"][0][soft], truth[soft], atol=EXACT)
    assert seen["flow_valid"][0][soft].mean() > (0.1 if name == "line" else 0.7)


@pytest.mark.filterwarnings("ignore")
def test_shapes_of_newton_with_scales(device: wp.Device) -> None:
    newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
    import newton_scenes

    builder = newton.ModelBuilder()
    mesh = newton.Mesh.create_sphere(0.3, num_latitudes=8, num_longitudes=8, compute_inertia=False)
    body = builder.add_body(xform=newton_scenes.pose(0.0, 0.0, 0.5, (0.1, 0.2, 0.3, 1.0)))
    builder.add_shape_mesh(body, mesh=mesh, scale=(1.0, 1.4, 2.0))
    model, state = newton_scenes.finalize(builder, device)
    camera = eye((0.0, -2.5, 1.0), (0.0, 0.0, 0.5), outputs=("flow", "flow_valid", "points", "segmentation"))
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    then = state.body_q.numpy()[0].astype(np.float64)
    other = model.state()
    now = then + np.array((0.1, 0.05, -0.02, 0.02, -0.05, 0.03, 0.0))
    now[3:] /= np.linalg.norm(now[3:])
    other.body_q.assign(now[None].astype(np.float32))
    scene.bind(other)
    seen = scenes.on_host(renderer.render()["eye"])
    hit = seen["segmentation"][0] >= 0
    place = places(seen, 0)
    turned = [scenes.matrix((q[6], q[3], q[4], q[5])) for q in (now, then)]
    truth = flow_of(camera, place, then[:3] + (place - now[:3]) @ turned[0] @ turned[1].T)
    assert hit.sum() > 50
    np.testing.assert_allclose(seen["flow"][0][hit], truth[hit], atol=EXACT)
    assert seen["flow_valid"][0][hit].mean() > 0.7


@pytest.mark.filterwarnings("ignore")
def test_clouds_of_gaussians(device: wp.Device) -> None:
    pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
    import newton
    import newton_scenes
    from splat_scenes import random_gaussians

    builder = newton.ModelBuilder()
    body = builder.add_body(xform=newton_scenes.pose(0.0, 0.0, 0.0))
    builder.add_shape_gaussian(body, gaussian=random_gaussians(200, 1, size=0.3))
    builder.add_shape_plane(None, width=0.0, length=0.0, xform=newton_scenes.pose(0.0, 2.0, 0.0, (1.0, 0.0, 0.0, 1.0)))
    model, state = newton_scenes.finalize(builder, device)
    camera = eye((0.0, -4.0, 0.0), (0.0, 0.0, 0.0), outputs=("flow", "flow_valid", "points", "segmentation"))
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    renderer.render()
    still = scenes.on_host(renderer.render()["eye"])
    assert set(np.unique(still["segmentation"])) >= {0, 1} and not still["flow"].any()
    np.testing.assert_array_equal(still["flow_valid"] == 1, still["segmentation"] >= 0)
    shift = np.array((0.2, 0.1, 0.15))
    pose = state.body_q.numpy().copy()
    pose[0, :3] += shift.astype(np.float32)
    state.body_q.assign(pose)
    seen = scenes.on_host(renderer.render()["eye"])
    place = places(seen, 0)
    truth = flow_of(camera, place, place - shift)
    cloud, plane = seen["segmentation"][0] == 0, seen["segmentation"][0] == 1
    np.testing.assert_allclose(seen["flow"][0][cloud], truth[cloud], atol=EXACT)
    assert not seen["flow"][0][plane].any()
    assert seen["flow_valid"][0][cloud].mean() > 0.5
    was_cloud = still["segmentation"][0] == 0
    assert (plane & was_cloud).any() and not seen["flow_valid"][0][plane & was_cloud].any()


def test_memory_of_what_moves(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    mjm, mjd = visual_geom_scenes.bent("cloth")
    scene = wc.from_mujoco(mjm, mjd)
    camera = eye((0.2, -1.6, 1.2), (0.0, 0.0, 0.0), outputs=("flow", "flow_valid", "points", "segmentation"))
    wc.Renderer(scene, [camera]).render()  # what Warp loads once is loaded
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    renderer = wc.Renderer(scene, [camera])
    assert ledger.held == renderer.memory.total
    assert "last frame" in str(renderer.memory)
    surface, rows = 2 * 4 * 3 * 2 + 4 * 7, renderer.memory.past - (1 + 76 + 8 * WIDTH * HEIGHT) - 2 * (64 + 112)
    assert rows % 8 == 36 * surface % 8 and rows >= (8 + 36) * surface


def test_states_on_the_host(device: wp.Device) -> None:
    mjm = scenes.compile_xml('<body pos="0 0 -2"><freejoint/><geom type="box" size=".4 .3 .2"/></body>')
    states = [scenes.forward(mjm) for _ in range(2)]
    camera = scenes.own_camera(outputs=("flow", "flow_valid", "segmentation"))
    renderer = wc.Renderer(wc.from_mujoco(mjm, states), [camera])
    renderer.render()
    states[1].qpos[0] += 0.1
    mujoco.mj_forward(mjm, states[1])
    seen = scenes.on_host(renderer.render()["eye"])
    box = seen["segmentation"][1] == 0
    focal = 16.0 / np.tan(np.radians(30.0))
    assert not seen["flow"][0].any() and box.any()
    truth = np.broadcast_to((0.1 * focal / 1.8, 0.0), (box.sum(), 2))
    np.testing.assert_allclose(seen["flow"][1][box], truth, atol=EXACT)


def test_files(device: wp.Device) -> None:
    pytest.importorskip("pxr", reason="pip install 'warpcam[usd]'")
    from pxr import Usd
    from usd_stages import above, add_square, metric

    stage = metric(Usd.Stage.CreateInMemory())
    add_square(stage, "/square")
    scene = wc.from_usd(stage, num_worlds=2)
    renderer = wc.Renderer(scene, [above(3.0, 16, 4.0, "flow", "flow_valid", "segmentation")])
    renderer.render()
    position = renderer.camera("above").position
    position[1, 0] += 0.25
    seen = scenes.on_host(renderer.render()["above"])
    hit = seen["segmentation"] >= 0
    assert not seen["flow"][0].any() and hit[1].any()
    np.testing.assert_allclose(seen["flow"][1][hit[1]], np.broadcast_to((-1.0, 0.0), (hit[1].sum(), 2)), atol=EXACT)


def frames_of(size: tuple[int, int]) -> list[dict[str, np.ndarray]]:
    """Return the frames of three worlds, some of which rest, are left out or are reset, on the current device."""
    outputs = ("flow", "flow_valid", "depth", "segmentation")
    moving = Moving(num_worlds=3, width=size[0], height=size[1], outputs=outputs)
    frames = [moving.see(), moving.see()]
    for step in range(4):
        moving.move(step % 3, by=(0.05, 0.1, -0.05), turned=(0.0, 0.1, 0.2), world=step % 2)
        if step == 2:
            moving.renderer.reset([1])
        frames.append(moving.see(worlds=[0, 1] if step == 1 else None))
    return frames


def assert_same(mine: dict[str, np.ndarray], theirs: dict[str, np.ndarray], share: float, flows: float = 1.0) -> None:
    """But for some pixels' validity, and for some of the others' flow."""
    same = mine["segmentation"] == theirs["segmentation"]
    assert same.mean() > 0.99
    off = (np.abs(mine["flow"] - theirs["flow"]) / (1.0 + np.abs(theirs["flow"]) / 16.0)).max(axis=-1, keepdims=True)
    assert (off.reshape(same.shape)[same] < EXACT).mean() >= flows
    assert (mine["flow_valid"] == theirs["flow_valid"])[same].mean() > share


@pytest.mark.parametrize("size", [(16, 8), (32, 16), (24, 20)])  # the first a block draws as a whole
def test_a_gpu_finds_what_a_cpu_finds(size: tuple[int, int], device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("compares a GPU with the CPU")
    found = frames_of(size)
    with wp.ScopedDevice("cpu"):
        wanted = frames_of(size)
    for mine, theirs in zip(found, wanted, strict=True):
        assert_same(mine, theirs, 0.99)
    assert any(frame["flow"].any() and 0.2 < frame["flow_valid"].mean() < 1.0 for frame in found)


TILTED = """
  <geom name="floor" type="plane" size="0 0 1" pos="0 0 -4" euler="%s"/>
  <geom name="other" type="plane" size=".4 .3 1" pos=".3 .6 -2.5"/>
  <body pos="-.4 .1 -2"><freejoint/><geom name="box" type="box" size=".3 .2 .2"/></body>
  <body pos=".6 -.3 -1.8"><freejoint/><geom name="ball" size=".2"/></body>
"""


def floors_seen(tilt: str, size: tuple[int, int], outputs: tuple[str, ...]) -> list[dict[str, np.ndarray]]:
    """Return the frames of two worlds whose cameras move over a floor, with things before it, slowly, fast, far back,
    and not.
    """
    moving = Moving(num_worlds=2, width=size[0], height=size[1], outputs=outputs, world=TILTED % tilt)
    frames = [moving.see()]
    for by, angle in (
        ((0.05, 0.02, -0.03), 0.02),
        ((-0.4, 0.3, 0.0), -0.15),
        ((0.0, 0.0, 0.0), 0.0),
        ((0.0, 0.0, 1.5), 0.3),
        ((0.2, 0.1, -1.4), -0.4),
        ((0.0, 0.0, -3.0), 0.0),
    ):
        moving.move_camera(by, (np.cos(angle), 0.3 * np.sin(angle), 0.6 * np.sin(angle), np.sin(angle)))
        moving.move(2, by=(0.1, -0.05, 0.05), turned=(0.1, 0.2, 0.0))
        moving.move(0, by=(0.0, 0.0, 0.02), world=1)
        frames.append(moving.see())
    return frames


@pytest.mark.parametrize("tilt", ["0 0 0", "50 5 0", "80 -10 0"])  # the last shows a horizon
@pytest.mark.parametrize("one", ["flow_valid", None])
@pytest.mark.parametrize("size", [(64, 64), (128, 72), (32, 32), (64, 48)])  # the first is a block's region
def test_a_gpu_looks_at_floors_as_a_whole(
    size: tuple[int, int], tilt: str, one: str | None, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.is_cuda:
        pytest.skip("a CPU looks at each pixel")
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: (64, 64))
    every = ("flow", "flow_valid", "depth", "segmentation")
    found = floors_seen(tilt, size, every if one is None else (one, "segmentation"))
    with wp.ScopedDevice("cpu"):
        wanted = floors_seen(tilt, size, every)
    for mine, theirs in zip(found, wanted, strict=True):
        # what was nearly beside the camera moves by as much as rounding says
        assert_same({**theirs, **mine}, theirs, 0.995, flows=0.995)
    floors = [frame for frame in wanted if (frame["segmentation"] == 0).any()]
    known = [frame["flow_valid"][frame["segmentation"] == 0].mean() for frame in floors]
    assert max(known) > 0.8 and any(0.2 < share < 0.8 for share in known)


@pytest.mark.parametrize("size", [(64, 64), (128, 72), (100, 72), (32, 48)])
def test_memory_of_floors(size: tuple[int, int], device: wp.Device) -> None:
    moving = Moving(width=size[0], height=size[1], outputs=("flow_valid",))
    parts = (
        {(64, 64): 2 * 64, (128, 72): 2 * 64 * 4, (32, 48): 2 * 64}.get(size, 0) if device.is_cuda else 0
    )  # of floors
    pixels = -(-size[0] // 8) * 8 * size[1]
    assert moving.renderer.memory.past == 1 + 76 + 128 * 3 + 4 * pixels + parts
    trail = moving.renderer._passes["eye"].history.flow_history
    assert trail.floor_first.size + trail.floor_second.size == parts
