"""A figure of the canonical forms that are kept in a results folder; nothing is made anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from benchmark.api.contracts import Input
from benchmark.errors import BenchmarkError
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import Row, TableContent
from benchmark.report.pictures.forms import WIDTH, Forms, drawn, poses_of, turned, untreated
from benchmark.report.statistics.table_significance import CONTROL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Methods that have room beside each other, and inches of the widest column.
_MOST, _COLUMN = 8, 1.25


def kept_forms_figure(table: TableContent, artefacts: ArtefactReader) -> Figure | None:
    """Draw the first subject of a table in a few poses, and the kept forms of its methods; None where none is kept."""
    for input_ in table.inputs:
        rows = [row for row in table.rows if input_ in row.cells and row.cells[input_].records]
        columns = _columns([row for row in rows if row.family != CONTROL], input_, artefacts)
        if len(columns) > 1:
            return drawn(columns, min(WIDTH, _COLUMN * len(columns)))
    return None


def _columns(rows: Sequence[Row], input_: Input, artefacts: ArtefactReader) -> list[Forms]:
    """The shapes, then the forms of each method; empty where the shapes are not here."""
    found: list[Forms] = []
    for row in rows:
        record = dict(row.cells[input_].records[0])
        try:
            shapes = [entry for entry in artefacts.dataset(record).entries if entry.identifier in record["shapes"]]
        except BenchmarkError:
            return []
        entries = poses_of(shapes, shapes[0].subject)
        surfaces = [artefacts.surface(record, entry) for entry in entries]
        meshes = [mesh for mesh in surfaces if mesh is not None]
        if len(meshes) < len(entries):
            continue
        seen = [artefacts.seen(record, entry, mesh) for entry, mesh in zip(entries, meshes, strict=True)]
        forms = turned(row.title, [artefacts.form(record, entry) for entry in entries], meshes, seen)
        found = found or [untreated(meshes, seen)]
        if not all(isinstance(form, str) for form in forms.meshes) and len(found) <= _MOST:
            found.append(forms)
    return found
