"""Which code made a file."""

from __future__ import annotations

import subprocess
from pathlib import Path


def commit() -> str | None:
    """The commit of the checkout that the package lies in, marked if it has been changed; None outside a checkout."""
    try:
        answer = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"], cwd=Path(__file__).parent, capture_output=True, text=True
        )
    except OSError:
        return None
    return answer.stdout.strip() or None
