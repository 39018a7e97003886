"""Our ray-caster camera beside Isaac Lab's own, by one configuration in one simulation of Isaac Lab.

Isaac Lab 3.0 simulates with Newton on any device, and needs no simulator app for that.
"""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch

import warpcam as wc

HOW = "see 'laboratories' in .ci/run"
newton = pytest.importorskip("newton", reason=HOW)
if not newton.__version__.startswith("1.6."):
    pytest.skip(
        f"Isaac Lab 3.0 simulates with Newton 1.6, here is {newton.__version__}: {HOW}", allow_module_level=True
    )
for name in ("newton_usd_schemas", "pxr", "isaaclab.renderers", "isaaclab_newton"):
    pytest.importorskip(name, reason=HOW, exc_type=ImportError)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of what Isaac Lab itself imports
    import isaaclab.sim as sim_utils
    from isaaclab.assets import AssetBaseCfg, RigidObjectCfg
    from isaaclab.scene import InteractiveScene, InteractiveSceneCfg
    from isaaclab.sensors.ray_caster import RayCasterCameraCfg
    from isaaclab.sensors.ray_caster.patterns import PinholeCameraPatternCfg
    from isaaclab.sim.schemas import MassCfg, UsdPhysicsCollisionCfg, UsdPhysicsRigidBodyCfg
    from isaaclab.utils import configclass
    from isaaclab_newton.physics import NewtonCfg, XPBDSolverCfg

    from warpcam.compat.isaaclab import RayCasterCamera

pytestmark = pytest.mark.filterwarnings("ignore")  # Isaac Lab's and Newton's own

NUM_ENVS, WIDTH, HEIGHT = 2, 40, 30
KINDS = ["distance_to_camera", "distance_to_image_plane", "normals"]


def unit(*numbers: float) -> tuple[float, ...]:
    return tuple((np.array(numbers) / np.linalg.norm(numbers)).tolist())


def config() -> Any:
    """A camera that looks down along x from a body that falls."""
    return RayCasterCameraCfg(
        prim_path="{ENV_REGEX_NS}/Base",
        mesh_prim_paths=["/World/block"],
        offset=RayCasterCameraCfg.OffsetCfg(pos=(0.1, 0.05, 0.3), rot=unit(0.05, 0.3, -0.1, 0.95), convention="world"),
        data_types=KINDS,
        max_distance=3.2,
        depth_clipping_behavior="max",
        pattern_cfg=PinholeCameraPatternCfg(
            focal_length=14.0, horizontal_aperture=20.0, horizontal_aperture_offset=0.03, width=WIDTH, height=HEIGHT
        ),
    )


@configclass
class Block(InteractiveSceneCfg):
    """A block that all environments see, and a falling body in each that carries a camera."""

    block: Any = AssetBaseCfg(
        prim_path="/World/block",
        spawn=sim_utils.MeshCuboidCfg(size=(5.0, 9.0, 1.0), collision_props=[UsdPhysicsCollisionCfg()]),
        init_state=AssetBaseCfg.InitialStateCfg(pos=(1.0, 0.0, -1.2)),
    )
    base: Any = RigidObjectCfg(
        prim_path="{ENV_REGEX_NS}/Base",
        spawn=sim_utils.CuboidCfg(
            size=(0.1, 0.1, 0.1),
            rigid_props=[UsdPhysicsRigidBodyCfg()],
            mass_props=[MassCfg(mass=1.0)],
            collision_props=[UsdPhysicsCollisionCfg()],
        ),
        init_state=RigidObjectCfg.InitialStateCfg(pos=(0.0, 0.0, 0.4), rot=unit(0.0, 0.1, 0.2, 0.97)),
    )
    theirs: Any = config()


