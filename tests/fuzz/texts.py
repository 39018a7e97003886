"""Texts of seeds: MJCF, URDF, calibrations and recipes."""

from collections.abc import Iterator

import numpy as np

MJCF = (
    '<mujoco><worldbody><geom type="plane" size="1 1 0.1"/><body><freejoint/><geom type="sphere" size="0.1"/></body>'
    "</worldbody></mujoco>",
    '<mujoco><asset><texture name="t" type="2d" file="a.png"/><material name="m" texture="t" texrepeat="2 2"/>'
    '<mesh name="v" file="a.obj" scale="0.5 0.5 0.5"/></asset><worldbody><geom type="mesh" mesh="v" material="m"/>'
    '<camera name="c" pos="0 0 3" fovy="60"/><light pos="0 0 4" dir="0 0 -1"/></worldbody></mujoco>',
    '<mujoco><asset><hfield name="h" nrow="4" ncol="5" size="1 1 0.2 0.1" elevation="0 1 2 3 4 0 1 2 3 4 0 1 2 3 4 0 1 '
    '2 3 4"/><texture name="s" type="skybox" builtin="gradient" rgb1="0.1 0.2 0.3" rgb2="1 1 1" width="8" height="8"/>'
    '</asset><worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>',
    '<mujoco><asset><texture name="c" type="cube" builtin="checker" width="16" height="16"/><material name="m" '
    'texture="c" reflectance="0.3"/><hfield name="h" file="a.png" size="1 1 0.2 0.1"/></asset><worldbody>'
    '<geom type="box" size="1 1 0.1" material="m"/><geom type="hfield" hfield="h"/></worldbody></mujoco>',
    '<mujoco><worldbody><body name="a"><joint type="hinge" axis="0 1 0" range="-1 1"/><geom type="capsule" '
    'fromto="0 0 0 0 0 1" size="0.05"/><site name="s0"/><body pos="0 0 1"><joint type="ball"/><geom type="ellipsoid" '
    'size="0.1 0.2 0.3"/><site name="s1"/></body></body></worldbody><tendon><spatial width="0.01"><site site="s0"/>'
    '<site site="s1"/></spatial></tendon><keyframe><key qpos="0.1 1 0 0 0"/></keyframe></mujoco>',
    '<mujoco><worldbody><flexcomp name="f" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" dim="2"/><body '
    'name="m" mocap="true"><geom type="cylinder" size="0.1 0.2"/></body></worldbody></mujoco>',
    '<mujoco><include file="b.xml"/><worldbody><replicate count="3" offset="1 0 0"><geom size="0.1"/></replicate>'
    '<frame pos="0 0 1"><geom size="0.2"/></frame></worldbody></mujoco>',
    '<mujoco><asset><mesh name="t" vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 2 1 0 1 3 0 3 2 1 2 3"/></asset><default>'
    '<geom rgba="1 0 0 0.5"/></default><worldbody><geom type="mesh" mesh="t"/></worldbody></mujoco>',
)
RECIPES = (
    "joints: file\nscene:\n  light_diffuse: {low: 0.5, high: 1.2, of: factor}\n",
    "cameras:\n  a:\n    shell: {target: [0, 0, 0], radius: [1, 2], azimuth: [0, 90], elevation: [10, 60]}\n",
    "distractors: {count: 3, low: [0, 0, 0], high: [1, 1, 1], shapes: [box, sphere]}\nspacing: 0.1\n",
    "labels: {by: body, classes: {a: [b, c]}, keypoints: true}\n",
    "sensors:\n  a:\n    effects: [{name: Noise, sigma: 0.1}]\n",
    "backgrounds: {folder: ., probability: 0.5}\ntextures: {folder: .}\n",
)
KALIBR = (
    ("pinhole", "radtan", (458.6, 457.3, 367.2, 248.4), (-0.28, 0.07, 0.0009, -1.2e-4)),
    ("pinhole", "equidistant", (190.9, 190.8, 254.9, 256.9), (-0.013, 0.05, -0.045, 1e-2)),
    ("omni", "radtan", (0.8, 833.0, 830.3, 373.8, 253.7), (-0.33, 0.13, 0.0006, 0.0006)),
    ("ds", "none", (-0.2, 0.6, 205.0, 206.0, 281.0, 183.0), ()),
    ("eucm", "none", (0.6, 1.1, 205.0, 206.0, 281.0, 183.0), ()),
    ("pinhole", "none", (300.0, 301.0, 320.0, 240.0), ()),
)
CUBE = b"".join(b"v %d %d %d\n" % (k & 1, k >> 1 & 1, k >> 2) for k in range(8)) + b"f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\n"


