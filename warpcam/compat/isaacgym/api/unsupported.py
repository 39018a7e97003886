"""Calls of Isaac Gym that are not here, by name, with what to do instead."""

from collections.abc import Callable, Mapping
from typing import Any

from warpcam.core.errors import WarpcamError

VIEWER = "there is no window; attach a camera and save its images with write_camera_image_to_file"
PHYSICS = "this front end is for cameras; sizes and states of inner bodies are the Newton model's own"
TENDONS = "tendons pull nothing here; those of an asset are held"
SOFT = "there are no soft bodies or particles here; warpcam.from_newton draws Newton's"
TIMERS = "time calls with time.perf_counter, or with warp.ScopedTimer on a GPU"
FILES = "a scene is made by calls; save what it shows with write_camera_image_to_file, or read a file with warpcam.load"
DEVICE = "create_sim chooses the one device"
SENSORS = "acquire_force_sensor_tensor has what force sensors measure, a row for each"
ARRAYS = "Vec3, Quat and Transform have methods of that kind, and torch_utils has functions for tensors"
ATTRACTORS = "there are no attractors here; forces and drives of joints pull bodies"
UNSUPPORTED: Mapping[str, str] = {
    **dict.fromkeys(
        (
            "create_viewer", "destroy_viewer", "draw_viewer", "poll_viewer_events", "query_viewer_has_closed",
            "query_viewer_action_events", "subscribe_viewer_keyboard_event", "subscribe_viewer_mouse_event",
            "viewer_camera_look_at", "get_viewer_camera_transform", "get_viewer_camera_handle", "get_viewer_size",
            "get_viewer_mouse_position", "set_viewer_camera", "write_viewer_image_to_file", "add_lines", "clear_lines",
            "draw_env_rigid_contacts", "draw_env_soft_contacts", "sync_frame_time",
        ),
        VIEWER,
    ),
    **dict.fromkeys(
        (
            "set_rigid_body_state_tensor", "set_actor_rigid_body_states", "set_actor_scale", "get_actor_scale",
            "set_sim_rigid_body_states", "set_env_rigid_body_states", "set_rigid_transform",
            "set_rigid_linear_velocity", "set_rigid_angular_velocity", "destroy_env",
        ),
        PHYSICS,
    ),
    **dict.fromkeys(
        (
            "get_actor_tendon_properties", "set_actor_tendon_properties", "get_actor_tendon_count",
            "get_actor_fixed_tendon_joint_coefficients", "set_actor_fixed_tendon_joint_coefficients",
            "get_asset_fixed_tendon_joint_coefficients", "set_asset_fixed_tendon_joint_coefficients",
            "get_asset_fixed_tendon_joint_name", "find_actor_tendon_index", "get_actor_tendon_name",
            "get_actor_tendon_offset", "set_actor_tendon_offset", "find_actor_fixed_tendon_joint_index",
            "get_actor_fixed_tendon_joint_name",
        ),
        TENDONS,
    ),
    **dict.fromkeys(
        (
            "acquire_particle_state_tensor", "refresh_particle_state_tensor", "set_particle_state_tensor",
            "acquire_pneumatic_pressure_tensor", "acquire_pneumatic_target_tensor", "get_sim_tetrahedra_count",
            "get_sim_triangle_count", "get_sim_triangles", "get_asset_soft_body_count", "get_actor_soft_body_count",
            "create_cloth_grid", "create_tet_grid", "set_particle_state_tensor_indexed",
            "reset_actor_particles_to_rest",
            "get_actor_soft_materials", "set_actor_soft_materials", "get_asset_soft_materials", "get_soft_contacts",
            "get_actor_tetrahedra_range", "get_actor_triangle_range", "get_sim_tetrahedra",
            "get_pneumatic_pressure", "get_pneumatic_target", "set_pneumatic_pressure", "set_pneumatic_target",
            "refresh_pneumatic_pressure_tensor", "refresh_pneumatic_target_tensor", "set_pneumatic_pressure_tensor",
            "set_pneumatic_pressure_tensor_indexed", "set_pneumatic_target_tensor",
            "set_pneumatic_target_tensor_indexed",
        ),
        SOFT,
    ),
    **dict.fromkeys(("create_performance_timers", "destroy_performance_timers", "get_performance_timers"), TIMERS),
    **dict.fromkeys(
        (
            "attach_sim", "load_sim", "load_opensim", "create_usd_exporter", "destroy_usd_exporter", "export_usd_asset",
            "export_usd_sim", "get_usd_export_root", "set_usd_export_root", "omni_connect", "omni_disconnect",
        ),
        FILES,
    ),
    **dict.fromkeys(("get_sensor", "get_actor_force_sensor"), SENSORS),
    "set_sim_device": DEVICE,
    "create_aggregate": "begin_aggregate and end_aggregate are there, and have no effect",
    "debug_print_asset": "get_asset_rigid_body_names, get_asset_joint_names and get_asset_dof_properties list it",
    **dict.fromkeys(
        (
            "create_rigid_body_attractor", "get_attractor_properties", "set_attractor_properties",
            "set_attractor_target", "get_env_attractor_count",
        ),
        ATTRACTORS,
    ),
    "set_camera_view_matrix": "give the pose to set_camera_transform",
    "get_viewer_camera": VIEWER,
}  # fmt: skip

# Names of gymapi, by what they begin with.
NAMES = {
    **dict.fromkeys(("KEY_", "MOUSE_", "KeyboardInput", "MouseInput", "DEFAULT_VIEWER_"), VIEWER),
    **dict.fromkeys(("AttractorProperties", "AXIS_"), ATTRACTORS),
    **dict.fromkeys(("Viewer", "ActionEvent"), VIEWER),
    **dict.fromkeys(("MAT_", "ParticleState", "Soft", "Int2", "Int3"), SOFT),
    **dict.fromkeys(("TENDON_", "TendonType"), TENDONS),
    **dict.fromkeys(("USD_", "Usd", "Omni", "carb_init"), FILES),
    **dict.fromkeys(("ForceSensor", "SpatialForce"), SENSORS),
    "PerformanceTimers": TIMERS,
    **dict.fromkeys(("cross", "dot", "rotate", "transform", "eulers_to_quats", "quats_to_eulers"), ARRAYS),
}


def why_missing(name: str) -> str:
    """Return the message for a name that does not exist."""
    reasons = [f"gymapi.{name} is not here: {reason}" for start, reason in NAMES.items() if name.startswith(start)]
    return reasons[0] if reasons else f"gymapi has no {name!r}"


class UnsupportedCalls:
    """Whose missing calls say why they are missing."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in UNSUPPORTED:
            raise AttributeError(f"Gym has no call {name!r}")

        def refuse(*_: Any, **__: Any) -> Any:
            raise WarpcamError(f"Gym.{name} is not here: {UNSUPPORTED[name]}")

        return refuse
