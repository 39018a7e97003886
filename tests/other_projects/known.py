"""Tests of other projects that fail with a front end in place, by a pattern of ``Class.test``, and why they do."""

from collections.abc import Mapping

INTERNALS = (
    "reads attributes of the project's own trees, kernels, lights or tables of textures, which a front end lacks"
)

MUJOCO: Mapping[str, str] = {}
MUJOCO_WARP: Mapping[str, str] = {
    "RenderTest.test_authored_normals_shade_smoothly_unless_disabled": "enable_vertex_normals=False is refused",
    "RenderTest.test_backface_cull_disabled_keeps_enclosure_*": "enable_backface_culling=False is refused",
    "RenderTest.test_backfaces_are_shaded_two_sided": "enable_backface_culling=False is refused",
    "RenderTest.test_megakernel_cached_across_renders": INTERNALS,
    "RenderTest.test_per_world_skybox_textures": "changed settings of an existing context are refused",
    "RenderTest.test_render_spot_light_with_attenuation": INTERNALS,
    "RenderTest.test_shadow_light_fraction_scales_shadowed_light1": (
        "a shadow has none of its light, as in MuJoCo's own renderer: 0.3 means 0"
    ),
    "RenderTest.test_shadow_light_fraction_scales_shadowed_light2": (
        "a shadow has none of its light, as in MuJoCo's own renderer: 1.0 is refused"
    ),
    "RenderTest.test_supersampling_antialiases_edges": "samples_per_pixel is 1, 2, 4 or 8, and light is MuJoCo's",
    "RenderTest.test_supersampling_multi_camera_mixed_outputs": INTERNALS,
    "RenderTest.test_supersampling_validation": "the error names what is allowed in other words",
    "RenderUtilTest.test_bvh_creation*": INTERNALS,
    "RenderUtilTest.test_render_context_lighting_flags": INTERNALS,
    "RenderUtilTest.test_render_context_with_textures": INTERNALS,
    "RenderUtilTest.test_texture_by_reference": INTERNALS,
    "RenderUtilTest.test_use_textures_flag": INTERNALS,
}
NEWTON: Mapping[str, str] = {
    "TestSensorCamera.test_cloth_albedo_uses_per_face_colors": INTERNALS,
    "TestSensorCamera.test_default_light_color_scales_direct_light": INTERNALS,
    "TestSensorCamera.test_set_ambient_light_scales_ambient_without_recompiling": INTERNALS,
    "TestSensorCamera.test_update_syncs_deformables_by_default": INTERNALS,
    "TestSensorCameraDeformable.test_simulation_surface_visibility": INTERNALS,
    "TestSensorCameraDeformable.test_skinning_follows_state_and_capture": (
        "sync_deformables=False with another state than the synchronised one is refused"
    ),
    "TestSensorCamera.test_sensor_camera_public_imports_resolve_to_same_class": "there are two classes then",
    "TestSensorCamera.test_msaa_blends_overlapping_objects_without_background": (
        "samples of a pixel stand at four places of its own edges, not where a bundle of the test's own has them"
    ),
    "TestSensorCamera.test_update_resolves_msaa_rays": "one pixel, with samples of the test's own",
    "TestSensorCamera.test_update_resolves_ssaa_rays": "one pixel, with samples of the test's own",
    "TestSensorCamera.test_msaa_reuses_shading_per_deformable_face": INTERNALS,
    "TestSensorCameraDeformable.test_textures_and_checkerboard": "small squares of a checkerboard are blurred",
    "TestSensorTiledCamera.test_albedo_output_follows_output_color_space": "levels of 8 bits are rounded, not cut off",
    "TestSensorTiledCamera.test_cloth_renders_via_triangle_mesh_construction": INTERNALS,
    "TestSensorTiledCamera.test_render_context_none_config_uses_default": INTERNALS,
}
DM_CONTROL: Mapping[str, str] = {
    "MujocoEngineTest.testTextOverlay*": "text is refused",
    "MujocoEngineTest.testCustomRenderFlags": "wireframes are refused",
    "MujocoEngineTest.testRenderFlags": "wireframes are refused",
}
GYMNASIUM: Mapping[str, str] = {}
