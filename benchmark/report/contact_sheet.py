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
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, ShapeError
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import render_depth
from benchmark.report.drawing import SUPERSAMPLING, depth_picture, shaded
from benchmark.stages import Stages
from benchmark.store import Store
from retrieval.cmbof import CMBOF

#: Poses of each subject, unless told otherwise.
POSES = 8

#: Pixels that a sheet is wide at most.
WIDTH = 1600

_SMALLEST, _LARGEST = 40, 160
"""Pixels per side of a picture."""

_GAP, _MARGIN, _FONT_SIZE, _LINE = 6, 8, 12, 18
_INK, _FAINT = (0, 0, 0), (110, 110, 110)

_COLOURS = 128
"""Two ramps of shades against white need no larger palette, which halves the file."""


@dataclass(frozen=True)
class ContactSheet:
    """The picture of a data set.

    Parameters
    ----------
    image
        With a palette, ready to be written.
    problems
        One line for each shape that cannot be drawn; its place is crossed out.
    """

    image: Image.Image
    problems: tuple[str, ...]

    def save(self, path: Path) -> None:
        """Write a PNG without date or version, so that the same sheet is the same file.

        Raises
        ------
        BenchmarkError
            If the name does not end in ``.png``, or the file cannot be written.
        """
        if path.suffix.lower() != ".png":
            raise BenchmarkError(f"{path} is not the name of a PNG file", "let it end in .png")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.image.save(path, optimize=True)
        except OSError as error:
            raise BenchmarkError(f"cannot write {path}: {error.strerror}", "choose another file with -o") from error


