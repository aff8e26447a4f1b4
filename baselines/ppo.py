"""PPO (Schulman et al. 2017) of a small Gaussian policy in numpy: stable-baselines3's algorithm, step by step, at several times its speed.

A network of two layers of 64 is so small that torch spends most of its time on the way to the arithmetic and back; `benchmarks/train_speed.py` has the
figures. A test holds an update against stable-baselines3's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv

from mpge_bench.baselines.policy import CLIP, LOG_STD_RANGE
from mpge_bench.baselines.workers import Advance

#: float32 unless said otherwise.
Array = npt.NDArray[Any]
#: Share of the learning rate that is left at the end; it falls linearly.
_FINAL_RATE = 0.1
#: As in stable-baselines3: what the value's loss counts, the largest norm of a gradient, the largest scaled reward.
_VALUE_COEFFICIENT, _GRADIENT_NORM, _REWARD_CLIP = 0.5, 0.5, 10.0


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
    """Adam (Kingma & Ba 2015) on one vector, with torch's order of operations and stable-baselines3's ε."""

    _BETA: ClassVar = (0.9, 0.999)
    _EPSILON = 1e-5

    def __init__(self, size: int) -> None:
        self._mean, self._square = np.zeros(size, np.float32), np.zeros(size, np.float32)
        self._scratch = np.zeros(size, np.float32)
        self._count = 0

    def step(self, values: Array, gradient: Array, rate: float) -> None:
        """Move `values`, in place, against `gradient`."""
        self._count += 1
        first, second = self._BETA
        mean, square, scratch = self._mean, self._square, self._scratch
        mean *= first
        mean += np.multiply(gradient, 1 - first, out=scratch)
        square *= second
        np.multiply(gradient, gradient, out=scratch)
        scratch *= 1 - second
        square += scratch
        np.sqrt(square, out=scratch)
        scratch /= np.sqrt(1 - second**self._count)
        scratch += self._EPSILON
        np.divide(mean, scratch, out=scratch)
        scratch *= rate / (1 - first**self._count)
        values -= scratch


class ActorCritic:
    """Actor and critic of two tanh layers each, all parameters in one vector; the numpy twin of `GaussianPolicy`, under the same names.

    Both are worked out together, layer by layer: minibatches are so small that the number of calls counts as much as the arithmetic.

    Attributes:
        values: all parameters, (p,).
        arrays: the same by name, as views of `values`.
        passed: how many inputs, the last ones, are no part of the observation and are not scaled; a subclass may use them.
    """

    passed = 0

    def __init__(
        self, observation_size: int, action_size: int, width: int, rng: np.random.Generator, further: Mapping[str, tuple[int, ...]] | None = None
    ) -> None:
        inputs = {0: observation_size, 2: width}
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
        (self._stacks, self.arrays), (self._stack_slopes, self._slopes) = (_views(vector, stacks) for vector in (self.values, self._gradient))
        for side in ("policy", "value"):
            for layer, size in inputs.items():
                self.arrays[f"mlp_extractor.{side}_net.{layer}.weight"][:] = np.sqrt(2) * _orthogonal((width, size), rng)
        self.arrays["action_net.weight"][:] = 0.01 * _orthogonal((action_size, width), rng)
        # Not used, but drawn as ever: what a seed gives shall stay.
        _orthogonal((action_size, width), rng)
        self.arrays["value_net.weight"][:] = _orthogonal((1, width), rng)

    def _hidden(self, x: Array) -> tuple[Array, Array]:
        """Both layers' outputs, of actor and critic, (2, n, width)."""
        (first, first_bias), (second, second_bias) = self._stacks[:2], self._stacks[2:4]
        one = self._observed(x) @ first.transpose(0, 2, 1)
        one += first_bias[:, None]
        np.tanh(one, out=one)
        two = one @ second.transpose(0, 2, 1)
        two += second_bias[:, None]
        np.tanh(two, out=two)
        return one, two

    def _heads(self, x: Array, hidden: Array) -> tuple[Array, Array, Array]:
        """Mean and logarithm of the standard deviation, not yet within its range, and value."""
        actor, critic = hidden
        weight, bias = self._stacks[4:6]
        found = actor @ weight.reshape(-1, weight.shape[2]).T
        found += bias.ravel()
        size = weight.shape[1]
        value = critic @ self.arrays["value_net.weight"][0] + self.arrays["value_net.bias"]
        return self._mean(x, found[:, :size]), found[:, size:], value

    def _observed(self, x: Array) -> Array:
        return x[:, : x.shape[1] - self.passed]

    def _mean(self, x: Array, own: Array) -> Array:
        """The mean; a subclass may add to the network's own."""
        return own

    def _mean_gradient(self, x: Array, slope: Array) -> None:
        """Write the gradient of what a subclass adds to the mean, `slope` (b, actuators) being that of the mean."""

    def evaluate(self, x: Array) -> tuple[Array, Array, Array]:
        """At scaled observations (n, o): mean and logarithm of the standard deviation, both (n, actuators), in units of the action limit; values (n,)."""
        mean, log_std, value = self._heads(x, self._hidden(x)[1])
        return mean, _within(log_std, *LOG_STD_RANGE), value

    def gradient(self, x: Array, actions: Array, old: Array, advantages: Array, returns: Array, *, settings: PPOSettings) -> Array:
        """Gradient (p,) of PPO's loss on a minibatch of b, as in stable-baselines3's `PPO.train`; a view that the next call overwrites.

        Args:
            x: scaled observations (b, o).
            actions: in units of the action limit, (b, actuators).
            old: logarithms of the probabilities with which they were chosen (b,).
            advantages, returns: (b,).
        """
        count = np.float32(1 / len(x))
        one, two = self._hidden(x)
        mean, raw, value = self._heads(x, two)
        log_std = _within(raw, *LOG_STD_RANGE)
        std = np.exp(log_std)
        distance = (actions - mean) / std
        ratio = np.exp(_log_probability(distance, log_std) - old)
        advantages = advantages - advantages.mean()
        advantages /= np.float32(np.sqrt(advantages @ advantages / (len(x) - 1)) + 1e-8)
        # The minimum of ratio and clipped ratio times advantage has no slope where the clipped one is the smaller.
        low, high = 1 - settings.clip_range, 1 + settings.clip_range
        slope = np.where(advantages > 0, ratio <= high, ratio >= low) * ratio * advantages * -count
        to_mean = slope[:, None] * distance / std
        to_log_std = slope[:, None] * (distance * distance - 1) - np.float32(settings.entropy_coefficient) * count
        to_log_std *= log_std == raw
        missed = (value - returns) * (2 * _VALUE_COEFFICIENT * count)
        self._back(x, one, two, np.concatenate((to_mean, to_log_std), 1), missed.astype(np.float32))
        self._mean_gradient(x, to_mean)
        norm = float(np.sqrt(self._gradient @ self._gradient))
        if norm > _GRADIENT_NORM:
            self._gradient *= np.float32(_GRADIENT_NORM / (norm + 1e-6))
        return self._gradient

    def _back(self, x: Array, one: Array, two: Array, heads: Array, value: Array) -> None:
        """Write the gradients of all layers, those of the heads' outputs being `heads` (b, 2 actuators) and `value` (b,)."""
        ones = np.ones(len(x), np.float32)
        first, first_bias, second, second_bias, head, head_bias = self._stack_slopes[:6]
        weight = self._stacks[4]
        np.dot(heads.T, two[0], out=head.reshape(-1, head.shape[2]))
        np.dot(ones, heads, out=head_bias.reshape(-1))
        np.dot(value, two[1], out=self._slopes["value_net.weight"][0])
        self._slopes["value_net.bias"][0] = value.sum()
        slope = np.empty_like(two)
        np.dot(heads, weight.reshape(-1, weight.shape[2]), out=slope[0])
        np.multiply(value[:, None], self.arrays["value_net.weight"], out=slope[1])
        slope *= 1 - two * two
        np.matmul(slope.transpose(0, 2, 1), one, out=second)
        np.matmul(ones, slope, out=second_bias)
        slope = slope @ self._stacks[2]
        slope *= 1 - one * one
        np.matmul(slope.transpose(0, 2, 1), self._observed(x), out=first)
        np.matmul(ones, slope, out=first_bias)


