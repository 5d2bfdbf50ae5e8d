"""What a table says, before it is LaTeX, Markdown, CSV or JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmark.contracts import Input
from benchmark.plan import Job
from benchmark.protocols import Gallery
from benchmark.reference import paper
from benchmark.registry import MethodSpec
from benchmark.store import Store

Scores = Mapping[str, float]


@dataclass(frozen=True)
class Cell:
    """What one method reached under one input.

    Parameters
    ----------
    status
        Status of the record, state of the job when there is no record, or ``"pending"`` for a method not built yet.
    record
        The record of the job; empty without one.
    """

    status: str
    record: Mapping[str, Any]

    @property
    def scores(self) -> Scores | None:
        """Scores by metric, or None when there are none."""
        return self.record.get("scores")


@dataclass(frozen=True)
class Row:
    """One method: its figures in the paper and ours by input."""

    method: str
    title: str
    family: str
    paper: Scores | None
    cells: Mapping[Input, Cell]


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
        """What a reader must know: thinned galleries, shapes left out, bridges, jobs without scores."""
        lines = []
        if self.gallery.quick:
            lines.append("Quick run: some poses of each subject were left out.")
        for row in self.rows:
            for input_, cell in row.cells.items():
                left_out = cell.record.get("unsupported", [])
                if left_out:
                    names = ", ".join(name for name, _ in left_out[:3]) + (" ..." if len(left_out) > 3 else "")
                    lines.append(f"{row.title}, {input_}: {len(left_out)} unsupported ({names}): {left_out[0][1]}")
                if cell.status not in ("ok", "pending", *NOT_RUN) and not (left_out and cell.scores):
                    reason = cell.record.get("reason", "")
                    lines.append(f"{row.title}, {input_}: {cell.status}{': ' + reason if reason else ''}")
        not_run = [row.title for row in self.rows if any(cell.status in NOT_RUN for cell in row.cells.values())]
        if not_run:
            lines.append(f"Not run yet: {', '.join(not_run)}.")
        bridges = self._bridges()
        if bridges:
            lines.append(bridges)
        return lines

    def _bridges(self) -> str:
        for row in self.rows:
            cell = row.cells.get("view")
            found = cell.record.get("notes", {}).get("bridges") if cell else None
            if found:
                return f"View input: {found['mean']:.1f} bridges per shape on average, {found['max']:.0f} at most."
        return ""


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
    by_gallery: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        by_gallery.setdefault((job.gallery.table.identifier, job.gallery.name), []).append(job)
    return [_content(group, store) for group in by_gallery.values()]


def _content(jobs: Sequence[Job], store: Store) -> TableContent:
    from retrieval.chance import chance_levels

    gallery = jobs[0].gallery
    inputs = tuple(dict.fromkeys(job.input for job in jobs))
    cells: dict[str, dict[Input, Cell]] = {}
    specs: dict[str, MethodSpec] = {}
    for job in jobs:
        record = (store.read_record(job.key) if job.key else None) or {"reason": job.reason}
        cells.setdefault(job.method.name, {})[job.input] = Cell(record.get("status", job.state), record)
        specs[job.method.name] = job.method
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


def _others(
    cells: Mapping[str, Mapping[Input, Cell]], printed: Iterable[str], specs: Mapping[str, MethodSpec]
) -> list[str]:
    """Methods without a row in the paper that were run: further forms first, controls last."""
    rest = [
        name
        for name, by_input in cells.items()
        if name not in set(printed) and any(cell.status not in NOT_RUN for cell in by_input.values())
    ]
    return sorted(rest, key=lambda name: specs[name].info.family == "control")
