"""Replays of a task of robosuite equal what its own environment gives, turned round as robomimic turns it."""

import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp

h5py = pytest.importorskip("h5py", reason="pip install 'warpcam[datasets]'")
pytest.importorskip(
    "robosuite", reason="robosuite needs an environment of its own: see 'robosuite' in .ci/run", exc_type=ImportError
)
pytestmark = pytest.mark.filterwarnings("ignore")  # robosuite and what it imports warn of their own use

from warpcam.compat import robosuite as front_end  # noqa: E402
from warpcam.datasets import replay  # noqa: E402

CAMERAS, WIDTH, HEIGHT, STEPS = ("agentview", "robot0_eye_in_hand"), 64, 48, 5


def test_lift(device: wp.Device, tmp_path: Path) -> None:
    """Colours bit for bit; depth as far as 24 bits of a depth buffer tell."""
    front_end.install(device)
    try:
        import robosuite
        from robosuite.utils.camera_utils import get_real_depth_map

        env = robosuite.make(
            "Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=True, use_camera_obs=True,
            camera_names=list(CAMERAS), camera_heights=HEIGHT, camera_widths=WIDTH, camera_depths=True,
        )  # fmt: skip
        env.reset()
        xml = env.sim.model.get_xml()
        env.reset_from_xml_string(xml)
        random, states = np.random.default_rng(0), []
        for _ in range(STEPS):
            states.append(env.sim.get_state().flatten())
            env.step(random.uniform(-1.0, 1.0, env.action_dim))
        with h5py.File(tmp_path / "demos.hdf5", "w") as file:
            demo = file.create_group("data/demo_0")
            demo.parent.attrs["env_args"] = json.dumps({"env_name": "Lift", "type": 1, "env_kwargs": {}})
            demo.attrs["model_file"], demo["states"] = xml, np.stack(states)
        output = tmp_path / "images.hdf5"
        replay(
            tmp_path / "demos.hdf5", output, cameras=CAMERAS, width=WIDTH, height=HEIGHT, depth=True, batch=3,
            device=device,
        )  # fmt: skip
        with h5py.File(output) as file:
            obs = file["data/demo_0/obs"]
            for row, state in enumerate(states):
                env.sim.set_state_from_flattened(state)
                env.sim.forward()
                seen = env._get_observations(force_update=True)
                for camera in CAMERAS:
                    np.testing.assert_array_equal(obs[f"{camera}_image"][row], seen[f"{camera}_image"][::-1])
                    depth = get_real_depth_map(env.sim, seen[f"{camera}_depth"])[::-1]
                    np.testing.assert_allclose(obs[f"{camera}_depth"][row], depth, atol=2e-4)
                    assert obs[f"{camera}_image"][row].std() > 30.0
    finally:
        front_end.uninstall()
