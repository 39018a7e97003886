"""Domain randomisation: ranges are kept, seeds repeat, worlds that are not meant stay, attributes are independent."""

import sys
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import torch
import usd_stages
import warp as wp
from pxr import Usd, UsdLux

import warpcam as wc
from warpcam.core.errors import WarpcamError

MODULE = sys.modules["warpcam.randomize"]  # that name in the package is the function

WORLDS = 500
ASSETS = """
  <texture name="one" type="2d" builtin="flat" width="4" height="4"/>
  <texture name="two" type="2d" builtin="flat" width="4" height="4"/>
  <material name="grey" rgba=".4 .4 .4 1" texture="one"/><material name="red" rgba=".8 .1 .1 1" emission=".2"/>
"""
WORLD = """
  <light pos="0 0 3" dir="0 0 -1" diffuse=".5 .4 .3"/><light pos="1 0 3" dir="0 .6 -.8"/>
  <geom type="sphere" size="1" material="red"/>
"""


@pytest.fixture
def scene(device: wp.Device) -> wc.Scene:
    mjm = scenes.compile_xml(WORLD, assets=ASSETS)
    return wc.from_mujoco_warp(mjm, *scenes.put(mjm, WORLDS))


def drawn(scene: wc.Scene, name: str, recipe: Any, seed: Any = 1, **options: Any) -> torch.Tensor:
    wc.randomize(scene, seed=seed, **options, **{name: recipe})
    return scene.vary(name).clone()


def test_values_fill_their_range(scene: wc.Scene) -> None:
    low, high = (0.2, 0.0, 0.5, 1.0), (0.4, 1.0, 0.6, 1.0)
    colors = drawn(scene, "material_color", (low, high)).cpu().numpy()
    assert (colors >= np.float32(low)).all() and (colors <= np.float32(high)).all()
    np.testing.assert_allclose(colors.mean(axis=(0, 1)), 0.5 * (np.array(low) + high), atol=0.05)
    share = (colors[..., 1].ravel() * 10).astype(int)
    assert np.bincount(share, minlength=10).min() > 60  # of 100


def test_offsets_and_factors_are_of_what_was_there_at_first(scene: wc.Scene) -> None:
    nominal = scene.vary("light_diffuse").clone()
    for seed in range(3):  # and do not add up
        factors = drawn(scene, "light_diffuse", wc.Uniform(0.5, 2.0, of="factor", linked=True), seed) / nominal
        assert factors.min() >= 0.5 - 1e-5 and factors.max() <= 2.0 + 1e-5
        torch.testing.assert_close(factors[..., 0], factors[..., 2])
    where = scene.vary("light_positions").clone()
    moved = drawn(scene, "light_positions", wc.Uniform((-1, -1, 0), (1, 1, 0), of="offset")) - where
    assert moved[..., 2].abs().max() == 0.0
    assert 0.9 < moved[..., :2].abs().max() <= 1.0 + 1e-5


def test_directions_turn_by_as_much_as_is_said(scene: wc.Scene) -> None:
    before = scene.vary("light_directions").clone()
    after = drawn(scene, "light_directions", wc.Uniform(10.0, 20.0, of="turn"))
    torch.testing.assert_close(after.norm(dim=-1), torch.ones_like(after[..., 0]))
    angles = torch.rad2deg(torch.acos((before * after).sum(dim=-1).clamp(-1, 1)))
    assert angles.min() > 9.9 and angles.max() < 20.1
    assert angles.std() > 2.0


def test_one_of_several_is_chosen(scene: wc.Scene) -> None:
    chosen = drawn(scene, "material_texture", wc.Choice([0, 1, -1], rows=[0]))
    assert sorted(chosen[:, 0, 1].unique().tolist()) == [-1, 0, 1]
    assert (chosen[:, 1, 1] == -1).all()  # the row that was not meant
    assert torch.bincount(chosen[:, 0, 1] + 1).min() > 120
    on = drawn(scene, "light_active", [1, 1, 1, 0])
    assert on.dtype == torch.bool
    assert 0.65 < on.float().mean() < 0.85


def test_a_seed_says_it_all(scene: wc.Scene) -> None:
    first, other, again = (drawn(scene, "material_color", (0.0, 1.0), seed) for seed in (7, 8, 7))
    assert (first == again).all()
    assert (first != other).float().mean() > 0.99
    alone = drawn(scene, "material_color", (0.0, 1.0), 8, worlds=[3, 5])
    assert (alone[[3, 5]] == other[[3, 5]]).all()  # whichever others are drawn with them
    rest = torch.ones(WORLDS, dtype=torch.bool)
    rest[[3, 5]] = False
    assert (alone[rest] == first[rest]).all()


