"""Many runs: none stops the others, one whose process was killed is tried once more. The runs are made up."""

from __future__ import annotations

import pytest

from mpge_bench.envs.errors import UserError
from mpge_bench.harness import sweep as harness
from mpge_bench.harness.engines import Killed
from mpge_bench.harness.settings import RunSettings
from mpge_bench.harness.sweep import Outcome, sweep

RUNS = [RunSettings("biased_pendulum", "direct", 0, "smoke", seed) for seed in range(4)]


class InPlace:
    """An engine in this process: runs of these seeds are killed, as often as it says, leaving what a killed process leaves."""

    processes = 1

    def __init__(self, kills):
        self.kills = dict(kills)
        self.calls = []

    def side_by_side(self, work, calls):
        for call in calls:
            settings, out, _ = call
            self.calls.append(settings.seed)
            if self.kills.get(settings.seed, 0):
                self.kills[settings.seed] -= 1
                settings.partial(out).mkdir(parents=True, exist_ok=True)
                (settings.partial(out) / "half").write_text("")
                yield call, Killed("SIGKILL")
            else:
                yield call, work(call)


@pytest.fixture(autouse=True)
def made_up(monkeypatch):
    """A run writes its result at once; of seed 1 it fails, of seed 2 it writes it somewhere else."""

    def run(settings, out, policy_folder):
        if settings.seed == 1:
            raise ValueError("no\nway")
        folder = settings.folder(out if settings.seed != 2 else out / "elsewhere")
        folder.mkdir(parents=True)
        (folder / "result.json").write_text("")
        return {"normalized_return": 0.5}

    monkeypatch.setattr(harness, "run", run)
    monkeypatch.setattr(harness, "compile_ahead", lambda: None)


def swept(engine, runs, out):
    told = []
    sweep(runs, out, None, engine, told.append)
    return told


def test_a_run_that_fails_does_not_stop_the_others(tmp_path):
    told = swept(InPlace({}), RUNS, tmp_path)
    assert [one.settings for one in told] == RUNS
    assert told[0] == Outcome(RUNS[0], {"normalized_return": 0.5}, None)
    assert told[1] == Outcome(RUNS[1], None, "ValueError: no way")
    assert "on a machine that does not share" in told[2].error
    assert (told[3].error, told[3].again) == (None, False)


def test_a_killed_run_is_made_again_after_the_others(tmp_path):
    engine = InPlace({0: 1})
    told = swept(engine, [RUNS[0], RUNS[3]], tmp_path)
    assert engine.calls == [0, 3, 0]
    assert [(one.settings.seed, one.again) for one in told] == [(0, True), (3, False), (0, False)]
    assert told[0].error == "its process died (SIGKILL); want of memory can do that"
    assert told[2].result


def test_a_run_that_is_killed_twice_has_failed_and_leaves_nothing(tmp_path):
    told = swept(InPlace({0: 3}), [RUNS[0], RUNS[3]], tmp_path)
    assert [(one.settings.seed, one.again) for one in told] == [(0, True), (3, False), (0, False)]
    assert "its process died" in told[2].error
    assert not RUNS[0].partial(tmp_path).exists()


def test_who_stops_a_sweep_finds_nothing_half_made(tmp_path):
    def stop(outcome):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep([RUNS[0], RUNS[3]], tmp_path, None, InPlace({0: 1}), stop)
    assert list(tmp_path.rglob("half")) == []


def test_wrong_settings_are_told_without_their_type(tmp_path, monkeypatch):
    def run(settings, out, policy_folder):
        raise UserError("too few samples")

    monkeypatch.setattr(harness, "run", run)
    assert swept(InPlace({}), RUNS[:1], tmp_path)[0].error == "too few samples"
