"""How functions of plain numbers and arrays are turned into machine code."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from typing import Any, TypeVar, cast

# One code path on every processor, as `mpge_bench.numerics` has it for the other libraries; read while numba is imported. It also makes what is compiled good
# for every machine that shares the cache.
os.environ.setdefault("NUMBA_CPU_NAME", "x86-64-v2" if platform.machine() == "x86_64" else "generic")
os.environ.setdefault("NUMBA_CPU_FEATURES", "")

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """`function` as machine code, kept on disk: no fused or reordered arithmetic, and divisions by zero as numpy's."""
    return cast(Function, numba.njit(cache=True, fastmath=False, error_model="numpy", nogil=True)(function))
