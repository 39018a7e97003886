"""mjlab's ray-cast sensors by our classes, beside mjlab's own in one simulation."""

import json
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

HOW = "pip install mjlab; .ci/run has an environment of its own for it"
if find_spec("mjlab") and find_spec("triton") and "torch._dynamo" not in sys.modules:
    pytest.skip(
        "pytest -p torch._dynamo: mjlab imports triton, which crashes where Warp's compiler was loaded before",
        allow_module_level=True,
    )
envs = pytest.importorskip("mjlab.envs", reason=HOW, exc_type=ImportError)

import mujoco  # noqa: E402
from mjlab import sensor as theirs  # noqa: E402
from mjlab.sensor import GridPatternCfg, ObjRef, PinholeCameraPatternCfg, RingPatternCfg  # noqa: E402
from mjlab.tasks.cartpole.cartpole_env_cfg import cartpole_balance_env_cfg  # noqa: E402

from warpcam.benchmarks import ray_casts  # noqa: E402
from warpcam.compat import mjlab as ours  # noqa: E402
from warpcam.compat.common.rows import columns_of  # noqa: E402
from warpcam.compat.mjlab import kernels  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # mjlab's own

NUM_ENVS = 3
SIZES = {
    mujoco.mjtGeom.mjGEOM_BOX: (0.5, 0.4, 0.3),
    mujoco.mjtGeom.mjGEOM_SPHERE: (0.3, 0, 0),
    mujoco.mjtGeom.mjGEOM_CAPSULE: (0.2, 0.4, 0),
    mujoco.mjtGeom.mjGEOM_CYLINDER: (0.2, 0.3, 0),
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: (0.2, 0.3, 0.4),
}
CART, POLE = (ObjRef(type="body", name=name, entity="cartpole") for name in ("cart", "pole_1"))
HAND, PALM = ObjRef(type="site", name="hand"), ObjRef(type="geom", name="palm")
FIELDS = ("distances", "normals_w", "hit_pos_w", "pos_w", "quat_w", "frame_pos_w", "frame_quat_w")


def surround(spec: Any) -> None:
    """Shapes of all types about the cart, in groups 0 to 3, one that nobody sees, and a leaning arm with a site."""
    spec.add_mesh(
        name="tetrahedron",
        uservert=[0, 0, 0.4, 0.4, 0, -0.2, -0.3, 0.3, -0.2, -0.3, -0.3, -0.2],
        userface=[0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 3, 2],
    )
    heights = np.random.default_rng(0).uniform(size=25)
    spec.add_hfield(name="hills", nrow=5, ncol=5, size=[1.0, 1.0, 0.3, 0.1], userdata=heights.tolist())
    world = spec.worldbody
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, -0.8])
    for number, (kind, size) in enumerate(SIZES.items()):
        place = [0.7 * number - 1.4, 0.5 * (-1) ** number, -0.3]
        world.add_geom(type=kind, size=size, pos=place, quat=[0.9, 0.1 * number, 0.2, 0.1], group=number % 4)
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.6, 0, 0], pos=[0, 0, 0.2], rgba=[1, 0, 0, 0])
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="tetrahedron", pos=[0.1, -0.6, -0.2])
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="hills", pos=[0.8, 0.2, -0.75])
    arm = world.add_body(name="arm", pos=[0.3, 0.2, 1.2], quat=[0.9, 0.2, -0.1, 0.3])
    arm.add_geom(name="palm", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.2, 0.1])
    arm.add_site(name="hand", pos=[0.05, 0, -0.02], quat=[0.8, 0.1, 0.3, 0.0])


def read(*cfgs: Any, spec_fn: Any = surround) -> list[Any]:
    """Data of sensors in one state of a simulation, each world of which has its own."""
    cfg = cartpole_balance_env_cfg()
    cfg.scene.spec_fn = spec_fn
    cfg.scene.sensors, cfg.scene.num_envs = cfgs, NUM_ENVS
    env = envs.ManagerBasedRlEnv(cfg=cfg, device="cpu")
    env.reset(seed=3)
    read_early = [env.scene[cfg.name].data for cfg in cfgs]
    env.sim.data.qpos[:] = torch.tensor([[0.313, 0.4], [-0.517, -0.2], [0.127, 2.5]])
    env.sim.forward()
    env.sim.sense()
    data = [env.scene[cfg.name].data for cfg in cfgs]
    assert all(now is not early for now, early in zip(data, read_early, strict=True))
    env.close()
    return data


