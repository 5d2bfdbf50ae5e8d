"""One figure of a table before it is printed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Scores = Mapping[str, float]


@dataclass(frozen=True)
class Cell:
    """What one method reached under one input.

    Parameters
    ----------
    status
        Status of the record, state of the job when there is no record, or ``"pending"`` for a method not built yet.
    record
        The record of the job; empty without one. For the mean of several jobs, what they tell together.
    spread
        Standard deviation of several jobs by metric; None for a single one.
    n_averaged, n_wanted
        Jobs that the scores are the mean of, and jobs that there should be.
    """

    status: str
    record: Mapping[str, Any]
    spread: Scores | None = None
    n_averaged: int = 1
    n_wanted: int = 1

    @property
    def scores(self) -> Scores | None:
        """Scores by metric, or None when there are none."""
        return self.record.get("scores")

    @property
    def models(self) -> list[Mapping[str, Any]]:
        """Trained models behind the scores, each once; empty for a method that does not learn."""
        return list({model["digest"]: model for model in self.record.get("models", ())}.values())
