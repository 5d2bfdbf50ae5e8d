"""Sheets of pictures: a shape and its form, the steps from a depth image to a form, and retrieved shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from benchmark.depth.frame import UPRIGHT
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import fit_half_width, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.report.drawing import OBLIQUE, shaded
from benchmark.report.forms import Drawn, seen, upright
from benchmark.report.grids import DPI, grid

_OBJECT = np.array([0.95, 0.55, 0.2])


def frame_picture(depths: Depths, mask: Mask, surface: Mesh, form: Mesh) -> Figure:
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
    grey = np.repeat(
        np.where(known, shade, 1.0)[..., None], 3, axis=2
    )  # near points are bright, missing values white
    marked = np.where(
        mask[..., None], 0.35 * grey + 0.65 * _OBJECT * grey / 0.9, 0.35 + 0.65 * grey
    )
    canonical = render_depth(form, UPRIGHT, fit_half_width(form, UPRIGHT), DPI)
    depth, drawn = np.where(canonical > 0, canonical, np.nan), upright(form, seen(surface, UPRIGHT))
    picture = shaded(drawn.mesh, OBLIQUE, DPI, drawn.values)
    pictures = {
        "depth": grey,
        "object": marked,
        "canonical depth": depth,
        "canonical form": picture,
    }
    return grid([(title, [picture]) for title, picture in pictures.items()])


def mesh_picture(mesh: Mesh, form: Mesh) -> Figure:
    """Draw a mesh (z up, facing -y) and its canonical form side by side."""
    shape = seen(mesh, FRONT)
    return retrieved_picture([("shape", shape), ("canonical form", upright(form, shape))])


def retrieved_picture(panels: Sequence[tuple[str, Drawn | None]]) -> Figure:
    """Draw forms side by side, each below its lines of text; None is no picture."""
    return grid(
        [(text, [form and shaded(form.mesh, OBLIQUE, DPI, form.values)]) for text, form in panels]
    )
