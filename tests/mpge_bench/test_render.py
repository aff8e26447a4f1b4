"""Films of source and target, and what robots look like in them."""

from __future__ import annotations

import importlib.util
import math
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image

from mpge_bench.baselines.policy import policy_set, save_policy
from mpge_bench.envs import ROBOTS, RobotEnv, get_task
from mpge_bench.envs.effects import Gravity
from mpge_bench.envs.errors import UserError
from mpge_bench.policies import load_set
from mpge_bench.render import Episode, RenderSettings, render

from ..conftest import PATIENCE

SMALL = {"seconds": 0.4, "width": 160, "height": 120, "fps": 10}


def small(task="biased_pendulum", policy="random", **changes):
    return RenderSettings(task, policy, **{**SMALL, **changes})


def pictures(path):
    with Image.open(path) as film:
        for frame in range(film.n_frames):
            film.seek(frame)
            yield np.asarray(film.convert("RGB"), int)


def sides(picture):
    """What both sides show, without the labels above and below."""
    above = 4 * 9
    return picture[above : above + 120, :160], picture[above : above + 120, 162:322]


def duration(path):
    """How long a GIF plays, s."""
    with Image.open(path) as film:
        total = 0
        for frame in range(film.n_frames):
            film.seek(frame)
            total += film.info["duration"]
    return total / 1000


