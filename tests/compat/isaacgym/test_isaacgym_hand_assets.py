"""Calls of IsaacGymEnvs' hands on an asset before their environments are made."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim

from warpcam.compat.isaacgym import gymapi

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
HAND = """
<mujoco model="hand">
  <worldbody>
    <body name="palm">
      <geom type="box" size="0.05 0.05 0.02"/><geom type="box" size="0.02 0.05 0.02" pos="0.07 0 0"/>
      <body name="knuckle" pos="0.1 0 0">
        <joint name="J1" axis="0 1 0" range="0 90"/>
        <geom type="capsule" fromto="0 0 0 0.04 0 0" size="0.01"/>
        <body name="tip" pos="0.04 0 0">
          <joint name="J0" axis="0 1 0" range="0 90"/>
          <geom type="capsule" fromto="0 0 0 0.03 0 0" size="0.01"/><geom type="sphere" size="0.012" pos="0.03 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="T_J1c" limited="true" range="-0.001 0.002" damping="0.3" stiffness="2">
      <joint joint="J0" coef="0.007"/><joint joint="J1" coef="-0.007"/>
    </fixed>
  </tendon>
  <actuator><position name="A_J1" joint="J1" kp="5"/><motor name="A_J0" joint="J0"/></actuator>
</mujoco>
"""


@pytest.fixture
def hand(tmp_path: Path) -> tuple[gymapi.Sim, gymapi.Asset]:
    (tmp_path / "hand.xml").write_text(HAND)
    sim = new_sim(wp.get_device("cpu"))
    return sim, GYM.load_asset(sim, str(tmp_path), "hand.xml", gymapi.AssetOptions(fix_base_link=True))


def test_motors_are_named_with_their_joints(hand: tuple[gymapi.Sim, gymapi.Asset]) -> None:
    _, asset = hand
    count = GYM.get_asset_actuator_count(asset)
    joints = [GYM.get_asset_actuator_joint_name(asset, index) for index in range(count)]
    assert joints == ["J1", "J0"] and GYM.get_asset_actuator_name(asset, 1) == "A_J0"
    assert [GYM.find_asset_dof_index(asset, name) for name in joints] == [0, 1]
    assert [motor.kp for motor in GYM.get_asset_actuator_properties(asset)] == [5.0, 0.0]
    with pytest.raises(wc.WarpcamError, match="get_asset_actuator_joint_name: index 2 came, the asset has 2"):
        GYM.get_asset_actuator_joint_name(asset, 2)


def test_files_are_read_for_motors_when_those_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And once: MuJoCo makes a whole model, meshes and all, and may not be installed."""
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "hand.xml").write_text(HAND)
    sim, seen = new_sim(wp.get_device("cpu")), []
    read = mujoco.MjSpec.from_file
    monkeypatch.setattr(mujoco.MjSpec, "from_file", lambda path: seen.append(path) or read(path))
    asset = GYM.load_asset(sim, str(tmp_path), "hand.xml")
    GYM.create_actor(GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1), asset, at(0, 0, 1), "hand")
    assert not seen
    GYM.get_asset_actuator_properties(asset)[0].kp = 7.0  # of a copy
    names = [GYM.get_asset_actuator_name(asset, index) for index in range(GYM.get_asset_actuator_count(asset))]
    assert names == ["A_J1", "A_J0"] and GYM.get_asset_tendon_count(asset) == 1 and len(seen) == 1
    assert GYM.get_asset_actuator_properties(asset)[0].kp == 5.0


@pytest.mark.parametrize("fixed", [True, False])
def test_what_a_base_is_held_by_is_no_joint(tmp_path: Path, fixed: bool) -> None:
    (tmp_path / "hand.xml").write_text(HAND if fixed else HAND.replace('"palm">', '"palm"><freejoint name="root"/>'))
    sim = new_sim(wp.get_device("cpu"))
    asset = GYM.load_asset(sim, str(tmp_path), "hand.xml", gymapi.AssetOptions(fix_base_link=fixed))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    assert GYM.get_actor_joint_dict(env, GYM.create_actor(env, asset, at(0, 0, 1), "hand")) == {"J1": 0, "J0": 1}
    assert GYM.get_asset_joint_names(asset) == ["J1", "J0"] and GYM.get_asset_joint_count(asset) == 2
    assert GYM.get_asset_dof_names(asset) == ["J1", "J0"]


