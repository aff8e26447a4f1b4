"""The report: what it says, that it needs nothing else, and that a browser draws it."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shutil
import subprocess
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from matplotlib import image

from mpge_bench.diagnosis.report.numbers import number
from mpge_bench.diagnosis.report.page import report_html
from mpge_bench.diagnosis.verdict.evidence import Evidence, JointEvidence, Law, Trajectory
from mpge_bench.diagnosis.verdict.result import Accuracy, Confusion, Detectable, DiagnosisResult, Errors, Estimate, FoundEffect, MoreData, Place, Rival

VOID = {"meta", "link", "br", "hr", "img", "input", "wbr"}


def _joint(name: str, share: float, friction: float, seed: int, noise: float = 0.02, rows: int = 3000) -> JointEvidence:
    """A joint on a sum of sines, which dry friction brakes."""
    rng = np.random.default_rng(seed)
    time = np.arange(rows) * 0.01
    phases = rng.uniform(0, 6, 3)
    rates = 2 * np.pi * np.array([0.23, 0.61, 1.37])
    q = (np.sin(time[:, None] * rates + phases) * [0.9, 0.4, 0.15]).sum(1)
    dq = np.gradient(q, time)
    command = np.clip(1.2 * dq + 0.8 * q + 0.1 * rng.standard_normal(rows), -2.5, 2.5)
    after = noise * rng.standard_normal(rows)
    return JointEvidence(name, "N m", "rad", "rad/s", share, noise, time, q, dq, command, after - friction * np.tanh(dq / 0.05), after)


def _trajectory(joint: str, miss: float) -> Trajectory:
    rng = np.random.default_rng(1)
    time = np.arange(400) * 0.01
    measured = 0.8 * np.sin(2.1 * time) + 0.2 * np.sin(7 * time)
    since = time % 0.5
    return Trajectory(
        "test_03.csv", joint, "rad", time, measured, measured + miss * since**2, measured + 0.002 * rng.standard_normal(400), np.arange(0, 4, 0.5)
    )


def _explained(second: str = "shoulder") -> DiagnosisResult:
    """Coulomb friction at the elbow of a two-joint arm."""
    at = np.linspace(-5, 5, 201)
    rivals = [
        ("stribeck_friction:elbow", "coulomb 0.309, static 0.321 N m, velocity 0.11 rad/s", 0.01119, 1.9),
        *(
            (f"{effect}:{joint}", "1.23", 0.052, 100.0 + k)
            for k, joint in enumerate(("elbow", second))
            for effect in ("viscous_friction", "lag", "delay", "armature")
        ),
        *((f"payload:link_{k}", "mass 0.21 kg, distance 0.1 m", 0.11, 900.0 + k) for k in range(8)),
    ]
    return DiagnosisResult(
        verdict="explained",
        p_value=1e-12,
        where=(Place("joint", "elbow", 0.93, "near standstill, |dq| < 0.2 rad/s"),),
        effects=(FoundEffect("coulomb_friction", "elbow", 0.97, {"torque": Estimate(0.31042, "N m", 0.29113, 0.33021)}),),
        alternatives=tuple(Rival((effects,), error, behind, parameters) for effects, parameters, error, behind in rivals),
        indistinguishable=(
            Confusion(("coulomb_friction:elbow", "load_friction:elbow"), "Hold the elbow against loads of different size and move it slowly."),
        ),
        fit=Accuracy(0.5, Errors(0.121, 0.0112, 0.0101, "rad"), {"q_elbow": Errors(0.0873, 0.00212, 0.0019, "rad")}),
        summary=("Coulomb friction at the elbow, 0.310 N m, explains what the simulator missed.", "Nothing else of the catalogue comes near."),
        detectable=(Detectable("viscous_friction", "elbow", "damping", 0.00712, "N m s/rad"), Detectable("torque_gain", second, "gain", 0.981, "1")),
        checks=("Sampling is even, 100 Hz.", "dq agrees with the derivative of q."),
        about={"horizon": "0.5 s", "trained on": "train_01.csv, train_02.csv", "held out": "test_03.csv", "took": "41 s"},
        evidence=Evidence(
            joints=(_joint(second, 0.07, 0.0, 2), _joint("elbow", 0.93, 0.31, 1)),
            laws=(Law("coulomb_friction", "elbow", "dq", at, -0.31 * np.tanh(at / 0.05)),),
            trajectories=(_trajectory("elbow", 1.1), _trajectory(second, 0.08)),
        ),
    )


def _with(result: DiagnosisResult, **changes: Any) -> DiagnosisResult:
    """`result` with other evidence."""
    return dataclasses.replace(result, evidence=dataclasses.replace(result.evidence, **changes))


def _no_mismatch() -> DiagnosisResult:
    result = _explained()
    joints = tuple(dataclasses.replace(joint, before=joint.after) for joint in result.evidence.joints)
    trajectories = tuple(dataclasses.replace(one, before=one.after) for one in result.evidence.trajectories)
    return dataclasses.replace(
        _with(result, joints=joints, laws=(), trajectories=trajectories),
        verdict="no_mismatch",
        p_value=0.423,
        where=(),
        effects=(),
        alternatives=(),
        indistinguishable=(),
        fit=Accuracy(0.5, Errors(0.0103, 0.0103, 0.0101, "rad")),
        summary=("All within the noise.",),
    )


def _unexplained() -> DiagnosisResult:
    at, torque = (-2.0, -1.0, -0.1, 0.1, 1.0, 2.0), (0.2, 0.3, 0.1, -0.1, -0.3, -0.2)
    curve = FoundEffect("unknown", "elbow", None, {"at": Estimate(at, "rad/s", at, at), "torque": Estimate(torque, "N m")}, ("dq",))
    result = _with(_explained(), laws=(Law("unknown", "elbow", "dq", np.array(at), np.array(torque)),))
    return dataclasses.replace(result, verdict="unexplained", effects=(curve,))


class _Page(HTMLParser):
    """Text of the page, and whether every element is closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.ids += [value for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.text += data + " "


def _read(html: str) -> _Page:
    page = _Page(html)
    assert not page.open
    assert len(page.ids) == len(set(page.ids))
    outside = re.sub(r'xmlns(:\w+)?="[^"]*"', "", html)
    assert not re.search(r"https?://|@import|<script|<link|<img", outside)
    assert not re.search(r'(?:src|href)="(?!#|data:)', outside)
    assert all(target in page.ids for target in re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', outside) for target in target if target)
    assert not re.search(r"\b(nan|inf|None)\b", page.text)
    assert len(html) < 3_000_000
    return page


def test_explained_says_verdict_where_what_and_the_rest_in_order():
    html = report_html(_explained())
    page = _read(html)
    text = " ".join(page.text.split())
    sections = re.findall(r'<section id="([\w-]+)"', html)
    assert sections == ["verdict", "where", "what", "fit", "ruled-out", "confusions", "detectable", "data", "settings"]
    for shown in (
        "p = 10⁻¹²",
        "0.121 → 0.0112",
        "0.0101",
        "0.310",
        "0.291",
        "0.330",
        "N m",
        "97 %",
        "93 % of the residual force, near standstill",
        "still possible",
        "0.00712",
    ):
        assert shown in text, shown
    assert "Coulomb friction at elbow: torque 0.310 N m (0.291 to 0.330)." in text
    assert "99.0 % of the error above the noise floor is gone" in text
    assert page.tags.count("svg") == 2 * 3 + 1 + 2
    assert page.tags.count("details") == 1  # rivals beyond the twelfth
    assert html == report_html(_explained())


def test_no_mismatch_shows_no_correction():
    page = _read(report_html(_no_mismatch()))
    assert "No mismatch found" in page.text
    assert "p = 0.423" in page.text
    assert "Nothing is missing" in page.text
    assert "corrected" not in page.text
    assert "→" not in page.text


def test_what_is_faint_is_not_called_nothing():
    result = dataclasses.replace(_no_mismatch(), is_faint=True, p_value=0.001, p_is_bound=True)
    page = _read(report_html(result))
    assert "Hardly a mismatch" in page.text
    assert "No mismatch found" not in page.text
    assert "Nowhere" not in page.text
    assert "Nothing is missing" not in page.text
    assert DiagnosisResult.from_json(json.loads(json.dumps(result.to_json()))).is_faint


def test_too_little_data_is_no_answer_of_either_kind():
    result = dataclasses.replace(_no_mismatch(), verdict="too_little_data", more_data=MoreData(4, 9, 5.0), summary=("Record 5 s more.",))
    page = _read(report_html(result))
    assert "Too little data" in page.text
    assert "Record 5 s more." in page.text
    assert "Nothing is missing" not in page.text
    assert "Nowhere" not in page.text
    assert DiagnosisResult.from_json(json.loads(json.dumps(result.to_json()))).more_data == result.more_data


def test_a_p_below_all_that_were_drawn_is_a_bound():
    assert "p < 0.001" in _read(report_html(dataclasses.replace(_explained(), p_value=1 / 1001, p_is_bound=True))).text


def test_what_is_not_told_has_no_interval_but_a_name():
    effect = FoundEffect("armature", "elbow", 0.9, {"inertia": Estimate(0.31042, "kg m²", -math.inf, math.inf)})
    result = dataclasses.replace(_explained(), effects=(effect,), untold=(("inertia of armature:elbow", "factor of inertia_scale:arm"),))
    page = _read(report_html(result))
    text = " ".join(page.text.split())
    assert "inertia 0.3104 not told" in text
    assert "one by one, only together: inertia of armature:elbow, factor of inertia_scale:arm" in text
    assert DiagnosisResult.from_json(json.loads(json.dumps(result.to_json())), result.evidence).effects == result.effects


def test_what_comes_beside_the_rigs_own_is_shown_with_what_there_is_in_all() -> None:
    effect = FoundEffect("viscous_friction", "elbow", 0.9, {"damping": Estimate(-0.31042, "N m s/rad", -0.33021, -0.29113, total=0.18958)})
    result = dataclasses.replace(_explained(), effects=(effect,))
    text = " ".join(_read(report_html(result)).text.split())
    assert "damping −0.310 −0.330 −0.291 N m s/rad damping in all 0.1896 – – N m s/rad" in text
    stored = json.loads(json.dumps(result.to_json()))
    assert stored["effects"][0]["parameters"]["damping"]["total"] == 0.18958
    assert DiagnosisResult.from_json(stored, result.evidence).effects == result.effects


def test_unexplained_shows_the_empirical_curve():
    page = _read(report_html(_unexplained()))
    assert "Mismatch not explained" in page.text
    assert "6 points, −0.300 to 0.300" in page.text
    assert "Unknown effect at elbow" in page.text


def test_names_are_escaped():
    html = report_html(_explained("<b>$x$ & 'y'"))
    page = _read(html)
    assert "<b>$x$" not in html
    assert "<b>$x$ & 'y'" in page.text
    assert page.text.count("<b>$x$ & 'y'") > 4


def test_one_joint_six_joints_and_none():
    result = _explained()
    _read(report_html(_with(result, joints=result.evidence.joints[1:], trajectories=())))
    many = tuple(_joint(f"joint_{k}", 1 / 6, 0.1 * k, k) for k in range(6))
    page = _read(report_html(_with(result, joints=many)))
    assert "3 more joints" in page.text
    _read(report_html(DiagnosisResult("explained", 1e-12, result.where, result.effects, fit=result.fit)))


def test_joints_without_force_or_motion_or_with_missing_rows():
    result = _explained()
    still, joint = result.evidence.joints
    zero = np.zeros_like(joint.before)
    gap = np.where(np.arange(len(zero)) % 7 == 0, np.nan, joint.before)
    joints = (
        dataclasses.replace(still, joint="quiet", before=zero, after=zero, noise=0.0),
        dataclasses.replace(joint, joint="passive", command=zero, before=gap),
        dataclasses.replace(joint, joint="empty", share=math.nan, **{name: np.zeros(0) for name in ("time", "q", "dq", "command", "before", "after")}),
    )
    page = _read(report_html(_with(result, joints=joints)))
    assert "agrees with the recordings exactly" in page.text
    assert "command u is 0 throughout" in page.text
    assert "No rows of this joint" in page.text


def test_a_law_without_a_name_is_told_as_its_formula():
    """In the file it is unknown, as a curve: nobody has a name for it."""
    law = FoundEffect("periodic_torque", "elbow", 0.9, {"amplitude": Estimate(0.4, "N m", 0.39, 0.41)}, formula="0.4 sin(7 q)")
    result = dataclasses.replace(_explained(), effects=(law,), verdict="unexplained")
    stored = json.loads(json.dumps(result.to_json()))
    assert (stored["explained_by"], stored["effects"][0]["effect"], stored["effects"][0]["law"]) == ("formula", "unknown", "periodic_torque")
    assert stored["effects"][0]["formula"] == "0.4 sin(7 q)"
    assert DiagnosisResult.from_json(stored).effects == (law,)
    assert "Mismatch described by a formula" in report_html(result)


def test_of_two_joints_that_are_tied_both_are_told():
    law = FoundEffect("coupling_spring", "elbow", 0.9, {"stiffness": Estimate(4.2, "N m/rad", 4.1, 4.3)}, formula="-4.2 (q - q_shoulder)", other="shoulder")
    result = dataclasses.replace(_explained(), effects=(law,), verdict="unexplained")
    stored = json.loads(json.dumps(result.to_json()))
    assert (stored["effects"][0]["target"], stored["effects"][0]["other"]) == ("elbow", "shoulder")
    assert DiagnosisResult.from_json(stored).effects == (law,)
    assert "Coupling spring at shoulder and elbow" in report_html(result)


@pytest.mark.slow
def test_what_was_read_back_from_json_says_the_same_without_plots():
    for result in (_explained(), _no_mismatch(), _unexplained()):
        again = DiagnosisResult.from_json(json.loads(json.dumps(result.to_json())), result.evidence)
        assert again.to_json() == result.to_json()
        assert report_html(again) == report_html(result)
        _read(report_html(dataclasses.replace(again, evidence=Evidence())))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.31042, "0.3104"),
        (1234.5678, "1235"),
        (-2.0, "−2.000"),
        (0, "0"),
        (1e-12, "10⁻¹²"),
        (2.5e-7, "2.5 × 10⁻⁷"),
        (3.2e8, "3.2 × 10⁸"),
        (math.nan, "–"),
        (None, "–"),
        (math.inf, "∞"),
    ],
)
def test_numbers(value, text):
    assert number(value) == text


