"""One code path of the math libraries on every x86-64 machine, so that a seed gives the same result everywhere.

numpy, OpenBLAS, MKL and torch choose among routines for the processor they find; these round differently, and learning carries a last bit into another
policy. `fix` asks all of them for AVX2's, which every x86-64 processor since 2013 (AMD: 2015) has, and for one thread, since sums split over threads round
differently, too. numba compiles for the processor it finds; it is to do so for any with AVX2 (x86-64-v3), and without FMA, which rounds once where a product
and a sum round twice. All of it acts through environment variables, which the libraries read while they are imported, and worker processes inherit.

What is left: another version of a library (results name theirs), a processor without AVX2, and the C library's sine and the like, which PyBullet and what
numba compiles call and which choose by the processor as well (with FMA or without). And torch's own arithmetic is not quite what MKL promises: on two
processors alike in all of this, groundings came out otherwise in the last bits, under every value of MKL_CBWR, while all that numpy, numba and PyBullet make
was the same (`tests/mpge_bench/harness/metrics.json` has both). After long learning that is another policy.
"""

from __future__ import annotations

import os
import sys

#: What each library is asked for. numpy's groups of instructions have had several names; those that a version does not know it ignores.
_WANTED = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL",
    "OPENBLAS_CORETYPE": "Haswell",
    "MKL_CBWR": "AVX2",
    "ATEN_CPU_CAPABILITY": "avx2",
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "NUMBA_CPU_NAME": "x86-64-v3",
    "NUMBA_CPU_FEATURES": "+avx2,-fma",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}


#: Set where the common code path could not be asked for, so that worker processes do not take it either: all of a run's shall be alike.
_LEFT = "MPGE_BENCH_CODE_PATH_LEFT"


def fix() -> None:
    """Ask for the common code path, but where the environment asks for another one already, or numpy was imported before."""
    if "numpy" in sys.modules or not _has_avx2():
        os.environ.setdefault(_LEFT, "1")
    elif _LEFT not in os.environ:
        for name, value in _WANTED.items():
            os.environ.setdefault(name, value)


def is_fixed() -> bool:
    """Whether this process runs on the common code path, as far as its environment tells."""
    return all(os.environ.get(name) == value for name, value in _WANTED.items())


def environment() -> dict[str, str]:
    """The variables that put a process which does not inherit them on this one's code path."""
    return {name: os.environ[name] for name in (*_WANTED, _LEFT) if name in os.environ}


def _has_avx2() -> bool:
    try:
        with open("/proc/cpuinfo") as file:
            return any(line.startswith("flags") and " avx2 " in f"{line.strip()} " for line in file)
    except OSError:
        return False  # no Linux: the libraries choose
