"""Every block of Python in the README and the docs runs as it stands, on a CPU and with few worlds."""

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

ROOT = Path(__file__).resolve().parents[2]
WORLDS = 8
Names = dict[str, Any]  # what a reader has of his own
BLOCKS = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
# Textures 0 to 7 are those that the pages choose from; the shapes 3 to 5 are on the table.
TEXTURES = "".join(f'<texture name="{i}" type="2d" builtin="flat" width="8" height="8"/>' for i in range(8))
MODEL = f"""
<mujoco>
  <asset>
    {TEXTURES}
    <material name="paint" texture="0"/>
  </asset>
  <worldbody>
    <light pos="2 1 4" dir="-2 -1 -4"/><light pos="-2 1 4" dir="2 -1 -4"/><light pos="0 0 4"/>
    <camera name="front" pos="0 -3 1" xyaxes="1 0 0 0 0.4 0.9"/>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <geom name="table" type="box" size=".6 .6 .1" pos="0 0 .1" material="paint"/>
    <geom name="block" type="box" size=".1 .1 .1" pos="0 0 .3"/>
    <geom name="ball" size=".1" pos=".2 0 .3"/><geom name="can" type="capsule" size=".1 .1" pos="-.2 0 .4"/>
    <body name="gripper" pos="0 0 1"><freejoint/>
      <geom name="palm" type="box" size=".1 .1 .02"/><camera name="wrist" pos=".3 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""
CONTROLLED = """
<mujoco model="robot">
  <worldbody>
    <body name="hand" pos="0 0 1"><freejoint/><geom name="palm" type="box" size=".1 .1 .02"/></body>
  </worldbody>
</mujoco>
"""
CAMCHAIN = """
cam0: {camera_model: pinhole, intrinsics: [458.6, 457.3, 367.2, 248.4], distortion_model: radtan,
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002], resolution: [752, 480]}
"""
KITCHEN = """#usda 1.0
(metersPerUnit = 1.0
 upAxis = "Z")
