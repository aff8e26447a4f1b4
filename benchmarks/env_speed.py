"""How many control steps a second our environments make, beside a raw PyBullet loop and pybullet_envs_gymnasium, all measured in one run."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what PyBullet and the Bullet environments print from C (``argv[0]=`` and the like) from the terminal."""
    streams = [(stream, os.dup(stream.fileno())) for stream in (sys.stdout, sys.stderr)]
    with open(os.devnull, "w") as sink:
        for stream, _ in streams:
            stream.flush()
            os.dup2(sink.fileno(), stream.fileno())
    try:
        yield
    finally:
        for stream, saved in streams:
            stream.flush()
            os.dup2(saved, stream.fileno())
            os.close(saved)


@dataclass(frozen=True)
class Contest:
    """One robot's measurement: our robot, the Bullet environment it is held against, and how many times as fast ours has to be."""

    robot: str
    bullet_id: str
    goal: float


CONTESTS = (
    Contest("hopper", "HopperBulletEnv-v0", 3.0),
    Contest("half_cheetah", "HalfCheetahBulletEnv-v0", 2.6),
    Contest("walker", "Walker2DBulletEnv-v0", 2.6),
    Contest("ant", "AntBulletEnv-v0", 2.1),
)
#: Least share of the raw loop's speed that the environment has to keep.
RAW_GOAL = 0.85
EPISODE_STEPS = 1000


def through(env: Any, actions: Any) -> Callable[[], float]:
    """CPU seconds of stepping `env` through `actions`, reset where an episode ends."""
    env.reset(seed=0)

    def measure() -> float:
        env.reset(seed=0)
        left = EPISODE_STEPS
        start = time.process_time()
        for action in actions:
            terminated = env.step(action)[2]
            left -= 1
            if terminated or not left:
                env.reset()
                left = EPISODE_STEPS
        return time.process_time() - start

    return measure


def raw_loop(robot: Any, actions: Any) -> Callable[[], float]:
    """CPU seconds of the bare PyBullet calls that the same control steps over the same model take.

    No action limits, reward or Gymnasium interface: torques in, springs (half-cheetah) worked out inline, limbs (ant) turned to their flywheels, states
    out into one array, and a reset to the same initial states where the robot has fallen.
    """
    import numpy as np
    import pybullet as bullet

    from mpge_bench.envs.rotors import ROTOR_RATIO

    world = robot.world()
    client, body, joints, moving = world._client, world._body, world._q_index, world._state_index
    wheels = [list(range(len(world._flywheels))), world._flywheels] if world._flywheels else None
    driven, driven_joints = (world._wheel_body, wheels[0]) if wheels else (body, joints)
    stiffness = [0.0] * len(joints)
    for spring in robot.nominal:
        stiffness[robot.joints.index(spring.target)] = spring.stiffness
    torques = np.zeros((len(actions), len(joints)))
    torques[:, [robot.joints.index(joint) for joint in robot.actuators]] = actions * robot.gears
    torques = (torques[:, wheels[1]] if wheels else torques).tolist()
    rotors = len(moving) - len(joints)
    first = len(joints) - len(robot.actuators)
    base_q, base_dq = (7, 6) if robot.floating else (0, 0)
    rng = np.random.default_rng(0)

    def turn(body: int, indices: Any, angles: Any, speeds: Any) -> None:
        bullet.resetJointStatesMultiDof(body, indices, [[x] for x in angles], [[x] for x in speeds], physicsClientId=client)

    def reset() -> Any:
        q, dq = (half.tolist() for half in robot.initial_state(rng))
        bullet.restoreState(world._snapshot, physicsClientId=client)
        if robot.floating:
            bullet.resetBasePositionAndOrientation(body, q[:3], q[3:7], physicsClientId=client)
            bullet.resetBaseVelocity(body, dq[:3], dq[3:6], physicsClientId=client)
        q, dq = q[base_q:], dq[base_dq:]
        speeds = [[x] for x in dq] + [[ROTOR_RATIO * x] for x in dq[first:][:rotors]]
        bullet.resetJointStatesMultiDof(body, moving, [[x] for x in q] + [[0.0]] * rotors, speeds, physicsClientId=client)
        if wheels:
            turn(driven, driven_joints, [q[joint] for joint in wheels[1]], [dq[joint] for joint in wheels[1]])
        return bullet.getJointStates(body, joints, physicsClientId=client)

    def measure() -> float:
        states = reset()
        left = EPISODE_STEPS
        start = time.process_time()
        for torque in torques:
            for _ in range(robot.substeps if robot.nominal else 1):
                forces = [u - k * x[0] for u, k, x in zip(torque, stiffness, states, strict=True)] if robot.nominal else torque
                bullet.setJointMotorControlArray(driven, driven_joints, bullet.TORQUE_CONTROL, forces=forces, physicsClientId=client)
                bullet.stepSimulation(physicsClientId=client)
                states = bullet.getJointStates(body, joints, physicsClientId=client)
            angles, speeds = [x[0] for x in states], [x[1] for x in states]
            if wheels:
                turned = bullet.getJointStates(driven, driven_joints, physicsClientId=client)
                angles, limbs, speeds = [x[0] for x in turned], speeds, [x[1] for x in turned]
                turn(body, joints, angles, limbs)
            if robot.floating:
                place, orientation = bullet.getBasePositionAndOrientation(body, physicsClientId=client)
                velocity, spin = bullet.getBaseVelocity(body, physicsClientId=client)
                reached = np.array([*place, *orientation, *angles, *velocity, *spin, *speeds])
            else:
                reached = np.array(angles + speeds)
            left -= 1
            if not left or robot.terminated(reached[: base_q + len(joints)], reached[base_q + len(joints) :]):
                states = reset()
                left = EPISODE_STEPS
        return time.process_time() - start

    return measure


