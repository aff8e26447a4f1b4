"""The models that have been fitted to transitions, on which rows, and how they compare."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.plainest import Plainness, plainness
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.evidence import likeness, repeats
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, Rows, chance_of, fitted, scales_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]
_log = logging.getLogger(__name__)
#: What is said to be cut short where an answer is not at its end, so that its intervals are too short.
ENDING = "fitting the answer to its end"
#: More than any robot has links.
_EVERYTHING = 1000


@dataclass
class Trials:
    """What a search fits with, and what it has fitted so far."""

    replay: Predictor
    hypotheses: Sequence[Hypothesis]
    workers: Workers
    clock: Clock
    settings: ReplaySettings
    advance: Callable[[int], None] = lambda steps: None
    #: The source's own transitions, which tell with noise where nothing is left to be explained.
    own: Predictor | None = None
    models: dict[frozenset[tuple[str, tuple[str, ...]]], Model] = field(default_factory=dict)
    cut: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.every = np.arange(len(self.replay))
        #: For models in the end: from the beginnings of episodes, where what the simulator remembers is known.
        self.rows = self.replay.heads((self.settings.fitted if self.noise is None else self.settings.fitted_noisy) // self.replay.entries)

    @cached_property
    def noise(self) -> Array | None:
        """What the source misses of its own transitions, shape (n, entries); None where that is rounding."""
        missed = None if self.own is None else self.own.residuals((), np.arange(len(self.own)))
        return None if missed is None or repeats(missed, self.settings) else missed

    def spread(self, total: int, worst: Rows | None) -> Rows:
        """About `total` rows in stretches evenly spread; half of them the `worst` ones, where these are known."""
        pieces, length = self.replay, self.settings.stretch
        if worst is None or total >= len(pieces):
            return pieces.stretches(total, length)
        return np.union1d(pieces.stretches(total // 2, length), worst[: max(1, total // 2 // length), None] + np.arange(length))

    def worst(self, effects: Sequence[Effect]) -> Rows | None:
        """Beginnings of stretches with noise, those of which `effects` leave most first: what acts seldom shows there alone. None without noise."""
        if self.noise is None:
            return None
        missed, length = self.replay.residuals(effects, self.every), self.settings.stretch
        size = np.log1p((missed / scales_of(self.noise, self.settings)) ** 2).mean(1)
        begins = np.arange(0, len(self.replay) - length + 1, length)
        return np.asarray(begins[np.argsort(-np.add.reduceat(size, begins))])

    def is_lacking(self, model: Model, share: float) -> bool:
        """Whether `model` leaves more than the right one would: than the source does of its own or, without noise, rounding in this share of the entries.

        It is asked of whole episodes, since stretches begin with contacts that nobody remembers.
        """
        missed, settings = self.replay.residuals(model.effects, self.every), self.settings
        if self.own is None or self.noise is None:
            return float(np.quantile(np.abs(missed), share)) >= settings.exact
        return likeness(self.replay, missed, self.own, self.noise, settings)[0] < settings.leftover

    def is_better(self, richer: Model | None, model: Model) -> bool:
        """Whether `richer` describes better, with parameters that mean something."""
        return richer is not None and richer.is_plausible and richer.description < model.description - max(self.settings.material, self.chance(richer, model))

    def is_equal(self, one: Model, other: Model) -> bool:
        """Whether `one` describes as well as `other`, with parameters that mean something."""
        return one.is_plausible and one.description < other.description + max(self.settings.equal, self.chance(one, other))

    def chance(self, one: Model, other: Model) -> float:
        """By how much noise alone may make one of them the better."""
        return self.settings.beyond_chance * chance_of(one, other, self.settings) if self.noise is not None else 0.0

    def late(self, stage: str) -> bool:
        if self.clock.late:
            self.cut[stage] = None
        return self.clock.late

    def add(self, model: Model) -> Model:
        _log.debug("%s %s: %.4g, %.3g", [one.label for one in model.hypotheses], model.values, model.description, model.missed)
        known = self.models.get(model.key)
        if known is None or model.description < known.description:
            self.models[model.key] = model
        return self.models[model.key]

    def each(self, work: Callable[..., object], shared: tuple[object, ...], items: Sequence[object]) -> list[object]:
        found = self.workers.each(work, shared, items, self.clock.deadline)
        if len(found) < len(items):
            self.cut["fitting hypotheses"] = None
        self.advance(len(found))
        return found

    @contextmanager
    def finely(self) -> Iterator[None]:
        """Where there is no noise, fits go on until they are exact: slopes over small differences lead there, over larger ones contacts bend them."""
        settings = self.settings
        if self.noise is None:
            self.settings = replace(settings, difference=settings.finishing, converged=settings.finishing)
        try:
            yield
        finally:
            self.settings = settings

    def fitted(self, hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]], workers: Workers | None = None) -> Model:
        """To the end, from `values`."""
        return fitted(self.replay, hypotheses, values, self.rows, self.settings, self.settings.iterations_polish, workers)

    def converged(self, hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]]) -> Model:
        """As `fitted`, in all processes, and on for as long as that gains."""
        model = self.fitted(hypotheses, values, self.workers)
        while not self.late(ENDING):
            further = self.fitted(model.hypotheses, model.values, self.workers)
            _log.debug("%s: %.4g, %.3g", further.values, further.description, further.missed)
            gained, model = model.description - further.description, further
            if gained < self.settings.material:
                break
        return model


def fitted_beside(
    replay: Predictor,
    model: Model,
    rows: Rows,
    settings: ReplaySettings,
    iterations: int,
    added: tuple[Sequence[Hypothesis], Sequence[Sequence[float]]],
) -> Model:
    """`model` and hypotheses `added` to it, with the parameters from which theirs are sought, fitted together."""
    return fitted(replay, (*model.hypotheses, *added[0]), (*model.values, *added[1]), rows, settings, iterations)


def plainness_of(model: Model) -> tuple[int, int, int, list[Plainness]]:
    """Less of plainer models: fewer parameters, fewer hypotheses, fewer things acted on, commoner physics."""
    acted_on = sum(_EVERYTHING if "*" in one.targets else len(one.targets) for one in model.hypotheses)
    return model.size, len(model.hypotheses), acted_on, sorted(plainness(one.starts[0]) for one in model.hypotheses)
