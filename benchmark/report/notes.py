"""Notes below a table: facts about the jobs behind it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from benchmark.api.contracts import Input
from benchmark.protocols.tables import INPUTS
from benchmark.reference import paper
from benchmark.report.content import OUTDATED, TIED, Row, TableContent
from benchmark.report.rounding import number
from benchmark.text import brief
from retrieval.measures import PRINTED

#: Share of the largest loss from which on a table tells how much was lost.
_WORTH_TELLING = 0.01

_MARKS = (
    "Bold: best of the column, controls aside; italic: not to be told from the best row of the column "
    "for other poses of these subjects (paired permutation test over queries, Holm's correction, 5 %)."
)

_OF_PREPARATIONS = "Standard deviation over {} preparations of vertices jittered by a millionth of the extent, {}: {}."

_OF_MEANS = "Mean ± standard deviation (n - 1) over the galleries, each ranked by itself."


def notes(table: TableContent, *, reasons: bool = True) -> list[str]:
    """Return what a reader must know: thinned galleries, trainings, jobs without scores, departures from sources.

    Parameters
    ----------
    table
        What they stand below.
    reasons
        Whether to say of each outdated row what has changed.
    """
    lines = []
    if table.quick:
        lines.append("Quick run: some poses of each subject were left out.")
    if table.n_galleries > 1:
        lines.append(_OF_MEANS)
    if any(judged.is_inseparable for judged in table.significance.values()):
        lines.append(_MARKS)
    lines += _tied(table)
    lines += _preparations(table)
    lines += _left_out(table)
    if trained := _trainings(table):
        lines += trained
        printed = {row.method for row in (*paper.ROWS, *paper.ABLATION)}
        if not table.is_own and any(row.models and row.method in printed for row in table.rows):
            lines.append(f"The paper's schedule: {paper.SCHEDULE}.")
    lines += _area(table)
    lines += [line for row in table.rows for line in _of_jobs(row)]
    lines += [f"{', '.join(titles)}, {what}" for what, titles in _without_scores(table).items()]
    outdated = _outdated(table)
    if reasons:
        lines += [f"{OUTDATED} {', '.join(titles)}: {what}" for what, titles in outdated.items()]
    elif outdated:
        lines.append(f"{OUTDATED} Made before the last change of code or packages.")
    lines += _not_here(table)
    if bridges := _bridges(table):
        lines.append(bridges)
    return [*lines, *_lost(table), *(f"{number} {text}" for number, text in table.departures.items())]


def _area(table: TableContent) -> Iterable[str]:
    """Say what metric size alone scores, which the learned network reads and no form shows."""
    for row in table.rows:
        scored = {input_: cell.scores for input_, cell in row.cells.items() if cell.scores}
        if row.method == "surface-area" and scored:
            figures = (
                f"{' '.join(f'{metric} {number(scores[metric], 2)}' for metric in PRINTED)} ({input_})"
                for input_, scores in scored.items()
            )
            yield f"The area alone, which rows that see metric size can read, scores {', '.join(figures)}."


def _not_here(table: TableContent) -> Iterable[str]:
    """Rows without a job under the inputs of the table: those that have one under another input, and the others."""
    blank = [row for row in table.rows if all(cell.status == "missing" for cell in row.cells.values())]
    for input_ in INPUTS:
        if titles := [row.title for row in blank if input_ in row.elsewhere]:
            yield f"Run on the {input_} input alone: {', '.join(titles)}."
    if titles := [row.title for row in blank if not row.elsewhere]:
        yield f"Not run: {', '.join(titles)}."


def _tied(table: TableContent) -> Iterable[str]:
    """Rows whose figures are means over the orders of results that tie at the first rank."""
    tied = [
        f"{row.title}, {input_} ({cell.n_tied} of {cell.n_queries} queries)"
        for row in table.rows
        for input_, cell in row.cells.items()
        if cell.n_tied
    ]
    if tied:
        yield f"{TIED} Results tie at the first rank; means over their orders, never italic: {'; '.join(tied)}."


def _preparations(table: TableContent) -> Iterable[str]:
    """Return how far rows move from one preparation to the next, for those that were prepared several times."""
    for input_ in table.inputs:
        told: dict[int, list[str]] = {}
        for row in table.rows:
            cell = row.cells.get(input_)
            if cell and (deviation := cell.preparation_sd):
                figures = " ".join(number(deviation[metric], 3) for metric in PRINTED)
                told.setdefault(len(cell.repeats), []).append(f"{row.title} {figures}")
        for count, rows in told.items():
            yield _OF_PREPARATIONS.format(count, f"{input_} {' '.join(PRINTED)}", "; ".join(rows))


def _left_out(table: TableContent) -> Iterable[str]:
    for row in table.rows:
        for input_, cell in row.cells.items():
            if left_out := cell.record.get("unsupported", []):
                names = ", ".join(brief(name) for name, _ in left_out[:3]) + (" ..." if len(left_out) > 3 else "")
                yield f"{row.title}, {input_}: {len(left_out)} unsupported ({names}): {brief(left_out[0][1])}"


def _without_scores(table: TableContent) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for row in table.rows:
        for input_, cell in row.cells.items():
            if cell.status not in ("ok", "missing"):
                reason = brief(cell.record.get("reason", ""))
                found.setdefault(f"{input_}: {cell.status}{': ' + reason if reason else ''}", []).append(row.title)
    return found


def _outdated(table: TableContent) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for row in table.rows:
        for cell in row.cells.values():
            if cell.outdated:
                of_rows = found.setdefault(f"made before the last change ({brief(cell.outdated)})", [])
                of_rows += [row.title] if row.title not in of_rows else []
    return found


def _trainings(table: TableContent) -> list[str]:
    """Return which schedule made the models, and on which data; rows that share them share a line."""
    titles: dict[str, list[str]] = {}
    for row in table.rows:
        by_schedule: dict[tuple[str, bool], list[str]] = {}
        for model in (model for cell in row.cells.values() for model in cell.models):
            by_schedule.setdefault((model["schedule"], model["extra_data"]), []).append(model["data"])
        for (schedule, extra), data in by_schedule.items():
            sets = list(dict.fromkeys(data))
            named = sets[0] + (f" (and {len(sets) - 1} more such sets)" if len(sets) > 1 else "")
            what = f"trained on {'extra data, ' if extra else ''}{named}: {schedule}"
            titles.setdefault(what, []).append(row.title)
    return [f"{'; '.join(of_rows)}: {what}" for what, of_rows in titles.items()]


def _bridges(table: TableContent) -> str:
    if (found := _noted(table, "bridges", "view")) and found["max"] > 0:
        return f"View input: {number(found['mean'], 1)} bridges per shape on average, {found['max']:.0f} at most."
    return ""


def _lost(table: TableContent) -> Iterable[str]:
    """Return how much of the shapes was lost before any method saw them, where it is worth telling."""
    for input_ in table.inputs:
        found = _noted(table, "lost_area", input_)
        if found and found["max"] > _WORTH_TELLING:
            what = "of what the camera sees" if input_ == "view" else "of the area"
            yield (
                f"{input_.capitalize()} input: preparation lost {found['mean']:.1%} {what} per shape on average, "
                f"{found['max']:.1%} at most."
            )


def _noted(table: TableContent, name: str, input_: Input) -> Mapping[str, float] | None:
    """Mean and maximum of what preparation noted: the same in all rows but for the shapes that they leave out."""
    for row in table.rows:
        records = row.cells[input_].records if input_ in row.cells else ()
        noted = [(record.get("notes", {}).get(name), record["n_shapes"]) for record in records]
        # A method may note something else by this name.
        found = [(each, shapes) for each, shapes in noted if each and {"mean", "max"} <= each.keys()]
        if found:
            total = sum(shapes for _, shapes in found)
            mean = sum(each["mean"] * shapes for each, shapes in found) / total
            return {"mean": mean, "max": max(each["max"] for each, _ in found)}
    return None


def _of_jobs(row: Row) -> Iterable[str]:
    """Return whether the models of a row had seen the shapes, and how many jobs are missing from its mean."""
    for input_, cell in row.cells.items():
        if seen := cell.record.get("seen"):
            yield f"{row.title}, {input_}: {len(seen)} of {cell.record['n_shapes']} shapes were seen in training"
        if differ := (cell.record.get("notes") or {}).get("runs_differ"):
            yield (
                f"{row.title}, {input_}: not repeatable, two runs on one shape differ by {differ['max']:.1e} of the "
                "largest number; `check` says more"
            )
        if 0 < cell.n_averaged < cell.n_wanted:
            yield (
                f"{row.title}, {input_}: mean of {cell.n_averaged} instead of {cell.n_wanted} "
                f"({brief(cell.record.get('reason', 'the others were not run'))})"
            )
