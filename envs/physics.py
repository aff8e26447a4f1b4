"""What an environment asks of whatever simulates its robot: PyBullet's `World`, or another simulator's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Physics(Protocol):
    """One robot in a world of its own, in the generalized coordinates q and velocities dq that `World` describes.

    Attributes:
        q, dq: the state now; each step replaces them by new arrays.
    """

    q: Array
    dq: Array

    @property
    def joints(self) -> Sequence[str]:
        """Movable joints in the order of q and dq."""
        ...

    @property
    def floating(self) -> bool:
        """Whether the base's coordinates come before the joints'."""
        ...

    def set_state(self, q: Array | Sequence[float], dq: Array | Sequence[float]) -> None:
        """Put the robot at `q` and `dq`; the next `step` is then the same whatever the world did before."""

    def step(self, command: Sequence[float]) -> None:
        """Advance one control step under joint torques `command`, N m or N, held throughout."""

    def recall(self, commands: Array, q: Array, dq: Array) -> None:
        """Let hidden states live through a recorded motion up to now; see `World.recall`."""

    def read(self) -> tuple[Array, Array]:
        """What the sensors tell of q and dq now."""
        ...


class Simulator(Protocol):
    """Another simulator than PyBullet, as the target of a pair."""

    @property
    def name(self) -> str:
        """For people."""
        ...

    def lacks(self) -> str:
        """What is not installed and how to get it, in one line; "" where nothing is missing."""
        ...

    def world(self, joints: Sequence[str]) -> Physics:
        """A new world with the robot that has these movable joints.

        Raises:
            UserError: if something is not installed.
        """
        ...
