"""Every threshold, constant and budget of the diagnosis: its value, its unit and its reason. All are stored in diagnosis.json.

What only keeps a division or an inverse from failing (1e-9 and the like) stays where it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mpge_bench.diagnosis.settings.mechanisms import ChooseSettings, DataSettings, FitSettings, HypothesisSettings, PredictSettings, VerdictSettings
from mpge_bench.diagnosis.settings.robots import FreeSettings, ReplaySettings, SmoothSettings

__all__ = [
    "DEFAULT",
    "ChooseSettings",
    "DataSettings",
    "DiagnosisSettings",
    "FitSettings",
    "FreeSettings",
    "HypothesisSettings",
    "PredictSettings",
    "ReplaySettings",
    "SmoothSettings",
    "VerdictSettings",
]


@dataclass(frozen=True)
class DiagnosisSettings:
    """All of them, by stage."""

    data: DataSettings = field(default_factory=DataSettings)
    predict: PredictSettings = field(default_factory=PredictSettings)
    hypotheses: HypothesisSettings = field(default_factory=HypothesisSettings)
    fit: FitSettings = field(default_factory=FitSettings)
    choose: ChooseSettings = field(default_factory=ChooseSettings)
    verdict: VerdictSettings = field(default_factory=VerdictSettings)
    replay: ReplaySettings = field(default_factory=ReplaySettings)
    free: FreeSettings = field(default_factory=FreeSettings)
    smooth: SmoothSettings = field(default_factory=SmoothSettings)

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Plain values by stage and name, as diagnosis.json holds them."""
        return {
            stage.name: {name: list(value) if isinstance(value, tuple) else value for name, value in dataclasses.asdict(getattr(self, stage.name)).items()}
            for stage in dataclasses.fields(self)
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Mapping[str, Any]]) -> DiagnosisSettings:
        """What `to_dict` gave; what `data` does not hold keeps its default."""
        default = cls()
        stages = {
            stage: dataclasses.replace(getattr(default, stage), **{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})
            for stage, values in data.items()
        }
        return dataclasses.replace(default, **stages)


DEFAULT = DiagnosisSettings()