def start(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "mpge_bench", "render", *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


@pytest.mark.slow
def test_the_command_writes_a_film_and_says_what_happened(tmp_path):
    arguments = ("--task", "broken_cheetah", "--policy", "random", "--seconds", 0.4, "--fps", 10, "--width", 160, "--height", 120)
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    process = start(*arguments, "--out", tmp_path / "new" / "film.gif", env=environment)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert re.search(r"source: return -?\d+\.\d\d in 0\.40 s\n", out)
    assert re.search(r"target: return -?\d+\.\d\d in 0\.40 s\n", out)
    assert "5 pictures of 322 × " in out
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["film.gif"]
    with Image.open(tmp_path / "new" / "film.gif") as film:
        assert (film.n_frames, film.width) == (5, 322)
        assert film.info["loop"] == 0
    assert duration(tmp_path / "new" / "film.gif") == 0.5


@pytest.mark.slow
def test_ctrl_c_leaves_nothing_and_the_old_film_as_it_was(tmp_path):
    old = tmp_path / "film.gif"
    old.write_text("old")
    arguments = ("--task", "ant_gravity", "--policy", "random", "--seconds", 40, "--width", 160, "--height", 120, "--out", old)
    # Where tests run in the background, SIGINT is ignored, and so it would be in their children.
    process = start(*arguments, start_new_session=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    deadline = time.monotonic() + PATIENCE
    while len(list(tmp_path.iterdir())) == 1:
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == [old]
    assert old.read_text() == "old"


def test_missing_policies_say_what_to_do(tmp_path):
    with pytest.raises(UserError, match=r"train-policies --task heavy_walker --kind source` makes it; --policy random needs none") as refusal:
        render(small("heavy_walker", "source"), tmp_path / "film.gif", policy_folder=tmp_path)
    assert "\n" not in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


def pair(tmp_path, gain):
    path = tmp_path / "pair.yaml"
    path.write_text(f"robot: swingup_pendulum\neffects:\n  - {{effect: torque_gain, target: slider, gain: {gain}}}\n")
    return str(path)


def test_sides_look_alike_where_physics_is_alike_and_only_there(tmp_path):
    for gain, alike in ((1.0, True), (0.0, False)):
        render(small(pair(tmp_path, gain)), tmp_path / "film.gif")
        *_, last = pictures(tmp_path / "film.gif")
        source, target = sides(last)
        assert (np.abs(source - target).max() == 0) == alike


def test_what_is_shown_moves(tmp_path):
    render(small(), tmp_path / "film.gif")
    first, *_, last = pictures(tmp_path / "film.gif")
    assert all((np.abs(there - here).max(2) > 60).sum() > 50 for here, there in zip(sides(first), sides(last), strict=True))


def test_a_seed_repeats_the_film_and_another_makes_another(tmp_path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        render(small("heavy_pendulum", seed=seed), tmp_path / f"{name}.gif")
    films = {name: (tmp_path / f"{name}.gif").read_bytes() for name in "abc"}
    assert films["a"] == films["b"] != films["c"]


def test_an_episode_that_ends_stays_on_its_last_picture(tmp_path):
    film = render(small("biased_pendulum", seconds=3.0, seed=1), tmp_path / "film.gif")
    assert film.source.ended
    assert film.target.ended
    longest = max(film.source.duration, film.target.duration)
    assert longest < 1.9
    # It goes on for a second, for the eye to take it in; what does not change takes one picture with a long duration.
    assert film.duration == pytest.approx(longest + 1)
    assert duration(tmp_path / "film.gif") == pytest.approx(film.duration, abs=0.15)
    shown = list(pictures(tmp_path / "film.gif"))
    assert len(shown) < film.frames
    # It is paler, with a dark label at the top.
    for before, after in zip(sides(shown[0]), sides(shown[-1]), strict=True):
        assert after[60:].min() > before[60:].min() + 50
        assert after[:30].min() < 60 < before[:30].min()


def test_films_keep_real_time(tmp_path):
    for fps in (7, 30):
        film = render(small(pair(tmp_path, 0.5), seconds=0.5, fps=fps), tmp_path / "film.gif")
        assert film.duration == pytest.approx(0.5)
        assert duration(tmp_path / "film.gif") == pytest.approx(film.frames / fps, abs=0.006)
        assert film.frames == round(0.5 * fps) + 1


def test_the_same_policy_acts_by_its_mean_in_both(policy_folder, make_policy, tmp_path):
    task = get_task("biased_pendulum")
    policy = make_policy(task.source(), 7)
    save_policy(tmp_path / "policy.safetensors", policy.state_dict(), {})
    sources, targets = (load_set(task, kind, policy_folder) for kind in ("source", "target"))
    own = policy_set([policy], task.robot.action_limit)
    # The seed chooses among five source policies and three target ones.
    for name, acting in (("source", sources[1]), ("target", targets[0]), (str(tmp_path / "policy.safetensors"), own)):
        film = render(small(policy=name, seed=6), tmp_path / "film.gif", policy_folder=policy_folder)
        for env, episode in ((task.source(), film.source), (task.target(), film.target)):
            observation, _ = env.reset(seed=6)
            for q, paid in zip(episode.q[1:], np.diff(episode.returns), strict=True):
                observation, reward, *_ = env.step(acting.best(observation[None], np.zeros(1, int))[0])
                assert np.array_equal(env.world.q, q)
                assert paid == pytest.approx(reward)


def test_a_policy_of_another_robot_is_refused(make_policy, tmp_path):
    save_policy(tmp_path / "policy.safetensors", make_policy(get_task("broken_hopper").source()).state_dict(), {})
    with pytest.raises(UserError, match="11 observations and 3 actions, where the task has 4 and 1"):
        render(small(policy=str(tmp_path / "policy.safetensors")), tmp_path / "film.gif")
    assert not (tmp_path / "film.gif").exists()


def test_mp4(tmp_path):
    imageio = pytest.importorskip("imageio.v2")
    pytest.importorskip("imageio_ffmpeg")
    film = render(small(height=121), tmp_path / "film.mp4")
    with imageio.get_reader(tmp_path / "film.mp4") as reader:
        frames = [np.asarray(frame, int) for frame in reader]
        assert reader.get_meta_data()["fps"] == 10
    assert len(frames) == film.frames == 5
    assert frames[0].shape == (film.size[1], film.size[0], 3)
    assert film.size[1] % 2 == 0
    assert (np.abs(frames[-1] - frames[0]).max(2) > 60).sum() > 50


def test_mp4_without_the_packages_says_how_to_get_them(tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name.startswith("imageio") else find(name, *rest))
    with pytest.raises(UserError, match=r"pip install 'mpge_bench\[video\]'"):
        render(small(), tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("out", "changes", "words"),
    [
        ("film.avi", {}, "unknown kind of film '.avi'; choose a name that ends with .gif or .mp4"),
        ("film", {}, "unknown kind of film ''"),
        ("file/film.gif", {}, "cannot be written"),
        ("folder.gif", {}, "is a folder"),
        ("new/film.gif", {"policy": "shipped"}, "unknown policy 'shipped'; choose source, target, random or the path of a .safetensors file"),
        ("new/film.gif", {"policy": "nowhere.safetensors"}, "nowhere.safetensors: no such policy file"),
        ("new/film.gif", {"seconds": 0.01}, "shorter than one control step of 0.04 s; give more --seconds"),
        ("new/film.gif", {"task": "pendulum"}, "unknown task 'pendulum'"),
    ],
)
def test_wrong_input_is_refused_and_leaves_nothing(out, changes, words, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.gif").mkdir()
    with pytest.raises(UserError) as refusal:
        render(small(**changes), tmp_path / out)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder.gif"]


def test_a_full_disk_ends_with_one_line_and_leaves_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mpge_bench.film._write_gif", full)
    with pytest.raises(UserError, match=r"cannot be written \(No space left on device\)"):
        render(small(), tmp_path / "new" / "folder" / "film.gif")
    assert list(tmp_path.iterdir()) == []


def test_between_control_steps_motion_is_interpolated():
    episode = Episode(0.1, np.array([[0.0, 1.0], [1.0, 3.0], [2.0, 3.0]]), np.zeros(3), True)
    assert episode.duration == pytest.approx(0.2)
    assert episode.at(0.0).tolist() == [0, 1]
    assert episode.at(0.05) == pytest.approx([0.5, 2])
    assert episode.at(0.17) == pytest.approx([1.7, 3])
    assert episode.at(5.0).tolist() == [2, 3]


def robot_in(picture):
    """Which pixels show the robot: background, ground and shadow are light."""
    return np.asarray(picture, int).min(2) < 110


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_is_seen_whole_and_large(name):
    env = RobotEnv(ROBOTS[name])
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (300, 400, 3)
    assert picture.dtype == np.uint8
    rows, columns = (np.flatnonzero(robot_in(picture).any(axis)) for axis in (1, 0))
    assert 2 < rows[0] < rows[-1] < 297
    assert 2 < columns[0] < columns[-1] < 397
    assert max(np.ptp(rows) / 300, np.ptp(columns) / 400) > 0.25


@pytest.mark.parametrize("name", ["hopper", "ant", "minitaur"])
def test_the_camera_follows(name):
    env = RobotEnv(ROBOTS[name])
    env.reset(seed=0)
    here = robot_in(env.render())
    q = env.world.q.copy()
    q[0] += 50.25
    env.world.set_state(q, env.world.dq)
    there = robot_in(env.render())
    assert (here != there).sum() < 0.05 * here.sum()


def test_the_ground_shows_how_fast_the_robot_is():
    env = RobotEnv(ROBOTS["hopper"])
    env.reset(seed=0)
    here = env.render().astype(int)
    q = env.world.q.copy()
    q[0] += 0.5  # one tile
    env.world.set_state(q, env.world.dq)
    there = env.render().astype(int)
    assert (np.abs(there - here).max(2) > 10).mean() > 0.2


def test_up_is_away_from_gravity():
    slope = math.radians(6)
    env = RobotEnv(ROBOTS["inverted_pendulum"], [Gravity("world", (-9.81 * math.sin(slope), 0.0, -9.81 * math.cos(slope)))])
    env.reset(seed=0)
    rail = np.asarray(env.render(), int).max(2) < 190
    heights = [np.flatnonzero(rail[:, column]).mean() for column in (60, 340)]
    # The rail rises along x, by so much from left to right.
    assert heights[0] - heights[1] == pytest.approx(280 * math.tan(slope), abs=3)


def test_limbs_differ_in_colour_and_keep_it_under_effects():
    for task in ("heavy_walker", "multipolar_swingup_3"):
        colours = []
        for env in (get_task(task).source(), get_task(task).target()):
            env.reset(seed=0)
            picture = env.render()
            dark = picture[robot_in(picture)].astype(int)
            hues = {"blue": dark[:, 2] - dark[:, 0] > 70, "orange": dark[:, 0] - dark[:, 2] > 70}
            colours.append({name: round(float(which.mean()), 1) for name, which in hues.items()})
        assert colours[0]["blue"] > 0
        assert colours[0]["orange"] > 0 or task != "heavy_walker"
        assert abs(colours[0]["blue"] - colours[1]["blue"]) < 0.25
