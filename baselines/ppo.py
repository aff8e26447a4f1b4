"""PPO (Schulman et al. 2017) of a small Gaussian policy in compiled loops: stable-baselines3's algorithm, step by step, at several times its speed.

A network of two layers of 64 is so small that torch, and numpy too, spend most of their time on the way to the arithmetic and back, which is why that is
compiled (`kernels`); `benchmarks/train_speed.py` has the figures. A test holds an update against stable-baselines3's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv

from mpge_bench.baselines import kernels
from mpge_bench.baselines.policy import CLIP, LOG_STD_RANGE
from mpge_bench.baselines.workers import Advance

#: float32 unless said otherwise.
Array = npt.NDArray[Any]
#: Share of the learning rate that is left at the end; it falls linearly.
_FINAL_RATE = 0.1
#: As in stable-baselines3: the largest norm of a gradient, the largest scaled reward.
_GRADIENT_NORM, _REWARD_CLIP = 0.5, 10.0


@dataclass(frozen=True, kw_only=True)
class PPOSettings:
    """Hyperparameters of PPO; `worlds` run side by side, `rollout_steps` of each make a batch.

    Attributes:
        initial_std: standard deviation, in units of the action limit, with which exploration begins.
        width: of both hidden layers of actor and critic.
    """

    worlds: int = 16
    rollout_steps: int = 128
    batch_size: int = 256
    epochs: int = 8
    learning_rate: float = 3e-4
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    entropy_coefficient: float = 0.0
    initial_std: float = 0.5
    width: int = 64


class _Adam:
    """Adam on one vector; `kernels.adam` has the law."""

    def __init__(self, size: int) -> None:
        self._mean, self._square = np.zeros(size, np.float32), np.zeros(size, np.float32)
        self._count = 0

    def step(self, values: Array, gradient: Array, rate: float) -> None:
        """Move `values`, in place, against `gradient`."""
        self._count += 1
        kernels.adam(values, gradient, self._mean, self._square, self._count, rate)


class ActorCritic:
    """Actor and critic of two tanh layers each, all parameters in one vector; the twin of `GaussianPolicy` without torch, under the same names.

    Attributes:
        values: all parameters, (p,).
        arrays: the same by name, as views of `values`.
        passed: how many inputs, the last ones, are no part of the observation and are not scaled; a subclass may use them.
    """

    passed = 0

    def __init__(
        self, observation_size: int, action_size: int, width: int, rng: np.random.Generator, further: Mapping[str, tuple[int, ...]] | None = None
    ) -> None:
        self._width, self._actions = width, action_size
        inputs = {0: observation_size, 2: width}
        # The order is that of `kernels.layers`.
        stacks: dict[tuple[str, ...], tuple[int, ...]] = {}
        for layer, size in inputs.items():
            names = [f"mlp_extractor.{side}_net.{layer}" for side in ("policy", "value")]
            stacks |= {tuple(f"{name}.weight" for name in names): (width, size), tuple(f"{name}.bias" for name in names): (width,)}
        heads = ("action_net", "log_std_net")
        stacks |= {tuple(f"{name}.weight" for name in heads): (action_size, width), tuple(f"{name}.bias" for name in heads): (action_size,)}
        stacks[("value_net.weight",)], stacks[("value_net.bias",)] = (1, width), (1,)
        for name, shape in (further or {}).items():
            stacks[(name,)] = shape
        self.values = np.zeros(sum(len(names) * int(np.prod(shape)) for names, shape in stacks.items()), np.float32)
        self._gradient = np.zeros_like(self.values)
        self.arrays, self._slopes = _views(self.values, stacks), _views(self._gradient, stacks)
        for side in ("policy", "value"):
            for layer, size in inputs.items():
                self.arrays[f"mlp_extractor.{side}_net.{layer}.weight"][:] = np.sqrt(2) * _orthogonal((width, size), rng)
        self.arrays["action_net.weight"][:] = 0.01 * _orthogonal((action_size, width), rng)
        # Not used, but drawn as ever: what a seed gives shall stay.
        _orthogonal((action_size, width), rng)
        self.arrays["value_net.weight"][:] = _orthogonal((1, width), rng)

    def _observed(self, x: Array) -> Array:
        return np.ascontiguousarray(x[:, : x.shape[1] - self.passed]) if self.passed else x

    def _mean(self, x: Array, own: Array) -> Array:
        """The mean; a subclass may add to the network's own."""
        return own

    def _mean_gradient(self, x: Array, slope: Array) -> None:
        """Write the gradient of what a subclass adds to the mean, `slope` (b, actuators) being that of the mean."""

    def evaluate(self, x: Array) -> tuple[Array, Array, Array]:
        """At scaled observations (n, o): mean and logarithm of the standard deviation, both (n, actuators), in units of the action limit; values (n,)."""
        _, _, own, log_std, value = kernels.forward(self.values, self._observed(x), self._width, self._actions)
        return self._mean(x, own), _within(log_std, *LOG_STD_RANGE), value

    def gradient(self, x: Array, actions: Array, old: Array, advantages: Array, returns: Array, *, settings: PPOSettings) -> Array:
        """Gradient (p,) of PPO's loss on a minibatch of b, as in stable-baselines3's `PPO.train`; a view that the next call overwrites.

        Args:
            x: scaled observations (b, o).
            actions: in units of the action limit, (b, actuators).
            old: logarithms of the probabilities with which they were chosen (b,).
            advantages, returns: (b,).
        """
        observed = self._observed(x)
        one, two, own, log_std, value = kernels.forward(self.values, observed, self._width, self._actions)
        mean, clip, entropy = self._mean(x, own), settings.clip_range, settings.entropy_coefficient
        to_mean, to_heads, to_value = kernels.loss_slopes(mean, log_std, value, actions, old, advantages, returns, LOG_STD_RANGE, clip, entropy)
        kernels.back(self.values, self._gradient, observed, one, two, to_heads, to_value, self._width)
        self._mean_gradient(x, to_mean)
        kernels.shorten(self._gradient, _GRADIENT_NORM)
        return self._gradient


