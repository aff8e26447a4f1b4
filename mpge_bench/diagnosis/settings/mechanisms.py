"""Of recordings of mechanisms on a fixed base, in the order of the stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpge_bench.diagnosis.settings.setting import setting


@dataclass(frozen=True)
class DataSettings:
    """Of reading and checking recordings."""

    shortest: float = setting(0.3, "s", "a shorter recording holds no window of a few tenths of a second")
    fewest_rows: int = setting(30, "rows", "fewer do not tell noise from motion")
    still: float = setting(8.0, "standard deviations of q", "a spread that noise alone makes over thousands of rows is no motion")
    degree_ratios: tuple[float, float] = setting((40.0, 80.0), "1", "degrees change 57 times as fast as radians")
    degree_spread: float = setting(20.0, "rad", "three turns; less is common in radians")
    degree_likeness: float = setting(0.9, "correlation", "q and the sum of dq must be the same motion before their ratio says anything")
    degree_torque: float = setting(0.5, "share of the available torque", "in radians, angles must lack less than commands and gravity give")
    degree_excess: float = setting(5.0, "times", "angles as they are must lack clearly more torque than angles turned")
    degree_beyond: float = setting(3.0, "times", "and clearly more than commands and gravity give")
    degree_resolved: float = setting(0.25, "share of the accelerations", "that smoothing over half as many rows changes: beyond it, they are not known")
    quotient: float = setting(1e-4, "share of the spread of dq", "a difference quotient agrees to rounding; a measurement does not")
    late: float = setting(0.003, "s", "a filter's or a clock's lag; less is within what rows of 5 ms tell")
    late_steps: float = setting(2.0, "physics steps", "simulators themselves are a step ahead or behind")
    velocity_gain: float = setting(0.05, "1", "less is within what differentiating does to fast motion")
    velocity_told: float = setting(0.7, "share of the disagreement", "gain and lag must tell a good part of it: noise disagrees always")
    velocity_left: float = setting(0.3, "share of the spread of dq", "and leave little: so does motion too fast for the rows")
    rough_share: float = setting(0.8, "share of the velocities' spread", "second differences of a swing of seven rows a turn: fewer do not follow it")
    rough_times: float = setting(3.0, "times", "what other recordings have: noise is rough, too, but in all of them alike (within 1.4 of each other)")
    row_period: float = setting(0.005, "s", "more rows of a slow mechanism cost time and tell nothing new")
    smoothing: float = setting(0.035, "s", "half the width of the local cubics: shorter than the motion's features, longer than the noise's")
    unseen: float = setting(0.25, "share", "of the recordings, or of the time of each, that neither fits nor choices look at")
    few: int = setting(3, "recordings", "below which there is none to spare for each of fitting, choosing and judging: they are cut in time")
    quaternion: float = setting(0.01, "1", "quaternions written with two digits are off by less; others are no orientations")
    jump: float = setting(8.0, "times", "the speed of the rows around: impacts stop a body or turn it round, but nothing hurls it for a single row")
    jump_place: float = setting(1.0, "m/s", "and beyond that by as much, lest a body at rest be said to jump")
    jump_turn: float = setting(15.0, "rad/s", "the same of its orientation; what tips over is fast for a moment")
    fall: float = setting(0.05, "s", "over which it is asked whether a body falls: what falls for twice as long falls 5 cm")
    falls: float = setting(0.5, "share of gravity", "a downward acceleration below it is no free fall")
    held: float = setting(0.2, "share of the rows", "in which a body must not fall before something is said to carry it")
    sunk: float = setting(0.1, "m", "what feet give and cameras are off by; deeper, half of a body under the ground is an error of unit or origin")
    above: int = setting(200, "states", "evenly spread, that are looked at for whether a body is above the ground")
    encoder_share: float = setting(0.5, "share of the rows", "an encoder repeats its few values; a fine sensor hardly ever does")
    encoder_percentile: float = setting(5.0, "percent", "the smallest differences of distinct values are one step; a few are rounding")


@dataclass(frozen=True)
class PredictSettings:
    """Of the simulator linearised about the recorded motion, and of its own predictions."""

    warm_up: float = setting(0.4, "s", "motor sides forget where they were within about this; lags and delays are driven for longer, as their parameters say")
    shortest_window: int = setting(5, "rows", "fewer are nothing but their starting state")
    read_before: float = setting(0.2, "share of a window", "that late sensors read before it, and that is left out; of later ones nothing is")
    spare_windows: int = setting(3, "windows", "the start of a recording is only given up to warm-up where this much is left")
    disturbances: tuple[float, ...] = setting((0.002, 0.02, 0.2), "share of the asked torque", "sizes tried of the unknown torque in a row, by decades")
    difference: float = setting(1e-4, "rad, rad/s", "for derivatives of inverse dynamics: between rounding and curvature")
    softness: float = setting(1e-3, "rad/s", "least speed over which dry friction changes sign in derivatives")
    lead: float = setting(0.01, "s", "MuJoCo's dry friction turns round about this long before the velocity does, PyBullet's with it")
    coarse: float = setting(1.0, "standard deviations", "windows count less in which half the physics step changes the prediction by more than about this")
    curved: float = setting(4.0, "coarse", "where half the physics step changes predictions by as much, its error beyond first order is of that size, too")
    start_position: float = setting(20.0, "standard deviations of q", "how far the first state may lie from the first guess")
    start_velocity: float = setting(0.3, "share of the speed", "the same for velocities, which may not be measured at all")
    restarted: float = setting(40.0, "standard deviations of the smoothed state", "by which a window's best start differs where the simulator follows at all")
    started: float = setting(1e-3, "share of its column", "a starting state whose effect on the readings differs by less from the others' takes nothing away")
    refinements: int = setting(2, "passes", "of reference and noise, each about the other; a third changes next to nothing")
    outermost: float = setting(99.0, "percent", "of third differences count in the first estimate of the noise: knocks are no noise")
    rough: float = setting(
        3.0, "times", "what third differences say of the noise, which it may be at most: sensors' noise is smoother than that, but models' errors smoother yet"
    )
    held_third: float = setting(0.67, "share", "of a single recording that is fitted to; models are chosen by the rest")
    held_recordings: float = setting(0.25, "share", "of several recordings by which models are chosen; where that is not one, of two, windows of each")
    even: float = setting(0.01, "physics steps", "rows are evenly spaced if none is further off")
    unstable: float = setting(1e5, "rad/s", "Bullet itself keeps velocities below 1e6")
    horizon: float = setting(0.5, "s", "how far ahead predictions are judged: long enough to tell small effects, short enough for a linearised error")


@dataclass(frozen=True)
class HypothesisSettings:
    """Of what might be missing, and of what simulators do differently, which is nobody's fault (in units of the physics step's own error)."""

    knots: int = setting(41, "points", "of a nameless curve: fine enough for a cog, few enough for the recordings")
    least_torque: float = setting(1e-6, "N m", "of the size of things at a joint: none may be 0, as searches start from shares of it")
    least_motion: float = setting(1e-3, "rad, rad/s", "the same of angles and speeds")
    least_length: float = setting(0.02, "m", "the same of a link whose centre of mass lies on its joint")
    outermost: float = setting(0.002, "share", "of the rows at either end of a signal that have no knots of their own")
    step_error: tuple[float, float] = setting((-1.0, 3.0), "what halving the step changes", "halving removes half the error of a first-order integrator")
    implicit_damping: tuple[float, float] = setting((-1.0, 1.0), "damping × step", "damping at the step's end acts like an inertia of damping × step")
    friction_lead: tuple[float, float] = setting((-0.3, 1.3), "lead", "from PyBullet's turning point to MuJoCo's, and a little beyond either")
    motor_step: tuple[float, float] = setting((-1.0, 1.0), "physics steps", "when within a step a slow motor gets its command, and a late sensor its reading")
    descents: int = setting(20, "passes", "of coordinate descent over a handful of bounded unknowns")


@dataclass(frozen=True)
class FitSettings:
    """Of screening and fitting."""

    draws: int = setting(1000, "draws", "of the test for any mismatch at all: p down to 0.001")
    draws_left: int = setting(500, "draws", "of the test for what a model leaves over")
    draws_order: int = setting(49, "draws", "where only the order of the candidates is wanted")
    told: float = setting(0.01, "squared standard deviations", "a parameter that moves the prediction by less when it doubles is not told")
    same: float = setting(5e-4, "share of a column's length", "derivatives by differences tell two columns that differ by less from none")
    involved: float = setting(0.01, "squared share of a direction", "parameters that make up less of an untold direction are told without it")
    pieces: float = setting(10.0, "independent readings", "as good as which a window is, as evidence: a model's errors last for some rows")
    evaluations: int = setting(12, "evaluations", "of the linearised simulator in a fit")
    evaluations_tried: int = setting(5, "evaluations", "for second and third starts")
    evaluations_polish: int = setting(6, "evaluations", "before the simulator's own predictions take over")
    tolerance: float = setting(1e-4, "share of a parameter", "far below any standard error")
    cost_tolerance: float = setting(1e-5, "share of the cost", "far below any standard error")
    hold: float = setting(0.01, "standard deviations", "what the recordings do not tell stays where it started")
    robustness: float = setting(0.25, "exponent", "of the windows' weights: least squares then lower a mean of roots")
    reweightings: int = setting(2, "fits", "far from the noise the windows' weights change with the fit")
    reweighted: float = setting(0.5, "1", "weights of windows that differ by less are not worked out a second time")
    starts: int = setting(3, "starts", "are fitted, where the best one stays far from the noise")
    far_start: float = setting(3.0, "times the noise", "what counts as far from the noise for that")
    near_noise: float = setting(3.0, "times the noise", "below it laws go by the model's own prediction, whose noise is independent of the residual's")
    start_passes: int = setting(2, "passes", "over the starting states of motors, each with derivatives about the last")
    start_steps: int = setting(3, "steps", "of least squares towards them in each pass; play takes more than one")
    iterations: int = setting(1, "iterations", "in the simulator, of a draft")
    iterations_nominal: int = setting(2, "iterations", "in the simulator, of the model of no effects, which has nothing but starting states to fit")
    iterations_polish: int = setting(3, "iterations", "in the simulator, of a model that is followed up")
    gained: float = setting(1e-3, "share of the cost", "an iteration that gains less is the last")
    retreats: int = setting(2, "halvings", "of the way from absence to parameters under which the simulation flies apart, before they are no candidates")
    halvings: int = setting(3, "halvings", "of a step in the simulator that makes a model worse")
    worse: float = setting(2.0, "times", "a new starting state that costs more is dropped: the motion is chaotic there")
    rank: float = setting(1e-4, "singular values", "directions of the parameters that the recordings tell less of stay where they are")
    step_matters: float = setting(30.0, "times the noise", "the physics step is nothing to a model that misses more")
    step_passes: int = setting(2, "passes", "over the physics step's error, each from better starting states")
    step_share: tuple[float, float] = setting((-1.0, 3.0), "what halving the step changes", "bounds of the step that the recordings ask for")
    clean: float = setting(1.1, "times the noise", "below it nothing more is looked for")
    noise_change: float = setting(0.95, "share", "noise that is estimated this near the old is left as it is")
    stiffnesses: tuple[float, ...] = setting(
        (1e-4, 1e-2, 1.0), "share of the curve's own weight", "smoothness of nameless curves, chosen within the train windows"
    )
    rough: float = setting(0.02, "share of a parameter", "least step of derivatives of errors from recorded states, which joints that stick make rough")
    unstable: float = setting(1e6, "standard deviations", "residual of a model under which the simulation flies apart: no candidate")


@dataclass(frozen=True)
class ChooseSettings:
    """Of the search over models."""

    significance: float = setting(0.01, "probability", "a mismatch is reported below this probability of chance")
    open: float = setting(0.5, "probability", "to first order, that the likeliest effect does so well by chance, below which it is fitted before that is said")
    beyond_noise: float = setting(3.0, "times the noise", "what even so large a noise would not make is a mismatch: the noise is but estimated")
    fewest: int = setting(5, "windows", "that may show a mismatch by what they miss, or by what one effect explains: what fewer tell has not been measured")
    least_chance: float = setting(1e-6, "probability", "smaller ones rest on the shape of a distribution far out, and are said to be below it")
    calm: float = setting(10.0, "standard deviations", "that half the physics step changes a prediction by: windows beyond miss much by chance")
    material: float = setting(0.01, "share of the sum of squares", "an effect that explains less changes no prediction by more than a tenth of the noise")
    coarse_material: float = setting(0.1, "share of the sum of squares", "the same where both models miss much more than the noise, and for nameless curves")
    coarse: float = setting(2.0, "times the noise", "what counts as much more than the noise for that")
    wholly: float = setting(0.4, "logarithm", "of by how much all windows' misses fall to the noise where a formula need not show in validation windows")
    errors: float = setting(2.0, "standard errors", "a gain must be beyond these; near the noise")
    coarse_errors: float = setting(1.0, "standard errors", "far from the noise, where windows differ too much for two")
    far: float = setting(3.0, "times the error that noise and physics step make", "beyond it models are judged as they will be used, from recorded states")
    doubtless: float = setting(5.0, "log odds", "150 to 1: few windows are enough that are explained whole, and so much more than noise")
    touched: float = setting(0.02, "share of a window's sum of squares", "by which it differs where two models predict it differently")
    few_touched: int = setting(3, "windows", "with no more than these touched, all windows are taken")
    slight: float = setting(0.005, "share of a joint's or motor's torque", "what two simulators differ in is often mended by tiny stiffness or play: no effect")
    decisive: float = setting(1.5, "times", "an effect that is slight must lower what is missed by as much")
    beam: int = setting(3, "models", "are followed up in each round")
    most: int = setting(6, "effects", "of a model, at most")
    tried: tuple[int, int, int] = setting((12, 8, 5), "candidates", "fitted in the first round; later beside the best model; beside the others")
    pairs: int = setting(12, "pairs", "of effects, of which no single one comes near the noise, are fitted: those that promise most together")
    polished: int = setting(4, "models", "of a round are polished")
    hopeless: tuple[float, float] = setting((10.0, 4.0), "times the best", "drafts that miss more are not polished: first round; later, or beside all joints")
    reached: float = setting(0.02, "share", "where a draft misses so much less than a model, models further behind are not followed up")
    leads: float = setting(0.05, "share of what the simulator misses", "squared, that one effect leaves where others are tried beside it before other ways")
    held: float = setting(1.2, "times the noise", "a best model this near the noise leaves room for none that is far off")
    elsewhere: float = setting(30.0, "times", "more than fits leave is missed where models are chosen: what is missed acts there")
    richer: int = setting(2, "fits", "of what contains an effect of the answer, from where it may begin, are followed to the end")
    half_truth: float = setting(30.0, "times the best", "a model this far off may still be half of the truth")
    on_the_way: float = setting(30.0, "times the noise", "a model that misses more is but a step on the way")
    resting: float = setting(3.0, "standard deviations", "of a joint's velocity, within which it may stand still")
    rests: float = setting(0.05, "share of the rows", "in which a joint stands still if dry friction is tried that would hold it fast")
    holding: tuple[float, float] = setting((0.9, 0.99), "quantiles", "of what the simulator lacks in these rows: friction to begin with; some of it is noise")
    holding_leaves: float = setting(0.5, "share of what the simulator misses", "that friction which holds a joint fast leaves at most")
    holding_leads: float = setting(0.25, "share of what the simulator misses", "that friction which holds a joint leaves if others are sought beside it first")
    begun_leaves: float = setting(0.5, "share of what the simulator misses", "from recorded states, that the start of an effect leaves that is followed up")
    convergences: int = setting(4, "fits", "of a model about its own fit, at most")
    near: float = setting(3.0, "times the noise", "the simulator alone leads on from here; a plainer model must come as near to be fitted in full")
    converged: float = setting(0.05, "share", "of what is missed; a fit that gains less is the last")
    settled: float = setting(0.3, "standard errors", "an answer of which no parameter moves by more when it is fitted anew is fitted to the end")
    settlings: int = setting(8, "fits", "of the answer about its own fit, at most")
    apart: float = setting(3.3, "standard deviations", "between two models' predictions, below which data of one pass for the other's one time in twenty")
    alike: float = setting(0.1, "share of what the effect changes", "by which the linearised simulator may tell two effects apart that are one")
    known_alike: float = setting(0.5, "share of what the effect changes", "the same, of two that are known to look alike (`told_apart`)")
    step_told: float = setting(0.25, "of the squares of what half the physics step changes", "a better model has to explain: less may be the integrator's")
    step_doubt: float = setting(0.25, "share", "of what half the physics step changes by which two fitted models have to differ to be two")
    twins: int = setting(2, "models", "that may be taken for the chosen one and are plainer, or that the linearised simulator is unsure of, are fitted")
    restarts: int = setting(40, "stretches", "of the recordings, spread over them, by which effects are sought from recorded states")
    many: float = setting(0.5, "share of the joints", "that need dry friction, say, from which on all kinds of what every machine has are fitted together")
    restart_looks: tuple[int, int] = setting((8, 3), "candidates", "that promise most beside all effects, or instead of each, are predicted with")
    restart_fits: tuple[int, int] = setting((4, 2), "candidates", "of these are fitted that predict best")
    restart_evaluations: int = setting(6, "evaluations", "and derivatives, of each fit")
    formulas: int = setting(6, "formulas", "are fitted beside a model that leaves more than the noise, those that promise most")
    lone: float = setting(0.4, "share of what is missed", "a formula, one of whose starts explains as much, is tried by itself first")
    curve_passes: int = setting(3, "fits", "of a nameless curve, each about the motion as the model with it then smooths it")
    mostly: float = setting(0.5, "share of the gain", "named physics that explains as much keeps its name beside a curve over the same signal")
    pruning: float = setting(0.15, "share of the time until nothing new is begun", "in which nothing is added any more, but what is needless is left out")
    reserved: float = setting(0.18, "share of the time budget", "in which nothing new is begun: what is under way ends, and the verdict is reached")
    reserved_least: float = setting(10.0, "s", "of small budgets more: so long the verdict takes where there are a few joints")
    reserved_most: float = setting(0.35, "share of the time budget", "but no more, or nothing would be searched for")

    def are_few(self, effects: Sequence[object]) -> bool:
        """Whether these are no more than a search by single effects leads to; a model of all joints has more, and each fit of it takes long."""
        return len(effects) <= self.most


@dataclass(frozen=True)
class VerdictSettings:
    """Of what is said of the answer."""

    explained: float = setting(1.5, "times the noise", "what is left below which named physics explains a mismatch")
    confused: float = setting(0.05, "probability", "that data of one model would be taken for the other, from which on they are called indistinguishable")
    sure: float = setting(0.94, "probability", "that what nothing is said to be taken for is there: 198 of 211 effects of concealed cases of two seeds were")
    surely: float = setting(1.645, "standard deviations", "of a detectable size beyond the threshold: 19 in 20 are found, not every other one")
    small: float = setting(0.1, "share of where searches begin", "by which what an effect changes far from the noise is told: larger ones are no derivatives")
    in_proportion: float = setting(0.6, "cosine", "of what a size changes with what a small one does, below which nothing of first order holds")
    no_evidence: float = setting(0.5, "probability", "p above it is that of no evidence: how much more it takes is reckoned from here")
    interval: float = setting(2.6, "standard errors", "that a 95% interval reaches either way: 1.96 held 88% of 287, as simulators differ by more than steps")
    rivals: int = setting(8, "models", "are listed with their errors")
    ruled_out: float = setting(5.0, "log evidence", "odds of 150 to 1 against the model")
    unlikely: float = setting(3.0, "log evidence", "odds of 20 to 1 against the model")
    listed: int = setting(3, "models", "are named as ruled out")
    spelled: int = setting(6, "effects", "of a model that was ruled out are listed one by one; one of more is told by what it differs in from the answer")
    where: float = setting(0.02, "share of the residual force", "joints with less are not named")
    at_noise: float = setting(1.3, "times the noise floor", "an error below it is called the noise's")
    regime: float = setting(1.8, "times the mean", "power of the residual force in a fifth of the rows, from which on it is at home there")
    regime_share: float = setting(0.2, "share of the rows", "that a regime takes in")
    constant: float = setting(0.001, "probability", "times what was looked at, below which a parameter is said to change")
    changes: float = setting(0.25, "share of a parameter", "that it changes by at least, to be said to")
    worse: float = setting(0.05, "share of the error", "by which held-out recordings that hardly show what was found may be missed more, by chance")
    moved: float = setting(
        0.5, "share of what is missed of held-out recordings", "squared, by which what changes their predictions has to help: 131 of 132 reported answers did"
    )
    gap: float = setting(1.5, "row intervals", "a longer one is a gap")
    shown: float = setting(4.0, "s", "of a held-out recording that are drawn")
    rows: int = setting(3000, "rows", "of the residual force that are drawn")
    law_points: int = setting(301, "points", "of a law that is drawn")
    law_spread: float = setting(1e-3, "share of the signal's range", "over which dry friction changes sign in a drawn law")