def test_pieces_of_a_rope_look_alike(device: wp.Device) -> None:
    """Its id stands for all of them, and one of them for itself."""
    rope = 1
    mjm = scenes.compile_xml(
        '<geom size=".1"/><flexcomp type="grid" dim="1" count="5 1 1" spacing=".2 .2 .2" name="rope" material="red"/>',
        assets=ASSETS,
    )
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 3))
    before = scene.vary("shape_colors").clone()
    pieces = torch.as_tensor(scene.columns[0] == rope)
    assert pieces.sum() == 1 + 4 and len(pieces) == 6
    for recipe in (wc.Uniform(0.0, 1.0), wc.Uniform(0.0, 1.0, rows=[rope])):
        colors = drawn(scene, "shape_colors", recipe).cpu()
        assert (colors[:, pieces] == colors[:, rope : rope + 1]).all()
        assert (colors != before.cpu())[:, pieces].all()
    assert (drawn(scene, "shape_colors", wc.Uniform(0.5, 1.0, rows=[5]))[:, rope] == colors[:, rope].to(before)).all()
    chosen = drawn(scene, "shape_materials", wc.Choice([-1], rows=[rope]))
    assert (chosen[:, pieces] == -1).all()


def test_seeds_on_the_device_are_of_each_world(scene: wc.Scene) -> None:
    seeds = torch.zeros(WORLDS, dtype=torch.int32, device=scene.vary("material_color").device)
    first = drawn(scene, "material_color", (0.0, 1.0), seeds)
    seeds[4] += 1
    second = drawn(scene, "material_color", (0.0, 1.0), seeds)
    assert [int(world) for world in (first != second).flatten(1).any(dim=1).nonzero()] == [4]
    assert (first == drawn(scene, "material_color", (0.0, 1.0), 0)).all()
    one = torch.zeros(1, dtype=torch.int32, device=seeds.device)
    assert (first == drawn(scene, "material_color", (0.0, 1.0), one)).all()


@pytest.mark.parametrize("as_mask", [True, False])
def test_worlds_that_are_not_meant_stay(scene: wc.Scene, as_mask: bool) -> None:
    before = scene.vary("material_emission").clone()
    ids = torch.arange(0, WORLDS, 3, device=before.device)
    mask = torch.zeros(WORLDS, dtype=torch.bool, device=before.device)
    mask[ids] = True
    after = drawn(scene, "material_emission", (0.5, 1.0), worlds=mask if as_mask else ids)
    assert (after[~mask] == before[~mask]).all()
    assert (after[mask] >= 0.5).all()


def test_attributes_worlds_and_rows_do_not_hang_together(scene: wc.Scene) -> None:
    wc.randomize(scene, seed=3, material_emission=(0.0, 1.0), material_specular=(0.0, 1.0), light_exponent=(0.0, 1.0))
    columns = [scene.vary(name).cpu() for name in ("material_emission", "material_specular", "light_exponent")]
    first = torch.cat(columns, dim=1).T
    wc.randomize(scene, seed=4, material_emission=(0.0, 1.0), material_specular=(0.0, 1.0), light_exponent=(0.0, 1.0))
    second = torch.cat([scene.vary("material_emission").cpu(), scene.vary("material_specular").cpu()], dim=1).T
    table = torch.cat((first, second, first[:, [*range(1, WORLDS), 0]]))
    apart = np.corrcoef(table.numpy()) - np.eye(len(table))
    assert np.abs(apart).max() < 0.2  # 4.5 standard deviations of 500 draws


def test_cameras_are_drawn_as_well(scene: wc.Scene) -> None:
    eye = scenes.own_camera(position=(0, 0, 3), exposure=0.0, outputs=("hdr",), width=4, height=4)
    renderer = wc.Renderer(scene, [eye])
    before = renderer.render()["eye"]["hdr"].clone()
    arrays = renderer.camera("eye")
    wc.randomize(
        arrays,
        seed=2,
        exposure=(-1.0, 1.0),
        position=wc.Uniform(-0.1, 0.1, of="offset"),
        rotation=wc.Uniform(0.0, 5.0, of="turn"),
        fovy=(50.0, 70.0),
    )
    assert arrays.fovy.min() >= 50.0 and arrays.fovy.max() <= 70.0 and arrays.fovy.std() > 3.0
    assert (arrays.position - torch.tensor((0.0, 0.0, 3.0), device=arrays.position.device)).abs().max() <= 0.1001
    torch.testing.assert_close(arrays.rotation.norm(dim=1), torch.ones(WORLDS, device=arrays.rotation.device))
    assert arrays.rotation[:, 0].min() >= np.cos(np.radians(2.5)) - 1e-5
    assert (renderer.render()["eye"]["hdr"] != before).flatten(1).any(dim=1).float().mean() > 0.95


