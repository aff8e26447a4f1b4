"""What is loaded is the model: its loops closed, its shapes where they are, and what does not load is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.envs import ROBOTS, RobotEnv
from mpge_bench.envs.articulation import Loop
from mpge_bench.envs.engine import BULLET_DATA
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.world import World

from .conftest import motions, pole


@pytest.mark.parametrize("cut", [None, 4000, 0])
def test_a_shape_that_pybullet_dies_of_is_refused(tmp_path: Path, cut: int | None) -> None:
    """It read COLLADA files that are not whole with a segmentation fault."""
    shape, whole = tmp_path / "cone.dae", (BULLET_DATA / "racecar/meshes/cone.dae").read_bytes()
    shape.write_bytes(b"<COLLADA/>" if cut == 0 else whole[:cut])
    path = tmp_path / "cone.urdf"
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    path.write_text(
        f'<robot name="cone"><link name="a"><inertial><mass value="1"/>{inertia}</inertial>'
        '<collision><geometry><mesh filename="cone.dae"/></geometry></collision></link></robot>'
    )
    if cut == 0:
        with pytest.raises(UserError, match=r"cone\.dae: PyBullet dies of this COLLADA file"):
            World(Model(path, floating=True), timestep=0.01, substeps=1)
    else:
        World(Model(path, floating=True), timestep=0.01, substeps=1)


@pytest.mark.parametrize("content", [None, "", '<robot name="cut off">', '<robot name="empty"></robot>', "<html></html>"])
def test_a_model_that_does_not_load_is_refused(tmp_path: Path, content: str | None) -> None:
    model = tmp_path / "model.urdf"
    if content is not None:
        model.write_text(content)
    with pytest.raises(UserError, match=r"model\.urdf(, line \d+)?: ") as error:
        World(model, timestep=0.005)
    assert "\n" not in str(error.value)


def frames(model: Model, q: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Place and rotation matrix of every link of a floating robot at `q`, worked out from the model's tree alone."""
    x, y, z, w = q[3:7]
    base = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    angles, tree = dict(zip(model.joints, q[7:], strict=True)), model.tree()
    root = next(joint.parent for joint in tree if joint.parent not in {other.child for other in tree})
    found = {root: (q[:3], base)}
    for joint in tree:
        place, turn = found[joint.parent]
        found[joint.child] = (place + turn @ joint.origin, turn @ joint.turn @ about(joint.axis, angles.get(joint.name, 0.0)))
    return found


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (Rodrigues')."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def gaps(model: Model, loops: tuple[Loop, ...], q: np.ndarray) -> list[float]:
    """How far, m, the two points of each loop are from each other at `q`."""
    placed = frames(model, q)
    ends = [[placed[link][0] + placed[link][1] @ point for link, point in ((one.link, one.point), (one.other_link, one.other_point))] for one in loops]
    return [float(np.linalg.norm(here - there)) for here, there in ends]


#: Where PyBullet's Minitaur joins its legs' lower ends.
FEET = tuple(
    Loop(f"lower_leg_{leg}R_link", (0.0, 0.005, 0.2), f"lower_leg_{leg}L_link", (0.0, 0.01, 0.2))
    for leg in ("front_left", "back_left", "front_right", "back_right")
)


@pytest.mark.parametrize("seed", range(20))
def test_the_minitaurs_poses_are_closed(seed: int) -> None:
    minitaur = ROBOTS["minitaur"]
    q, _, _ = motions(minitaur, 20)[seed]
    # PyBullet's joints are 5 mm apart along their own axes.
    assert max(gaps(minitaur.load(), FEET, q)) < 0.006


def test_the_minitaurs_loops_stay_closed_while_it_moves() -> None:
    minitaur = ROBOTS["minitaur"]
    model, env, rng = minitaur.load(), RobotEnv(minitaur), np.random.default_rng(0)
    env.reset(seed=0)
    widest, moved = [], []
    for step in range(300):
        action = np.sin(0.15 * step + np.arange(8)) if step < 150 else rng.uniform(-1, 1, 8)
        env.step(action)
        widest.append(max(gaps(model, FEET, env.world.q)))
        moved.append(env.world.q[7:])
    assert max(widest) < 0.01
    assert np.ptp(moved, axis=0).min() > 0.3


def test_a_loop_at_a_link_that_is_not_there_is_refused() -> None:
    loop = Loop("torso", (0.0, 0.0, 0.0), "paw", (0.0, 0.0, 0.0))
    with pytest.raises(UserError, match="a loop is to be closed at link 'paw', which the model has not; it has torso, leg_1") as error:
        World(ROBOTS["ant"].load(), timestep=0.01, loops=[loop])
    assert "\n" not in str(error.value)


def test_the_lowest_point_is_that_of_the_shapes(tmp_path: Path) -> None:
    path = tmp_path / "ball.urdf"
    body = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    ball = '<collision><origin xyz="0.1 0 0.2"/><geometry><sphere radius="0.15"/></geometry></collision>'
    lever = '<joint name="lever" type="continuous"><parent link="body"/><child link="lever"/></joint>'
    path.write_text(f'<robot name="ball"><link name="body">{body}{ball}</link><link name="lever">{body}</link>{lever}</robot>')
    world = World(Model(path, floating=True), timestep=1e-3)
    # Upright, head over heels, and on its side.
    for turn, lowest in (((0, 0, 0, 1), 1.0 + 0.2), ((1, 0, 0, 0), 1.0 - 0.2), ((0, 0.5**0.5, 0, 0.5**0.5), 1.0 - 0.1)):
        world.set_state([0.3, 0.2, 1.0, *turn, 0.0], np.zeros(7))
        assert world.lowest() == pytest.approx(lowest - 0.15, abs=0.01)


def test_the_ants_lowest_points_are_its_feet() -> None:
    standing, heights = ROBOTS["ant"].world(), []
    for height in (0.7, 1.2):
        standing.set_state([0, 0, height, 0, 0, 0, 1, 0, 1.0, 0, -1.0, 0, -1.0, 0, 1.0], np.zeros(14))
        heights.append(standing.lowest())
    assert np.diff(heights) == pytest.approx([0.5])
    # The feet, 0.57 m long and 8 cm thick, point down by 1 rad; the boxes round them go somewhat deeper.
    assert heights[0] == pytest.approx(0.7 - 0.5657 * math.sin(1.0) - 0.08, abs=0.05)


def test_what_touches_nothing_has_no_lowest_point(tmp_path: Path) -> None:
    assert World(pole(tmp_path), timestep=1e-3).lowest() == math.inf
