"""How functions of plain numbers and arrays are turned into machine code; `mpge_bench.numerics` says for which processor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """`function` as numba compiles it, kept on disk where that is possible: no fused or reordered arithmetic, and divisions by zero as numpy's."""
    try:
        return cast(Function, numba.njit(cache=True, error_model="numpy")(function))
    except RuntimeError:  # neither the function's folder nor the user's cache can be written
        return cast(Function, numba.njit(error_model="numpy")(function))
