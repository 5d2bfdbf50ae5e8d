"""What a table says, before it is LaTeX, Markdown, CSV or JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmark.contracts import Input
from benchmark.jobs.plan import Job
from benchmark.methods.registry import MethodSpec
from benchmark.protocols.tables import Gallery
from benchmark.reference import paper
from benchmark.report.ablation import averaged, row_of
from benchmark.report.cell import Cell, Scores
from benchmark.storage.store import Store


@dataclass(frozen=True)
class Row:
    """One method: its figures in the paper and ours by input."""

    method: str
    title: str
    family: str
    paper: Scores | None
    cells: Mapping[Input, Cell]

    @property
    def models(self) -> list[Mapping[str, Any]]:
        """Trained models behind the row; empty for a method that does not learn."""
        return [model for cell in self.cells.values() for model in cell.models]

    @property
    def label(self) -> str:
        """Title as printed: a row with training data beyond the paper's says so, a mean tells of how many models."""
        extra = "extra training data"
        told = [extra] if any(model["extra_data"] for model in self.models) and extra not in self.title else []
        if self.models and any(cell.n_wanted > 1 for cell in self.cells.values()):
            told.append(f"{len(self.models)} model{'' if len(self.models) == 1 else 's'}")
        return self.title + (f" ({', '.join(told)})" if told else "")


@dataclass(frozen=True)
class TableContent:
    """One table on one gallery.

    Parameters
    ----------
    gallery
        The shapes, and whether they are a stand-in.
    inputs
        The inputs that were asked for.
    rows
        The paper's methods in the paper's order, then all others.
    chance
        Expected scores of a random ranking of the gallery.
    """

    gallery: Gallery
    inputs: tuple[Input, ...]
    rows: tuple[Row, ...]
    chance: Scores

    @property
    def identifier(self) -> str:
        """The paper's numeral, or the name of the data set."""
        return self.gallery.table.identifier

    @property
    def file_stem(self) -> str:
        """Name of the files of this table."""
        dataset = self.gallery.dataset.name
        parts = ["table", self.identifier] + ([dataset] if dataset != self.identifier else [])
        return "-".join(parts + (["quick"] if self.gallery.quick else []))

    @property
    def has_paper(self) -> bool:
        """Whether the paper has this table."""
        return any(row.paper for row in self.rows)

    @property
    def data_title(self) -> str:
        """The data in words, never without saying that it is a stand-in."""
        dataset = self.gallery.dataset
        if dataset.stand_in_for:
            official = OFFICIAL_TITLES.get(dataset.stand_in_for, dataset.stand_in_for)
            return f"generated stand-in '{dataset.name}', not {official}"
        return dataset.title

    @property
    def size(self) -> str:
        """Number of shapes and classes in words."""
        subjects = {entry.subject for entry in self.gallery.entries}
        return f"{len(self.gallery.entries)} shapes, {len(subjects)} classes"

    def notes(self) -> list[str]:
        """What a reader must know: thinned galleries, shapes left out, trainings, bridges, jobs without scores."""
        lines = []
        if self.gallery.quick:
            lines.append("Quick run: some poses of each subject were left out.")
        if self.gallery.table.ablation:
            lines.append(_OF_ABLATIONS)
        without_scores: dict[str, list[str]] = {}
        for row in self.rows:
            for input_, cell in row.cells.items():
                left_out = cell.record.get("unsupported", [])
                if left_out:
                    names = ", ".join(name for name, _ in left_out[:3]) + (" ..." if len(left_out) > 3 else "")
                    lines.append(f"{row.title}, {input_}: {len(left_out)} unsupported ({names}): {left_out[0][1]}")
                if cell.status not in ("ok", "pending", *NOT_RUN) and not (left_out and cell.scores):
                    reason = cell.record.get("reason", "")
                    without_scores.setdefault(f"{input_}: {cell.status}{': ' + reason if reason else ''}", []).append(
                        row.title
                    )
        trained = self._trainings()
        if trained:
            lines += [*trained, f"The paper's schedule: {paper.SCHEDULE}."]
        lines += [line for row in self.rows for line in self._of_models(row)]
        lines += [f"{', '.join(titles)}, {what}" for what, titles in without_scores.items()]
        not_run = [row.title for row in self.rows if any(cell.status in NOT_RUN for cell in row.cells.values())]
        if not_run:
            lines.append(f"Not run yet: {', '.join(not_run)}.")
        bridges = self._bridges()
        if bridges:
            lines.append(bridges)
        return lines

    def _trainings(self) -> list[str]:
        """Which schedule made the models, and on which data; rows that share them share a line."""
        titles: dict[str, list[str]] = {}
        for row in self.rows:
            by_schedule: dict[tuple[str, bool], list[str]] = {}
            for model in (model for cell in row.cells.values() for model in cell.models):
                by_schedule.setdefault((model["schedule"], model["extra_data"]), []).append(model["data"])
            for (schedule, extra), data in by_schedule.items():
                sets = list(dict.fromkeys(data))
                named = sets[0] + (f" (and {len(sets) - 1} more such sets)" if len(sets) > 1 else "")
                what = f"trained on {'extra data, ' if extra else ''}{named}: {schedule}"
                titles.setdefault(what, []).append(row.title)
        return [f"{'; '.join(of_rows)}: {what}" for what, of_rows in titles.items()]

    def _of_models(self, row: Row) -> Iterable[str]:
        """Whether the models of a row had seen the shapes, and how many there are."""
        for input_, cell in row.cells.items():
            if seen := cell.record.get("seen"):
                yield f"{row.title}, {input_}: {len(seen)} of {cell.record['n_shapes']} shapes were seen in training"
            if 0 < cell.n_averaged < cell.n_wanted:
                yield (
                    f"{row.title}, {input_}: mean of {cell.n_averaged} instead of {cell.n_wanted} "
                    f"({cell.record['reason']})"
                )

    def _bridges(self) -> str:
        for row in self.rows:
            cell = row.cells.get("view")
            found = cell.record.get("notes", {}).get("bridges") if cell else None
            if found:
                return f"View input: {found['mean']:.1f} bridges per shape on average, {found['max']:.0f} at most."
        return ""


