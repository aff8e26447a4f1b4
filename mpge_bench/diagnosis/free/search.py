"""The search for what windows lack: as for transitions, but that it knows the noise, and that derivatives tell in long windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.transitions.choose import Search
from mpge_bench.diagnosis.transitions.evidence import Comparison
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis


@dataclass
class FreeSearch(Search):
    """One that ends where what is left is the noise."""

    evidence: Evidence = field(kw_only=True)

    def compared(self) -> Comparison:
        """Whether there is anything to search for; where it is not plain to see, what all hypotheses change of many windows is looked at."""
        nominal = model_of(self.replay, (), (), self.every, self.settings)
        test = self.evidence.compared(nominal.residuals, (), self.glance)
        if test.is_mismatch:
            return test
        free, starts = self.evidence.settings.free, sum(len(one.starts) for one in self.hypotheses)
        self.glance = self.replay.heads(max(len(self.glance), round(free.tested / free.window / starts)))
        self.know(self.replay, nominal, self.hypotheses)
        return self.evidence.compared(nominal.residuals, self.columns.values(), self.glance)

    def know(self, replay: Predictor, model: Model, hypotheses: Sequence[Hypothesis]) -> None:
        """See `Search`; with long steps."""
        coarse = self.evidence.target.coarser()
        super().know(coarse, model_of(coarse, model.hypotheses, model.values, self.glance, self.settings), hypotheses)

    @property
    def is_smooth(self) -> bool:
        """Whether windows are long ones, in which looks tell, and derivatives."""
        return self.evidence.settings.free.pinned == self.evidence.settings.smooth.pinned

    def taken_in(self, model: Model) -> Model:
        """See `Search`; what is taken in is fitted again about what starts change beside it: beside the rig, whose ground may be level, that is something else.

        All models are judged by that from then on: those that were not as good are forgotten.
        """
        richer = super().taken_in(model)
        if richer is model or not self.is_smooth:
            return richer
        rivals = [one for one in self.models.values() if one.hypotheses and one.key != richer.key and self.is_equal(one, richer)]
        self.replay = self.evidence.target.linearised(richer.effects)
        self.models.clear()
        self.add(model_of(self.replay, (), (), self.rows, self.settings))
        found = self.add(self.fitted(richer.hypotheses, richer.values))
        for one in rivals:
            if not self.late("fitting hypotheses"):
                self.add(self.fitted(one.hypotheses, one.values))
        return found

    def turns(self) -> list[list[Hypothesis]]:
        """See `Search`; all at once where windows are smooth, and looks tell: what is drafted without reason takes longer than looks."""
        return [list(self.hypotheses)] if self.is_smooth else super().turns()

    def is_lacking(self, model: Model, share: float) -> bool:
        """See `Trials`."""
        missed = self.replay.residuals(model.effects, self.every)
        return self.evidence.chance(missed, self.columns.values(), self.glance)[0] < self.settings.leftover
