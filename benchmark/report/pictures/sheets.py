"""Sheets of pictures: a data set at a glance, the steps from a depth image to a form, and retrieved shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageChops, ImageDraw, ImageFont

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.depth.frame import UPRIGHT
from benchmark.depth.reading import Depths, Mask
from benchmark.errors import ConfigurationError, DatasetError, ShapeError
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import fit_half_width, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.method_run import Preparation
from benchmark.pipeline.recipes import sensor_of
from benchmark.report.pictures.painting import SUPERSAMPLING, depth_picture, shaded
from benchmark.report.pictures.posing import select

#: Default number of poses of each subject, and largest width of a sheet in pixels.
POSES, WIDTH = 8, 1600

#: Pixels per side of a picture: the minimum, the minimum for adding three-quarter views, and the maximum.
_SMALLEST, _ROOMY, _LARGEST = 40, 84, 160

_NEAR, _GAP, _MARGIN, _LINE = 3, 12, 8, 18
_INK, _FAINT = (0, 0, 0), (110, 110, 110)

#: Size of the palette, enough for two ramps of shades; it reduces files to a third.
_COLOURS = 128

#: Height of the picture of a depth image, and side of that of a retrieved form, in pixels.
_HEIGHT, _SIDE = 300, 180
_OBJECT = np.array([0.95, 0.55, 0.2])


@dataclass(frozen=True)
class ContactSheet:
    """Picture of a data set with a palette, and a line for each shape that cannot be drawn and is crossed out."""

    image: Image.Image
    problems: tuple[str, ...]


def contact_sheet(dataset: ShapeSet, n_subjects: int | None = None, n_poses: int = POSES) -> ContactSheet:
    """Draw some poses of some subjects, each as a shaded surface and as a depth image.

    The surface fills its picture and, if there is room, is also shown from the side. The depth images have the scale of
    the data set, so they show the sizes of the shapes.

    Parameters
    ----------
    dataset
        The data set.
    n_subjects
        Number of rows; None shows all subjects.
    n_poses
        Number of columns; a subject with fewer poses has a shorter row.

    Raises
    ------
    ConfigurationError
        If a number is not positive, or the poses do not fit the width.
    DatasetError
        If the data set is empty.
    """
    if n_poses < 1 or (n_subjects is not None and n_subjects < 1):
        raise ConfigurationError("a sheet shows at least one subject in one pose", "pass positive numbers")
    if not dataset.shapes:
        raise DatasetError(f"data set '{dataset.name}' has no meshes", "check its folder")
    rows = select(dataset, dataset.shapes, n_subjects, n_poses)
    half_width = Preparation(dataset, "view").half_width
    pictures, problems = {}, []
    for entry in (entry for row in rows for entry in row):
        try:
            pictures[entry.identifier] = _pictures(dataset, entry, half_width)
        except ShapeError as error:
            problems.append(f"{entry.identifier}: {error}")
    n_all = len({entry.subject for entry in dataset.shapes})
    shown = f"{sum(map(len, rows))} of {len(dataset.shapes)} shapes"
    sheet = _sheet(rows, pictures, f"{dataset.title}: {len(rows)} of {n_all} subjects, {shown}")
    # Maximum coverage changes shades by a few levels at most; the default method spoils rare ones, such as labels.
    few = sheet.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    return ContactSheet(few, tuple(problems))


def frame_picture(depths: Depths, mask: Mask, form: Mesh) -> Image.Image:
    """Draw depths, the object in them, and its canonical form, as a depth image and as a surface.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing values.
    mask
        Pixels of the object, shape (h, w).
    form
        Vertices: right, up, towards the viewer.
    """
    seen = depths > 0
    near, far = np.percentile(depths[seen], (1, 99)) if seen.any() else (0.0, 1.0)
    shade = 0.9 - 0.75 * np.clip((depths - near) / max(far - near, 1e-9), 0, 1)
    grey = np.repeat(np.where(seen, shade, 1.0)[..., None], 3, axis=2)  # near points are bright, missing values white
    marked = np.where(mask[..., None], 0.35 * grey + 0.65 * _OBJECT * grey / 0.9, 0.35 + 0.65 * grey)
    canonical = render_depth(form, UPRIGHT, fit_half_width([form], UPRIGHT), _HEIGHT * SUPERSAMPLING)
    scaled = []
    for picture in (grey, marked):
        image = Image.fromarray(np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8))
        size = (max(1, round(image.width * _HEIGHT / image.height)), _HEIGHT)
        scaled.append(image.resize(size, Image.Resampling.LANCZOS))
    pictures = [*scaled, depth_picture(canonical, _HEIGHT), shaded(form, UPRIGHT, _HEIGHT)]
    return _beside(("depth", "object", "canonical depth", "canonical form"), pictures, 14)


def mesh_picture(mesh: Mesh, form: Mesh) -> Image.Image:
    """Draw a mesh (z up, facing -y) and its canonical form side by side."""
    return _beside(("shape", "canonical form"), [shaded(mesh, FRONT, _HEIGHT), shaded(form, UPRIGHT, _HEIGHT)], 14)


def retrieved_picture(panels: Sequence[tuple[str, Mesh | None]]) -> Image.Image:
    """Draw forms side by side, each below its text.

    Parameters
    ----------
    panels
        Lines of text, and a form (right, up, towards the viewer) or None for no picture; the query comes first.
    """
    blank = Image.new("RGB", (_SIDE, _SIDE), "white")
    return _beside([text for text, _ in panels], [shaded(m, UPRIGHT, _SIDE) if m else blank for _, m in panels], 12)


def _beside(texts: Sequence[str], pictures: Sequence[Image.Image], font_size: int) -> Image.Image:
    """Combine pictures of one height side by side, each below its text."""
    head = max(text.count("\n") + 1 for text in texts) * (font_size + 6) + _NEAR
    width = sum(picture.width for picture in pictures) + _GAP * (len(pictures) + 1)
    sheet = Image.new("RGB", (width, head + pictures[0].height + _GAP), "white")
    pen, font, left = ImageDraw.Draw(sheet), ImageFont.load_default(font_size), _GAP
    for text, picture in zip(texts, pictures, strict=True):
        pen.multiline_text((left, _NEAR), text, fill="black", font=font, spacing=3)
        sheet.paste(picture, (left, head))
        left += picture.width + _GAP
    return sheet


def _pictures(dataset: ShapeSet, entry: Entry, half_width: float) -> list[Image.Image]:
    """Return the surface, its side view, and its depth image as centred squares."""
    mesh, camera, sensor = clean(dataset.load(entry))[0], dataset.camera(entry), sensor_of(dataset, entry)
    image = render_depth(mesh, camera, half_width, _LARGEST * SUPERSAMPLING)
    right, up, backwards = camera.rotation
    x, y, z = -backwards - 0.8 * right - 0.25 * up  # an animal in side view faces right
    surfaces = [shaded(mesh, view, _LARGEST) for view in (camera, Camera((x, y, z), camera.up))]
    return [*surfaces, depth_picture(image if sensor is None else sensor.perturbed(image), _LARGEST)]


def _sheet(rows: Sequence[Sequence[Entry]], pictures: Mapping[str, list[Image.Image]], heading: str) -> Image.Image:
    n_columns = max(map(len, rows))
    extents = np.full((len(rows), n_columns, 3, 2), _LARGEST / 10)  # room for a cross
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            if entry.identifier in pictures:
                extents[i, j] = [_extent(picture) for picture in pictures[entry.identifier]]
    indent = _MARGIN + int(max(_FONT.getlength(row[0].subject) for row in rows)) + 1 + _GAP
    for shown in ([0, 1, 2], [0, 2]):
        across = extents[:, :, shown, 0].max(axis=0)
        room = WIDTH - indent - _MARGIN - n_columns * (_GAP + (len(shown) - 1) * _NEAR) + _GAP
        scale = min(room / across.sum(), 1.0)
        if scale * _LARGEST >= _ROOMY:
            break
    if scale * _LARGEST < _SMALLEST:
        raise ConfigurationError(f"{n_columns} poses do not fit a width of {WIDTH} pixels", "show fewer poses")
    widths = (across * scale).astype(int)
    columns = widths.sum(axis=1) + (len(shown) - 1) * _NEAR
    heights = (extents[:, :, shown, 1].max(axis=(1, 2)) * scale).astype(int)
    same_poses = len({tuple(entry.pose for entry in row) for row in rows}) == 1
    lefts = (indent + np.cumsum(columns + _GAP) - columns - _GAP).tolist()
    lines = 2 if same_poses else np.arange(len(rows)) + 2
    tops = (_MARGIN + lines * _LINE + _NEAR + np.cumsum(heights + _GAP) - heights - _GAP).tolist()
    sheet = Image.new("RGB", (lefts[-1] + int(columns[-1]) + _MARGIN, tops[-1] + int(heights[-1]) + _MARGIN), "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((_MARGIN, _MARGIN), heading, fill=_INK, font=_FONT)
    for row, top, height in zip(rows, tops, heights.tolist(), strict=True):
        pen.text((_MARGIN, top + height // 2), row[0].subject, fill=_INK, font=_FONT, anchor="lm")
        for entry, left, width, of_pictures in zip(row, lefts, columns.tolist(), widths.tolist(), strict=False):
            if top == tops[0] or not same_poses:
                where = (left + width // 2, top - _NEAR - _LINE // 2)
                pen.text(where, _shortened(entry.pose, width), fill=_FAINT, font=_FONT, anchor="mm")
            if entry.identifier not in pictures:
                pen.line((left, top, left + width, top + height), fill=_FAINT)
                pen.line((left, top + height, left + width, top), fill=_FAINT)
                continue
            for kind, wide in zip(shown, of_pictures, strict=True):
                sheet.paste(_cropped(pictures[entry.identifier][kind], wide, height, scale), (left, top))
                left += wide + _NEAR
    return sheet


def _extent(picture: Image.Image) -> tuple[int, int]:
    """Return width and height of the non-white part, for a crop about the centre."""
    box = ImageChops.invert(picture).getbbox() or (0, 0, 0, 0)
    middle = picture.width / 2
    return tuple(int(2 * max(middle - box[k], box[k + 2] - middle)) for k in (0, 1))  # type: ignore[return-value]


def _cropped(picture: Image.Image, width: int, height: int, scale: float) -> Image.Image:
    """Return the centre of a square picture, reduced in size."""
    x, y, middle = width / scale / 2, height / scale / 2, picture.width / 2
    box = (max(middle - x, 0), max(middle - y, 0), min(middle + x, picture.width), min(middle + y, picture.height))
    return picture.resize((width, height), Image.Resampling.LANCZOS, box)


# Bundled with Pillow, so sheets look the same on every machine.
_FONT = ImageFont.load_default(12)


def _shortened(text: str, width: int) -> str:
    if _FONT.getlength(text) <= width:
        return text
    while text and _FONT.getlength(f"{text}…") > width:
        text = text[:-1]
    return f"{text}…"
