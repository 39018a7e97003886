"""Isaac Gym's forces along joints, jacobians and mass matrices, beside MuJoCo's own figures."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

mujoco, newton = pytest.importorskip("mujoco"), pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim, wrapped  # noqa: E402, newton may be missing

from warpcam.compat.isaacgym import gymapi, gymtorch  # noqa: E402
from warpcam.compat.isaacgym.physics import model_writes  # noqa: E402

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
          <joint name="turn" axis="0 0.3 1" armature="0.05"/>
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
ARM = """
<mujoco model="arm">
  <worldbody>
    <body name="base"><geom type="box" size="0.05 0.05 0.05" pos="0 0 -0.5" mass="1"/>
      <body name="turret"><joint name="j0" axis="0 0 1"/><geom type="sphere" size="0.05" mass="1"/>
        <body name="upper"><joint name="j1" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1.2"/>
          <body name="lower" pos="0.4 0 0"><joint name="j2" axis="0 1 0"/>
            <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="0.8"/>
            <body name="hand" pos="0.35 0 0"><joint name="j3" axis="1 0 0"/>
              <geom type="box" size="0.04 0.05 0.02" mass="0.5"/></body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
# Bodies that are fixed to others: turned, off their own centres, in a chain, on the base and on what moves.
FIXED = """
<mujoco model="fixed">
  <compiler fusestatic="true"/>
  <worldbody>
    <body name="base"><freejoint/>
      <geom type="box" size="0.1 0.2 0.1" pos="0.05 0 0.02" mass="1"/>
      <body name="mast" pos="0.3 -0.1 0.4" quat="0.8 0.2 0.5 0.1">
        <geom type="box" size="0.05 0.3 0.02" pos="0.2 0.1 -0.1" mass="0.8"/>
        <body name="lamp" pos="0.1 0.2 0.3" quat="0.5 -0.4 0.3 0.6">
          <geom type="sphere" size="0.1" pos="0 0.3 0" mass="0.6"/></body>
      </body>
      <body name="boom" pos="0.1 0 0.3">
        <joint name="lift" axis="0 1 0"/>
        <geom type="box" size="0.3 0.05 0.04" pos="0.3 0.02 0.01" mass="1.5"/>
        <body name="claw" pos="0.6 0.1 -0.1" quat="0.9 0.1 0.3 0.2">
          <geom type="capsule" fromto="0 0 0 0.1 0.2 0.1" size="0.04" mass="0.4"/>
          <body name="tip" pos="0.1 0.2 0.1">
            <joint name="turn" axis="1 0 0.5"/><geom type="box" size="0.05 0.1 0.2" pos="0.1 0 0" mass="0.3"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
COUNTS = pytest.mark.parametrize("count", [1, 3], ids=["MuJoCo", "MuJoCo-Warp"])


def cranes(device: wp.Device, folder: Path, count: int, fixed: bool = True) -> gymapi.Sim:
    """Behind a ball each, so that a crane is neither the first actor nor its bodies the first bodies."""
    text = CRANE if fixed else CRANE.replace('<body name="base" pos="0 0 0">', '<body name="base"><freejoint/>')
    (folder / "crane.xml").write_text(text)
    sim = new_sim(device, dt=0.01, substeps=2)
    asset = GYM.load_asset(sim, str(folder), "crane.xml", gymapi.AssetOptions(fix_base_link=fixed))
    ball = GYM.create_sphere(sim, 0.1)
    turn = gymapi.Quat.from_axis_angle(gymapi.Vec3(0.3, 0.2, 1.0), 0.5)
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 2)
        GYM.create_actor(env, ball, at(0, 5, 9), "ball", index, 0)
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
    """Keep all bodies as they are, except those on the boom, which stays."""
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


def as_mujoco_has_it(model: Any, root: np.ndarray, dofs: np.ndarray, fixed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian about the bodies' centres and mass matrix, of base and joints as they are there.

    MuJoCo's columns of a floating base are its origin's velocity, and angular velocity in its own frame; Isaac Gym's
    are its centre's, and along the world's axes.
    """
    data = mujoco.MjData(model)
    if not fixed:
        data.qpos[:7] = (*root[:3], root[6], *root[3:6])
    data.qpos[0 if fixed else 7 :] = dofs
    mujoco.mj_forward(model, data)
    into = np.eye(model.nv)
    if not fixed:
        turn, lever = data.xmat[1].reshape(3, 3), data.xipos[1] - data.xpos[1]
        into[:3, 3:6] = np.array(((0, -lever[2], lever[1]), (lever[2], 0, -lever[0]), (-lever[1], lever[0], 0)))
        into[3:6, 3:6] = turn.T
    rows = []
    for body in range(2 if fixed else 1, model.nbody):
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian[:3], jacobian[3:], body)
        rows.append(jacobian @ into)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return np.array(rows), into.T @ full @ into


