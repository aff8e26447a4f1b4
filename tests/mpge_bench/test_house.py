"""The command line's modules: how long they and their functions are, and that they know of nothing but what they share."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import mpge_bench.cli

HOUSE = Path(mpge_bench.cli.__file__).parent
MODULES = sorted(HOUSE.glob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_functions_and_modules_are_short_enough_to_be_read(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 300
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            # A command's options and its help, which are its signature and docstring, are as many as they have to be; work is done elsewhere.
            body = node.body[1:] if ast.get_docstring(node) else node.body
            assert (node.end_lineno or 0) - body[0].lineno < 40, f"{path.stem}.{node.name}"


@pytest.mark.parametrize("path", [path for path in MODULES if path.stem != "__init__"], ids=lambda path: path.stem)
def test_a_module_of_commands_imports_what_is_shared_and_no_other(path: Path) -> None:
    imported = {node.module or "" for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)}
    ours = {name for name in imported if f"{name}.".startswith("mpge_bench.cli.")}
    assert ours == (set() if path.stem == "shared" else {"mpge_bench.cli.shared"})
