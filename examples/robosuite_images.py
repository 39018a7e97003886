"""Camera observations of robosuite without OpenGL: see docs/compat/robosuite.md for what to install."""

import numpy as np
from PIL import Image

from warpcam.compat import robosuite as cameras

cameras.install()

import robosuite  # noqa: E402 - before or after install(), as you like

env = robosuite.make(
    "Lift",
    robots="Panda",
    has_renderer=False,
    camera_names=["agentview", "robot0_eye_in_hand"],
    camera_heights=256,
    camera_widths=256,
    camera_depths=True,
    camera_segmentations="instance",
)
random = np.random.default_rng(0)
observations = env.reset()
for _ in range(10):
    observations, reward, done, info = env.step(random.uniform(-1.0, 1.0, env.action_dim))

# As robosuite has them, images begin with their bottom row.
views = [observations[f"{camera}_image"][::-1] for camera in env.camera_names]
Image.fromarray(np.concatenate(views, axis=1)).save("robosuite.png")
print("robosuite.png:", *(f"{name} {image.shape}" for name, image in observations.items() if "agentview" in name))
