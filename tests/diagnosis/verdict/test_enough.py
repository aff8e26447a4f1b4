"""Too little data is an answer: it never passes for there being no mismatch, and says how much more it takes; what is large shows in little data."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpge_bench.diagnosis.choose import choice
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import candidates, scales
from mpge_bench.diagnosis.pipeline import diagnose_files
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.envs.effects import TorqueGain

from ..conftest import write_case


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seconds", [0.8, 2.0])
def test_one_or_two_windows_are_too_little_data_without_a_warning(tmp_path: Path, seconds: float) -> None:
    """No window was left to choose by, and numpy's warnings of empty means stood on the screen."""
    rig = write_case(tmp_path, [TorqueGain("hinge", 0.6)], recordings=1, seconds=seconds)
    assert diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1).result.verdict == "too_little_data"


@pytest.mark.slow
@pytest.mark.parametrize(("recordings", "seconds"), [(1, 3.0), (4, 1.0)])
def test_too_short_recordings_of_a_large_effect_say_how_much_more_it_takes(tmp_path: Path, recordings: int, seconds: float) -> None:
    rig = write_case(tmp_path, [TorqueGain("hinge", 0.6)], recordings=recordings, seconds=seconds)
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1).result
    assert found.verdict == "too_little_data"
    assert (found.effects, found.where) == ((), ())
    assert found.more_data is not None
    assert found.more_data.needed >= 8 > found.more_data.windows
    # What it asks for is enough.
    assert found.more_data.seconds < 30
    assert f"record about {found.more_data.seconds:.0f} s more" in " ".join(found.summary)
    assert "within the sensors' noise" not in " ".join(found.summary)
    rig = write_case(tmp_path, [TorqueGain("hinge", 0.6)], recordings=recordings, seconds=seconds + (found.more_data.seconds + 1) / recordings)
    measured = measurements(read_rig(rig), read_recordings(sorted(tmp_path.glob("*.csv")), read_rig(rig)))
    linear = reference(measured.rig, measured.recordings)
    assert choice.tested(problem(measured, linear, 0.5), candidates(measured.rig, scales(linear))).screening.p_value < 0.01


@pytest.mark.slow
def test_a_large_effect_is_named_from_one_recording_of_four_seconds(tmp_path: Path) -> None:
    """Of five windows, missed by 20 times the noise, it was said that they cannot tell a mismatch from chance."""
    rig = write_case(tmp_path, [TorqueGain("hinge", 0.6)], recordings=1, seconds=4.0)
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1).result
    assert [(one.effect, one.target) for one in found.effects] == [("torque_gain", "hinge")]
    assert found.verdict == "explained"


@pytest.mark.slow
def test_nothing_is_found_in_four_seconds_of_nothing(tmp_path: Path) -> None:
    rig = write_case(tmp_path, recordings=1, seconds=4.0)
    assert diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1).result.verdict in ("no_mismatch", "too_little_data")