def test_a_browser_draws_it(tmp_path):
    browser = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
    if browser is None:
        pytest.skip("no Chromium found")
    page, shot = tmp_path / "report.html", tmp_path / "report.png"
    page.write_text(report_html(_explained()), encoding="utf-8")
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path / 'profile'}",
        f"--screenshot={shot}",
        "--window-size=1200,4000",
    ]
    subprocess.run([*command, page.as_uri()], check=True, capture_output=True, timeout=120)
    pixels = np.round(np.asarray(image.imread(shot))[..., :3] * 255).astype(int)
    assert pixels.shape == (4000, 1200, 3)
    for colour in ("d55e00", "0072b2", "0b5394", "e8f1fa"):  # nominal, corrected, the banner's title and ground
        expected = [int(colour[k : k + 2], 16) for k in (0, 2, 4)]
        assert (np.abs(pixels - expected).max(-1) < 12).sum() > 200, colour
    # Down to the last section something is drawn.
    assert (pixels[3000:] < 128).all(-1).any()


@pytest.mark.parametrize(("verdict", "warned"), [("explained", False), ("partly_explained", True), ("no_mismatch", False)])
def test_detectable_sizes_are_doubted_where_more_than_noise_is_left(verdict: str, warned: bool) -> None:
    size = Detectable("viscous_friction", "elbow", "damping", 0.00712, "N m s/rad")
    assert ("larger effects may hide" in report_html(DiagnosisResult(verdict, 0.001, detectable=(size,)))) is warned
