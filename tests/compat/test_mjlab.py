"""mjlab's camera sensor by our class, in tasks of its own."""

import copy
import json
import runpy
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco_warp
import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

HOW = "pip install mjlab; .ci/run has an environment of its own for it"
if find_spec("mjlab") and find_spec("triton") and "torch._dynamo" not in sys.modules:
    pytest.skip(
        "pytest -p torch._dynamo: mjlab imports triton, which crashes where Warp's compiler was loaded before",
        allow_module_level=True,
    )
envs = pytest.importorskip("mjlab.envs", reason=HOW, exc_type=ImportError)

from mjlab.sensor import CameraSensorCfg as MjlabCfg  # noqa: E402
from mjlab.tasks.cartpole.cartpole_env_cfg import cartpole_balance_env_cfg  # noqa: E402
from mjlab.tasks.manipulation.config.yam.env_cfgs import yam_lift_cube_vision_env_cfg  # noqa: E402

from warpcam.compat import mjlab as ours  # noqa: E402
from warpcam.compat import mujoco_warp as calls  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # mjlab's own

NUM_ENVS = 2


def make(cfg: Any) -> Any:
    cfg.scene.num_envs = NUM_ENVS
    return envs.ManagerBasedRlEnv(cfg=cfg, device="cpu")


def actions(env: Any, random: torch.Generator) -> torch.Tensor:
    return 2.0 * torch.rand(NUM_ENVS, env.action_manager.total_action_dim, generator=random) - 1.0


def test_the_yam_arm_sees_its_cube_for_a_hundred_steps() -> None:
    cfg = ours.use(yam_lift_cube_vision_env_cfg("rgb"))
    assert [type(sensor) for sensor in cfg.scene.sensors].count(ours.CameraSensorCfg) == 1
    env = make(cfg)
    random = torch.Generator().manual_seed(0)
    env.reset()
    assert env.scene.sensor_context is None
    sensor, frames = env.scene["camera_d405"], []
    for step in range(100):
        observations = env.step(actions(env, random))[0]
        frames.append(sensor.data.rgb.clone())
        assert observations["camera"].shape == (NUM_ENVS, 3, 32, 32)
        if step in (0, 99):
            scene = wc.from_mujoco_warp(
                env.sim.mj_model, env.sim.wp_model, env.sim.wp_data, groups=(0, 3), draw=("geoms", "flexes")
            )
            direct = wc.Renderer(scene, [wc.Camera("robot/camera_d405", width=32, height=32)]).render()
            assert torch.equal(direct["robot/camera_d405"]["rgb"], frames[-1])
            seen = observations["camera"].permute(0, 2, 3, 1)
            assert torch.allclose(seen * (255.0 if seen.max() <= 1.0 else 1.0), frames[-1].float(), atol=1.0)
    assert len({frame.numpy().tobytes() for frame in frames}) > 90
    assert env.scene["camera_d405"].data.depth is None
    env.close()


def test_images_are_those_of_mjlabs_own_sensor() -> None:
    """Draw one cartpole twice: by mjlab's renderer, and by ours."""
    images = []
    sensor = MjlabCfg(
        name="eye", pos=(0.0, -3.0, 1.2), quat=(0.7071, 0.7071, 0.0, 0.0), fovy=60.0, width=32, height=24,
        data_types=("rgb", "depth", "segmentation"),
    )  # fmt: skip
    for mine in (False, True):
        cfg = cartpole_balance_env_cfg()
        cfg.scene.sensors = (*cfg.scene.sensors, copy.deepcopy(sensor))
        env = make(ours.use(cfg) if mine else cfg)
        assert isinstance(env.scene["eye"], ours.CameraSensor) is mine
        env.reset(seed=3)
        env.sim.data.qpos[:] = torch.tensor([[0.3, 0.4], [-0.5, -0.2]])
        env.sim.forward()
        env.sim.sense()
        data = env.scene["eye"].data
        images.append({name: getattr(data, name).clone() for name in ("rgb", "depth", "segmentation")})
        env.close()
    theirs, mine_images = images
    for name, image in theirs.items():
        assert mine_images[name].shape == image.shape and mine_images[name].dtype == image.dtype, name
    same = (theirs["segmentation"] == mine_images["segmentation"]).all(dim=-1)
    assert same.float().mean() > 0.98 and len(theirs["segmentation"][..., 0].unique()) > 2
    np.testing.assert_allclose(mine_images["depth"][same], theirs["depth"][same], rtol=2e-3, atol=1e-3)


