"""What was tried and what it crossed, as text and as JSON."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

from tests.faults.cases import Border, Outcome, crossed

#: Borders that have a column of their own.
COLUMNS = {Border.LOST: "lost", Border.HALF: "half", Border.ORPHAN: "orphans", Border.STALL: "stalls"}


def rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One row a section, and one for all."""
    sections = dict.fromkeys(outcome.section for outcome in outcomes)
    found = [_row(name, [outcome for outcome in outcomes if outcome.section == name]) for name in sections]
    return [*found, _row("all", outcomes)]


def as_json(outcomes: Sequence[Outcome], seed: int, seconds: float) -> dict[str, Any]:
    """All figures and all crossings."""
    return {
        "seed": seed,
        "seconds": round(seconds, 1),
        "sections": rows(outcomes),
        "crossings": [
            {"case": outcome.name, "border": crossing.border.name.lower(), "said": crossing.said}
            for outcome in outcomes
            for crossing in outcome.crossings
        ],
    }


def as_text(outcomes: Sequence[Outcome], seed: int, seconds: float) -> str:
    """A table in Markdown, and below it each crossing with the command that makes it again."""
    keys = ("section", "cases", "tried", "crossed", *COLUMNS.values(), "recovery_median", "recovery_max")
    header = (*keys[:-2], "recovery s, median", "max")
    lines = [header, ["---", *["---:"] * (len(header) - 1)]]
    lines += [["" if row[key] is None else str(row[key]) for key in keys] for row in rows(outcomes)]
    text = "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
    text += f"\nSeed {seed}, {seconds:.0f} s.\n"
    for outcome in outcomes:
        for crossing in outcome.crossings:
            text += f"\n{outcome.name}: {crossing.border}\n    {crossing.said}\n    {again(outcome, seed)}\n"
    return text


def again(outcome: Outcome, seed: int) -> str:
    """Command that tries a case again."""
    return f"python -m tests.faults --only {outcome.name} --seed {seed}"


def _row(name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    recoveries = [seconds for outcome in outcomes for seconds in outcome.recoveries]
    return {
        "section": name,
        "cases": len(outcomes),
        "tried": sum(outcome.tried for outcome in outcomes),
        "crossed": sum(len(outcome.crossings) for outcome in outcomes),
        **{column: crossed(outcomes, border) for border, column in COLUMNS.items()},
        "recovery_median": round(statistics.median(recoveries), 1) if recoveries else None,
        "recovery_max": round(max(recoveries), 1) if recoveries else None,
        "seconds": round(sum(outcome.seconds for outcome in outcomes), 1),
    }
