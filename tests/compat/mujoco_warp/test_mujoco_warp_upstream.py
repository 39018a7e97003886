"""MuJoCo-Warp's own tests of its renderer, as they came with it, of the calls that take its place."""

from importlib import import_module
from typing import Any

import mujoco_warp as mjw
import pytest
import warp as wp

from warpcam.compat import mujoco_warp as ours

for needed in ("absl.testing", "mujoco_warp._src.render_test", "mujoco_warp._src.render_util_test"):
    pytest.importorskip(needed, reason="this MuJoCo-Warp has no tests in it, or absl-py is missing")

CALLS = ("create_render_context", "refit_bvh", "render", "get_rgb", "get_depth", "get_segmentation")
# Of what is offered; docs/compat/mujoco_warp.md has what is not. Here are those that show the most: all others of what
# is offered pass as well.
OF_IMAGES = (
    "test_coincident_geoms_resolve_to_higher_index_box",
    "test_depth_matches_mujoco",
    "test_disable_ambient_lighting",
    "test_geom_rgba_precedence_over_material_geom_rgba_overrides",
    "test_render0",
    "test_render_per_world_mat_texid_batch_size",
    "test_render_rgb_and_segmentation",
    "test_render_segmentation0",
    "test_render_texture_by_reference",
    "test_segmentation_matches_mujoco",
    "test_supersampling_preserves_segmentation_and_depth",
    "test_zfar_clipping_clipped",
)
OF_CONTEXTS = (
    "test_cam_active_empty",
    "test_cam_active_filtering",
    "test_get_segmentation",
    "test_get_segmentation_preserves_flex_ids",
    "test_heterogeneous_camera",
    "test_output_buffers",
    "test_rgb_only_and_depth_only",
    "test_segmentation_from_camera_output",
)
CASES = [("render_test", "RenderTest", name) for name in OF_IMAGES]
CASES += [("render_util_test", "RenderUtilTest", name) for name in OF_CONTEXTS]


@pytest.mark.parametrize(("module", "case", "name"), CASES, ids=[*OF_IMAGES, *OF_CONTEXTS])
def test_a_case_of_mujoco_warps(
    device: wp.Device, module: str, case: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = getattr(import_module(f"mujoco_warp._src.{module}"), case)
    if not hasattr(kind, name):
        pytest.skip(f"MuJoCo-Warp {mjw.__version__} has no such test")
    made: list[Any] = []
    for call in CALLS:
        monkeypatch.setattr(mjw, call, getattr(ours, call))
    create = ours.create_render_context
    monkeypatch.setattr(mjw, "create_render_context", lambda *a, **k: made.append(create(*a, **k)) or made[-1])
    test = kind(name)
    result = test.run()
    assert result is not None and not result.failures + result.errors, result.failures + result.errors
    if result.skipped:
        pytest.skip(result.skipped[0][1])
    assert all(isinstance(context, ours.RenderContext) for context in made) and made
