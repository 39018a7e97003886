"""Tasks by the names of the command line."""

from collections.abc import Mapping

from warpcam.train.cartpole import CartPole, SwingUp
from warpcam.train.mujoco_task import MujocoTask
from warpcam.train.pick import Pick
from warpcam.train.quadruped import Quadruped
from warpcam.train.reach import Reach

TASKS: Mapping[str, type[MujocoTask]] = {
    "cartpole": CartPole,
    "swing-up": SwingUp,
    "reach": Reach,
    "pick": Pick,
    "quadruped": Quadruped,
}
