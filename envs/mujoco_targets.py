"""Gymnasium's own MuJoCo robots as targets of our PyBullet sources: same task, other simulator, contact model and integrator.

What is Gymnasium's: model file (masses, inertias, damping, armature, frictions, soft contacts and end stops), integrator, physics and control step. What is
ours, so that source and target are one task: order, signs and units of q, dq, actions and observations (which agree but for the zero of the
half-cheetah's height and MuJoCo's order of a quaternion), initial states, reward and the end of an episode. Gymnasium's own terms of the reward give the
same but for this: on the step that ends an episode, Gymnasium's hopper, walker and ant are not paid for staying up, ours are; Gymnasium's ant pays for
contact forces, which ours does not observe, and its speed is that of a physics step (10 ms) before.

The robots differ by more than the simulator. MuJoCo takes the volumes of capsules as they are, where the published masses that our sources have came from
an older formula: its hopper and walker weigh 4% more. Gymnasium's walker has the same friction on both feet, since its version 5. What our sources
lack of MuJoCo's armature stands in each robot's docstring.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import BASE_DQ, BASE_Q, checked_state
from mpge_bench.envs.physics import Array

#: MuJoCo's x, y, z, then w, x, y, z as ours: x, y, z, then x, y, z, w; and back.
_OURS, _THEIRS = [0, 1, 2, 4, 5, 6, 3], [0, 1, 2, 6, 3, 4, 5]
#: What Gymnasium's MuJoCo environments import.
_PACKAGES = ("mujoco", "imageio")


class MujocoWorld:
    """The robot of a Gymnasium MuJoCo environment behind the interface of `World`: `physics.Physics`.

    Args:
        id: Gymnasium's.
        joints: our names of the movable joints, in the order of q; Gymnasium's may lack our ending ``_joint``.

    Raises:
        ValueError: if the environment's joints are others.
    """

    def __init__(self, id: str, joints: Sequence[str]) -> None:
        self._mujoco = mujoco = _mujoco()
        with _unheard():
            env: Any = gymnasium.make(id).unwrapped
        self._model, self._data, self._frames = env.model, env.data, env.frame_skip
        model = self._model
        self.floating = bool(model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE)
        names = [model.joint(index).name for index in range(int(self.floating), model.njnt)]
        if [name.removesuffix("_joint") for name in joints] != [name.removesuffix("_joint") for name in names]:
            raise ValueError(f"{id} has the joints {', '.join(names)}, not {', '.join(joints)}")
        self.joints = tuple(joints)
        #: What to add to qpos for our q: a planar robot's height is that of its torso, from wherever the file counts.
        self._datum = np.zeros(model.nq)
        if not self.floating:
            height = names.index("rootz")
            self._datum[height] = model.body_pos[model.jnt_bodyid[height], 2] - model.qpos0[height]
        driven = model.actuator_trnid[:, 0] - int(self.floating)
        #: Where each actuator's joint stands among `joints`, and its gear, N m per unit of control.
        self._drives = list(zip(driven.tolist(), model.actuator_gear[:, 0].tolist(), strict=True))
        self.q, self.dq = self._state()

    def set_state(self, q: Array | Sequence[float], dq: Array | Sequence[float]) -> None:
        """Put the robot at `q` and `dq`, forgetting all else (MuJoCo starts its solver from the last step's accelerations).

        Raises:
            UserError: if a length is wrong, a value is not finite or a quaternion is 0.
        """
        q, dq = checked_state(q, dq, self.q.shape, self.dq.shape, floating=self.floating)
        self._mujoco.mj_resetData(self._model, self._data)
        if self.floating:
            self._data.qpos[:BASE_Q], self._data.qpos[BASE_Q:] = q[_THEIRS], q[BASE_Q:]
            self._data.qvel[:] = dq
            self._data.qvel[3:BASE_DQ] = self._turned(dq[3:BASE_DQ], back=True)
        else:
            self._data.qpos[:], self._data.qvel[:] = q - self._datum, dq
        self.q, self.dq = q, dq

    def step(self, command: Sequence[float]) -> None:
        """One control step of Gymnasium's under joint torques `command`, N m; what no actuator drives is not driven.

        Raises:
            UserError: if a torque is not finite.
        """
        if not math.isfinite(math.fsum(command)):
            raise UserError(f"step takes finite torques; got {list(command)}")
        self._data.ctrl[:] = [command[joint] / gear for joint, gear in self._drives]
        self._mujoco.mj_step(self._model, self._data, nstep=self._frames)
        self.q, self.dq = self._state()

    def recall(self, commands: Array, q: Array, dq: Array) -> None:
        """Nothing: q and dq are the whole state of these robots."""

    def read(self) -> tuple[Array, Array]:
        """q and dq: the sensors tell the truth."""
        return self.q, self.dq

    def _state(self) -> tuple[Array, Array]:
        q, dq = self._data.qpos + self._datum, self._data.qvel.copy()
        if self.floating:
            q[:BASE_Q] = q[_OURS]
            dq[3:BASE_DQ] = self._turned(dq[3:BASE_DQ], back=False)
        return q, dq

    def _turned(self, spin: Array, *, back: bool) -> Array:
        """Angular velocity along the world's axes from one along the base's own, as MuJoCo has it; or `back`."""
        turn, turned = self._data.qpos[3:BASE_Q].copy(), np.empty(3)
        if back:
            turn[1:] *= -1
        self._mujoco.mju_rotVecQuat(turned, np.ascontiguousarray(spin), turn)
        return turned


@dataclass(frozen=True)
class Mujoco:
    """A robot of Gymnasium's in MuJoCo, as a pair's target (`physics.Simulator`)."""

    id: str

    @property
    def name(self) -> str:
        return f"MuJoCo, Gymnasium's {self.id}"

    def lacks(self) -> str:
        missing = any(importlib.util.find_spec(package) is None for package in _PACKAGES)
        return "MuJoCo is not installed; get it by: pip install 'mpge_bench[mujoco]'" if missing else ""

    def world(self, joints: Sequence[str]) -> MujocoWorld:
        if missing := self.lacks():
            raise UserError(f"{self.id}: {missing}")
        return MujocoWorld(self.id, joints)


def _mujoco() -> Any:
    """The package, which is an extra."""
    return importlib.import_module("mujoco")


@contextmanager
def _unheard() -> Iterator[None]:
    """MuJoCo's warnings on model files are kept from the terminal and from a MUJOCO_LOG.TXT in the working directory: the files are Gymnasium's."""
    mujoco = _mujoco()
    heard = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(heard)


#: By our robot.
GYMNASIUM: Mapping[str, Mujoco] = {
    "hopper": Mujoco("Hopper-v5"),
    "half_cheetah": Mujoco("HalfCheetah-v5"),
    "walker": Mujoco("Walker2d-v5"),
    "ant": Mujoco("Ant-v5"),
}
