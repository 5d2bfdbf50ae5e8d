"""A data set at a glance: subjects downwards, poses across, each shape as its depth camera sees it."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.canonical import canonical_entry
from benchmark.errors import ConfigurationError, DatasetError, ShapeError
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import Camera, render_depth
from benchmark.report import drawing
from benchmark.stages import Stages
from benchmark.store import Store
from retrieval.cmbof import CMBOF

#: A sheet is at most this many pixels wide, and a picture at most that many.
WIDTH, LARGEST = 1600, 160

#: Poses of each subject, unless told otherwise.
POSES = 8

_PICTURES = 2
_GAP, _MARGIN, _FONT_SIZE = 6, 8, 12
_BLACK, _GREY = (0, 0, 0), (90, 90, 90)
_COLOURS = 128
"""Colours of the palette: two ramps of shades against white need no more, and the file shrinks to a third."""


@dataclass(frozen=True)
class ContactSheet:
    """The picture of a data set.

    Parameters
    ----------
    image
        With a palette, ready to be written.
    problems
        One line for each shape that could not be drawn; its place is crossed out.
    """

    image: Image.Image
    problems: tuple[str, ...]

    def save(self, path: Path) -> None:
        """Write a PNG without date or version, so that the same sheet is the same file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self.image.save(path, format="PNG", optimize=True)


def contact_sheet(dataset: Dataset, n_subjects: int | None = None, n_poses: int = POSES) -> ContactSheet:
    """Draw some poses of some subjects: the shaded surface beside its depth image.

    The surface fills its picture; the depth image has the one scale of the data set, so it shows how large the shapes
    are and that they fit the frame.

    Parameters
    ----------
    dataset
        The data set.
    n_subjects
        Number of rows, evenly chosen; None shows all subjects.
    n_poses
        Number of columns: the canonical pose, and others of the subject, evenly chosen.

    Raises
    ------
    ConfigurationError
        If a number is not positive, or so many poses do not fit the width.
    DatasetError
        If the data set is empty, or a shape does not fit the frame of the camera.
    """
    rows = select(dataset, n_subjects, n_poses)
    with tempfile.TemporaryDirectory() as folder:  # the half width of an official set is a stage: it sees all shapes
        half_width = Stages(Store.open(Path(folder)), dataset, "view", 0, CMBOF()).half_width
    layout = _Layout.of(rows)
    sheet = Image.new("RGB", layout.size, "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((_MARGIN, _MARGIN), _heading(dataset, rows), fill=_BLACK, font=_font())
    problems = []
    for i, row in enumerate(rows):
        middle = layout.corner(i, 0)[1] + layout.picture // 2
        pen.text((_MARGIN, middle), row[0].subject, fill=_BLACK, font=_font(), anchor="lm")
        for j, entry in enumerate(row):
            x, y = layout.corner(i, j)
            if i == 0 or not layout.shared_poses:
                where = (x + layout.cell // 2, y - 2)
                pen.text(where, layout.fitted(entry.pose), fill=_GREY, font=_font(), anchor="md")
            try:
                pictures = _pictures(dataset, entry, half_width, layout.picture)
            except ShapeError as error:
                problems.append(f"{entry.identifier}: {error}")
                pen.line((x, y, x + layout.cell, y + layout.picture), fill=_GREY)
                pen.line((x, y + layout.picture, x + layout.cell, y), fill=_GREY)
                continue
            for k, picture in enumerate(pictures):
                sheet.paste(picture, (x + k * layout.picture, y))
    return ContactSheet(sheet.quantize(_COLOURS, dither=Image.Dither.NONE), tuple(problems))


def select(dataset: Dataset, n_subjects: int | None, n_poses: int) -> list[list[Entry]]:
    """Choose the shapes of a sheet, row by row.

    Parameters
    ----------
    dataset, n_subjects, n_poses
        See :func:`contact_sheet`.

    Returns
    -------
    list of list of Entry
        One row for each subject, in the order of the data set; the canonical pose comes first, the others keep their
        order. A subject that has fewer poses has a shorter row.

    Raises
    ------
    ConfigurationError
        If a number is not positive.
    DatasetError
        If the data set is empty.
    """
    if n_poses < 1 or (n_subjects is not None and n_subjects < 1):
        raise ConfigurationError("a sheet needs at least one subject and one pose", "pass positive numbers")
    if not dataset.entries:
        raise DatasetError(f"data set '{dataset.name}' has no meshes", "check its folder")
    shapes: dict[str, list[Entry]] = {}
    for entry in dataset.entries:
        shapes.setdefault(entry.subject, []).append(entry)
    rows = []
    for subject in _evenly(list(shapes), n_subjects or len(shapes)):
        first = canonical_entry(dataset, subject)
        rows.append(_evenly([first, *(entry for entry in shapes[subject] if entry != first)], n_poses))
    return rows


def _evenly[T](items: Sequence[T], count: int) -> list[T]:
    count = min(count, len(items))
    return [items[round(i * (len(items) - 1) / max(count - 1, 1))] for i in range(count)]
