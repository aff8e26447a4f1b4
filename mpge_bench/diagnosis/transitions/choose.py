"""Which hypotheses are the answer: one more in each round, as long as what is left takes fewer nats to write down; then none that is not needed."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.evidence import best_trust
from mpge_bench.diagnosis.transitions.exchange import exchanged
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, Rows, fitted, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.many import usual_differences
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.diagnosis.transitions.screen import Columns, Look, Refit, columns_of, look, looked_again, refit_of, share_of, together
from mpge_bench.diagnosis.transitions.trials import Trials, fitted_beside, plainness_of

Array = npt.NDArray[np.float64]
_log = logging.getLogger(__name__)


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
class Search(Trials):
    """One search, round by round."""

    #: What hypotheses change beside some model, of the rows `glance`.
    columns: dict[tuple[str, tuple[str, ...]], Columns] = field(default_factory=dict)
    #: Models on whose misses the search has been focused.
    shown: set[frozenset[tuple[str, tuple[str, ...]]]] = field(default_factory=set)
    #: A model to go on from, which was found elsewhere.
    found: Model | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        settings = self.settings
        starts = sum(len(one.starts) for one in self.hypotheses)
        glimpsed = int(np.clip(settings.screening // max(starts, 1), settings.fewest, settings.most_rows))
        #: For first looks and, more of them, for drafts: of all kinds of motion.
        worst = self.worst(())
        self.glance, self.few = (self.spread(rows, worst) for rows in (glimpsed, settings.drafted // self.replay.entries))
        self.glimpse = self.glance

    def answer(self) -> Answer:
        """The whole search."""
        chosen = self.acting(self.told(self.plainer(self.explained())))
        # What has the answer in it and more is no other answer.
        others = (one for one in self.models.values() if one.hypotheses and not one.key >= chosen.key)
        equals = sorted((one for one in others if self.is_equal(one, chosen)), key=plainness_of)
        return Answer(self.models[frozenset()], chosen, tuple(self.models.values()), tuple(equals), self.rows, tuple(self.cut))

    def explained(self) -> Model:
        """The best model: of one hypothesis after another or, where the first leaves something, of all that robots of one make usually differ by."""
        whole, self.clock = self.clock, self.clock.within(self.settings.searching)
        try:
            chosen, many = self._gathered()
        finally:
            self.clock = whole
        return many or self.alone(self.needed(chosen))

    def _gathered(self) -> tuple[Model, Model | None]:
        """The best model of one hypothesis after another, with what was picked up on the way, and that of all usual differences, where it is better."""
        chosen, rounds, looked = self.first(), 0, False
        while len(chosen.hypotheses) < self.settings.most and (not chosen.hypotheses or self.is_lacking(chosen, self.settings.exact_share)):
            if self.late("looking for effects"):
                break
            richer = exchanged(self, self.taken_in(chosen))
            rounds, is_stuck = rounds + 1, richer is chosen
            chosen = richer
            # Not at once: what two rounds find takes less time so, unless what the first finds is usual.
            if chosen.hypotheses and not looked and (rounds == self.settings.rounds or is_stuck or all(one.kind.varies for one in chosen.hypotheses)):
                looked = True
                many = usual_differences(self) if self.is_lacking(chosen, self.settings.exact_share) else None
                if many is not None and self.is_better(many, chosen):
                    return chosen, many
            if is_stuck:
                break
        return chosen, None

    def first(self) -> Model:
        """The model from which the search goes on."""
        nominal = self.add(model_of(self.replay, (), (), self.rows, self.settings))
        if self.found is None:
            return nominal
        return self.models.get(self.found.key) or self.add(self.fitted(self.found.hypotheses, self.found.values))

    def taken_in(self, model: Model) -> Model:
        """`model`, or what is better by one more hypothesis or several of a kind."""
        model = self.focused(model)
        # Columns of a round before are a little off, and cost nothing; where they lead nowhere though something is missing, new ones may.
        fresh = not self.columns
        richer = self.grown(model)
        if not fresh and not self.is_better(richer, model) and not self.late("looking for effects"):
            self.forget()
            richer = self.grown(model)
        return richer if richer is not None and self.is_better(richer, model) else model

    def forget(self) -> None:
        """All columns; new ones are of few rows."""
        self.columns.clear()
        self.glance = self.glimpse

    def nothing(self) -> Answer:
        """The answer where there is no mismatch."""
        nominal = model_of(self.replay, (), (), self.rows, self.settings)
        return Answer(nominal, nominal, (nominal,), (), self.rows, ())

    def focused(self, model: Model) -> Model:
        """`model`, and the search turned to where it misses most: what acts seldom, as a limit does, shows nowhere else.

        Where it is exact but for some transitions it is judged on these, too; all models fitted before are forgotten then, since they were judged on others.
        """
        settings = self.settings
        if self.noise is not None and model.hypotheses:
            worst = self.worst(model.effects)
            self.glance, self.few = (self.spread(len(rows), worst) for rows in (self.glance, self.few))
            self.columns.clear()
        if model.missed > settings.exact or model.key in self.shown:
            return model
        missed = np.abs(self.replay.residuals(model.effects, self.every)).max(1) > settings.exact
        if not missed.any():
            return model
        self.shown.add(model.key)
        before = np.flatnonzero(missed)[:, None] - np.arange(settings.stretch)
        shown = np.unique(np.maximum(before, 0))
        self.glance, self.few, self.rows = shown[: len(self.glance)], shown[: len(self.few)], np.union1d(self.rows, shown)
        settings = self.settings = replace(settings, typical=1 - float(missed[self.rows].mean()) / 2)
        self.columns.clear()
        self.models.clear()
        self.add(model_of(self.replay, (), (), self.rows, settings))
        return self.add(model_of(self.replay, model.hypotheses, model.values, self.rows, settings))

    def drafted(self, model: Model) -> Predictor:
        """The replay for looks and drafts beside `model`: the more it lacks, the more of what it misses is put right, lest simulations go astray."""
        if self.noise is None or not isinstance(self.replay, Replay):
            return self.replay
        return replace(self.replay, trust=best_trust(self.replay, model.effects, self.settings))

    def know(self, replay: Predictor, model: Model, hypotheses: Sequence[Hypothesis]) -> None:
        """The columns of `hypotheses` beside `model`, whose residuals are those of the rows `glance`."""
        columns: list[Columns] = self.each(columns_of, (replay, model, self.glance), hypotheses)  # type: ignore[assignment]
        self.columns.update({one.hypothesis.key: one for one in columns})

    @property
    def ahead(self) -> int:
        """How many drafts of a round are fitted further."""
        return 1

    def is_more(self, one: Hypothesis, model: Model) -> bool:
        """Whether `one` may stand beside the hypotheses of `model`."""
        return one.key not in model.key

    def refit(self, replay: Predictor, model: Model, rows: Rows) -> Refit:
        """What the parameters of `model` make up for in a look at the `rows`: nothing where contacts bend what they change."""
        return refit_of(model, None, self.settings)

    def looks(self, replay: Predictor, model: Model, hypotheses: Sequence[Hypothesis]) -> list[Look]:
        """Those of `hypotheses` that promise most beside `model`, by themselves or several of a kind together."""
        settings, known = self.settings, self.columns
        glance, few = (model_of(replay, model.hypotheses, model.values, rows, settings) for rows in (self.glance, self.few))
        self.know(replay, glance, [one for one in hypotheses if one.key not in known])
        left = [known[one.key] for one in hypotheses if one.key in known and self.is_more(one, model)]
        refit = self.refit(replay, glance, self.glance)
        found = [look(glance, one, settings, refit) for one in left]
        # Several parameters on each of several things say anything.
        plain = [one for one in left if one.hypothesis.is_single and one.hypothesis.size == 1]
        for kind in dict.fromkeys(one.hypothesis.kind for one in plain):
            several = together(glance, [one for one in plain if one.hypothesis.kind is kind], settings, refit)
            found += [several] if several else []
        found = sorted(found, key=lambda one: -one.gain)[: settings.checked]
        anyway = self.checked_anyway(glance)
        found = [one for place, one in enumerate(found) if place < anyway or one.gain > settings.close * found[0].gain]
        again: list[Look] = self.each(looked_again, (replay, few, self.few, settings, self.refit(replay, few, self.few)), found)  # type: ignore[assignment]
        # The first look goes by proportion, which leads astray where changes are large; the second goes by the simulator, where a start may be far off.
        again = sorted(again, key=lambda one: -one.gain)[: settings.tried]
        _log.debug("looks %s", [(one.label, round(one.gain, 3)) for one in again])
        checked = {one.hypotheses for one in again}
        return [*again, *[one for one in found if one.hypotheses not in checked][: settings.tried // 2]]

    def checked_anyway(self, model: Model) -> int:
        """How many hypotheses are looked at a second time beside `model`, however little they promise."""
        return self.settings.checked_anyway

    def turns(self) -> list[list[Hypothesis]]:
        """In which hypotheses are looked at: those of one parameter come first, since none can be plainer."""
        return [[one for one in self.hypotheses if (one.size == 1) is plain] for plain in (True, False)]

    def drafts(self, replay: Predictor, model: Model) -> list[Model]:
        """`model` with what promises most beside it, each fitted to few transitions; the best first.

        Where one of a turn leaves nothing but rounding or noise, nothing else is looked at.
        """
        settings, most = self.settings, 0.0
        found: list[Model] = []
        for hypotheses in self.turns():
            looks = self.looks(replay, model, hypotheses)
            most = max([most, *(one.gain for one in looks)])
            looks = [one for one in looks if one.gain > settings.promising * most]
            shared = (replay, model, self.few, settings, settings.iterations_first)
            begun: list[Model] = self.each(fitted_beside, shared, [(one.hypotheses, one.start) for one in looks])  # type: ignore[assignment]
            begun.sort(key=lambda one: one.description)
            found += begun[settings.followed :]
            found += self.each(_fitted, (replay, self.few, settings, settings.iterations), begun[: settings.followed])  # type: ignore[arg-type]
            found.sort(key=lambda one: one.description)
            # What is exact in the end need not be after these iterations.
            ahead = slice(self.ahead)
            found[ahead] = self.each(_fitted, (replay, self.few, settings, settings.iterations_polish), found[ahead])  # type: ignore[assignment]
            found[ahead] = [self.finished(one, replay, self.few) for one in found[ahead]]
            found.sort(key=lambda one: one.description)
            if found and not self.is_lacking(found[0], settings.exact_draft):
                break
        return found

    def grown(self, model: Model) -> Model | None:
        """The best model of one hypothesis more, fitted to the end."""
        settings = self.settings
        replay = self.drafted(model)
        few = model_of(replay, model.hypotheses, model.values, self.few, settings)
        drafts = [one for one in self.drafts(replay, model) if one.is_plausible]
        _log.debug("drafts %s", [([other.label for other in one.hypotheses], one.values, round(one.description, 3)) for one in drafts])
        # Few transitions say little of chance: that is for the end.
        if not drafts or drafts[0].description > few.description - settings.material:
            return None
        # Those that describe as well as the best are all its rivals, however many.
        kept = [one for place, one in enumerate(drafts) if place < settings.polished or self.is_equal(one, drafts[0])]
        ends: list[Model] = self.each(_fitted, (self.replay, self.rows, settings, settings.iterations_polish), kept)  # type: ignore[assignment]
        for one in ends:
            self.add(one)
        ends = [one for one in ends if one.is_plausible]
        if not ends:
            return None
        best = min(ends, key=lambda one: one.description)
        return self.add(self.finished(min((one for one in ends if self.is_equal(one, best)), key=plainness_of), self.replay, self.rows))

    def finished(self, model: Model, replay: Predictor, rows: Rows) -> Model:
        """`model` fitted until it is exact, where it nearly is and nothing is noisy: what looks as if more were missing may be the fit's own end."""
        settings = self.settings
        if self.noise is not None or not settings.exact < model.missed < settings.nearly:
            return model
        with self.finely():
            return _fitted(replay, rows, self.settings, settings.iterations_polish, model)

    def needed(self, model: Model) -> Model:
        """`model` without the hypotheses that it can do without."""
        for one in sorted(model.hypotheses, key=lambda one: -one.size):
            if len(model.hypotheses) < 2 or self.late("leaving out effects"):
                break
            model = self.lesser(model, self.add(self.fitted(*model.without(one))))
        return model

    def lesser(self, model: Model, less: Model) -> Model:
        """`less`, which has one hypothesis less, or `model` where that one is needed."""
        return model if self.is_better(model, less) else less

    def alone(self, model: Model) -> Model:
        """`model` or, where one hypothesis on a target of its own describes as well as all of its several together, that one."""
        if len(model.hypotheses) < 2 or self.late("one effect in the place of several"):
            return model
        blamed = {target for one in model.hypotheses for target in one.targets}
        replay = self.drafted(self.models[frozenset()])
        nominal, whole = (model_of(replay, one.hypotheses, one.values, self.glance, self.settings) for one in (self.models[frozenset()], model))
        columns = [one for one in self.columns.values() if one.hypothesis.size < model.size and blamed & set(one.hypothesis.targets)]
        refit = self.refit(replay, nominal, self.glance)
        known = [look(nominal, one, self.settings, refit) for one in columns]
        least = max(
            self.settings.promising * max((one.gain for one in known), default=0.0), self.settings.standing_for * share_of(whole, nominal, self.settings)
        )
        known = sorted((one for one in known if one.gain > least), key=lambda one: (one.hypotheses[0].size, -one.gain))
        shared = (self.replay, nominal, self.few, self.settings, self.settings.iterations_polish)
        drafts: list[Model] = self.each(fitted_beside, shared, [(one.hypotheses, one.start) for one in known])  # type: ignore[assignment]
        for draft in drafts:
            # Only one that is as near has a chance.
            if draft.missed > self.settings.near * max(model.missed, self.settings.exact):
                continue
            tried = self.add(self.fitted(draft.hypotheses, draft.values))
            if self.is_equal(tried, model):
                return tried
        return model

    def plainer(self, model: Model) -> Model:
        """`model` with a plainer effect in the place of one that contains it or that it resembles, where that describes as well."""
        for one in model.hypotheses:
            for other in self.hypotheses:
                if other.targets != one.targets or other.kind.name not in one.kind.plainer() or other.key in model.key or self.late("plainer effects"):
                    continue
                others, values = model.without(one)
                tried = self.add(self.fitted((*others, other), (*values, _start(other, model, one))))
                if self.is_equal(tried, model):
                    return self.plainer(tried)
        return model

    def told(self, model: Model) -> Model:
        """`model` with each parameter that changes nothing, as the place of a load across a plane, at the value at which it is absent."""
        for place, one in enumerate(model.hypotheses):
            for index, absent in enumerate(one.absent or ()):
                values = [list(own) for own in model.values]
                values[place][index] = absent
                tried = model_of(self.replay, model.hypotheses, values, self.rows, self.settings)
                if float(np.max(np.abs(tried.residuals - model.residuals))) < self.settings.exact:
                    self.models[model.key] = model = tried
        return model

    def acting(self, model: Model) -> Model:
        """`model` without hypotheses that change nothing, as a rotor of no inertia: time was up before they were left out."""
        whole = model_of(self.replay, model.hypotheses, model.values, self.rows, self.settings)
        for one in model.hypotheses:
            less = model_of(self.replay, *model.without(one), self.rows, self.settings)
            if float(np.max(np.abs(less.residuals - whole.residuals))) < self.settings.exact:
                return self.acting(self.add(less))
        return model


def _start(other: Hypothesis, model: Model, one: Hypothesis) -> list[float]:
    """Parameters of `other` from which to fit it in the place of `one`: those of the same name, else its own."""
    values, first = dict(zip(one.kind.parameters, model.values[model.hypotheses.index(one)], strict=False)), other.starts[0]
    return [values.get(name, getattr(first, name)) for name in other.kind.parameters]


def _fitted(replay: Predictor, rows: Rows, settings: ReplaySettings, iterations: int, draft: Model) -> Model:
    return fitted(replay, draft.hypotheses, draft.values, rows, settings, iterations)
