"""Cases: the same from the same seed, sealed, gone on with where they were stopped; and scores of diagnosers that are always right, never, or broken."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from mpge_bench import concealed
from mpge_bench.concealed import answer, recorded
from mpge_bench.concealed.answer import Answer, Named, answer_of, diagnoser
from mpge_bench.concealed.draw import FLOATING, GEOMETRY, KINDS, LEAST_VISIBLE, OUTSIDE, drawn, key_of, places, visible
from mpge_bench.concealed.laws import ACTUATOR
from mpge_bench.concealed.make import _made, _recorded, _system
from mpge_bench.concealed.mechanism import Array, Case, Effect, Rig
from mpge_bench.concealed.score import Truth, _errors, cases_of, score
from mpge_bench.concealed.summary import lines
from mpge_bench.cores import cores
from mpge_bench.diagnosis import pipeline
from mpge_bench.envs.effects import CATALOGUE
from mpge_bench.envs.errors import UserError

pytest.importorskip("mujoco")
#: Of this seed the first case is two links that swing freely, the upper with air drag.
SEED = 40


def truth(rig: Path) -> list[dict[str, object]]:
    """What the answer's file says: only a test may look."""
    path = rig.parents[2] / "kept" / rig.parent.name / "label.yaml"
    found: list[dict[str, object]] = yaml.safe_load(path.read_text())["effects"]
    return found


class Right:
    """Knows, and says that gravity would be the same."""

    def __call__(self, rig: Path, recordings: Sequence[Path], out: Path, seconds: float) -> Answer:
        assert len(recordings) == 4
        effects = [Named(one["effect"], one["target"], {k: (v, 0.9 * v, 1.1 * v) for k, v in one["value"].items()}, 0.9) for one in truth(rig)]
        data = yaml.safe_load(rig.read_text()) | {"robot": str(rig.parent / "robot.urdf"), "effects": [_plain(one) for one in truth(rig)]}
        (out / "corrected.yaml").write_text(yaml.safe_dump(data))
        return Answer(True, effects, [[("gravity", "world")]], corrected=str(out / "corrected.yaml"))


def _plain(one: dict[str, object]) -> dict[str, object]:
    return {"effect": one["effect"], "target": one["target"], **one["value"]}


class Nothing:
    """Sees nothing anywhere."""

    def __call__(self, rig: Path, recordings: Sequence[Path], out: Path, seconds: float) -> Answer:
        return Answer(False)


class Broken:
    """Fails."""

    def __call__(self, rig: Path, recordings: Sequence[Path], out: Path, seconds: float) -> Answer:
        raise ArithmeticError("no answer")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One case, with its answer."""
    path = tmp_path_factory.mktemp("cases")
    _made(path, SEED, 0, "c")
    return path


@pytest.mark.parametrize("name", ["mechanism", "laws", "recorded", "floating", "ground", "thrown", "draw", "make"])
def test_what_makes_cases_shares_nothing_with_what_diagnoses(name: str) -> None:
    text = (Path(concealed.__file__).parent / f"{name}.py").read_text()
    found = {node.module or "" for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)}
    allowed = ("mpge_bench.concealed", "mpge_bench.console", "mpge_bench.files", "mpge_bench.form")
    # What says errors, reads files and turns functions into machine code knows no physics.
    allowed += ("mpge_bench.envs.errors", "mpge_bench.envs.reading", "mpge_bench.envs.compiled")
    assert all(module.startswith(allowed) for module in found if module.startswith("mpge_bench"))
    assert "pybullet" not in text


def test_kinds_are_the_catalogue_s_or_outside_of_it() -> None:
    assert (KINDS | GEOMETRY | FLOATING).keys() <= CATALOGUE.keys()
    assert not [name for name in OUTSIDE if name in CATALOGUE and not CATALOGUE[name].is_formula]


def test_motors_do_to_a_command_what_they_do_in_the_order_of_the_catalogue_whichever_was_drawn_first() -> None:
    """A bias before a gain, as it was drawn, is another one behind it, where our simulator has it: the error of the true effects was that of false ones."""
    order = [CATALOGUE[kind].place for kind in ACTUATOR if kind in CATALOGUE]
    assert order == sorted(order)
    case = Case("c0000", "pend", [], [])
    rig = Rig(case, np.random.default_rng(0))
    both = [Effect("torque_bias", rig.joints[0], {"torque": 1.0}), Effect("torque_gain", rig.joints[0], {"gain": 0.5})]
    for effects in (both, both[::-1]):
        torque = 2.0
        for _, law in recorded.Truth(rig, effects).laws["actuator"]:
            torque = law(torque, [0.0], [0.0], 0.0)
        assert torque == 2.0


@pytest.mark.slow
def test_what_is_drawn_is_to_be_seen_and_no_thing_has_two_of_one_group() -> None:
    case = drawn(SEED + 2, 0)
    assert case == drawn(SEED + 2, 0)
    assert len({(KINDS[one.kind].group, one.target) for one in case.effects}) == len(case.effects) == 2
    rig = Rig(case, np.random.default_rng(key_of(SEED + 2, case.name)))
    # Another motion than the one by which it was drawn.
    assert max(visible(case, rig, one, np.random.default_rng(5)) for one in case.effects) > LEAST_VISIBLE / 2


def test_no_motor_is_biased_where_a_spring_is() -> None:
    """Of the two only another rest is to be seen: case 33 of seed 2044 hid both and was one spring to everybody."""
    assert KINDS["torque_bias"].group == KINDS["joint_spring"].group


def test_a_cart_has_no_side_to_put_a_load_on() -> None:
    """One was put there all the same, at no place at all, and MuJoCo refused the case."""
    rig = Rig(Case("any", "cart", [], []), np.random.default_rng(0))
    assert places("payload", KINDS["payload"], rig) == ["pole"]
    assert places("mass_scale", KINDS["mass_scale"], rig) == ["cart", "pole"]
    assert places("torque_gain", KINDS["torque_gain"], rig) == ["slide"]
    assert places("coupling_spring", OUTSIDE["coupling_spring"], rig) == ["hinge"]


def closed_loop(seed: int, index: int) -> tuple[Array, Array]:
    """q and dq of a case's recording under a controller, as they would be without noise, shape (rows, joints) each."""
    case = drawn(seed, index)
    key = key_of(seed, case.name)
    clean = _recorded(*_system(case, key), "closed", np.random.default_rng([*key, 2]), 1.0)[1]
    return clean[:, 1], clean[:, 2]


