"""Notes below a table: facts about its jobs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from benchmark.api.contracts import Input
from benchmark.protocols.tables import INPUTS
from benchmark.reference import paper
from benchmark.report.content import OUTDATED, TIED, TableContent
from benchmark.report.escaping import number
from benchmark.report.results import MISSING
from benchmark.text import brief
from retrieval.measures import PRINTED

#: Largest fraction of the surface that may be lost without a note.
_WORTH_TELLING = 0.01

_MARKS = (
    "Bold: best of the column, excluding controls; italic: not significantly different from the best row "
    "for other poses of these subjects (paired permutation test over queries, Holm's correction, 5 %)."
)


_OF_MEANS = "Mean ± standard deviation (n - 1) over the galleries, each ranked by itself."
_OF_TRAININGS = "Mean ± standard deviation (n - 1) over the trainings."


def notes(table: TableContent, *, reasons: bool = True, most: int | None = None) -> list[str]:
    """Return the notes of a table: reduced galleries, trainings, jobs without scores, departures from sources.

    Parameters
    ----------
    table
        The table.
    reasons
        Whether to explain why rows are outdated.
    most
        Maximum number of notes, the last of which counts the omitted ones; None for all.
    """
    lines = ["Quick run: some poses of each subject were omitted."] if table.quick else []
    if table.n_galleries > 1 or any(line.deviation for line in table.lines):
        lines.append(_OF_MEANS if table.n_galleries > 1 else _OF_TRAININGS)
    judged = (one for line in table.lines for one in table.judged(line).values())
    lines += [_MARKS] if any(one.is_inseparable for one in judged) else []
    lines += [*_tied(table), *_refused(table), *_trainings(table), *_area(table)]
    lines += [line for of_line in table.lines for line in _of_jobs(of_line)]
    failed = (
        (f"{line.input}: {': '.join(filter(None, (line.status, brief(line.reason))))}", line.title)
        for line in table.lines
        if line.status not in ("ok", MISSING)
    )
    lines += [f"{', '.join(titles)}, {failure}" for failure, titles in _titles(failed).items()]
    outdated = _titles((brief(line.outdated), line.title) for line in table.lines if line.outdated)
    if reasons:
        lines += [
            f"{OUTDATED} {', '.join(titles)}: made before the last change ({change})"
            for change, titles in outdated.items()
        ]
    elif outdated:
        lines.append(f"{OUTDATED} Made before the last change of code or packages.")
    lines += [*_not_here(table), *_of_preparation(table)]
    lines += [f"{number} {text}" for number, text in table.departures.items()]
    if most is None or len(lines) <= most:
        return lines
    return [*lines[: most - 1], f"{len(lines) - most + 1} more notes: 'tables' prints them."]


def _titles(rows: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Group titles of rows by a common text."""
    grouped: dict[str, dict[str, None]] = {}
    for text, title in rows:
        grouped.setdefault(text, {})[title] = None
    return {text: list(titles) for text, titles in grouped.items()}


def _tied(table: TableContent) -> Iterator[str]:
    """Name the rows whose scores are means over the orders of tied first ranks."""
    tied = [
        f"{line.title}, {line.input} ({line.n_tied} of {line.n_queries} queries)" for line in table.lines if line.n_tied
    ]
    if tied:
        yield f"{TIED} Ties at the first rank: scores are means over their orders, and never italic: {'; '.join(tied)}."


def _refused(table: TableContent) -> Iterator[str]:
    for line in table.lines:
        if refused := line.unsupported:
            names = ", ".join(brief(name) for name, _ in refused[:3]) + (" ..." if len(refused) > 3 else "")
            yield f"{line.title}, {line.input}: {len(refused)} unsupported ({names}): {brief(refused[0][1])}"