def test_it_may_be_captured(scene: wc.Scene, device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("graphs are captured on a CUDA device only; this one is a CPU")
    seed = torch.zeros(1, dtype=torch.int32, device=scene.vary("material_color").device)
    mask = torch.ones(WORLDS, dtype=torch.bool, device=seed.device)
    attributes = {
        "material_color": (0.0, 1.0),
        "light_directions": wc.Uniform(0.0, 30.0, of="turn"),
        "light_active": [0, 1],
    }
    wc.randomize(scene, seed=seed, worlds=mask, **attributes)
    wanted = {}
    for number in (0, 1):
        seed.fill_(number)
        wc.randomize(scene, seed=seed, worlds=mask, **attributes)
        wanted[number] = {name: scene.vary(name).clone() for name in attributes}
    torch.cuda.synchronize()
    with wp.ScopedCapture(device=device) as capture:
        wc.randomize(scene, seed=seed, worlds=mask, **attributes)
    for number in (0, 1):
        seed.fill_(number)
        torch.cuda.synchronize()
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)
        for name, values in wanted[number].items():
            assert (scene.vary(name) == values).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({}, "randomize: no recipe came"),
        ({"light_diffuse": 0.5}, r"randomize: light_diffuse must be \(low, high\), a list, Uniform or Choice, got 0.5"),
        ({"light_diffuse": [0, 1]}, "randomize: light_diffuse takes Uniform"),
        ({"light_active": (0, 1)}, "randomize: light_active takes Choice"),
        ({"light_diffuse": (0.0, float("nan"))}, "randomize: light_diffuse: bounds must be finite numbers"),
        ({"light_diffuse": ((0, 0), (1, 1))}, "randomize: light_diffuse: bounds must be a number or 3"),
        ({"light_diffuse": (1.0, 0.0)}, r"randomize: light_diffuse: low must not be above high, got 1\.0, 0\.0"),
        ({"light_diffuse": ((0, 0, 0.5), (1, 1, 0.25))}, "light_diffuse: low must not be above high"),
        ({"light_diffuse": wc.Uniform(0, 1, rows=[2])}, "rows must be different indices from 0 to 1"),
        ({"light_diffuse": wc.Uniform(0, 1, of="turn")}, "only light_directions and rotation turn"),
        ({"light_diffuse": wc.Uniform(0, 1, of="log")}, "of must be one of 'value', 'offset', 'factor', 'turn'"),
        ({"light_diffuse": wc.Uniform(0, 1, linked="no")}, "light_diffuse: linked must be True or False, got 'no'"),
        ({"light_diffuse": ([[0, 0, 0]], 1)}, "randomize: light_diffuse: bounds must be a number or 3"),
        ({"light_diffuse": wc.Uniform(0, 1, rows=[True, False])}, "light_diffuse: rows must be whole numbers, got"),
        ({"light_intensity": (-2, -1)}, "randomize: light_intensity: values must be from 0 to inf, got -2, -1"),
        ({"light_intensity": wc.Uniform(-1, 1, of="factor")}, "light_intensity: factors must be from 0 to inf, got -1"),
        ({"background": (0, 2)}, "randomize: background: values must be from 0 to 1, got 0, 2"),
        ({"seed": torch.tensor(5, dtype=torch.int32), "light_diffuse": (0, 1)}, "seed must be a whole number of 32 b"),
        ({"light_active": [0, 2]}, "a choice of on and off takes 1 and 0"),
        ({"light_active": []}, "a choice needs at least one value"),
        ({"seed": 0.5, "light_diffuse": (0, 1)}, "randomize: seed must be a whole number of 32 bits"),
        ({"seed": np.zeros(2), "light_diffuse": (0, 1)}, "randomize: seed must be a whole number of 32 bits"),
        ({"worlds": [WORLDS], "light_diffuse": (0, 1)}, "randomize: worlds has id 500"),
        ({"glow": (0, 1)}, "vary: 'glow' came"),
    ],
)
def test_what_cannot_be_drawn_is_named(scene: wc.Scene, call: dict[str, Any], message: str) -> None:
    with pytest.raises(WarpcamError, match=message):
        wc.randomize(scene, **call)


