"""What a shell offers when Tab is pressed."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from mpge_bench.baselines.registry import ADDRESSES
from mpge_bench.envs import TASKS


def offered(*words, code="from mpge_bench.cli import main; main()"):
    """What bash is told may stand in the place of the last of `words`."""
    asking = {"_MPGE_BENCH_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(("mpge_bench", *words)), "COMP_CWORD": str(len(words))}
    call = [sys.executable, "-c", f"import sys; sys.argv = ['mpge_bench']; {code}"]
    done = subprocess.run(call, env={**os.environ, **asking}, capture_output=True, text=True)
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.parametrize("words", [("run", "--task", ""), ("tasks", ""), ("sweep", "--task", "ant_gravity", "--task", ""), ("diagnose", "--task", "")])
def test_pairs_are_offered(words):
    assert [one for one in offered(*words) if not one.endswith("_")] == list(TASKS)


def test_pairs_that_begin_as_what_is_typed_and_the_instances_of_a_family():
    assert offered("render", "--task", "heavy_p") == ["heavy_pendulum"]
    assert offered("run", "--task", "multipolar_h") == ["multipolar_hopper_"]
    assert offered("run", "--task", "multipolar_hopper_1") == [f"multipolar_hopper_{number}" for number in (1, *range(10, 20))]


def test_methods_and_commands_are_offered():
    assert offered("run", "--method", "") == list(ADDRESSES)
    assert offered("methods", "mp") == ["mpg", "mpge"]
    assert offered("concealed", "sp") == ["spike"]


def test_presets_are_those_of_the_methods_on_the_line():
    assert offered("run", "--preset", "") == ["smoke", "standard", "paper"]
    assert offered("run", "--method", "garat", "--preset", "") == ["smoke", "standard", "paper", "desai"]
    assert offered("sweep", "--method", "mpg", "--method", "garat", "--preset", "d") == ["desai"]


def test_nobody_waits_for_torch():
    code = "from mpge_bench.cli import app\ntry: app()\nfinally: print('torch' in sys.modules)"
    said = offered("run", "--method", "garat", "--preset", "", code=f"exec({code!r})")
    assert said[-1] == "False"
    assert "desai" in said


def test_the_program_is_completed_and_not_python(in_process, monkeypatch):
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    code, out, err = in_process("--show-completion", "bash")
    assert code == 0, err
    assert out.splitlines()[-1] == "complete -o default -F _mpge_bench_completion mpge_bench"
