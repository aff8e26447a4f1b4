"""A diagnosis in the words of a roboticist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpge_bench.envs.effects import Effect, UnknownTorque

#: What each effect of the catalogue is, said of its target; {name} is a parameter's value with its interval.
SENTENCES = {
    "torque_gain": "The {target}'s motor delivers {gain} of its command.",
    "torque_bias": "The {target}'s motor adds a constant {torque} to its command.",
    "torque_limit": "The {target}'s motor delivers no more than {torque}.",
    "back_emf_limit": "The {target}'s motor runs out of voltage: at most {stall} at standstill, nothing beyond {no_load_speed}.",
    "dead_zone": "The {target}'s motor does not answer commands below {torque}, and answers larger ones by as much less.",
    "delay": "The {target}'s motor acts {seconds} late.",
    "lag": "The {target}'s motor follows its command with a time constant of {time_constant}.",
    "backlash": "The {target}'s gear has a play of {width}, and a motor inertia of {motor_inertia} behind it.",
    "joint_elasticity": "The {target}'s drive is elastic: stiffness {stiffness}, damping {damping}, motor inertia {motor_inertia}.",
    "viscous_friction": "The {target} has viscous friction of {damping}.",
    "coulomb_friction": "The {target} has dry friction of {torque}.",
    "stribeck_friction": "The {target} has dry friction that falls from {static} at standstill to {coulomb}, within about {velocity}.",
    "load_friction": "The {target} loses {coefficient} of the torque it carries to friction.",
    "joint_spring": "A spring of {stiffness} pulls the {target} to {rest}.",
    "armature": "The {target}'s rotor adds an inertia of {inertia}.",
    "air_drag": "The {target} is braked with the square of its speed: {quadratic}.",
    "payload": "The {target} carries {mass} more, {distance} from its joint.",
    "mass_scale": "The {target} weighs {factor} times what the simulator believes.",
    "com_offset": "The {target}'s centre of mass lies off by {x}, {y}, {z}.",
    "inertia_scale": "The {target}'s rotational inertia is {factor} times what the simulator believes.",
    "gravity": "Gravity is {vector} in the base's frame: the base is tilted, or gravity has another strength.",
    "external_force": "A constant force of {vector} pulls at the {target}.",
    "sensor_bias": "The {target}'s sensor reads {offset} too much.",
    "sensor_scale": "The {target}'s sensor reads {gain} times the true value.",
    "sensor_delay": "The {target}'s sensor is {seconds} late.",
    "position_servo": "The {target}'s servo has gains {kp} and {kd}.",
}

#: For two effects that look alike on some recordings, what would tell them apart.
EXPERIMENTS = {
    frozenset({"payload", "torque_gain"}): "let the arm swing with the motor off: a payload changes the free motion, a motor's gain does not",
    frozenset({"mass_scale", "torque_gain"}): "let the arm swing with the motor off: mass changes the free motion, a motor's gain does not",
    frozenset({"gravity", "torque_gain"}): "let the arm swing with the motor off: gravity changes the free motion, a motor's gain does not",
    frozenset(
        {"gravity", "sensor_bias"}
    ): "let every joint hang at rest and read the sensors, then turn the base about the vertical: a tilt turns with it, a sensor's bias does not",
    frozenset({"gravity", "torque_bias"}): "repeat at other angles: gravity's torque depends on them, a bias does not",
    frozenset({"viscous_friction", "back_emf_limit"}): "drive at full torque and then let it coast: back-EMF limits only the driven motion",
    frozenset({"delay", "lag"}): "command sines of rising frequency: a delay leaves the amplitude, a lag lowers it",
    frozenset({"delay", "backlash"}): "reverse slowly under load: play shows at reversals only, a delay always",
    frozenset({"delay", "sensor_delay"}): "hold the motor still and push the joint by hand against a second sensor: only a late sensor is late then",
    frozenset({"lag", "sensor_delay"}): "let the joint swing with the motor off against a second sensor: only a late sensor is late then",
    frozenset({"dead_zone", "coulomb_friction"}): "let the joint coast with the motor off: friction brakes it, a dead zone does not",
    frozenset({"armature", "inertia_scale"}): "move the joint that carries this one: a link's inertia is felt there, a rotor's is not",
    frozenset({"armature", "mass_scale"}): "hold the joint still at several angles: mass needs holding torque, a rotor does not",
    frozenset(
        {"payload", "com_offset"}
    ): "weigh the link, or shake its joint fast with gravity out of play: a payload adds inertia, an offset moves weight only",
    frozenset({"payload", "mass_scale"}): "drive fast and slow: a payload and a denser link have different ratios of inertia to weight",
    frozenset({"torque_gain", "coulomb_friction"}): "let the joint coast with the motor off: friction brakes it, a weak motor does not",
    frozenset(
        {"torque_gain", "load_friction"}
    ): "drive and brake with the same torque: friction adds to one and takes from the other, a weak motor takes from both",
    frozenset({"coulomb_friction", "stribeck_friction"}): "move very slowly, with many reversals",
    frozenset({"coulomb_friction", "load_friction"}): "move at constant speed under two different loads",
    frozenset({"joint_spring", "gravity"}): "turn the base on its side: gravity's torque changes, a spring's does not",
    frozenset({"torque_bias", "joint_spring"}): "hold the joint at angles far apart",
    frozenset({"backlash", "armature"}): "reverse slowly: play shows as a moment without torque",
    frozenset({"joint_elasticity", "armature"}): "command fast sines or a knock: elasticity rings at its own frequency",
    frozenset({"joint_elasticity", "backlash"}): "twist the joint by hand with the motor held: play gives way freely, a spring pushes back from the start",
}


def sentence(effect: Effect, intervals: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """One plain line about `effect`.

    Args:
        intervals: 95% interval of each parameter (one for each number of a vector).
    """
    if isinstance(effect, UnknownTorque):
        most = max(abs(value) for value in effect.torque)
        signal = {"q": "position", "dq": "speed", "command": "motor's torque"}[effect.signal]
        return f"Something without a name acts on the {effect.target}: a torque of up to {most:.3g} N m that depends on its {signal} (curve exported)."
    if effect.name == "torque_gain" and float(getattr(effect, "gain", 1.0)) < 0.02:
        return f"The {effect.target}'s motor is dead."
    words = {}
    for name, parameter in effect.parameters.items():
        value = getattr(effect, name)
        values = value if isinstance(value, tuple) else (value,)
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        if effect.name == "torque_gain" or effect.name == "load_friction":
            (low, high), number = intervals[name][0], 100 * values[0]
            words[name] = f"{number:.3g}% ({100 * low:.3g}-{100 * high:.3g}%)"
        elif len(values) == 1:
            low, high = intervals[name][0]
            words[name] = f"{values[0]:.4g}{unit} ({low:.4g} to {high:.4g})"
        else:
            words[name] = "(" + ", ".join(f"{one:.4g}" for one in values) + f"){unit}"
    return SENTENCES[effect.name].format(target=effect.target.removesuffix("_link"), **words)


def experiment(first: str, second: str) -> str:
    """What would tell two models apart, given as labels such as ``delay:elbow``."""
    names = [{part.split(":")[0] for part in label.split(" + ")} for label in (first, second)]
    for one in sorted(names[0] - names[1] or names[0]):
        for other in sorted(names[1] - names[0] or names[1]):
            if frozenset({one, other}) in EXPERIMENTS:
                return EXPERIMENTS[frozenset({one, other})]
    return "record again with larger and faster motion of the joints concerned, reversals and standstills included"
