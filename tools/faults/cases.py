"""What all sections speak of: borders that must not be crossed, cases that try them, and what came of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tools.faults.scene import Scene


class Border(StrEnum):
    """What no fault may bring about."""

    LOST = "a finished record was lost or changed"
    HALF = "half a record was left"
    ORPHAN = "a process outlived its run"
    STALL = "no end within the time allowed"
    TRACEBACK = "a traceback reached the user"
    EXIT_CODE = "the exit code is none of those documented"
    SILENCE = "nothing, or not the right thing, was said about what is wrong"
    SCORES = "scores differ from those of an undisturbed run"
    SPREAD = "the fault cost more than its own shape or job"
    PROGRAM = "the fault program itself went wrong"


@dataclass(frozen=True)
class Crossing:
    """A border that was crossed, and how."""

    border: Border
    said: str


@dataclass(frozen=True)
class Case:
    """One fault to try.

    Parameters
    ----------
    name
        Unique name, ``section/what``; with the seed it says all about the case.
    act
        Makes the fault in a scene, and tells the scene of borders that were crossed.
    """

    name: str
    act: Callable[[Scene], None]

    @property
    def section(self) -> str:
        """Name of its section."""
        return self.name.partition("/")[0]


@dataclass
class Outcome:
    """What came of one case.

    Parameters
    ----------
    name
        Name of the case.
    tried
        Faults that were made: kills, mutations, command lines.
    crossings
        Borders that were crossed.
    recoveries
        Seconds from a kill to the moment when work went on.
    seconds
        Time that the case took.
    """

    name: str
    tried: int = 0
    crossings: list[Crossing] = field(default_factory=list)
    recoveries: list[float] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def section(self) -> str:
        """Name of the section of the case."""
        return self.name.partition("/")[0]
