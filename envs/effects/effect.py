"""What every physical effect is: a frozen record of a law, its target and its parameters, which installs itself into a world."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.errors import UserError

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model


@dataclass(frozen=True)
class Parameter:
    """Unit and admissible closed range of one parameter of an effect.

    Attributes:
        neutral: the value at which the effect vanishes (infinite where none in the range does).
        size: how many numbers; None for any number of them.
        step: share of its size by which it is moved to see what depends on it; large where the motion answers in jerks.
        percent: people are told it in percent.
    """

    unit: str
    low: float
    high: float
    neutral: float = 0.0
    size: int | None = 1
    step: float = 1e-4
    percent: bool = False

    def unit_of(self, *, slide: bool) -> str:
        """Its unit at a hinge or, where torques are forces and angles lengths, at a slide."""
        return self.unit.replace("N m", "N").replace("rad", "m").replace("kg m²", "kg") if slide else self.unit

    def told(self, value: float | tuple[float, ...], intervals: Sequence[tuple[float, float]], *, slide: bool = False) -> str:
        """The value, with its 95% interval and unit, for people; `intervals` holds one for each number, infinite where nothing tells it."""
        values = value if isinstance(value, tuple) else (value,)
        unit = "" if self.unit == "1" else f" {self.unit_of(slide=slide)}"
        if len(values) > 1:
            texts = [f"{one:.4g}" if math.isfinite(high - low) else "not told" for one, (low, high) in zip(values, intervals, strict=True)]
            return f"({', '.join(texts)}){unit}"
        low, high = intervals[0]
        if math.isinf(high - low):
            return f"{self.plain(value, slide=slide)} (not told by these recordings)"
        if self.percent:
            return f"{100 * values[0]:.3g}% ({100 * low:.3g}-{100 * high:.3g}%)"
        return f"{self.plain(value, slide=slide)} ({low:.4g} to {high:.4g})"

    def plain(self, value: float | tuple[float, ...], *, slide: bool = False) -> str:
        """The value with its unit, for people."""
        unit = "" if self.unit == "1" else f" {self.unit_of(slide=slide)}"
        if isinstance(value, tuple):
            return f"({', '.join(f'{one:.4g}' for one in value)}){unit}"
        return f"{100 * value:.3g}%" if self.percent else f"{value:.4g}{unit}"


#: Share of the largest command below which that of an ordinary recording is begun from, too: starts are .35 to 1.2 of the largest, and reach what is nearer.
_JERK = 0.6


@dataclass(frozen=True)
class Scale:
    """How large things are where an effect is looked for, and what else is there; a search starts from parameters of this size.

    Attributes:
        torque: of the command or, without one, of gravity and inertia, N m; root mean square.
        limit: largest command, N m.
        speed: root mean square, rad/s.
        top_speed: largest, rad/s.
        angle: standard deviation of the joint's position, rad.
        inertia: mean of the joint's entry on the mass matrix's diagonal, kg m².
        mass: of the joint's link, kg.
        length: from the joint to the farthest centre of mass that it carries, m.
        period: between rows, s.
        duration: of the shortest recording, s.
        gravity: nominal, m/s², shape (3,).
        friction: coefficient of the link in contact; 0 where it touches nothing.
        restitution: coefficient of the link in contact.
        damping: of the joint as the model has it, N m s/rad.
        rotor: inertia of the joint's rotor as the model has it, kg m².
        carried_rotor: the same of one that the link before the joint carries, as its body and not at the joint alone.
        servo_period: s, between commands to a servo; 0 where commands are torques.
        servo_kp, servo_kd: gains of the joint's servo as the rig has it, N m/rad and N m s/rad; 0 where it has none.
        before: joints that come before this one, each of which may be tied to it.
        carried: whether another joint carries this one.
        arm: from the origin of the link that carries this joint to it, m; 0 where no joint carries it.
        step: physics step of the simulator, s; 0 where nothing is said of it.
        shaken: whether the base's acceleration was recorded.
        usual_limit: largest command of an ordinary recording, N m; 0 where nothing is said of it.
    """

    torque: float
    limit: float
    speed: float
    top_speed: float
    angle: float
    inertia: float
    mass: float
    length: float
    period: float
    duration: float
    gravity: tuple[float, float, float]
    friction: float = 0.0
    restitution: float = 0.0
    damping: float = 0.0
    rotor: float = 0.0
    carried_rotor: float = 0.0
    servo_period: float = 0.0
    servo_kp: float = 0.0
    servo_kd: float = 0.0
    before: tuple[str, ...] = ()
    carried: bool = False
    arm: float = 0.0
    step: float = 0.0
    shaken: bool = False
    usual_limit: float = 0.0

    @property
    def limits(self) -> tuple[float, ...]:
        """The largest command, and that of an ordinary recording where it is far smaller: one may begin with a jerk of several times what is ever asked for."""
        return (self.limit, self.usual_limit) if 0 < self.usual_limit < _JERK * self.limit else (self.limit,)

    def is_instant(self, seconds: float) -> bool:
        """Whether simulators differ by as much, which move positions by the velocity at a step's end or in its middle."""
        return seconds < self.step / 2

    @property
    def is_unknown_servo(self) -> bool:
        """Whether the joint has a servo of which the rig knows no damping: none is without, so that its gains are but guessed."""
        return self.servo_kp > 0 and not self.servo_kd


