"""Sheets of pictures: a shape and its form, the steps from a depth image to a form, and retrieved shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from benchmark.depth.frame import UPRIGHT
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import fit_half_width, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.report.drawing import OBLIQUE, depth_picture, shaded
from benchmark.report.forms import Drawn, seen, upright

_GAP, _TEXT = 10, 12

#: Height of the picture of a depth image, and side of that of a retrieved form, in pixels.
_HEIGHT, _SIDE = 300, 180
_OBJECT = np.array([0.95, 0.55, 0.2])


def _blank(width: int, height: int) -> Image.Image:
    return Image.new("RGB", (width, height), "white")


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
        sheet.paste(picture, (left, head), picture if picture.mode == "RGBA" else None)
        left += picture.width + _GAP
    return sheet
