"""PPO of rsl_rl as CUDA graphs: acting is one, and learning from a mini batch is one."""

from collections.abc import Callable
from itertools import chain
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from torch import nn

from warpcam.core.errors import WarpcamError

SLOWEST, FASTEST, FACTOR = 1e-5, 1e-2, 1.5  # of the adaptive learning rate, as in rsl_rl
WARM = 3  # calls before one is recorded


class _Graph:
    """Work on memory that stays where it is: run some times by itself, then recorded, then replayed.

    Args:
        work: Enqueues the work.
        stream: Where it is recorded, and where it runs before, since autograd keeps the stream; None records nothing.
    """

    def __init__(self, work: Callable[[], None], stream: torch.cuda.Stream | None):
        self.work, self.stream, self._calls = work, stream, 0
        self._graph: Any = None

    def __call__(self) -> None:
        if self.stream is None:
            self.work()
        elif self._graph is not None:
            self._graph.replay()
        elif self._calls < WARM:
            self._calls += 1
            here = torch.cuda.current_stream(self.stream.device)
            self.stream.wait_stream(here)
            with torch.cuda.stream(self.stream):
                self.work()
            here.wait_stream(self.stream)
        else:
            self._graph = torch.cuda.CUDAGraph()
            # Other threads, of a recorder for example, may go on meanwhile.
            with torch.cuda.graph(self._graph, stream=self.stream, capture_error_mode="thread_local"):
                self.work()
            self._graph.replay()


