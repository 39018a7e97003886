"""Names of Isaac Gym: each exists, or says what to use instead. Calls that read several environments at once."""

import re

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("newton")
from gym_worlds import GYM, walls

from warpcam.compat.isaacgym import gymapi

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
REFUSED_CALLS = """
    attach_sim create_aggregate create_performance_timers create_usd_exporter debug_print_asset
    destroy_performance_timers destroy_usd_exporter export_usd_asset export_usd_sim find_actor_fixed_tendon_joint_index
    find_actor_tendon_index get_actor_fixed_tendon_joint_name get_actor_force_sensor get_actor_soft_materials
    get_actor_tendon_name get_actor_tendon_offset get_actor_tetrahedra_range get_actor_triangle_range
    get_asset_soft_materials get_performance_timers get_pneumatic_pressure get_pneumatic_target get_sensor
    get_sim_tetrahedra get_soft_contacts get_usd_export_root load_opensim load_sim omni_connect omni_disconnect
    refresh_pneumatic_pressure_tensor refresh_pneumatic_target_tensor reset_actor_particles_to_rest
    set_actor_soft_materials set_actor_tendon_offset set_particle_state_tensor_indexed set_pneumatic_pressure
    set_pneumatic_pressure_tensor set_pneumatic_pressure_tensor_indexed set_pneumatic_target
    set_pneumatic_target_tensor set_pneumatic_target_tensor_indexed set_sim_device set_usd_export_root
""".split()
REFUSED_NAMES = """
    ActionEvent AttractorProperties AXIS_ALL DEFAULT_VIEWER_WIDTH ForceSensor Int2 Int3 KEY_A KeyboardInput
    MAT_NEOHOOKEAN OmniConnectionParams ParticleState PerformanceTimers SoftContact SoftMaterial SoftMaterialType
    SpatialForce
    TENDON_FIXED TendonType USD_MATERIAL_MDL UsdExportOptions UsdExporter UsdMaterialMode Viewer carb_init cross dot
    eulers_to_quats_zyx quats_to_eulers_zyx rotate rotate_inverse transform transform_inverse
""".split()


@pytest.mark.parametrize("name", REFUSED_CALLS)
def test_a_call_that_is_not_here_says_what_to_do_instead(name: str) -> None:
    with pytest.raises(wc.WarpcamError, match=rf"Gym.{name} is not here: \w+"):
        getattr(GYM, name)(None)


@pytest.mark.parametrize("name", REFUSED_NAMES)
def test_a_name_that_is_not_here_says_what_to_do_instead(name: str) -> None:
    with pytest.raises(AttributeError, match=rf"gymapi.{name} is not here: \w+"):
        getattr(gymapi, name)


def test_names_that_no_version_has() -> None:
    with pytest.raises(AttributeError, match="Gym has no call 'render_everything'"):
        _ = GYM.render_everything
    with pytest.raises(AttributeError, match="gymapi has no 'Vec5'"):
        _ = gymapi.Vec5


def test_small_types() -> None:
    assert (GYM.get_version().major, GYM.get_version().minor) == (1, 0)
    one = gymapi.Vec2(1.0, 2.0)
    assert one + gymapi.Vec2(1, 1) == gymapi.Vec2(2, 3) and -one * 2 == gymapi.Vec2(-2, -4)
    assert gymapi.Vec2.from_buffer(np.array([(3, 4)], gymapi.Vec2.dtype)[0]) == gymapi.Vec2(3, 4)
    assert one / 2 - gymapi.Vec2(0.5, 0) == gymapi.Vec2(0, 1) and tuple(one) == (1.0, 2.0)
    assert gymapi.Mat44(x=(1, 2, 3, 4)) == gymapi.Mat44(x=(1, 2, 3, 4)) != gymapi.Mat44()
    speed = gymapi.Velocity.from_buffer(np.arange(6, dtype=np.float32))
    assert speed.linear == gymapi.Vec3(0, 1, 2) and speed.angular == gymapi.Vec3(3, 4, 5)
    frame = gymapi.DofFrame.from_buffer(np.arange(6, dtype=np.float32))
    assert frame.origin == gymapi.Vec3(0, 1, 2) and frame.axis == gymapi.Vec3(3, 4, 5)
    params = gymapi.SimParams()
    params.stress_visualization_min, params.stress_visualization_max, params.flex.return_contacts = 0.0, 1.0, False


def test_states_of_several_environments(device: wp.Device) -> None:
    world = walls(device, fixed=False)
    envs, first = world.envs, [GYM.get_actor_rigid_body_handle(env, 0, 0) for env in world.envs]
    poses = GYM.get_vec_rigid_transform(envs, first)
    assert poses.dtype == gymapi.Transform.dtype and poses.shape == (3,)
    np.testing.assert_allclose(poses["p"]["x"], (2.5, 2.6, 2.7), rtol=1e-6)
    assert (GYM.get_vec_rigid_transform(envs, 0) == poses).all()
    for read in (GYM.get_vec_rigid_linear_velocity, GYM.get_vec_rigid_angular_velocity):
        speeds = read(envs, first)
        assert speeds.dtype == gymapi.Vec3.dtype and speeds.shape == (3,) and not speeds["x"].any()
    dofs = GYM.get_vec_actor_dof_states(envs, world.actors, gymapi.STATE_ALL)
    assert dofs.shape == (3, 0) and dofs.dtype == gymapi.DofState.dtype
    forces = GYM.get_vec_env_rigid_contact_forces(envs)
    assert forces.shape == (3, 1) and forces.dtype == gymapi.Vec3.dtype
    with pytest.raises(wc.WarpcamError, match=re.escape("one for each of 3 environments is needed, got [0, 0]")):
        GYM.get_vec_rigid_transform(envs, [0, 0])
    with pytest.raises(wc.WarpcamError, match="a list of environments is needed, got None"):
        GYM.get_vec_rigid_transform(None, 0)
