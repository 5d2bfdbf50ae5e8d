"""A query and the shapes that were found for it, each with its canonical form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from benchmark.depth.projection import UPRIGHT
from benchmark.geometry.mesh import Mesh
from benchmark.report.pictures.drawing import shaded

SIZE = 180
"""Pixels per side of each form."""

_GAP, _LINE, _FONT_SIZE = 8, 18, 12


def retrieved_picture(panels: Sequence[tuple[str, Mesh | None]]) -> Image.Image:
    """Draw forms side by side, each below its lines of text.

    Parameters
    ----------
    panels
        Text, of lines, and form: right, up, towards the viewer; the query comes first. Nothing is drawn for None.
    """
    n_lines = max(text.count("\n") + 1 for text, _ in panels)
    head = n_lines * _LINE + _GAP
    sheet = Image.new("RGB", (len(panels) * (SIZE + _GAP) + _GAP, head + SIZE + _GAP), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(_FONT_SIZE)
    for number, (text, form) in enumerate(panels):
        left = _GAP + number * (SIZE + _GAP)
        pen.multiline_text((left, _GAP // 2), text, fill="black", font=font, spacing=3)
        if form is not None:
            picture = np.round(255 * shaded(form, UPRIGHT, SIZE)).astype(np.uint8)
            sheet.paste(Image.fromarray(picture), (left, head))
    return sheet
