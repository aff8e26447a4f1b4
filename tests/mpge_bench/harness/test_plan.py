"""What a sweep is to run, and what it says of that beforehand."""

from __future__ import annotations

import pytest

from mpge_bench.baselines.presets import load_settings
from mpge_bench.baselines.registry import get_method
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.plan import Grid, plan_of, read_grid
from mpge_bench.harness.settings import RunSettings

PENDULUM = "biased_pendulum"


def test_all_combinations_seed_by_seed_and_no_run_twice():
    grid = Grid(tasks=(PENDULUM, "heavy_pendulum"), methods=("direct", "gat"), samples=(50, 60), seeds=2, preset="smoke")
    runs = grid.runs()
    assert len(runs) == 2 * 2 * (1 + 2)  # direct draws no samples: one run for both
    assert [run.seed for run in runs] == [0] * 6 + [1] * 6
    assert runs[:2] == (RunSettings(PENDULUM, "direct", 0, "smoke"), RunSettings(PENDULUM, "gat", 50, "smoke"))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"methods": ()}, "nothing to run; give --task and --method"),
        ({"samples": ()}, r"samples are \[\] and seeds 3; give 1 or more of each"),
        ({"seeds": 0}, "seeds 0; give 1 or more"),
        ({"methods": ("direct", "gta")}, "unknown method 'gta'"),
        ({"set": ("steps=1",)}, "unknown setting steps"),
        ({"seeds": 2**31}, "2147483648 runs are asked for, more than 100000"),
    ],
)
def test_a_wrong_grid_is_known_before_any_work(wrong, said):
    with pytest.raises(UserError, match=said):
        Grid(**{"tasks": (PENDULUM,), "methods": ("direct",)} | wrong).runs()


def test_a_file_holds_what_flags_say(tmp_path):
    path = tmp_path / "sweep.yaml"
    path.write_text("# all of it\ntasks: [biased_pendulum]\nmethods: [gat]\nsamples: [5e1]\nseeds: 2\npreset: smoke\nset: [agent.steps=0]\nnoise: 1e-2\n")
    grid = Grid(**read_grid(path))
    assert grid == Grid(tasks=(PENDULUM,), methods=("gat",), samples=(50,), seeds=2, preset="smoke", set=("agent.steps=0",), noise=0.01)
    path.write_text("seeds: 2\n")
    assert read_grid(path) == {"seeds": 2}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tasks: [a]\n\nmethod: [b]\n", "line 3: unknown key method; there are tasks, methods, samples, seeds, preset, set, noise$"),
        ("tasks: [a]\n1: 2\n", "line 2: unknown key 1"),
        ("tasks: a\n", r"line 1: setting tasks takes a list, such as \[one, other\], not 'a'"),
        ("tasks: [a]\nmethods:\n  - 5\n", "line 2: setting methods takes text, not 5"),
        ("seeds: 2.5\n", "line 1: setting seeds takes a whole number, not 2.5"),
        ("tasks: [a\nseeds: 2\n", "not a readable sweep file .*line 2"),
        ("- a\n", "not a sweep file; it has keys such as"),
        ("", "not a sweep file"),
    ],
)
def test_a_wrong_file_is_named_with_its_line(tmp_path, text, said):
    path = tmp_path / "sweep.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match=f"^{path}(: |, ){said}"):
        read_grid(path)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match=r"sweep\.yaml: not a readable sweep file \(.*No such file"):
        read_grid(tmp_path / "sweep.yaml")


@pytest.fixture
def made(write_result):
    """made(folder, "gat", 1, 30.0) puts a smoke result of that method and seed there, which took so many seconds."""

    def put(folder, name, seed, seconds, jobs=1):
        method = get_method(name)
        settings = vars(load_settings(method.settings, method.preset, "smoke", PENDULUM)) if name == "direct" else {}
        path = RunSettings(PENDULUM, name, 50, "smoke", seed).folder(folder) / "result.json"
        times = {"wall_clock_s": {"grounding": 0.0, "total": seconds}, "machine": {"jobs": jobs}}
        write_result(path, 0.5, pair=get_task(PENDULUM).to_dict(), settings=settings, **times)

    return put


def test_the_plan_says_what_is_there_and_how_long_the_rest_takes(tmp_path, made):
    out, board = tmp_path / "out", tmp_path / "board"
    grid = Grid(tasks=(PENDULUM,), methods=("direct", "gat"), samples=(50,), seeds=4, preset="smoke")
    assert plan_of(grid, out, (out, board)).words(2) == "8 runs; 8 to do, 2 at a time, one process and thread each: time not known"
    made(out, "direct", 0, 10.0)
    made(board, "direct", 1, 20.0)
    made(board, "direct", 2, 1.0, jobs=2)  # not as a sweep makes them
    plan = plan_of(grid, out, (out, board))
    assert len(plan.missing) == 7
    assert RunSettings(PENDULUM, "direct", 50, "smoke", 0) not in plan.missing
    # Three runs of 15 s in two processes.
    said = "8 runs, 1 of them there already; 7 to do, 2 at a time, one process and thread each: about 22 s for 3 of them, not known for the others"
    assert plan.words(2) == said
    made(board, "gat", 7, 900.0)
    assert plan_of(grid, out, (out, board)).words(2).endswith("each: about 30 min")
    assert plan_of(grid, out, (out, board)).words(100).endswith("7 at a time, one process and thread each: about 15 min")
    for seed in range(1, 4):
        made(out, "direct", seed, 10.0)
    only = Grid(tasks=(PENDULUM,), methods=("direct",), seeds=4, preset="smoke")
    assert plan_of(only, out, ()).words(2) == "4 runs, 4 of them there already: nothing to do"


def test_what_is_in_a_runs_place_and_not_its_result_is_known_before_any_work(tmp_path, made):
    made(tmp_path, "gat", 0, 1.0)  # with other settings than the preset's
    with pytest.raises(UserError, match="holds a result with other settings"):
        plan_of(Grid(tasks=(PENDULUM,), methods=("gat",), samples=(50,), preset="smoke"), tmp_path, ())


def test_what_is_wrong_with_the_grid_of_a_file_alone_is_said_of_the_file(tmp_path):
    path = tmp_path / "sweep.yaml"
    path.write_text("tasks: [hoper]\nmethods: [direct]\n")
    with pytest.raises(UserError, match=r"sweep\.yaml: unknown task 'hoper'"):
        plan_of(Grid(**read_grid(path)), tmp_path, (), path)
