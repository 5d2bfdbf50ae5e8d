"""Sheets of pictures: a data set at a glance, the steps from a depth image to a form, and retrieved shapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import by_subject
from benchmark.depth.frame import UPRIGHT
from benchmark.depth.reading import Depths, Mask
from benchmark.errors import DatasetError, ShapeError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import common_half_width, fit_half_width, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.report.drawing import OBLIQUE, depth_picture, shaded
from benchmark.report.forms import Drawn, seen, upright

T = TypeVar("T")

#: Most subjects, and poses of each, on a sheet, and pixels of a picture.
SUBJECTS, POSES, _PIXELS = 40, 6, 96

_GAP, _TEXT = 10, 12

#: Height of the picture of a depth image, and side of that of a retrieved form, in pixels.
_HEIGHT, _SIDE = 300, 180
_OBJECT = np.array([0.95, 0.55, 0.2])


def contact_sheet(shapes: ShapeSet) -> tuple[Image.Image, list[str]]:
    """Draw some poses of each subject, as a shaded surface and as a depth image at the scale of the data set.

    Returns
    -------
    tuple of PIL.Image.Image and list of str
        The picture, whose ``info`` names the shapes, and a line for each shape that cannot be drawn and is grey.

    Raises
    ------
    DatasetError
        If the data set is empty.
    """
    if not shapes.shapes:
        raise DatasetError(f"data set '{shapes.name}' has no meshes", "check its folder")
    subjects = by_subject(shapes.shapes)
    rows = [spread(of, POSES) for of in spread([*subjects.values()], SUBJECTS)]
    pictures, problems = _pictures(shapes, [entry for row in rows for entry in row])
    shown = f"{len(rows)} of {len(subjects)} subjects, {sum(map(len, rows))} of {len(shapes.shapes)} shapes"
    strips = [_beside([f"{shapes.title}: {shown}"], [_blank(len(shapes.title + shown) * 8, 1)], _TEXT)]
    margin = _blank(8 * max(len(row[0].subject) for row in rows), _PIXELS)
    missing = _blank(2 * _PIXELS, _PIXELS, "silver")
    for row in rows:
        names = [row[0].subject, *(entry.pose[: _PIXELS // 4] for entry in row)]
        strips.append(_beside(names, [margin, *(pictures.get(entry.identifier, missing) for entry in row)], _TEXT))
    sheet = _blank(max(strip.width for strip in strips), sum(strip.height for strip in strips))
    for number, strip in enumerate(strips):
        sheet.paste(strip, (0, sum(above.height for above in strips[:number])))
    # A palette of two ramps reduces files to a third.
    small = sheet.quantize(128, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    small.info["shapes"] = " ".join(entry.identifier for row in rows for entry in row)
    return small, problems


def _blank(width: int, height: int, colour: str = "white") -> Image.Image:
    return Image.new("RGB", (width, height), colour)


def spread(values: Sequence[T], most: int) -> list[T]:
    """Return at most ``most`` evenly spaced values, including the first and the last."""
    places = np.unique(np.linspace(0, max(len(values) - 1, 0), min(most, len(values))).astype(int))
    return [values[place] for place in places.tolist()]


def _pictures(shapes: ShapeSet, entries: Sequence[Entry]) -> tuple[dict[str, Image.Image], list[str]]:
    """Return surface beside depth image of each shape, and what is wrong with the others."""
    meshes, problems = [], []
    for entry in entries:
        try:
            meshes.append((entry, clean(shapes.load(entry))[0]))
        except ShapeError as error:
            problems.append(f"{entry.identifier}: {error}")
    each = [fit_half_width([mesh], shapes.camera(entry)) for entry, mesh in meshes]
    half_width = shapes.half_width or (common_half_width(each) if each else 1.0)
    pictures = {}
    for entry, mesh in meshes:
        camera, sensor = shapes.camera(entry), shapes.sensor(entry)
        depth = render_depth(mesh, camera, half_width, 3 * _PIXELS)
        depth = depth if sensor is None else sensor.perturbed(depth)
        pair = shaded(mesh, camera, _PIXELS), depth_picture(depth, _PIXELS)
        pictures[entry.identifier] = Image.fromarray(np.hstack([np.asarray(picture) for picture in pair]))
    return pictures, problems


def frame_picture(depths: Depths, mask: Mask, surface: Mesh, form: Mesh) -> Image.Image:
    """Draw depths, the object in them, and its canonical form, as a depth image and as a surface.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing values.
    mask
        Pixels of the object, shape (h, w).
    surface
        The surface of the object.
    form
        Vertices: right, up, towards the viewer.
    """
    known = depths > 0
    near, far = np.percentile(depths[known], (1, 99)) if known.any() else (0.0, 1.0)
    shade = 0.9 - 0.75 * np.clip((depths - near) / max(far - near, 1e-9), 0, 1)
    grey = np.repeat(np.where(known, shade, 1.0)[..., None], 3, axis=2)  # near points are bright, missing values white
    marked = np.where(mask[..., None], 0.35 * grey + 0.65 * _OBJECT * grey / 0.9, 0.35 + 0.65 * grey)
    canonical = render_depth(form, UPRIGHT, fit_half_width([form], UPRIGHT), 3 * _HEIGHT)
    scaled = []
    for picture in (grey, marked):
        image = Image.fromarray(np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8))
        size = (max(1, round(image.width * _HEIGHT / image.height)), _HEIGHT)
        scaled.append(image.resize(size, Image.Resampling.LANCZOS))
    pictures = [*scaled, depth_picture(canonical, _HEIGHT), _coloured(upright(form, seen(surface, UPRIGHT)), _HEIGHT)]
    return _beside(("depth", "object", "canonical depth", "canonical form"), pictures, 14)


def mesh_picture(mesh: Mesh, form: Mesh) -> Image.Image:
    """Draw a mesh (z up, facing -y) and its canonical form side by side."""
    shape = seen(mesh, FRONT)
    return _beside(
        ("shape", "canonical form"), [_coloured(each, _HEIGHT) for each in (shape, upright(form, shape))], 14
    )


def retrieved_picture(panels: Sequence[tuple[str, Drawn | None]]) -> Image.Image:
    """Draw forms side by side, each below its lines of text; None is no picture."""
    pictures = [_coloured(form, _SIDE) if form else _blank(_SIDE, _SIDE) for _, form in panels]
    return _beside([text for text, _ in panels], pictures, _TEXT)


def _coloured(drawn: Drawn, size: int) -> Image.Image:
    return shaded(drawn.mesh, OBLIQUE, size, drawn.values)


def _beside(texts: Sequence[str], pictures: Sequence[Image.Image], font_size: int) -> Image.Image:
    """Combine pictures of one height side by side, each below its text."""
    head = max(text.count("\n") + 1 for text in texts) * (font_size + 6) + 3
    width = sum(picture.width for picture in pictures) + _GAP * (len(pictures) + 1)
    sheet = _blank(width, head + pictures[0].height + _GAP)
    pen, font, left = ImageDraw.Draw(sheet), ImageFont.load_default(font_size), _GAP  # bundled with Pillow
    for text, picture in zip(texts, pictures, strict=True):
        pen.multiline_text((left, 3), text, fill="black", font=font, spacing=3)
        sheet.paste(picture, (left, head))
        left += picture.width + _GAP
    return sheet
