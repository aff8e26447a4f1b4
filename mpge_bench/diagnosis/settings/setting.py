"""What every threshold, constant and budget says of itself."""

from __future__ import annotations

from dataclasses import field
from typing import Any


def setting(value: Any, unit: str, reason: str) -> Any:
    """A field of settings with a default, its unit and the reason for it."""
    return field(default=value, metadata={"unit": unit, "reason": reason})
