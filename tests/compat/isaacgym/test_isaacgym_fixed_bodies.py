"""Isaac Gym: bodies that are fixed to a base that the world holds become part of the base, which stays."""

from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

newton = pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim  # noqa: E402, newton may be missing

from warpcam.compat.isaacgym import gymapi, gymtorch  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
ROD = '<inertial><mass value="{}"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
URDF = f"""
<robot name="held">
  <link name="base">BASE</link><link name="plate">{ROD.format(1)}</link><link name="arm">{ROD.format(3)}</link>
  <joint name="bolt" type="fixed"><parent link="base"/><child link="plate"/><origin xyz="0.3 0 0"/></joint>
  <joint name="turn" type="continuous">
    <parent link="plate"/><child link="arm"/><origin xyz="0 0.2 0"/><axis xyz="1 0 0"/>
  </joint>
</robot>
"""
XML = """
<mujoco model="held">
  <worldbody>
    <body name="base"><geom type="sphere" size="0.1" mass="2"/>
      <body name="plate" pos="0.3 0 0"><geom type="sphere" size="0.1" mass="1"/>
        <body name="arm" pos="0 0.2 0"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.1" mass="3"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    ("name", "text", "weight"),
    [("held.urdf", URDF.replace("BASE", ROD.format(2)), 3.0), ("held.urdf", URDF.replace("BASE", ""), 1.0),
     ("held.xml", XML, 3.0)],
    ids=["urdf", "urdf, massless", "xml"],
)  # fmt: skip
def test_a_base_that_is_held_stays(device: wp.Device, tmp_path: Path, name: str, text: str, weight: float) -> None:
    (tmp_path / name).write_text(text)
    sim = new_sim(device)
    asset = GYM.load_asset(
        sim, str(tmp_path), name, gymapi.AssetOptions(collapse_fixed_joints=True, fix_base_link=True)
    )
    assert GYM.get_asset_rigid_body_names(asset) == ["base", "arm"]
    assert GYM.get_asset_joint_names(asset) == GYM.get_asset_dof_names(asset) == ["turn"]
    for index in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 2)
        GYM.create_actor(env, asset, at(0, 0, 1.0 + index), "held", index, 0)
    GYM.prepare_sim(sim)
    assert [body.mass for body in GYM.get_actor_rigid_body_properties(env, 0)] == pytest.approx([weight, 3.0])
    roots = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(sim))
    bodies = gymtorch.wrap_tensor(GYM.acquire_rigid_body_state_tensor(sim))
    roots[1, :3] = torch.tensor((0.5, 0.0, 4.0))
    GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(roots))
    for _ in range(3):
        GYM.refresh_rigid_body_state_tensor(sim)
        places = [(0.0, 0.0, 1.0), (0.3, 0.2, 1.0), (0.5, 0.0, 4.0), (0.8, 0.2, 4.0)]
        np.testing.assert_allclose(bodies[:, :3].cpu(), places, atol=1e-6)
        GYM.simulate(sim)