def _within(values: Array, low: float, high: float) -> Array:
    """As np.clip, at a third of the time for small arrays."""
    found: Array = np.minimum(np.maximum(values, np.float32(low)), np.float32(high))
    return found


def _views(vector: Array, stacks: Mapping[tuple[str, ...], tuple[int, ...]]) -> dict[str, Array]:
    """The parts of `vector` by their names; `stacks` holds, in order, names of arrays of one shape and that shape."""
    found: dict[str, Array] = {}
    begin = 0
    for names, shape in stacks.items():
        end = begin + len(names) * int(np.prod(shape))
        found |= dict(zip(names, vector[begin:end].reshape(len(names), *shape), strict=True))
        begin = end
    return found


def _orthogonal(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """A random matrix of orthogonal rows or columns (Saxe et al. 2014), as torch makes it."""
    tall = rng.standard_normal((max(shape), min(shape)))
    q, r = np.linalg.qr(tall)
    found: Array = q * np.sign(np.diag(r))
    return found if shape[0] >= shape[1] else found.T


@dataclass
class _Rollout:
    """What a batch of T steps of n worlds holds; all (T, n, ...)."""

    observations: Array
    actions: Array
    log_probabilities: Array
    rewards: Array
    values: Array
    #: Whether the episode went on after the step.
    goes_on: Array


class PPO:
    """A PPO agent in `worlds`.

    Args:
        worlds: where it acts; its own.
        settings: hyperparameters.
        seed: of the network's initial weights, of the action noise and of the minibatches.
        start: weights by name to start from, the input statistics among them then kept, the noise set to `initial_std`; None starts from scratch.
        log_dir: where TensorBoard curves go.
        network: makes the actor and critic; arguments as `ActorCritic`'s.

    Attributes:
        steps: control steps taken so far.
        episodes: control steps taken so far and return of each episode that ended, in order.
    """

    def __init__(
        self,
        worlds: VecEnv,
        settings: PPOSettings,
        seed: int,
        *,
        start: Mapping[str, Array] | None = None,
        log_dir: Path | None = None,
        network: Callable[[int, int, int, np.random.Generator], ActorCritic] = ActorCritic,
    ) -> None:
        self.settings = settings
        self.limit = float(worlds.action_space.high[0])  # type: ignore[attr-defined]
        self.rng = np.random.default_rng(seed)
        (inputs,), (self._actions,) = worlds.observation_space.shape, worlds.action_space.shape  # type: ignore[misc]
        self.network = network(inputs, self._actions, settings.width, self.rng)
        observations = inputs - self.network.passed
        self._scale: RunningMeanStd | None = None if start is not None else RunningMeanStd(shape=(observations,))
        self.mean, self.std = np.zeros(observations), np.ones(observations)
        if start is not None:
            self.scale_inputs_as(start)
            for name, array in self.network.arrays.items():
                array[:] = start[name]
        # A trained policy hardly explores any more; to learn another gait it must.
        self.network.arrays["log_std_net.weight"][:] = 0
        self.network.arrays["log_std_net.bias"][:] = np.log(settings.initial_std)
        self._adam = _Adam(self.network.values.size)
        self._reward_scale = kernels.no_rewards()
        self._log_dir, self._logger = log_dir, cast(Logger | None, None)
        self.worlds = worlds
        self._states: Array | None = None
        self._discounted = np.zeros(worlds.num_envs)
        self.steps = 0
        self.episodes: list[tuple[int, float]] = []

    def scale_inputs_as(self, weights: Mapping[str, Array]) -> None:
        """Use the input statistics among `weights`, and learn no others."""
        self.mean, self.std = (np.asarray(weights[f"features_extractor.{name}"], float) for name in ("mean", "std"))
        self._scale = None

    def state(self) -> dict[str, Array]:
        """Weights and input statistics by name, as copies; a state dict of `GaussianPolicy`'s."""
        scale = {"features_extractor.mean": self.mean.astype(np.float32), "features_extractor.std": self.std.astype(np.float32)}
        return scale | {name: array.copy() for name, array in self.network.arrays.items()}

    def learn(self, until: int, total: int, advance: Advance) -> None:
        """Learn until `until` control steps have been taken in all, in whole batches; the learning rate falls over `total` steps."""
        while self.steps < until:
            rollout, last = self.collect(advance)
            self.update(rollout, last, max(1 - self.steps / total, _FINAL_RATE))
            self._log()

    def _scaled(self, observations: Array) -> Array:
        return kernels.scaled(observations, self.mean, self.std, CLIP)

    def collect(self, advance: Advance) -> tuple[_Rollout, Array]:
        """Act for a batch; what happened, and the values (n,) of the states that it ended in."""
        settings, count = self.settings, self.worlds.num_envs
        shape = (settings.rollout_steps, count)
        rollout = _Rollout(*(np.zeros((*shape, *size), np.float32) for size in ((self.mean.size + self.network.passed,), (self._actions,), (), (), (), ())))
        seen = np.zeros((*shape, self.mean.size))
        states = np.asarray(self.worlds.reset()) if self._states is None else self._states
        for step in range(settings.rollout_steps):
            seen[step] = states[:, : self.mean.size]
            x = self._scaled(states)
            mean, log_std, rollout.values[step] = self.network.evaluate(x)
            noise = self.rng.standard_normal(mean.shape, np.float32)
            rollout.observations[step] = x
            executed = kernels.act(mean, log_std, noise, self.limit, rollout.actions[step], rollout.log_probabilities[step])
            states, rewards, dones, infos = self.worlds.step(executed)  # type: ignore[assignment]
            self.steps += count
            rollout.rewards[step] = self._rewarded(rewards, dones, infos)
            rollout.goes_on[step] = ~dones
            advance(count)
        self._states = states
        last = self.network.evaluate(self._scaled(states))[2]
        if self._scale is not None:
            # Not before: the update that follows compares with the probabilities of the policy that acted.
            self._scale.update(seen.reshape(-1, self.mean.size))
        return rollout, last

    def _rewarded(self, rewards: Array, dones: Array, infos: list[dict[str, Any]]) -> Array:
        """Rewards in spreads of the discounted return; what an episode cut off by its time limit would still have brought is added."""
        gamma = self.settings.gamma
        scaled: Array = kernels.scale_rewards(rewards, self._discounted, self._reward_scale, gamma, _REWARD_CLIP)
        if dones.any():
            self._discounted[dones] = 0
            for index in np.flatnonzero(dones):
                if "episode" in infos[index]:
                    self.episodes.append((self.steps, infos[index]["episode"]["r"]))
                if infos[index].get("TimeLimit.truncated"):
                    scaled[index] += gamma * self.network.evaluate(self._scaled(infos[index]["terminal_observation"][None]))[2][0]
        return scaled

    def update(self, rollout: _Rollout, last: Array, share: float = 1.0) -> None:
        """Learn from a batch, at `share` of the learning rate."""
        settings = self.settings
        advantages = self._advantages(rollout, last)
        columns = (rollout.observations, rollout.actions, rollout.log_probabilities, advantages, advantages + rollout.values)
        x, *flat = (values.reshape(-1, *values.shape[2:]) for values in columns)
        rate = settings.learning_rate * share
        for _ in range(settings.epochs):
            order = self.rng.permutation(len(x))
            shuffled = [values[order] for values in (x, *flat)]
            for begin in range(0, len(order), settings.batch_size):
                batch = (values[begin : begin + settings.batch_size] for values in shuffled)
                self._adam.step(self.network.values, self.network.gradient(*batch, settings=settings), rate)
        if self._scale is not None:
            self.mean, self.std = self._scale.mean.copy(), np.maximum(np.sqrt(self._scale.var), 1e-6)

    def _advantages(self, rollout: _Rollout, last: Array) -> Array:
        """Generalised advantage estimates (Schulman et al. 2016), (T, n)."""
        gamma, found = self.settings.gamma, np.zeros_like(rollout.rewards)
        following, advantage = last, np.zeros_like(last)
        for step in range(len(found) - 1, -1, -1):
            missed = rollout.rewards[step] + gamma * following * rollout.goes_on[step] - rollout.values[step]
            advantage = missed + gamma * self.settings.gae_lambda * rollout.goes_on[step] * advantage
            found[step], following = advantage, rollout.values[step]
        return found

    def _log(self) -> None:
        if self._log_dir:
            self._logger = self._logger or configure(str(self._log_dir), ["tensorboard"])
            recent = [value for _, value in self.episodes[-100:]]
            if recent:
                self._logger.record("rollout/ep_rew_mean", float(np.mean(recent)))
            self._logger.record("train/std", float(np.exp(self.network.arrays["log_std_net.bias"]).mean()))
            self._logger.dump(self.steps)
