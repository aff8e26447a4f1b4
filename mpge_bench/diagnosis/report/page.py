"""The diagnosis as one self-contained HTML page: the verdict first, then the evidence for it."""

from __future__ import annotations

import math

import matplotlib
import numpy as np

from mpge_bench.diagnosis.report.numbers import number
from mpge_bench.diagnosis.report.plots import COLOURS, finite_rows, joint_plots, law_plot, trajectory_plot
from mpge_bench.diagnosis.report.tables import (
    confusions_table,
    detectable_table,
    effects_table,
    fit_of,
    joints_table,
    lawless,
    rivals_table,
    values_text,
    where_lines,
)
from mpge_bench.diagnosis.verdict.result import DiagnosisResult
from mpge_bench.webpage import STYLE, render

#: Rows of a table before the rest is folded away; joints and trajectories that are drawn at most; joints that are shown whatever their share.
ROWS, JOINTS, TRAJECTORIES, SHOWN = 12, 12, 12, 3

_VERDICTS = {
    "no_mismatch": ("No mismatch found", "What the simulator misses of these recordings is about the noise."),
    "too_little_data": ("Too little data", "These recordings are too short to tell a mismatch from chance."),
    "explained": ("Mismatch explained", "The effects below account for what the simulator got wrong."),
    "partly_explained": ("Mismatch partly explained", "The effects below account for a part of it; something remains."),
    "unexplained": ("Mismatch not explained", "Something differs, and no effect of the catalogue accounts for it."),
}


#: Of mismatches that something else than named physics describes.
_DESCRIBED = {
    "formula": ("Mismatch described by a formula", "No physics of the catalogue accounts for it, but the law below does, as far as the errors say."),
    "curve": ("Mismatch not explained, but modelled", "No physics of the catalogue accounts for all of it; a nameless curve stands in for the rest."),
}


#: Of none that is taken for one, though it is not taken for chance.
_FAINT = ("Hardly a mismatch", "Something shows that is not the noise by chance; it is about as small, and nothing known here mends it.")


def report_html(result: DiagnosisResult) -> str:
    """One HTML page that needs nothing else: style and plots are within it, and it asks for nothing from a network."""
    heading, gist = _FAINT if result.is_faint else _DESCRIBED.get(result.explained_by, _VERDICTS[result.verdict])
    evidence = result.evidence
    joints = [finite_rows(joint) for joint in evidence.joints]
    joints.sort(key=lambda joint: -joint.share if math.isfinite(joint.share) else 0.0)
    blamed = {effect.target for effect in result.effects} | {place.name for place in result.where}
    corrected = bool(result.effects) or any(not np.array_equal(joint.before, joint.after) for joint in joints)
    effects = effects_table(result.effects)
    fitted = {entry["key"]: values_text(entry["lines"]) for entry in effects}
    with matplotlib.rc_context(STYLE):
        drawn = [(joint.joint in blamed or place < SHOWN, joint_plots(joint, place)) for place, joint in enumerate(joints[:JOINTS])]
        laws = [
            plot
            for place, law in enumerate(evidence.laws)
            if (plot := law_plot(law, evidence.laws, joints, fitted.get((law.effect, law.joint), ""), f"l{place}-")) is not None
        ]
        trajectories = [trajectory_plot(one, f"t{place}-") for place, one in enumerate(evidence.trajectories[:TRAJECTORIES]) if len(one.time) > 1]
    return render(
        "diagnosis/report/report.html.j2",
        verdict=result.verdict,
        is_faint=result.is_faint,
        title=heading,
        gist=gist,
        summary=result.summary,
        p_value=f"< {number(result.p_value, 1)}" if result.p_is_bound else f"= {number(result.p_value, 3)}",
        mismatch=result.verdict not in ("no_mismatch", "too_little_data"),
        fit=fit_of(result.fit),
        effects=effects,
        untold=result.untold,
        where=where_lines(result.where),
        joints=joints_table(joints, corrected),
        shown=[plots for shown, plots in drawn if shown],
        folded=[plots for shown, plots in drawn if not shown],
        undrawn=[joint.joint for joint in joints[JOINTS:]],
        laws=laws,
        lawless=lawless(result.effects, evidence.laws),
        trajectories=trajectories,
        trajectories_left=len(evidence.trajectories) - len(trajectories),
        rivals=rivals_table(result),
        confusions=confusions_table(result),
        detectable=detectable_table(result),
        checks=result.checks,
        settings=result.about,
        corrected=corrected,
        colours=COLOURS,
        rows=ROWS,
    )
