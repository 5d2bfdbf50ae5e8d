"""Figures in print, the same wherever they were made: of a score, the last bits differ between processors."""

from __future__ import annotations

from decimal import ROUND_HALF_UP, Decimal

#: Stands where there is no figure.
BLANK = "--"


def millionths(value: float) -> float:
    """Return a figure without what differs between processors, for a comparison that decides something in print."""
    return round(float(value), 6) + 0.0


def number(value: float | None, decimals: int = 2) -> str:
    """Return a figure with so many decimals: rounded to 1e-6, then half up."""
    if value is None:
        return BLANK
    rounded = Decimal(repr(millionths(value))).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return str(rounded + 0)  # nothing is negative that reads as zero
