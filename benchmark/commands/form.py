"""A canonical form for other libraries, notebooks and files."""

from __future__ import annotations

import base64
import io
import json
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm
from benchmark.datasets.mesh_files import WRITABLE, write_mesh
from benchmark.errors import ConfigurationError
from benchmark.files import write_atomically
from benchmark.geometry.mesh import Mesh

if TYPE_CHECKING:
    from trimesh import Trimesh

#: Formats that trimesh writes: GLB in single precision with colours, STL without own vertices.
BY_TRIMESH = (".glb", ".stl")

#: Extensions of the files in which a form can be written.
WRITTEN = (*WRITABLE, *BY_TRIMESH)

#: Vertices of a form in a notebook, and pixels of its picture.
_VERTICES = 2000
_PIXELS = 320


@dataclass(frozen=True, eq=False, repr=False)
class Form(CanonicalForm):
    """A canonical form that a notebook shows, and that other libraries take.

    Parameters
    ----------
    vertices, faces, notes, vertex_map
        As of :class:`benchmark.api.CanonicalForm`.
    body
        The shape with the vertices of the form, whose parts have the colours; None if the form has
        vertices of its own.
    title
        What it is called where it is shown.
    """

    body: Mesh | None = field(default=None, repr=False)
    title: str = ""

    def __repr__(self) -> str:
        """Return its title and size."""
        return f"Form({self.title!r}, {len(self.vertices)} vertices, {len(self.faces)} faces)"

    @cached_property
    def outwardness(self) -> NDArray[np.float64]:
        """How far each vertex is from the centre of the body, from 0 to 1.

        A part has its value in every pose.
        """
        from benchmark.report.drawing import outwardness

        return outwardness(self.body or self.mesh)

    def colours(self) -> NDArray[np.uint8]:
        """Return the colour of each vertex as in the report, shape (n, 4)."""
        from benchmark.report.drawing import colours_of

        return colours_of(self.outwardness)

    def to_trimesh(self) -> Trimesh:
        """Return it as a ``trimesh.Trimesh`` with the same vertices, and colours by part."""
        import trimesh  # lazy, as half a second is long for those who need none

        return trimesh.Trimesh(
            self.vertices, self.faces, process=False, vertex_colors=self.colours()
        )

    def write(self, path: str | Path) -> list[str]:
        """Write the form as a mesh file.

        Parameters
        ----------
        path
            The file; its extension says the format. GLB has single precision, and colours by part.
            STL repeats the corners of triangles. All others, such as OFF, OBJ and PLY, keep
            coordinates in double precision.

        Returns
        -------
        list of str
            Sentences on what the format does not keep; empty if it keeps everything.

        Raises
        ------
        ConfigurationError
            If there is no such format.
        """
        target = Path(path)
        suffix = target.suffix.lower()
        check_writable(target)
        if suffix not in BY_TRIMESH:
            write_mesh(target, self.mesh)
            return []
        content = self.to_trimesh().export(file_type=suffix[1:])
        write_atomically(target, lambda file: file.write(content))
        if suffix == ".stl":
            return ["STL repeats the corners of triangles: it has no numbers of vertices"]
        return ["GLB has coordinates in single precision"]

    def picture(self) -> bytes:
        """Return its picture as WebP, coloured by part."""
        from benchmark.report.drawing import OBLIQUE, shaded, webp

        return webp(shaded(self.mesh, OBLIQUE, _PIXELS, self.outwardness))

    def _repr_html_(self) -> str:
        """Show it in 3D, to be turned by the mouse, without a network.

        Where no script runs, there is a picture.
        """
        return surface_html(self)

    def _repr_png_(self) -> bytes:
        """Show its picture."""
        from benchmark.report.drawing import OBLIQUE, shaded

        stream = io.BytesIO()
        shaded(self.mesh, OBLIQUE, _PIXELS, self.outwardness).save(stream, format="PNG")
        return stream.getvalue()


@dataclass(frozen=True)
class FormsSideBySide:
    """Forms side by side, as a notebook shows them."""

    forms: tuple[Form, ...]

    def _repr_html_(self) -> str:
        """Show each in 3D."""
        surfaces = "".join(surface_html(form) for form in self.forms)
        return f'<div style="display:flex;flex-wrap:wrap">{surfaces}</div>'


def side_by_side(*forms: Form) -> FormsSideBySide:
    """Show forms side by side in a notebook."""
    return FormsSideBySide(forms)


def check_writable(path: Path) -> None:
    """Raise ``ConfigurationError`` if a form cannot be written to a file of this name."""
    if path.suffix.lower() not in WRITTEN:
        raise ConfigurationError(
            f"{path} is not the name of a mesh file", f"use {', '.join(WRITTEN)}"
        )


def _thinned_surface(form: Form) -> dict[str, Any]:
    """Return what the script of a notebook draws: a thinned form, its colours, and its position."""
    from scipy.spatial import cKDTree

    from benchmark.geometry.preparation import decimate
    from benchmark.report.drawing import OBLIQUE, colours_of
    from benchmark.report.forms import centred

    mesh = form.mesh
    small = mesh
    if mesh.n_vertices > _VERTICES:
        small = decimate(mesh, _VERTICES)
    # Vertices of the thinned mesh have the colour of the nearest vertex of the form.
    _, nearest = cKDTree(mesh.vertices).query(small.vertices)
    return {
        "points": _packed(centred(small).vertices.astype("<f4")),
        "faces": _packed(small.faces.astype("<u2")),
        "colours": _packed(colours_of(form.outwardness[nearest])[:, :3]),
        "turn": OBLIQUE.rotation.tolist(),
    }


def surface_html(form: Form) -> str:
    """Return HTML that shows a form in a notebook, as a surface that can be turned.

    The surface is drawn by a script; where scripts do not run, a picture of it is seen. The HTML
    needs no network: it holds the script, and the surface as text.
    """
    surface = _thinned_surface(form)
    picture = base64.b64encode(form.picture()).decode("ascii")
    script = files("benchmark.commands").joinpath("surface.js").read_text(encoding="utf-8")
    # An inline frame keeps the script apart from those of the notebook.
    page = (
        f"<body style='margin:0'><img width='{_PIXELS}' height='{_PIXELS}' "
        f"src='data:image/webp;base64,{picture}' alt='{escape(form.title, quote=True)}'>"
        f"<script>const SURFACE = {json.dumps(surface)};\n{script}</script></body>"
    )
    return (
        '<figure style="display:inline-block;margin:4px">'
        f'<iframe srcdoc="{escape(page, quote=True)}" '
        f'width="{_PIXELS}" height="{_PIXELS}" style="border:0"></iframe>'
        f"<figcaption>{escape(form.title)}</figcaption></figure>"
    )


def _packed(values: NDArray[Any]) -> str:
    """Return the bytes of an array as text."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
