"""Pages of forms: some shapes of each column of a table, and their forms by each method, in 3D."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from scipy.spatial import cKDTree

from benchmark.geometry.preparation import decimate
from benchmark.report.figures import first_records, some_shapes
from benchmark.report.forms import Drawn
from benchmark.report.notation import file_name
from benchmark.report.page_builder import FORM_PIXELS, Pages
from benchmark.report.table_view import TableView

#: Classes on a page of forms, and shapes of each.
_CLASSES = 3
_POSES = 2

#: Vertices of a form in 3D.
_VERTICES = 2000


def forms_of_column(pages: Pages, view: TableView) -> dict[str, Any]:
    """Add pictures of some shapes and their forms to the report, and return what its page shows.

    Parameters
    ----------
    pages
        The report, to which files are added.
    view
        A table with a single column.

    Returns
    -------
    dict
        What the template ``forms.html`` reads: ``title`` of the column, names of the ``shapes``,
        and ``rows`` of title, anchor and forms. A form that is not stored is an empty dict. Nothing
        if no form is stored.
    """
    records = first_records(view)
    if not records:
        return {}
    first = next(iter(records.values()))
    shapes = some_shapes(first, _CLASSES, _POSES)
    rows = []
    for row, record in records.items():
        surfaces = [pages.forms.form(record, shape) for shape in shapes]
        if any(surfaces):
            name = f"{record.input}-{record.data.name}-{record.method}"
            forms = _surfaces(pages, name, f" by {row.title}", shapes, surfaces)
            rows.append((row.title, file_name(row.method), forms))
    if not rows:
        return {}

    # The first row shows the shapes themselves.
    bodies = [pages.forms.shape(first, shape) for shape in shapes]
    of_shapes = _surfaces(pages, f"{first.input}-{first.data.name}-shape", "", shapes, bodies)
    rows.insert(0, ("Shape", "shape", of_shapes))
    return {"title": view.columns[0].title, "shapes": shapes, "rows": rows}


def _surfaces(
    pages: Pages, name: str, by: str, shapes: Sequence[str], drawn: Sequence[Drawn | None]
) -> list[dict[str, Any]]:
    """Add the pictures of some surfaces to the report, and return what the page needs of each.

    Parameters
    ----------
    pages
        The report, to which files are added.
    name
        First part of the names of the files.
    by
        Says which method made the forms, for descriptions of the pictures: " by GPS"; "" for the
        shapes themselves.
    shapes, drawn
        Names of the shapes, and the surface of each; None if none is stored.

    Returns
    -------
    list of dict
        See :func:`_surface`; empty for a shape without a surface.
    """
    content: list[dict[str, Any]] = []
    for shape, surface in zip(shapes, drawn, strict=True):
        if surface is None:
            content.append({})
            continue
        says = f"Form of {shape}{by}" if by else shape
        if surface.is_mirrored:
            says += ", mirrored"
        content.append(_surface(pages, f"{name}-of-{shape}", says, surface))
    return content


def _surface(pages: Pages, name: str, says: str, drawn: Drawn) -> dict[str, Any]:
    """Add a surface to the report, as a picture and as a mesh that the user can turn.

    Parameters
    ----------
    pages
        The report, to which files are added.
    name
        Name of the files without extension.
    says
        Description for those who cannot see the picture.
    drawn
        The surface, with a value of each vertex that gives its colour.

    Returns
    -------
    dict
        Addresses of the ``picture`` and of the ``mesh``, the description, and how the surface was
        aligned.
    """
    # The mesh is thinned; its vertices have the colour of the nearest vertex of the surface.
    small = drawn.mesh
    if small.n_vertices > _VERTICES:
        small = decimate(small, _VERTICES)
    _, nearest = cKDTree(drawn.mesh.vertices).query(small.vertices)
    surface = {
        "points": small.vertices.T.round(3).tolist(),
        "faces": small.faces.T.tolist(),
        "values": drawn.values[nearest].round(2).tolist(),
    }
    file = f"forms/{file_name(name)}.js"
    numbers = json.dumps(surface, separators=(",", ":"))
    pages.files[file] = f"show('{file}', {numbers});"
    return {
        "picture": pages.picture(name, drawn, FORM_PIXELS, is_coloured=True),
        "mesh": file,
        "says": says,
        "is_mirrored": drawn.is_mirrored,
        "apart": drawn.apart,
    }
