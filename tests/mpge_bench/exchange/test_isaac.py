"""Files made for Isaac Sim's and PACE's system identification."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError
from mpge_bench.exchange.isaac import is_compact, read_compact, read_pace
from mpge_bench.exchange.series import Asked

ORDER = Asked(joints=("elbow", "shoulder"))
TABLE = pd.DataFrame({"timestamp": [5.0, 5.1, 5.2], "q1": [1, 2, 3], "q2": [4, 5, 6], "dq1": [0, 0, 1], "dq2": [1, 1, 1], "cmd1": [7, 8, 9], "cmd2": [0, 0, 0]})


def chirp(path: Path, **changes: object) -> Path:
    """What PACE's data_collection.py saves."""
    data = {"time": torch.linspace(0, 1, 5), "dof_pos": torch.arange(10.0).reshape(5, 2), "des_dof_pos": -torch.arange(10.0).reshape(5, 2)}
    torch.save({key: value for key, value in {**data, **changes}.items() if value is not None}, path)
    return path


def test_pace(servos: Rig, tmp_path: Path) -> None:
    found = read_pace(chirp(tmp_path / "chirp_data.pt"), servos, ORDER)
    assert found.name == "chirp_data"
    assert found.table["time"].tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert found.table["q_elbow"].tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert found.table["u_shoulder"].tolist() == [-1.0, -3.0, -5.0, -7.0, -9.0]


def test_what_is_no_file_of_pace_is_refused_and_runs_nothing(servos: Rig, rig: Rig, tmp_path: Path) -> None:
    for changes, said in (({"dof_pos": None}, "KeyError"), ({"time": torch.zeros(4)}, "has shape"), ({"time": Trap()}, "Weights only load failed")):
        with pytest.raises(UserError, match="not a readable file of PACE") as error:
            read_pace(chirp(tmp_path / "chirp.pt", **changes), servos, ORDER)
        assert said in str(error.value)
        assert "\n" not in str(error.value)
    whole = chirp(tmp_path / "chirp.pt").read_bytes()
    (tmp_path / "cut.pt").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UserError, match="not a readable file of PACE"):
        read_pace(tmp_path / "cut.pt", servos, ORDER)
    with pytest.raises(UserError, match="des_dof_pos are target angles, and shoulder of the rig has mode torque"):
        read_pace(tmp_path / "chirp.pt", rig, ORDER)
    with pytest.raises(UserError, match="has 2 values without names; give --joints"):
        read_pace(tmp_path / "chirp.pt", servos, Asked())


class Trap:
    """Whoever unpickles it, fails."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return pytest.fail, ("the file's code was run",)


def test_isaac_sims_columns(rig: Rig) -> None:
    assert is_compact(TABLE)
    assert not is_compact(TABLE.rename(columns={"q1": "q_elbow"}))
    found = read_compact(Path("data.csv"), TABLE, rig, ORDER)
    assert found.table.to_dict("list") == {
        "time": pytest.approx([0.0, 0.1, 0.2]),
        "u_shoulder": [0, 0, 0],
        "u_elbow": [7, 8, 9],
        "q_elbow": [1, 2, 3],
        "q_shoulder": [4, 5, 6],
        "dq_elbow": [0, 0, 1],
        "dq_shoulder": [1, 1, 1],
    }
    for table, said in ((TABLE.drop(columns="cmd2"), "has no column cmd2"), (TABLE.replace({"q2": {5: np.nan}}), "sample 2: q_shoulder is nan")):
        with pytest.raises(UserError, match=said):
            read_compact(Path("data.csv"), table, rig, ORDER)