def bullet_env(name: str, actions: Any) -> Callable[[], float]:
    """CPU seconds of stepping one of pybullet_envs_gymnasium's environments, without Gymnasium's wrappers, as ours is."""
    import gymnasium
    import numpy as np

    return through(gymnasium.make(name).unwrapped, actions.astype(np.float32))


def _timed(robot: str, steps: int, rounds: int, together: Any) -> float:
    """Seconds by the clock of the fastest of `rounds` through `steps` random actions, each begun when all processes are ready."""
    with quiet():
        import numpy as np

        from mpge_bench.envs import ROBOTS, RobotEnv

        env = RobotEnv(ROBOTS[robot])
    measure = through(env, np.random.default_rng(0).uniform(-1, 1, (steps, len(ROBOTS[robot].actuators))))
    taken = []
    for _ in range(rounds):
        together.wait()
        start = time.perf_counter()
        measure()
        taken.append(time.perf_counter() - start)
    return min(taken)


def processes(robot: str, steps: int, count: int, rounds: int) -> float:
    """Control steps a second, by the clock, of `count` processes side by side."""
    with multiprocessing.Manager() as manager, ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
        together = manager.Barrier(count)
        taken = list(pool.map(_timed, [robot] * count, [steps] * count, [rounds] * count, [together] * count))
    return count * steps / max(taken)


app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def main(
    steps: Annotated[int, typer.Option(min=100, help="Control steps a round; every loop goes through the same random actions.")] = 4000,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds; the loops take turns in each and the fastest round of each counts.")] = 5,
) -> None:
    """Measure control steps a second of our hopper, half-cheetah, walker and ant, on one core and in two processes side by side.

    Three loops go through the same random actions in turn, each resetting its robot where an episode ends: ours (RobotEnv.step), the raw loop (the
    bare PyBullet calls over our own model: torques in, step, joint states out) and pybullet_envs_gymnasium (its own model, 4 physics steps of 4.125
    ms a control step). Times are CPU seconds of this process, so that other work on the machine weighs little; the best of the rounds counts.

    With two processes each goes through the actions in ours, begun together; what is told is the steps of both over the longer time, by the clock.

    Exits with 1 where ours is not 3.0 (hopper), 2.6 (half-cheetah, walker) or 2.1 (ant) times as fast as pybullet_envs_gymnasium, or below 0.85 of the
    raw loop. Needs
    pip install -e '.[benchmark]'. A quick look: python benchmarks/env_speed.py --steps 500 --rounds 2
    """
    with quiet():
        import numpy as np

        from mpge_bench.envs import ROBOTS, RobotEnv

        try:
            import pybullet_envs_gymnasium  # noqa: F401
        except ImportError:
            sys.exit("pybullet_envs_gymnasium is not installed; get it by: pip install -e '.[benchmark]'")
    console = Console()
    columns = ("robot", "ours", "raw", "bullet", "ours/raw", "ours/bullet", "1 process", "2 processes")
    table = Table(*columns, title="Control steps a second (bullet: pybullet_envs_gymnasium; the last two by the clock)")
    misses = []
    for contest in CONTESTS:
        robot = ROBOTS[contest.robot]
        actions = np.random.default_rng(0).uniform(-1, 1, (steps, len(robot.actuators)))
        with quiet():
            loops = [through(RobotEnv(robot), actions), raw_loop(robot, actions), bullet_env(contest.bullet_id, actions)]
        times: list[list[float]] = [[] for _ in loops]
        for _ in range(rounds):
            for loop, taken in zip(loops, times, strict=True):
                taken.append(loop())
        ours, raw, theirs = (steps / min(taken) for taken in times)
        beside = [f"{processes(contest.robot, steps, count, rounds):,.0f}" for count in (1, 2)]
        table.add_row(contest.robot, f"{ours:,.0f}", f"{raw:,.0f}", f"{theirs:,.0f}", f"{ours / raw:.2f}", f"{ours / theirs:.2f}", *beside)
        if ours / theirs < contest.goal:
            misses.append(f"{contest.robot}: {ours / theirs:.2f} times pybullet_envs_gymnasium, below the goal of {contest.goal}")
        if ours / raw < RAW_GOAL:
            misses.append(f"{contest.robot}: {ours / raw:.2f} of the raw loop, below the goal of {RAW_GOAL}")
    console.print(table)
    if misses:
        sys.exit("\n".join(misses))


if __name__ == "__main__":
    app()