CASES = {
    "grid": {"frame": CART, "pattern": GridPatternCfg(size=(1.6, 1.0)), "ray_alignment": "yaw"},
    "leaning grid": {
        "frame": HAND, "pattern": GridPatternCfg(size=(1.6, 1.0), direction=(0.2, 0.1, -1.0)),
        "include_geom_groups": None,
    },
    "camera": {"frame": (HAND, PALM), "pattern": PinholeCameraPatternCfg(fovy=80.0), "ray_alignment": "world"},
    "rings": {
        "frame": (CART, POLE, HAND), "pattern": RingPatternCfg.single_ring(0.3, 8), "max_distance": 1.2,
        "include_geom_groups": (0, 2),
    },
    "from within": {
        "frame": (HAND, CART), "pattern": RingPatternCfg.single_ring(0.05, 31, direction=(0.3, 0.4, 0.1)),
        "exclude_parent_body": False,
    },
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_data_are_those_of_mjlabs_own_sensor(case: str) -> None:
    """Its rays lose sides of height fields; none of these meets one."""
    settings = CASES[case]
    expected, data = read(
        theirs.RayCastSensorCfg(name="theirs", **settings), ours.RayCastSensorCfg(name="own", **settings)
    )
    assert (expected.distances >= 0.0).float().mean() > 0.3
    for name in FIELDS:
        one, other = getattr(expected, name), getattr(data, name)
        assert one.shape == other.shape and one.dtype == other.dtype, name
        np.testing.assert_allclose(other, one, atol=1e-4, err_msg=name)
    worlds = data.hit_pos_w.reshape(NUM_ENVS, -1)
    assert case in ("leaning grid", "camera") or not torch.equal(worlds[0], worlds[1])
    if case == "rings":
        missed = data.distances < 0.0
        assert missed.any() and (data.distances[missed] == -1.0).all() and not data.normals_w[missed].any()


@pytest.mark.parametrize("reduction", ["min", "max", "mean", "none"])
def test_heights_are_those_of_mjlabs_own_sensor(reduction: str) -> None:
    """Also of frames that are within a box of the terrain, above nothing, and beyond the greatest distance."""
    settings = {
        "frame": (CART, POLE, HAND), "pattern": RingPatternCfg.single_ring(0.28, 6), "ray_alignment": "yaw",
        "max_distance": 1.6, "reduction": reduction,
    }  # fmt: skip

    def terrain(spec: Any) -> None:
        surround(spec)
        box = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [0.3, 0.3, 0.3]}
        spec.worldbody.add_geom(pos=[-0.5, 0.0, 0.0], **box)  # about the cart of the second world

    expected, data = read(
        theirs.TerrainHeightSensorCfg(name="theirs", **settings),
        ours.TerrainHeightSensorCfg(name="own", **settings),
        spec_fn=terrain,
    )
    assert data.heights.shape == ((NUM_ENVS, 3, 7) if reduction == "none" else (NUM_ENVS, 3))
    np.testing.assert_allclose(data.heights, expected.heights, atol=1e-4)
    assert (data.heights[1, 0] == 0.0).any() or reduction in ("max", "mean")
    np.testing.assert_allclose(data.distances, expected.distances, atol=1e-4)


def test_a_task_is_read_by_our_sensors() -> None:
    """Its own configurations, of all three kinds; a subclass of somebody else's stays."""

    class Theirs(theirs.RayCastSensorCfg):
        pass

    cfg = cartpole_balance_env_cfg()
    cfg.scene.sensors = (
        theirs.RayCastSensorCfg(name="scan", frame=CART, max_distance=3.0),
        theirs.TerrainHeightSensorCfg(name="height", frame=(CART, POLE), reduction="mean"),
        Theirs(name="other", frame=CART),
    )
    scan, height, other = ours.use(cfg, antialiasing=4).scene.sensors
    assert scan == ours.RayCastSensorCfg(name="scan", frame=CART, max_distance=3.0)
    assert height == ours.TerrainHeightSensorCfg(name="height", frame=(CART, POLE), reduction="mean")
    assert type(other) is Theirs
    cfg.scene.sensors, cfg.scene.num_envs = (scan, height), 1
    env = envs.ManagerBasedRlEnv(cfg=cfg, device="cpu")
    assert env.scene.sensor_context is None
    assert isinstance(env.scene["scan"], theirs.RayCastSensor) and env.scene["scan"].num_rays == 121
    assert isinstance(env.scene["height"], theirs.TerrainHeightSensor) and env.scene["height"].num_frames == 2
    env.close()


