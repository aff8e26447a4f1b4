"""What every physical effect is: a frozen record of a law, its target and its parameters, which installs itself into a world."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

from mpge_bench.envs.errors import UserError

if TYPE_CHECKING:
    from mpge_bench.envs.world import World

@dataclass(frozen=True)
class Parameter:
    """Unit and admissible closed range of one parameter of an effect."""

    unit: str
    low: float
    high: float


#: Every effect by its name in the catalogue, e.g. ``"torque_gain"``.
CATALOGUE: dict[str, type[Effect]] = {}


@dataclass(frozen=True)
class Effect:
    """One departure of the target's physics from the source's.

    Attributes:
        target: what it acts on: a joint, a link or ``"*"`` (all links), by its name in the robot's model.

    Subclasses set ``name``, ``on`` (the kind of target) and ``parameters`` and override the hooks they need. Joint torques and forces are in
    N m and N; what is called torque below is a force on a prismatic joint.

    Raises:
        UserError: on construction, if a parameter is not finite or outside its bounds.
    """

    target: str

    name: ClassVar[str]
    on: ClassVar[str]
    parameters: ClassVar[dict[str, Parameter]]
    #: True where `actuate` is a pure function of the command: the effect then is an action transformation, known in closed form.
    maps_command: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        CATALOGUE[cls.name] = cls

    def __post_init__(self) -> None:
        for name, parameter in self.parameters.items():
            value = getattr(self, name)
            if not (isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value) and parameter.low <= float(value) <= parameter.high):
                raise UserError(
                    f"effect {self.name} on {self.target}: {name} = {value} {parameter.unit} is outside"
                    f" [{parameter.low:g}, {parameter.high:g}]; choose a value within the bounds"
                )

    def install(self, world: World) -> None:
        """Change the model of `world` once, when it is made."""

    def actuate(self, command: Any, joint: int, q: Any, dq: Any) -> None:
        """Turn the command into what the joint receives, in place.

        Args:
            command: joint torques, first axis the joints; N m or N. One command (a list) or, where `maps_command`, many (shape (joints, n)).
            joint: the target's index.
            q: generalized coordinates, one a joint, m or rad.
            dq: generalized velocities, one a joint, m/s or rad/s.
        """

    def to_dict(self) -> dict[str, Any]:
        """Plain data (for YAML and JSON) that `effect_from_dict` turns back into an equal effect."""
        return {"effect": self.name, **dataclasses.asdict(self)}


def effect_from_dict(data: Mapping[str, Any]) -> Effect:
    """The effect described by plain data such as ``{"effect": "torque_gain", "target": "elbow", "gain": 0.6}``.

    Raises:
        UserError: if the effect is not in the catalogue, a parameter is missing, unknown or outside its bounds.
    """
    if not isinstance(data, Mapping):
        raise UserError(f"an effect is a mapping such as {{effect: torque_gain, target: elbow, gain: 0.6}}; got {data!r}")
    data = dict(data)
    name = data.pop("effect", None)
    if not isinstance(name, str) or name not in CATALOGUE:
        raise UserError(f"unknown effect {name!r}; known: {', '.join(sorted(CATALOGUE))}")
    kind = CATALOGUE[name]
    fields = dataclasses.fields(kind)
    expected, optional = {field.name for field in fields}, {field.name for field in fields if field.default is not dataclasses.MISSING}
    if not expected - optional <= set(data) <= expected:
        raise UserError(f"effect {name} takes {', '.join(sorted(expected))}; got {', '.join(sorted(map(str, data))) or 'nothing'}")
    return kind(**data)