@pytest.mark.slow
def test_no_joint_goes_round_though_what_is_hidden_makes_the_loop_unstable() -> None:
    """A seven-joint arm whipped round at 250 rad/s: its controller's gains stayed as they were, and only what was asked of it became less."""
    assert np.abs(closed_loop(2027, 28)[0]).max() < 2.8


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "index"), [(2029, 35), (2029, 42), (2027, 58)])
def test_rows_follow_every_motion(seed: int, index: int) -> None:
    """Arms of five to seven joints whose controller trembled from row to row, at up to 60 rad/s, which no rows of 10 ms tell."""
    q, dq = closed_loop(seed, index)
    means, gone = (dq[1:] + dq[:-1]) / 2, np.diff(q, axis=0) / 0.01
    assert (np.std(means - gone, axis=0) < 0.05 * np.std(dq, axis=0) + 0.02).all()


def test_a_case_that_cannot_be_recorded_is_drawn_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of seed 2030's cases one trembled however little was asked of it, and all that were to come after it were not made, with a traceback."""
    drawn_ones: list[Case] = []

    def unsteady(case: Case, out: Path, seed: int) -> None:
        drawn_ones.append(case)
        if len(drawn_ones) == 1:
            raise RuntimeError("trembles")
        (out / "kept" / case.name).mkdir(parents=True)
        (out / "kept" / case.name / "label.yaml").write_text("effects: []")

    monkeypatch.setattr("mpge_bench.concealed.make.make", unsteady)
    _made(tmp_path, SEED, 0, "c")
    first, second = drawn_ones
    assert first == drawn(SEED, 0)
    assert second == drawn(SEED, 0, turn=1) != first
    monkeypatch.setattr("mpge_bench.concealed.make.DRAWS", 1)
    drawn_ones.clear()
    with pytest.raises(UserError, match=r"c0001 of seed .*; take another --seed"):
        _made(tmp_path, SEED, 1, "c")


