"""How reports write scores, seconds and the names of files."""

from __future__ import annotations

import math
import re

from benchmark.code_digest import digest_of_bytes

#: What stands in place of a value that does not exist.
BLANK = "--"

#: Characters of the name of a file, at most.
_LONGEST_FILE_NAME = 80


def two_decimals(value: float | None) -> str:
    """Return a score with two decimals.

    Records hold six decimals; a half of the last one that is shown rounds up.
    """
    if value is None or math.isnan(value):
        return BLANK
    rounded = math.floor(round(value * 1e6) / 1e4 + 0.5) / 100
    return f"{rounded:.2f}"


def hundredths(value: float | None) -> str:
    """Return a score with two decimals and no leading zero; see :func:`two_decimals`."""
    return two_decimals(value).removeprefix("0")


def signed_hundredths(difference: float) -> str:
    """Return a difference of scores with its sign, rounded as scores are.

    A - B and B - A have the same digits.
    """
    size = hundredths(abs(difference))
    is_negative = difference < 0 and size != hundredths(0)
    sign = "-" if is_negative else "+"
    return sign + size


def two_digits(seconds: float) -> str:
    """Return seconds in two digits."""
    if seconds < 0.995:  # which would be rounded to 1.00
        return hundredths(seconds)
    if seconds < 9.95:
        return f"{seconds:.1f}"
    return f"{seconds:.0f}"


def file_name(name: str) -> str:
    """Return a name as that of a file, with a digest where characters were lost."""
    safe = re.sub(r"[^A-Za-z0-9._-]", "-", name)[:_LONGEST_FILE_NAME]
    if safe == name:
        return safe
    digest = digest_of_bytes(name.encode())[:8]
    return f"{safe.strip('-')}-{digest}"
