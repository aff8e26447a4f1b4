"""Numbers as text for people."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape

Array = npt.NDArray[np.float64]

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: Any, digits: int = 4) -> str:
    """`value` for reading: `digits` significant digits, powers of ten only where there is no other way, a dash where there is no number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or math.isnan(value):
        return "–"
    value = float(value)
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        return _minus(f"{value:.{max(digits - 1 - exponent, 0)}f}")
    mantissa = re.sub(r"\.?0+$", "", f"{value:.{digits - 1}e}".split("e")[0])
    return _minus(("" if mantissa == "1" else f"{mantissa} × ") + f"10{str(exponent).translate(_SUPERSCRIPTS)}")


def _minus(text: str) -> str:
    return text.replace("-", "−")


def estimate(value: Any, low: Any, high: Any) -> tuple[str, str, str]:
    """A value and its interval, all to the decimal place that the interval's width gives a meaning to."""
    known = finite_values((value, low, high))
    width = float(known.max() - known.min()) / 2 if len(known) == 3 else 0.0
    largest = float(np.abs(known).max()) if len(known) else 0.0
    if width <= 0 or not 1e-4 <= largest < 1e6:
        return number(value), number(low), number(high)
    # Two digits of the half width, but three to five of the largest value.
    size = math.floor(math.log10(largest))
    decimals = max(min(max(1 - math.floor(math.log10(width)), 2 - size), 4 - size), 0)
    return _fixed(value, decimals), _fixed(low, decimals), _fixed(high, decimals)


def _fixed(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return _minus(text.lstrip("-") if float(text) == 0 else text)


def listed(values: Any, count: int) -> list[Any]:
    return list(values) if isinstance(values, Sequence) and len(values) == count else [values] * count


def finite_values(values: Iterable[Any]) -> Array:
    return np.array([float(value) for value in values if isinstance(value, int | float | np.number) and math.isfinite(value)])


def percent(share: Any) -> str:
    if not isinstance(share, int | float | np.number) or not math.isfinite(share):
        return "–"
    # 99.6 % is not all of it, and 0.3 % is not nothing.
    return f"{100 * share:.1f} %" if 0 < share < 0.01 or 0.99 < share < 1 else f"{100 * share:.0f} %"


def breakable(name: str) -> Markup:
    """A name like ``coulomb_friction:elbow`` that a narrow page may break."""
    return Markup(re.sub(r"([_:])", r"\1<wbr>", str(escape(name))))


def unit_text(unit: Any) -> str:
    return "" if unit in (None, "1", "") else str(unit)
