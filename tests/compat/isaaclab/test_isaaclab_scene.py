"""Our renderer in a scene, a simulation and cameras of Isaac Lab's own, beside the renderer that it brings.

Isaac Lab 3.0 simulates with Newton on any device, and needs no simulator app for that.
"""

import warnings
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

HOW = "see 'laboratories' in .ci/run"
newton = pytest.importorskip("newton", reason=HOW)
if not newton.__version__.startswith("1.6."):
    pytest.skip(
        f"Isaac Lab 3.0 simulates with Newton 1.6, here is {newton.__version__}: {HOW}", allow_module_level=True
    )
for name in ("newton_usd_schemas", "pxr", "isaaclab.renderers", "isaaclab_newton"):
    pytest.importorskip(name, reason=HOW, exc_type=ImportError)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of what Isaac Lab itself imports
    import isaaclab.sim as sim_utils
    from isaaclab.assets import RigidObjectCfg
    from isaaclab.scene import InteractiveScene, InteractiveSceneCfg
    from isaaclab.sensors.camera import CameraCfg
    from isaaclab.sim.schemas import MassCfg, UsdPhysicsCollisionCfg, UsdPhysicsRigidBodyCfg
    from isaaclab.utils import configclass
    from isaaclab_newton.physics import NewtonCfg, XPBDSolverCfg
    from isaaclab_newton.renderers import NewtonWarpRendererCfg

    from warpcam.compat.isaaclab import WarpcamRenderer, WarpcamRendererCfg
    from warpcam.compat.isaaclab.simple_shading import AMBIENT, CAMERA_LIGHT

pytestmark = pytest.mark.filterwarnings("ignore")  # Isaac Lab's and Newton's own

NUM_ENVS, WIDTH, HEIGHT = 2, 40, 30
BOTH = ("depth", "distance_to_camera", "normals", "albedo", "semantic_segmentation", "instance_segmentation")
MORE = ("rgb", "rgba", "rgb_hdr", "distance_to_image_plane", "motion_vectors", "instance_id_segmentation_fast")


def box(name: str, place: tuple[float, float, float], label: str) -> Any:
    return RigidObjectCfg(
        prim_path="{ENV_REGEX_NS}/" + name,
        spawn=sim_utils.CuboidCfg(
            size=(0.4, 0.3, 0.5),
            rigid_props=[UsdPhysicsRigidBodyCfg()],
            mass_props=[MassCfg(mass=1.0)],
            collision_props=[UsdPhysicsCollisionCfg()],
            visual_material=sim_utils.PreviewSurfaceCfg(diffuse_color=(0.9, 0.3, 0.1)),
            semantic_tags=[("class", label)],
        ),
        init_state=RigidObjectCfg.InitialStateCfg(pos=place),
    )


def camera(name: str, kinds: tuple[str, ...], renderer: Any) -> Any:
    return CameraCfg(
        prim_path="{ENV_REGEX_NS}/" + name, height=HEIGHT, width=WIDTH, data_types=list(kinds), renderer_cfg=renderer,
        offset=CameraCfg.OffsetCfg(pos=(-2.0, 0.1, 0.6), rot=(0.0, 0.0, 0.0, 1.0), convention="world"),
        spawn=sim_utils.PinholeCameraCfg(focal_length=24.0, horizontal_aperture=24.0, clipping_range=(0.05, 50.0)),
    )  # fmt: skip


@configclass
class Boxes(InteractiveSceneCfg):
    """Two boxes in each environment, and cameras at one place: one drawn by Isaac Lab, two by us."""

    first: Any = box("First", (0.0, 0.3, 0.6), "box")
    second: Any = box("Second", (0.5, -0.4, 0.7), "brick")
    theirs: Any = camera("Theirs", BOTH, NewtonWarpRendererCfg(enable_backface_culling=True))
    ours: Any = camera("Ours", BOTH + MORE, WarpcamRendererCfg())
    simple: Any = camera("Simple", ("simple_shading_diffuse_mdl", "depth"), WarpcamRendererCfg())


class Lab:
    """A running scene."""

    def __init__(self, sim: Any):
        self.sim = sim
        self.scene = InteractiveScene(Boxes(num_envs=NUM_ENVS, env_spacing=6.0, lazy_sensor_update=False))
        sim.reset()
        self.scene.reset()

    def step(self) -> None:
        self.scene.write_data_to_sim()
        self.sim.step(render=False)
        self.scene.update(self.sim.get_physics_dt())

    def image(self, kind: str, of: str = "ours") -> np.ndarray:
        return self.scene[of].data.output[kind].warp.numpy().copy()


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    physics = NewtonCfg(solver_cfg=XPBDSolverCfg())
    with sim_utils.build_simulation_context(
        sim_cfg=sim_utils.SimulationCfg(device="cpu", physics=physics, dt=0.01)
    ) as sim:
        running = Lab(sim)
        for _ in range(3):
            running.step()
        yield running


def test_images_are_those_of_the_renderer_that_it_brings(lab: Lab) -> None:
    shapes = lab.scene["ours"]._render_data.renderer.array("camera", "segmentation").numpy()[..., 0]
    padded = np.pad(shapes, ((0, 0), (1, 1), (1, 1)), mode="edge")
    around = [padded[:, i : i + HEIGHT, j : j + WIDTH] for i in range(3) for j in range(3)]
    inside = ~(np.stack(around) != shapes).any(axis=0)
    hit = inside & (shapes >= 0)
    assert len(np.unique(shapes)) == 1 + 2 * NUM_ENVS and hit.mean() > 0.04
    for kind in BOTH:
        mine, expected = lab.image(kind), lab.image(kind, "theirs")
        assert (mine.dtype, mine.shape) == (expected.dtype, expected.shape), kind
        where = inside if kind.endswith("segmentation") else hit
        if kind == "albedo":
            assert np.abs(mine[where].astype(int) - expected[where]).max() <= 1
        else:
            np.testing.assert_allclose(mine[where], expected[where], atol=1e-4, err_msg=kind)
    assert np.isposinf(lab.image("depth")[inside & (shapes < 0)]).all()
    info, their_info = lab.scene["ours"].data.info, lab.scene["theirs"].data.info
    for kind in ("semantic_segmentation", "instance_segmentation"):
        assert info[kind] == their_info[kind] and len(info[kind]["idToLabels"]) >= 4


