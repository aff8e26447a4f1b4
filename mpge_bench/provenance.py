"""Which code made a file."""

from __future__ import annotations

import subprocess
from pathlib import Path

_ROOT = Path(__file__).parents[1]


def commit() -> str | None:
    """The commit of the checkout that the package lies in, marked if it has been changed; None outside a checkout.

    An installed package may well lie below some other project's checkout, as in a `.venv`.
    """
    if not (_ROOT / ".git").exists():
        return None
    try:
        answer = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"], cwd=_ROOT, capture_output=True, text=True)
    except OSError:
        return None
    return answer.stdout.strip() or None
