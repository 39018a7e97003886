"""One robot with a depth camera, two colour cameras, a lidar and a point cloud, in robot_sensors.png.

The robot turns and reaches over a table. From the top left: the scene from outside, the front camera with a rolling
shutter, the rear camera with a wide lens; colours and measured depth at the wrist, the point cloud of both; below, what
the lidar on the mast sees around it, ranges and intensities, while the robot turns.
"""

import mujoco
import numpy as np
from PIL import Image

import warpcam as wc
from warpcam import sensors, visualize

ROBOT = """
<mujoco>
  <option gravity="0 0 0" timestep="0.002"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <asset>
    <texture name="squares" type="2d" builtin="checker" rgb1=".55 .5 .45" rgb2=".75 .72 .65" width="64" height="64"/>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".8 .9 1" rgb2=".4 .55 .75" width="32" height="192"/>
    <material name="floor" texture="squares" texrepeat="2 2" texuniform="true"/>
  </asset>
  <worldbody>
    <light directional="true" dir="-0.4 0.3 -1" diffuse=".7 .7 .65"/>
    <camera name="outside" pos="-1.5 -2.1 1.7" xyaxes="0.78 -0.62 0 0.33 0.42 0.85" fovy="50"/>
    <geom name="floor" type="plane" size="6 6 .1" material="floor"/>
    <geom name="wall" type="box" size=".1 3 .8" pos="3 0 .8" rgba=".75 .7 .6 1"/>
    <geom name="shelf" type="box" size=".25 .6 .5" pos="-1.8 1.2 .5" rgba=".5 .35 .25 1"/>
    <geom name="pillar" type="cylinder" size=".2 1" pos="-.5 -2.6 1" rgba=".6 .6 .65 1"/>
    <geom name="bin" type="cylinder" size=".25 .3" pos="-2 -.4 .3" rgba=".2 .45 .5 1"/>
    <geom name="table" type="box" size=".35 .6 .02" pos="1.15 0 .5" rgba=".75 .6 .4 1"/>
    <geom name="leg" type="box" size=".06 .5 .24" pos="1.15 0 .24" rgba=".4 .35 .3 1"/>
    <geom name="block" type="box" size=".05 .05 .05" pos="1.0 .12 .57" euler="0 0 30" rgba=".8 .25 .2 1"/>
    <geom name="ball" type="sphere" size=".055" pos="1.1 -.08 .575" rgba=".2 .6 .35 1"/>
    <geom name="can" type="cylinder" size=".04 .07" pos="1.25 .06 .59" rgba=".25 .35 .8 1"/>
    <body name="base" pos="0 0 .18">
      <joint name="turn" type="hinge" axis="0 0 1"/>
      <geom type="box" size=".3 .22 .1" rgba=".9 .55 .15 1" mass="10"/>
      <geom type="cylinder" size=".12 .03" pos=".18 .25 -.06" euler="90 0 0" rgba=".15 .15 .15 1"/>
      <geom type="cylinder" size=".12 .03" pos=".18 -.25 -.06" euler="90 0 0" rgba=".15 .15 .15 1"/>
      <geom type="cylinder" size=".12 .03" pos="-.18 .25 -.06" euler="90 0 0" rgba=".15 .15 .15 1"/>
      <geom type="cylinder" size=".12 .03" pos="-.18 -.25 -.06" euler="90 0 0" rgba=".15 .15 .15 1"/>
      <geom type="cylinder" size=".02 .2" pos="-.2 0 .3" rgba=".3 .3 .3 1"/>
      <geom name="puck" type="cylinder" size=".05 .04" pos="-.2 0 .53" rgba=".1 .1 .12 1"/>
      <body name="shoulder" pos=".1 0 .15">
        <geom type="capsule" size=".05" fromto="0 0 0 .12 0 .5" rgba=".85 .85 .88 1" mass="1"/>
        <body name="forearm" pos=".12 0 .5">
          <joint name="elbow" type="hinge" axis="0 1 0" stiffness="0"/>
          <geom type="capsule" size=".04" fromto="0 0 0 .45 0 .17" rgba=".85 .85 .88 1" mass="1"/>
          <body name="hand" pos=".5 0 .19">
            <geom type="box" size=".05 .05 .03" rgba=".2 .2 .25 1" mass=".3"/>
            <geom type="box" size=".01 .01 .05" pos="0 .04 -.08" rgba=".2 .2 .25 1" mass=".05"/>
            <geom type="box" size=".01 .01 .05" pos="0 -.04 -.08" rgba=".2 .2 .25 1" mass=".05"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
WIDTH, HEIGHT = 240, 136
TABLE = ((0.5, -0.8, 0.45), (1.8, 0.8, 1.0))  # corners of the space around it [m]
AHEAD, BACK = (0.5, 0.5, -0.5, -0.5), (0.5, 0.5, 0.5, 0.5)  # cameras that look along the body's x, and against it

model = mujoco.MjModel.from_xml_string(ROBOT)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
scene = wc.from_mujoco(model, data)

wrist = sensors.realsense_d435()
front = [
    sensors.RollingShutter(readout=0.03),
    sensors.MotionBlur(exposure=0.01),
    sensors.NaturalVignetting(),
    sensors.Exposure(stops=0.3),
    sensors.ShotNoise(electrons=600.0),
]
rear = [
    sensors.ChromaticAberration(red=1.004, blue=0.996),
    sensors.Exposure(stops=-0.3),
    sensors.ShotNoise(electrons=300.0),
    sensors.BayerMosaic(),
    sensors.JpegArtifacts(quality=60),
]
common = {"width": WIDTH, "height": HEIGHT, "shadows": True, "antialiasing": 4}
wide = wc.Distorted(fx=100.0, coefficients=(-0.2, 0.03, 0.0, 0.0))
flow = ("rgb", "depth", "flow")
down = (0.66, 0.24, -0.24, -0.66)  # of the wrist camera, which looks ahead and down
cameras = [
    wc.Camera("outside", **common),
    wc.Camera(
        "front",
        parent="base",
        position=(0.0, 0.2, 0.55),
        rotation=AHEAD,
        lens=wc.Pinhole(fx=170.0),
        outputs=flow,
        **common,
    ),
    wc.Camera("rear", parent="base", position=(-0.31, 0, 0.08), rotation=BACK, lens=wide, **common),
    wrist.camera("wrist", parent="hand", position=(0.06, 0, 0.03), rotation=down, outputs=("rgb",), **common),
]
rig = sensors.Rig(wc.Renderer(scene, cameras), {"wrist": wrist, "front": front, "rear": rear}, seed=0)
clouds = sensors.PointClouds(rig, ["wrist"], num_points=4096, bounds=TABLE, attributes=("rgb",))
lidar = sensors.Lidar(
    scene,
    sensors.patterns.ouster_os1(channels=32, columns=512),
    parent="base",
    position=(-0.2, 0.0, 0.6),
    exclude_body="base",
    noise=sensors.LidarNoise(constant=5.308e-3, linear=-4.073e-6, quadratic=3.083e-6),
    sweep="moving",
    seed=0,
)

data.qvel[:] = 2.0, 0.3  # turn and elbow [rad/s]
rig.read(), lidar.read()
for _ in range(15):
    mujoco.mj_step(model, data)
frames, scan = rig.read(), lidar.read()
cloud = clouds.read()


def picture(camera: str, output: str = "rgb") -> np.ndarray:
    return visualize.picture(output, frames[camera][output].cpu().numpy())[0]


def from_aside(points: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """The cloud from the left of the table, the nearest points last."""
    image = np.full((HEIGHT, WIDTH, 3), 20, np.uint8)
    seen = (points - (1.1, 1.1, 0.9)) @ np.array([(-1.0, 0.0, 0.0), (0.0, -0.35, 0.94), (0.0, 0.94, 0.35)]).T
    pixels = wc.Pinhole(fovy=40.0).project(seen, width=WIDTH, height=HEIGHT).numpy().astype(int)
    for k in np.argsort(seen[:, 2]):
        column, row = pixels[k]
        image[max(row - 1, 0) : max(row + 1, 0), max(column - 1, 0) : max(column + 1, 0)] = colors[k]
    return image


def strip(image: np.ndarray) -> np.ndarray:
    """A scan all around, as wide as three pictures."""
    return np.asarray(Image.fromarray(image).resize((3 * WIDTH, 64), Image.Resampling.NEAREST))


count = int(cloud["count"][0])
points, colors = (cloud[name][0, :count].cpu().numpy() for name in ("points", "rgb"))
ranges = visualize.picture("distance", scan["ranges"].cpu().numpy()[..., None])[0]
light = np.sqrt(scan["intensities"][0].cpu().numpy().clip(0.0, 1.0))
rows = [
    np.concatenate([picture("outside"), picture("front"), picture("rear")], axis=1),
    np.concatenate([picture("wrist"), picture("wrist", "depth"), from_aside(points, colors)], axis=1),
    strip(ranges),
    strip((255.0 * light).astype(np.uint8)[..., None].repeat(3, axis=2)),
]
Image.fromarray(np.concatenate(rows)).save("robot_sensors.png", optimize=True)

measured = (frames["wrist"]["depth"] > 0.0).float().mean().item()
returns = scan["ranges"].isfinite().float().mean().item()
print(f"wrist: {100 * measured:.1f} % of the pixels are measured; cloud: {count} points")
print(f"lidar: {100 * returns:.1f} % of the rays return")
