"""Many worlds of one task behind one stable-baselines3 VecEnv, in one process, with an optional action transformation on all of them at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium import Env
from stable_baselines3.common.vec_env import VecEnv

from mpge_bench.baselines.policy import PolicySet
from mpge_bench.envs import RobotEnv
from mpge_bench.envs.engine import disconnect_dropped

Array = npt.NDArray[Any]


class Transformation(Protocol):
    """An action transformation ã(s, a), possibly one of several members, each of which grounds the source a little differently."""

    members: int

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        """The transformed actions, shape (n, actuators), for observations (n, o), actions (n, actuators) and member indices (n,)."""


class Identity:
    """ã = a: the ungrounded source."""

    members = 1

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        return action


class Noise:
    """ã = a + Gaussian noise of standard deviation `std`, in units of the action limit."""

    members = 1

    def __init__(self, std: float, limit: float, seed: int) -> None:
        self.std, self.rng = std * limit, np.random.default_rng(seed)

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        return action + self.std * self.rng.standard_normal(action.shape)


class Worlds(VecEnv):
    """`count` copies of an environment stepped in turn; one process suffices, since PyBullet itself takes most of the time.

    With a `transformation` this is the grounded environment: the robots execute ã(s, a) and the agent is paid for a. Which member of the
    transformation is in force is drawn anew, uniformly, at each episode's start (MPGE, ensemble policy learning); so is, where there are several
    rollout policies, the one that acts (`members` says how many).

    Attributes:
        steps: control steps simulated so far, over all worlds.
        observations: of the running episodes, shape (count, o).
        member: index of what was drawn at each episode's start, shape (count,).
    """

    def __init__(self, make: Callable[[], RobotEnv], count: int, seed: int, transformation: Transformation | None = None, members: int = 0) -> None:
        self.envs: Sequence[RobotEnv] = [make() for _ in range(count)]
        first = self.envs[0]
        super().__init__(count, first.observation_space, first.action_space)
        self.limit = first.robot.action_limit
        self.episode_steps = first.robot.episode_steps
        self.transformation: Transformation = transformation or Identity()
        self.members = members or self.transformation.members
        self.rng = np.random.default_rng(seed)
        self.steps = 0
        self.observations = np.zeros((count, first.robot.observation_size))
        self.member = np.zeros(count, int)
        self._elapsed = np.zeros(count, int)
        self._returns = np.zeros(count)
        self._actions = np.zeros((count, len(first.robot.actuators)))

    def reset(self) -> Array:
        for index in range(self.num_envs):
            self._begin(index)
        return self.observations.copy()

    def _begin(self, index: int) -> None:
        self.observations[index], _ = self.envs[index].reset(seed=int(self.rng.integers(2**31)))
        self.member[index] = self.rng.integers(self.members)
        self._elapsed[index] = 0
        self._returns[index] = 0.0

    if TYPE_CHECKING:  # stable-baselines3's also allows for observations that are dicts or tuples

        def step(self, actions: Array) -> tuple[Array, Array, Array, list[dict[str, Any]]]: ...

    def step_async(self, actions: Array) -> None:
        self._actions = np.clip(actions, -self.limit, self.limit).astype(float)

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        executed = self.transformation(self.observations, self._actions, self.member)
        alike = executed is self._actions
        paid, ended = [], []
        for index, (env, action) in enumerate(zip(self.envs, executed, strict=True)):
            # An action that is executed as it was chosen is to be one array, which then is looked through once.
            self.observations[index], reward, terminated, _, _ = env.advance(action, action if alike else self._actions[index])
            paid.append(reward)
            ended.append(terminated)
        rewards, terminations = np.array(paid), np.array(ended, bool)
        self._elapsed += 1
        self._returns += rewards
        dones = terminations | (self._elapsed >= self.episode_steps)
        infos: list[dict[str, Any]] = [{} for _ in self.envs]
        for index in np.flatnonzero(dones).tolist():
            infos[index] = {
                "terminal_observation": self.observations[index].copy(),
                "TimeLimit.truncated": not ended[index],
                "episode": {"r": self._returns[index], "l": int(self._elapsed[index]), "t": 0.0},
            }
            self._begin(index)
        self.steps += self.num_envs
        return self.observations.copy(), rewards, dones, infos

    def close(self) -> None:
        """Give the worlds' memory back (some 50 MB each in PyBullet); nothing but `steps` is to be asked for after it."""
        self.envs = []
        disconnect_dropped()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.envs[index], attr_name) for index in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        for index in self._get_indices(indices):
            setattr(self.envs[index], attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        return [getattr(self.envs[index], method_name)(*method_args, **method_kwargs) for index in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Env[Any, Any]], indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]


class DiverseWorlds(Worlds):
    """Worlds in which it also pays to be where earlier policies are undecided: `coefficient` times the mean over them of H(πi(·|s)) is added to the reward.

    That is how an entropy-regularised set is made, one policy after the other (MPGE, section 4). Entropies are of the Gaussian in units of the action limit.
    """

    def __init__(
        self, make: Callable[[], RobotEnv], count: int, seed: int, transformation: Transformation | None = None, *, earlier: PolicySet, coefficient: float
    ) -> None:
        super().__init__(make, count, seed, transformation)
        self.earlier, self.coefficient = earlier, coefficient

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        stds = [self.earlier.distribution(self.observations, np.full(self.num_envs, one))[1] for one in range(len(self.earlier))]
        entropy = np.mean([(np.log(std / self.limit) + 0.5 * np.log(2 * np.pi * np.e)).sum(1) for std in stds], axis=0)
        observations, rewards, dones, infos = super().step_wait()
        return observations, rewards + self.coefficient * entropy, dones, infos