def _within(values: Array, low: float, high: float) -> Array:
    """As np.clip, at a third of the time for small arrays."""
    found: Array = np.minimum(np.maximum(values, np.float32(low)), np.float32(high))
    return found


def _views(vector: Array, stacks: Mapping[tuple[str, ...], tuple[int, ...]]) -> tuple[list[Array], dict[str, Array]]:
    """The parts of `vector`, in order: stacks of arrays of one shape, and each array by its name."""
    found: list[Array] = []
    by_name: dict[str, Array] = {}
    begin = 0
    for names, shape in stacks.items():
        end = begin + len(names) * int(np.prod(shape))
        found.append(vector[begin:end].reshape(len(names), *shape))
        by_name |= dict(zip(names, found[-1], strict=True))
        begin = end
    return found, by_name


def _orthogonal(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """A random matrix of orthogonal rows or columns (Saxe et al. 2014), as torch makes it."""
    tall = rng.standard_normal((max(shape), min(shape)))
    q, r = np.linalg.qr(tall)
    found: Array = q * np.sign(np.diag(r))
    return found if shape[0] >= shape[1] else found.T


def _log_probability(distance: Array, log_std: Array) -> Array:
    """Of actions `distance` standard deviations off the mean, (n,)."""
    found: Array = -(np.float32(0.5) * distance * distance + log_std).sum(1) - np.float32(0.5 * np.log(2 * np.pi) * distance.shape[1])
    return found


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
        self._reward_scale = RunningMeanStd(shape=())
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
        size = self.mean.size
        found = observations.astype(np.float32)
        found[:, :size] = np.clip((observations[:, :size] - self.mean) / self.std, -CLIP, CLIP)
        return found

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
            action = mean + np.exp(log_std) * noise
            rollout.observations[step], rollout.actions[step] = x, action
            rollout.log_probabilities[step] = _log_probability(noise, log_std)
            states, rewards, dones, infos = self.worlds.step(np.clip(action, -1, 1) * self.limit)  # type: ignore[assignment]
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
        self._discounted = self._discounted * gamma + rewards
        self._reward_scale.update(self._discounted)
        scaled: Array = np.clip(rewards / np.sqrt(self._reward_scale.var + 1e-8), -_REWARD_CLIP, _REWARD_CLIP)
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
            for begin in range(0, len(order), settings.batch_size):
                picked = order[begin : begin + settings.batch_size]
                gradient = self.network.gradient(x[picked], *(values[picked] for values in flat), settings=settings)
                self._adam.step(self.network.values, gradient, rate)
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