def test_seeds_and_recipes_that_come_anew_are_not_kept(scene: wc.Scene) -> None:
    """A new tensor for each episode, bounds that grow from one to the next."""
    device = scene.vary("material_color").device
    one = drawn(scene, "material_color", (0.0, 1.0), torch.tensor([1], dtype=torch.int32, device=device))
    state, known = MODULE._randomizers[scene], []
    for episode in range(MODULE.MAX_STAGES + 20):
        seed = torch.tensor([episode], dtype=torch.int32, device=device)
        wc.randomize(scene, seed=seed, material_color=(0.0, 1.0))
        known.append(len(state.stages))
    assert len(set(known)) == 1
    for episode in range(MODULE.MAX_STAGES + 20):
        wc.randomize(scene, seed=episode, material_emission=(0.0, 0.5 + 1e-3 * episode))
        known.append(len(state.stages))
    assert max(known) == MODULE.MAX_STAGES
    assert scene.vary("material_emission").max() > 0.5
    assert (drawn(scene, "material_color", (0.0, 1.0), 1) == one).all()


def test_a_recipe_that_is_part_of_a_graph_is_kept(scene: wc.Scene) -> None:
    for name in ("light_exponent", "light_cutoff"):
        wc.randomize(scene, seed=1, **{name: (0.0, 1.0)})
    state = MODULE._randomizers[scene]
    captured, other = state.stages
    state.keep(captured, state.stages[captured], True)
    for episode in range(MODULE.MAX_STAGES + 1):
        wc.randomize(scene, seed=episode, material_emission=(0.0, 0.25 + 1e-3 * episode))
    assert captured in state.stages and other not in state.stages


def test_nothing_may_be_drawn_of_nothing(device: wp.Device) -> None:
    mjm = mujoco.MjModel.from_xml_string("<mujoco/>")
    scene = wc.from_mujoco(mjm, mujoco.MjData(mjm), device=device)
    wc.randomize(scene, seed=1, shape_colors=(0.0, 1.0))
    assert scene.vary("shape_colors").shape == (1, 0, 4)


def test_targets_are_scenes_and_cameras(device: wp.Device) -> None:
    with pytest.raises(
        WarpcamError,
        match=r"randomize: target must be a scene, renderer.camera\(...\) or rig.parameters\(...\), got dict",
    ):
        wc.randomize({}, light_diffuse=(0, 1))


def test_no_camera_is_exposed_beyond_what_a_float_holds(scene: wc.Scene) -> None:
    eye = wc.Camera("eye", width=4, height=4, lens=wc.Pinhole(fovy=60.0), position=(0.0, 0.0, 3.0), exposure=0.0)
    arrays = wc.Renderer(scene, [eye]).camera("eye")
    wc.randomize(arrays, exposure=(-2.0, 2.0))
    with pytest.raises(WarpcamError, match="randomize: exposure: values must be at most 127, got 0, 128"):
        wc.randomize(arrays, exposure=(0, 128))


def test_bounds_may_have_the_shape_of_an_entry(device: wp.Device) -> None:
    stage = usd_stages.metric(Usd.Stage.CreateInMemory())
    usd_stages.add_square(stage, "/square")
    UsdLux.SphereLight.Define(stage, "/lamp")
    scene = wc.from_usd(stage, 2, device=device)
    axes = np.arange(9.0).reshape(3, 3)
    wc.randomize(scene, light_rotations=(axes, axes))
    assert (scene.vary("light_rotations").cpu() == torch.as_tensor(axes)).all()
    with pytest.raises(WarpcamError, match="randomize: light_rotations: bounds must be a number or 9"):
        wc.randomize(scene, light_rotations=(axes[None], axes))


def test_worlds_with_the_same_seed_look_the_same(scene: wc.Scene) -> None:
    seeds = torch.arange(WORLDS, dtype=torch.int32, device=scene.vary("material_color").device)
    first = drawn(scene, "material_color", (0.1, 0.9), seeds, by_world=False)
    turned = drawn(scene, "material_color", (0.1, 0.9), seeds.flip(0), by_world=False)
    torch.testing.assert_close(first.flip(0), turned, rtol=0.0, atol=0.0)
    assert len(torch.unique(first[:, 0, 0])) > 0.99 * WORLDS and (first[:, 0] != first[:, 1]).any()
    assert len(torch.unique(drawn(scene, "material_color", (0.1, 0.9), 5, by_world=False)[:, 0, 0])) == 1
    assert (drawn(scene, "material_color", (0.1, 0.9), seeds) != first).any()
    with pytest.raises(WarpcamError, match="by_world must be True or False, got 1"):
        wc.randomize(scene, by_world=1, material_color=(0.1, 0.9))
