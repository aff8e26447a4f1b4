"""Recordings from ROS 2 bags: states of joints from one topic, commands from another. Nothing of ROS is needed, and no code or definition in a bag is used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs import yaml12
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading, text_of
from mpge_bench.exchange.series import Array, Asked, Read, Series, joined, ordered

#: Topics by their usual names.
STATES, COMMANDS = "/joint_states", "/joint_commands"
JOINT_STATE, FLOATS, TRAJECTORY = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray", "trajectory_msgs/msg/JointTrajectory"
_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Message:
    """A message and its times, ns: when the bag received it, and its header's stamp, 0 without one."""

    received: int
    stamp: int
    content: Any


@dataclass(frozen=True)
class Order:
    """What a message commands from some time on.

    Attributes:
        after: s, from the message's own time.
        fields: by their names in messages, values in the order of `joints`; empty ones hold nothing.
    """

    after: float
    joints: Sequence[str]
    fields: Mapping[str, Sequence[float]]


def is_bag(path: Path) -> bool:
    """Whether `path` looks like a bag: an MCAP or SQLite file, or a folder of them as `ros2 bag record` makes it."""
    return path.suffix.lower() in (".mcap", ".db3") or (path / "metadata.yaml").exists()


def read_bag(path: Path, rig: Rig, asked: Asked) -> Read:
    """The recording in a bag.

    Times are the headers' stamps. Commands without stamps have the times at which the bag received them, less the median of what the states took from stamp to
    receipt; states without stamps have theirs, and so have the commands, then. Points of a trajectory count from their own times until the next point or the
    next trajectory.

    Raises:
        UserError: if rosbags is not installed, the bag cannot be read, a topic is missing or of another type, or its messages are not the rig's.
    """
    topics = asked.states or STATES, asked.commands or COMMANDS
    kinds, found = _messages(path, topics)
    wheres = [f"{path}, topic {topic}" for topic in topics]
    for where, topic in zip(wheres, topics, strict=True):
        if not found[topic]:
            raise UserError(f"{where}: has no messages; record it again, or name another topic with --states or --commands")
    states, commands = (found[topic] for topic in topics)
    of_states, of_commands, notes = _clock(states, commands)
    kind = kinds[topics[1]]
    joints = ordered(asked.joints, rig, wheres[1], len(commands[0].content.data)) if kind == FLOATS else ()
    orders = [_orders(kind, one.content, joints) for one in commands]
    if any(len(several) > 1 for several in orders):
        notes += ("a trajectory's points are held from one to the next; controllers draw curves through them: record what they send to the motors, if you can",)
    table, more = joined(_states(wheres[0], states, of_states, rig), _commands(wheres[1], orders, of_commands, rig))
    return Read(path.stem, table, notes + more)


def _messages(path: Path, topics: Sequence[str]) -> tuple[Mapping[str, str], Mapping[str, list[Message]]]:
    """Types of all topics and the messages of `topics`."""
    try:
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise UserError("bags of ROS 2 need rosbags: pip install 'mpge_bench[ros]'") from error
    with reading(path, "bag", "if the recording was cut off, `mcap recover` or `ros2 bag reindex` may mend it"), _opened(path, Reader) as bag:
        kinds = {one.topic: one.msgtype for one in bag.connections}
        _check_topics(path, topics, kinds)
        # The types as ROS 2 has them, not as the bag says: rosbags would make code of those.
        store = get_typestore(Stores.ROS2_HUMBLE)
        found: dict[str, list[Message]] = {topic: [] for topic in topics}
        for connection, received, raw in bag.messages([one for one in bag.connections if one.topic in topics]):
            content: Any = store.deserialize_cdr(raw, connection.msgtype)
            header = getattr(content, "header", None)
            found[connection.topic].append(Message(_whole(received), 0 if header is None else _nanoseconds(header.stamp), content))
    return kinds, found


def _opened(path: Path, reader: Callable[[Path], Any]) -> Any:
    """A bag, whose metadata, which rosbags reads whatever it is, is seen to be a text that a writer would write: a few lines of YAML may be any size."""
    if path.is_dir():
        yaml12.load(text_of(path / "metadata.yaml"))
    return reader(path)


def _whole(received: Any) -> int:
    """A time of receipt as SQLite has it, which keeps texts in columns of numbers, too."""
    if not isinstance(received, int):
        raise TypeError(f"a message was received at {received!r}, which is no whole number of nanoseconds")
    return received


def _nanoseconds(time: Any) -> int:
    """Of a Time or a Duration."""
    return int(time.sec) * _NANOSECONDS + int(time.nanosec)


def _check_topics(path: Path, topics: Sequence[str], kinds: Mapping[str, str]) -> None:
    """Both topics have to be there, with types that are understood."""
    has = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(kinds.items())) or "none"
    for topic, option, allowed in zip(topics, ("--states", "--commands"), ((JOINT_STATE,), (JOINT_STATE, FLOATS, TRAJECTORY)), strict=True):
        if topic not in kinds:
            raise UserError(f"{path}: has no topic {topic}; name one of type {' or '.join(allowed)} with {option}: the bag has {has}")
        if kinds[topic] not in allowed:
            raise UserError(f"{path}: topic {topic} is of type {kinds[topic]}; {option} takes {' or '.join(allowed)}: the bag has {has}")


