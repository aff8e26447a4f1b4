"""How many processes side by side a machine carries."""

from __future__ import annotations

import math
import os
from pathlib import Path

#: What a container may use, as control groups say it: microseconds of processor time, or "max", in so many.
_QUOTA = Path("/sys/fs/cgroup/cpu.max")


def cores() -> int:
    """Processor cores that this process may use: those it is bound to (by taskset, a batch system), and no more than its container's quota."""
    bound = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = _QUOTA.read_text().split()
        return max(1, min(bound, math.ceil(int(quota) / int(period))))
    except (OSError, ValueError):
        return bound
