"""Whether any file that a user may load, spoilt by accident or on purpose, is loaded or refused in one line, and nothing else ever happens.

    python benchmarks/hostile_files.py                     500 spoilt files of each kind, the table, exit status 1 if anything else happened
    python benchmarks/hostile_files.py --kind rig --count 50 --seed 7
    python benchmarks/hostile_files.py --kind rig --only 31    one of them, with its traceback

Each is loaded by what its user's command calls, in a process of its own, which ends where a file brings it down and is then started again after that file.
Wrong is: any exception but the project's own error, one that does not name the file, code run (a file called `touched` appears), more than `SECONDS`, more
than `MEMORY`, a process that dies.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import mpge_bench  # noqa: F401  # isort: skip

import numpy as np
import pandas as pd
import typer
import yaml
from mutations import FORMS, canary, spoilt
from rich.console import Console
from rich.table import Table

from mpge_bench.diagnosis.transitions.episodes import FORMATS, Episodes, read_transitions, write_transitions
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError, one_line

#: How long a file may take, s, and how many bytes it may add to what the process held before.
SECONDS, MEMORY = 20.0, 1 << 30
#: Bytes beyond which a process is refused memory, lest the machine be brought down.
WALL = 6 << 30
_BOARD = Path(__file__).parents[1] / "leaderboard" / "results" / "biased_pendulum"
_POLICIES = Path(__file__).parents[1] / "baselines" / "policies"
_PENDULUM = """<robot name="pendulum"><link name="base"/>
<link name="rod"><inertial><origin xyz="0.02 0 -0.2"/><mass value="1.5"/><inertia ixx="0.03" iyy="0.03" izz="0.005" ixy="0" ixz="0.001" iyz="0"/></inertial>
<collision><origin xyz="0 0 -0.2"/><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><origin xyz="0 0 1" rpy="0 0 0.1"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="5" velocity="20"/><dynamics damping="0.1" friction="0.05"/></joint></robot>"""
_MJCF = """<mujoco model="pendulum"><option timestep="0.002"/><worldbody><body name="rod" pos="0 0 1">
<joint name="hinge" type="hinge" axis="0 1 0" damping="0.1" armature="0.01" stiffness="0.2" range="-180 180" limited="true"/>
<geom type="capsule" size="0.04" fromto="0 0 0 0 0 -0.4" mass="1.5"/></body></worldbody></mujoco>"""
_RIG = {
    "robot": "robot.urdf",
    "base": "fixed",
    "gravity": [0.0, 0.0, -9.81],
    "timestep": 0.002,
    "record_period": 0.01,
    "joints": {"hinge": {"mode": "position", "kp": 20.0, "kd": 1.0, "servo_period": 0.01}},
    "noise": {"q": 0.001, "dq": 0.01},
    "effects": [{"effect": "viscous_friction", "target": "hinge", "damping": 0.2}, {"effect": "torque_gain", "target": "hinge", "gain": 0.9}],
}
_PAIR = {
    "name": "mine",
    "summary": "a weak motor",
    "robot": {
        "model": "robot.urdf",
        "actuators": {"hinge": 5.0},
        "goal": {"hinge": 0.5},
        "start": {"hinge": 0.1},
        "timestep": 0.005,
        "substeps": 4,
        "episode_steps": 5,
        "friction": 1.0,
    },
    "effects": [{"effect": "torque_gain", "target": "hinge", "gain": 0.5}, {"effect": "payload", "target": "rod", "mass": 0.2, "distance": 0.3}],
}
_SWEEP = {
    "tasks": ["broken_hopper", "heavy_hopper"],
    "methods": ["mpge", "gat"],
    "samples": [500, 1000],
    "seeds": 2,
    "preset": "smoke",
    "set": ["agent.steps=512"],
    "noise": 0.01,
}


@dataclass(frozen=True)
class Kind:
    """Files of one kind.

    Attributes:
        spoilt: which of them is spoilt, by its path, and its form.
        write: writes all that belongs to it into a folder.
        load: loads them from the working directory as the user's command does.
        imports: it says what to run, and may name modules of the user's own, which are imported then.
        also: what else than its path tells the user which file is meant.
    """

    spoilt: str
    form: str
    write: Callable[[Path], None]
    load: Callable[[], object]
    imports: bool = False
    also: tuple[str, ...] = ()


def command(*arguments: str) -> None:
    """Run the command line without what it prints."""
    from mpge_bench.cli import app

    with contextlib.redirect_stdout(io.TextIOWrapper(io.BytesIO(), "utf-8")):
        app(list(arguments), standalone_mode=False)


# Policies, results and what lies beside them.


def _shipped(folder: Path) -> None:
    place = folder / "inverted_pendulum"
    place.mkdir(parents=True)
    for seed in range(5):
        shutil.copy(_POLICIES / "inverted_pendulum" / "source_0.safetensors", place / f"source_{seed}.safetensors")
    (folder / "biased_pendulum").mkdir()
    shutil.copy(_POLICIES / "biased_pendulum" / "references.json", folder / "biased_pendulum")


def _policies() -> None:
    from mpge_bench.policies import load_set

    known = load_set(get_task("biased_pendulum"), "source", Path())
    assert np.isfinite(known.best(np.zeros((5, 4)), np.arange(5))).all()


def _references() -> None:
    from mpge_bench.harness.references import path_of, stored

    found = stored(path_of("biased_pendulum", Path()))
    assert found is not None
    assert found.on_policy_mismatch


def _result_of(method: str, samples: int = 1000) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        for place in ("out", "other"):
            shutil.copytree(_BOARD / f"{method}/n{samples}/standard/seed1", folder / place / f"biased_pendulum/{method}/n{samples}/standard/seed1")

    return write


def _results(*path: str) -> str:
    return "/".join(("out/biased_pendulum", *path))


def _result() -> None:
    from mpge_bench.harness.settings import stored_run

    with contextlib.ExitStack() as failures:
        # Each command by itself: what one refuses another may not read at all.
        for call in (
            lambda: stored_run(Path(_RESULT)),
            lambda: command("run", "--task", "biased_pendulum", "--method", "gat", "--seed", "1", "--out", "out"),
            lambda: command("verify", "out", "--form"),
            lambda: command("leaderboard", "out", "--markdown"),
            lambda: command("compare", "out", "other"),
        ):
            failures.enter_context(_last_refusal(call))


@contextlib.contextmanager
def _last_refusal(call: Callable[[], object]) -> Iterator[None]:
    """Have `call` done now, and its user's error raised when all others are done."""
    refused = None
    try:
        call()
    except UserError as error:
        refused = error
    yield
    if refused:
        raise refused


