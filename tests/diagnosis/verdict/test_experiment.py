"""What is said of the next experiment, and that the file holds it."""

from __future__ import annotations

import json

from mpge_bench.diagnosis.verdict.experiment import Foretold, NextExperiment
from mpge_bench.diagnosis.verdict.result import DiagnosisResult

TOLD = NextExperiment(
    "rivals",
    tried=12,
    seconds=10.0,
    classes=(("delay:elbow",), ("lag:elbow", "sensor_delay:elbow")),
    apart=41.2,
    joint="elbow",
    time=3.42,
    unit="rad",
    noises=28.0,
    predictions=(Foretold("delay:elbow", 0.412), Foretold("lag:elbow", 0.398), Foretold("sensor_delay:elbow", 0.4)),
    limits={"elbow": {"position": 1.5, "speed": 8.0, "command": 2.0}},
    settings={"draws": 12},
)


def test_it_says_what_it_is_for_and_what_each_rival_predicts() -> None:
    (line,) = TOLD.lines
    assert "tells delay:elbow from (lag:elbow or sensor_delay:elbow)." in line
    assert "At 3.42 s elbow would be at 0.412 rad by delay:elbow; 0.398 rad by lag:elbow" in line
    assert "0.014 rad, or 28 times the noise" in line
    assert "stay 41.2 standard deviations apart" in line
    assert line.endswith("No motion that was found within the limits tells (lag:elbow or sensor_delay:elbow) apart.")


def test_where_there_is_none_it_says_why() -> None:
    (line,) = NextExperiment("rivals", 12, classes=(("gravity:world", "sensor_bias:elbow"),)).lines
    assert line == "Next experiment: none. No motion that was found within the limits tells (gravity:world or sensor_bias:elbow) apart."
    assert "no motion from rest at 0" in NextExperiment("too_little_data", 0).lines[0]


def test_the_file_holds_it() -> None:
    result = DiagnosisResult("explained", 0.001, next_experiment=TOLD)
    data = json.loads(json.dumps(result.to_json()))
    assert data["next_experiment"]["file"] == "next_experiment.csv"
    assert DiagnosisResult.from_json(data).next_experiment == TOLD
    assert DiagnosisResult.from_json({"verdict": "explained"}).next_experiment is None
