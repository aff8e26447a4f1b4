"""What a diagnosis shows beside its verdict: the numbers behind the report's plots and tables."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class JointEvidence:
    """Force that the simulator lacks at one joint, row by row of all recordings, thinned out to a few thousand rows.

    Attributes:
        unit: of the force, N m or N; `angle` and `speed` are the units of q and dq.
        share: of all joints' residual force before, 0 to 1.
        noise: standard deviation of the residual force that the sensors' noise alone makes.
    """

    joint: str
    unit: str
    angle: str
    speed: str
    share: float
    noise: float
    time: Array
    q: Array
    dq: Array
    command: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class Law:
    """The torque that a fitted effect adds to a joint, as a curve over the signal it depends on (dq, q or command), for drawing through `before`."""

    effect: str
    joint: str
    signal: str
    at: Array
    torque: Array


@dataclass(frozen=True)
class Trajectory:
    """A stretch of a held-out recording, predicted from its windows' starts by the nominal and by the corrected simulator."""

    recording: str
    joint: str
    unit: str
    time: Array
    measured: Array
    before: Array
    after: Array
    #: Times at which the predictions start anew from the recorded state.
    restarts: Array


@dataclass(frozen=True)
class Rival:
    """A model that was tried: its effects, its held-out error (same unit as the fit's) and how much log evidence it is behind the chosen one."""

    effects: str
    parameters: str
    held_out_error: float
    log_evidence_behind: float


@dataclass(frozen=True)
class Confusion:
    """Models that these recordings cannot tell apart, and the experiment that would."""

    models: tuple[str, str]
    experiment: str


@dataclass(frozen=True)
class Detectable:
    """Smallest size of an effect that these recordings would have shown."""

    effect: str
    target: str
    parameter: str
    size: float
    unit: str


@dataclass(frozen=True)
class Evidence:
    """All of it.

    Attributes:
        summary: the verdict in plain lines.
        checks: what the look at the data said (noise, sampling, channels left out), one sentence each.
        settings: horizon, recordings used for training and held out, seconds taken.
    """

    summary: tuple[str, ...]
    joints: tuple[JointEvidence, ...]
    laws: tuple[Law, ...]
    trajectories: tuple[Trajectory, ...]
    rivals: tuple[Rival, ...]
    confusions: tuple[Confusion, ...]
    detectable: tuple[Detectable, ...]
    checks: tuple[str, ...]
    settings: dict[str, str] = field(default_factory=dict)
