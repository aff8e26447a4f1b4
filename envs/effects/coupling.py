"""Laws that tie two joints together, as a cable or a belt over pulleys of both does: formulas, looked for only where no physics of the catalogue explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mpge_bench.envs.effects.effect import Effect, Parameter, Scale
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Tie

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model

#: Either turns the other its way or, crossed, against it.
_RATIOS = (1.0, -1.0)
_RATIO = Parameter("1", -100.0, 100.0, neutral=float("inf"))


@dataclass(frozen=True)
class Coupling(Effect):
    """A joint and an `other` pull on each other, equally and oppositely through the transmission between them: what the target has of torque, the other has
    of the opposite, `ratio` times as much."""

    other: str

    is_formula = True
    on = "pair"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.other == self.target:
            raise UserError(f"effect {self.name} on {self.target}: a joint cannot be tied to itself; give another one as `other`")

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        words = {name: parameter.told(getattr(self, name), intervals[name], slide=slide) for name, parameter in self.parameters.items()}
        return self.sentence.format(target=self.target, other=self.other, **words)

    def tied(self) -> Tie:
        """It as a robot's model has it."""
        raise NotImplementedError

    def install(self, model: Model) -> None:
        model.tie(self.tied())

    def to_mjcf(self, spec: Any) -> bool:
        tie = self.tied()
        tendon = spec.add_tendon(stiffness=tie.stiffness, damping=tie.damping, springlength=[tie.rest, tie.rest])
        tendon.wrap_joint(tie.joint, 1.0)
        tendon.wrap_joint(tie.other, -tie.ratio)
        return True


@dataclass(frozen=True)
class CouplingSpring(Coupling):
    """A spring between two joints pulls them to where ``q = ratio * other's q + rest``: torque ``-stiffness * (q - ratio * other's q - rest)``."""

    stiffness: float
    ratio: float = 1.0
    rest: float = 0.0

    name = "coupling_spring"
    sentence = (
        "The {other} and the {target} pull on each other with {stiffness}, at rest where the {target} is at"
        " {ratio} times the {other}'s position and {rest} more."
    )
    resembles = ("joint_spring",)
    rests_on = ("stiffness", "ratio")
    parameters = {"stiffness": Parameter("N m/rad", 0.0, 1e5), "ratio": _RATIO, "rest": Parameter("rad", -100.0, 100.0, neutral=float("inf"))}

    def tied(self) -> Tie:
        return Tie(self.target, self.other, self.ratio, stiffness=self.stiffness, rest=self.rest)

    @property
    def formula(self) -> str:
        return f"-{self.stiffness:.4g} (q - {self.ratio:.4g} q_{self.other} - {self.rest:.4g})".replace("- -", "+ ")

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"other": other, "stiffness": 0.1 * scale.torque / scale.angle, "ratio": ratio} for other in scale.before for ratio in _RATIOS]


@dataclass(frozen=True)
class CouplingDamping(Coupling):
    """Two joints brake each other's motion where it is not ``dq = ratio * other's dq``: torque ``-damping * (dq - ratio * other's dq)``."""

    damping: float
    ratio: float = 1.0

    name = "coupling_damping"
    sentence = "The {other} and the {target} brake each other with {damping}, unless the {target} has {ratio} times the {other}'s speed."
    resembles = ("viscous_friction",)
    rests_on = ("damping", "ratio")
    parameters = {"damping": Parameter("N m s/rad", 0.0, 1e4), "ratio": _RATIO}

    def tied(self) -> Tie:
        return Tie(self.target, self.other, self.ratio, damping=self.damping)

    @property
    def formula(self) -> str:
        return f"-{self.damping:.4g} (dq - {self.ratio:.4g} dq_{self.other})".replace("- -", "+ ")

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"other": other, "damping": 0.1 * scale.torque / scale.speed, "ratio": ratio} for other in scale.before for ratio in _RATIOS]
