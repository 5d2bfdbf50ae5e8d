"""Sheets of pictures: shape and form, steps from a depth image to a form, retrieved shapes."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.depth.frame import UPRIGHT
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import fit_half_width, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.report.drawing import OBLIQUE, shaded
from benchmark.report.forms import Drawn, drawn_form, drawn_from
from benchmark.report.grids import DPI, LETTERS_PER_INCH, grid

#: Colour of the object in a depth image.
_OBJECT = np.array([0.95, 0.55, 0.2])

#: How much of the grey of a pixel is left behind the colour of the object, and in the rest of the
#: image, which fades to white.
_GREY_OF_OBJECT = 0.35
_GREY_OF_REST = 0.65

#: The brightest grey of a depth image.
_BRIGHTEST = 0.9


def frame_picture(depths: Depths, mask: Mask, surface: Mesh, form: Mesh) -> Figure:
    """Draw an image of a depth camera and the canonical form of its object, side by side.

    The four pictures are the depths, the object in them, and its canonical form as a depth image
    and as a surface.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing values.
    mask
        Pixels of the object, shape (h, w).
    surface
        The surface of the object, as the camera sees it.
    form
        Its canonical form, with the same vertices; axes point right, up, and towards the viewer.
    """
    grey = _grey(depths)
    # The object is tinted; the rest of the image fades towards white.
    tinted = _GREY_OF_OBJECT * grey + (1 - _GREY_OF_OBJECT) * _OBJECT * grey / _BRIGHTEST
    faded = (1 - _GREY_OF_REST) + _GREY_OF_REST * grey
    marked = np.where(mask[..., None], tinted, faded)
    canonical = render_depth(form, UPRIGHT, fit_half_width(form, UPRIGHT), DPI)
    drawn = drawn_form(form, drawn_from(surface, UPRIGHT))
    pictures = {
        "depth": grey,
        "object": marked,
        "canonical depth": np.where(canonical > 0, canonical, np.nan),
        "canonical form": shaded(drawn.mesh, OBLIQUE, DPI, drawn.values),
    }
    return grid([(title, [picture]) for title, picture in pictures.items()])


def _grey(depths: Depths) -> NDArray[np.float64]:
    """Return depths in grey, shape (h, w, 3): near points are bright, missing values white."""
    known = depths > 0
    near = 0.0
    far = 1.0
    if known.any():
        near, far = np.percentile(depths[known], (1, 99))
    share = np.clip((depths - near) / max(far - near, 1e-9), 0, 1)
    shade = np.where(known, 0.9 - 0.75 * share, 1.0)
    return np.repeat(shade[..., None], 3, axis=2)


def mesh_picture(mesh: Mesh, form: Mesh) -> Figure:
    """Draw a mesh (z up, facing -y) and its canonical form side by side."""
    shape = drawn_from(mesh, FRONT)
    return retrieved_picture([("shape", shape), ("canonical form", drawn_form(form, shape))])


def retrieved_picture(panels: Sequence[tuple[str, Drawn | None]]) -> Figure:
    """Draw forms side by side, each below its lines of text; None is no picture."""
    titles = [_wrapped(text) for text, _ in panels]
    n_lines = max(title.count("\n") for title in titles)
    columns = []
    for title, (_, form) in zip(titles, panels, strict=True):
        picture = form and shaded(form.mesh, OBLIQUE, DPI, form.values)
        columns.append((title + "\n" * (n_lines - title.count("\n")), [picture]))
    return grid(columns)


def _wrapped(text: str) -> str:
    """Return lines of text that fit above a picture; a name is broken only if it has to be."""
    lines = text.split("\n")
    return "\n".join(fill(line, LETTERS_PER_INCH, break_on_hyphens=False) for line in lines)
