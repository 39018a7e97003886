"""An arm of seven joints, made for the tasks here: of no product."""

from collections.abc import Sequence

import mujoco

JOINTS = 7
HOME_FORWARD = (0.0, 0.0, 0.0, 1.7, 0.0, 0.95, 0.0)  # the tool points down, and 28 degrees forward [rad]
HOME_DOWN = (0.0, 0.5, 0.0, 1.7, 0.0, 0.94, 0.0)  # the tool points down [rad]
# Axis of a joint, limit [rad], length of the link behind it [m], its radius [m], its mass [kg].
LINKS: Sequence[tuple[str, float, float, float, float]] = (
    ("0 0 1", 2.8, 0.15, 0.06, 2.0),
    ("0 1 0", 1.9, 0.20, 0.055, 2.0),
    ("0 0 1", 2.8, 0.15, 0.05, 1.5),
    ("0 1 0", 2.4, 0.20, 0.045, 1.5),
    ("0 0 1", 2.8, 0.15, 0.04, 1.0),
    ("0 1 0", 2.2, 0.08, 0.04, 0.5),
    ("0 0 1", 2.8, 0.02, 0.035, 0.3),
)
BASE = 0.15  # height of the first joint [m]
STIFFNESS = 400.0, 400.0, 300.0, 300.0, 150.0, 150.0, 100.0  # of the position servos [N m / rad]


def compile_arm(hand: str, world: str, *, actuators: str = "", options: str = "") -> mujoco.MjModel:
    """Compile the arm with its base at the origin, compensated for its weight, and servos of position for its joints.

    Joints, links and servos are named ``joint0`` to ``joint6``, and so on. The servos are the first of the actuators.
    In the zero pose all links point up, along z.

    Args:
        hand: MJCF of what the last link carries. Its frame has z along the tool.
        world: MJCF of other bodies.
        actuators: MJCF of other actuators.
        options: MJCF of sections beside these.
    """
    opened, height = "", BASE
    for number, (axis, limit, length, radius, mass) in enumerate(LINKS):
        opened += (
            f'<body name="link{number}" pos="0 0 {height}" gravcomp="1">'
            f'<joint name="joint{number}" axis="{axis}" range="{-limit} {limit}" damping="2" armature="0.1"/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 {length}" size="{radius}" mass="{mass}" class="link"/>'
        )
        height = length
    servos = "".join(
        f'<position name="servo{number}" joint="joint{number}" kp="{stiffness}" kv="{0.12 * stiffness}" '
        f'ctrlrange="{-limit} {limit}"/>'
        for number, ((_, limit, *_), stiffness) in enumerate(zip(LINKS, STIFFNESS, strict=True))
    )
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  {options}
  <visual><headlight ambient="0.4 0.4 0.4" diffuse="0.5 0.5 0.5" specular="0 0 0"/></visual>
  <default>
    <default class="link"><geom contype="0" conaffinity="0" rgba="0.75 0.77 0.8 1"/></default>
  </default>
  <worldbody>
    <camera name="overview" pos="1.5 -1.3 1.1" xyaxes="0.72 0.69 0 -0.37 0.39 0.84" fovy="40"/>
    <geom type="cylinder" fromto="0 0 0 0 0 {BASE}" size="0.08" rgba="0.3 0.32 0.36 1" class="link"/>
    {world}
    {opened}
    <body name="hand" pos="0 0 {height}" gravcomp="1">{hand}</body>
    {"</body>" * len(LINKS)}
  </worldbody>
  <actuator>{servos}{actuators}</actuator>
</mujoco>""")
