"""A page to play with: shapes unfold into their forms, and rankings show the first wrong match.

The page is one file that needs no network. :func:`play_galleries` takes shapes, forms and rankings
from a results folder, :func:`play_page` makes the page of any galleries.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.geometry.mesh import Mesh, sides_of
from benchmark.geometry.preparation import decimate
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.records import Record
from benchmark.registry import select_one
from benchmark.report.data_titles import short_data_title
from benchmark.report.drawing import PALETTE
from benchmark.report.forms import Drawn, StoredForms
from benchmark.text import brief, clean_text

#: Vertices of a surface on the page.
N_VERTICES = 600

#: Surfaces on the page, shapes and forms together; as many take some 2.4 MB.
MOST_SURFACES = 460

#: Poses of a class that are shown before further classes are left out.
FEWEST_POSES = 3

#: Largest coordinate as a whole number.
_LARGEST = 32767

#: Largest value of a colour as a whole number.
_SHADES = 255

#: Row of the shapes themselves, and what it is called on the page.
_SHAPES = "identity"
_SHAPES_TITLE = "The shape itself"

_TEMPLATES = Environment(
    loader=PackageLoader("benchmark.report"), autoescape=True, trim_blocks=True, lstrip_blocks=True
)


@dataclass(frozen=True, kw_only=True)
class PlayMethod:
    """A method on the page.

    Parameters
    ----------
    name, title
        Its name on the command line, and in the tables.
    sentence
        What it does, for readers who know no mathematics.
    ranked
        For each shape the numbers of the others, nearest first, and nothing for a refused one;
        empty if the shapes have no classes to find.
    seen
        Numbers of the shapes that it was trained on.
    """

    name: str
    title: str
    sentence: str = ""
    ranked: Sequence[Sequence[int]] = ()
    seen: Sequence[int] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class PlayShape:
    """A shape on the page with its form by each method of its gallery, or None without one."""

    name: str
    label: str
    body: Drawn
    forms: Sequence[Drawn | None]

    @property
    def pose(self) -> str:
        """What its name says of its pose: ``standing``, or ``pose 4``."""
        pose = re.sub(r"[_/-]+", " ", self.name.removeprefix(self.label)).strip()
        if pose.isdecimal():
            return f"pose {pose}"
        return pose or self.name


@dataclass(frozen=True, kw_only=True, eq=False)
class PlayGallery:
    """Shapes that are ranked together.

    Parameters
    ----------
    title
        What the shapes are.
    methods, shapes
        Methods and shapes in their order on the page.
    n_left_out
        How many shapes of the gallery the page has no room for.
    """

    title: str
    methods: Sequence[PlayMethod]
    shapes: Sequence[PlayShape]
    n_left_out: int = 0


def write_play_page(path: Path, galleries: Sequence[PlayGallery], back: str = "") -> None:
    """Write the page of some galleries; see :func:`play_page`."""
    write_text(path, play_page(galleries, back))


def play_page(galleries: Sequence[PlayGallery], back: str = "") -> str:
    """Return the page of some galleries as HTML, with a link back to a page of scores.

    Raises
    ------
    ConfigurationError
        If there is no gallery with a shape.
    """
    return render_play_page(*play_data(galleries), back)


def play_data(galleries: Sequence[PlayGallery]) -> tuple[dict[str, Any], str]:
    """Return the content of the page on which forms can be turned.

    Parameters
    ----------
    galleries
        Methods, shapes and forms of each data set. Galleries without a shape are left out.

    Returns
    -------
    content : dict
        What the script of the page reads, as JSON.
    numbers : str
        Coordinates of all surfaces, packed into one text to which the content refers.

    Raises
    ------
    ConfigurationError
        If no gallery has a shape.
    """
    shown = [gallery for gallery in galleries if gallery.shapes]
    if not shown:
        raise ConfigurationError(
            "there are no forms to play with", "run methods on a data set first"
        )
    surfaces = Surfaces()
    content = {
        "galleries": [_gallery_content(gallery, surfaces) for gallery in shown],
        "meshes": surfaces.meshes,
        "palette": [_channels(colour) for colour in PALETTE],
    }
    return content, surfaces.text()


def render_play_page(content: Mapping[str, Any], numbers: str, back: str = "") -> str:
    """Return the page of what :func:`play_data` returned."""
    text = json.dumps(content, separators=(",", ":")).replace("</", r"<\/")
    page = _TEMPLATES.get_template("play.html")
    return page.render(content=text, numbers=numbers, back=back, palette=PALETTE)


# Galleries of a results folder
# ------------------------------------------------------------------------------------------------


def play_galleries(
    forms: StoredForms, records: Iterable[Record], most_surfaces: int = MOST_SURFACES
) -> list[PlayGallery]:
    """Return the galleries whose shapes, forms and distances a results folder keeps.

    Complete surfaces come first: of a method that ran on these and on views, they alone are shown.

    Parameters
    ----------
    forms
        Reader of the forms of the folder.
    records
        Records of its jobs.
    most_surfaces
        How many surfaces there may be in all; small galleries leave room for larger ones.
    """
    groups = _grouped(records, forms)
    n_surfaces = [len(group[0].shapes) * (1 + len(group)) for group in groups]
    shares = [0] * len(groups)
    left = most_surfaces
    for n_done, number in enumerate(np.argsort(n_surfaces, kind="stable").tolist()):
        shares[number] = min(n_surfaces[number], left // (len(groups) - n_done))
        left -= shares[number]
    galleries = [_gallery(group, forms, share) for group, share in zip(groups, shares, strict=True)]
    return [gallery for gallery in galleries if gallery.shapes]


def _grouped(records: Iterable[Record], forms: StoredForms) -> list[list[Record]]:
    """Return the records of each gallery of which a shape is stored here, a list for each.

    A list has one record for each method, if possible of complete surfaces rather than views. The
    shapes themselves come first, records of views last. The first shape with a result of each
    record stands for all of its shapes.
    """
    groups: dict[str, dict[str, Record]] = {}  # by gallery and method
    for record in filter(_has_forms, records):
        group = groups.setdefault(record.gallery, {})
        present = group.get(record.method)
        if present is None or (record.input == "mesh" and present.input == "view"):
            group[record.method] = record

    def place(record: Record) -> tuple[bool, str]:
        """Return what records are sorted by: the shapes themselves first, then the input."""
        return record.method != _SHAPES, record.input

    stored = []
    for group in groups.values():
        in_order = sorted(group.values(), key=place)
        if any(forms.shape(record, record.shapes[record.answered[0]]) for record in in_order):
            stored.append(in_order)
    return stored


def _has_forms(record: Record) -> bool:
    """Return whether a record ranks the forms of its shapes among each other."""
    ranks_itself = len(record.sides) == 1
    has_forms = bool(record.scorer) and any(record.files.values())
    return record.status == "ok" and ranks_itself and has_forms


def _gallery(records: Sequence[Record], forms: StoredForms, most_surfaces: int) -> PlayGallery:
    """Return what the page shows of the records of one gallery.

    Parameters
    ----------
    records
        A record for each method.
    forms
        Reader of the stored shapes and forms.
    most_surfaces
        Number of surfaces, of shapes and forms together, for which the page has room.
    """
    first = min(records, key=lambda record: record.input == "view")  # of surfaces, if there is one
    numbers = _chosen(first.labels, most_surfaces // (1 + len(records)))
    shapes = []
    for number in numbers:
        name = first.shapes[number]
        body = forms.shape(first, name)
        if body is None:
            continue
        forms_of_shape = [_form(record, forms, name, body) for record in records]
        label = first.labels[number]
        shapes.append(PlayShape(name=name, label=label, body=body, forms=forms_of_shape))
    names = [shape.name for shape in shapes]
    return PlayGallery(
        title=clean_text(short_data_title(first)),
        methods=[_method(record, forms.folder, names) for record in records],
        shapes=shapes,
        n_left_out=len(first.shapes) - len(shapes),
    )


def _chosen(labels: Sequence[str], most: int) -> list[int]:
    """Choose shapes for which there is room, with the same number of poses of each class.

    For example, of two classes with 10 and 3 poses, and room for 8, it chooses 5 and 3.

    Parameters
    ----------
    labels
        Class of each shape.
    most
        Number of shapes for which there is room.

    Returns
    -------
    list of int
        Indices of the chosen shapes, ascending. If there is not even room for a few poses of each
        class, the last classes are left out.
    """
    members: dict[str, list[int]] = {}
    for number, label in enumerate(labels):
        members.setdefault(label, []).append(number)
    sizes = [len(of_class) for of_class in members.values()]
    n_poses = FEWEST_POSES
    while n_poses < max(sizes, default=0) and sum(min(n, n_poses + 1) for n in sizes) <= most:
        n_poses += 1
    chosen: list[int] = []
    for of_class in members.values():
        shown = of_class[:n_poses]
        if chosen and len(chosen) + len(shown) > most:
            break
        chosen += shown
    return sorted(chosen)


def _form(record: Record, forms: StoredForms, name: str, body: Drawn) -> Drawn | None:
    """Return the form of a shape as it is drawn.

    The shape itself where a method leaves it as it is.
    """
    if record.method == _SHAPES:
        return body
    return forms.form(record, name) if name in record.shapes else None


def _method(record: Record, folder: Path, names: Sequence[str]) -> PlayMethod:
    """Return what the page says of the method of a record."""
    return PlayMethod(
        name=record.method,
        title=_SHAPES_TITLE if record.method == _SHAPES else clean_text(record.title),
        sentence=_sentence(record),
        ranked=_ranked(record, folder, names),
        seen=[number for number, name in enumerate(names) if name in record.seen],
    )


def _sentence(record: Record) -> str:
    """Return the sentence about the method of a record; records of plugins hold it."""
    sentence = record.summary
    if not sentence:
        try:
            sentence = select_one(record.base_name).summary
        except ConfigurationError:  # a row of another program
            return ""
    sentence = brief(sentence)
    return sentence[:1].upper() + sentence[1:].removesuffix(".") + "."


def _ranked(record: Record, folder: Path, names: Sequence[str]) -> list[list[int]]:
    """Return how a method ranks the shapes of a page among each other.

    Parameters
    ----------
    record
        Record of the method.
    folder
        Results folder, in which its distances may be stored.
    names
        Names of the shapes on the page.

    Returns
    -------
    list of list of int
        For each shape, the indices of the others in ``names``, nearest first; empty for a shape
        without a form. No list at all if no distances are stored.
    """
    matrix = read_distances(folder, record)
    if matrix is None:
        return []
    # Rows and columns of the matrix are the shapes with a form, in the order of the record.
    with_form = [record.shapes[number] for number in record.answered]
    column_of = {name: column for column, name in enumerate(with_form)}
    shown = [number for number, name in enumerate(names) if name in column_of]
    columns = [column_of[names[number]] for number in shown]
    ranked: list[list[int]] = [[] for _ in names]
    for query in shown:
        distances = matrix[column_of[names[query]], columns]
        order = np.argsort(distances, kind="stable")
        ranked[query] = [shown[i] for i in order if shown[i] != query]
    return ranked


# Surfaces as whole numbers
# ------------------------------------------------------------------------------------------------


@dataclass
class Surfaces:
    """Surfaces of the page, as whole numbers one after the other.

    A mesh is what the forms of a shape share: triangles, and how far each vertex is from the centre
    of the body. A surface is the number of its mesh with the place of its coordinates.
    """

    parts: list[NDArray[np.int16]] = field(default_factory=list)
    meshes: list[dict[str, int]] = field(default_factory=list)
    length: int = 0

    def add(self, numbers: NDArray[Any]) -> int:
        """Append whole numbers, and return the place of the first."""
        place = self.length
        self.length += numbers.size
        self.parts.append(numbers.astype(np.int16).ravel())
        return place

    def add_mesh(self, faces: NDArray[np.int64], values: NDArray[np.float64]) -> int:
        """Add triangles and colours, and return the number of the mesh."""
        mesh = {
            "faces": self.add(faces),
            "corners": faces.size,
            "values": self.add(np.round(_SHADES * values)),
            "vertices": len(values),
        }
        self.meshes.append(mesh)
        return len(self.meshes) - 1

    def add_points(self, points: NDArray[np.float64]) -> int:
        """Add coordinates, moved and scaled to fill a unit ball, and return their place."""
        centred = points - (points.min(axis=0) + points.max(axis=0)) / 2
        radius = max(float(np.linalg.norm(centred, axis=1).max()), 1e-12)
        return self.add(np.round(_LARGEST * centred / radius))

    def text(self) -> str:
        """Return all numbers as text: deflated, first bytes before second ones, which are alike."""
        numbers = np.concatenate(self.parts).astype("<i2").view(np.uint8).reshape(-1, 2)
        return base64.b64encode(zlib.compress(numbers.T.tobytes(), 9)).decode()


def thinned_surface(
    mesh: Mesh, n_vertices: int = N_VERTICES
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return some vertices of a mesh, shape (n,), and triangles of them, shape (m, 3)."""
    points, triangles = _with_shortest_edges_collapsed(mesh, n_vertices)
    nearest = cKDTree(mesh.vertices).query(points)[1]
    kept, number = np.unique(nearest, return_inverse=True)
    faces = number[triangles]
    has_three = (faces != np.roll(faces, 1, axis=1)).all(axis=1)  # some share their nearest vertex
    return kept, faces[has_three]


