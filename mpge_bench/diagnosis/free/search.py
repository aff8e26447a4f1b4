"""The search for what windows lack: as for transitions, but that it knows the noise, and that derivatives tell in long windows."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.free.own_starts import promising
from mpge_bench.diagnosis.free.proportion import nearer
from mpge_bench.diagnosis.free.side_by_side import relinearised, restarted
from mpge_bench.diagnosis.free.twins import rivals
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.transitions.choose import Search
from mpge_bench.diagnosis.transitions.evidence import Comparison
from mpge_bench.diagnosis.transitions.fit import Model, Parameters, Predictor, Rows, model_of, slopes_of, standard_errors
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.screen import Refit, refit_of
from mpge_bench.diagnosis.transitions.trials import ENDING, plainness_of
from mpge_bench.envs.effects import Delay

Array = npt.NDArray[np.float64]
_log = logging.getLogger(__name__)


@dataclass
class FreeSearch(Search):
    """One that ends where what is left is the noise."""

    evidence: Evidence = field(kw_only=True)
    #: That windows are linearised about.
    last: Model | None = None
    #: Models with other hypotheses in the place of one of a model's, by the values of that model's.
    beside: dict[tuple[object, ...], tuple[Model, ...]] = field(default_factory=dict)
    #: Models beside which one more hypothesis was sought, or none is missing.
    looked_beside: set[object] = field(default_factory=set)
    #: Models with what decides what becomes of starts, by those beside which that was looked at.
    with_starts: dict[tuple[object, ...], Model | None] = field(default_factory=dict)
    #: What the model misses beside which columns are known, of the rows `glance`, with long steps.
    left_beside: Array | None = None

    def compared(self) -> Comparison:
        """Whether there is anything to search for; where it is not plain to see, what all hypotheses change of many windows is looked at."""
        nominal = model_of(self.replay, (), (), self.every, self.settings)
        test = self.evidence.compared(nominal.residuals, (), self.glance)
        if test.is_mismatch:
            return test
        self.know_all(nominal)
        return self.evidence.compared(nominal.residuals, self.columns.values(), self.glance)

    def agreed(self) -> Comparison:
        """Whether there is anything where no effect was found: windows that miss much have to agree on one."""
        nominal = model_of(self.replay, (), (), self.every, self.settings)
        self.forget()
        self.know_all(nominal)
        return self.evidence.compared(nominal.residuals, self.columns.values(), self.glance, agreed=True)

    def know_all(self, model: Model) -> None:
        """What all hypotheses change beside `model`, of as many windows as a test of what is left takes."""
        free, starts = self.evidence.settings.free, sum(len(one.starts) for one in self.hypotheses)
        self.glance = self.replay.heads(max(len(self.glance), round(free.tested / free.window / starts)))
        self.know(self.replay, model, [one for one in self.hypotheses if one.key not in model.key])

    def drafted(self, model: Model) -> Predictor:
        """See `Search`; with long steps."""
        return self.windows.quicker(model.effects)

    def know(self, replay: Predictor, model: Model, hypotheses: Sequence[Hypothesis]) -> None:
        """See `Search`; with long steps."""
        coarse = replay.coarser()
        model = model_of(coarse, model.hypotheses, model.values, self.glance, self.settings)
        self.left_beside = model.residuals
        super().know(coarse, model, self.in_proportion(coarse, model, hypotheses) if self.is_smooth else hypotheses)

    def checked_anyway(self, model: Model) -> int:
        """See `Search`; all that there is time for beside what misses so much that nothing is in proportion, and first looks tell next to nothing."""
        is_far = _usual(model) > self.evidence.settings.free.far
        return self.settings.checked if is_far else super().checked_anyway(model)

    def in_proportion(self, replay: Predictor, model: Model, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """`hypotheses` with starts that change windows by about as much as `model`, whose residuals are those of `glance`, misses: by more nothing tells."""
        free = self.evidence.settings.free
        few = np.unique(np.linspace(0, len(self.glance) - 1, free.shown).round().astype(int))
        most = max(free.near, _usual(model))
        seen = replace(model, residuals=model.residuals[few])
        found: list[Hypothesis] = self.each(nearer, (replay, seen, self.glance[few], most), hypotheses)  # type: ignore[assignment]
        near = {one.key: one for one in found}
        return [near.get(one.key, one) for one in hypotheses]

    def is_more(self, one: Hypothesis, model: Model) -> bool:
        """See `Search`; what acts on several alike is no more than what acts on each, of which one was found."""
        return not any(one.kind is other.kind and set(one.targets) & set(other.targets) for other in model.hypotheses)

    @property
    def ahead(self) -> int:
        """See `Search`; what starts take up for the most part lags behind in drafts."""
        return self.settings.polished if self.is_smooth else super().ahead

    def refit(self, replay: Predictor, model: Model, rows: Rows) -> Refit:
        """See `Search`; where windows are smooth all that is changed is in proportion."""
        if not self.is_smooth:
            return super().refit(replay, model, rows)
        return refit_of(model, self.taken(replay, model, rows), self.settings)

    def taken(self, replay: Predictor, model: Model, rows: Rows) -> Array:
        """What is no news beside `model`, whose residuals are those of `rows`: by what its parameters change the predictions, and when within a physics step a
        motor with a hidden state gets its command, in which simulators differ; shape (changes, rows, entries)."""
        if not model.hypotheses:
            return np.zeros((0, *model.residuals.shape))
        slopes, simulator = slopes_of(replay, model, model.residuals, rows, self.settings), self.windows.simulator
        late = sorted({one.target for one in model.effects if one.remembers and one.target in simulator.rig.driven})
        if not late:
            return slopes
        # With the steps of what is missed: longer ones hold a command for longer.
        here = self.windows.residuals(model.effects, rows)
        later = [here - self.windows.residuals(simulator.rig.joined(model.effects, Delay(joint, simulator.step)), rows) for joint in late]
        return np.concatenate((slopes, later))

    @property
    def windows(self) -> Windows:
        """What models are fitted to, linearised about the last one that was taken in."""
        assert isinstance(self.replay, Windows)
        return self.replay

    @property
    def is_smooth(self) -> bool:
        """Whether windows are long ones, in which looks tell, and derivatives."""
        return self.evidence.settings.free.pinned == self.evidence.settings.smooth.pinned

    def taken_in(self, model: Model) -> Model:
        """See `Search`; what is taken in is fitted again about what starts change beside it: beside the rig, whose ground may be level, that is something else.

        All models are judged by that from then on: those that were not as good are forgotten.
        """
        self.looked_beside.add(model.key)
        richer = super().taken_in(model)
        if not self.is_smooth:
            # What is not fitted to its end looks as if more were missing.
            return richer if richer is model else self.add(self.settled(richer))
        other = self.about_own_starts(model)
        if richer is model and other is None:
            return model
        rivals = [one for one in self.models.values() if one.hypotheses and one.key != richer.key and self.is_equal(one, richer)]
        found = self._judged_anew(self._likelier(self.settled(richer), other))
        before = self.add(model_of(self.replay, model.hypotheses, model.values, self.rows, self.settings))
        if not self.is_better(found, before):
            return before
        for one in rivals if found.key == richer.key else ():
            if not self.late("fitting hypotheses"):
                self.add(self.fitted(one.hypotheses, one.values))
        # What is left is told by what effects change beside this: what rests on level ground does not show how soft that is as what slides does.
        self.forget()
        return found

    def about_own_starts(self, model: Model) -> Model | None:
        """See `promising`."""
        if _named(model) not in self.with_starts:
            self.with_starts[_named(model)] = promising(self, self.windows, model)
        return self.with_starts[_named(model)]

    def _likelier(self, model: Model, other: Model | None) -> Model:
        """`model`, which is settled, or `other` where that describes better once it is, each about its own starts."""
        if other is None:
            return model
        found, wins = self._tried(other, model, self.is_better)
        return found if wins else model

    def _tried(self, other: Model, model: Model, wins: Callable[[Model, Model], bool]) -> tuple[Model, bool]:
        """`other`, about its own starts, and whether it wins there over `model`; if not, windows are as they were before."""
        windows, last = self.replay, self.last
        found = self.settled(other)
        won = wins(found, model)
        if not won:
            self.replay, self.last = windows, last
        return found, won

    def _judged_anew(self, found: Model) -> Model:
        """`found`, by which all models are judged from now on."""
        self.models.clear()
        self.add(model_of(self.replay, (), (), self.rows, self.settings))
        return self.add(found)

    def first(self) -> Model:
        """See `Search`; what was found in other windows is settled in these: beside what is off by a little in long windows all that pulls looks lacking."""
        first = super().first()
        if not first.hypotheses or first is self.last:
            return first
        return self._judged_anew(self.settled(first)) if self.is_smooth else self.add(self.settled(first))

    def begun(self) -> Model:
        """What is found first, as drafted: the windows that come next are linearised about it."""
        return super().taken_in(super().first())

    def explained(self) -> Model:
        """See `Search`; where another hypothesis takes the place of one or several, more may be missing beside that than was beside these."""
        model = super().explained()
        seen: set[object] = set()
        while self.is_smooth and model.hypotheses and model.key not in seen and not self.late("telling twins apart"):
            seen.add(model.key)
            model = self.contested(self.further(model))
        return model

    def further(self, model: Model) -> Model:
        """`model` and what more is needed beside it, where nobody has looked yet."""
        while model.key not in self.looked_beside and len(model.hypotheses) < self.settings.most and not self.late("looking for effects"):
            model = self.settled(model)
            if not self.is_known(model):
                self.forget()
            if not self.is_lacking(model, self.settings.exact_share):
                break
            model = self.taken_in(model)
        return model

    def is_known(self, model: Model) -> bool:
        """Whether the model beside which columns are known predicts what `model` does: beside what moves otherwise effects change something else."""
        if self.left_beside is None or len(self.left_beside) != len(self.glance):
            return False
        left = self.replay.coarser().residuals(model.effects, self.glance)
        return float(np.sqrt(((left - self.left_beside) ** 2).mean())) < self.evidence.settings.free.telling

    def lesser(self, model: Model, less: Model) -> Model:
        """See `Search`; what is a little worse without one is so because windows are linearised about all of it: it is judged about its own starts."""
        if not self.is_smooth:
            return super().lesser(model, less)
        if less.description > model.description + self.evidence.settings.free.doubted:
            return model
        found, wins = self._tried(less, model, lambda found, model: not self.is_better(model, found))
        return self._judged_anew(found) if wins else model

    def contested(self, model: Model) -> Model:
        """`model` or, once windows are linearised about it, a rival of no more parameters that describes them better, or as well and is plainer."""
        free, model = self.evidence.settings.free, self.settled(model)
        near = [one for one in self.rivals(model) if one.is_plausible and one.size <= model.size and one.description < model.description + free.contest]
        # Those that are as good already first.
        for one in sorted(near, key=lambda one: (not self.is_equal(one, model), plainness_of(one)))[: free.contested]:
            if self.late("telling twins apart"):
                break
            found, wins = self._tried(one, model, self._is_preferred)
            if wins:
                return self._judged_anew(found)
            # By what it comes to about its own starts it is no more an equal, or is one.
            self.models[one.key] = found
            self.beside[_named(model)] = tuple(found if other is one else other for other in self.rivals(model))
        return model

    def _is_preferred(self, one: Model, other: Model) -> bool:
        """Whether `one` describes better than `other`, or as well and is plainer."""
        return self.is_better(one, other) or (self.is_equal(one, other) and plainness_of(one) < plainness_of(other))

    def rivals(self, model: Model) -> tuple[Model, ...]:
        """See `rivals`."""
        if _named(model) not in self.beside:
            self.beside[_named(model)] = rivals(self, model)
        return self.beside[_named(model)]

    def twins(self, model: Model) -> tuple[Model, ...]:
        """The rivals of `model` that are as good, the plainest first."""
        return tuple(sorted((one for one in self.rivals(model) if self.is_equal(one, model)), key=plainness_of))

    def is_told(self, model: Model) -> bool:
        """Whether none of its hypotheses may be absent by its parameters' intervals."""
        halves = iter(self.evidence.settings.verdict.interval * standard_errors(self.replay, model, self.rows, self.settings))
        for one, values in zip(model.hypotheses, model.values, strict=True):
            own = np.array([next(halves) for _ in values])
            if one.absent is not None and (np.abs(np.array(values) - one.absent) <= own).all():
                return False
        return True

    def settled(self, model: Model) -> Model:
        """`model` fitted again about what starts change beside it, for as long as that moves parameters by more than chance: beside another it is off.

        In windows with contacts, from starts that stay, for as long as that gains.
        """
        free = self.evidence.settings.free
        if not model.hypotheses or model is self.last:
            return model
        if not self.is_smooth:
            self.last = self.converged(model.hypotheses, model.values)
            return self.last
        idle = 0
        for turn in range(free.settled):
            if self.late(ENDING):
                break
            # After two turns it moves by little, and derivatives are what they are.
            if turn < free.relinearised:
                self.replay = relinearised(self.workers, self.windows, model.effects, anew=turn == 0)
            else:
                self.replay = restarted(self.workers, self.windows, model.effects)
            found = self.fitted(model.hypotheses, model.values)
            moved = np.abs(Parameters.vector(found.values) - Parameters.vector(model.values))
            gained, model = model.description - found.description, found
            _log.debug("settled %s: %.4g, %.3g", model.values, model.description, model.missed)
            # What starts take up bit by bit is not missed by the model, though it looks so.
            idle = idle + 1 if gained < self.settings.equal else 0
            is_still = gained < self.settings.material and (moved <= free.still * standard_errors(self.replay, model, self.rows, self.settings)).all()
            if is_still or idle == free.idle:
                break
        self.last = model
        return model

    def turns(self) -> list[list[Hypothesis]]:
        """See `Search`; all at once where windows are smooth, and looks tell: what is drafted without reason takes longer than looks."""
        return [list(self.hypotheses)] if self.is_smooth else super().turns()

    def is_lacking(self, model: Model, share: float) -> bool:
        """See `Trials`."""
        missed = self.replay.residuals(model.effects, self.every)

        def is_told() -> bool:
            seen = replace(model, residuals=missed[self.glance])
            fitted = self.taken(self.replay, seen, self.glance) if model.hypotheses and self.columns else None
            return self.evidence.chance(missed, self.columns.values(), self.glance, fitted)[0] < self.settings.leftover

        lacks = is_told()
        # What is faint is told along what effects change.
        if not lacks and not self.columns and not self.late("looking for effects"):
            self.know_all(model)
            lacks = is_told()
        if not lacks and self.is_smooth and self.last is not None and _named(model) == _named(self.last):
            lacks = self.about_own_starts(model) is not None
        if not lacks:
            self.looked_beside.add(model.key)
        return lacks


def _usual(model: Model) -> float:
    """What `model` misses of a window, root mean square, at the median."""
    return float(np.median(np.sqrt((model.residuals**2).mean(1))))


def _named(model: Model) -> tuple[object, ...]:
    return model.key, model.values
