"""A program for Isaac Gym whose camera tensors once came back as None: here only its import is another one.

Four arms reach for boxes, each with a camera on its wrist and one that looks on, of 640x480 pixels, 69.4 degrees and a
far plane 2 m away. The wrist's images are read both ways that such programs have: as tensors that are wrapped once, and
copied to the host in each step. Saves isaacgym_cameras.png.
"""

import numpy as np
import torch
from PIL import Image

# from isaacgym import gymapi, gymtorch
from warpcam.compat.isaacgym import gymapi, gymtorch

ENVS, STEPS, EVERY = 4, 10, 5
WIDTH, HEIGHT, FOV, FAR = 640, 480, 69.4, 2.0
ARM = """
<mujoco model="arm">
  <default><geom rgba="0.9 0.9 0.92 1"/><joint damping="2" armature="0.05"/></default>
  <worldbody>
    <body name="base">
      <geom type="cylinder" size="0.09 0.05" pos="0 0 0.05" rgba="0.2 0.2 0.25 1"/>
      <body name="shoulder" pos="0 0 0.1">
        <joint name="turn" axis="0 0 1" range="-150 150"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.05"/>
        <body name="elbow" pos="0 0 0.35">
          <joint name="bend" axis="0 1 0" range="-30 120"/>
          <geom type="capsule" fromto="0 0 0 0.35 0 0" size="0.04" rgba="0.95 0.5 0.15 1"/>
          <body name="wrist" pos="0.4 0 0">
            <joint name="tilt" axis="0 1 0" range="-100 100"/>
            <geom type="box" size="0.05 0.07 0.03" rgba="0.2 0.2 0.25 1"/>
            <geom type="box" size="0.03 0.01 0.01" pos="0.08 0.05 0"/>
            <geom type="box" size="0.03 0.01 0.01" pos="0.08 -0.05 0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def create(gym: gymapi.Gym, folder: str = ".") -> tuple[gymapi.Sim, list, list, dict]:
    """A simulation, its environments, its actors' places, and the tensors of all cameras, which keep their memory."""
    params = gymapi.SimParams()
    params.dt, params.up_axis, params.gravity = 1 / 60, gymapi.UP_AXIS_Z, gymapi.Vec3(0, 0, -9.81)
    params.use_gpu_pipeline = torch.cuda.is_available()
    sim = gym.create_sim(0, 0, gymapi.SIM_PHYSX, params)
    gym.add_ground(sim, gymapi.PlaneParams(normal=gymapi.Vec3(0, 0, 1)))
    gym.set_light_parameters(
        sim, 0, gymapi.Vec3(0.8, 0.8, 0.8), gymapi.Vec3(0.3, 0.3, 0.3), gymapi.Vec3(-0.4, -0.8, 1.2)
    )

    with open(f"{folder}/arm.xml", "w") as file:
        file.write(ARM)
    arm = gym.load_asset(sim, folder, "arm.xml", gymapi.AssetOptions(fix_base_link=True))
    box = gym.create_box(sim, 0.08, 0.08, 0.08, gymapi.AssetOptions(density=400.0))

    props = gymapi.CameraProperties()
    props.width, props.height, props.horizontal_fov, props.far_plane = WIDTH, HEIGHT, FOV, FAR
    props.enable_tensors, props.shadows = True, True
    plain = gymapi.CameraProperties()
    plain.width, plain.height, plain.horizontal_fov, plain.far_plane = WIDTH, HEIGHT, FOV, FAR
    plain.enable_tensors, plain.shadows = False, True

    kinds = {"color": gymapi.IMAGE_COLOR, "depth": gymapi.IMAGE_DEPTH, "ids": gymapi.IMAGE_SEGMENTATION}
    envs, tensors = [], {name: [] for name in kinds}
    for index in range(ENVS):
        env = gym.create_env(sim, gymapi.Vec3(-1, -1, 0), gymapi.Vec3(1, 1, 1), 2)
        robot = gym.create_actor(env, arm, gymapi.Transform(), "arm", index, 1, 1)
        drive = gym.get_actor_dof_properties(env, robot)
        drive["driveMode"], drive["stiffness"], drive["damping"] = gymapi.DOF_MODE_POS, 60.0, 6.0
        gym.set_actor_dof_properties(env, robot, drive)
        for number in range(3):
            place = gymapi.Vec3(0.45 + 0.1 * number, 0.25 * (number - 1), 0.04)
            handle = gym.create_actor(env, box, gymapi.Transform(p=place), f"box {number}", index, 0, 2 + number)
            hue = [0.15, 0.15, 0.15]
            hue[(index + number) % 3] = 0.85
            gym.set_rigid_body_color(env, handle, 0, gymapi.MESH_VISUAL_AND_COLLISION, gymapi.Vec3(*hue))

        wrist = gym.create_camera_sensor(env, props)
        # The camera looks along x of what it is given: down from the hand, a little ahead.
        pose = gymapi.Transform(gymapi.Vec3(0.06, 0, 0.05), gymapi.Quat.from_axis_angle(gymapi.Vec3(0, 1, 0), 1.0))
        hand = gym.find_actor_rigid_body_handle(env, robot, "wrist")
        gym.attach_camera_to_body(wrist, env, hand, pose, gymapi.FOLLOW_TRANSFORM)
        side = gym.create_camera_sensor(env, plain)
        gym.set_camera_location(side, env, gymapi.Vec3(0.9, -1.1, 0.8), gymapi.Vec3(0.25, 0, 0.2))
        for name, kind in kinds.items():
            tensor = gym.get_camera_image_gpu_tensor(sim, env, wrist, kind)
            tensors[name].append(gymtorch.wrap_tensor(tensor))  # once: the memory stays
        envs.append((env, wrist, side))
    gym.prepare_sim(sim)
    return sim, envs, list(kinds), tensors