def test_mjlabs_own_sensor_draws_through_the_calls_of_mujoco_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its sensor and its context as they are, with our calls in place of those that they make."""
    contexts = []

    def create(*given: Any, **named: Any) -> Any:
        contexts.append(calls.create_render_context(*given, **named))
        return contexts[-1]

    for name in ("refit_bvh", "render"):
        monkeypatch.setattr(mujoco_warp, name, getattr(calls, name))
    monkeypatch.setattr(mujoco_warp, "create_render_context", create)
    cfg = cartpole_balance_env_cfg()
    kinds = ("rgb", "depth", "segmentation")
    cfg.scene.sensors = (MjlabCfg(name="eye", camera_name="cartpole/fixed", width=24, height=16, data_types=kinds),)
    env = make(cfg)
    env.reset(seed=3)
    env.step(torch.ones(NUM_ENVS, env.action_manager.total_action_dim))
    data = env.scene["eye"].data
    assert type(env.scene["eye"]) is not ours.CameraSensor and len(contexts) == 1
    scene = wc.from_mujoco_warp(env.sim.mj_model, env.sim.wp_model, env.sim.wp_data, draw=("geoms", "flexes"))
    direct = wc.Renderer(scene, [wc.Camera("cartpole/fixed", width=24, height=16, outputs=kinds)]).render()
    images = direct["cartpole/fixed"]
    hit = images["segmentation"][..., 0] >= 0
    assert hit.any() and torch.equal(data.rgb[hit], images["rgb"][hit])
    assert torch.equal(data.segmentation[..., 0], images["segmentation"][..., 0])
    assert torch.equal(data.depth[hit], images["depth"][hit])
    env.close()


def test_data_types_that_mjlab_lacks() -> None:
    cfg = cartpole_balance_env_cfg()
    kinds = ("rgb", "segmentation", "normals", "points", "distance", "bodies", "albedo", "flow")
    cfg.scene.sensors = (
        ours.CameraSensorCfg(name="eye", camera_name="cartpole/fixed", width=24, height=16, data_types=kinds),
        ours.CameraSensorCfg(
            name="plain", camera_name="cartpole/lookatcart", width=16, height=16, use_textures=False, use_shadows=True,
            antialiasing=4, clone_data=True,
        ),
    )  # fmt: skip
    env = make(cfg)
    env.reset()
    data = env.scene["eye"].data
    assert set(data.images) == set(kinds) and data.depth is None
    assert data.images["normals"].shape == (NUM_ENVS, 16, 24, 3)
    hit = data.segmentation[..., 0] >= 0
    assert hit.any() and torch.allclose(data.images["normals"].norm(dim=-1)[hit], torch.ones(()), atol=1e-3)
    first = env.scene["plain"].data.rgb
    env.step(torch.ones(NUM_ENVS, env.action_manager.total_action_dim))
    assert env.scene["plain"].data.rgb.data_ptr() != first.data_ptr()
    assert env.scene["eye"].data.images["flow"].any()
    env.reset()
    assert not env.scene["eye"].data.images["flow"].any()
    env.close()


def test_sensors_of_one_camera_have_the_images_of_each_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """In sizes, data types and settings of their own; they share a frame with sensors of other cameras only."""
    frames = []

    class Counted(wc.Renderer):
        def __init__(self, scene: wc.Scene, cameras: Any):
            frames.append((scene, [camera.width for camera in cameras]))
            super().__init__(scene, cameras)

    def images_of(*sensors: ours.CameraSensorCfg) -> list[dict[str, torch.Tensor]]:
        cfg = cartpole_balance_env_cfg()
        cfg.scene.sensors = copy.deepcopy(sensors)
        env = make(cfg)
        env.reset(seed=3)
        env.step(torch.ones(NUM_ENVS, env.action_manager.total_action_dim))
        images = [dict(env.scene[sensor.name].data.images) for sensor in sensors]
        env.close()
        return images

    monkeypatch.setattr(wc, "Renderer", Counted)
    kinds = ("depth", "segmentation", "flow")
    one, other = "cartpole/fixed", "cartpole/lookatcart"
    sensors = (
        ours.CameraSensorCfg(name="color", camera_name=one, width=64, height=64),
        ours.CameraSensorCfg(name="depth", camera_name=one, width=32, height=24, data_types=kinds),
        ours.CameraSensorCfg(name="aside", camera_name=other, width=20, height=16, data_types=("rgb", "depth")),
        ours.CameraSensorCfg(name="smooth", camera_name=one, width=65, height=64, use_shadows=True, antialiasing=4),
        ours.CameraSensorCfg(name="plain", camera_name=one, width=66, height=64, use_textures=False),
        ours.CameraSensorCfg(name="still", camera_name=other, width=20, height=16, data_types=("rgb", "depth")),
    )
    together = images_of(*sensors)
    assert [widths for _, widths in frames] == [[64, 20], [32, 20], [65], [66]]
    assert len({id(scene) for scene, _ in frames}) == 2  # with textures and without
    for sensor, images in zip(sensors, together, strict=True):
        (alone,) = images_of(sensor)
        assert tuple(images) == tuple(alone) == sensor.data_types, sensor.name
        for name, image in images.items():
            assert image.shape[:3] == (NUM_ENVS, sensor.height, sensor.width), (sensor.name, name)
            assert torch.equal(image, alone[name]) and len(image.unique()) > 2, (sensor.name, name)


def test_randomised_fields_and_ray_casts_beside() -> None:
    """Fields that are expanded are replaced by other arrays, with a lens and a colour for each world."""
    from mjlab.sensor import GridPatternCfg, ObjRef, RayCastSensorCfg

    cfg = cartpole_balance_env_cfg()
    cfg.scene.sensors = (
        ours.CameraSensorCfg(
            name="eye", camera_name="cartpole/fixed", width=64, height=48, data_types=("rgb", "segmentation")
        ),
        RayCastSensorCfg(
            name="scan", frame=ObjRef(type="body", name="cart", entity="cartpole"), exclude_parent_body=True,
            pattern=GridPatternCfg(size=(0.2, 0.2), resolution=0.2),
        ),
    )  # fmt: skip
    env = make(cfg)
    env.reset(seed=3)
    env.sim.sense()
    before = {name: image.clone() for name, image in env.scene["eye"].data.images.items()}
    assert env.scene["scan"].data.distances.shape[0] == NUM_ENVS
    env.sim.expand_model_fields(("cam_fovy", "geom_rgba", "mat_rgba"))
    camera = env.sim.mj_model.camera("cartpole/fixed").id
    env.sim.model.cam_fovy[1, camera] *= 0.5
    env.sim.model.mat_rgba[0, :, :3] *= 0.5
    env.sim.model.geom_rgba[0, :, :3] *= 0.5
    env.sim.sense()
    after = env.scene["eye"].data.images
    assert torch.equal(after["segmentation"][0], before["segmentation"][0])
    hit = before["segmentation"][0, ..., 0] >= 0
    assert hit.any() and after["rgb"][0][hit].float().mean() < 0.9 * before["rgb"][0][hit].float().mean()
    poles = [(image["segmentation"][1, ..., 0] > 0).sum() for image in (before, after)]
    assert poles[1] > 1.5 * poles[0] > 0  # half the field of view
    env.close()


def test_what_is_chosen_in_place_of_a_sensors_own() -> None:
    """For all camera sensors of a task, whoever drew them before; a class of somebody else's stays."""

    class Theirs(MjlabCfg):
        pass

    cfg = cartpole_balance_env_cfg()
    theirs = Theirs(name="theirs")
    cfg.scene.sensors = (MjlabCfg(name="one", width=8), ours.CameraSensorCfg(name="two", reflections=False), theirs)
    one, two, third = ours.use(cfg, antialiasing=4, data_types=("rgb", "normals")).scene.sensors
    assert one == ours.CameraSensorCfg(name="one", width=8, antialiasing=4, data_types=("rgb", "normals"))
    assert two == ours.CameraSensorCfg(name="two", reflections=False, antialiasing=4, data_types=("rgb", "normals"))
    assert third is theirs
    with pytest.raises(wc.WarpcamError, match="data_types has 'smell'"):
        ours.use(cfg, data_types=("smell",))