class Recorder:
    """What mjlab draws for debugging."""

    meansize = 0.1

    def __init__(self) -> None:
        self.arrows: list[Any] = []
        self.spheres: list[Any] = []

    def get_env_indices(self, count: int) -> list[int]:
        return [count - 1]

    def add_arrow(self, start: Any, end: Any, **_: Any) -> None:
        self.arrows.append((start, end))

    def add_sphere(self, center: Any, **_: Any) -> None:
        self.spheres.append(center)


def test_rays_are_drawn_for_debugging() -> None:
    cfg = cartpole_balance_env_cfg()
    cfg.scene.spec_fn = surround
    viz = theirs.RayCastSensorCfg.VizCfg(show_rays=True)
    settings = {"frame": (HAND, PALM), "pattern": GridPatternCfg(size=(0.2, 0.2)), "debug_vis": True, "viz": viz}
    cfg.scene.sensors = (
        theirs.RayCastSensorCfg(name="theirs", **settings), ours.RayCastSensorCfg(name="own", **settings),
    )  # fmt: skip
    cfg.scene.num_envs = 2
    env = envs.ManagerBasedRlEnv(cfg=cfg, device="cpu")
    env.sim.sense()
    drawn = [Recorder(), Recorder()]
    for sensor, recorder in zip((env.scene["theirs"], env.scene["own"]), drawn, strict=True):
        sensor.debug_vis(recorder)
    assert len(drawn[0].arrows) == 18
    np.testing.assert_allclose(np.array(drawn[1].arrows), np.array(drawn[0].arrows), atol=1e-4)
    np.testing.assert_allclose(np.array(drawn[1].spheres), np.array(drawn[0].spheres), atol=1e-4)
    env.close()


@pytest.mark.parametrize(
    ("pattern", "columns"),
    [
        (GridPatternCfg(size=(1.6, 1.0)), 17),
        (GridPatternCfg(size=(1.5, 1.0), direction=(0.2, 0.1, -1.0)), 16),
        (PinholeCameraPatternCfg(), 16),
        (ray_casts.SpinningPattern(), 360),
        (RingPatternCfg.single_ring(0.3, 8), 9),
        (RingPatternCfg.single_ring(0.3, 31), 8),
        (GridPatternCfg(size=(0.3, 0.3)), 8),
    ],
)
def test_rays_lie_in_rows_as_images_are_traced(pattern: Any, columns: int) -> None:
    """A tile of 8 x 4 rays that belong together is traced many times faster than one of rays from all around."""
    assert columns_of(*(table.numpy() for table in pattern.generate_rays(None, "cpu"))) == columns


@pytest.mark.parametrize("terrain", ["blocks", "hills"])
def test_the_benchmark_compares_all(tmp_path: Path, capsys: pytest.CaptureFixture[str], terrain: str) -> None:
    for name in ("isaaclab", "lazy_loader"):
        pytest.importorskip(name, reason=HOW)
    out = tmp_path / "rays.json"
    ray_casts.main(
        ["--device", "cpu", "--worlds", "1", "--rounds", "1", "--terrain", terrain, "--out", str(out)],
    )
    results = json.loads(out.read_text())["results"]
    assert [result["rays_per_world"] for result in results] == [176 + 32 * 360, 176, 32 * 360]
    for result in results:
        assert set(result["agreeing"]) == set(result["ratio"]) == {"mjlab", "isaaclab"}
        assert min(result["agreeing"].values()) > 0.999 and min(result["ratio"].values()) > 0.0
    assert capsys.readouterr().out.count("% agree") == 2 * 3


def test_kernels_compile_for_cuda(tmp_path: Path) -> None:
    (path,) = wp.compile_aot_module(kernels.place_frame.module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert path.stat().st_size > 0


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"ray_alignment": "roll"}, "ray_alignment is 'roll'; allowed are 'base', 'yaw', 'world'"),
        ({"max_distance": 0.0}, r"max_distance must be a positive number \[m\], got 0.0"),
        ({"max_distance": "far"}, r"max_distance must be a positive number \[m\], got 'far'"),
        ({"include_geom_groups": (0, 6)}, r"include_geom_groups must be some of 0 to 5, or None, got \(0, 6\)"),
        ({"reduction": "median"}, "reduction is 'median'; allowed are 'min', 'max', 'mean', 'none'"),
        ({"frame": ObjRef(type="joint", name="slider")}, "frame is a joint; allowed are body, site, geom"),
    ],
)
def test_values_that_mean_nothing(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(wc.WarpcamError, match=rf"TerrainHeightSensorCfg\('scan'\): {text}"):
        read(ours.TerrainHeightSensorCfg(name="scan", **{"frame": HAND, **settings}))