class Lab:
    """A running scene, and our camera of its model and state."""

    def __init__(self, sim: Any):
        self.sim = sim
        self.scene = InteractiveScene(Block(num_envs=NUM_ENVS, env_spacing=2.0, lazy_sensor_update=False))
        sim.reset()
        self.scene.reset()
        self.theirs = self.scene["theirs"]
        backend = self.theirs.backend
        bodies = {str(label).rsplit("/", 1)[-1] for label in backend.model.body_label}
        scene = wc.from_newton(backend.model, backend.state_0)
        with pytest.warns(UserWarning, match="mesh_prim_paths is not read"):
            self.ours = RayCasterCamera(config(), scene, exclude_bodies=tuple(bodies))

    def step(self) -> None:
        self.scene.write_data_to_sim()
        self.sim.step(render=False)
        self.scene.update(self.sim.get_physics_dt())
        self.ours.update()


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    physics = NewtonCfg(solver_cfg=XPBDSolverCfg())
    with sim_utils.build_simulation_context(
        sim_cfg=sim_utils.SimulationCfg(device="cpu", physics=physics, dt=0.01)
    ) as sim:
        running = Lab(sim)
        for _ in range(3):
            running.step()
        yield running


def assert_alike(lab: Lab) -> None:
    mine, expected = lab.ours.data, lab.theirs.data
    for name in ("pos_w", "intrinsic_matrices"):
        torch.testing.assert_close(getattr(mine, name), getattr(expected, name).torch, atol=1e-5, rtol=0.0)
    for name in ("quat_w_world", "quat_w_ros", "quat_w_opengl"):
        cosines = (getattr(mine, name) * getattr(expected, name).torch).sum(dim=-1)
        torch.testing.assert_close(cosines.abs(), torch.ones(NUM_ENVS), atol=1e-5, rtol=0.0)
    assert mine.image_shape == expected.image_shape and mine.info == expected.info
    assert list(mine.output) == list(expected.output)
    for kind in KINDS:
        own, other = mine.output[kind].cpu().numpy(), expected.output[kind].torch.cpu().numpy()
        assert (own.dtype, own.shape) == (other.dtype, other.shape)
        with np.errstate(invalid="ignore"):
            off = ~np.isclose(own, other, atol=1e-4, rtol=0.0).all(axis=-1)
        assert off.sum() <= 4, kind  # where a ray grazes an edge
    assert 0.2 < np.isfinite(mine.output["normals"][..., 0].cpu()).float().mean() < 0.9
    assert torch.equal(lab.ours.frame, lab.theirs.frame)


def test_data_are_those_of_its_own_camera(lab: Lab) -> None:
    lab.ours.reset()
    lab.theirs.reset()
    lab.step()
    assert_alike(lab)


@pytest.mark.parametrize("convention", ["ros", "opengl", "world"])
def test_poses_in_the_world(lab: Lab, convention: str) -> None:
    rotations = {
        "world": (0.0, 0.3, 0.1, 0.95),
        "ros": (0.5, -0.65, 0.45, -0.4),
        "opengl": (0.4, -0.3, -0.5, 0.65),
    }
    places, turn = torch.tensor(((0.2, 1.0, 0.6), (-0.3, -1.0, 0.7))), torch.tensor(rotations[convention])
    for camera in (lab.ours, lab.theirs):
        camera.set_world_poses(places, (turn / turn.norm()).repeat(2, 1), convention=convention)
    lab.step()
    assert_alike(lab)


def test_cameras_look_at_targets_and_intrinsics_change(lab: Lab) -> None:
    eyes, targets = torch.tensor(((0.0, 0.5, 0.9),)), torch.tensor(((1.0, 0.0, -0.7),))
    matrices = lab.theirs.data.intrinsic_matrices.torch.clone()
    matrices[1, 0, 0] *= 0.7
    for camera in (lab.ours, lab.theirs):
        camera.set_world_poses_from_view(eyes, targets, [1])
        camera.set_intrinsic_matrices(matrices[1:], env_ids=[1])
    lab.step()
    assert_alike(lab)
