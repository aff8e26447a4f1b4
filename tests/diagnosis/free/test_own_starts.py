"""What decides what becomes of starts is seen about starts of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.free.hypotheses import hypotheses
from mpge_bench.diagnosis.free.own_starts import promising
from mpge_bench.diagnosis.free.pipeline import _for_windows
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import model_of
from mpge_bench.envs.effects import ContactCompliance, Effect

from .conftest import BRICK, NOISE, RIG, UNHURRIED
from .test_twins import searched
from .test_windows import made, measured

SOFT = ContactCompliance("brick", 4000.0, 25.0)


def slid(folder: Path, effects: tuple[Effect, ...]) -> Path:
    """Recordings of a brick that slides over a ground in which, where that is soft, it has sunk as deep as it rests."""
    (folder / "brick.urdf").write_text(BRICK)
    (folder / "rig.yaml").write_text(yaml.safe_dump({**RIG, "ground": {"friction": 0.3, "restitution": 0.0}}))
    rig, rng = read_rig(folder / "rig.yaml"), np.random.default_rng(0)
    world, layout = rig.world(effects, substeps=4), rig.layout
    for run in range(8):
        world.set_state([0, 0, 0.04, 0, 0, 0, 1], np.zeros(6))
        q, _ = world.roll(np.zeros((60, 0)))
        world.set_state(q[-1], [rng.choice([-1, 1]) * rng.uniform(0.8, 1.2), 0, 0, 0, 0, 0])
        q, dq = world.roll(np.zeros((40, 0)))
        state = layout.plus(layout.state(q, dq), np.concatenate((NOISE * rng.standard_normal((40, 6)), np.zeros((40, 6))), 1))
        values = np.column_stack((0.008 * np.arange(40), layout.q(state)))
        pd.DataFrame(values, columns=["time", *rig.columns["q"]]).to_csv(folder / f"run_{run}.csv", index=False)
    return folder


def in_short_windows(folder: Path) -> FreeSearch:
    windows = made(folder).linearised()
    settings = _for_windows(DEFAULT, windows.entries)
    options = [one for one in hypotheses(*measured(folder)[:3], DEFAULT) if one.kind.moves_starts]
    evidence = Evidence(windows, windows.imagined(0).linearised(), settings)
    return FreeSearch(windows, options, Workers(1), UNHURRIED, settings.replay, evidence=evidence)


def test_a_soft_ground_promises_little_from_the_starts_of_a_hard_one_and_much_from_its_own(tmp_path: Path) -> None:
    """Of a sled on a soft slope a tilted gravity was found, and a tilted ground stood in for the soft one."""
    search = in_short_windows(slid(tmp_path, (SOFT,)))
    (soft,) = search.hypotheses
    nothing = model_of(search.replay, (), (), search.every, search.settings)
    from_others = model_of(search.replay, (soft,), ((SOFT.stiffness, SOFT.damping),), search.every, search.settings)
    found = promising(search, search.windows, nothing)
    assert found is not None
    assert [one.label for one in found.hypotheses] == ["contact_compliance:brick"]
    assert nothing.description - found.description > 4 * (nothing.description - from_others.description)


def test_a_hard_ground_is_not_soft(tmp_path: Path) -> None:
    search = in_short_windows(slid(tmp_path, ()))
    assert promising(search, search.windows, model_of(search.replay, (), (), search.every, search.settings)) is None


@pytest.mark.slow
def test_it_is_fitted_to_its_end_beside_what_other_looks_found(tmp_path: Path) -> None:
    search = searched(slid(tmp_path, (SOFT,)), ("contact_compliance", "contact_friction", "ground_height"))
    assert search.is_smooth
    found = search.taken_in(search.first())
    assert [one.label for one in found.hypotheses] == ["contact_compliance:brick"]
    assert found.values[0][0] == pytest.approx(SOFT.stiffness, rel=0.1)