def contact_sheet(dataset: Dataset, n_subjects: int | None = None, n_poses: int = POSES) -> ContactSheet:
    """Draw some poses of some subjects, each as the shaded surface beside the depth image.

    The surface fills its picture. The depth image has the scale of the data set, so it shows how large the shapes are
    and that none is cut off.

    Parameters
    ----------
    dataset
        The data set.
    n_subjects
        Rows; None shows all subjects.
    n_poses
        Columns; a subject with fewer poses has a shorter row.

    Raises
    ------
    ConfigurationError
        If a number is not positive, or so many poses do not fit the width.
    DatasetError
        If the data set is empty, or a shape extends beyond the frame of the camera.
    """
    rows = select(dataset, n_subjects, n_poses)
    layout = _Layout.of(rows)
    # The frame of a set that declares none is a stage of the view, for which all shapes are looked at.
    with tempfile.TemporaryDirectory() as folder:
        half_width = Stages(Store.open(Path(folder)), dataset, "view", 0, CMBOF()).half_width
    sheet = Image.new("RGB", layout.size, "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((_MARGIN, _MARGIN), _heading(dataset, rows), fill=_INK, font=_font())
    problems = []
    for i, row in enumerate(rows):
        middle = layout.corner(i, 0)[1] + layout.picture // 2
        pen.text((_MARGIN, middle), row[0].subject, fill=_INK, font=_font(), anchor="lm")
        for j, entry in enumerate(row):
            x, y = layout.corner(i, j)
            if i == 0 or not layout.same_poses:
                label = _shortened(entry.pose, layout.cell)
                pen.text((x + layout.cell // 2, y - _LINE // 2), label, fill=_FAINT, font=_font(), anchor="mm")
            try:
                sheet.paste(_cell(dataset, entry, half_width, layout.picture), (x, y))
            except ShapeError as error:
                problems.append(f"{entry.identifier}: {error}")
                right, bottom = x + layout.cell, y + layout.picture
                pen.line((x, y, right, bottom), fill=_FAINT)
                pen.line((x, bottom, right, y), fill=_FAINT)
    return ContactSheet(sheet.quantize(_COLOURS, dither=Image.Dither.NONE), tuple(problems))


def select(dataset: Dataset, n_subjects: int | None = None, n_poses: int = POSES) -> list[list[Entry]]:
    """Choose the shapes of a sheet, spread evenly over the subjects and over the poses of each.

    Parameters
    ----------
    dataset, n_subjects, n_poses
        See :func:`contact_sheet`.

    Returns
    -------
    list of list of Entry
        A row for each subject, in the order of the data set; the canonical pose leads, the others keep their order.

    Raises
    ------
    ConfigurationError
        If a number is not positive.
    DatasetError
        If the data set is empty.
    """
    if n_poses < 1 or (n_subjects is not None and n_subjects < 1):
        raise ConfigurationError("a sheet shows at least one subject in one pose", "pass positive numbers")
    if not dataset.entries:
        raise DatasetError(f"data set '{dataset.name}' has no meshes", "check its folder")
    shapes: dict[str, list[Entry]] = {}
    for entry in dataset.entries:
        shapes.setdefault(entry.subject, []).append(entry)
    subjects = list(shapes)
    rows = []
    for i in _evenly(len(subjects), n_subjects or len(subjects)):
        first = canonical_entry(dataset, subjects[i])
        ordered = [first, *(entry for entry in shapes[subjects[i]] if entry != first)]
        rows.append([ordered[j] for j in _evenly(len(ordered), n_poses)])
    return rows


@dataclass(frozen=True)
class _Layout:
    """Where things are, in pixels from the upper left corner."""

    rows: int
    columns: int
    indent: int
    picture: int
    same_poses: bool

    @classmethod
    def of(cls, rows: Sequence[Sequence[Entry]]) -> _Layout:
        columns = max(len(row) for row in rows)
        indent = _MARGIN + max(_text_width(row[0].subject) for row in rows) + _GAP
        picture = min(((WIDTH - indent - _MARGIN + _GAP) // columns - _GAP) // 2, _LARGEST)
        if picture < _SMALLEST:
            raise ConfigurationError(f"{columns} poses do not fit a width of {WIDTH} pixels", "show fewer poses")
        poses = {tuple(entry.pose for entry in row) for row in rows}
        return cls(len(rows), columns, indent, picture, same_poses=len(poses) == 1)

    @property
    def cell(self) -> int:
        """Width of a surface and a depth image."""
        return 2 * self.picture

    @property
    def size(self) -> tuple[int, int]:
        right, bottom = self.corner(self.rows - 1, self.columns - 1)
        return right + self.cell + _MARGIN, bottom + self.picture + _MARGIN

    def corner(self, row: int, column: int) -> tuple[int, int]:
        """Upper left corner of a cell; poses are named above each cell, or once if they are the same in all rows."""
        lines = 1 if self.same_poses else row + 1
        top = _MARGIN + _LINE + _GAP + lines * _LINE + row * (self.picture + _GAP)
        return self.indent + column * (self.cell + _GAP), top


def _cell(dataset: Dataset, entry: Entry, half_width: float, size: int) -> Image.Image:
    mesh, camera = clean(dataset.load(entry))[0], dataset.camera(entry)
    fine = size * SUPERSAMPLING
    depth = depth_picture(render_depth(mesh, camera, half_width, fine), fine)
    depth = depth.reshape(size, SUPERSAMPLING, size, SUPERSAMPLING, 3).mean(axis=(1, 3))
    pictures = np.concatenate([shaded(mesh, camera, size), depth], axis=1)
    return Image.fromarray(np.round(255 * pictures).astype(np.uint8))


def _heading(dataset: Dataset, rows: Sequence[Sequence[Entry]]) -> str:
    n_subjects = len({entry.subject for entry in dataset.entries})
    shown = sum(len(row) for row in rows)
    return f"{dataset.title}: {len(rows)} of {n_subjects} subjects, {shown} of {len(dataset.entries)} shapes"


def _evenly(count: int, wanted: int) -> list[int]:
    """Indices below ``count``, the first and the last among them; all where fewer are there than wanted."""
    wanted = min(wanted, count)
    return [round(i * (count - 1) / max(wanted - 1, 1)) for i in range(wanted)]


def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    # Pillow carries this one along, so a sheet looks the same wherever it is drawn.
    return ImageFont.load_default(_FONT_SIZE)


def _text_width(text: str) -> int:
    return int(np.ceil(_font().getlength(text)))


def _shortened(text: str, width: int) -> str:
    if _text_width(text) <= width:
        return text
    while text and _text_width(f"{text}…") > width:
        text = text[:-1]
    return f"{text}…"
