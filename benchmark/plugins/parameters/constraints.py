"""Constraints that a parameter declares beside its type: which of the values of that type it takes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

__all__ = ["Constraint", "Interval", "Matches", "OneOf"]


@dataclass(frozen=True)
class Interval:
    """The numbers between two bounds; never NaN, and infinite in no case.

    Parameters
    ----------
    low, high
        The bounds; None where there is none.
    closed
        Which of the bounds belong to it: ``"both"``, ``"left"``, ``"right"`` or ``"neither"``.
    """

    low: float | None = None
    high: float | None = None
    closed: Literal["both", "left", "right", "neither"] = "both"

    def admit(self, value: Any) -> Any:
        """Return the value if it lies inside, or raise ``ValueError``."""
        above = self.low is None or self.low < value or (self.low == value and self.closed in ("both", "left"))
        below = self.high is None or value < self.high or (self.high == value and self.closed in ("both", "right"))
        if not (above and below and math.isfinite(value)):
            raise ValueError
        return value

    def __str__(self) -> str:
        low = high = ""
        if self.low is not None:
            low = f"{'of at least' if self.closed in ('both', 'left') else 'above'} {self.low:g}"
        if self.high is not None:
            high = f"{'of at most' if self.closed in ('both', 'right') else 'below'} {self.high:g}"
        return " and ".join(filter(None, (low, high))) or "that is finite"


Names = Iterable[str] | Mapping[str, str]


@dataclass(frozen=True)
class OneOf:
    """One of the names that are known when the parameter is looked at.

    Parameters
    ----------
    names
        The names, or a mapping from each way to write one to the name that it stands for, or a function that returns
        either, for what is expensive to import.
    """

    names: Names | Callable[[], Names]

    @property
    def known(self) -> Mapping[str, str]:
        """The name that each way to write one stands for."""
        names = self.names() if callable(self.names) else self.names
        return names if isinstance(names, Mapping) else {name: name for name in names}

    def admit(self, value: Any) -> Any:
        """Return the name that the value stands for, or raise ``ValueError``."""
        if value not in (known := self.known):
            raise ValueError
        return known[value]

    def __str__(self) -> str:
        return " or ".join(self.known)


@dataclass(frozen=True)
class Matches:
    """The texts of one form.

    Parameters
    ----------
    pattern
        A regular expression for the whole text.
    words
        What such a text is, in words.
    """

    pattern: str
    words: str

    def admit(self, value: Any) -> Any:
        """Return the value if it has the form, or raise ``ValueError``."""
        if not re.fullmatch(self.pattern, value):
            raise ValueError
        return value

    def __str__(self) -> str:
        return self.words


@runtime_checkable
class Constraint(Protocol):
    """Condition on a value besides its type; as text, what to write instead."""

    def admit(self, value: Any) -> Any:
        """Return the value as it is to be known, or raise ``ValueError``."""
        ...