@pytest.mark.slow
def test_make_writes_cases_once_and_keeps_answers_apart(tmp_path: Path, in_process: Callable[..., tuple[int, str, str]], refused: Callable[..., str]) -> None:
    code, out, err = in_process("concealed", "make", "--cases", 1, "--seed", SEED, "--out", tmp_path, "--jobs", 1)
    assert code == 0, err
    assert "1 cases made" in out
    given, kept = tmp_path / "given" / "c0000", tmp_path / "kept" / "c0000"
    assert {path.name for path in given.iterdir()} == {"rig.yaml", "robot.urdf", *(f"train_{index:02d}.csv" for index in range(4))}
    assert {path.name for path in kept.iterdir()} == {"label.yaml", "test_00.csv", "test_01.csv"}
    assert yaml.safe_load((kept / "label.yaml").read_text())["effects"][0]["effect"] == "air_drag"
    before = {path.name: path.read_bytes() for path in (*given.iterdir(), *kept.iterdir())}
    assert "0 cases made" in in_process("concealed", "make", "--cases", 1, "--seed", SEED, "--out", tmp_path, "--jobs", 1)[1]
    # As one that was stopped before it was done.
    (kept / "label.yaml").unlink()
    (given / "train_00.csv").write_text("half")
    in_process("concealed", "make", "--cases", 1, "--seed", SEED, "--out", tmp_path, "--jobs", 1)
    assert {path.name: path.read_bytes() for path in (*given.iterdir(), *kept.iterdir())} == before
    assert "seed 40" in refused("concealed", "make", "--seed", 1, "--out", tmp_path)


@pytest.mark.slow
def test_score_counts_what_is_said_against_what_is_hidden(
    folder: Path, tmp_path: Path, in_process: Callable[..., tuple[int, str, str]], refused: Callable[..., str]
) -> None:
    def scored(name: str) -> dict[str, object]:
        out = tmp_path / name
        code, text, err = in_process("concealed", "score", folder, "--diagnoser", f"{__name__}:{name}", "--out", out, "--jobs", 1, "--json")
        assert code == 0, err
        (row,) = json.loads(text)
        assert len(pd.read_parquet(out / "scores.parquet")) == 1
        assert "air_drag:upper" in (out / "index.html").read_text()
        return dict(row)

    right = scored("Right")
    assert (right["right"], right["credit"], right["passed"]) == (True, 0.5, True)
    assert (right["parameter_error"], right["inside"], right["numbers"]) == (0.0, 1, 1)
    assert right["error"] == pytest.approx(right["true"], rel=1e-6)
    assert right["error"] < right["nothing"] / 1.1
    nothing = scored("Nothing")
    assert (nothing["right"], nothing["credit"], nothing["passed"], nothing["found"]) == (False, 0.0, False, "nothing")
    broken = scored("Broken")
    assert (broken["found"], broken["remark"]) == ("failed", "ArithmeticError: no answer")
    assert "no case" in refused("concealed", "score", folder, "--only", "d*")
    assert "package.module:Class" in refused("concealed", "score", folder, "--diagnoser", "nowhere:Never")
    assert "concealed make" in refused("concealed", "score", tmp_path / "empty")


@pytest.mark.parametrize(
    ("named", "error", "as_good"),
    [
        ([("air_drag", "elbow")], 1.5, None),  # it is there
        ([("gravity", "world")], 1.01, True),
        ([("gravity", "world")], 1.5, False),
        ([("gravity", "world"), ("delay", "elbow")], 1.0, False),  # one more than there are
    ],
)
def test_another_answer_may_be_as_good(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: list[tuple[str, str]], error: float, as_good: bool | None
) -> None:
    monkeypatch.setattr("mpge_bench.concealed.score._errors", lambda case, answer: {"error": error, "nothing": 9.0, "true": 1.0})
    hidden = case(tmp_path, {"effect": "air_drag", "target": "elbow", "catalogued": True, "value": {"quadratic": 0.01}})
    said = [Named(effect, target, {"quadratic": (0.01, 0.009, 0.011)}) for effect, target in named]
    (tmp_path / "answer.json").write_text(Answer(True, said).to_json()[:-1] + ', "seconds": 2.0}')
    row = score(hidden, tmp_path)
    assert row["as_good"] is as_good
    told = [text for text, _ in lines([row]) if "predict unseen recordings as well" in text]
    assert len(told) == (as_good is not None)


def case(tmp_path: Path, *effects: dict[str, object]) -> Truth:
    (tmp_path / "kept").mkdir(exist_ok=True)
    (tmp_path / "kept" / "label.yaml").write_text(yaml.safe_dump({"effects": list(effects)}))
    return Truth(tmp_path / "given", tmp_path / "kept")


