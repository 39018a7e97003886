"""A cart-pole balanced from pixels: brax's PPO, simulation by MJX and images by warpcam in one program of JAX.

Needs brax and MJX: pip install 'warpcam[jax]' mujoco-mjx brax. Its defaults show on a CPU that all runs, in a minute;
``--steps 2000000 --worlds 1024`` is a training for a GPU.
"""

import argparse
import functools
import time

import jax
import jax.numpy as jnp
import mujoco
from brax.envs.base import Env, State
from brax.training.agents.ppo import networks_vision
from brax.training.agents.ppo import train as ppo
from mujoco import mjx

import warpcam as wc
from warpcam.jax import Renderer

SIZE, STACK, SUBSTEPS = 32, 2, 2
LEAN, REACH = 0.6, 0.95  # where an episode ends [rad, m]

SCENE = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast" iterations="4"><flag contact="disable"/></option>
  <worldbody>
    <light pos="0 -1 3" dir="0 .3 -1"/>
    <camera name="side" pos="0 -2.2 0.5" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <geom type="plane" size="0 0 1" pos="0 0 -0.3" rgba="0.3 0.35 0.4 1"/>
    <body pos="0 0 0.2">
      <joint name="slide" type="slide" axis="1 0 0" range="-1 1" damping="1"/>
      <geom type="box" size="0.2 0.1 0.1" mass="1" rgba="0.8 0.6 0.2 1"/>
      <body>
        <joint name="hinge" axis="0 1 0" damping="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.05" mass="0.2" rgba="0.9 0.9 0.9 1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="slide" gear="10" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


class CartPole(Env):
    """One world; brax vmaps it. An observation is the last two grey images, and nothing else."""

    def __init__(self) -> None:
        self.host = mujoco.MjModel.from_xml_string(SCENE)
        self.model = mjx.put_model(self.host, impl="jax")
        side = wc.Camera("side", width=SIZE, height=SIZE, outputs=("rgb",), antialiasing=4)
        self.render = Renderer(self.host, [side])

    def reset(self, rng: jax.Array) -> State:
        """A state with the pole nearly upright."""
        position = jax.random.uniform(rng, (2,), minval=-0.1, maxval=0.1)
        data = mjx.make_data(self.host, impl="jax").replace(qpos=position)
        data = mjx.forward(self.model, data)
        grey = self.grey(data)
        observation = {"pixels/side": jnp.concatenate([grey] * STACK, axis=-1)}
        return State(data, observation, jnp.float32(0.0), jnp.float32(0.0), {"reward": jnp.float32(0.0)}, {})

    def step(self, state: State, action: jax.Array) -> State:
        """Push the cart for two steps of the simulation."""
        data = state.pipeline_state.replace(ctrl=jnp.clip(action, -1.0, 1.0))
        data = jax.lax.fori_loop(0, SUBSTEPS, lambda _, data: mjx.step(self.model, data), data)
        data = mjx.kinematics(self.model, data)  # poses of the state, and not of that before it
        place, lean = data.qpos
        reward = jnp.cos(lean) * (1.0 - 0.5 * jnp.abs(place))
        done = ((jnp.abs(lean) > LEAN) | (jnp.abs(place) > REACH)).astype(jnp.float32)
        frames = jnp.concatenate([state.obs["pixels/side"][..., 1:], self.grey(data)], axis=-1)
        return state.replace(
            pipeline_state=data, obs={"pixels/side": frames}, reward=reward, done=done, metrics={"reward": reward}
        )

    def grey(self, data: mjx.Data) -> jax.Array:
        """Image of a state, float32 (height, width, 1) from -0.5 to 0.5."""
        return self.render(data)["side"]["rgb"].mean(axis=-1, keepdims=True) / 255.0 - 0.5

    @property
    def observation_size(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the observations."""
        return {"pixels/side": (SIZE, SIZE, STACK)}

    @property
    def action_size(self) -> int:
        """One push."""
        return 1

    @property
    def backend(self) -> str:
        """Simulator."""
        return "mjx"


def main() -> None:
    """Train, and print the mean return of each evaluation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--evaluations", type=int, default=3)
    options = parser.parse_args()
    start = time.perf_counter()

    def tell(steps: int, metrics: dict[str, float]) -> None:
        seconds = time.perf_counter() - start
        print(f"{steps:>9} steps, {seconds:6.1f} s: mean return {metrics['eval/episode_reward']:.1f}", flush=True)

    ppo.train(
        CartPole(),
        num_timesteps=options.steps,
        vision=True,
        num_envs=options.worlds,
        num_eval_envs=options.worlds,
        num_evals=options.evaluations,
        episode_length=250,
        unroll_length=16,
        batch_size=options.worlds // 4,
        num_minibatches=4,
        num_updates_per_batch=3,
        learning_rate=1e-3,
        entropy_cost=0.01,
        discounting=0.97,
        network_factory=functools.partial(
            networks_vision.make_ppo_networks_vision,
            policy_hidden_layer_sizes=(64,),
            value_hidden_layer_sizes=(64,),
            cnn_output_channels=(8, 16),
            cnn_kernel_size=(5, 3),
            cnn_stride=(2, 2),
            cnn_global_pool="none",  # a mean over the image would not say where the pole is
        ),
        progress_fn=tell,
    )


if __name__ == "__main__":
    main()
