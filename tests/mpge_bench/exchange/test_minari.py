"""Minari's own library reads what is written, and what it wrote is read."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.transitions.episodes import FIELDS, Episodes
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.exchange import minari as exchange

minari = pytest.importorskip("minari", reason="data sets of Minari need the extra minari")
pytest.importorskip("h5py", reason="data sets of Minari need the extra minari")

numbers = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=6)


def recording(values: list[float]) -> pd.DataFrame:
    """All columns from `values`; the last two commands are the same."""
    q = np.array(values)
    u = np.append(q[:-1], q[-2])
    moved = {"q_shoulder": q, "q_elbow": -q, "dq_elbow": 0.5 * q, "supply_volts": q}
    return pd.DataFrame({"time": 0.01 * np.arange(len(q)), "u_shoulder": u, "u_elbow": -u, **moved})


@settings(deadline=None, max_examples=10)
@given(st.lists(numbers, min_size=1, max_size=3))
def test_recordings_come_back_to_the_last_bit(rig: Rig, tmp_path_factory: pytest.TempPathFactory, several: list[list[float]]) -> None:
    out, tables = tmp_path_factory.mktemp("set") / "arm", [recording(values) for values in several]
    exchange.write_recordings(tables, rig, out)
    assert exchange.is_minari(out)
    assert [path.name for path in out.parent.iterdir()] == ["arm"]
    found = exchange.read_recordings(out, rig)
    assert [one.name for one in found] == [f"arm_{index:04d}" for index in range(len(tables))]
    for one, table in zip(found, tables, strict=True):
        pd.testing.assert_frame_equal(one.table[list(table)], table, check_exact=True)


def test_minari_reads_recordings(rig: Rig, tmp_path: Path) -> None:
    exchange.write_recordings([recording([1.0, 2.0, 3.0])], rig, tmp_path / "arm")
    (episode,) = minari.MinariDataset(tmp_path / "arm").iterate_episodes()
    assert episode.observations.tolist() == [[1.0, -1.0, 0.5], [2.0, -2.0, 1.0], [3.0, -3.0, 1.5]]
    assert episode.actions.tolist() == [[1.0, -1.0], [2.0, -2.0]]
    assert np.isnan(episode.rewards).all()
    assert (episode.terminations.tolist(), episode.truncations.tolist()) == ([False, False], [False, True])


@pytest.fixture
def transitions() -> Episodes:
    """Two episodes of the pendulum, of three and two steps."""
    rng = np.random.default_rng(0)
    dt = get_task("biased_pendulum").robot.dt
    speeds = [rng.normal(size=(count + 1, 2)) for count in (3, 2)]
    states = [np.concatenate((dt * np.cumsum(one, axis=0), one), axis=1) for one in speeds]
    before, after = (np.concatenate([one[part] for one in states]) for part in (slice(-1), slice(1, None)))
    return Episodes(before, rng.uniform(-1, 1, (5, 1)), after)


def test_transitions_come_back_and_minari_reads_them(transitions: Episodes, tmp_path: Path) -> None:
    task = get_task("biased_pendulum")
    exchange.write_transitions(transitions, task, tmp_path / "drawn")
    found = exchange.read_transitions(tmp_path / "drawn", task.robot)
    assert all(np.array_equal(getattr(found, name), getattr(transitions, name)) for name in FIELDS)
    loaded = minari.MinariDataset(tmp_path / "drawn")
    assert (loaded.total_episodes, loaded.total_steps, loaded.spec.dataset_id) == (2, 5, "mpge_bench/biased_pendulum-v0")
    with pytest.raises(UserError, match="drawn: is there already"):
        exchange.write_transitions(transitions, task, tmp_path / "drawn")
    with pytest.raises(UserError, match="the hopper has 11 columns there"):
        exchange.read_transitions(tmp_path / "drawn", get_task("broken_hopper").robot)


def test_transitions_of_others_are_read(transitions: Episodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `minari` itself stores a data set: below its name, in a folder called data."""
    from gymnasium.spaces import Box
    from minari.data_collector import EpisodeBuffer

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    seen = [np.append(transitions.observations[part], transitions.next_observations[part][-1:], 0) for part in (slice(3), slice(3, 5))]
    acted = [transitions.actions[part] for part in (slice(3), slice(3, 5))]
    none = [np.zeros(len(one)) for one in acted]
    rest = ({"rewards": zero, "terminations": zero, "truncations": zero} for zero in none)
    buffers = [EpisodeBuffer(observations=one, actions=two, **three) for one, two, three in zip(seen, acted, rest, strict=True)]
    spaces = {"observation_space": Box(-9, 9, (4,), np.float64), "action_space": Box(-1, 1, (1,), np.float64)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an author and the like that it is not told
        minari.create_dataset_from_buffers("pendulum/test-v0", buffers, **spaces)
    found = exchange.read_transitions(tmp_path / "pendulum" / "test-v0", get_task("biased_pendulum").robot)
    assert all(np.array_equal(getattr(found, name), getattr(transitions, name)) for name in FIELDS)


def test_a_data_set_that_names_an_environment_in_place_of_spaces_is_refused(transitions: Episodes, tmp_path: Path) -> None:
    exchange.write_transitions(transitions, get_task("biased_pendulum"), tmp_path / "drawn")
    path = tmp_path / "drawn" / "metadata.json"
    metadata = json.loads(path.read_text())
    del metadata["observation_space"]
    path.write_text(json.dumps(metadata | {"env_spec": json.dumps({"id": "Trap-v0", "entry_point": "os:abort"})}))
    with pytest.raises(UserError, match="its metadata does not say the spaces"):
        exchange.read_transitions(tmp_path / "drawn", get_task("biased_pendulum").robot)


def test_what_is_cut_off_or_of_another_rig_is_refused_in_one_line(rig: Rig, tmp_path: Path) -> None:
    exchange.write_recordings([recording([1.0, 2.0, 3.0])], rig, tmp_path / "arm")
    file = tmp_path / "arm" / "main_data.hdf5"
    whole = file.read_bytes()
    for content in (b"", whole[: len(whole) // 2]):
        file.write_bytes(content)
        with pytest.raises(UserError, match="arm: not a readable data set of Minari") as error:
            exchange.read_recordings(tmp_path / "arm", rig)
        assert "\n" not in str(error.value)
    file.write_bytes(whole)
    path = tmp_path / "arm" / "metadata.json"
    path.write_text(path.read_text().replace("q_elbow", "q_wrist"))
    with pytest.raises(UserError, match="does not say which of its numbers are q_elbow"):
        exchange.read_recordings(tmp_path / "arm", rig)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ([recording([1.0, 2.0]), recording([1.0, 2.0]).drop(columns="dq_elbow")], "recordings have different columns"),
        ([recording([1.0, 2.0]).iloc[:1]], "a recording has 1 rows"),
    ],
)
def test_what_no_data_set_can_hold_is_refused(rig: Rig, tmp_path: Path, tables: list[pd.DataFrame], said: str) -> None:
    with pytest.raises(UserError, match=said):
        exchange.write_recordings(tables, rig, tmp_path / "arm")
    assert not list(tmp_path.iterdir())
