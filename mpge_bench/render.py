"""Films of a pair: source and target side by side under one policy."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.baselines.policy import Policy, load_state, policy_from
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.envs import RobotEnv, Task, get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.film import BLUE, ORANGE, Film, Format, Labels, Side, Written, check_film, followed, one_way, partial_film, times
from mpge_bench.policies import FOLDER, load_set
from mpge_bench.record import random_actions

Array = npt.NDArray[np.float64]

#: How long the last picture is shown after both episodes have ended early, s.
_HOLD = 1.0
_COLOURS = {"source": BLUE, "target": ORANGE}


@dataclass(frozen=True)
class RenderSettings:
    """What to render.

    Attributes:
        task: source/target pair.
        policy: ``source``: one of the source policies, which one says the seed; ``target``: so of the target-optimal ones; ``random``: smooth random actions;
            or the path of a .safetensors file. Policies act by their mean.
        seed: of the episode's start and of random actions.
        seconds: longest duration, s; not beyond the task's own length.
        width, height: of each side's picture, pixels.
        fps: pictures a second.
    """

    task: str
    policy: str = "source"
    seed: int = 0
    seconds: float = 5.0
    width: int = 400
    height: int = 300
    fps: int = 25


@dataclass(frozen=True)
class Episode:
    """One side's episode.

    Attributes:
        dt: control step, s.
        q: the state's positions at the beginning and after each control step, shape (steps + 1, size of q).
        returns: sum of the rewards up to then, shape (steps + 1,).
        ended: the task ended the episode (the robot fell, say).
    """

    dt: float
    q: Array
    returns: Array
    ended: bool

    @property
    def duration(self) -> float:
        """How long it lasts, s."""
        return self.dt * (len(self.q) - 1)

    def at(self, time: float) -> Array:
        """q at `time`, s, between control steps interpolated; after the end that of the end."""
        step = min(time / self.dt, len(self.q) - 1.0)
        before = int(step)
        here, there = self.q[before], self.q[min(before + 1, len(self.q) - 1)]
        return here + (step - before) * (there - here)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Rendered(Written):
    """The film of a pair that was written, and what is seen in it."""

    source: Episode
    target: Episode


def render(settings: RenderSettings, out: Path, *, policy_folder: Path = FOLDER, progress: Progress | None = None) -> Rendered:
    """Let the policy act in source and target from the same seed, and write the film to `out`, a .gif or .mp4; a file that is there is replaced.

    An episode that the task ends early stays on its last picture; the film stops soon after both have.

    Raises:
        UserError: for wrong settings, a file of another kind or that cannot be written, a policy that is missing or of another robot, or MP4 without
            the packages that it needs.
    """
    progress = progress or Silent()
    check_film(out)
    task = get_task(settings.task)
    steps = min(int(np.floor(settings.seconds / task.robot.dt + 1e-6)), task.robot.episode_steps)
    if steps < 1:
        raise UserError(f"{settings.seconds} s is shorter than one control step of {task.robot.dt} s; give more --seconds")
    act = _actor(settings, task, steps, policy_folder)
    with partial_film(out) as partial:
        environments = {"source": task.source(), "target": task.target()}
        episodes = {side: _episode(env, act, steps, settings.seed) for side, env in environments.items()}
        film = _film(settings, task, environments, episodes)
        progress.stage(f"rendering {task.name}", film.count)
        written = film.write(partial, progress)
    return Rendered(**vars(written), source=episodes["source"], target=episodes["target"])


def _actor(settings: RenderSettings, task: Task, steps: int, folder: Path) -> Callable[[int, Array], Array]:
    """What gives the action, shape (actuators,), by the control step's number and the observation."""
    robot, name = task.robot, settings.policy
    if name == "random":
        actions = random_actions(robot, steps, np.random.default_rng(settings.seed))
        return lambda step, observation: actions[step]
    if name in ("source", "target"):
        try:
            policies: Policy = load_set(task, name, folder)
        except UserError as error:
            raise UserError(f"{error}; --policy random needs none") from error
    elif name.endswith(".safetensors"):
        policies = policy_from(load_state(Path(name), robot.observation_size, len(robot.actuators)), robot.action_limit)
    else:
        raise UserError(f"unknown policy {name!r}; choose source, target, random or the path of a .safetensors file")
    member = np.array([settings.seed % len(policies)])
    return lambda step, observation: policies.best(observation[None], member)[0]


def _episode(env: RobotEnv, act: Callable[[int, Array], Array], steps: int, seed: int) -> Episode:
    observation, _ = env.reset(seed=seed)
    states, returns, ended = [env.world.q], [0.0], False
    for step in range(steps):
        observation, reward, ended, _, _ = env.step(act(step, observation))
        states.append(env.world.q)
        returns.append(returns[-1] + reward)
        if ended:
            break
    q = one_way(np.array(states)) if env.world.floating else np.array(states)
    return Episode(env.robot.dt, q, np.array(returns), ended)


def _film(settings: RenderSettings, task: Task, environments: dict[str, RobotEnv], episodes: dict[str, Episode]) -> Film:
    longest = max(episode.duration for episode in episodes.values())
    held = _HOLD if all(episode.ended for episode in episodes.values()) else 0.0
    duration = min(longest + held, max(settings.seconds, longest))
    rooms = [env.robot.room(env.effects) for env in environments.values()]
    # Both sides are seen from equally far away.
    room = np.min([low for low, _ in rooms], 0), np.max([high for _, high in rooms], 0)
    digits = 2 if max(np.abs(episode.returns).max() for episode in episodes.values()) < 10 else 1
    sides = []
    for name, episode in episodes.items():
        env, ended = environments[name], episode.duration if episode.ended else None
        cameras = followed([task.robot.camera(episode.at(time), room) for time in times(duration, settings.fps)], settings.fps)
        view = env.robot.world(env.effects, seen=True)
        sides.append(Side(name, _COLOURS[name], episode.at, view, cameras, functools.partial(_paid, episode, digits), ended))
    differs = task.summary or ", ".join(f"{effect.name} on {effect.target}" for effect in task.effects)
    labels = Labels(task.name, f"{_policy_name(settings.policy)}, seed {settings.seed}", f"target: {differs}")
    return Film(sides, labels, Format(settings.width, settings.height, settings.fps), duration, longest)


def _paid(episode: Episode, digits: int, time: float) -> str:
    return f"return {episode.returns[min(round(time / episode.dt), len(episode.returns) - 1)]:.{digits}f}"


def _policy_name(policy: str) -> str:
    if policy in ("source", "target"):
        return f"{policy} policy" if policy == "source" else "target-optimal policy"
    return "random actions" if policy == "random" else policy
