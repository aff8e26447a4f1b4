"""Every threshold, constant and budget of the diagnosis: its value, its unit and its reason, in the order of the stages. All are stored in diagnosis.json.

What only keeps a division or an inverse from failing (1e-9 and the like) stays where it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


def _setting(value: Any, unit: str, reason: str) -> Any:
    return field(default=value, metadata={"unit": unit, "reason": reason})


@dataclass(frozen=True)
class DataSettings:
    """Of reading and checking recordings."""

    shortest: float = _setting(0.3, "s", "a shorter recording holds no window of a few tenths of a second")
    fewest_rows: int = _setting(30, "rows", "fewer do not tell noise from motion")
    still: float = _setting(8.0, "standard deviations of q", "a spread that noise alone makes over thousands of rows is no motion")
    degree_ratios: tuple[float, float] = _setting((40.0, 80.0), "1", "degrees change 57 times as fast as radians")
    degree_spread: float = _setting(20.0, "rad", "three turns; less is common in radians")
    degree_likeness: float = _setting(0.9, "correlation", "q and the sum of dq must be the same motion before their ratio says anything")
    degree_torque: float = _setting(0.5, "share of the available torque", "in radians, angles must lack less than commands and gravity give")
    degree_excess: float = _setting(5.0, "times", "angles as they are must lack clearly more torque than angles turned")
    degree_beyond: float = _setting(3.0, "times", "and clearly more than commands and gravity give")
    degree_resolved: float = _setting(
        0.25, "share of the accelerations", "that smoothing over half as many rows changes: beyond it, they are not known"
    )
    quotient: float = _setting(1e-4, "share of the spread of dq", "a difference quotient agrees to rounding; a measurement does not")
    late: float = _setting(0.003, "s", "a filter's or a clock's lag; less is within what rows of 5 ms tell")
    late_steps: float = _setting(2.0, "physics steps", "simulators themselves are a step ahead or behind")
    velocity_gain: float = _setting(0.05, "1", "less is within what differentiating does to fast motion")
    velocity_told: float = _setting(0.7, "share of the disagreement", "gain and lag must tell a good part of it: noise disagrees always")
    velocity_left: float = _setting(0.3, "share of the spread of dq", "and leave little: so does motion too fast for the rows")
    rough_share: float = _setting(0.8, "share of the velocities' spread", "second differences of a swing of seven rows a turn: fewer do not follow it")
    rough_times: float = _setting(3.0, "times", "what other recordings have: noise is rough, too, but in all of them alike (within 1.4 of each other)")
    row_period: float = _setting(0.005, "s", "more rows of a slow mechanism cost time and tell nothing new")
    smoothing: float = _setting(0.035, "s", "half the width of the local cubics: shorter than the motion's features, longer than the noise's")
    unseen: float = _setting(0.25, "share", "of the recordings, or of the time of each, that neither fits nor choices look at")
    few: int = _setting(3, "recordings", "below which there is none to spare for each of fitting, choosing and judging: they are cut in time")
    quaternion: float = _setting(0.01, "1", "quaternions written with two digits are off by less; others are no orientations")
    jump: float = _setting(8.0, "times", "the speed of the rows around: impacts stop a body or turn it round, but nothing hurls it for a single row")
    jump_place: float = _setting(1.0, "m/s", "and beyond that by as much, lest a body at rest be said to jump")
    jump_turn: float = _setting(15.0, "rad/s", "the same of its orientation; what tips over is fast for a moment")
    fall: float = _setting(0.05, "s", "over which it is asked whether a body falls: what falls for twice as long falls 5 cm")
    falls: float = _setting(0.5, "share of gravity", "a downward acceleration below it is no free fall")
    held: float = _setting(0.2, "share of the rows", "in which a body must not fall before something is said to carry it")
    encoder_share: float = _setting(0.5, "share of the rows", "an encoder repeats its few values; a fine sensor hardly ever does")
    encoder_percentile: float = _setting(5.0, "percent", "the smallest differences of distinct values are one step; a few are rounding")


@dataclass(frozen=True)
class PredictSettings:
    """Of the simulator linearised about the recorded motion, and of its own predictions."""

    warm_up: float = _setting(0.4, "s", "motor sides forget where they were within about this; lags and delays are driven for longer, as their parameters say")
    shortest_window: int = _setting(5, "rows", "fewer are nothing but their starting state")
    spare_windows: int = _setting(3, "windows", "the start of a recording is only given up to warm-up where this much is left")
    disturbances: tuple[float, ...] = _setting((0.002, 0.02, 0.2), "share of the asked torque", "sizes tried of the unknown torque in a row, by decades")
    difference: float = _setting(1e-4, "rad, rad/s", "for derivatives of inverse dynamics: between rounding and curvature")
    softness: float = _setting(1e-3, "rad/s", "least speed over which dry friction changes sign in derivatives")
    lead: float = _setting(0.01, "s", "MuJoCo's dry friction turns round about this long before the velocity does, PyBullet's with it")
    coarse: float = _setting(1.0, "standard deviations", "windows count less in which half the physics step changes the prediction by more than about this")
    curved: float = _setting(4.0, "coarse", "where half the physics step changes predictions by as much, its error beyond first order is of that size, too")
    start_position: float = _setting(20.0, "standard deviations of q", "how far the first state may lie from the first guess")
    start_velocity: float = _setting(0.3, "share of the speed", "the same for velocities, which may not be measured at all")
    started: float = _setting(1e-3, "share of its column", "a starting state whose effect on the readings differs by less from the others' takes nothing away")
    refinements: int = _setting(2, "passes", "of reference and noise, each about the other; a third changes next to nothing")
    outermost: float = _setting(99.0, "percent", "of third differences count in the first estimate of the noise: knocks are no noise")
    rough: float = _setting(
        3.0, "times", "what third differences say of the noise, which it may be at most: sensors' noise is smoother than that, but models' errors smoother yet"
    )
    held_third: float = _setting(0.67, "share", "of a single recording that is fitted to; models are chosen by the rest")
    held_recordings: float = _setting(0.25, "share", "of several recordings by which models are chosen; where that is not one, of two, windows of each")
    even: float = _setting(0.01, "physics steps", "rows are evenly spaced if none is further off")
    unstable: float = _setting(1e5, "rad/s", "Bullet itself keeps velocities below 1e6")
    horizon: float = _setting(0.5, "s", "how far ahead predictions are judged: long enough to tell small effects, short enough for a linearised error")


@dataclass(frozen=True)
class HypothesisSettings:
    """Of what might be missing, and of what simulators do differently, which is nobody's fault (in units of the physics step's own error)."""

    knots: int = _setting(41, "points", "of a nameless curve: fine enough for a cog, few enough for the recordings")
    least_torque: float = _setting(1e-6, "N m", "of the size of things at a joint: none may be 0, as searches start from shares of it")
    least_motion: float = _setting(1e-3, "rad, rad/s", "the same of angles and speeds")
    least_length: float = _setting(0.02, "m", "the same of a link whose centre of mass lies on its joint")
    outermost: float = _setting(0.002, "share", "of the rows at either end of a signal that have no knots of their own")
    step_error: tuple[float, float] = _setting((-1.0, 3.0), "what halving the step changes", "halving removes half the error of a first-order integrator")
    implicit_damping: tuple[float, float] = _setting(
        (-1.0, 1.0), "damping × step", "damping at the step's end acts like an inertia of damping × step"
    )
    friction_lead: tuple[float, float] = _setting((-0.3, 1.3), "lead", "from PyBullet's turning point to MuJoCo's, and a little beyond either")
    motor_step: tuple[float, float] = _setting((-1.0, 1.0), "physics steps", "when within a step a slow motor gets its command, and a late sensor its reading")
    descents: int = _setting(20, "passes", "of coordinate descent over a handful of bounded unknowns")


@dataclass(frozen=True)
class FitSettings:
    """Of screening and fitting."""

    draws: int = _setting(1000, "draws", "of the test for any mismatch at all: p down to 0.001")
    draws_left: int = _setting(500, "draws", "of the test for what a model leaves over")
    draws_order: int = _setting(49, "draws", "where only the order of the candidates is wanted")
    told: float = _setting(0.01, "squared standard deviations", "a parameter that moves the prediction by less when it doubles is not told")
    same: float = _setting(5e-4, "share of a column's length", "derivatives by differences tell two columns that differ by less from none")
    involved: float = _setting(0.01, "squared share of a direction", "parameters that make up less of an untold direction are told without it")
    evaluations: int = _setting(12, "evaluations", "of the linearised simulator in a fit")
    evaluations_tried: int = _setting(5, "evaluations", "for second and third starts")
    evaluations_polish: int = _setting(6, "evaluations", "before the simulator's own predictions take over")
    tolerance: float = _setting(1e-4, "share of a parameter", "far below any standard error")
    cost_tolerance: float = _setting(1e-5, "share of the cost", "far below any standard error")
    hold: float = _setting(0.01, "standard deviations", "what the recordings do not tell stays where it started")
    robustness: float = _setting(0.25, "exponent", "of the windows' weights: least squares then lower a mean of roots")
    reweightings: int = _setting(2, "fits", "far from the noise the windows' weights change with the fit")
    reweighted: float = _setting(0.5, "1", "weights of windows that differ by less are not worked out a second time")
    starts: int = _setting(3, "starts", "are fitted, where the best one stays far from the noise")
    far_start: float = _setting(3.0, "times the noise", "what counts as far from the noise for that")
    near_noise: float = _setting(3.0, "times the noise", "below it laws go by the model's own prediction, whose noise is independent of the residual's")
    start_passes: int = _setting(2, "passes", "over the starting states of motors, each with derivatives about the last")
    start_steps: int = _setting(3, "steps", "of least squares towards them in each pass; play takes more than one")
    iterations: int = _setting(1, "iterations", "in the simulator, of a draft")
    iterations_nominal: int = _setting(2, "iterations", "in the simulator, of the model of no effects, which has nothing but starting states to fit")
    iterations_polish: int = _setting(3, "iterations", "in the simulator, of a model that is followed up")
    gained: float = _setting(1e-3, "share of the cost", "an iteration that gains less is the last")
    halvings: int = _setting(3, "halvings", "of a step in the simulator that makes a model worse")
    worse: float = _setting(2.0, "times", "a new starting state that costs more is dropped: the motion is chaotic there")
    rank: float = _setting(1e-4, "singular values", "directions of the parameters that the recordings tell less of stay where they are")
    step_matters: float = _setting(30.0, "times the noise", "the physics step is nothing to a model that misses more")
    step_passes: int = _setting(2, "passes", "over the physics step's error, each from better starting states")
    step_share: tuple[float, float] = _setting((-1.0, 3.0), "what halving the step changes", "bounds of the step that the recordings ask for")
    clean: float = _setting(1.1, "times the noise", "below it nothing more is looked for")
    noise_change: float = _setting(0.95, "share", "noise that is estimated this near the old is left as it is")
    stiffnesses: tuple[float, ...] = _setting(
        (1e-4, 1e-2, 1.0), "share of the curve's own weight", "smoothness of nameless curves, chosen within the train windows"
    )
    rough: float = _setting(0.02, "share of a parameter", "least step of derivatives of errors from recorded states, which joints that stick make rough")
    unstable: float = _setting(1e6, "standard deviations", "residual of a model under which the simulation flies apart: no candidate")


@dataclass(frozen=True)
class ChooseSettings:
    """Of the search over models."""

    significance: float = _setting(0.01, "probability", "a mismatch is reported below this probability of chance")
    beyond_noise: float = _setting(3.0, "times the noise", "what even so large a noise would not make is a mismatch: the noise is but estimated")
    least_chance: float = _setting(1e-6, "probability", "smaller ones rest on the shape of a distribution far out, and are said to be below it")
    calm: float = _setting(10.0, "standard deviations", "that half the physics step changes a prediction by: windows beyond miss much by chance")
    material: float = _setting(0.01, "share of the sum of squares", "an effect that explains less changes no prediction by more than a tenth of the noise")
    coarse_material: float = _setting(0.1, "share of the sum of squares", "the same where both models miss much more than the noise, and for nameless curves")
    coarse: float = _setting(2.0, "times the noise", "what counts as much more than the noise for that")
    errors: float = _setting(2.0, "standard errors", "a gain must be beyond these; near the noise")
    coarse_errors: float = _setting(1.0, "standard errors", "far from the noise, where windows differ too much for two")
    far: float = _setting(3.0, "times the error that noise and physics step make", "beyond it models are judged as they will be used, from recorded states")
    touched: float = _setting(0.02, "share of a window's sum of squares", "by which it differs where two models predict it differently")
    few_touched: int = _setting(3, "windows", "with no more than these touched, all windows are taken")
    slight: float = _setting(0.005, "share of the joint's torque", "what two simulators differ in is often mended by tiny stiffness, play or lag: no effect")
    decisive: float = _setting(1.5, "times", "an effect that is slight must lower what is missed by as much")
    beam: int = _setting(3, "models", "are followed up in each round")
    most: int = _setting(6, "effects", "of a model, at most")
    tried: tuple[int, int, int] = _setting((12, 8, 5), "candidates", "fitted in the first round; later beside the best model; beside the others")
    pairs: int = _setting(12, "pairs", "of effects, of which no single one comes near the noise, are fitted: those that promise most together")
    polished: int = _setting(4, "models", "of a round are polished")
    hopeless: tuple[float, float] = _setting((10.0, 4.0), "times the best", "drafts that miss more are not polished: first round; later, or beside all joints")
    reached: float = _setting(0.02, "share", "where a draft misses so much less than a model, models further behind are not followed up")
    held: float = _setting(1.2, "times the noise", "a best model this near the noise leaves room for none that is far off")
    elsewhere: float = _setting(30.0, "times", "more than fits leave is missed where models are chosen: what is missed acts there")
    half_truth: float = _setting(30.0, "times the best", "a model this far off may still be half of the truth")
    on_the_way: float = _setting(30.0, "times the noise", "a model that misses more is but a step on the way")
    convergences: int = _setting(4, "fits", "of a model about its own fit, at most")
    near: float = _setting(3.0, "times the noise", "the simulator alone leads on from here; a plainer model must come as near to be fitted in full")
    converged: float = _setting(0.05, "share", "of what is missed; a fit that gains less is the last")
    settled: float = _setting(0.3, "standard errors", "an answer of which no parameter moves by more when it is fitted anew is fitted to the end")
    settlings: int = _setting(8, "fits", "of the answer about its own fit, at most")
    apart: float = _setting(3.3, "standard deviations", "between two models' predictions, below which data of one pass for the other's one time in twenty")
    alike: float = _setting(0.1, "share of what the effect changes", "by which the linearised simulator may tell two effects apart that are one")
    twins: int = _setting(2, "models", "that may be taken for the chosen one and are plainer, or that the linearised simulator is unsure of, are fitted")
    restarts: int = _setting(40, "stretches", "of the recordings, spread over them, by which effects are sought from recorded states")
    restart_looks: tuple[int, int] = _setting((8, 3), "candidates", "that promise most beside all effects, or instead of each, are predicted with")
    restart_fits: tuple[int, int] = _setting((4, 2), "candidates", "of these are fitted that predict best")
    restart_evaluations: int = _setting(6, "evaluations", "and derivatives, of each fit")
    formulas: int = _setting(6, "formulas", "are fitted beside a model that leaves more than the noise, those that promise most")
    lone: float = _setting(0.4, "share of what is missed", "a formula, one of whose starts explains as much, is tried by itself first")
    curve_passes: int = _setting(3, "fits", "of a nameless curve, each about the motion as the model with it then smooths it")
    mostly: float = _setting(0.5, "share of the gain", "named physics that explains as much keeps its name beside a curve over the same signal")
    reserved: float = _setting(0.18, "share of the time budget", "in which nothing new is begun: what is under way ends, and the verdict is reached")
    reserved_least: float = _setting(10.0, "s", "of small budgets more: so long the verdict takes where there are a few joints")
    reserved_most: float = _setting(0.35, "share of the time budget", "but no more, or nothing would be searched for")


@dataclass(frozen=True)
class VerdictSettings:
    """Of what is said of the answer."""

    explained: float = _setting(1.5, "times the noise", "what is left below which named physics explains a mismatch")
    confused: float = _setting(0.05, "probability", "that data of one model would be taken for the other, from which on they are called indistinguishable")
    surely: float = _setting(1.645, "standard deviations", "of a detectable size beyond the threshold: 19 in 20 are found, not every other one")
    no_evidence: float = _setting(0.5, "probability", "p above it is that of no evidence: how much more it takes is reckoned from here")
    interval: float = _setting(2.6, "standard errors", "that a 95% interval reaches either way: 1.96 held 88% of 287, as simulators differ by more than steps")
    rivals: int = _setting(8, "models", "are listed with their errors")
    ruled_out: float = _setting(5.0, "log evidence", "odds of 150 to 1 against the model")
    unlikely: float = _setting(3.0, "log evidence", "odds of 20 to 1 against the model")
    listed: int = _setting(3, "models", "are named as ruled out")
    where: float = _setting(0.02, "share of the residual force", "joints with less are not named")
    at_noise: float = _setting(1.3, "times the noise floor", "an error below it is called the noise's")
    regime: float = _setting(1.8, "times the mean", "power of the residual force in a fifth of the rows, from which on it is at home there")
    regime_share: float = _setting(0.2, "share of the rows", "that a regime takes in")
    constant: float = _setting(0.001, "probability", "times what was looked at, below which a parameter is said to change")
    changes: float = _setting(0.25, "share of a parameter", "that it changes by at least, to be said to")
    gap: float = _setting(1.5, "row intervals", "a longer one is a gap")
    shown: float = _setting(4.0, "s", "of a held-out recording that are drawn")
    rows: int = _setting(3000, "rows", "of the residual force that are drawn")
    law_points: int = _setting(301, "points", "of a law that is drawn")
    law_spread: float = _setting(1e-3, "share of the signal's range", "over which dry friction changes sign in a drawn law")


@dataclass(frozen=True)
class ReplaySettings:
    """Of transitions of a robot of the benchmark (`mpge_bench.diagnosis.transitions`)."""

    unseen: float = _setting(0.25, "share", "of the transitions, the last of each episode's, that neither fits nor choices look at")
    settle: int = _setting(5, "rows", "after which what the simulator remembers (motors on springs, commands on their way) is nearly that of the target")
    worst: float = _setting(1e3, "spreads of a step's change", "residuals are cut off at, lest a simulation that flies apart decide")
    least_torque: float = _setting(1.0, "N m", "of a motor whose commands are angles: searches start from shares of it")
    least_motion: float = _setting(1e-3, "rad, rad/s", "the same of angles and speeds")
    least_length: float = _setting(0.05, "m", "the same of links")
    remembered: int = _setting(10, "rows", "of which a delay is sought within the first half: more than that is not known of a stretch within an episode")
    screening: int = _setting(20_000, "rows", "predicted to look at all hypotheses once: half a minute")
    fewest: int = _setting(30, "rows", "are looked at first, however many hypotheses there are")
    most_rows: int = _setting(120, "rows", "are looked at first, however few")
    stretch: int = _setting(15, "rows", "in a row, for what remembers")
    drafted: int = _setting(2_400, "entries", "of observations that drafts are fitted to: a transition tells more where more is observed")
    room: float = _setting(1.0, "times what the source leaves of its own", "that a right model may leave")
    fitted: int = _setting(4_800, "entries", "that models are fitted to in the end")
    fitted_noisy: int = _setting(9_600, "entries", "the same where there is noise to average out")
    trusts: tuple[float, ...] = _setting((0.1, 0.2, 0.3, 0.5, 0.7, 1.0), "shares of a difference", "tried, of which the source's own transitions choose")
    beyond_chance: float = _setting(2.0, "standard errors", "between descriptions that are said to differ, where there is noise")
    checked: int = _setting(24, "hypotheses", "are looked at a second time, at the parameters that the first look proposes")
    strides: tuple[float, ...] = _setting((4.0, 16.0), "times the first look's proposal", "tried, too: it falls short where the mismatch is large")
    tried: int = _setting(10, "hypotheses", "are fitted in each round")
    companion: float = _setting(0.1, "share of what is left", "that one more of a kind must explain, to be looked at with the others")
    promising: float = _setting(0.05, "share of the best look's gain", "looks that promise less are not followed up")
    polished: int = _setting(3, "models", "of a round are fitted to the end")
    iterations_first: int = _setting(2, "iterations", "of all drafts")
    followed: int = _setting(5, "drafts", "of a round, the best after these, go on")
    iterations: int = _setting(4, "iterations", "of those: enough to see which come near")
    iterations_polish: int = _setting(15, "iterations", "of a model that is followed up")
    walks: tuple[float, ...] = _setting((), "shares of a parameter", "steps of a walk after least squares: transitions are smooth enough without")
    softness: float = _setting(2.0, "times the median", "residuals beyond count less in fits: contacts that come a step sooner or later")
    shared: float = _setting(0.1, "share of all entries' median", "least scale of one entry's residuals, lest what fits already hold the rest")
    exact_share: float = _setting(0.998, "share of the entries, or of the transitions", "in which nothing but rounding is left where a model is exact")
    exact_draft: float = _setting(0.97, "share of the entries", "what one parameter must explain for no hypothesis of several to be looked at")
    typical: float = _setting(0.5, "quantile", "of the sizes of residuals, that is their scale; higher where most of them are but rounding")
    exact: float = _setting(1e-8, "spreads of a step's change", "what is missed below this is rounding, which is about 1e-12")
    difference: float = _setting(1e-4, "share of a parameter", "for derivatives")
    least_difference: float = _setting(1e-7, "share of a parameter", "the same at the end of a fit: far above rounding")
    least_component: float = _setting(1e-3, "share of a vector's largest component", "in which the others are sought, however small: they have one unit")
    nearly: float = _setting(1e-5, "spreads of a step's change", "less is missed where a fit of the right effects came to a stop too soon, without noise")
    finishing: float = _setting(1e-6, "share of a parameter, and of the cost", "for derivatives and to end, where many parameters are made exact")
    jump: float = _setting(20.0, "times what nine of ten rows that answer do not exceed", "beyond it is a jump, as of a contact that comes a step sooner")
    answers: float = _setting(1e-9, "share of the largest slope", "rows with less do not answer to a parameter at all")
    converged: float = _setting(1e-3, "share of the cost", "an iteration that gains less is the last")
    dampings: int = _setting(4, "trials", "of shorter and shorter steps, each ten times as much damped, before a fit ends")
    dampings_first: int = _setting(8, "trials", "the same in the first iteration")
    material: float = _setting(0.01, "nats an entry", "an effect that explains less is not taken in")
    equal: float = _setting(0.005, "nats an entry", "models that differ by less are told apart by how plain they are")
    near: float = _setting(3.0, "times", "what a draft may miss of what a model does, to have a chance in its place")
    most: int = _setting(6, "hypotheses", "of a model, at most")
    rounds: int = _setting(2, "rounds", "after which, where something is left, all that robots of one make usually differ by is fitted at once")
    block: int = _setting(5, "rows", "neighbouring ones, whose noise is alike, count as one piece of evidence")
    apart: int = _setting(30, "rows", "after which what is missed has forgotten what was put right, most of it within ten")
    leftover: float = _setting(0.01, "probability", "that as much as a model leaves is noise, below which more is looked for")
    told: float = _setting(1e-8, "squared scales of what is missed", "a parameter that moves a row by less when it doubles is not told")
    significance: float = _setting(0.001, "probability", "a mismatch is reported below it: at .01 a hundred sources held against themselves alarm once")
    draws: int = _setting(4999, "draws", "of the permutation test for any mismatch: tests count twice, and are to fall well below that")
    suspects: int = _setting(5, "hypotheses", "along which most more is missed than the source misses of its own, are held against all its sets")
    own_sets: int = _setting(8, "sets", "of the source's own transitions, each as many as the target's: they cost nothing, and tell how sets differ by chance")
    certain: float = _setting(1e-6, "probability", "what is said of a mismatch that shows without noise: the simulator repeats itself bit for bit")
    freedom: float = _setting(2.0, "degrees of freedom", "of the t distribution of residuals: contacts make far outliers")


@dataclass(frozen=True)
class FreeSettings:
    """Of recordings of what moves freely or touches something (`mpge_bench.diagnosis.free`)."""

    smoothing: float = _setting(0.02, "s", "half the width of the parabolas that give velocities: a few rows between two impacts")
    least_noise: float = _setting(1e-5, "m, rad", "recordings made by a simulator may have none at all")
    late: float = _setting(0.25, "rows", "recorded velocities that lag by more are difference quotients, half a row late")
    calm: float = _setting(2.0, "standard deviations", "misfit of parabolas up to which the poses tell velocities")
    doubt: float = _setting(2.0, "times", "what the noise makes of a parabola's slope: motion is no parabola")
    even: float = _setting(0.05, "rows", "rows may come that much sooner or later")
    window: float = _setting(0.1, "s", "an impact shows within it, and the next one does not yet make the motion chaotic")
    fewest_rows: int = _setting(5, "rows", "of a window: fewer are nothing but their start")
    moved: float = _setting(30.0, "standard deviations of q", "what moves less within a window tells nothing")
    stirred: float = _setting(8.0, "standard deviations of q", "the same where few windows move by as much: more than the noise alone looks like")
    run_in: int = _setting(2, "rows", "before a window's start through which the simulator runs: a solver needs a few steps to be warm")
    screening: int = _setting(3000, "windows", "predicted to look at all hypotheses once, and again for the test")
    fewest: int = _setting(24, "windows", "are looked at, however many hypotheses there are")
    few: int = _setting(60, "windows", "are looked at, and drafts fitted to, however few hypotheses there are")
    checked: int = _setting(8, "hypotheses", "are looked at a second time")
    tried: int = _setting(4, "hypotheses", "are fitted in each round: each costs dozens of seconds")
    polished: int = _setting(2, "models", "of a round are fitted to the end")
    iterations: int = _setting(1, "iterations", "of least squares in a draft, before the walk")
    iterations_polish: int = _setting(2, "iterations", "of a model that is followed up")
    walks: tuple[float, ...] = _setting((0.2, 0.05), "shares of a parameter", "steps of a walk after least squares, which contacts bring to a stop too soon")
    difference: float = _setting(0.1, "share of a parameter", "for derivatives: with a hundredth, fits stop at the jerks of single contacts")
    choosing: float = _setting(0.25, "share", "of what is searched on, by which models are chosen that were fitted to the rest")
    judged: int = _setting(8, "models", "the best ones, are held against what models are chosen by")
    fast: float = _setting(0.3, "m/s", "a change of speed within two rows either way from which a touch is an impact")
    slow: float = _setting(0.05, "m/s", "below which a body that touches the ground is at rest, with the next")
    slow_turn: float = _setting(0.3, "rad/s", "the same of its spin, and of joints")
    touch: float = _setting(0.003, "m", "from the ground, up to which a body touches it: tables are no planes")
    windows: int = _setting(240, "windows", "of what is searched on, at most: a second or two of simulator for each model")
    unseen_windows: int = _setting(160, "windows", "that are held out, at most")
    outlying: float = _setting(5.0, "standard deviations", "what is missed by more tells of the simulator, not of where a window started")
    worst: float = _setting(1e5, "standard deviations", "residuals are cut off at, lest a simulation that flies apart decide")


@dataclass(frozen=True)
class DiagnosisSettings:
    """All of them, by stage."""

    data: DataSettings = DataSettings()
    predict: PredictSettings = PredictSettings()
    hypotheses: HypothesisSettings = HypothesisSettings()
    fit: FitSettings = FitSettings()
    choose: ChooseSettings = ChooseSettings()
    verdict: VerdictSettings = VerdictSettings()
    replay: ReplaySettings = ReplaySettings()
    free: FreeSettings = FreeSettings()

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
