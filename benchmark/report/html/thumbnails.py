"""Small pictures of the shapes of a data set, on sheets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image

from benchmark.datasets.base import Entry
from benchmark.errors import BenchmarkError
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.html.folder import Folder
from benchmark.report.pictures.painting import outwardness, painted
from benchmark.report.pictures.posing import centred, reach
from benchmark.storage.records import Record

#: Pixels per side of a picture, and pictures in a row and on a sheet.
SIDE, ACROSS, ON_SHEET = 96, 10, 100

#: Shapes of a data set that have pictures; of larger sets these are spread evenly.
MOST_PICTURES = 1000

_MARGIN = 1.05


def write_thumbnails(stem: str, records: Sequence[Record], artefacts: ArtefactReader, folder: Folder) -> dict[str, int]:
    """Draw the shapes of some records whose surfaces are kept.

    Returns
    -------
    dict
        Place of each picture by the name of the shape: picture k is on sheet k // 100, at k % 100.
    """
    source: dict[str, Record] = {}
    for record in sorted(records, key=lambda each: each["input"] != "mesh"):  # whole surfaces where they are there
        for shape in record["shapes"]:
            source.setdefault(shape, record)
    entries = _entries(records, artefacts)
    wanted = [name for name in source if name in entries]
    chosen = np.unique(np.linspace(0, max(len(wanted) - 1, 0), min(MOST_PICTURES, len(wanted))).astype(int)).tolist()
    places: dict[str, int] = {}
    sheet: Image.Image | None = None
    for name in (wanted[k] for k in chosen):
        picture = _picture(entries[name], source[name], artefacts)
        if picture is None:
            continue
        number, k = divmod(len(places), ON_SHEET)
        if sheet is None:
            sheet = Image.new("RGBA", (SIDE * ACROSS, SIDE * (ON_SHEET // ACROSS)))
        sheet.paste(picture, (SIDE * (k % ACROSS), SIDE * (k // ACROSS)))
        places[name] = len(places)
        if k == ON_SHEET - 1:
            folder.picture(f"parts/pictures/{stem}-{number}.webp", sheet)
            sheet = None
    if sheet is not None:
        folder.picture(f"parts/pictures/{stem}-{(len(places) - 1) // ON_SHEET}.webp", sheet)
    return places


def _entries(records: Sequence[Record], artefacts: ArtefactReader) -> dict[str, Entry]:
    for record in records:
        try:
            return {entry.identifier: entry for entry in artefacts.dataset(record).entries}
        except BenchmarkError:
            continue
    return {}


def _picture(entry: Entry, record: Record, artefacts: ArtefactReader) -> Image.Image | None:
    surface = artefacts.surface(record, entry)
    if surface is None:
        return None
    points = centred(artefacts.seen(record, entry, surface))
    return painted(points, surface.faces, outwardness(surface), SIDE, _MARGIN * reach(points))