_OF_ABLATIONS = (
    "Mean ± standard deviation (n - 1): over trainings with different seeds, all tested on the gallery of Table I; for "
    "learners that are trained once for each fold, over three galleries of five subjects."
)

#: States of jobs that would run.
NOT_RUN = ("missing", "stale")

OFFICIAL_TITLES = {"shrec14-synthetic": "SHREC'14 synthetic", "shrec14-real": "SHREC'14 real", "tosca": "TOSCA"}


def contents(jobs: Sequence[Job], store: Store) -> list[TableContent]:
    """Fill the tables that a plan stands for with what the store holds.

    Parameters
    ----------
    jobs
        The plan.
    store
        Where the records are.
    """
    by_table: dict[tuple[str, str, bool], list[Job]] = {}
    for job in jobs:
        gallery = job.gallery
        by_table.setdefault((gallery.table.identifier, gallery.dataset.name, gallery.quick), []).append(job)
    return [_content(group, store) for group in by_table.values()]


def _content(jobs: Sequence[Job], store: Store) -> TableContent:
    from retrieval.chance import chance_levels

    gallery = jobs[0].gallery
    inputs = tuple(dict.fromkeys(job.input for job in jobs))
    specs: dict[str, MethodSpec] = {}
    grouped: dict[str, dict[Input, list[Job]]] = {}
    for job in jobs:
        spec = row_of(job.method) if gallery.table.ablation else job.method
        specs[spec.name] = spec
        grouped.setdefault(spec.name, {}).setdefault(job.input, []).append(job)
    cells = {
        name: {input_: _cell(of_cell, store) for input_, of_cell in by_input.items()}
        for name, by_input in grouped.items()
    }
    printed = paper.rows(gallery.table.identifier)
    pending: dict[Input, Cell] = {input_: Cell("pending", {}) for input_ in inputs}
    rows = [
        Row(name, row.title, "paper", row.values[gallery.table.identifier], cells.get(name, pending))
        for name, row in printed.items()
    ]
    rows += [
        Row(name, specs[name].title, specs[name].info.family, None, cells[name])
        for name in _others(cells, printed, specs)
    ]
    return TableContent(gallery, inputs, tuple(rows), chance_levels([entry.subject for entry in gallery.entries]))


def _cell(jobs: Sequence[Job], store: Store) -> Cell:
    records = [(store.read_record(job.key) if job.key else None) or {"reason": job.reason} for job in jobs]
    if len(jobs) > 1:
        return averaged(jobs, records)
    return Cell(records[-1].get("status", jobs[-1].state), records[-1])


def _others(
    cells: Mapping[str, Mapping[Input, Cell]], printed: Iterable[str], specs: Mapping[str, MethodSpec]
) -> list[str]:
    """Methods without a row in the paper that were run: further forms first, controls last."""
    rest = [name for name, by_input in cells.items() if name not in set(printed) and _was_run(by_input.values())]
    return sorted(rest, key=lambda name: specs[name].info.family == "control")


def _was_run(cells: Iterable[Cell]) -> bool:
    """Whether some input was tried, or none can be: what waits for one input alone has no row yet."""
    statuses = [cell.status for cell in cells if cell.record.get("status") or cell.status in NOT_RUN]
    return not statuses or any(status not in NOT_RUN for status in statuses)
