"""Pictures of a depth image: on its way to the canonical form of its object, and beside the shapes found for it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from benchmark.depth.mask import Mask
from benchmark.depth.projection import UPRIGHT
from benchmark.depth.reading import Depths
from benchmark.geometry.depth import fit_half_width, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.report.pictures.painting import SUPERSAMPLING, depth_picture, shaded

HEIGHT = 300
"""Pixels of the height of each picture."""

SIZE = 180
"""Pixels per side of each form that was found."""

TITLES = ("depth", "object", "canonical depth", "canonical form")

_GAP, _LINE, _FONT_SIZE = 12, 24, 14
_NEAR, _TEXT_LINE, _SMALL = 8, 18, 12
_OBJECT = np.array([0.95, 0.55, 0.2])


def frame_picture(depths: Depths, mask: Mask, form: Mesh) -> Image.Image:
    """Draw depths, the object among them, and its canonical form, as a depth image and as a surface.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 where nothing was seen.
    mask
        Pixels of the object, shape (h, w).
    form
        Right, up, towards the viewer.
    """
    grey = _grey(depths)
    marked = np.where(mask[..., None], 0.35 * grey + 0.65 * _OBJECT * grey / 0.9, 0.35 + 0.65 * grey)
    canonical = render_depth(form, UPRIGHT, fit_half_width([form], UPRIGHT), HEIGHT * SUPERSAMPLING)
    panels = [_scaled(grey), _scaled(marked), depth_picture(canonical, HEIGHT), shaded(form, UPRIGHT, HEIGHT)]
    width = sum(panel.width for panel in panels) + _GAP * (len(panels) + 1)
    sheet = Image.new("RGB", (width, HEIGHT + _LINE + _GAP), "white")
    pen, font, left = ImageDraw.Draw(sheet), ImageFont.load_default(_FONT_SIZE), _GAP
    for title, panel in zip(TITLES, panels, strict=True):
        sheet.paste(panel, (left, _LINE))
        pen.text((left, _LINE // 2), title, fill="black", font=font, anchor="lm")
        left += panel.width + _GAP
    return sheet


def retrieved_picture(panels: Sequence[tuple[str, Mesh | None]]) -> Image.Image:
    """Draw forms side by side, each below its lines of text.

    Parameters
    ----------
    panels
        Text, of lines, and form: right, up, towards the viewer; the query comes first. Nothing is drawn for None.
    """
    n_lines = max(text.count("\n") + 1 for text, _ in panels)
    head = n_lines * _TEXT_LINE + _NEAR
    sheet = Image.new("RGB", (len(panels) * (SIZE + _NEAR) + _NEAR, head + SIZE + _NEAR), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(_SMALL)
    for number, (text, form) in enumerate(panels):
        left = _NEAR + number * (SIZE + _NEAR)
        pen.multiline_text((left, _NEAR // 2), text, fill="black", font=font, spacing=3)
        if form is not None:
            sheet.paste(shaded(form, UPRIGHT, SIZE), (left, head))
    return sheet


def _grey(depths: Depths) -> NDArray[np.float64]:
    """Near is bright, what was not seen is white; shape (h, w, 3), in [0, 1]."""
    seen = depths > 0
    near, far = np.percentile(depths[seen], (1, 99)) if seen.any() else (0.0, 1.0)
    shade = 0.9 - 0.75 * np.clip((depths - near) / max(far - near, 1e-9), 0, 1)
    return np.asarray(np.repeat(np.where(seen, shade, 1.0)[..., None], 3, axis=2))


def _scaled(picture: NDArray[np.float64]) -> Image.Image:
    height, width = picture.shape[:2]
    image = Image.fromarray(np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8))
    return image.resize((max(1, round(width * HEIGHT / height)), HEIGHT), Image.Resampling.LANCZOS)
