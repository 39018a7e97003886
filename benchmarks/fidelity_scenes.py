"""Scenes of a fidelity run: files of other packages and scenes made here, and a camera for each."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from warpcam.benchmarks import crowded_scenes, scenes

OWN = "warpcam"  # the package of scenes made here
FREE = "free"  # the camera that MuJoCo's viewers begin with
FOLDERS: Mapping[str, str] = {
    "mujoco_warp": "test_data",
    "dm_control": "suite",
    "gymnasium": "envs/mujoco/assets",
    "gymnasium_robotics": "envs/assets",
    "mjlab": "",
    "robosuite": "models/assets",
}


@dataclass(frozen=True)
class Shot:
    """One view of one scene, in its first keyframe if it has any, else as it starts.

    Attributes:
        name: Of the shot.
        package: That brings the scene, and ``FOLDERS`` says where in it; ``OWN`` for one that is made here.
        file: Within that folder, or the scene's name in ``crowded_scenes.SCENES``.
        camera: Name or index of one of its cameras, or ``FREE``.
    """

    name: str
    package: str
    file: str
    camera: str | int = FREE


SHOTS: tuple[Shot, ...] = (
    Shot("humanoid", "mujoco_warp", "humanoid/humanoid.xml", "side"),
    Shot("n_humanoid", "mujoco_warp", "humanoid/n_humanoid.xml"),
    Shot("primitives", "mujoco_warp", "primitives.xml", 0),
    Shot("aloha", "mujoco_warp", "aloha_pot/scene.xml", "teleoperator_pov"),
    Shot("aloha_overhead", "mujoco_warp", "aloha_pot/scene.xml", "overhead_cam"),
    Shot("mug", "mujoco_warp", "mug/mug.xml", 0),
    Shot("pendula", "mujoco_warp", "pendula.xml", 0),
    Shot("ray", "mujoco_warp", "ray.xml"),
    Shot("constraints", "mujoco_warp", "constraints.xml"),
    Shot("hfield", "mujoco_warp", "hfield/hfield.xml"),
    Shot("boxes", "mujoco_warp", "convex_collision/box100.xml"),
    Shot("cow", "mujoco_warp", "collision_sdf/cow.xml"),
    Shot("skybox_checker", "mujoco_warp", "skybox/checker.xml", "main"),
    Shot("skybox_gradient", "mujoco_warp", "skybox/gradient.xml", "main"),
    Shot("floppy", "mujoco_warp", "flex/floppy.xml", 0),
    Shot("multiflex", "mujoco_warp", "flex/multiflex.xml", 0),
    Shot("tendon_wrap", "mujoco_warp", "tendon/wrap.xml"),
    Shot("acrobot", "dm_control", "acrobot.xml", "fixed"),
    Shot("ball_in_cup", "dm_control", "ball_in_cup.xml", "cam0"),
    Shot("cartpole", "dm_control", "cartpole.xml", "fixed"),
    Shot("cheetah", "dm_control", "cheetah.xml", "side"),
    Shot("dog", "dm_control", "dog.xml", "x-axis"),
    Shot("finger", "dm_control", "finger.xml", "cam0"),
    Shot("fish", "dm_control", "fish.xml", "tracking_x"),
    Shot("humanoid_cmu", "dm_control", "humanoid_CMU.xml", "side"),
    Shot("manipulator", "dm_control", "manipulator.xml", "fixed"),
    Shot("point_mass", "dm_control", "point_mass.xml", "cam0"),
    Shot("quadruped", "dm_control", "quadruped.xml", "x"),
    Shot("reacher", "dm_control", "reacher.xml", "fixed"),
    Shot("swimmer", "dm_control", "swimmer.xml", "tracking1"),
    Shot("walker", "dm_control", "walker.xml", "side"),
    Shot("ant", "gymnasium", "ant.xml", "track"),
    Shot("half_cheetah", "gymnasium", "half_cheetah.xml", "track"),
    Shot("gym_humanoid", "gymnasium", "humanoid.xml", "track"),
    Shot("pusher", "gymnasium", "pusher_v5.xml"),
    Shot("walker2d", "gymnasium", "walker2d.xml", "track"),
    Shot("fetch", "gymnasium_robotics", "fetch/pick_and_place.xml", "external_camera_0"),
    Shot("shadow_hand", "gymnasium_robotics", "hand/manipulate_block.xml"),
    Shot("adroit_door", "gymnasium_robotics", "adroit_hand/adroit_door.xml", "fixed"),
    Shot("kitchen", "gymnasium_robotics", "kitchen_franka/kitchen_assets/kitchen_env_model.xml", "right_cap"),
    Shot("g1", "mjlab", "asset_zoo/robots/unitree_g1/xmls/g1.xml", "tracking"),
    Shot("go1", "mjlab", "asset_zoo/robots/unitree_go1/xmls/go1.xml", "tracking"),
    Shot("yam", "mjlab", "asset_zoo/robots/i2rt_yam/xmls/yam.xml", "front_cam"),
    Shot("table", "robosuite", "arenas/table_arena.xml", "frontview"),
    Shot("pegs", "robosuite", "arenas/pegs_arena.xml", "agentview"),
    Shot("panda", "robosuite", "robots/panda/robot.xml"),
    Shot("cereal", "robosuite", "objects/cereal.xml"),
    *(Shot(name, OWN, name, "fixed") for name in crowded_scenes.SCENES),
)


def load(shot: Shot) -> tuple[mujoco.MjModel, mujoco.MjData, int]:
    """The scene, its state, and the index of the camera."""
    camera = shot.camera
    if shot.package == OWN:
        mjm = crowded_scenes.SCENES[shot.file]().compile()
    else:
        path = scenes.package_folder(shot.package) / FOLDERS[shot.package] / shot.file
        mjm = mujoco.MjModel.from_xml_path(str(path))
        if camera == FREE:
            spec = mujoco.MjSpec.from_file(str(path))
            add_free_camera(spec, mjm)
            mjm = spec.compile()
    mjd = mujoco.MjData(mjm)
    if mjm.nkey:
        mujoco.mj_resetDataKeyframe(mjm, mjd, 0)
    mujoco.mj_forward(mjm, mjd)
    return mjm, mjd, mjm.camera(camera).id


def add_free_camera(spec: mujoco.MjSpec, mjm: mujoco.MjModel) -> None:
    """Fix a camera where MuJoCo's free camera begins, so that every renderer can look through it."""
    view = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(mjm, view)
    azimuth, elevation = np.radians((view.azimuth, view.elevation))
    forward = np.array((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)))
    position = view.lookat - view.distance * forward
    rotation = scenes.facing(tuple(position), tuple(view.lookat))
    spec.worldbody.add_camera(name=FREE, pos=position, quat=rotation, fovy=float(mjm.vis.global_.fovy))
