"""Other corrections of a case: what they learn, that it is kept, told and drawn, and that torch is imported only by the one that needs it."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mpge_bench import concealed
from mpge_bench.concealed import all_parameters, compare, residual
from mpge_bench.concealed.answer import Answer
from mpge_bench.concealed.compare import Learnt, unseen_error, with_effects
from mpge_bench.concealed.summary import lines
from mpge_bench.diagnosis.data.recording import Recording, read_recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.envs.errors import UserError

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pendulum with a weak motor and friction, in short recordings."""
    from mpge_bench.concealed.make import make
    from mpge_bench.concealed.mechanism import Case, Effect

    out = tmp_path_factory.mktemp("cases")
    effects = [Effect("torque_gain", "hinge", {"gain": 0.6}), Effect("viscous_friction", "hinge", {"damping": 0.3})]
    make(Case("c0000", "pend", ["told", "si"], effects), out, 3, rows=300)
    return out


def read(folder: Path) -> tuple[Rig, list[Recording], list[Recording]]:
    rig = read_rig(folder / "given" / "c0000" / "rig.yaml")
    given, unseen = (sorted((folder / part / "c0000").glob("*.csv")) for part in ("given", "kept"))
    return rig, [read_recording(path, rig) for path in given], [read_recording(path, rig) for path in unseen]


@pytest.mark.slow
def test_all_parameters_at_once_come_near_where_they_can_say_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(all_parameters, "STARTS", 1)
    rig, given, unseen = read(folder)
    found = all_parameters.identified(rig, given)
    assert unseen_error(found, unseen, rig.layout) < 0.1 * unseen_error(with_effects(rig), unseen, rig.layout)
    assert found.said["converged"]
    assert {one["effect"] for one in found.said["effects"]} == set(all_parameters.USUAL)


@pytest.mark.slow
def test_a_residual_learns_what_the_simulator_lacks(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(residual, "EPOCHS", 30)
    rig, given, unseen = read(folder)
    found = residual.trained(rig, given)
    assert unseen_error(found, unseen, rig.layout) < 0.5 * unseen_error(with_effects(rig), unseen, rig.layout)
    before, after = found.said["held_out"]
    assert after < 0.5 * before
    assert found.predict(unseen[0]).tolist() == found.predict(unseen[0]).tolist()


def test_an_untrained_residual_changes_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(residual, "EPOCHS", 0)
    rig, given, unseen = read(folder)
    assert unseen_error(residual.trained(rig, given), unseen, rig.layout) == pytest.approx(unseen_error(with_effects(rig), unseen, rig.layout), rel=1e-6)


class Nothing:
    """Sees nothing anywhere."""

    def __call__(self, rig: Path, recordings: Sequence[Path], out: Path, seconds: float) -> Answer:
        return Answer(False)


def halved(rig: Rig, recordings: Sequence[Recording]) -> Learnt:
    """Gets there half-way, and has seen what may be seen alone."""
    assert [one.path.name for one in recordings] == [f"train_{index:02d}.csv" for index in range(4)]
    nothing = with_effects(rig)
    return Learnt(lambda one: (nothing.predict(one) + one.q) / 2, {"seen": len(recordings)})


def failing(rig: Rig, recordings: Sequence[Recording]) -> Learnt:
    raise UserError("no idea")


def test_comparisons_are_kept_and_told_beside_the_diagnosis(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: Callable[..., tuple[int, str, str]], refused: Callable[..., str]
) -> None:
    asked = {"halved": ("half-way", f"{__name__}:halved"), "failing": ("never", f"{__name__}:failing")}
    monkeypatch.setattr(compare, "COMPARATORS", asked)
    monkeypatch.setattr("mpge_bench.concealed.summary.COMPARATORS", asked)
    command = ["concealed", "score", folder, "--diagnoser", f"{__name__}:Nothing", "--out", tmp_path, "--jobs", 1]
    code, out, err = in_process(*command, "--compare", "halved,failing")
    assert code == 0, err
    assert "half-way: error on unseen recordings, times the true effects'" in out
    assert "never: failed: 1 of 1" in out
    kept = json.loads((tmp_path / "c0000" / "halved.json").read_text())
    (row,) = pd.read_parquet(tmp_path / "scores.parquet").to_dict("records")
    assert kept["seen"] == 4
    assert kept["error"] == row["halved"] == pytest.approx(row["nothing"] / 2)
    assert json.loads((tmp_path / "c0000" / "failing.json").read_text())["failed"] == "no idea"
    page = (tmp_path / "index.html").read_text()
    assert "Errors of each correction" not in page  # of one there is none
    # What is kept is not learnt again, and told without being asked for.
    (tmp_path / "c0000" / "halved.json").write_text(json.dumps(kept | {"error": row["true"]}))
    (tmp_path / "c0000" / "failing.json").unlink()
    out = in_process(*command)[1]
    assert "half-way: error on unseen recordings, times the true effects': 1 (median of 1" in out
    assert "never" not in out
    assert "Errors of each correction" in (tmp_path / "index.html").read_text()
    assert "choose of halved, failing" in refused(*command, "--compare", "halved,none")


def test_outside_the_catalogue_comparisons_are_in_the_uncorrected_errors() -> None:
    row = {"group": "outside the catalogue", "right": True, "credit": 1.0, "off": [], "confidences": [], "seconds": 1.0}
    told = dict(lines([row | {"error": 1.0, "nothing": 4.0, "true": None, "residual": 2.0}]))
    assert told["neural residual: error on unseen recordings, times the uncorrected, outside the catalogue"] == "0.5 (median of 1; this diagnosis on them 0.25)"


def test_torch_is_imported_by_the_residual_alone() -> None:
    for path in Path(concealed.__file__).parent.glob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        names |= {f"{node.module}.{alias.name}" for node in nodes if isinstance(node, ast.ImportFrom) for alias in node.names}
        heavy = {name for name in names if name.split(".")[0] == "torch" or name.startswith("mpge_bench.concealed.residual")}
        assert bool(heavy) == (path.name == "residual.py"), (path.name, heavy)


def test_errors_are_of_all_recordings_alike(folder: Path) -> None:
    rig, given, _ = read(folder)
    off = Learnt(lambda one: one.q + (0.3 if one is given[0] else 0.4))
    assert unseen_error(off, given[:2], rig.layout) == pytest.approx(float(np.sqrt((0.09 + 0.16) / 2)))