def mjcf_files(image: bytes) -> dict[str, bytes]:
    """Files that texts of ``MJCF`` name."""
    return {"a.png": image, "a.obj": CUBE, "b.xml": b'<mujoco><worldbody><geom size="0.3"/></worldbody></mujoco>'}


def urdf() -> Iterator[str]:
    """Robots of one to four links, of each kind of joint and shape."""
    shapes = (
        '<box size="1 1 1"/>', '<sphere radius="0.5"/>', '<cylinder radius="0.2" length="1"/>',
        '<mesh filename="a.stl" scale="0.1 0.1 0.1"/>', '<mesh filename="package://here/a.obj"/>',
    )  # fmt: skip
    looks = (
        "", '<material name="red"><color rgba="1 0 0 1"/></material>',
        '<material name="paint"><texture filename="a.png"/></material>',
    )  # fmt: skip
    joints = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
    for number, (shape, look) in enumerate((shape, look) for shape in shapes for look in looks):
        links = ""
        for link in range(1 + number % 4):
            links += (
                f'<link name="l{link}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" '
                f'izz="1"/></inertial><visual><origin xyz="0 0 {link}" rpy="0 0.1 0"/><geometry>{shape}</geometry>'
                f"{look}</visual><collision><geometry>{shapes[number % 3]}</geometry></collision></link>"
            )
            if link:
                links += (
                    f'<joint name="j{link}" type="{joints[number % 6]}"><parent link="l{link - 1}"/><child '
                    f'link="l{link}"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
                )
        yield f'<robot name="r{number}">{links}</robot>'


def calibrations() -> Iterator[str]:
    """Kalibr's, ROS's, OpenCV's and KITTI's files."""
    for model, kind, numbers, coefficients in KALIBR:
        for count in (1, 2, 3):
            yield "".join(
                f"cam{place}:\n  camera_model: {model}\n  distortion_model: {kind}\n  intrinsics: {list(numbers)}\n"
                f"  distortion_coeffs: {list(coefficients)}\n  resolution: [752, 480]\n"
                for place in range(count)
            )
    matrix = [410.0, 0.0, 320.0, 0.0, 405.0, 240.0, 0.0, 0.0, 1.0]
    for model, count in (("plumb_bob", 5), ("rational_polynomial", 8), ("equidistant", 4), ("none", 0), ("fisheye", 4)):
        values = [0.01] * count
        yield (
            "image_width: 640\nimage_height: 480\ncamera_name: a\n"
            f"camera_matrix: {{rows: 3, cols: 3, data: {matrix}}}\n"
            f"distortion_model: {model}\ndistortion_coefficients: {{rows: 1, cols: {count}, data: {values}}}\n"
        )
        yield f"height: 480\nwidth: 640\ndistortion_model: {model}\nd: {values}\nk: {matrix}\n---\nheight: 1\n"
    for count in (4, 5, 8, 12, 14):
        yield (
            "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n"
            f"   cols: 3\n   dt: d\n   data: {matrix}\ndistortion_coefficients: !!opencv-matrix\n   rows: {count}\n"
            f"   cols: 1\n   dt: d\n   data: {[0.001] * count}\n"
        )
    rows = " ".join(f"{value:e}" for value in np.eye(3, 4).reshape(-1))
    yield "".join(f"P{camera}: {rows}\n" for camera in range(4)) + f"R_rect: {rows}\nTr_velo_cam: {rows}\n"
