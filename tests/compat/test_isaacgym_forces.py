"""Isaac Gym's forces along joints, jacobians and mass matrices, beside MuJoCo's own figures."""

from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim  # noqa: E402, newton may be missing

from warpcam.compat.isaacgym import gymapi, gymtorch  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
CRANE = """
<mujoco model="crane">
  <worldbody>
    <body name="base" pos="0 0 0">
      <geom type="box" size="0.1 0.1 0.1" mass="1"/>
      <body name="boom" pos="0.1 0 0.3">
        <joint name="lift" axis="0 1 0"/>
        <geom type="box" size="0.3 0.05 0.04" pos="0.3 0.02 0.01" mass="1.5"/>
        <body name="hook" pos="0.6 0 -0.1" quat="0.9 0.1 0.3 0.2">
          <joint name="turn" axis="0.2 0.3 1" armature="0.05"/>
          <joint name="tilt" axis="1 0 0"/>
          <geom type="box" size="0.05 0.1 0.2" pos="0.02 0.05 -0.1" mass="0.7"/>
        </body>
      </body>
      <body name="slider" pos="-0.2 0.1 0.1">
        <joint name="slide" type="slide" axis="0.1 1 0.2"/>
        <geom type="capsule" fromto="0 0 0 0.1 0.2 0.1" size="0.04" mass="0.4"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
COUNTS = pytest.mark.parametrize("count", [1, 3], ids=["MuJoCo", "MuJoCo-Warp"])


def wrapped(tensor: gymapi.Tensor) -> torch.Tensor:
    return gymtorch.wrap_tensor(tensor)


def cranes(device: wp.Device, folder: Path, count: int, fixed: bool = True) -> gymapi.Sim:
    """Behind a ball each, so that a crane is neither the first actor nor its bodies the first bodies."""
    text = CRANE if fixed else CRANE.replace('<body name="base" pos="0 0 0">', '<body name="base"><freejoint/>')
    (folder / "crane.xml").write_text(text)
    sim = new_sim(device, dt=0.01, substeps=2)
    asset = GYM.load_asset(sim, str(folder), "crane.xml", gymapi.AssetOptions(fix_base_link=fixed))
    turn = gymapi.Quat.from_axis_angle(gymapi.Vec3(0.3, 0.2, 1.0), 0.5)
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 2)
        GYM.create_actor(env, GYM.create_sphere(sim, 0.1), at(0, 5, 9), "ball", index, 0)
        place = at(0.1 * index, 0, 1) if fixed else gymapi.Transform(gymapi.Vec3(0.1 * index, 0, 1), turn)
        GYM.create_actor(env, asset, place, "crane", index, 0)
    return sim


@COUNTS
def test_what_holds_a_joint_is_felt(device: wp.Device, tmp_path: Path, count: int) -> None:
    """A drive that carries the boom against gravity, and forces that the program sets."""
    sim = cranes(device, tmp_path, count)
    for index in range(count):
        drives = GYM.get_actor_dof_properties(GYM.get_env(sim, index), 1)
        drives["driveMode"][0], drives["stiffness"][0], drives["damping"][0] = gymapi.DOF_MODE_POS, 4000.0, 400.0
        drives["driveMode"][1:], drives["damping"][1:] = gymapi.DOF_MODE_EFFORT, 0.0
        GYM.set_actor_dof_properties(GYM.get_env(sim, index), 1, drives)
        assert GYM.enable_actor_dof_force_sensors(GYM.get_env(sim, index), 1)
        assert GYM.get_actor_dof_forces(GYM.get_env(sim, index), 1).tolist() == [0.0] * 4
    GYM.prepare_sim(sim)
    forces, dofs = wrapped(GYM.acquire_dof_force_tensor(sim)), wrapped(GYM.acquire_dof_state_tensor(sim))
    assert forces.shape == (4 * count,) and not forces.any()
    # Held at rest by hand: the drive's spring alone, before anything falls.
    given = torch.zeros(count, 4)
    given[:, 1:] = 0.1 * torch.arange(1.0, 4.0) * (1.0 + torch.arange(count))[:, None]
    GYM.set_dof_actuation_force_tensor(sim, gymtorch.unwrap_tensor(given.to(forces.device)))
    start = dofs.clone()
    start[::4, 0] = 0.01
    GYM.set_dof_state_tensor(sim, gymtorch.unwrap_tensor(start))
    sim.params.substeps = 1
    GYM.simulate(sim)
    GYM.refresh_dof_force_tensor(sim)
    expected = given.numpy().copy()
    expected[:, 0] = -4000.0 * 0.01
    np.testing.assert_allclose(forces.cpu().numpy().reshape(count, 4), expected, rtol=1e-4, atol=1e-5)
    for _ in range(100):
        GYM.set_dof_state_tensor(sim, gymtorch.unwrap_tensor(held(dofs)))
        GYM.simulate(sim)
        GYM.refresh_dof_state_tensor(sim)
    GYM.refresh_dof_force_tensor(sim)
    held_by = GYM.get_actor_dof_forces(GYM.get_env(sim, count - 1), 1)
    assert held_by.tolist() == forces[-4:].tolist()
    # 1.5 kg at 0.3 m and 0.7 kg at about 0.6 m about y, which turns x down.
    assert held_by[0] == pytest.approx(-9.81 * (1.5 * 0.3 + 0.7 * 0.6), rel=0.2)


def held(dofs: torch.Tensor) -> torch.Tensor:
    """As they are, but for what hangs on the boom, which stays."""
    states = dofs.clone().view(-1, 4, 2)
    states[:, 1:] = 0.0
    return states.view(-1, 2).contiguous()


def test_forces_along_joints_that_nobody_knows_are_an_error(device: wp.Device, tmp_path: Path) -> None:
    sim = cranes(device, tmp_path, 1)
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, GYM.create_box(sim, 1, 1, 1), at(0, 0, 0), "box")
    forces = wrapped(GYM.acquire_dof_force_tensor(sim))
    GYM.simulate(sim)
    for ask in (lambda: GYM.refresh_dof_force_tensor(sim), lambda: GYM.get_actor_dof_forces(GYM.get_env(sim, 0), 1)):
        with pytest.raises(wc.WarpcamError, match=r"forces of joints: .* XPBD does not tell them"):
            ask()
    assert not forces.any()