def test_groups_are_of_any_number_as_mjlab_has_them() -> None:
    """Also a data type that is named twice is one."""

    def balls(spec: Any) -> None:
        for number, group in enumerate((0, 5, 6, 7, -1)):
            spec.worldbody.add_geom(size=[0.2, 0.0, 0.0], pos=[0.5 * number - 1.0, 0.0, 3.0], group=group)

    cfg = cartpole_balance_env_cfg()
    cfg.scene.spec_fn = balls
    settings = {"pos": (0.0, 0.0, 6.0), "width": 60, "height": 30, "data_types": ("segmentation", "segmentation")}
    settings["enabled_geom_groups"] = (0, 5, 7, 7)
    cfg.scene.sensors = (MjlabCfg(name="theirs", **settings), ours.CameraSensorCfg(name="mine", **settings))
    env = make(cfg)
    env.reset()
    theirs, mine = (env.scene[name].data.segmentation for name in ("theirs", "mine"))
    assert torch.equal(theirs, mine)
    seen = {int(env.sim.mj_model.geom_group[geom]) for geom in mine[..., 0].unique() if geom >= 0}
    assert seen == {0, 5, 7}
    env.scene["mine"].cfg.enabled_geom_groups = ("all",)
    env.scene["mine"]._cameras._frames = None
    with pytest.raises(wc.WarpcamError, match=r"CameraSensorCfg\('mine'\): enabled_geom_groups must be whole numbers"):
        env.sim.sense()
    env.close()