@pytest.mark.parametrize(
    ("answer", "right", "false_name", "formula"),
    [
        (Answer(True, laws=[("periodic_torque", "elbow")], places=["elbow"]), True, False, True),
        (Answer(True, places=["elbow"]), True, False, False),
        (Answer(True, [Named("joint_spring", "elbow")], places=["elbow"]), False, True, False),
        (Answer(False, places=["elbow"]), False, False, False),
    ],
)
def test_what_the_catalogue_does_not_have_is_to_be_located_and_not_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: Answer, right: bool, false_name: bool, formula: bool
) -> None:
    monkeypatch.setattr("mpge_bench.concealed.score._errors", lambda case, answer: {"error": 1.0, "nothing": 2.0, "true": None})
    hidden = case(tmp_path, {"effect": "cogging", "target": "elbow", "catalogued": False, "value": {"torque": 0.2, "teeth": 8.0}})
    (tmp_path / "answer.json").write_text(answer.to_json()[:-1] + ', "seconds": 2.0}')
    row = score(hidden, tmp_path)
    assert (row["right"], row["false_name"], row["formula"]) == (right, false_name, formula)
    told = dict(lines([row]))
    assert told["outside the catalogue: a false name"] == f"{int(false_name)} of 1 ({100 * false_name}%)"
    assert told["outside the catalogue: the right formula, of those that can be said"] == f"{int(formula)} of 1 ({100 * formula}%)"


@pytest.mark.parametrize(("found", "right"), [("elbow+shoulder", True), ("elbow+wrist", False), ("elbow", False)])
def test_of_a_coupling_both_joints_are_to_be_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: str, right: bool) -> None:
    monkeypatch.setattr("mpge_bench.concealed.score._errors", lambda case, answer: {"error": 1.0, "nothing": 2.0, "true": None})
    hidden = case(tmp_path, {"effect": "coupling_spring", "target": "elbow", "catalogued": False, "value": {"stiffness": 0.2, "other": "shoulder"}})
    answer = Answer(True, laws=[("coupling_spring", found)], places=["elbow"])
    (tmp_path / "answer.json").write_text(answer.to_json()[:-1] + ', "seconds": 2.0}')
    row = score(hidden, tmp_path)
    assert (row["right"], row["false_name"], row["formula"]) == (True, False, right)


def test_our_own_answers_are_read_from_diagnosis_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gain = {"effect": "torque_gain", "target": "elbow", "confidence": 0.5, "parameters": {"gain": {"value": 0.8, "low": 0.7, "high": 0.9}}}
    law = {"effect": "unknown", "law": "periodic_torque", "target": "shoulder", "confidence": 1.0, "parameters": {}}
    data = {"verdict": "partly_explained", "p_value": 1e-9, "complete": True, "effects": [gain, law], "where": [{"kind": "joint", "name": "elbow"}]}
    data |= {"schema": "mpge_bench/diagnosis/1", "detectable": [], "indistinguishable": [["torque_gain:elbow", "mass_scale:lower + gravity:world"]]}
    (tmp_path / "diagnosis.json").write_text(json.dumps(data))
    monkeypatch.chdir(tmp_path)
    found = answer_of(Path())
    assert found.mismatch
    # Whoever goes on with the scores may stand elsewhere.
    assert found.corrected == str(tmp_path.resolve() / "corrected.yaml")
    assert [(one.effect, one.target, one.parameters) for one in found.effects] == [("torque_gain", "elbow", {"gain": (0.8, 0.7, 0.9)})]
    assert found.laws == [("periodic_torque", "shoulder")]
    assert found.equals == [[("mass_scale", "lower"), ("gravity", "world")]]
    assert Answer.from_json(found.to_json()) == found


def test_a_corrected_simulator_that_is_not_there_is_no_uncorrected_one(folder: Path, tmp_path: Path) -> None:
    """Errors of a hundred answers were those of the uncorrected simulator, since their folder was named from another place."""
    with pytest.raises(UserError, match=r"gone/corrected\.yaml"):
        _errors(Truth(folder / "given" / "c0000", folder / "kept" / "c0000"), Answer(True, corrected=str(tmp_path / "gone" / "corrected.yaml")))


@pytest.mark.parametrize(("name", "processes"), [("Ours", 1), ("OnAllCores", cores())])
def test_ours_takes_one_core_a_case_or_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, processes: int) -> None:
    asked: list[int] = []
    monkeypatch.setattr(pipeline, "diagnose_files", lambda *given, jobs, **named: asked.append(jobs))
    monkeypatch.setattr(answer, "answer_of", lambda out: None)
    diagnoser(f"mpge_bench.concealed.answer:{name}")(tmp_path / "rig.yaml", [], tmp_path, 10.0)
    assert asked == [processes]


def test_a_diagnoser_is_a_class_without_arguments() -> None:
    with pytest.raises(UserError, match="takes no arguments"):
        diagnoser("fractions:nothing")
    with pytest.raises(UserError, match="has no cases"):
        cases_of(Path("/nowhere"))
