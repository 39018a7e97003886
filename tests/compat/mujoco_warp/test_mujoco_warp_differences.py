"""Differences of MuJoCo-Warp's renderer, as the page about these calls says; without a difference the page is wrong."""

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import warp as wp

from warpcam.compat import mujoco_warp as ours


def images(system: Any, mjm: mujoco.MjModel, **options: Any) -> dict[str, np.ndarray]:
    """Images of the first camera, 40 x 40 pixels."""
    m, d = scenes.put(mjm, 1)
    flags = {"render_rgb": True, "render_depth": True, "render_seg": True}
    rc = system.create_render_context(mjm, nworld=1, **{"cam_res": (40, 40), **flags, **options})
    system.refit_bvh(m, d, rc)
    system.render(m, d, rc)
    return {name: getattr(rc, f"{name}_data").numpy()[0].reshape(40, 40, -1).copy() for name in ("rgb", "depth", "seg")}


@pytest.fixture
def lit(device: wp.Device) -> mujoco.MjModel:
    return scenes.compile_xml(
        '<light pos="0 0 4"/><camera pos="0 0 3" fovy="60"/><geom type="plane" size="1 1 .1"/><geom size=".3"/>'
        '<geom type="box" size=".2 .2 .01" pos=".1 .1 1"/>'
    )


@pytest.mark.parametrize(
    "options",
    [
        {"use_fast_math": False},
        {"use_precomputed_rays": False},
        {"deterministic": True},
        {"shadow_light_fraction": 0.0},
    ],
)
def test_arguments_without_an_effect(lit: mujoco.MjModel, options: dict[str, Any]) -> None:
    plain, changed = images(ours, lit, use_shadows=True), images(ours, lit, use_shadows=True, **options)
    assert all((plain[name] == changed[name]).all() for name in plain)


def test_planes_are_seen_from_above_alone(device: wp.Device) -> None:
    """MuJoCo-Warp's way, not that of MuJoCo's renderer."""
    mjm = scenes.compile_xml('<camera pos="0 0 -3" quat="0 1 0 0"/><geom type="plane" size="1 1 .1"/>')
    for system in (ours, mjw):
        seen = images(system, mjm)
        assert (seen["seg"][..., 0] == -1).all() and not seen["depth"].any()


def test_an_image_shows_all_of_a_sensor(device: wp.Device) -> None:
    """A sensor twice as wide as it is high, in a square image."""
    mjm = scenes.compile_xml(
        '<camera sensorsize="2 1" focal="1 1" resolution="40 40"/><geom name="aside" size=".05" pos=".9 0 -1"/>'
        '<geom name="above" size=".05" pos="0 .45 -1"/>'
    )
    seen = {system: set(np.unique(images(system, mjm)["seg"][..., 0])) - {-1} for system in (ours, mjw)}
    assert seen[ours] == {mjm.geom("aside").id, mjm.geom("above").id}
    assert seen[mjw] != seen[ours]


def test_flexes_are_drawn_if_their_group_is(device: wp.Device) -> None:
    mjm = scenes.compile_xml(
        '<camera pos="0 0 3"/><geom size=".1" pos="1 0 0"/><flexcomp name="cloth" type="grid" dim="2" count="3 3 1" '
        'spacing=".3 .3 .3" radius=".02"/>'
    )
    mjm.flex_group[:] = 4
    flex = int(mujoco.mjtObj.mjOBJ_FLEX)
    for groups, expected in (([0, 1, 2], False), ([0, 4], True)):
        assert (images(ours, mjm, enabled_geom_groups=groups)["seg"][..., 1] == flex).any() == expected
        assert (images(mjw, mjm, enabled_geom_groups=groups)["seg"][..., 1] == flex).any()


def test_repeats_that_are_not_positive_count_as_one(device: wp.Device) -> None:
    checks = '<texture name="t" type="2d" builtin="checker" width="16" height="16" rgb1="1 1 1"/>'
    seen = []
    for repeat in ("1 1", "0 -2"):
        mjm = scenes.compile_xml(
            '<camera pos="0 0 3"/><geom type="plane" size="1 1 .1" material="m"/>',
            assets=f'{checks}<material name="m" texture="t" texrepeat="{repeat}"/>',
        )
        seen.append(images(ours, mjm)["rgb"])
    assert (seen[0] == seen[1]).all() and len(np.unique(seen[0])) > 2