def _clock(states: Sequence[Message], commands: Sequence[Message]) -> tuple[Array, Array, tuple[str, ...]]:
    """Times of states and commands on one clock, s from the first state, and what was assumed."""
    (at, received), (issued, sent) = (np.array([(one.stamp, one.received) for one in messages]).T for messages in (states, commands))
    notes: tuple[str, ...] = ()
    if not at.any():
        at, notes = received, ("states have no stamps: all times are those at which the bag received the messages",)
    elif issued.any():
        sent = issued
    else:
        late = int(np.median(received - at))
        sent = sent - late
        notes = (f"commands have no stamps: they count from their receipt, less {late / 1e6:.3g} ms, the median that states took from stamp to receipt",)
    # Whole nanoseconds since 1970 are more than floating-point numbers can hold.
    return (at - at[0]) / _NANOSECONDS, (sent - at[0]) / _NANOSECONDS, notes


def _states(where: str, messages: Sequence[Message], time: Array, rig: Rig) -> Series:
    """Positions, and velocities and efforts of joints that all messages have them of."""
    at = _matching(where, [one.content.name for one in messages], rig.joints)
    contents = [messages[index].content for index in at]
    columns: dict[str, Array] = {}
    for prefix, name in (("q", "position"), ("dq", "velocity"), ("effort", "effort")):
        lacking = next((index for index, one in zip(at, contents, strict=True) if len(getattr(one, name)) != len(one.name)), None)
        if lacking is None:
            columns |= {f"{prefix}_{joint}": np.array([getattr(one, name)[one.name.index(joint)] for one in contents]) for joint in rig.joints}
        elif prefix == "q":
            content = messages[lacking].content
            raise UserError(f"{where}: message {lacking + 1} has {len(content.position)} positions for {len(content.name)} joints; it has to have one for each")
    # Drivers write NaN for what they do not measure.
    measured = {name: values for name, values in columns.items() if name.startswith("q_") or not np.isnan(values).all()}
    return Series(where, time[at], measured)


def _orders(kind: str, content: Any, joints: Sequence[str]) -> list[Order]:
    """What a message commands; `joints` are those of a message without names."""
    if kind == FLOATS:
        return [Order(0.0, joints, {"position": content.data, "effort": content.data})]
    if kind == JOINT_STATE:
        return [Order(0.0, content.name, {"position": content.position, "effort": content.effort})]
    return [
        Order(_nanoseconds(point.time_from_start) / _NANOSECONDS, content.joint_names, {"position": point.positions, "effort": point.effort})
        for point in content.points
    ]


def _commands(where: str, orders: Sequence[Sequence[Order]], time: Array, rig: Rig) -> Series:
    """Of each joint with a motor what its mode takes: target angles or torques."""
    Series(where, time, {}).checked(repeated=True)
    at = _matching(where, [several[0].joints if several else () for several in orders], rig.driven)
    times: list[float] = []
    rows: list[list[float]] = []
    for index in at:
        while times and times[-1] >= time[index]:  # a trajectory ends where the next begins
            times.pop()
            rows.pop()
        for one in orders[index]:
            times.append(time[index] + one.after)
            rows.append([_value(f"{where}: message {index + 1}", one, joint, rig) for joint in rig.driven])
    found = np.reshape(rows, (len(rows), len(rig.driven)))
    return Series(where, np.array(times), {f"u_{joint}": found[:, column] for column, joint in enumerate(rig.driven)})


def _value(where: str, order: Order, joint: str, rig: Rig) -> float:
    mode = rig.modes[joint]
    field = "position" if mode == "position" else "effort"
    values = order.fields[field]
    if len(values) != len(order.joints):
        said = f"has no {field} for {joint}, which mode {mode} of the rig takes"
        raise UserError(f"{where} {said}; correct the mode, or name another topic with --commands")
    return float(values[list(order.joints).index(joint)])


def _matching(where: str, named: Sequence[Sequence[str]], joints: Sequence[str]) -> list[int]:
    """Which messages have all `joints`; others may have none of them.

    Raises:
        UserError: if a message has only some of them, or no message has any.
    """
    found = [index for index, names in enumerate(named) if set(joints) <= set(names)]
    partly = next((index for index, names in enumerate(named) if set(joints) & set(names) and not set(joints) <= set(names)), None)
    if partly is not None:
        lacking = ", ".join(joint for joint in joints if joint not in named[partly])
        raise UserError(f"{where}: message {partly + 1} lacks {lacking}; it has {', '.join(named[partly])}, and one message must have all of the rig's joints")
    if not found:
        others = ", ".join(dict.fromkeys(name for names in named for name in names)) or "none"
        raise UserError(f"{where}: has none of the rig's joints ({', '.join(joints)}), but {others}; joints must have the same names in both")
    return found