@pytest.mark.parametrize("fixed", [True, False], ids=["fixed", "floating"])
def test_jacobians_and_mass_matrices_are_mujocos(device: wp.Device, tmp_path: Path, fixed: bool) -> None:
    sim = cranes(device, tmp_path, 3, fixed)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "crane.xml"))
    GYM.prepare_sim(sim)
    jacobians = wrapped(GYM.acquire_jacobian_tensor(sim, "crane"))
    masses = wrapped(GYM.acquire_mass_matrix_tensor(sim, "crane"))
    roots, dofs = wrapped(GYM.acquire_actor_root_state_tensor(sim)), wrapped(GYM.acquire_dof_state_tensor(sim))
    bodies = wrapped(GYM.acquire_rigid_body_state_tensor(sim)).view(3, -1, 13)[:, 1:]
    assert jacobians.shape == ((3, 3, 6, 4) if fixed else (3, 4, 6, 10))
    assert masses.shape == ((3, 4, 4) if fixed else (3, 10, 10))
    generator = np.random.default_rng(7)
    states = generator.uniform(-1.0, 1.0, (12, 2)).astype(np.float32)
    GYM.set_dof_state_tensor(sim, gymtorch.unwrap_tensor(torch.as_tensor(states, device=dofs.device)))
    for moves in (0, 3):  # as it was put, and as it moves
        for _ in range(moves):
            GYM.simulate(sim)
        for refresh in (
            GYM.refresh_dof_state_tensor,
            GYM.refresh_actor_root_state_tensor,
            GYM.refresh_rigid_body_state_tensor,
            GYM.refresh_jacobian_tensors,
            GYM.refresh_mass_matrix_tensors,
        ):
            assert refresh(sim)
        places = dofs[:, 0].cpu().numpy().reshape(3, 4)
        for index, root in enumerate(roots[1::2].cpu().numpy()):
            expected, full = as_mujoco_has_it(model, root, places[index], fixed)
            np.testing.assert_allclose(jacobians[index].cpu(), expected, atol=2e-5)
            np.testing.assert_allclose(masses[index].cpu(), full, atol=2e-5, rtol=1e-4)
        speeds = dofs[:, 1].view(3, 4, 1)
        if not fixed:
            speeds = torch.cat((roots[1::2, 7:].reshape(3, 6, 1), speeds), dim=1)
        links = bodies[:, 1:, 7:] if fixed else bodies[:, :, 7:]
        moving = (jacobians @ speeds[:, None])[..., 0]
        torch.testing.assert_close(moving, links, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("kind", ["xml", "urdf"])
def test_bodies_made_one_weigh_and_turn_as_mujocos(device: wp.Device, tmp_path: Path, kind: str) -> None:
    model = mujoco.MjModel.from_xml_string(FIXED)
    text = FIXED if kind == "xml" else as_urdf(mujoco.MjModel.from_xml_string(FIXED.replace('"true"', '"false"')))
    (tmp_path / f"fixed.{kind}").write_text(text)
    sim = new_sim(device)
    options = gymapi.AssetOptions(collapse_fixed_joints=True)
    asset = GYM.load_asset(sim, str(tmp_path), f"fixed.{kind}", options)
    assert GYM.get_asset_rigid_body_names(asset) == ["base", "boom", "tip"]
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    turn = gymapi.Quat.from_axis_angle(gymapi.Vec3(0.3, 0.2, 1.0), 0.5)
    GYM.create_actor(env, asset, gymapi.Transform(gymapi.Vec3(0, 0, 1), turn), "robot", 0, 0)
    GYM.prepare_sim(sim)
    states = torch.tensor([[0.4, 0.0], [-0.7, 0.0]])
    root = wrapped(GYM.acquire_actor_root_state_tensor(sim))
    dofs = states.to(root.device)
    GYM.set_dof_state_tensor(sim, gymtorch.unwrap_tensor(dofs))
    jacobians, full = as_mujoco_has_it(model, root[0].cpu().numpy(), states[:, 0].numpy(), False)
    found = wrapped(GYM.acquire_jacobian_tensor(sim, "robot")), wrapped(GYM.acquire_mass_matrix_tensor(sim, "robot"))
    np.testing.assert_allclose(found[0][0].cpu(), jacobians, atol=2e-5)
    np.testing.assert_allclose(found[1][0].cpu(), full, atol=2e-5, rtol=1e-4)
    masses = [body.mass for body in GYM.get_actor_rigid_body_properties(env, 0)]
    np.testing.assert_allclose(masses, (2.4, 1.9, 0.3), rtol=1e-6)
    GYM.simulate(sim)
    assert np.isfinite(wrapped(GYM.acquire_rigid_body_state_tensor(sim)).cpu()).all()


def as_urdf(model: Any) -> str:
    """The bodies of a model and how they hang together, without geometry."""
    texts = []
    for body in range(1, model.nbody):
        name = model.body(body).name
        turned = np.zeros(9)
        mujoco.mju_quat2Mat(turned, model.body_iquat[body])
        inertia = turned.reshape(3, 3) @ np.diag(model.body_inertia[body]) @ turned.reshape(3, 3).T
        terms = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{inertia[i, j]:.9g}"' for i in range(3) for j in range(i, 3))
        center = " ".join(f"{part:.9g}" for part in model.body_ipos[body])
        texts.append(
            f'<link name="{name}"><inertial><origin xyz="{center}"/><mass value="{model.body_mass[body]:.9g}"/>'
            f"<inertia {terms}/></inertial></link>"
        )
        if body == 1:
            continue
        place = " ".join(f"{part:.9g}" for part in model.body_pos[body])
        w, x, y, z = model.body_quat[body]
        angles = (
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(2 * (w * y - z * x)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        )
        first = model.body_jntadr[body]
        axis = " ".join(map(str, model.jnt_axis[first])) if first >= 0 else "1 0 0"
        texts.append(
            f'<joint name="{name}_joint" type="{"continuous" if first >= 0 else "fixed"}">'
            f'<parent link="{model.body(model.body_parentid[body]).name}"/><child link="{name}"/>'
            f'<origin xyz="{place}" rpy="{" ".join(f"{angle:.9g}" for angle in angles)}"/><axis xyz="{axis}"/></joint>'
        )
    return f'<robot name="fixed">{"".join(texts)}</robot>'


def test_refreshing_launches_and_does_nothing_else(
    device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No memory is taken and nothing is brought to the host, so that a graph may be recorded of it."""
    sim = cranes(device, tmp_path, 3)
    GYM.acquire_jacobian_tensor(sim, "crane"), GYM.acquire_mass_matrix_tensor(sim, "crane")
    GYM.acquire_dof_force_tensor(sim), GYM.acquire_net_contact_force_tensor(sim)
    refreshes = (
        GYM.refresh_jacobian_tensors,
        GYM.refresh_mass_matrix_tensors,
        GYM.refresh_dof_force_tensor,
        GYM.refresh_net_contact_force_tensor,
    )
    GYM.simulate(sim)
    for refresh in refreshes:
        refresh(sim)
    with monkeypatch.context() as patch:
        for name in ("zeros", "empty", "full", "clone", "synchronize_device", "from_numpy"):
            patch.setattr(wp, name, None)
        for name in ("numpy", "assign"):
            patch.setattr(wp.array, name, None)
        for refresh in refreshes:
            assert refresh(sim)


def test_a_heavier_body_is_in_the_mass_matrix_at_once(device: wp.Device, tmp_path: Path) -> None:
    sim = cranes(device, tmp_path, 1)
    GYM.prepare_sim(sim)
    masses, env = wrapped(GYM.acquire_mass_matrix_tensor(sim, "crane")), GYM.get_env(sim, 0)
    before = masses.clone()
    bodies = GYM.get_actor_rigid_body_properties(env, 1)
    bodies[3].mass += 2.0
    GYM.set_actor_rigid_body_properties(env, 1, bodies)
    GYM.refresh_mass_matrix_tensors(sim)
    expected = before.clone()
    expected[0, 3, 3] += 2.0
    torch.testing.assert_close(masses, expected)


def test_drives_of_many_actors_are_written_at_once(
    device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Drives are written when they are next read: a program may set those of each actor, one after the other."""
    sim = cranes(device, tmp_path, 3)
    GYM.prepare_sim(sim)
    masses, written = wrapped(GYM.acquire_mass_matrix_tensor(sim, "crane")), []
    before, write = masses.clone(), model_writes.write_drives
    monkeypatch.setattr(model_writes, "write_drives", lambda *given: written.append(1) or write(*given))
    for index in range(3):
        drives = GYM.get_actor_dof_properties(GYM.get_env(sim, index), 1)
        drives["armature"][2] += 0.5 + index
        GYM.set_actor_dof_properties(GYM.get_env(sim, index), 1, drives)
    GYM.refresh_mass_matrix_tensors(sim)
    assert len(written) == 1
    before[:, 2, 2] += 0.5 + torch.arange(3, device=before.device)
    torch.testing.assert_close(masses, before)


def test_matrices_that_cannot_be_given_are_named(device: wp.Device, tmp_path: Path) -> None:
    sim = cranes(device, tmp_path, 1)
    for index in range(2):
        GYM.create_actor(GYM.get_env(sim, 0), GYM.create_box(sim, 1, 1, 1), at(9, 3 * index, 0), "box")
    for acquire in (GYM.acquire_jacobian_tensor, GYM.acquire_mass_matrix_tensor):
        with pytest.raises(wc.WarpcamError, match="there is no actor 'robot'; there are 'ball', 'box', 'crane'"):
            acquire(sim, "robot")
        with pytest.raises(wc.WarpcamError, match="actors 'box' are made of several assets"):
            acquire(sim, "box")
    ball = wrapped(GYM.acquire_mass_matrix_tensor(sim, "ball"))
    mass = float(ball[0, 0, 0])
    assert ball.shape == (1, 6, 6) and mass == pytest.approx(1000.0 * 4.0 / 3.0 * np.pi * 0.1**3, rel=1e-4)


def test_hands_are_driven_in_space(device: wp.Device, tmp_path: Path) -> None:
    """By forces along joints that jacobian and mass matrix tell, as IsaacGymEnvs' task that stacks cubes does."""
    (tmp_path / "arm.xml").write_text(ARM)
    count = 2
    sim = new_sim(device, dt=1.0 / 60.0, substeps=2)
    options = gymapi.AssetOptions(fix_base_link=True, disable_gravity=True)
    asset = GYM.load_asset(sim, str(tmp_path), "arm.xml", options)
    drives = GYM.get_asset_dof_properties(asset)
    drives["driveMode"], drives["stiffness"], drives["damping"] = gymapi.DOF_MODE_EFFORT, 0.0, 0.0
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-1, -1, 0), gymapi.Vec3(1, 1, 1), 2)
        GYM.set_actor_dof_properties(env, GYM.create_actor(env, asset, at(0, 0, 0), "arm", index, 0), drives)
    hand, row = GYM.get_asset_rigid_body_dict(asset)["hand"], GYM.get_actor_joint_dict(env, 0)["j3"]
    GYM.prepare_sim(sim)
    jacobians, masses = (
        wrapped(acquire(sim, "arm")) for acquire in (GYM.acquire_jacobian_tensor, GYM.acquire_mass_matrix_tensor)
    )
    bodies = wrapped(GYM.acquire_rigid_body_state_tensor(sim)).view(count, -1, 13)
    dofs = wrapped(GYM.acquire_dof_state_tensor(sim)).view(count, -1, 2)
    states = torch.tensor([[0.1, 0.0], [0.6, 0.0], [-1.1, 0.0], [0.2, 0.0]] * count, device=dofs.device)
    GYM.set_dof_state_tensor(sim, gymtorch.unwrap_tensor(states))
    goals = torch.tensor([[0.45, 0.25, 0.2], [0.5, -0.2, -0.1]], device=dofs.device)
    for _ in range(120):
        for refresh in (
            GYM.refresh_rigid_body_state_tensor,
            GYM.refresh_dof_state_tensor,
            GYM.refresh_jacobian_tensors,
            GYM.refresh_mass_matrix_tensors,
        ):
            refresh(sim)
        reach, rest = jacobians[:, row, :3], torch.eye(4, device=dofs.device)
        back = torch.linalg.inv(masses)
        weight = torch.linalg.inv(reach @ back @ reach.mT)
        wanted = 60.0 * (goals - bodies[:, hand, :3]) - 15.0 * bodies[:, hand, 7:10]
        idle = rest - reach.mT @ weight @ reach @ back
        forces = reach.mT @ weight @ wanted[..., None] - idle @ masses @ (5.0 * dofs[..., 1:])
        GYM.set_dof_actuation_force_tensor(sim, gymtorch.unwrap_tensor(forces.reshape(-1).contiguous()))
        GYM.simulate(sim)
    GYM.refresh_rigid_body_state_tensor(sim)
    np.testing.assert_allclose(bodies[:, hand, :3].cpu(), goals.cpu(), atol=2e-3)
