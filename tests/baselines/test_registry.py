"""How methods are found by their names."""

from __future__ import annotations

import subprocess
import sys

import pytest

from mpge_bench.baselines.method import Method
from mpge_bench.baselines.registry import ADDRESSES, get_method, methods
from mpge_bench.envs.errors import UserError


def test_every_address_leads_to_a_method():
    assert list(methods()) == list(ADDRESSES)
    assert all(isinstance(method, Method) for method in methods().values())
    assert get_method("mpg") is methods()["mpg"]


def test_names_are_known_without_torch_and_a_method_is_read_when_it_is_asked_for():
    program = """
import sys
from mpge_bench.baselines.registry import ADDRESSES, get_method
assert ADDRESSES and not {'torch', 'stable_baselines3', 'pandas'} & set(sys.modules)
get_method('direct')
assert 'mpge_bench.baselines.mpg' not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_unknown_method():
    with pytest.raises(UserError, match=f"unknown method 'mpgee'; choose one of: {', '.join(ADDRESSES)}; or give your own: my_package.mine:MyMethod"):
        get_method("mpgee")
