"""Clouds of Gaussians beside Newton's camera and MuJoCo-Warp: ``python -m warpcam.benchmarks.splats``.

One cloud for all worlds, a body that moves in front of it, and a camera that is elsewhere in each world and frame.
Newton's camera is asked for the 20 nearest Gaussians of a ray, its own default, and for nothing behind them; ours
blends all of them over what is behind.

MuJoCo-Warp draws the same cloud in a scene of its own, in which each world has one of two such clouds.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import newton
import numpy as np
import warp as wp
from newton.sensors import SensorCamera

import warpcam as wc
from warpcam.benchmarks import machine, measure

FOVY, SETS = 60.0, 4
BASE = 0.28209479177387814  # the spherical harmonic of degree 0


def room(count: int, seed: int = 0) -> newton.Gaussian:
    """Build a cloud like the scan of a room: flat Gaussians on walls and three balls."""
    random = np.random.default_rng(seed)
    half = np.array((2.0, 2.0, 1.25))
    faces = random.choice(9, count, p=np.array((16, 16, 10, 10, 10, 10, 2, 2, 2)) / 78.0)
    points, normals = random.uniform(-half, half, (count, 3)), np.zeros((count, 3))
    for face, (axis, side) in enumerate(((2, -1), (2, 1), (0, -1), (0, 1), (1, -1), (1, 1))):
        points[faces == face, axis], normals[faces == face, axis] = side * half[axis], -side
    for face, center in enumerate(((-0.8, 0.6, -0.6), (0.7, 0.9, -0.7), (0.2, -0.5, -0.9)), start=6):
        around = random.normal(size=((faces == face).sum(), 3))
        normals[faces == face] = around / np.linalg.norm(around, axis=1, keepdims=True)
        points[faces == face] = center + 0.35 * normals[faces == face]
    points += 0.004 * random.normal(size=points.shape)
    sizes = np.sqrt(78.0 / count) * np.exp(random.normal(size=(count, 3)) * (0.5, 0.5, 0.3)) * (1.0, 1.0, 0.15)
    z = np.array((0.0, 0.0, 1.0))
    turns = np.concatenate((np.cross(z, normals), 1.0 + normals @ z[:, None]), axis=1)  # takes z to the normal
    turns[np.linalg.norm(turns, axis=1) < 1e-6] = (1.0, 0.0, 0.0, 0.0)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    colors = 0.5 + 0.3 * np.sin(points * (3.0, 4.0, 5.0) + (0.0, 1.0, 2.0))
    opacities = np.clip(random.beta(2.0, 1.2, count), 0.02, 0.99)
    return newton.Gaussian(points, turns, sizes, opacities, (colors - 0.5) / BASE, min_response=0.0113)


def build(count: int, worlds: int) -> newton.Model:
    robot = newton.ModelBuilder()
    robot.add_shape_capsule(robot.add_body(), radius=0.15, half_height=0.3)
    scene = newton.ModelBuilder()
    scene.add_shape_gaussian(-1, gaussian=room(count))
    scene.replicate(robot, worlds)
    return scene.finalize()


def poses_of(worlds: int, spread: tuple[float, float, float], middle: tuple[float, float, float]) -> list[np.ndarray]:
    """Positions (world, 3) of each set."""
    return [np.random.default_rng(seed).uniform(-1.0, 1.0, (worlds, 3)) * spread + middle for seed in range(SETS)]


def transforms(positions: np.ndarray, quaternion: tuple[float, ...]) -> wp.array:
    rows = np.concatenate((positions, np.tile(quaternion, (len(positions), 1))), axis=1)
    return wp.array(rows.astype(np.float32), dtype=wp.transformf)


def measured(count: int, worlds: int, side: int, with_newton: bool) -> dict[str, Any]:
    """Milliseconds a frame of rgb and depth."""
    device = wp.get_device()
    model = build(count, worlds)
    state = model.state()
    eyes, ahead = poses_of(worlds, (0.5, 0.3, 0.3), (0.0, -1.4, 0.1)), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    bodies = [transforms(p, (0.0, 0.0, 0.0, 1.0)) for p in poses_of(worlds, (0.7, 0.7, 0.5), (0.0, 0.5, 0.0))]
    views = [transforms(p, ahead) for p in eyes]
    camera = wc.Camera(
        "eye", width=side, height=side, outputs=("rgb", "depth"), lens=wc.Pinhole(fovy=FOVY),
        position=eyes[0], rotation=(ahead[3], *ahead[:3]),
    )  # fmt: skip
    renderer = wc.Renderer(wc.from_newton(model, state), [camera], graph=False)
    places = wp.from_torch(renderer.camera("eye").position, dtype=wp.vec3)
    positions = [wp.array(p.astype(np.float32), dtype=wp.vec3) for p in eyes]

    def place(index: int) -> None:
        wp.copy(state.body_q, bodies[index])
        wp.copy(places, positions[index])

    found: dict[str, Any] = {"scene": "newton", "gaussians": count, "worlds": worlds, "side": side}
    found["warpcam"] = timed(lambda: renderer.render(), place, device)
    if with_newton:
        sensor, view = SensorCamera(model), wp.clone(views[0])
        rays = SensorCamera.compute_camera_rays_pinhole(side, side, camera_fov=np.radians(FOVY), device=device)
        depth = sensor.allocate_image_depth_forward(worlds, side, side)
        color = sensor.allocate_image_color(worlds, side, side)
        order = SensorCamera.RenderOrder
        for name, options in (
            ("TILED", {"render_order": order.TILED, "tile_width": 8, "tile_height": 8}),
            ("PIXEL_PRIORITY", {"render_order": order.PIXEL_PRIORITY}),
        ):
            config = SensorCamera.RenderConfig(**options)

            def frame(config: Any = config) -> None:
                model.bvh_refit_shapes(state)
                sensor.update(state, view, rays, forward_depth_image=depth, color_image=color, render_config=config)

            def place_both(index: int) -> None:
                wp.copy(state.body_q, bodies[index])
                wp.copy(view, views[index])

            found[f"newton {name}"] = timed(frame, place_both, device)
    return found


def measured_mujoco(count: int, worlds: int, side: int, with_theirs: bool) -> dict[str, Any]:
    """Milliseconds a frame of rgb and depth, with two clouds of so many Gaussians that worlds have in turn."""
    device = wp.get_device()
    mjm = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><light pos="0 0 1"/><body name="eye" mocap="true"><camera name="eye" fovy="{FOVY}" '
        'xyaxes="1 0 0 0 0 1"/></body><body mocap="true"><geom type="capsule" size="0.15 0.3"/></body>'
        "</worldbody></mujoco>"
    )
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=worlds)
    poses = [
        wp.array(np.stack(both, axis=1).astype(np.float32), dtype=wp.vec3)
        for both in zip(
            poses_of(worlds, (0.5, 0.3, 0.3), (0.0, -1.4, 0.1)),
            poses_of(worlds, (0.7, 0.7, 0.5), (0.0, 0.5, 0.0)),
            strict=True,
        )
    ]
    groups = np.arange(worlds) % 2
    clouds = [arrays_of(room(count, seed)) for seed in (0, 1)]
    camera = wc.Camera("eye", width=side, height=side, outputs=("rgb", "depth"))
    scene = wc.from_mujoco_warp(mjm, m, d, splats=wc.Splats(clouds, choice=groups))
    renderer = wc.Renderer(scene, [camera], graph=False)

    def place(index: int) -> None:
        wp.copy(d.mocap_pos, poses[index])
        mjw.kinematics(m, d)
        mjw.camlight(m, d)

    found: dict[str, Any] = {"scene": "mujoco", "gaussians": count, "clouds": 2, "worlds": worlds, "side": side}
    found["warpcam"] = timed(lambda: renderer.render(), place, device)
    if with_theirs:
        both = {key: np.concatenate([cloud[key] for cloud in clouds]).astype(np.float32) for key in clouds[0]}
        rc = mjw.create_render_context(
            mjm,
            nworld=worlds,
            cam_res=(side, side),
            render_rgb=True,
            render_depth=True,
            splat_position=both["positions"],
            splat_rotation=both["rotations"],
            splat_scale=both["scales"],
            splat_rgba=np.concatenate((both["colors"], both["opacities"][:, None]), axis=1),
            splat_adr=np.array((0, count, 2 * count)),
            splat_group_id=groups,
        )

        def frame() -> None:
            mjw.refit_bvh(m, d, rc)
            mjw.render(m, d, rc)

        found["mujoco_warp"] = timed(frame, place, device)
    return found


def arrays_of(cloud: newton.Gaussian) -> dict[str, np.ndarray]:
    """The arrays of ``warpcam.Splats``."""
    return {
        "positions": cloud.positions,
        "rotations": cloud.rotations[:, [3, 0, 1, 2]],
        "scales": cloud.scales,
        "opacities": cloud.opacities,
        "colors": BASE * cloud.sh_coeffs[:, :3] + 0.5,
    }


def timed(frame: Callable[[], Any], place: Callable[[int], None], device: wp.Device) -> float:
    place(0)
    measure.time_first(frame, device)
    return float(measure.time_frames(frame, place, SETS, device, None)["median"])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--gaussians", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--worlds", type=int, default=1024)
    parser.add_argument("--side", type=int, default=64)
    parser.add_argument("--no-newton", action="store_true")
    parser.add_argument("--no-mujoco-warp", action="store_true")
    parser.add_argument("--scenes", nargs="+", choices=("newton", "mujoco"), default=["newton", "mujoco"])
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON")
    arguments = parser.parse_args()
    device = wp.get_preferred_device()
    report: dict[str, Any] = {"about": __doc__, "machine": machine.describe(device), "results": []}
    ways = {"newton": (measured, arguments.no_newton), "mujoco": (measured_mujoco, arguments.no_mujoco_warp)}
    with measure.on_one_stream(device):
        for count in arguments.gaussians:
            for name in arguments.scenes:
                measure_one, alone = ways[name]
                found = measure_one(count, arguments.worlds, arguments.side, not alone)
                print(json.dumps(found), flush=True)
                report["results"].append({"scene": name, **found})
                if arguments.out:
                    arguments.out.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
