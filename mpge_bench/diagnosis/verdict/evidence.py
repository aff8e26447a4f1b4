"""The numbers behind a report's plots."""

from __future__ import annotations

from dataclasses import dataclass

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
class Evidence:
    """The numbers behind the report's plots."""

    joints: tuple[JointEvidence, ...] = ()
    laws: tuple[Law, ...] = ()
    trajectories: tuple[Trajectory, ...] = ()
