"""Thresholds of designed experiments. Those of the next experiment are stored in diagnosis.json with it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExperimentSettings:
    """Of the next experiment that a diagnosis asks for.

    Attributes:
        seconds: s it lasts; as the recordings that are advised, long enough for slow and fast motion.
        shortest: s to which it is cut where a rival would go beyond the limits later, as what nothing holds does.
        draws: motions that are tried, each a second or two in one process.
        seed: of their draw.
        beyond: times what the recordings reached of position, speed and command, up to which it goes where nobody states limits: no leap into what nobody
            has seen the machine do.
        models: held against one another at most, the answer among them: each costs a fit and a few predictions a motion.
        apart: standard deviations of the noise between two models' predictions, each at its best, below which a motion does not tell them apart: twice as
            many as at which answers are no longer called indistinguishable, since the real motion is not quite the designed one.
        rounds: of choosing a motion and looking at it from each model's own side, which shows more pairs to be one.
    """

    seconds: float = 10.0
    shortest: float = 2.0
    draws: int = 12
    seed: int = 0
    beyond: float = 1.5
    models: int = 7
    apart: float = 6.6
    rounds: int = 3


DEFAULT = ExperimentSettings()