def test_simple_shading_is_of_the_colours_that_the_stage_has(lab: Lab) -> None:
    """Lit from the camera, as the stage has no light, and bent by the curve that RTX shows it with."""
    hit = np.isfinite(lab.image("depth", "simple"))[..., 0]
    np.testing.assert_array_equal(hit, np.isfinite(lab.image("depth"))[..., 0])
    image = lab.image("simple_shading_diffuse_mdl", "simple")
    assert (image.dtype, image.shape) == (np.uint8, (NUM_ENVS, HEIGHT, WIDTH, 3)) and not image[~hit].any()
    light = np.array((0.9, 0.3, 0.1)) * (AMBIENT + CAMERA_LIGHT)
    shown = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14)
    facing = hit & np.isclose(lab.image("normals")[..., 0], -1.0)
    assert np.abs(image[facing] - 255.0 * (1.055 * shown ** (1 / 2.4) - 0.055)).max() < 1.0 and facing.sum() > 40


def test_it_is_known_by_name(lab: Lab) -> None:
    assert set(lab.sim.render_context.renderer_types) == {"newton_warp", "warpcam"}
    assert isinstance(lab.scene["ours"]._renderer, WarpcamRenderer)


def test_what_falls_is_seen_to_move(lab: Lab) -> None:
    before = lab.image("depth")
    lab.step()
    shapes = lab.image("instance_id_segmentation_fast").any(axis=-1)
    vectors = lab.image("motion_vectors")
    assert (lab.image("depth") != before).any()
    assert (vectors[shapes][:, 1] < 0.0).all() and np.abs(vectors[shapes][:, 0]).max() < 1e-3
    assert (vectors[~shapes] == 0.0).all()
    names = lab.scene["ours"].data.info["instance_id_segmentation_fast"]["idToLabels"]
    pixels = lab.image("instance_id_segmentation_fast").reshape(-1, 4)
    colors = {tuple(int(part) for part in color) for color in np.unique(pixels, axis=0)}
    assert {names[color].split("/")[4] for color in colors if any(color)} == {"First", "Second"}


def test_after_a_reset_images_are_of_the_state_after_it(lab: Lab) -> None:
    first = lab.scene["first"]
    away = first.data.default_root_pose.torch.clone()
    away[:, :3] += lab.scene.env_origins
    away[1, 1] += 0.4
    lab.scene.reset([1])
    first.write_root_pose_to_sim_index(root_pose=away)
    lab.scene.update(0.0)
    depth = lab.image("depth")
    for world, column in ((0, 0.3), (1, 0.7)):
        near = np.isclose(depth[world, ..., 0], 1.8, atol=1e-3)
        expected = WIDTH / 2 - (column - 0.1) / 1.8 * WIDTH
        assert abs(np.nonzero(near.any(axis=0))[0].mean() + 0.5 - expected) < 1.0
    assert (lab.image("motion_vectors")[1] == 0.0).all()


def test_intrinsics_of_each_environment(lab: Lab) -> None:
    sensor = lab.scene["ours"]
    count = [(image.any(axis=-1)).sum() for image in lab.image("semantic_segmentation")]
    matrices = sensor.data.intrinsic_matrices.torch.clone()
    matrices[1, 0, 0] *= 0.5
    matrices[1, 1, 1] *= 0.5
    sensor.set_intrinsic_matrices(matrices)
    lab.step()
    seen = [(image.any(axis=-1)).sum() for image in lab.image("semantic_segmentation")]
    assert seen[0] == pytest.approx(count[0], rel=0.1) and seen[1] < 0.5 * count[1]


def test_colours_of_shapes_are_randomised_by_isaac_labs_own_event(lab: Lab) -> None:
    """Isaac Lab randomises by names of renderers, of which it knows those that read Newton's model."""
    from isaaclab.envs.mdp import randomize_visual_shape
    from isaaclab.managers import EventTermCfg, SceneEntityCfg

    env = SimpleNamespace(sim=lab.sim, scene=lab.scene, device="cpu", num_envs=NUM_ENVS)
    green = {"choices": [(0.0, 1.0, 0.0)]}
    params = {"asset_cfg": SceneEntityCfg("first", body_ids=[0]), "channels": {"color": green}}
    term = randomize_visual_shape(EventTermCfg(func=randomize_visual_shape, params=params), env)
    before = wp.clone(lab.scene["ours"]._renderer._backend.model.shape_color)
    term(env, torch.tensor([1]), **params)
    lab.step()
    for of in ("ours", "theirs"):
        greens = [(image[..., 1] > 250).sum() for image in lab.image("albedo", of)]
        assert greens[0] == 0 and greens[1] > 20, of
    lab.scene["ours"]._renderer._backend.model.shape_color.assign(before)


def test_what_it_cannot_do_is_refused(lab: Lab) -> None:
    buffer = wp.zeros((NUM_ENVS, HEIGHT, WIDTH, 3))
    with pytest.raises(wc.WarpcamError, match="simple_shading_full_mdl: the camera was made without it"):
        lab.scene["ours"]._render_data.set_outputs({"simple_shading_full_mdl": buffer})
