"""Worlds that made no image."""

import logging

import numpy as np
import warp as wp


def tell_faults(faults: wp.array) -> None:
    """Warn of faulty worlds, (world,) uint8: most often their state was never forwarded."""
    if count := int(np.count_nonzero(faults.numpy())):
        logging.getLogger("warpcam").warning(
            "render: %d of %d worlds made no image or miss a shape, see Renderer.faulty: a pose, size or lens is not "
            "finite, or a rotation or size is 0, as in a state whose kinematics never ran. Run mj_forward, "
            "mujoco_warp.forward or newton.eval_fk first, or call render(forward=True)",
            count,
            len(faults),
        )