def Xform "World" {
  def Camera "Camera"
  {
    double3 xformOp:translate = (0, 0, 4)
    uniform token[] xformOpOrder = ["xformOp:translate"]
  }
  def Sphere "Mug" {
  }
  def Xform "Arm"
  {
    def Cube "link3" {
    }
  }
}
"""


def simulated() -> Names:
    mjm = mujoco.MjModel.from_xml_string(MODEL)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=WORLDS)
    return {"mujoco": mujoco, "mjm": mjm, "mjd": mjd, "model": mjm, "data": mjd, "m": m, "d": d}


def in_a_file() -> Names:
    Path("scene.xml").write_text(MODEL)
    return {}


def looked_at(*outputs: str) -> Names:
    names = simulated()
    scene = wc.from_mujoco_warp(*(names[name] for name in ("mjm", "m", "d")))
    own: Names = {"lens": wc.Pinhole(fovy=58.0), "position": (0.0, -3.0, 1.0)}
    cameras = [wc.Camera("wrist", width=16, height=16, outputs=outputs or ("depth",))]
    cameras += [wc.Camera("front", width=16, height=16, outputs=("depth",), **own)]
    renderer = wc.Renderer(scene, cameras)
    done = torch.zeros(WORLDS, dtype=torch.bool)
    ours = {"scene": scene, "cameras": cameras, "renderer": renderer, "images": renderer.render()}
    return {**names, **ours, "done": done, "episode": 3, "start": torch.zeros(3)}


def cameras() -> Names:
    Path("camchain.yaml").write_text(CAMCHAIN)
    directions = np.tile((0.0, 0.0, -1.0), (64, 64, 1))
    return {**looked_at(), "directions": directions, "origins": 0.1 * directions}


def outputs() -> Names:
    names = looked_at()

    def step() -> None:
        names["d"].geom_xpos.fill_(0.1)

    return {**names, "step": step}


def scenes() -> Names:
    return looked_at("segmentation")


def point_clouds() -> Names:
    pytest.importorskip("trimesh")
    return looked_at()


def viewer() -> Names:
    pytest.importorskip("viser")
    return {**looked_at(), "step": lambda: None}


def memory() -> Names:
    return looked_at("rgb")


def newton() -> Names:
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("newton")

    class Solver:
        def step(self, state: Any, other: Any, *rest: Any) -> None:
            other.assign(state)

    Path("robot.xml").write_text(CONTROLLED)
    Path("src/arm_description").mkdir(parents=True)
    Path("src/arm_description/box.stl").write_bytes(trimesh.creation.box().export(file_type="stl"))
    mesh = '<visual><geometry><mesh filename="package://arm_description/box.stl"/></geometry></visual>'
    Path("arm.urdf").write_text(f'<robot name="arm"><link name="base">{mesh}</link></robot>')
    return {"solver": Solver(), "control": None, "contacts": None, "dt": 0.01}


def usd() -> Names:
    pytest.importorskip("pxr.Usd")
    Path("kitchen.usda").write_text(KITCHEN)
    return {}


def skies() -> Names:
    oiio: Any = pytest.importorskip("OpenImageIO")
    for name in ("noon.hdr", "studio.exr"):
        output = oiio.ImageOutput.create(name)
        assert output.open(name, oiio.ImageSpec(16, 8, 3, "float"))
        assert output.write_image(np.full((8, 16, 3), 0.5, np.float32))
        output.close()
    return usd()


def sensors() -> Names:
    newton = pytest.importorskip("newton")
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.5)
    model = builder.finalize()
    poses = wp.array([wp.transform_identity()], dtype=wp.transformf)
    return {"model": model, "state": model.state(), "num_views": 1, "camera_transforms": poses}


def timed() -> Names:
    names = looked_at("rgb", "depth", "flow", "flow_valid")

    def step() -> None:
        names["d"].time.assign(names["d"].time.numpy() + 0.01)

    return {**names, "step": step}


def vector_env() -> Names:
    gymnasium = pytest.importorskip("gymnasium")
    names = simulated()

    class MyVectorEnv(gymnasium.vector.VectorEnv):
        def __init__(self, count: int):
            self.num_envs = count
            self.mjm, self.m, self.d = (names[name] for name in ("mjm", "m", "d"))
            self.single_observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
            self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
            self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, count)
            self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, count)
            self.metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}

        def reset(self, **options: Any) -> Any:
            return torch.zeros(self.num_envs, 2), {}

    return {"MyVectorEnv": MyVectorEnv}


def training() -> Names:
    for name in ("gymnasium", "rsl_rl", "imageio_ffmpeg"):
        pytest.importorskip(name, reason="pip install 'warpcam[train]'")
    return {}


def in_jax() -> Names:
    pytest.importorskip("jax", reason="pip install 'warpcam[jax]'")
    return simulated()


def gym_pictures() -> Names:
    pytest.importorskip("gymnasium")
    pytest.importorskip("moviepy")
    return {}


def control_suite() -> Names:
    engine = pytest.importorskip("dm_control.mujoco.engine")
    try:
        engine.Physics.from_xml_string("<mujoco/>")
    except AttributeError as error:
        pytest.skip(f"this dm_control does not know MuJoCo {mujoco.__version__}: {error}")
    return {}


def isaac_gym() -> Names:
    pytest.importorskip("newton")
    import gym_worlds

    world = gym_worlds.walls(wp.get_device("cpu"), 1)
    world.render()
    return {"gym": gym_worlds.GYM, "sim": world.sim, "env": world.envs[0], "camera": world.cameras[0]}


def recorded() -> Names:
    """A vector env that ends each episode after ten steps, and a file of one demonstration."""
    for name in ("h5py", "imageio_ffmpeg", "pandas", "pyarrow"):
        pytest.importorskip(name, reason="pip install 'warpcam[datasets]'")
    import h5py

    names, ends = simulated(), itertools.cycle([False] * 9 + [True])

    def step(actions: np.ndarray) -> tuple[Any, ...]:
        ended = np.full(2, next(ends))
        return {"state": actions}, np.zeros(2), ended, ~np.ones(2, bool), {}

    state = np.concatenate(([0.0], names["mjd"].qpos, names["mjd"].qvel))
    with h5py.File("demos.hdf5", "w") as file:
        demo = file.create_group("data/demo_0")
        demo["states"], demo.attrs["model_file"] = state[None], MODEL.replace("wrist", "agentview")
    return {
        "env": SimpleNamespace(step=step),
        "policy": lambda seen: seen["state"],
        "observations": {"state": np.ones((2, 3))},
    }


PAGES: dict[str, Callable[[], Names]] = {
    "README.md": in_a_file,
    "docs/cameras.md": cameras,
    "docs/datasets_trajectories.md": recorded,
    "docs/first_picture.md": simulated,
    "docs/index.md": simulated,
    "docs/jax.md": in_jax,
    "docs/labels.md": looked_at,
    "docs/memory.md": memory,
    "docs/mujoco_warp.md": simulated,
    "docs/newton.md": newton,
    "docs/outputs.md": outputs,
    "docs/environments.md": skies,
    "docs/path_tracing.md": usd,
    "docs/looks.md": usd,
    "docs/splats.md": in_a_file,
    "docs/randomize.md": looked_at,
    "docs/scenes.md": scenes,
    "docs/sensors.md": looked_at,
    "docs/sensors_lidar.md": looked_at,
    "docs/sensors_time.md": timed,
    "docs/sensors_point_clouds.md": point_clouds,
    "docs/sensors_color.md": memory,
    "docs/sensors_depth.md": simulated,
    "docs/sensors_stereo.md": simulated,
    "docs/training.md": training,
    "docs/training_gpus.md": training,
    "docs/usd.md": usd,
    "docs/viewer.md": viewer,
    "docs/compat/dm_control.md": control_suite,
    "docs/compat/genesis.md": simulated,
    "docs/compat/gymnasium-vector.md": vector_env,
    "docs/compat/gymnasium.md": gym_pictures,
    "docs/compat/isaacgym.md": isaac_gym,
    "docs/compat/mujoco.md": simulated,
    "docs/compat/mujoco_warp.md": simulated,
    "docs/compat/newton.md": sensors,
}
# In environments of their own, where the tests of tests/compat do what these pages do.
ELSEWHERE = {f"docs/compat/{name}.md" for name in ("isaaclab", "mjlab", "robosuite")}


def blocks_of(page: str) -> list[str]:
    """The page's blocks, with fewer worlds and without a GPU."""
    text = (ROOT / page).read_text().replace("4096", str(WORLDS)).replace('"cuda"', '"cpu"')
    return BLOCKS.findall(text)


@pytest.mark.usefixtures("small_maps")
@pytest.mark.parametrize("page", PAGES)
def test_blocks_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with wp.ScopedDevice("cpu"):
        names: Names = {"wc": wc, "torch": torch, "np": np, **PAGES[page]()}
        try:
            for number, block in enumerate(blocks_of(page)):
                path = tmp_path / f"{Path(page).stem}_block_{number}.py"  # where Warp finds the source of kernels
                path.write_text(block)
                exec(compile(block, str(path), "exec"), names)
        finally:
            for patch in {"pictures", "isaacgym"} & set(names):
                names[patch].uninstall()


def test_every_page_with_code_is_run() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    with_code = {str(path.relative_to(ROOT)) for path in pages if BLOCKS.search(path.read_text())}
    assert with_code == PAGES.keys() | ELSEWHERE
