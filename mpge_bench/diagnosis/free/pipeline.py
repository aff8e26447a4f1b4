"""From recordings of what moves freely or touches something to a verdict: the stages in their order.

motion -> lengths -> windows -> hypotheses -> evidence -> choose -> verdict
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import Measurements
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.free.ending import ended
from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.free.hypotheses import hypotheses
from mpge_bench.diagnosis.free.lengths import Length, longest
from mpge_bench.diagnosis.free.motion import Noise, motion_of, noise_of
from mpge_bench.diagnosis.free.regimes import places
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.free.side_by_side import linearised
from mpge_bench.diagnosis.free.simulator import simulator_of
from mpge_bench.diagnosis.free.verdict import concluded
from mpge_bench.diagnosis.free.windows import Windows, windows_of
from mpge_bench.diagnosis.settings import DiagnosisSettings
from mpge_bench.diagnosis.transitions.choose import Answer
from mpge_bench.diagnosis.transitions.fit import Model, chance_of, model_of, nats_of
from mpge_bench.diagnosis.transitions.trials import plainness_of
from mpge_bench.diagnosis.verdict.result import DiagnosisResult
from mpge_bench.envs.effects import Effect


def diagnose_free(
    rig: Rig, recordings: Sequence[Recording], clock: Clock, workers: Workers, advance: Callable[[int], None], settings: DiagnosisSettings
) -> tuple[DiagnosisResult, tuple[Effect, ...]]:
    """What `rig`, which is no tree on a fixed base in the air, lacks of what was recorded.

    Returns:
        What is said, and the effects that were chosen.

    Raises:
        UserError: if recordings cannot be cut into windows, or the nominal simulation fails.
    """
    parts = parted(Measurements(rig, tuple(recordings), {}, settings))
    simulator = simulator_of(rig, recordings, settings)
    noise = noise_of(parts.searched.recordings, rig.layout, dict(rig.noise), settings.free)
    motions, later = ([motion_of(one, rig.layout, noise, settings.free) for one in some] for some in (parts.searched.recordings, parts.unseen))
    given = simulator, parts.searched.recordings, motions, noise
    options = hypotheses(*given[:3], settings)

    def searching(length: Length, windows: Windows, found: Model | None = None) -> FreeSearch:
        """A search on `windows`, beside what was found."""
        effects = found.effects if found else ()
        own = _for_windows(replace(settings, free=length.settings), windows.entries)
        evidence = Evidence(windows, length.own, own, effects)
        return FreeSearch(windows, options, workers, clock, own.replay, advance, found=found, evidence=evidence)

    def begun(found: Model | None = None) -> tuple[FreeSearch, Windows, Length]:
        """A search beside what was found, windows by which models are chosen, and the length of both."""
        length = longest(*given, settings, workers, clock, found.effects if found else ())
        choosing = _choosing(length.windows, settings)
        return searching(length, length.windows.part(~choosing), found), length.windows.part(choosing), length

    search, others, length = begun()
    test = search.compared()
    if not test.is_mismatch and not clock.late:
        # What shows seldom may show in enough of all: of three windows in which a puck sticks one was kept to choose by.
        whole = searching(length, length.windows)
        test = whole.compared()
        if test.is_mismatch:
            search, others = whole, others.part(others.heads(0))
    if test.is_mismatch:
        search, others = cut_anew(begun, search, others, length, clock)
    answer = search.answer() if test.is_mismatch else search.nothing()
    settings = search.evidence.settings
    if len(others):
        answer = chosen_by(linearised(workers, others, answer.chosen.effects) if search.is_smooth else others, answer, settings)
    if test.is_mismatch and not answer.chosen.hypotheses and not clock.late:
        test = search.agreed()
    where = places(search.evidence.target, motions, answer.nominal.residuals[:, : search.windows.slopes.shape[1]]) if test.is_mismatch else ()
    settled = ended(search, answer.chosen, clock)
    answer, settled = beside_equals(search, answer, settled)
    unseen = windows_of(simulator, parts.unseen, later, noise, settings.free, settings.free.unseen_windows)
    result = concluded(search.replay, unseen, parts.unseen, answer, settled, test, where, _checks(recordings, rig, noise), settings, clock, workers)
    return result, settled.effects if result.effects else ()


def cut_anew(
    begun: Callable[[Model], tuple[FreeSearch, Windows, Length]], search: FreeSearch, others: Windows, length: Length, clock: Clock
) -> tuple[FreeSearch, Windows]:
    """`search` and the windows that models are chosen by, cut anew by `begun` beside what is found first for as long as more is, and there is time for it.

    What is faint shows in long windows alone, and these answer in proportion beside what is large; what sticks on level ground slides on a slope.
    """
    while (length.shortened or not search.is_smooth) and not clock.late:
        before, found = search.found, search.begun()
        if len(found.hypotheses) == (len(before.hypotheses) if before else 0):
            break
        if clock.within(length.settings.looking).lacks(length.least):
            search.found = found
            break
        search, others, length = begun(found)
        if not search.is_smooth:
            break
    return search, others


def _for_windows(settings: DiagnosisSettings, entries: int) -> DiagnosisSettings:
    """`settings` whose search is one over windows of so many `entries`, which are fewer than transitions and take longer."""
    free, names = settings.free, ("screening", "fewest", "checked", "checked_anyway", "tried", "polished", "iterations", "iterations_polish", "walks", "walked")
    own = {name: getattr(free, name) for name in (*names, "difference", "worst", "material", "equal", "faint", "standing_for", "jump")}
    search = replace(settings.replay, block=1, stretch=1, iterations_first=free.iterations, followed=0, room=settings.verdict.explained)
    search = replace(search, most_rows=free.few, drafted=free.few * entries, fitted=free.windows * entries)
    return replace(settings, replay=replace(search, **own), verdict=replace(settings.verdict, interval=free.interval))


def _choosing(windows: Windows, settings: DiagnosisSettings) -> npt.NDArray[np.bool_]:
    """Which windows models are chosen by: those of the last recordings or, of few recordings, the last ones."""
    share, numbers = settings.free.choosing, np.unique(windows.recording)
    if len(numbers) >= settings.data.few:
        return np.isin(windows.recording, numbers[-max(1, round(share * len(numbers))) :])
    return np.asarray(np.arange(len(windows)) >= round((1 - share) * len(windows)))


def chosen_by(windows: Windows, answer: Answer, settings: DiagnosisSettings) -> Answer:
    """`answer` with, of the best models, the one that describes `windows` best, to which none was fitted; its own where that is as good but for chance."""
    if not answer.chosen.hypotheses:
        return answer
    replay, free, every = settings.replay, settings.free, np.arange(len(windows))
    best = sorted(answer.models, key=lambda one: one.description)[: free.judged]
    models = [answer.chosen, answer.nominal, *(one for one in best if one.key not in (answer.chosen.key, answer.nominal.key))]
    judged = [model_of(windows, one.hypotheses, one.values, every, replay) for one in models]
    # Parameters have no price in windows that they were not fitted to.
    told = [float(nats_of(one.residuals, replay).mean()) for one in judged]
    first = int(np.argmin(told))
    least = max(replay.equal, replay.beyond_chance * chance_of(judged[0], judged[first], replay))
    # One window that is missed by far is much chance: where most others go against the answer, too, it is none.
    worse = nats_of(judged[0].residuals, replay).mean(1) > nats_of(judged[first].residuals, replay).mean(1)
    is_chance = told[0] - told[first] < (least if worse.mean() <= free.against else replay.equal)
    return answer if is_chance else replace(answer, chosen=models[first], equals=())


def beside_equals(search: FreeSearch, answer: Answer, settled: Model) -> tuple[Answer, Model]:
    """`answer` with all that describes windows as well as `settled`, its choice fitted to its end; and the plainest of them, which is the choice then.

    Of those of as many parameters what is told from its absence is plainer: a body of .05 to 19 times the mass says nothing that a friction of .453 does not.
    """
    alike = {one.key: one for one in (*answer.equals, *search.twins(settled), settled)}

    def plainness(one: Model) -> tuple[object, ...]:
        size, *rest = plainness_of(one)
        # Of one alone nothing is asked, which takes as long as a step of its fit.
        return size, len(alike) > 1 and not search.is_told(one), *rest

    chosen, *equals = sorted(alike.values(), key=plainness)
    models = {one.key: one for one in (*answer.models, *search.models.values())}
    return replace(answer, chosen=chosen, equals=tuple(equals), models=tuple(models.values()), cut=tuple(search.cut)), chosen


def _checks(recordings: Sequence[Recording], rig: Rig, noise: Noise) -> tuple[str, ...]:
    """What the look at the data said."""
    lines = [f"{len(recordings)} recordings, {sum(one.duration for one in recordings):.0f} s in all.", *rig.certain_line()]
    base = rig.layout.nv - len(rig.joints)
    if base:
        place, turn = (float(noise.q[part].max()) for part in (slice(0, 3), slice(3, 6)))
        lines.append(f"Free base: noise of its place about {place:.2g} m, of its orientation about {turn:.2g} rad.")
    lines += [f"{joint}: noise of q about {noise.q[base + column]:.2g} {rig.units(joint).position}." for column, joint in enumerate(rig.joints)]
    if not np.isfinite(noise.dq).all():
        lines.append("Velocities are reconstructed from positions where they were not recorded, or lag as difference quotients do.")
    return tuple(lines)
