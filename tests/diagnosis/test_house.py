"""The house: which stage may know of which, how long its functions and modules are, and that an effect is looked for, said and exported by its class alone."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import mpge_bench.diagnosis
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.hypotheses.candidates import candidates
from mpge_bench.diagnosis.verdict.intervals import found_effects
from mpge_bench.envs.effects import CATALOGUE, Effect, Hidden, Parameter, Scale

HOUSE = Path(mpge_bench.diagnosis.__file__).parent
#: Each may import from those before it, and from settings.
STAGES = ("data", "predict", "hypotheses", "fit", "choose", "verdict", "experiment", "report")
MODULES = sorted(HOUSE.rglob("*.py"))


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(HOUSE).with_suffix("").parts)


def imported(path: Path) -> Iterator[str]:
    """Modules of the diagnosis that the module imports, wherever in it: ``data.rig`` and the like."""
    for node in ast.walk(ast.parse(path.read_text())):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names] if isinstance(node, ast.Import) else []
        for name in names:
            if name.startswith("mpge_bench.diagnosis."):
                yield name.removeprefix("mpge_bench.diagnosis.")
            else:
                assert name != "mpge_bench.diagnosis", "import from its modules by their full names"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_arrows_point_one_way(path: Path) -> None:
    stage = path.relative_to(HOUSE).parts[0]
    for name in imported(path):
        other = name.split(".")[0]
        if stage in STAGES:
            assert other == "settings" or STAGES.index(other) <= STAGES.index(stage), f"{name_of(path)} imports {name}"
        else:
            assert stage != "settings" or other == "settings", "settings know of nobody"
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert (node.module or "").split(".")[:2] not in (["mpge_bench", "baselines"], ["mpge_bench", "harness"])


def test_no_circle() -> None:
    arrows = {name_of(path): set(imported(path)) for path in MODULES}
    while free := [name for name, targets in arrows.items() if not targets & set(arrows)]:
        arrows = {name: targets for name, targets in arrows.items() if name not in free}
    assert not arrows


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_functions_and_modules_are_short_enough_to_be_read(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 350
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 60, f"{name_of(path)}.{node.name}"


def test_no_torch() -> None:
    code = "import sys, mpge_bench.diagnosis.pipeline; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@pytest.fixture
def magnet() -> Iterator[type[Effect]]:
    """An effect that nobody but this file knows of."""

    @dataclass(frozen=True)
    class Magnet(Effect):
        """A magnet holds the joint near its middle: a torque ``-pull * q / (1 + q²)``."""

        pull: float

        name = "magnet"
        sentence = "A magnet pulls the {target} to its middle with {pull}."
        on = "joint"
        parameters = {"pull": Parameter("N m/rad", 0.0, 1e3)}
        is_curve = True

        @property
        def goes_by(self) -> str:
            return "q"

        def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
            command[joint] -= self.pull * q[joint] / (1 + q[joint] ** 2)

        @classmethod
        def starts(cls, scale: Scale) -> list[dict[str, Any]]:
            return [{"pull": 0.1 * scale.torque / scale.angle}]

    yield Magnet
    del CATALOGUE["magnet"]


def test_an_effect_is_searched_for_said_and_exported_by_its_class_alone(magnet: type[Effect], rig: Rig, tmp_path: Path) -> None:
    import yaml

    scale = Scale(1.0, 2.0, 1.0, 3.0, 0.5, 0.1, 1.0, 0.2, 0.01, 5.0, rig.gravity)
    options = [one for one in candidates(rig, dict.fromkeys(rig.joints, scale)) if one.name == "magnet"]
    assert [one.target for one in options] == list(rig.joints)
    found = options[0].starts[0]
    bounds = {"pull": [(0.1, 0.3)]}
    assert found.say(bounds) == "A magnet pulls the shoulder to its middle with 0.2 N m/rad (0.1 to 0.3)."
    (said,) = found_effects(rig, [(found, bounds)], [], {}, {})
    assert (said.effect, said.target, said.parameters["pull"].value) == ("magnet", "shoulder", 0.2)
    corrected = tmp_path / "corrected.yaml"
    corrected.write_text(yaml.safe_dump(rig.corrected([found], str(rig.model.path.resolve()))))
    assert found in read_rig(corrected).nominal