def _with_shortest_edges_collapsed(
    mesh: Mesh, n_vertices: int
) -> tuple[NDArray[np.float64], NDArray[np.integer[Any]]]:
    """Return vertices and triangles of a mesh after collapsing its shortest edges.

    That takes a quarter of the time of collapses by quadric error, whose finer shapes nobody sees
    on small pictures. These are made only of a mesh that libigl cannot take: one that is not
    manifold, or whose faces are not oriented alike. Those of a Möbius strip cannot be, and libigl
    would never end; fused limbs of a scan may make such a surface.
    """
    import igl  # which few commands need

    if mesh.n_vertices <= n_vertices:
        return mesh.vertices, mesh.faces
    if _is_oriented(mesh):
        # A collapse removes two triangles with a vertex.
        n_faces = max(1, mesh.n_faces - 2 * (mesh.n_vertices - n_vertices))
        points, triangles, *_ = igl.decimate(mesh.vertices, mesh.faces, n_faces)
        if len(points):  # otherwise, the mesh is not manifold
            return points, triangles
    thinned = decimate(mesh, n_vertices)
    return thinned.vertices, thinned.faces


def _is_oriented(mesh: Mesh) -> bool:
    """Return whether neighbouring triangles run along their common edge in opposite directions."""
    starts, ends = sides_of(mesh.faces)
    return len(np.unique(starts * mesh.n_vertices + ends)) == len(starts)


