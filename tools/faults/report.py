"""What was tried and what it crossed, by section."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from benchmark.report.escaping import markdown_table
from tools.faults.cases import Border, Outcome

#: Borders that have a column of their own.
_COLUMNS = (Border.LOST, Border.HALF, Border.ORPHAN, Border.STALL)

_HEADER = (
    "section", "cases", "tried", "crossed", "records lost", "half records", "orphans", "stalls",
    "recovery s, median", "max",
)  # fmt: skip


def report(outcomes: Sequence[Outcome], seed: int, seconds: float) -> str:
    """A table in Markdown, one row a section, and below it each crossing with the command that makes it again."""
    sections = dict.fromkeys(outcome.section for outcome in outcomes)
    rows = [(section, *_cells([o for o in outcomes if o.section == section])) for section in sections]
    lines = markdown_table(_HEADER, [*rows, ("all", *_cells(outcomes))])
    lines += ["", f"Seed {seed}, {seconds:.0f} s."]
    for outcome in outcomes:
        for crossing in outcome.crossings:
            again = f"python -m tools.faults --only {outcome.name} --seed {seed}"
            lines += ["", f"{outcome.name}: {crossing.border}", f"    {crossing.said}", f"    {again}"]
    return "\n".join(lines) + "\n"


def _cells(outcomes: Sequence[Outcome]) -> list[str]:
    borders = [crossing.border for outcome in outcomes for crossing in outcome.crossings]
    recoveries = [seconds for outcome in outcomes for seconds in outcome.recoveries]
    counts = [len(outcomes), sum(outcome.tried for outcome in outcomes), len(borders)]
    counts += [borders.count(border) for border in _COLUMNS]
    times = [f"{statistics.median(recoveries):.1f}", f"{max(recoveries):.1f}"] if recoveries else ["", ""]
    return [str(count) for count in counts] + times