class GraphedPPO(PPO):  # type: ignore[misc]
    """``PPO`` of rsl_rl that waits for a GPU once in an update instead of five times in each mini batch.

    Losses, the adaptive learning rate and the optimizer's steps stay on the device. It learns what ``PPO`` learns. With
    several processes gradients are averaged between two graphs.

    Args:
        actor: As ``PPO`` has it, without memory.
        critic: Likewise.
        storage: As ``PPO`` has it.
        graphs: Whether a GPU's work is recorded.
        options: Others of ``PPO``, but for its extensions: random network distillation, symmetry, mixed precision and
            other optimizers than Adam.
    """

    def __init__(self, actor: Any, critic: Any, storage: Any, *, graphs: bool = True, **options: Any):
        for name, plain in (("optimizer", "adam"), ("rnd_cfg", None), ("symmetry_cfg", None)):
            if options.get(name, plain) != plain:
                raise WarpcamError(f"GraphedPPO: {name} {options[name]!r} came, only {plain!r} is possible; use PPO")
        if options.get("use_mixed_precision", False):
            raise WarpcamError("GraphedPPO: use_mixed_precision came, give the models half=True instead")
        if actor.is_recurrent or critic.is_recurrent:
            raise WarpcamError("GraphedPPO: a recurrent model came, only models without memory are possible; use PPO")
        super().__init__(actor, critic, storage, **options)
        self.learning_rate: float
        gpu = torch.device(self.device).type == "cuda"
        stream = torch.cuda.Stream(self.device) if graphs and gpu else None  # type: ignore[no-untyped-call]
        with torch.inference_mode(False):
            self._rate = torch.tensor(self.learning_rate, device=self.device)
            self._losses = torch.zeros(3, device=self.device)  # value, surrogate, entropy
            self._divergence = torch.zeros((), device=self.device)
            self._shared = self._divergence  # of several processes: gradients and divergence of a mini batch
            size = storage.num_envs * storage.num_transitions_per_env // self.num_mini_batches
            self._rows = torch.zeros(size, dtype=torch.long, device=self.device)
            self._advantages = torch.zeros_like(storage.advantages)
        self.optimizer = torch.optim.Adam(self._weights(), lr=self._rate, fused=gpu, capturable=gpu)
        self._seen: Any = None
        self._acted: tuple[Any, ...] = ()
        self._act, self._update, self._back, self._forth = (
            _Graph(work, stream) for work in (self._act_as_seen, self._update_batch, self._backward, self._apply)
        )

    def act(self, obs: Any) -> torch.Tensor:
        """Sample actions, and keep what learning needs of them."""
        with torch.inference_mode(False), torch.no_grad():
            if self._seen is None:
                self._seen = obs.clone()
            for group, values in obs.items():
                self._seen[group].copy_(values)
            self._act()
        kept = self.transition
        kept.hidden_states, kept.observations = (None, None), self._seen
        kept.actions, kept.values, kept.actions_log_prob, kept.distribution_params = self._acted
        return kept.actions

    def update(self) -> dict[str, float]:
        """Learn from what is stored; returns the mean losses.

        Raises:
            WarpcamError: The losses are no numbers, since observations or rewards are none.
        """
        stored = self.storage
        with torch.inference_mode(False):
            self._advantages.copy_(stored.advantages)
            self._losses.zero_()
            rows = torch.randperm(self.num_mini_batches * len(self._rows), device=self.device)
            rows = rows.reshape(self.num_mini_batches, -1)
            for _ in range(self.num_learning_epochs):
                for batch in rows:
                    self._rows.copy_(batch)
                    if self.is_multi_gpu:
                        self._back()
                        torch.distributed.all_reduce(self._shared)
                        self._forth()
                    else:
                        self._update()
            self._normalize()
        count = self.num_learning_epochs * self.num_mini_batches
        value, surrogate, entropy, self.learning_rate = torch.cat((self._losses / count, self._rate[None])).tolist()
        losses = {"value": value, "surrogate": surrogate, "entropy": entropy}
        if not all(abs(loss) < float("inf") for loss in losses.values()):
            told = ", ".join(f"{name} {loss}" for name, loss in losses.items())
            raise WarpcamError(f"the losses are no finite numbers ({told}): look for such in observations and rewards")
        stored.clear()
        return losses

    def load(self, loaded_dict: dict[str, Any], load_cfg: dict[str, Any] | None, strict: bool) -> bool:
        """Load models and optimizer; weights and learning rate stay where graphs have them."""
        again = super().load(loaded_dict, load_cfg, strict)
        with torch.inference_mode(False):
            self._rate.fill_(float(self.learning_rate))
        self.learning_rate = float(self._rate)
        for group in self.optimizer.param_groups:
            group["lr"] = self._rate
        # The optimizer's moments have other places now.
        self._update, self._forth = (_Graph(graph.work, graph.stream) for graph in (self._update, self._forth))
        return again

    def _weights(self) -> Any:
        return chain(self.actor.parameters(), self.critic.parameters())

    def _act_as_seen(self) -> None:
        super().act(self._seen)
        kept = self.transition
        self._acted = kept.actions, kept.values, kept.actions_log_prob, kept.distribution_params

    def _update_batch(self) -> None:
        self._backward()
        self._apply()

    def _backward(self) -> None:
        """Compute gradients of the losses of the mini batch."""
        stored, rows = self.storage, self._rows
        seen = {group: values.flatten(0, 1)[rows] for group, values in stored.observations.items()}
        actions, before, returns, log_before, advantages = (
            values.flatten(0, 1)[rows]
            for values in (stored.actions, stored.values, stored.returns, stored.actions_log_prob, self._advantages)
        )
        if self.normalize_advantage_per_mini_batch:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        self.actor(seen, stochastic_output=True)
        log_now, entropy = self.actor.get_output_log_prob(actions), self.actor.output_entropy.mean()
        values = self.critic(seen)
        with torch.no_grad():
            old = tuple(values.flatten(0, 1)[rows] for values in stored.distribution_params)
            new = tuple(values.detach() for values in self.actor.output_distribution_params)
            self._divergence.copy_(self.actor.get_kl_divergence(old, new).mean())
        advantages, clip = advantages.squeeze(1), self.clip_param
        ratio = torch.exp(log_now - log_before.squeeze(1))
        surrogate = -torch.minimum(advantages * ratio, advantages * ratio.clamp(1.0 - clip, 1.0 + clip)).mean()
        errors = (values - returns).square()
        if self.use_clipped_value_loss:
            near = before + (values - before).clamp(-clip, clip)
            errors = torch.maximum(errors, (near - returns).square())
        value = errors.mean()
        for weights in self._weights():
            weights.grad = None
        (surrogate + self.value_loss_coef * value - self.entropy_coef * entropy).backward()
        self._losses += torch.stack((value, surrogate, entropy)).detach()
        if self.is_multi_gpu:
            self._shared = torch.cat([values.reshape(-1) for values in self._averaged()])

    def _averaged(self) -> list[torch.Tensor]:
        """What processes average: gradients, in whichever order memory has them, and how far the policy has gone."""
        gradients = [weights.grad for weights in self._weights() if weights.grad is not None]
        return [*gradients, self._divergence]

    def _take_averages(self) -> None:
        averaged = self._averaged()
        means = (self._shared / self.gpu_world_size).split([values.numel() for values in averaged])
        for values, mean in zip(averaged, means, strict=True):
            values.copy_(mean.view(values.shape))

    def _apply(self) -> None:
        """Adapt the learning rate to how far the policy has gone, and step."""
        if self.is_multi_gpu:
            self._take_averages()
        if self.desired_kl is not None and self.schedule == "adaptive":
            far, rate = self._divergence, self._rate
            slower, faster = (rate / FACTOR).clamp(min=SLOWEST), (rate * FACTOR).clamp(max=FASTEST)
            near = (far < 0.5 * self.desired_kl) & (far > 0.0)
            rate.copy_(torch.where(far > 2.0 * self.desired_kl, slower, torch.where(near, faster, rate)))
        for model in (self.actor, self.critic):
            nn.utils.clip_grad_norm_(model.parameters(), self.max_grad_norm)
        self.optimizer.step()

    def _normalize(self) -> None:
        """Update the means and deviations of observations, where graphs have them."""
        seen = self.storage.observations.flatten(0, 1)
        for model in (self.actor, self.critic):
            places = dict(model.named_buffers())
            model.update_normalization(seen)
            for name, values in list(model.named_buffers()):
                if values is not places[name]:
                    owner, _, own = name.rpartition(".")
                    setattr(model.get_submodule(owner), own, places[name].copy_(values))