def _beside() -> None:
    from mpge_bench.leaderboard.verify import evidence, physics_in, results_in

    for path in results_in([Path("out")]):
        data, task, _, _ = evidence(path)
        physics_in(path, data, task)


def _curve() -> None:
    from mpge_bench.leaderboard.plots import read_curve

    for path in Path("out").rglob("curve.parquet"):
        read_curve(path.parent)


def _finished(folder: Path) -> None:
    from safetensors.numpy import save_file

    from mpge_bench.baselines.grounding.finished import NAME

    rng = np.random.default_rng(0)
    weights = {"0.weight": (5, 4, 3), "0.bias": (5, 3)}
    save_file({f"{steps}.{name}": rng.normal(size=shape).astype(np.float32) for steps in (100, 200) for name, shape in weights.items()}, folder / NAME)


def _take_up() -> None:
    from mpge_bench.baselines.grounding.finished import taken_up

    taken_up(lambda *call: {}, (), Path(), lambda steps: None)


# Rigs, recordings, pairs, transitions.


def _rig_in(folder: Path, data: dict[str, Any] = _RIG, model: str = _PENDULUM) -> None:
    (folder / data["robot"]).write_text(model)
    (folder / "rig.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    time = 0.01 * np.arange(150)
    angle, speed = 0.5 * np.sin(4 * time), 2.0 * np.cos(4 * time)
    table = pd.DataFrame({"time": time, "u_hinge": 0.6 * np.sin(4 * time), "q_hinge": angle, "dq_hinge": speed, "temperature": 20 + time})
    table.to_csv(folder / "recording.csv", index=False)
    table.to_parquet(folder / "recording.parquet", index=False)


def _mjcf_in(folder: Path) -> None:
    _rig_in(folder, {**_RIG, "robot": "robot.xml"}, _MJCF)


def _task_in(folder: Path) -> None:
    """A rig that names a pair, by the path of its file."""
    _pair_in(folder)
    (folder / "rig.yaml").write_text(yaml.safe_dump({"task": "pair.yaml", "noise": {"q": 0.001}, "effects": _PAIR["effects"]}))


def _rig() -> None:
    from mpge_bench.diagnosis.data.rig import read_rig

    read_rig(Path("rig.yaml"))


def _simulated(recording: str) -> Callable[[], None]:
    """What `simulate` and `diagnose` do with it first."""

    def load() -> None:
        from mpge_bench.diagnosis.data.checks import measurements, read_recordings
        from mpge_bench.diagnosis.data.rig import read_rig

        rig = read_rig(Path("rig.yaml"))
        measurements(rig, read_recordings([Path(recording)], rig))
        command("simulate", "--rig", "rig.yaml", "--recording", recording)

    return load


def _pair_in(folder: Path) -> None:
    (folder / "robot.urdf").write_text(_PENDULUM)
    (folder / "pair.yaml").write_text(yaml.safe_dump(_PAIR, sort_keys=False))


def _pair() -> None:
    get_task("pair.yaml").fingerprints()


def _transitions_in(folder: Path) -> None:
    for ending in FORMATS:
        write_transitions(_drawn(), folder / f"transitions{ending}")


def _drawn() -> Episodes:
    """Of a pendulum that moves as its velocities say, by chance."""
    rng, dt = np.random.default_rng(0), get_task("biased_pendulum").robot.dt
    speeds = rng.normal(size=(61, 2))
    states = np.concatenate((dt * np.cumsum(speeds, axis=0), speeds), axis=1)
    return Episodes(states[:-1], rng.uniform(-1, 1, (60, 1)), states[1:])


def _transitions(name: str) -> Callable[[], None]:
    def load() -> None:
        found = read_transitions(Path(name), get_task("biased_pendulum").robot)
        assert found.scale.shape == (4,)

    return load


# What other tools record.


def _minari_in(folder: Path) -> None:
    from mpge_bench.exchange import minari

    minari.write_transitions(_drawn(), get_task("biased_pendulum"), folder / "drawn")


def _minari() -> None:
    from mpge_bench.exchange import minari

    minari.read_transitions(Path("drawn"), get_task("biased_pendulum").robot)


def _bag_in(ending: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        _rig_in(folder)
        store = get_typestore(Stores.ROS2_HUMBLE)
        types: Any = store.types
        plugin = StoragePlugin.MCAP if ending == "mcap" else StoragePlugin.SQLITE3
        with Writer(folder / "bag", version=9, storage_plugin=plugin) as bag:
            for topic in ("/joint_states", "/joint_commands"):
                connection = bag.add_connection(topic, "sensor_msgs/msg/JointState", typestore=store)
                for row in range(20):
                    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=row * 10_000_000)
                    header, one = types["std_msgs/msg/Header"](stamp=stamp, frame_id=""), np.array([0.1 * row])
                    message = types["sensor_msgs/msg/JointState"](header=header, name=["hinge"], position=one, velocity=one, effort=one)
                    bag.write(connection, 1_000_000_000 + row * 10_000_000, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        (found,) = (folder / "bag").glob(f"*.{ending}")
        found.rename(folder / "bag" / f"bag.{ending}")
        said = (folder / "bag" / "metadata.yaml").read_text()
        (folder / "bag" / "metadata.yaml").write_text(said.replace(found.name, f"bag.{ending}"))

    return write


def _lerobot_in(folder: Path) -> None:
    _rig_in(folder)
    for place in ("meta", "data/chunk-000"):
        (folder / "arms" / place).mkdir(parents=True)
    shared = {"dtype": "float32", "shape": [1], "names": ["hinge.pos"]}
    info = {"codebase_version": "v3.0", "fps": 30, "features": {"observation.state": shared, "action": shared}}
    (folder / "arms" / "meta" / "info.json").write_text(json.dumps(info))
    at = np.arange(40, dtype=np.float32)
    columns = {"observation.state": list(at[:, None] / 10), "action": list(at[:, None] / 9), "timestamp": at / np.float32(30)}
    table = pd.DataFrame({**columns, "frame_index": np.arange(40), "episode_index": np.repeat((0, 1), 20)})
    table.to_parquet(folder / "arms" / "data" / "chunk-000" / "file-000.parquet")


def _isaac_in(folder: Path) -> None:
    import torch

    _rig_in(folder)
    rows = torch.arange(20.0)
    torch.save({"time": rows / 10, "dof_pos": rows[:, None], "des_dof_pos": -rows[:, None]}, folder / "chirp.pt")
    table = pd.DataFrame({"timestamp": np.arange(20) / 10, "q1": np.arange(20.0), "dq1": 1.0, "cmd1": 2.0})
    table.to_csv(folder / "isaac.csv", index=False)


def _converted(name: str) -> Callable[[], None]:
    """What `convert` does with it first."""

    def load() -> None:
        from mpge_bench.diagnosis.data.rig import read_rig
        from mpge_bench.exchange.convert import read
        from mpge_bench.exchange.series import Asked

        read(Path(name), read_rig(Path("rig.yaml")), Asked(joints=("hinge",)))

    return load


# Settings.


def _preset_in(folder: Path) -> None:
    from mpge_bench.baselines.presets import FOLDER

    for name in ("gat", "agent"):
        if (FOLDER / f"{name}.yaml").exists():
            shutil.copy(FOLDER / f"{name}.yaml", folder)


def _preset() -> None:
    from mpge_bench.baselines.presets import load_settings
    from mpge_bench.baselines.registry import get_method

    for preset in ("smoke", "standard", "paper"):
        load_settings(get_method("gat").settings, Path("gat.yaml"), preset, "broken_hopper")


def _sweep_in(folder: Path) -> None:
    (folder / "sweep.yaml").write_text(yaml.safe_dump(_SWEEP, sort_keys=False))


def _sweep() -> None:
    from mpge_bench.harness.plan import Grid, plan_of, read_grid

    path, out = Path("sweep.yaml"), Path("out")
    plan_of(Grid(**read_grid(path)), out, (out,), path)


# Concealed cases: what they hide, what was said of them, and what a diagnosis says.


def _case_in(folder: Path) -> None:
    from mpge_bench.concealed.answer import ANSWER, Answer, Named

    given, kept, out = folder / "given" / "c0000", folder / "kept" / "c0000", folder / "scores" / "c0000"
    for place in (given, kept, out):
        place.mkdir(parents=True)
    _rig_in(given)
    (given / "recording.csv").rename(given / "train_00.csv")
    shutil.copy(given / "train_00.csv", kept / "test_00.csv")
    effects = [{"effect": "torque_gain", "target": "hinge", "catalogued": True, "value": {"gain": 0.8}}]
    (kept / "label.yaml").write_text(yaml.safe_dump({"effects": effects, "noise_q": 0.001, "noise_dq": 0.01}))
    (folder / "cases.json").write_text(json.dumps({"seed": 3}))
    (given / "corrected.yaml").write_text((given / "rig.yaml").read_text())
    named = [Named("torque_gain", "hinge", {"gain": (0.81, 0.7, 0.9)}, 0.9)]
    answer = Answer(True, named, [[("torque_bias", "hinge")]], [("periodic_torque", "hinge")], ["hinge"], "given/c0000/corrected.yaml", 0.001, "mismatch")
    (out / ANSWER).write_text(json.dumps({"seconds": 3.0, **json.loads(answer.to_json())}, indent=1))
    (out / "residual.json").write_text(json.dumps({"seconds": 3.0, "error": 0.01, "epochs": 5}))


def _scores() -> None:
    from mpge_bench.concealed.score import cases_of, score
    from mpge_bench.concealed.summary import lines, table

    rows = [score(case, Path("scores") / case.given.name) for case in cases_of(Path())]
    table(rows)
    list(lines(rows))


def _cases() -> None:
    from mpge_bench.concealed.make import make_cases
    from mpge_bench.console import ConsoleProgress

    with contextlib.redirect_stderr(io.StringIO()), ConsoleProgress() as progress:
        make_cases(Path(), {}, 3, 1, progress)


def _diagnosis_in(folder: Path) -> None:
    label = {"value": 0.8, "low": 0.7, "high": 0.9, "unit": "1"}
    effect = {"effect": "torque_gain", "target": "hinge", "parameters": {"gain": label}, "confidence": 0.9, "law": None}
    said = {
        "schema": "mpge_bench/diagnosis/1",
        "verdict": "mismatch",
        "p_value": 0.001,
        "complete": True,
        "effects": [effect],
        "indistinguishable": [["torque_gain:hinge", "torque_bias:hinge + payload:rod"]],
        "where": [{"kind": "joint", "name": "hinge", "error": 0.1}],
        "detectable": [{"effect": "torque_gain", "target": "hinge", "size": 0.01, "unit": "1"}],
    }
    (folder / "diagnosis.json").write_text(json.dumps(said, indent=1))


def _diagnosis() -> None:
    from mpge_bench.concealed.answer import answer_of
    from mpge_bench.concealed.spiked import detectable_sizes

    answer_of(Path())
    detectable_sizes(Path())


_RESULT = _results("gat/n1000/standard/seed1/result.json")
#: By name.
KINDS: dict[str, Kind] = {
    "policy": Kind("inverted_pendulum/source_0.safetensors", "safetensors", _shipped, _policies),
    "references": Kind("biased_pendulum/references.json", "json", _shipped, _references),
    "result": Kind(_RESULT, "json", _result_of("gat"), _result, also=("first folder",)),
    "result's policy": Kind(_results("gat/n1000/standard/seed1/policy.safetensors"), "safetensors", _result_of("gat"), _beside),
    "grounding (gat)": Kind(_results("gat/n1000/standard/seed1/grounding.safetensors"), "safetensors", _result_of("gat"), _beside),
    "grounding (mpg)": Kind(_results("mpg/n1000/standard/seed1/grounding.safetensors"), "safetensors", _result_of("mpg"), _beside),
    "grounding (inversion)": Kind(_results("inversion/n1000/standard/seed1/grounding.safetensors"), "safetensors", _result_of("inversion"), _beside),
    "curve": Kind(_results("gat/n1000/standard/seed1/curve.parquet"), "parquet", _result_of("gat"), _curve),
    "finished groundings": Kind("finished.safetensors", "safetensors", _finished, _take_up),
    "rig": Kind("rig.yaml", "yaml", _rig_in, _simulated("recording.csv")),
    "rig of a pair": Kind("rig.yaml", "yaml", _task_in, _rig),
    "URDF": Kind("robot.urdf", "urdf", _rig_in, _simulated("recording.csv")),
    "MJCF": Kind("robot.xml", "mjcf", _mjcf_in, _simulated("recording.csv")),
    "recording (CSV)": Kind("recording.csv", "csv", _rig_in, _simulated("recording.csv")),
    "recording (Parquet)": Kind("recording.parquet", "parquet", _rig_in, _simulated("recording.parquet")),
    "pair": Kind("pair.yaml", "yaml", _pair_in, _pair),
    "pair's URDF": Kind("robot.urdf", "urdf", _pair_in, _pair),
    "transitions": Kind("transitions.npz", "npz", _transitions_in, _transitions("transitions.npz")),
    "transitions (Parquet)": Kind("transitions.parquet", "parquet", _transitions_in, _transitions("transitions.parquet")),
    "Minari: metadata": Kind("drawn/metadata.json", "json", _minari_in, _minari, also=("drawn",)),
    "Minari: data": Kind("drawn/main_data.hdf5", "hdf5", _minari_in, _minari, also=("drawn",)),
    "bag (MCAP)": Kind("bag/bag.mcap", "bytes", _bag_in("mcap"), _converted("bag"), also=("bag",)),
    "bag (SQLite)": Kind("bag/bag.db3", "bytes", _bag_in("db3"), _converted("bag"), also=("bag",)),
    "bag: metadata": Kind("bag/metadata.yaml", "yaml", _bag_in("db3"), _converted("bag"), also=("bag",)),
    "LeRobot: info": Kind("arms/meta/info.json", "json", _lerobot_in, _converted("arms"), also=("arms",)),
    "LeRobot: frames": Kind("arms/data/chunk-000/file-000.parquet", "parquet", _lerobot_in, _converted("arms"), also=("arms",)),
    "PACE": Kind("chirp.pt", "bytes", _isaac_in, _converted("chirp.pt")),
    "Isaac Sim (CSV)": Kind("isaac.csv", "csv", _isaac_in, _converted("isaac.csv")),
    "preset": Kind("gat.yaml", "yaml", _preset_in, _preset),
    "sweep": Kind("sweep.yaml", "yaml", _sweep_in, _sweep, imports=True),
    "concealed: answer": Kind("scores/c0000/answer.json", "json", _case_in, _scores),
    "concealed: label": Kind("kept/c0000/label.yaml", "yaml", _case_in, _scores),
    "concealed: comparison": Kind("scores/c0000/residual.json", "json", _case_in, _scores),
    "concealed: manifest": Kind("cases.json", "json", _case_in, _cases),
    "diagnosis": Kind("diagnosis.json", "json", _diagnosis_in, _diagnosis),
}


@dataclass(frozen=True)
class Outcome:
    """What came of one spoilt file: `what` was done to it, "loaded", "refused" or what was wrong, and what was said."""

    what: str
    found: str
    said: str


def tried(name: str, seed: int, index: int, folder: Path, *, tell: bool = False) -> Outcome:
    """Spoil number `index` of the kind `name` in `folder`, which holds its valid files and is the working directory, and load it; the file is mended after."""
    kind = KINDS[name]
    path, touched = folder / kind.spoilt, canary(folder, module=not kind.imports)
    valid = path.read_bytes()
    what, data = spoilt(valid, kind.form, random.Random(f"{seed} {name} {index}"))
    before, begun = _most_memory(), time.monotonic()
    path.write_bytes(data)
    try:
        found, said = _loaded(kind, tell)
    finally:
        path.write_bytes(valid)
    taken, grown = time.monotonic() - begun, _most_memory() - before
    if touched.exists():
        touched.unlink()
        found, said = "ran code", said
    elif grown > MEMORY:
        found = f"took {grown >> 20} MB"
    elif taken > SECONDS:
        found = f"took {taken:.0f} s"
    return Outcome(what, found, said)


def _loaded(kind: Kind, tell: bool) -> tuple[str, str]:
    try:
        kind.load()
    except UserError as error:
        if tell:
            traceback.print_exc()
        said = one_line(error)  # as the command line prints it
        names = (Path(kind.spoilt).name, str(Path(kind.spoilt).parent), *kind.also)
        return ("refused" if any(name in said for name in names if name != ".") else "refused without its name"), said
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        if tell:
            traceback.print_exc()
        where = traceback.extract_tb(error.__traceback__)
        own = next((frame for frame in reversed(where) if "mpge_bench" in frame.filename or "baselines" in frame.filename), where[-1])
        return f"raised {type(error).__name__}", f"{Path(own.filename).name}:{own.lineno}: {str(error)[:200]}"
    return "loaded", ""


def _most_memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _work(name: str, seed: int, first: int, count: int) -> None:
    """In a process of its own: a line of JSON for each file, on what was standard output, from which all that is printed while loading is kept."""
    out = os.fdopen(os.dup(1), "w")
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + WALL, held + WALL))
    with tempfile.TemporaryDirectory() as place:
        KINDS[name].write(Path(place))
        os.chdir(place)
        KINDS[name].load()  # valid; and what is imported on the way is no file's fault
        print(json.dumps(None), file=out, flush=True)
        for index in range(first, first + count):
            found = tried(name, seed, index, Path(place))
            print(json.dumps([found.what, found.found, found.said[:500]]), file=out, flush=True)
        os.chdir("/")


