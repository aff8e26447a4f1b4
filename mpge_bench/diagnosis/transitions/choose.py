"""Which hypotheses are the answer: one more in each round, as long as what is left takes fewer nats to write down; then none that is not needed."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mpge_bench.diagnosis.choose.trials import Clock
from mpge_bench.diagnosis.choose.twins import plainness
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, Rows, fitted, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.screen import Columns, Look, columns_of, look, looked_again

_log = logging.getLogger(__name__)
#: More than any robot has links.
_EVERYTHING = 1000


@dataclass(frozen=True)
class Answer:
    """What was chosen, and what it was chosen from.

    Attributes:
        nominal, chosen: models, on the rows that models are fitted to.
        models: all that were fitted to the end, the nominal among them.
        equals: models that describe the transitions as well as `chosen`, which is plainer.
        rows: that models are fitted to.
        cut: stages that the time budget cut short.
    """

    nominal: Model
    chosen: Model
    models: tuple[Model, ...]
    equals: tuple[Model, ...]
    rows: Rows
    cut: tuple[str, ...]


@dataclass
class Search:
    """One search, and the models it has fitted so far."""

    replay: Predictor
    hypotheses: Sequence[Hypothesis]
    workers: Workers
    clock: Clock
    settings: ReplaySettings
    advance: Callable[[int], None] = lambda steps: None
    models: dict[frozenset[tuple[str, tuple[str, ...]]], Model] = field(default_factory=dict)
    cut: dict[str, None] = field(default_factory=dict)
    columns: list[Columns] = field(default_factory=list)

    def __post_init__(self) -> None:
        settings, pieces = self.settings, self.replay
        starts = sum(len(one.starts) for one in self.hypotheses)
        few = int(np.clip(settings.screening // max(starts, 1), settings.fewest, settings.most_rows))
        #: For looks and drafts: of all kinds of motion.
        self.few = pieces.stretches(few, settings.stretch)
        #: For models in the end: from the beginnings of episodes, where what the simulator remembers is known.
        self.rows = pieces.heads(settings.fitted_rows)

    def answer(self) -> Answer:
        """The whole search."""
        chosen = self.add(model_of(self.replay, (), (), self.rows, self.settings))
        while len(chosen.hypotheses) < self.settings.most and not chosen.is_exact(self.settings):
            if self.late("looking for effects"):
                break
            chosen = self.focused(chosen)
            # Columns of a round before are a little off, and cost nothing; where they lead nowhere, new ones may.
            fresh = not self.columns
            richer = self.grown(chosen)
            if not fresh and not self.is_better(richer, chosen) and not self.late("looking for effects"):
                self.columns = []
                richer = self.grown(chosen)
            if richer is None or not self.is_better(richer, chosen):
                break
            chosen = richer
        chosen = self.plainer(self.alone(self.needed(chosen)))
        near = chosen.description + self.settings.equal
        # What has the answer in it and more is no other answer.
        equals = sorted((one for one in self.models.values() if one.hypotheses and one.description < near and not one.key >= chosen.key), key=_plainness)
        return Answer(self.models[frozenset()], chosen, tuple(self.models.values()), tuple(equals), self.rows, tuple(self.cut))

    def focused(self, model: Model) -> Model:
        """`model`, where it is exact but for some transitions judged on these, too: what acts seldom, as a limit does, shows nowhere else.

        All models fitted before are forgotten then, since they were judged on others.
        """
        every, settings = np.arange(len(self.replay)), self.settings
        if model.missed > settings.exact or len(self.rows) == len(every):
            return model
        missed = np.abs(self.replay.residuals(model.effects, every)).max(1) > settings.exact
        if not missed.any():
            return model
        before = np.flatnonzero(missed)[:, None] - np.arange(settings.settle + 1)
        shown = np.unique(np.maximum(before, 0))
        self.few, self.rows, self.columns = shown[: settings.most_rows], np.union1d(self.rows, shown), []
        self.models.clear()
        self.add(model_of(self.replay, (), (), self.rows, settings))
        return self.add(model_of(self.replay, model.hypotheses, model.values, self.rows, settings))

    def is_better(self, richer: Model | None, model: Model) -> bool:
        return richer is not None and richer.description < model.description - self.settings.material

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
        found = self.workers.each(work, (self.replay, *shared), items, self.clock.deadline)
        if len(found) < len(items):
            self.cut["fitting hypotheses"] = None
        self.advance(len(found))
        return found

    def grown(self, model: Model) -> Model | None:
        """The best model of one hypothesis more, fitted to the end."""
        settings = self.settings
        few = model_of(self.replay, model.hypotheses, model.values, self.few, settings)
        if not self.columns:
            self.columns = self.each(columns_of, (few, self.few), self.hypotheses)  # type: ignore[assignment]
        looks = [look(few, one, settings) for one in self.columns if one.hypothesis.key not in model.key]
        looks = sorted(looks, key=lambda one: -one.gain)[: settings.checked]
        again: list[Look] = self.each(looked_again, (few, self.few, settings), looks)  # type: ignore[assignment]
        # The first look goes by proportion, which leads astray where changes are large; the second goes by the simulator, where a start may be far off.
        again = sorted(again, key=lambda one: -one.gain)[: settings.tried]
        _log.debug("looks %s", [(one.hypothesis.label, round(one.gain, 3)) for one in again])
        checked = {one.hypothesis.key for one in again}
        looks = [*again, *[one for one in looks if one.hypothesis.key not in checked][: settings.tried // 2]]
        drafts: list[Model] = self.each(_drafted, (model, self.few, settings), looks)  # type: ignore[assignment]
        drafts.sort(key=lambda one: one.description)
        _log.debug("drafts %s", [(one.hypotheses[-1].label, one.values[-1], round(one.description, 3)) for one in drafts])
        if not drafts or not self.is_better(drafts[0], few):
            return None
        best = drafts[0].description
        # Those that describe as well as the best are all its rivals, however many.
        kept = [one for place, one in enumerate(drafts) if place < settings.polished or one.description < best + settings.equal]
        ends: list[Model] = self.each(_polished, (self.rows, settings), kept)  # type: ignore[assignment]
        for one in ends:
            self.add(one)
        if not ends:
            return None
        least = min(one.description for one in ends)
        return min((one for one in ends if one.description < least + settings.equal), key=_plainness)

    def needed(self, model: Model) -> Model:
        """`model` without the hypotheses that it can do without."""
        for one in sorted(model.hypotheses, key=lambda one: -one.size):
            if len(model.hypotheses) < 2 or self.late("leaving out effects"):
                break
            rest = [(other, own) for other, own in zip(model.hypotheses, model.values, strict=True) if other is not one]
            less = self.add(self.fitted(*zip(*rest, strict=True)))
            if less.description < model.description + self.settings.material:
                model = less
        return model

    def alone(self, model: Model) -> Model:
        """`model` or, where one hypothesis on a target of its own describes as well as all of its several together, that one."""
        if len(model.hypotheses) < 2:
            return model
        blamed = {target for one in model.hypotheses for target in one.targets}
        few = model_of(self.replay, (), (), self.few, self.settings)
        known = [look(few, one, self.settings) for one in self.columns if one.hypothesis.size < model.size and blamed & set(one.hypothesis.targets)]
        for one in sorted(known, key=lambda one: (one.hypothesis.size, -one.gain)):
            if self.late("one effect in the place of several"):
                break
            draft = fitted(self.replay, (one.hypothesis,), (one.start,), self.few, self.settings, self.settings.iterations_polish)
            # Only one that is as near has a chance.
            if draft.missed > self.settings.near * max(model.missed, self.settings.exact):
                continue
            tried = self.add(self.fitted(draft.hypotheses, draft.values))
            if tried.description < model.description + self.settings.equal:
                return tried
        return model

    def plainer(self, model: Model) -> Model:
        """`model` with a plainer effect in the place of one that contains it or that it resembles, where that describes as well."""
        for one in model.hypotheses:
            for other in self.hypotheses:
                if other.targets != one.targets or other.kind.name not in one.kind.plainer() or other.key in model.key or self.late("plainer effects"):
                    continue
                pairs = [(kept, own) for kept, own in zip(model.hypotheses, model.values, strict=True) if kept is not one]
                tried = self.add(self.fitted(*zip(*[*pairs, (other, _start(other, model, one))], strict=True)))
                if tried.description < model.description + self.settings.equal:
                    return self.plainer(tried)
        return model

    def fitted(self, hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]]) -> Model:
        return fitted(self.replay, hypotheses, values, self.rows, self.settings, self.settings.iterations_polish)


def _start(other: Hypothesis, model: Model, one: Hypothesis) -> list[float]:
    """Parameters of `other` from which to fit it in the place of `one`: those of the same name, else its own."""
    values, first = dict(zip(one.kind.parameters, model.values[model.hypotheses.index(one)], strict=False)), other.starts[0]
    return [values.get(name, getattr(first, name)) for name in other.kind.parameters]


def _plainness(model: Model) -> tuple[int, int, int, list[tuple[bool, int, int, int]]]:
    """Less of plainer models: fewer parameters, fewer hypotheses, fewer things acted on, commoner physics."""
    acted_on = sum(_EVERYTHING if "*" in one.targets else len(one.targets) for one in model.hypotheses)
    return model.size, len(model.hypotheses), acted_on, sorted(plainness(one.starts[0]) for one in model.hypotheses)


def _drafted(replay: Predictor, model: Model, rows: Rows, settings: ReplaySettings, look: Look) -> Model:
    return fitted(replay, (*model.hypotheses, look.hypothesis), (*model.values, look.start), rows, settings, settings.iterations)


def _polished(replay: Predictor, rows: Rows, settings: ReplaySettings, draft: Model) -> Model:
    return fitted(replay, draft.hypotheses, draft.values, rows, settings, settings.iterations_polish)
