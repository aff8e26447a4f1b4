"""Every setting has a unit and a reason, and what is stored can be read back."""

from __future__ import annotations

import dataclasses
import json

from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings


def test_every_setting_has_a_unit_and_a_reason() -> None:
    for stage in dataclasses.fields(DEFAULT):
        for setting in dataclasses.fields(getattr(DEFAULT, stage.name)):
            assert setting.metadata["unit"], setting.name
            assert len(setting.metadata["reason"]) > 10, setting.name


def test_settings_are_stored_and_read_back() -> None:
    other = dataclasses.replace(DEFAULT, choose=dataclasses.replace(DEFAULT.choose, beam=5, tried=(3, 2, 1)))
    stored = json.loads(json.dumps(other.to_dict()))
    assert stored["choose"]["beam"] == 5
    assert DiagnosisSettings.from_dict(stored) == other
    # A file of an older version lacks some.
    del stored["data"]
    assert DiagnosisSettings.from_dict(stored) == other
