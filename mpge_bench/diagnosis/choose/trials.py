"""The models fitted so far, and the means to fit more: the notebook that the parts of this stage share, and nobody else sees."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.exported import best_exported, exported_error, noise_floors, validation_recordings
from mpge_bench.diagnosis.choose.score import gain, idle, is_better, is_doubtless, is_sharper
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.fit.linear import Fit, LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.regressed import smoothed
from mpge_bench.diagnosis.fit.simulator import as_it_is, drafted, polished, unforgiven
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, candidates, key, label
from mpge_bench.diagnosis.settings import ChooseSettings
from mpge_bench.envs.compiled import is_past
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of

_log = logging.getLogger(__name__)


class Trials:
    """Of one search.

    Attributes:
        problem: with the noise as it is estimated now, and the windows that models are chosen by now.
        nominal, fitter: the model of no effects under that noise, and its fitter.
        models: fitted in the simulator so far.
        cut: stages that the time budget cut short, in their order.
    """

    def __init__(
        self,
        problem: Problem,
        candidates: Sequence[Candidate],
        nominal: tuple[Model, LinearFitter],
        workers: Workers,
        clock: Clock,
        advance: Callable[[int], None] = lambda steps: None,
    ) -> None:
        self.candidates, self.workers, self.clock = tuple(candidates), workers, clock
        self._advance = advance
        self.cut: dict[str, None] = {}
        self.begin(problem, nominal)

    def begin(self, problem: Problem, nominal: tuple[Model, LinearFitter]) -> None:
        """Forget all models: they were judged by another noise, or on other windows."""
        self.problem = problem
        self._exported = exported_error(problem, validation_recordings(problem))
        self._used = exported_error(problem, problem.recordings)
        self.nominal, self.fitter = nominal
        layout, predictor = problem.linear.motion.layout, self.fitter.predictor
        floors = noise_floors(problem, predictor, problem.linear.motion.spread)
        # No right model does better than its physics step.
        stepped = np.mean(predictor.halved_error[problem.choosing] ** 2, (0, 1))
        self._floor = float(np.sqrt(np.mean(layout.dx(floors) ** 2 + layout.dx(stepped))))
        #: What starting states leave of what half the step changes, as a sum of squares in standard deviations of the noise.
        self._stepped = float(np.sum(predictor.project(predictor.halved_error) ** 2))
        self.models: list[Model] = [self.nominal]
        self._anew: set[frozenset[str]] = set()

    @property
    def settings(self) -> ChooseSettings:
        return self.problem.settings.choose

    @cached_property
    def formulas(self) -> tuple[Candidate, ...]:
        """Laws that are said as formulas."""
        return tuple(candidates(self.problem.rig, self.problem.scales, formulas=True))

    def is_clean(self, model: Model) -> bool:
        """Whether `model` leaves nothing to be explained, neither of what it was fitted to nor of what chooses."""
        clean = self.problem.settings.fit.clean
        return model.train < clean and model.validation < clean

    def explains(self, model: Model) -> bool:
        """Whether what `model` leaves would be called explained, both of what it was fitted to and of what chooses."""
        return max(model.train, model.validation) < self.problem.settings.verdict.explained

    def cut_short(self, stage: str, seconds: float = 0.0) -> bool:
        """Whether there is no time left for something more of `stage`, which takes so many `seconds` and is then noted as cut short."""
        late = is_past(self.clock.deadline - seconds)
        if late:
            self.cut[stage] = None
        return late

    def another(self, effects: Sequence[Effect], begun: float) -> float:
        """Seconds that another round beside `effects` takes: of all joints as long as the one that `begun`, s of the monotonic clock; else no matter."""
        return 0.0 if self.settings.are_few(effects) else time.monotonic() - begun

    @contextmanager
    def growing(self) -> Iterator[None]:
        """While effects are added, which is to leave time to leave out again what others have made needless."""
        whole = self.clock
        self.clock = whole.sooner(self.settings.pruning)
        try:
            yield
        finally:
            self.clock = whole

    def fitted(self, model: Model) -> Model:
        """Count `model` as fitted."""
        values = [[float(f"{value:.4g}") for value in parameters_of(effect)] for effect in model.effects]
        _log.debug("%s %s: %.4g %.4g (%d)", label(model.effects), values, model.train, model.validation, model.parameters)
        self._advance(1)
        return model

    def add(self, model: Model) -> Model:
        """Count `model` as fitted and note it as one that may be chosen."""
        self.models.append(self.fitted(model))
        return model

    def as_it_is(self, effects: Sequence[Effect]) -> Model | None:
        """The model of `effects` with the parameters that they have, noted as one that may be chosen; None where the linearised simulator flies apart."""
        found = as_it_is(self.problem, effects)
        return None if found is None else self.add(found)

    def levels(self, models: Sequence[Model]) -> list[float]:
        """How much each of `models` misses, times what noise and physics step make, as mean squares, by which they are chosen.

        Of validation windows, from the best starting states; or, where even the best of them is far from what the noise makes, of all recordings as it would
        be exported, from recorded states: what starting states can hide of so large errors, those of motors that nobody records above all, is missed all
        the same, and one recording is too few to tell which of two wrong models is nearer.
        """
        if not self.are_far(models):
            return [one.validation for one in models]
        return [(self._used(one.effects) / self._floor) ** 2 for one in models]

    def nearest(self, models: Sequence[Model]) -> list[Model]:
        """Of `models` those that miss next to nothing more than the one that misses least.

        Of windows by the room of whichever of the two leaves itself more.
        """
        levels = self.levels(models)
        first, within = models[int(np.argmin(levels))], self.settings.material
        if self.are_far(models):
            return [one for one, level in zip(models, levels, strict=True) if level <= (1 + within) * min(levels)]
        return [one for one in models if one.misses_no_more(first, self.problem.choosing, within)]

    def are_far(self, models: Sequence[Model]) -> bool:
        """Whether even the best of `models` is far from what noise and physics step make: of what models are chosen by, in windows and as exported."""
        if min((one.validation for one in models), default=0.0) < self.settings.coarse:
            return False
        return min(self._exported(one.effects) for one in models) > self.settings.far * self._floor

    def is_better(self, simple: Model, rich: Model, *, materially: bool = False) -> bool:
        """Whether `rich` predicts better than `simple`, as `score.is_better` has it or, where both are far from the noise, as they would be exported.

        Args:
            materially: of validation windows by as much as is asked far from the noise, wherever it is.
        """
        least = self.settings.coarse_material
        if self.are_far([simple, rich]):
            before, after = (self._used(one.effects) ** 2 for one in (simple, rich))
            return after < (1 - least) * before
        if self._is_sharper(rich, simple):
            return False
        if self._is_sharper(simple, rich):
            return True
        if self._explained(simple, rich) < self.settings.step_told * self._stepped:
            return False
        if not is_better(self.problem, simple, rich) or (materially and gain(simple, rich, self.problem.validation)[0] < least):
            return False
        # A small gain from the best starting states is none if more is lost from those that are recorded; and none is that, where noise does not make the loss.
        if self.no_worse(rich, simple, within=least):
            return True
        # What alone explains all is better though more is lost where it starts from recorded states: those of a motor's side nobody records.
        new = (effect for effect in rich.effects if not key([effect]) <= simple.key)
        if self.explains(rich) and (not self.explains(simple) or any(effect.swings for effect in new)) and is_doubtless(self.problem, simple, rich):
            return True
        return not self.loses(rich, simple) and gain(simple, rich, np.ones_like(self.problem.validation))[0] >= least

    def is_likelier(self, one: Model, other: Model) -> bool:
        """Whether all windows together say beyond chance that `one` predicts better than `other`, if by however little; of none far from the noise."""
        share, error = gain(other, one, np.ones_like(self.problem.validation))
        # Of two that are the same physics one may be nearer in every window, by rounding.
        told = self._explained(other, one) > self.settings.errors**2
        return told and share > self.settings.errors * error and not self.are_far([one, other])

    def _is_sharper(self, simple: Model, rich: Model) -> bool:
        return self.explains(rich) and is_sharper(self.problem, simple, rich)

    def _explained(self, simple: Model, rich: Model) -> float:
        """What `rich` explains beyond `simple`: a sum of squares in standard deviations of the noise."""
        entries = self.fitter.predictor.halved_error[0].size
        return float(entries * np.sum(simple.missed_beside(rich) - rich.missed_beside(simple)))

    def no_worse(self, rich: Model, simple: Model, *, within: float = 0.0) -> bool:
        """Whether `rich`, as it would be exported, predicts what models are chosen by no worse than `simple`, but for a share `within` of the error."""
        return self._exported(rich.effects) <= (1 + within) * self._exported(simple.effects)

    def stands(self, model: Model) -> bool:
        """Whether the simulator can be linearised about `model`: where it flies apart, as about friction of 27 N m, nothing more can be asked."""
        try:
            self.problem.fitter(model.effects)
        except np.linalg.LinAlgError:
            return False
        return True

    def is_of_use(self, model: Model) -> bool:
        """Whether `model`, as it would be exported, predicts what models are chosen by no worse than the simulator without it.

        Where windows leave no doubt of it not by a tenth, and no recordings worse on the whole: the noise of recorded states may be most of what is missed.
        """
        if self.no_worse(model, self.nominal):
            return True
        noisy = self.no_worse(model, self.nominal, within=self.settings.coarse_material) and self._used(model.effects) <= self._used(self.nominal.effects)
        return noisy and is_doubtless(self.problem, self.nominal, model)

    def loses(self, rich: Model, simple: Model) -> bool:
        """Whether `rich`, as it would be exported, misses a tenth more than `simple` of what models are chosen by, and by more than noise and step make."""
        more, less = (self._exported(one.effects) ** 2 for one in (rich, simple))
        return not self.no_worse(rich, simple, within=self.settings.coarse_material) and more - less > self._floor**2

    def once_more(self, effects: Sequence[Effect], stage: str) -> Model | None:
        """`effects` fitted to the end from where they are, though they were before from elsewhere; None where that was done, or there is no time for it."""
        if key(effects) in self._anew or self.cut_short(stage):
            return None
        self._anew.add(key(effects))
        return self.to_the_end(effects)

    def known(self) -> dict[frozenset[str], Model]:
        """The last model of each set of effects."""
        return {one.key: one for one in self.models}

    def each(self, work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any]) -> list[Any]:
        """`work(problem, *shared, item)` for each of `items`, side by side; only for the first ones where time is up."""
        return self.side_by_side("fitting candidates", work, (self.problem, *shared), items)

    def side_by_side(self, stage: str, work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any]) -> list[Any]:
        """`work(*shared, item)` for each of `items`; only for the first ones, and `stage` noted as cut short, where time is up."""
        found = self.workers.each(work, shared, items, self.clock.deadline)
        if len(found) < len(items):
            self.cut[stage] = None
        return found

    def polished(self, sets: Sequence[Sequence[Effect]]) -> list[tuple[Model, LinearFitter]]:
        """Each set of effects fitted to the end."""
        return self.each(smoothed, (), sets)

    def grown(self, fitter: LinearFitter, steps: Sequence[tuple[Sequence[Effect], Candidate]]) -> list[Fit]:
        """Of each step its effects and a candidate beside them, fitted in the linearised simulator."""
        return self.each(_grown, (fitter,), steps)

    def step(self, effects: Sequence[Effect], candidate: Candidate) -> tuple[list[Effect], Candidate]:
        """As `Candidate.in_place` has it."""
        return candidate.in_place(effects, self.problem.scale(candidate.target))

    def drafted(self, fitter: LinearFitter, fits: Sequence[Fit], most: int, old: Sequence[Effect] = ()) -> list[Model]:
        """Those `fits` of the linearised simulator without idle effects that come nearest, `most` of them, refined a little in the simulator.

        Args:
            old: what may be idle, now that others have come.
        """
        useful = [one for one in fits if key(idle(self.problem, fitter, one.effects)) <= key(old)]
        useful.sort(key=lambda one: fitter.chi_square(one.cost, slice(None)))
        return self.refined(fitter, useful[:most])

    def refined(self, fitter: LinearFitter, fits: Sequence[Fit]) -> list[Model]:
        """`fits` refined a little in the simulator."""
        return [self.fitted(draft) for draft in self.each(drafted, (fitter,), fits)]

    def as_exported(self, model: Model) -> Model:
        """`model` or, where that predicts better in the simulator as it is exported, without nuisances, with parameters that make up for these.

        Far from the noise, where models are judged by all recordings as they are exported, with those that predict these best.
        """
        if self._can_be_as_used(model):
            return self._as_used(model)
        effects = unforgiven(self.problem, model)
        if not self._exported(effects) < (1 - self.settings.material) * self._exported(model.effects):
            return model
        return self.add(replace(model, fit=replace(model.fit, effects=effects)))

    def _can_be_as_used(self, model: Model) -> bool:
        """Whether `model` is judged as it is used; one of all joints was fitted so if that helped, and a nameless curve has no parameters to be sought.

        Others take a second or two, for which there is time beyond the search's.
        """
        few = model.fit.size > 0 and self.settings.are_few(model.effects) and all(effect.named for effect in model.effects)
        return few and math.isfinite(self._used(model.effects)) and self.are_far([model])

    def _as_used(self, model: Model) -> Model:
        """`model` with the parameters with which it predicts all recordings searched on best as it is exported."""
        effects = best_exported(self.problem, self.problem.recordings, model.effects, self.workers.each)
        # As much as is asked of models there (`is_better`).
        if not self._used(effects) ** 2 < (1 - self.settings.coarse_material) * self._used(model.effects) ** 2:
            return model
        return self.as_it_is(effects) or model

    def again(self, model: Model, fitter: LinearFitter, evaluations: int) -> tuple[tuple[Model, LinearFitter], float]:
        """`model` fitted anew about its own fit or, where that gains nothing, as it is, with its fitter; and the gain."""
        train = ~self.problem.validation
        anew = polished(self.problem, model.effects, evaluations=evaluations)
        # Each leaves itself as much room as its own physics step asks for.
        gained = model.level_beside(anew[0], train) - anew[0].level_beside(model, train)
        return (anew if gained > 0 else (model, fitter)), gained

    def to_the_end(self, effects: Sequence[Effect]) -> Model:
        """`effects` fitted until that no longer helps."""
        ((model, fitter),) = self.polished([effects])
        return self.converged(model, fitter)[0]

    def converged(self, model: Model, fitter: LinearFitter) -> tuple[Model, LinearFitter]:
        """`model` fitted anew about its own fit until that no longer helps."""
        settings = self.settings
        evaluations = self.problem.settings.fit.evaluations_polish
        # One far from the noise is but a step on the way, unless it hides how near it could come.
        on_the_way = model.train > settings.on_the_way and not any(effect.remembers for effect in model.effects)
        for _ in range(0 if on_the_way else settings.convergences):
            if self.cut_short("fitting to the end"):
                break
            if model.train < settings.near:
                evaluations = 1
            (model, fitter), gained = self.again(model, fitter, evaluations)
            if gained < settings.converged * model.train:
                if evaluations == 1:
                    break
                evaluations = 1
        return model, fitter


def _grown(problem: Problem, fitter: LinearFitter, step: tuple[Sequence[Effect], Candidate]) -> Fit:
    return fitter.grow(*step)
