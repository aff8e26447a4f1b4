"""The 76 concealed cases that the project's figures are of: one of each kind of effect, of several mechanisms and sensors.

What makes them, in MuJoCo, is `mpge_bench.concealed`, whose command `concealed make` draws others.
"""

from __future__ import annotations

import argparse
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import mujoco
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpge_bench.concealed.make import make
from mpge_bench.concealed.mechanism import Case, Effect

# name | mechanism | options | effects
# Options: told (the rig states the noise), no_dq, enc1024 and enc4096 (encoders of so many ticks, no dq), loud, closed (every recording is closed-loop),
# damped, si. Without `si` sizes are relative, see `absolute`, and vary by a seventh from seed to seed.
CASES = """
pend_none               | pend   | told             |
pend_none_encoder       | pend   | enc4096          |
arm2_none               | arm2   |                  |
arm2_none_closed_loud   | arm2   | closed loud told |
arm3_none_no_dq         | arm3   | no_dq told       |
cart_none               | cart   | closed           |
servo2_none             | servo2 | told             |
free2_none              | free2  |                  |

arm2_gain               | arm2   | told             | torque_gain shoulder gain=.75
cart_gain               | cart   |                  | torque_gain slide gain=1.25
arm3_dead               | arm3   | si               | torque_gain elbow gain=0
pend_bias               | pend   | told             | torque_bias hinge torque=.15
arm2_limit              | arm2   |                  | torque_limit shoulder torque=.4
servo2_limit            | servo2 | told             | torque_limit elbow torque=.5
pend_back_emf           | pend   |                  | back_emf_limit hinge stall=.6 no_load_speed=4
arm2_back_emf           | arm2   | told             | back_emf_limit elbow stall=.8 no_load_speed=5
arm3_dead_zone          | arm3   | told             | dead_zone shoulder torque=.2
arm2_delay              | arm2   |                  | delay elbow seconds=.015
arm3_delay_closed       | arm3   | closed told      | delay shoulder seconds=.03
pend_lag                | pend   | told             | lag hinge time_constant=.06
servo2_lag              | servo2 |                  | lag shoulder time_constant=.025
pend_backlash           | pend   | told             | backlash hinge width=.05 motor_inertia=.25
arm2_backlash           | arm2   |                  | backlash shoulder width=.03 motor_inertia=.15

arm3_viscous            | arm3   | told             | viscous_friction yaw damping=.08
free2_viscous           | free2  |                  | viscous_friction lower damping=.05
arm2_coulomb_closed     | arm2   | closed told      | coulomb_friction elbow torque=.2
cart_coulomb_hinge      | cart   |                  | coulomb_friction hinge torque=.06
pend_stribeck           | pend   |                  | stribeck_friction hinge coulomb=.12 static=.25 velocity=.3
servo2_stribeck         | servo2 | told             | stribeck_friction shoulder coulomb=.1 static=.2 velocity=.4
arm2_load_friction      | arm2   | told             | load_friction shoulder coefficient=.2
arm2_spring             | arm2   |                  | joint_spring elbow stiffness=.6 rest=.4
arm3_armature           | arm3   | told             | armature elbow inertia=.4
pend_elastic            | pend   | told             | joint_elasticity hinge hz=9 ratio=.05 motor_inertia=.3
arm2_elastic            | arm2   |                  | joint_elasticity elbow hz=14 ratio=.08 motor_inertia=.4
pend_air_drag           | pend   |                  | air_drag hinge quadratic=.04

arm3_payload            | arm3   |                  | payload elbow_link mass=.3 distance=.9
servo2_payload          | servo2 | told             | payload elbow_link mass=.4 distance=1
arm2_mass               | arm2   | told             | mass_scale elbow_link factor=1.3
free2_com               | free2  |                  | com_offset lower_link x=.1 y=0 z=-.1
arm3_inertia            | arm3   | told             | inertia_scale shoulder_link factor=1.8
arm3_gravity            | arm3   |                  | gravity world vector=1,-.6,-9.74
cart_gravity            | cart   | told             | gravity world vector=.9,0,-9.77
arm3_external           | arm3   | told             | external_force elbow_link vector=.2,.15,.1

arm2_sensor_bias        | arm2   | told             | sensor_bias shoulder offset=.06
servo2_sensor_bias      | servo2 |                  | sensor_bias elbow offset=-.08
pend_sensor_scale       | pend   |                  | sensor_scale hinge gain=1.07
arm2_sensor_delay       | arm2   | told             | sensor_delay elbow seconds=.02

pend_coulomb_encoder    | pend   | enc1024          | coulomb_friction hinge torque=.15
arm2_viscous_no_dq      | arm2   | no_dq told       | viscous_friction shoulder damping=.08
arm3_payload_encoder    | arm3   | enc4096 told     | payload shoulder_link mass=.3 distance=.8
arm2_delay_no_dq        | arm2   | no_dq            | delay shoulder seconds=.025
servo2_dead_encoder     | servo2 | enc4096          | dead_zone elbow torque=.2
arm3_stribeck_loud      | arm3   | loud told        | stribeck_friction elbow coulomb=.15 static=.3 velocity=.25
cart_lag_loud           | cart   | loud             | lag slide time_constant=.05

arm2_gain_faint         | arm2   | si loud told     | torque_gain shoulder gain=.97
arm2_payload_faint      | arm2   | si               | payload elbow_link mass=.02 distance=.35
pend_viscous_faint      | pend   | si loud          | viscous_friction hinge damping=.01
arm2_delay_faint        | arm2   | si told          | delay elbow seconds=.004
pend_coulomb_faint      | pend   | si enc1024       | coulomb_friction hinge torque=.03

pend_armature_damped    | pend   | damped told      | armature hinge inertia=.3
arm2_armature_damped    | arm2   | damped           | armature elbow inertia=.3
arm2_viscous_damped     | arm2   | damped told      | viscous_friction shoulder damping=.08

arm2_coulomb_viscous    | arm2   | told             | coulomb_friction shoulder torque=.1 + viscous_friction shoulder damping=.05
arm2_gain_delay         | arm2   |                  | delay elbow seconds=.02 + torque_gain elbow gain=.7
arm3_payload_coulomb    | arm3   | told             | payload elbow_link mass=.3 distance=.9 + coulomb_friction elbow torque=.15
pend_stribeck_armature  | pend   |                  | stribeck_friction hinge coulomb=.1 static=.2 velocity=.3 + armature hinge inertia=.3
arm2_limit_viscous      | arm2   | told             | torque_limit shoulder torque=.45 + viscous_friction elbow damping=.08
cart_drag_coulomb       | cart   |                  | air_drag slide quadratic=.08 + coulomb_friction hinge torque=.05
arm2_backlash_coulomb   | arm2   | no_dq            | backlash elbow width=.05 motor_inertia=.3 + coulomb_friction shoulder torque=.1
servo2_bias_payload     | servo2 | told             | sensor_bias shoulder offset=.05 + payload elbow_link mass=.3 distance=.9

arm2_cogging            | arm2   | told             | cogging shoulder torque=.2 teeth=8
pend_position_friction  | pend   |                  | position_friction hinge torque=.3 waves=3
arm3_ripple             | arm3   | told             | torque_ripple shoulder torque=.15 hz=3
arm2_one_way_friction   | arm2   |                  | one_way_friction elbow forward=.15 backward=.02
arm2_coupling           | arm2   | told             | coupling_spring elbow stiffness=.6 other=shoulder
arm2_drift              | arm2   |                  | gain_drift shoulder rate=-.04
"""