def main() -> None:
    """Step, look, and say what was seen."""
    gym = gymapi.acquire_gym()
    sim, envs, _, tensors = create(gym)
    dofs = gymtorch.wrap_tensor(gym.acquire_dof_state_tensor(sim))
    targets = torch.zeros(len(dofs), device=dofs.device).reshape(ENVS, 3)
    frames: dict[str, torch.Tensor] = {}
    for step in range(STEPS):
        targets[:, 0] = torch.linspace(-0.5, 0.5, ENVS) * step / STEPS
        targets[:, 1:] = torch.tensor((0.15, 0.6)) * step / STEPS
        gym.set_dof_position_target_tensor(sim, gymtorch.unwrap_tensor(targets.reshape(-1)))
        gym.simulate(sim)
        gym.fetch_results(sim, True)
        gym.step_graphics(sim)
        if (step + 1) % EVERY:
            continue
        gym.render_all_camera_sensors(sim)
        # The first way: tensors on the device.
        gym.start_access_image_tensors(sim)
        frames = {name: torch.stack(images) for name, images in tensors.items()}
        gym.end_access_image_tensors(sim)
        # The second way: copies on the host.
        pictures = [
            gym.get_camera_image(sim, env, side, gymapi.IMAGE_COLOR).reshape(HEIGHT, WIDTH, 4) for env, _, side in envs
        ]
    assert frames["color"].shape == (ENVS, HEIGHT, WIDTH, 4)
    depth = frames["depth"]
    seen = torch.isfinite(depth)
    assert bool((depth[seen] < 0).all() and (depth[seen] >= -FAR).all())
    print(f"colour {tuple(frames['color'].shape)}, depth {tuple(depth.shape)} on {depth.device}")
    print(f"from {-depth[seen].max():.2f} m to {-depth[seen].min():.2f} m; ids {frames['ids'].unique().tolist()}")
    rows = [np.hstack([frames["color"][i].cpu().numpy() for i in range(ENVS)]), np.hstack(pictures)]
    Image.fromarray(np.vstack(rows)[::2, ::2, :3]).save("isaacgym_cameras.png")


if __name__ == "__main__":
    main()