def test_tendons_are_told_of_and_held(hand: tuple[gymapi.Sim, gymapi.Asset]) -> None:
    sim, asset = hand
    assert GYM.get_asset_tendon_count(asset) == 1 and GYM.get_asset_tendon_name(asset, 0) == "T_J1c"
    properties = GYM.get_asset_tendon_properties(asset)
    tendon = properties[0]
    assert (tendon.stiffness, tendon.damping, tendon.is_fixed_limited) == (2.0, 0.3, True)
    assert (tendon.fixed_lower_limit, tendon.fixed_upper_limit) == (-0.001, 0.002)
    tendon.limit_stiffness, tendon.damping = 30, 0.1
    assert GYM.get_asset_tendon_properties(asset)[0].damping == 0.3  # a copy
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, asset, at(0, 0, 1), "hand")  # nothing is said of what was not changed
    assert GYM.set_asset_tendon_properties(asset, properties)
    assert GYM.get_asset_tendon_properties(asset)[0].limit_stiffness == 30
    with pytest.warns(RuntimeWarning, match="tendons are held, and pull nothing"):
        GYM.create_actor(env, asset, at(0, 1, 1), "hand")
    with pytest.raises(wc.WarpcamError, match="a list of 1 TendonProperties is needed"):
        GYM.set_asset_tendon_properties(asset, [])
    assert GYM.get_asset_tendon_count(GYM.create_box(sim, 1, 1, 1)) == 0


def test_shapes_of_each_body(hand: tuple[gymapi.Sim, gymapi.Asset]) -> None:
    sim, asset = hand
    ranges = GYM.get_asset_rigid_body_shape_indices(asset)
    assert [(one.start, one.count) for one in ranges] == [(0, 2), (2, 1), (3, 2)]
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, asset, at(0, 0, 1), "hand")
    assert GYM.get_actor_rigid_body_shape_indices(env, 0) == ranges


def test_states_of_all_bodies_at_once(hand: tuple[gymapi.Sim, gymapi.Asset]) -> None:
    sim, asset = hand
    envs = []
    for index in range(2):
        envs.append(GYM.create_env(sim, gymapi.Vec3(-1, -1, 0), gymapi.Vec3(1, 1, 1), 2))
        GYM.create_actor(envs[-1], asset, at(0, 0, 1 + index), "hand")
        GYM.create_actor(envs[-1], GYM.create_sphere(sim, 0.1), at(5, 0, 1 + index), "ball")
    before = GYM.get_env_rigid_body_states(envs[1], gymapi.STATE_ALL)
    states = GYM.get_sim_rigid_body_states(sim, gymapi.STATE_ALL)
    assert before.shape == (4,) and states.shape == (8,) and states.dtype == gymapi.RigidBodyState.dtype
    np.testing.assert_allclose(states["pose"]["p"]["z"], np.repeat((1.0, 2.0), 4))
    np.testing.assert_allclose(states[4:]["pose"]["p"]["x"], (0.0, 0.1, 0.14, 5.0), atol=1e-6)
    for name in ("x", "y", "z"):
        np.testing.assert_allclose(states[4:]["pose"]["p"][name], before["pose"]["p"][name], atol=1e-6)
    assert not GYM.get_sim_rigid_body_states(sim, gymapi.STATE_VEL)["pose"]["p"]["z"].any()
    index = GYM.find_actor_rigid_body_index(envs[1], 1, "sphere", gymapi.DOMAIN_SIM)
    assert states[index]["pose"]["p"]["x"] == 5.0