class Hidden:
    """What an effect remembers between physics steps; empty at rest.

    Attributes:
        timestep: physics step, s.
        inertia: about what the joint offers to a torque, kg m², where that is known: it limits what is stable at the physics step.
        time: since the motion, of which a recording may show a part, began, s; of many steps at once shape (..., steps).
    """

    __slots__ = ("inertia", "state", "time", "timestep")

    def __init__(self, timestep: float, inertia: float = math.inf) -> None:
        self.timestep = timestep
        self.inertia = inertia
        self.state: Any = None
        self.time: Any = 0.0


#: Every effect by its name in the catalogue, e.g. ``"torque_gain"``.
CATALOGUE: dict[str, type[Effect]] = {}


@dataclass(frozen=True)
class Effect:
    """One departure of the target's physics from the source's.

    Attributes:
        target: what it acts on: a joint, a link, ``"*"`` (all links; in a rig also all joints that have a motor) or ``"world"``, by its name in the
            robot's model.

    Subclasses set ``name``, ``on`` (the kind of target: joint, pair, link, world or sensor; a pair is a joint and another that a field of the effect's names)
    and ``parameters`` and override the hooks they need. Joint torques and forces are in N m and N; what is called torque below is a force on a prismatic
    joint, and what is called an angle is a length there.

    Raises:
        UserError: on construction, if a parameter is not finite or outside its bounds.
    """

    target: str

    name: ClassVar[str]
    on: ClassVar[str]
    parameters: ClassVar[dict[str, Parameter]]
    #: Further numbers that it takes, known from what is built or set: nobody looks for them, and a search leaves them as they are.
    settings: ClassVar[dict[str, Parameter]] = {}
    #: True where `actuate` is a pure function of the command: the effect then is an action transformation, known in closed form.
    maps_command: ClassVar[bool] = False
    #: True where the effect is the same at every physics step of a control step, so that it need not be worked out anew.
    steady: ClassVar[bool] = False
    #: True where `actuate` has a hidden state: what it does depends on the commands before.
    remembers: ClassVar[bool] = False
    #: True where a motor of its own inertia answers to the joint's motion: nobody records where it is at the start of a prediction.
    swings: ClassVar[bool] = False
    #: True where predictions jump with its parameters: derivatives at a point do not tell how they go on.
    jumps: ClassVar[bool] = False
    #: True where it needs a motor: it says nothing of a passive joint.
    needs_motor: ClassVar[bool] = False
    #: True where it is a part of the motor: on a passive joint it can be put, but recordings of one are not searched for it.
    in_motor: ClassVar[bool] = False
    #: True where it is searched for from transitions of whole states alone: recordings of joints hardly tell its parameters apart, or have a twin of it.
    asks_states: ClassVar[bool] = False
    #: True where the target ``"*"`` stands for all links or, of what acts on joints, for all of a rig's that have a motor.
    takes_all: ClassVar[bool] = False
    #: Place in the chain from the command (low) to the joint (high), for who lists effects without knowing their order.
    place: ClassVar[int] = 50
    #: What it is called at the head of a table, where that is not its name in the catalogue.
    title: ClassVar[str] = ""
    #: What it is, said of its target; {parameter} is a parameter's value with its interval.
    sentence: ClassVar[str] = ""
    #: The same, said of all joints that have a motor.
    sentence_of_all: ClassVar[str] = ""
    #: True where every real machine has more or less of it.
    everywhere: ClassVar[bool] = False
    #: Where robots of one make usually differ by it: "each" on each thing that it acts on, "alike" by the same on all; none elsewhere.
    varies: ClassVar[str] = ""
    #: True where it acts on nothing but what touches the robot.
    in_contact: ClassVar[bool] = False
    #: True where it decides what becomes of a start, as a soft ground does of how deep a body sits in it: of other starts than its own it makes nonsense.
    moves_starts: ClassVar[bool] = False
    #: The effect that it is where what it acts on is all that moves: a force on it is gravity, a late sensor of it a late motor.
    on_all_is: ClassVar[str] = ""
    #: True where two of them on one target are one with the sums of their parameters.
    adds: ClassVar[bool] = False
    #: Plainer effects that it contains, as Stribeck's friction contains Coulomb's: never beside it.
    contains: ClassVar[tuple[str, ...]] = ()
    #: Plainer effects that it does not contain but may be mistaken for.
    resembles: ClassVar[tuple[str, ...]] = ()
    #: True of several numbers that do what a sensor's one does by coincidence alone: where that predicts as well it is what is there.
    is_no_reading: ClassVar[bool] = False
    #: What would tell it from other effects that look like it on some recordings, by their names. An experiment stands in one of the two.
    told_apart: ClassVar[dict[str, str]] = {}
    #: True where its torque is a curve over one signal, the one it goes by, that can be drawn.
    is_curve: ClassVar[bool] = False
    #: True of a law that is said as a formula and has no name of its own: it is looked for only where no physics of the catalogue explains.
    is_formula: ClassVar[bool] = False
    #: Parameters of a formula that have to be more than nothing for it to be what it says.
    rests_on: ClassVar[tuple[str, ...]] = ()
    #: False for what stands in for physics that nobody has named: its parameters are solved for, not searched.
    named: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        if "name" in cls.__dict__:
            CATALOGUE[cls.name] = cls

    def __post_init__(self) -> None:
        for name, parameter in (self.parameters | self.settings).items():
            value = getattr(self, name)
            numbers = value if parameter.size != 1 and isinstance(value, Sequence) and not isinstance(value, str) else (value,)
            if parameter.size not in (None, len(numbers)) or not all(_within(number, parameter) for number in numbers):
                many = "" if parameter.size == 1 else f"{parameter.size or 'some'} numbers each in "
                raise UserError(
                    f"effect {self.name} on {self.target}: {name} = {value} {parameter.unit} is outside"
                    f" {many}[{parameter.low:g}, {parameter.high:g}]; choose a value within the bounds"
                )
            if parameter.size != 1:
                object.__setattr__(self, name, tuple(float(number) for number in numbers))

    def _check_curve(self, at: str, values: str) -> None:
        """Refuse parameters `at` and `values`, by name, that are no curve."""
        places = getattr(self, at)
        if len(places) != len(getattr(self, values)) or not places or any(b <= a for a, b in itertools.pairwise(places)):
            raise UserError(f"effect {self.name} on {self.target}: `{at}` and `{values}` must be equally long and `{at}` must rise")

    def each(self, driven: Sequence[str]) -> tuple[Effect, ...]:
        """The effects that it stands for, one a target: itself or, where it acts on all joints with a motor, which are `driven`, one on each."""
        if self.target == "*" and self.on == "joint" and self.takes_all:
            return tuple(dataclasses.replace(self, target=joint) for joint in driven)
        return (self,)

    def install(self, model: Model) -> None:
        """Change `model` once, before it is loaded."""

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        """Turn the command into what the joint receives, in place, once a physics step.

        Args:
            command: joint torques, first axis the joints; N m or N. One command (a list) or many (shape (joints, n)).
            joint: the target's index.
            q: generalized coordinates, one a joint, m or rad; shaped as `command`.
            dq: generalized velocities, one a joint, m/s or rad/s.
            hidden: what the effect remembers; its own, and kept from physics step to physics step.
        """

    def unsense(self, q: npt.NDArray[np.float64], dq: npt.NDArray[np.float64], joint: int) -> None:
        """Undo in place what `sense` does to single readings; what is late (`looks_back`) it leaves late. Arguments are shaped (..., joints)."""

    def friction(self, command: Any, joint: int, q: Any, dq: Any) -> Any:
        """Largest torque, N m, with which dry friction opposes the motion of the joint now; None if the effect is no dry friction."""
        return None

    def sense(self, q: npt.NDArray[np.float64], dq: npt.NDArray[np.float64], joint: int, timestep: float) -> None:
        """Turn a motion into what the sensors read of it, in place.

        Args:
            q: generalized coordinates at equal intervals, shape (..., time, joints).
            dq: velocities, same shape.
            joint: the target's index.
            timestep: interval, s. Before the first row the motion is taken to have gone on at the first row's velocity.
        """

    @classmethod
    def is_everywhere(cls, scale: Scale) -> bool:
        """Whether every machine has more or less of it at a joint of this `scale`."""
        return cls.everywhere

    def to_urdf(self, model: Model) -> bool:
        """Write it into `model` as a URDF file holds it, for other programs than this; False where URDF has no place for it."""
        return False

    def to_mjcf(self, spec: Any) -> bool:
        """Write it into a MuJoCo model (`mujoco.MjSpec`), whose motors have the names of their joints; False where MJCF has no place for it.

        It is asked where URDF has none, in the order in which effects act.
        """
        return False

    @property
    def formula(self) -> str:
        """Of a law that is said as one, without its unit; nothing of what has a name."""
        return ""

    @property
    def goes_by(self) -> str:
        """The signal of its joint, ``"command"``, ``"q"`` or ``"dq"``, that its torque depends on, as far as there is one."""
        return "command" if self.maps_command else "dq"

    @property
    def rubs(self) -> bool:
        """Whether it is dry friction."""
        return type(self).friction is not Effect.friction

    @property
    def alters_model(self) -> bool:
        """Whether it changes bodies, rotors, gravity or constant forces: what `install` is for."""
        return type(self).install is not Effect.install

    @property
    def rotor_inertia(self) -> float:
        """What it adds to its joint's own inertia and to no other entry of the mass matrix, kg m²."""
        return 0.0

    def own_rotor(self, inertia: float) -> float:
        """What it makes of the `inertia`, kg m², of the rotor that the robot has at its joint; as it is, of all but the effects that are about nothing else."""
        return inertia

    @property
    def shaking(self) -> float:
        """Share of the base's recorded acceleration that it says acts."""
        return 0.0

    @property
    def implicit_damping(self) -> float:
        """Damping, N m s/rad, that some simulators work out at the end of the physics step and some at its beginning."""
        return 0.0

    @property
    def looks_back(self) -> float | None:
        """How old what it makes the sensors read is, s; None where that is no part of its law."""
        return None

    @property
    def forgets(self) -> float:
        """Within how many s its hidden state comes to depend on where it began by no more than a hundredth, as far as its parameters say."""
        return 0.0

    def is_stepwise(self, timestep: float) -> bool:
        """Whether its torques along a given motion must be worked out one after another, at physics steps of `timestep` s."""
        return self.remembers

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        """One plain line about it.

        Args:
            intervals: 95% interval of each parameter (one for each number of a vector).
            slide: whether the target is a prismatic joint.
        """
        words = {name: parameter.told(getattr(self, name), intervals[name], slide=slide) for name, parameter in self.parameters.items()}
        target = self.target.removesuffix("_link")
        if self.target == "*" and self.sentence_of_all:
            return self.sentence_of_all.format(**words)
        if not self.sentence:
            return f"{self.called()} at the {target}: {', '.join(f'{name} {text}' for name, text in words.items())}."
        return self.sentence.format(target=target, **words)

    @property
    def physics(self) -> tuple[str, str] | None:
        """What it is about, of which a simulator has but one, by its name and target; None of a nameless curve."""
        return (self.name, self.target) if self.named else None

    @property
    def has_a_name(self) -> bool:
        """Whether it is physics that has a name: neither a nameless curve nor a formula."""
        return self.named and not self.is_formula

    def corrects(self, other: Effect) -> bool:
        """Whether it stands in the place of `other`, of which a simulator believed in too much or too little. Nameless curves add up."""
        return self.physics is not None and self.physics == other.physics

    def say_instead(self, other: Effect, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        """`say`, where the rig says `other`."""
        believed = ", ".join(parameter.plain(getattr(other, name), slide=slide) for name, parameter in self.parameters.items())
        return f"{self.say(intervals, slide=slide).removesuffix('.')}, not {believed} as the rig says."

    @classmethod
    def called(cls) -> str:
        """Its name at the head of a table."""
        return cls.title or cls.name.replace("_", " ").capitalize()

    @classmethod
    def plainer(cls) -> tuple[str, ...]:
        """Plainer effects that may be the truth where it is found."""
        return (*cls.contains, *cls.resembles)

    @classmethod
    def is_bent(cls) -> bool:
        """Whether what it changes is not in proportion to its parameters, even where they are small."""
        return cls.remembers or cls.maps_command or math.isinf(next(iter(cls.parameters.values())).neutral)

    @classmethod
    def is_one_sided(cls) -> bool:
        """Whether there is no less of it than none: no load is negative."""
        return any(parameter.low == parameter.neutral for parameter in cls.parameters.values())

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        """Parameter values from which a search for this effect starts, where things are as large as `scale` says; none if it is not searched for."""
        return []

    @classmethod
    def at_most(cls) -> list[dict[str, Any]]:
        """The same where it is as strong as can be: of a robot that stands by what it takes away nothing weaker leads there."""
        return []

    @classmethod
    def beyond(cls, plainer: Effect, scale: Scale) -> list[dict[str, Any]]:
        """The same where `plainer`, which it contains, was fitted already: what that found is not to be sought anew."""
        return []

    def turned_into(self) -> Effect | None:
        """The plainer effect that a fit has made of it, where what else it says changes nothing any more and no fit comes out; None if there is none."""
        return None

    def is_shown(self, scale: Scale) -> bool:
        """Whether a motion of such a `scale` shows it for what it is."""
        return True

    def stands_for(self) -> Effect | None:
        """The plainer effect that does about the same where its own parameters mean nothing; None if there is none."""
        return None

    @classmethod
    def holding(cls, torque: float) -> list[dict[str, Any]]:
        """The same where its joint stands still though `torque`, N m, would move it; none if it holds nothing fast."""
        return []

    @classmethod
    def absent(cls, scale: Scale) -> list[float] | None:
        """The numbers of its parameters at which it changes nothing where things are as `scale` says; None where there are none."""
        found = [parameter.neutral for parameter in cls.parameters.values() for _ in range(parameter.size or 0)]
        return found if all(map(math.isfinite, found)) else None

    def is_plausible(self, scale: Scale) -> bool:
        """Whether the parameters are of a size that means something where things are as large as `scale` says; a fit may end at others, which mean nothing."""
        return True

    def to_dict(self) -> dict[str, Any]:
        """Plain data (for YAML and JSON) that `effect_from_dict` turns back into an equal effect."""
        data = {name: list(value) if isinstance(value, tuple) else value for name, value in dataclasses.asdict(self).items()}
        return {"effect": self.name, **data}


class OfModel(Effect):
    """What makes a link another body, or another one to touch, or puts a joint elsewhere: the model itself is another, and a URDF holds it as it is."""

    def to_urdf(self, model: Model) -> bool:
        self.install(model)
        return True


def _within(value: Any, parameter: Parameter) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value) and parameter.low <= float(value) <= parameter.high


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
