"""A data set at a glance: subjects downwards, poses across, each shape as its depth camera sees it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import canonical_entry
from benchmark.errors import ConfigurationError, DatasetError, ShapeError
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import camera_coordinates, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.preparation import Preparation
from benchmark.pipeline.recipes import sensor_of
from benchmark.report.pictures.painting import SUPERSAMPLING, depth_picture, shaded

#: Poses of each subject, unless told otherwise.
POSES = 8

#: Pixels that a sheet is wide at most.
WIDTH = 1600

_SMALLEST, _ROOMY, _LARGEST = 40, 84, 160
"""Pixels per side of a picture before its white borders go; from the second on, the three-quarter view joins in."""

_NEAR, _GAP, _MARGIN, _FONT_SIZE, _LINE = 3, 12, 8, 12, 18
_ROUNDING = 2
"""Pixels that a cropped picture keeps beyond the share of the shape: one on each side may be covered in part."""

_INK, _FAINT = (0, 0, 0), (110, 110, 110)

_COLOURS = 128
"""Two ramps of shades against white need no larger palette, and the file shrinks to a third."""


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


def contact_sheet(dataset: Dataset, n_subjects: int | None = None, n_poses: int = POSES) -> ContactSheet:
    """Draw some poses of some subjects, each as the shaded surface beside the depth image.

    The surface fills its picture, and where there is room it is shown from aside as well. The depth images share the
    scale of the data set, so they show how large the shapes are.

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
        If the data set is empty.
    """
    rows = select(dataset, n_subjects, n_poses)
    half_width = Preparation(dataset, "view").half_width
    sights: dict[str, _Sight] = {}
    problems = []
    for entry in (entry for row in rows for entry in row):
        try:
            mesh = clean(dataset.load(entry))[0]
            render_depth(mesh, dataset.camera(entry), half_width, 1)  # refuses what does not fit the frame
            sights[entry.identifier] = _Sight(mesh, dataset.camera(entry), half_width, sensor_of(dataset, entry))
        except ShapeError as error:
            problems.append(f"{entry.identifier}: {error}")
    layout = _Layout.of(rows, sights)
    image = _draw(rows, sights, layout, _heading(dataset, rows))
    # Maximum coverage changes no shade by more than a few levels; the default method spoils rare ones, such as labels.
    few = image.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    return ContactSheet(few, tuple(problems))


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
class _Sight:
    """One shape before its camera; its pictures are centred squares: the surface, perhaps from aside, and its depth."""

    mesh: Mesh
    camera: Camera
    half_width: float
    sensor: DepthSensor | None = None

    def cameras(self, aside: bool) -> tuple[Camera, ...]:
        return (self.camera, _three_quarter(self.camera)) if aside else (self.camera,)

    def shares(self, aside: bool) -> NDArray[np.float64]:
        """Share of the square that each picture fills at most, shape (pictures, 2): width, height."""
        extents = [np.ptp(camera_coordinates(self.mesh, camera), axis=0)[:2] for camera in self.cameras(aside)]
        surfaces = [extent / max(extent.max(), 1e-12) for extent in extents]
        return np.array([*surfaces, extents[0] / (2 * self.half_width)])

    def pictures(self, aside: bool, size: int) -> list[Image.Image]:
        """The pictures, squares of so many pixels."""
        image = render_depth(self.mesh, self.camera, self.half_width, size * SUPERSAMPLING)
        depth = depth_picture(image if self.sensor is None else self.sensor.perturbed(image), size)
        return [*(shaded(self.mesh, camera, size) for camera in self.cameras(aside)), depth]


@dataclass(frozen=True)
class _Layout:
    """Layout of a sheet, in pixels.

    Parameters
    ----------
    size
        Side of the square pictures.
    widths
        What is left of their width in each column, one number per picture.
    heights
        What is left of their height in each row.
    indent
        Left of the first column.
    aside
        Whether there is room for the three-quarter view.
    same_poses
        Whether the rows show the same poses, so that naming them once is enough.
    """

    size: int
    widths: tuple[tuple[int, ...], ...]
    heights: tuple[int, ...]
    indent: int
    aside: bool
    same_poses: bool

    @classmethod
    def of(cls, rows: Sequence[Sequence[Entry]], sights: Mapping[str, _Sight]) -> _Layout:
        indent = _MARGIN + max(_text_width(row[0].subject) for row in rows) + _GAP
        poses = {tuple(entry.pose for entry in row) for row in rows}
        n_columns = max(len(row) for row in rows)
        for aside in (True, False):
            n_pictures = 3 if aside else 2
            shares = np.full((len(rows), n_columns, n_pictures, 2), 0.1)  # a cross needs some room, too
            for i, row in enumerate(rows):
                for j, entry in enumerate(row):
                    if entry.identifier in sights:
                        shares[i, j] = sights[entry.identifier].shares(aside)
            across, down = shares[..., 0].max(axis=0), shares[..., 1].max(axis=(1, 2))
            gaps = n_columns * (_GAP + (n_pictures - 1) * _NEAR) - _GAP
            room = WIDTH - indent - _MARGIN - gaps - _ROUNDING * across.size
            size = min(int(room / across.sum()), _LARGEST)
            if size >= _ROOMY:
                break
        if size < _SMALLEST:
            raise ConfigurationError(f"{n_columns} poses do not fit a width of {WIDTH} pixels", "show fewer poses")
        widths = tuple(tuple(column) for column in _pixels(across, size).tolist())
        return cls(size, widths, tuple(_pixels(down, size).tolist()), indent, aside, same_poses=len(poses) == 1)

    def left(self, column: int) -> int:
        return self.indent + sum(self.width(j) + _GAP for j in range(column))

    def top(self, row: int) -> int:
        lines = 2 if self.same_poses else row + 2
        return _MARGIN + lines * _LINE + _NEAR + sum(self.heights[:row]) + row * _GAP

    def width(self, column: int) -> int:
        return sum(self.widths[column]) + (len(self.widths[column]) - 1) * _NEAR

    @property
    def whole(self) -> tuple[int, int]:
        """Width and height of the sheet."""
        right = self.left(len(self.widths)) - _GAP + _MARGIN
        return right, self.top(len(self.heights) - 1) + self.heights[-1] + _MARGIN


def _draw(rows: Sequence[Sequence[Entry]], sights: Mapping[str, _Sight], layout: _Layout, heading: str) -> Image.Image:
    sheet = Image.new("RGB", layout.whole, "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((_MARGIN, _MARGIN), heading, fill=_INK, font=_font())
    for i, row in enumerate(rows):
        top, height = layout.top(i), layout.heights[i]
        pen.text((_MARGIN, top + height // 2), row[0].subject, fill=_INK, font=_font(), anchor="lm")
        for j, entry in enumerate(row):
            left, width = layout.left(j), layout.width(j)
            if i == 0 or not layout.same_poses:
                where = (left + width // 2, top - _NEAR - _LINE // 2)
                pen.text(where, _shortened(entry.pose, width), fill=_FAINT, font=_font(), anchor="mm")
            if entry.identifier not in sights:
                pen.line((left, top, left + width, top + height), fill=_FAINT)
                pen.line((left, top + height, left + width, top), fill=_FAINT)
                continue
            pictures = sights[entry.identifier].pictures(layout.aside, layout.size)
            for picture, kept in zip(pictures, layout.widths[j], strict=True):
                sheet.paste(_cropped(picture, kept, height), (left, top))
                left += kept + _NEAR
    return sheet


def _three_quarter(camera: Camera) -> Camera:
    """The camera moved to its right, which is where an animal seen from the side has its head, and up a little."""
    right, up, backwards = camera.rotation
    x, y, z = -backwards - 0.8 * right - 0.25 * up
    return Camera((x, y, z), camera.up)


def _cropped(picture: Image.Image, width: int, height: int) -> Image.Image:
    """The middle of a square picture."""
    top, left = (picture.height - height) // 2, (picture.width - width) // 2
    return picture.crop((left, top, left + width, top + height))


def _pixels(shares: NDArray[np.float64], size: int) -> NDArray[np.int64]:
    """Pixels that hold a share of the picture in its middle, up to the whole."""
    return np.minimum(np.floor(shares * size).astype(np.int64) + _ROUNDING, size)


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