def _trainings(table: TableContent) -> Iterator[str]:
    """Describe schedule and training data of models; rows with the same ones share a note."""
    trainings: list[tuple[str, str]] = []
    for row in table.rows:
        by_schedule: dict[tuple[str, bool], dict[str, None]] = {}
        for model in (model for line in table.lines if line.method == row.method for model in line.models):
            by_schedule.setdefault((model["schedule"], model["extra_data"]), {})[model["data"]] = None
        for (schedule, has_extra), (first, *others) in by_schedule.items():
            named = first + (f" (and {len(others)} more such sets)" if others else "")
            trainings.append((f"trained on {'extra data, ' if has_extra else ''}{named}: {schedule}", row.title))
    yield from (f"{'; '.join(titles)}: {training}" for training, titles in _titles(trainings).items())
    learned = {line.method for line in table.lines if line.models}
    if not table.is_own and learned & {row.method for row in (*paper.ROWS, *paper.ABLATION)}:
        yield f"The paper's schedule: {paper.SCHEDULE}."


def _area(table: TableContent) -> Iterator[str]:
    """State the score of metric size, which the learned network can use but no form shows."""
    figures = [
        f"{' '.join(f'{measure} {number(line.scores[measure])}' for measure in PRINTED)} ({line.input})"
        for line in table.lines
        if line.method == "surface-area" and line.scores
    ]
    if figures:
        yield f"The surface area alone, which methods that see metric size can use, scores {', '.join(figures)}."


def _of_jobs(line: Any) -> Iterator[str]:
    """Describe shapes seen in training, runs that differ, and jobs missing from the mean of a row."""
    where = f"{line.title}, {line.input}"
    if line.seen:
        yield f"{where}: {len(line.seen)} of {line.n_shapes} shapes were seen in training"
    if differ := line.notes.get("runs_differ"):
        yield (
            f"{where}: not repeatable, two runs on one shape differ by {differ['max']:.1e} of the largest number; "
            "`check` says more"
        )
    if 0 < line.n_averaged < line.n_wanted:
        yield f"{where}: mean of {line.n_averaged} instead of {line.n_wanted} ({brief(line.reason)})"


def _not_here(table: TableContent) -> Iterator[str]:
    """Name the rows without a job: those with a job for another input, and the others."""
    run = {line.method for line in table.lines if line.status != MISSING}
    blank = [row for row in table.rows if row.method not in run]
    for input_ in INPUTS:
        if titles := [row.title for row in blank if input_ in row.run_under]:
            yield f"Run only on the {input_} input: {', '.join(titles)}."
    if titles := [row.title for row in blank if not row.run_under]:
        yield f"Not run: {', '.join(titles)}."


def _of_preparation(table: TableContent) -> Iterator[str]:
    """State the number of bridges between pieces and, if large, the fraction of the surface lost in preparation."""
    if (bridges := _noted(table, "bridges", "view")) and bridges["max"] > 0:
        yield f"View input: {number(bridges['mean'], 1)} bridges per shape on average, {bridges['max']:.0f} at most."
    for input_ in table.inputs:
        if (lost := _noted(table, "lost_area", input_)) and lost["max"] > _WORTH_TELLING:
            share = "of what the camera sees" if input_ == "view" else "of the area"
            yield (
                f"{input_.capitalize()} input: preparation lost {lost['mean']:.1%} {share} per shape on average, "
                f"{lost['max']:.1%} at most."
            )


def _noted(table: TableContent, name: str, input_: Input) -> Mapping[str, float] | None:
    """Return mean and maximum of a note of the preparation, which rows share except for omitted shapes."""
    for records in (line.records for line in table.lines if line.input == input_):
        noted = [(record.get("notes", {}).get(name), record["n_shapes"]) for record in records]
        # A method may use this name for another note.
        noted = [(summary, n_shapes) for summary, n_shapes in noted if summary and {"mean", "max"} <= summary.keys()]
        if noted:
            total = sum(n_shapes for _, n_shapes in noted)
            mean = sum(summary["mean"] * n_shapes for summary, n_shapes in noted) / total
            return {"mean": mean, "max": max(summary["max"] for summary, _ in noted)}
    return None