@pytest.mark.parametrize("zfar", [0.0, 1.0])
def test_a_model_whose_zfar_is_zero_has_no_end(zfar: float) -> None:
    """A zfar of zero is no limit, as with MuJoCo-Warp's calls; another one cuts off."""
    cfg = cartpole_balance_env_cfg()
    cfg.scene.spec_fn = lambda spec: setattr(spec.visual.map, "zfar", zfar)
    cfg.scene.sensors = (
        ours.CameraSensorCfg(name="eye", camera_name="cartpole/fixed", width=32, height=24, data_types=("depth",)),
    )
    env = make(cfg)
    env.reset(seed=3)
    deepest = env.scene["eye"].data.depth.max()
    end = zfar * env.sim.mj_model.stat.extent
    assert deepest > 20.0 if end == 0.0 else 0.0 < deepest < end < 20.0
    env.close()


def test_a_data_type_that_nobody_has() -> None:
    with pytest.raises(wc.WarpcamError, match="data_types has 'smell'; allowed are rgb, rgba"):
        ours.CameraSensorCfg(name="eye", data_types=("rgb", "smell"))


@pytest.mark.skipif(not wp.is_cuda_available(), reason="a capture needs a CUDA device")
def test_on_cuda_images_follow_the_simulation() -> None:
    cfg = ours.use(yam_lift_cube_vision_env_cfg("depth"))
    cfg.scene.num_envs = 4
    env = envs.ManagerBasedRlEnv(cfg=cfg, device="cuda:0")
    env.reset()
    frames = []
    for _ in range(5):
        env.step(torch.rand(4, env.action_manager.total_action_dim, device="cuda:0"))
        frames.append(env.scene["camera_d405"].data.depth.cpu().numpy().tobytes())
    assert len(set(frames)) == 5
    env.close()


def test_a_task_of_mjlab_learns_by_its_own_runner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program = Path(__file__).resolve().parents[2] / "examples" / "mjlab_vision.py"
    monkeypatch.setattr(sys, "argv", [program.name, "--worlds", "2", "--iterations", "1", "--steps", "4"])
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(program), run_name="__main__")
    (told,) = json.loads((tmp_path / "mjlab-vision" / "returns.json").read_text())
    assert told["renderer"] == "warpcam" and len(told["curve"]) == 1
    assert "Mjlab-Lift-Cube-Yam-Rgb, warpcam, seed 0: " in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--seconds", "0"])  # the run is there, and is not done again
    runpy.run_path(str(program), run_name="__main__")
    assert "warpcam: median" in capsys.readouterr().out