def parsed(line: str) -> Case:
    """A line of the table."""
    name, mechanism, options, effects = (part.strip() for part in line.split("|"))
    found = []
    for words in (text.split() for text in effects.split("+") if text):
        values: dict[str, Any] = dict(word.split("=") for word in words[2:])
        for key, text in values.items():
            values[key] = text if text.isalpha() else [float(x) for x in text.split(",")] if "," in text else float(text)
        found.append(Effect(words[0], words[1], values))
    return Case(name, mechanism, options.split(), found)


def main() -> None:
    cases = [parsed(line) for line in CASES.splitlines() if line]
    parser = argparse.ArgumentParser(
        description="Make recordings of mechanisms with a concealed effect, in MuJoCo.",
        epilog="OUT/given/<case> has what a diagnosis may read (rig.yaml, robot.urdf, train_00..03.csv), OUT/kept/<case> the answer (label.yaml) and "
        "test_00..01.csv. The same seed makes the same files; another one makes other masses, sizes, commands and noise. Example: "
        "python benchmarks/make_concealed.py /tmp/hard --only 'arm2_*', then mpge_bench diagnose --rig /tmp/hard/given/arm2_gain/rig.yaml ...",
    )
    parser.add_argument("out", type=Path, nargs="?", metavar="OUT", help="folder to write to, made at need")
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument("--only", default="*", metavar="GLOB", help="only the cases with such a name")
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--count", type=int, metavar="N", help=f"only the first N cases (of {len(cases)})")
    some.add_argument("--list", action="store_true", help="show the cases and make nothing")
    args = parser.parse_args()
    if args.out is None and not args.list:
        parser.error("where to? Give OUT, or --list to see the cases")
    mujoco.set_mju_user_warning(lambda text: None)  # of commands that turned out too large; `record` looks for itself
    cases = [case for case in cases if fnmatch(case.name, args.only)][: args.count]
    table = Table("case", "effects", "options", *([] if args.list else ["visible", "max |q|", "max |dq|"]), box=None)
    for case in cases if args.list else track(cases, "recording", console=Console(stderr=True)):
        what = ", ".join(f"{effect.kind}:{effect.target}" for effect in case.effects) or "none"
        table.add_row(case.name, what, " ".join(case.options), *([] if args.list else [f"{x:.3g}" for x in make(case, args.out, args.seed)]))
    console = Console(width=150)
    console.print(table)
    if not args.list:
        console.print("visible: the error of the rig as believed, 0.5 s ahead, in standard deviations of the sensor's noise (the worst channel's)")


if __name__ == "__main__":
    main()
