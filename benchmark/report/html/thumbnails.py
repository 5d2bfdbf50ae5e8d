"""Small pictures of the shapes of a data set and of all their forms, on sheets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmark.api.contracts import Input
from benchmark.datasets.base import Entry
from benchmark.errors import BenchmarkError
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.storage.records import Record
from benchmark.protocols.tables import INPUTS
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.html.scripts import Files, Progress, add_picture
from benchmark.report.pictures.painting import outwardness, painted
from benchmark.report.pictures.posing import centred, reach, upright
from benchmark.text import brief

#: Pixels per side of a picture, pictures in a row of a sheet, and rows.
SIDE, ACROSS, DOWN = 80, 10, 5
ON_SHEET = ACROSS * DOWN

#: Shapes of a data set that have pictures; of larger sets these are spread evenly.
MOST_PICTURES = 1000

#: Pictures of forms in the whole report, at one or two kilobytes and about thirty milliseconds each.
MOST_SMALL_FORMS = 16_000

T = TypeVar("T")

_NOT_DRAWN = "not drawn: one report has no room for all forms; choose fewer with -t, -d, -m or --input"
_MARGIN = 1.05


@dataclass(frozen=True)
class Sheets:
    """Pictures of the shapes of a data set under one input, and of their forms.

    Parameters
    ----------
    stem
        How the names of the files begin.
    places
        Place of each shape, the same on the sheets of all methods: the one at k is on sheet k // 50, at k % 50.
    numbers
        Number of each method in the names of its files; 0 is the shapes themselves.
    told
        By method and shape: "" for a picture of its form, and else why there is none.
    """

    stem: str
    places: dict[str, int] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)
    told: dict[str, dict[str, str]] = field(default_factory=dict)


def write_thumbnails(
    stem: str,
    records: Sequence[Record],
    artefacts: ArtefactReader,
    files: Files,
    most_shapes: int,
    say: Progress,
) -> dict[Input, Sheets]:
    """Draw the shapes of some records whose surfaces are kept, and what is kept of their forms.

    Parameters
    ----------
    stem
        Name of the files.
    records
        Records with scores of one data set.
    artefacts
        Where surfaces and forms are.
    files
        Where they are added.
    most_shapes
        Shapes whose forms are drawn, under each input.
    say
        Told how many shapes are drawn, where they are many.

    Returns
    -------
    dict
        By input, where each picture is.
    """
    entries = _entries(records, artefacts)
    found: dict[Input, Sheets] = {}
    for input_ in INPUTS:
        by_method: dict[str, dict[str, Record]] = {}
        for record in (record for record in records if record["input"] == input_):
            of_method = by_method.setdefault(record["method"], {})
            for shape in record["shapes"]:
                of_method.setdefault(shape, record)
        if by_method:
            drawing = _Drawing(Sheets(f"{stem}-{input_}"), by_method, artefacts, files, say)
            drawing.draw(entries, most_shapes)
            found[input_] = drawing.sheets
    return found


@dataclass
class _Drawing:
    """The sheets of one input while they are drawn."""

    sheets: Sheets
    by_method: Mapping[str, Mapping[str, Record]]
    artefacts: ArtefactReader
    files: Files
    say: Progress
    _open: dict[int, Image.Image] = field(default_factory=dict)

    def draw(self, entries: Mapping[str, Entry], most_shapes: int) -> None:
        """Draw the shapes that have entries, those of a subject after each other."""
        source = {shape: record for of_method in self.by_method.values() for shape, record in of_method.items()}
        order = {entry.subject: number for number, entry in enumerate(entries.values())}
        names = sorted((name for name in source if name in entries), key=lambda name: order[entries[name].subject])
        shown = spread(names, MOST_PICTURES)
        with_forms = set(spread(shown, most_shapes))
        self.sheets.numbers.update({method: number for number, method in enumerate(self.by_method, 1)})
        subject, models = "", dict[str, Points]()
        for name in shown:
            entry = entries[name]
            if entry.subject != subject:
                subject, models = entry.subject, {}
            surface = self.artefacts.surface(source[name], entry)
            if surface is not None:
                self._draw(entry, surface, source[name], models if name in with_forms else None)
        self._close()

    def _draw(self, entry: Entry, surface: Mesh, record: Record, models: dict[str, Points] | None) -> None:
        """Draw a shape and, as far as they are kept, its forms: turned as those of the same subject are, if asked."""
        place = self.sheets.places[entry.identifier] = len(self.sheets.places)
        seen, values = self.artefacts.seen(record, entry, surface), outwardness(surface)
        self._paint(0, place, surface.with_vertices(seen), values)
        for method, number in self.sheets.numbers.items():
            of_method = self.by_method[method].get(entry.identifier)
            if of_method is None:
                continue
            form = _NOT_DRAWN if models is None else self.artefacts.form(of_method, entry, surface)
            self.sheets.told.setdefault(method, {})[entry.identifier] = brief(form) if isinstance(form, str) else ""
            if isinstance(form, str) or models is None:
                continue
            points = upright(form, surface, seen, models.get(method))
            models.setdefault(method, points)
            has_own = not np.array_equal(form.faces, surface.faces)
            self._paint(number, place, form.with_vertices(points), outwardness(form) if has_own else values)
        if place % ON_SHEET == ON_SHEET - 1:
            self._close()
            self.say(f"{place + 1} shapes drawn with their forms")

    def _paint(self, number: int, place: int, mesh: Mesh, values: NDArray[np.float64]) -> None:
        points = centred(mesh.vertices)
        picture = painted(points, mesh.faces, values, SIDE, _MARGIN * reach(points))
        row, column = divmod(place % ON_SHEET, ACROSS)
        if number not in self._open:
            self._open[number] = Image.new("RGBA", (SIDE * ACROSS, SIDE * DOWN))
        self._open[number].paste(picture, (SIDE * column, SIDE * row))

    def _close(self) -> None:
        """Write the sheets that have pictures."""
        sheet = (len(self.sheets.places) - 1) // ON_SHEET
        for number, image in self._open.items():
            add_picture(self.files, f"{self.sheets.stem}-{number}-{sheet}", image)
        self._open.clear()


def spread(values: Sequence[T], most: int) -> list[T]:
    """Return so many of the values, evenly spread."""
    places = np.unique(np.linspace(0, max(len(values) - 1, 0), min(most, len(values))).astype(int))
    return [values[k] for k in places.tolist()]


def _entries(records: Sequence[Record], artefacts: ArtefactReader) -> dict[str, Entry]:
    for record in records:
        try:
            return {entry.identifier: entry for entry in artefacts.dataset(record).entries}
        except BenchmarkError:
            continue
    return {}