def _outcomes(name: str, seed: int, count: int) -> list[Outcome]:
    """What came of `count` files, by processes that are started again where one dies or hangs."""
    found: list[Outcome] = []
    while len(found) < count:
        call = [sys.executable, __file__, "--kind", name, "--seed", str(seed), "--count", str(count - len(found)), "--work", str(len(found))]
        process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
        assert process.stdout is not None
        started = process.stdout.readline()
        if started.strip() != "null":
            raise SystemExit(f"{name}: the valid files cannot be loaded; try --only 0")
        while True:
            # A file that keeps C busy cannot be interrupted from within.
            watch = threading.Timer(2 * SECONDS, process.kill)
            watch.start()
            line = process.stdout.readline()
            watch.cancel()
            if not line:
                break
            found.append(Outcome(*json.loads(line)))
        if process.wait() and len(found) < count:
            found.append(Outcome("?", f"process ended with {process.returncode}", ""))
    return found


def main(
    kind: Annotated[list[str] | None, typer.Option(help=f"Only this kind; may be given several times: {', '.join(KINDS)}.")] = None,
    count: Annotated[int, typer.Option(min=1, help="Spoilt files of each kind.")] = 500,
    seed: Annotated[int, typer.Option(help="Draws what is done to them.")] = 0,
    only: Annotated[int | None, typer.Option(help="Try this one alone, here, and show what it raises.")] = None,
    work: Annotated[int | None, typer.Option(hidden=True)] = None,
) -> None:
    if work is not None:
        _work((kind or [""])[0], seed, work, count)
        return
    names, wrong = kind or list(KINDS), []
    if only is not None:
        with tempfile.TemporaryDirectory() as place:
            KINDS[names[0]].write(Path(place))
            os.chdir(place)
            print(tried(names[0], seed, only, Path(place), tell=True))
            os.chdir("/")
        return
    drawn = Table("kind", "spoilt", "loaded", "refused", "wrong", "time")
    for name in names:
        begun = time.monotonic()
        found = _outcomes(name, seed, count)
        counts = Counter(one.found for one in found)
        bad = [(index, one) for index, one in enumerate(found) if one.found not in ("loaded", "refused")]
        wrong += bad
        drawn.add_row(name, *map(str, (len(found), counts["loaded"], counts["refused"], len(bad))), f"{time.monotonic() - begun:.0f} s")
        for index, one in bad:
            print(f"{name} {index}: {one.what}: {one.found}: {one.said}", flush=True)
    Console(width=120).print(drawn)
    raise typer.Exit(1 if wrong else 0)


if __name__ == "__main__":
    assert all(one.form in FORMS for one in KINDS.values())
    typer.run(main)