def _gallery_content(gallery: PlayGallery, surfaces: Surfaces) -> dict[str, Any]:
    """Return what the script of the page reads of one gallery: its methods and shapes.

    Parameters
    ----------
    gallery
        Methods, shapes and forms.
    surfaces
        The surfaces of the page, to which those of the gallery are added; shapes refer to them by
        number.
    """
    return {
        "title": gallery.title,
        "left": gallery.n_left_out,
        "methods": [
            {
                "name": method.name,
                "title": method.title,
                "says": method.sentence,
                "ranked": method.ranked,
                "seen": method.seen,
            }
            for method in gallery.methods
        ],
        "shapes": [_shape_content(shape, surfaces) for shape in gallery.shapes],
    }


def _shape_content(shape: PlayShape, surfaces: Surfaces) -> dict[str, Any]:
    """Return what the script of the page reads of one shape and its forms.

    All have the same thinned mesh, so that one can turn into another. Their points are added to the
    surfaces of the page, and are referred to by number.

    Parameters
    ----------
    shape
        The shape, with the form that each method made of it, or None.
    surfaces
        The surfaces of the page.
    """
    kept, faces = thinned_surface(shape.body.mesh)
    mesh = surfaces.add_mesh(faces, shape.body.values[kept])
    body = {"mesh": mesh, "points": surfaces.add_points(shape.body.mesh.vertices[kept])}
    forms: list[dict[str, Any] | None] = []
    for form in shape.forms:
        if form is None:
            forms.append(None)
        elif form is shape.body:
            forms.append(body)
        else:
            forms.append(_form_content(form, shape.body, mesh, kept, surfaces))
    return {
        "name": clean_text(shape.name),
        "label": clean_text(shape.label),
        "pose": clean_text(shape.pose),
        "body": body,
        "forms": forms,
    }


def _form_content(
    form: Drawn, body: Drawn, mesh: int, kept: NDArray[np.int64], surfaces: Surfaces
) -> dict[str, Any]:
    """Add a form, with the mesh of its shape unless it has vertices of its own."""
    if form.body is not body:
        kept, faces = thinned_surface(form.mesh)
        mesh = surfaces.add_mesh(faces, form.values[kept])
    points = surfaces.add_points(form.mesh.vertices[kept])
    content: dict[str, Any] = {"mesh": mesh, "points": points}
    if form.is_mirrored:
        content["mirrored"] = True
    return content


def _channels(colour: str) -> list[float]:
    """Return red, green and blue of a colour such as ``#4a62b0``, from 0 to 1."""
    return [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
