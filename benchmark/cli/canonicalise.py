"""One mesh file in, its canonical form out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, Method, Shape
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.calls import Guard, call_apart
from benchmark.plugins.output_checks import form_of
from benchmark.plugins.registry import methods, variant

#: A form in plain values: vertices, faces and notes.
Plain = tuple[list[list[float]], list[list[int]], Mapping[str, float | str]]

if TYPE_CHECKING:
    from benchmark.geometry.mesh import Mesh

#: Asks for the form at all vertices of the file.
ALL = "all"


@dataclass(frozen=True)
class FormRequest:
    """Request for canonical forms.

    Parameters
    ----------
    method
        Name of a method that makes forms.
    plugins
        Python files with further methods.
    seed
        Base seed.
    limit
        Seconds that a form may take; None for no limit.
    """

    method: str
    plugins: tuple[Path, ...] = ()
    seed: int = 0
    limit: float | None = None

    def guard(self, shape: str, hint: str) -> Guard:
        """Return the terms on which the method is called for a shape."""
        return Guard(f"method '{self.method}' on {shape}", hint, self.limit)


def canonicalise_file(
    source: Path, target: Path, request: FormRequest, vertices: int | str | None = None
) -> CanonicalForm:
    """Write the form that a method gives the mesh of a file, made in a process of its own.

    The file is written here, so that it is there if, and only if, the method has come to its end.

    Parameters
    ----------
    source, target
        Mesh files; the extension says the format.
    request
        By which method.
    vertices
        Vertices of the prepared mesh, and so of the form; None for as many as in the benchmark. ``"all"`` prepares the
        mesh as in the benchmark and carries the form over to the vertices of the file: each takes the barycentric mean
        of the form over the triangle of the prepared mesh that is nearest to it and looks the same way.

    Raises
    ------
    ConfigurationError
        If the method is unknown or has no canonical form, if vertices are asked for and its forms have their own, or if
        the target is the source, has the name of no mesh, or cannot be written.
    ShapeError
        If the mesh cannot be read or treated.
    BrokenCall
        If the method ends its process, or does not end.
    """
    from benchmark.geometry.io import WRITABLE

    if target.suffix.lower() not in WRITABLE:
        raise ConfigurationError(f"{target} is not the name of a mesh file", f"use {', '.join(WRITABLE)}")
    if target.exists() and source.exists() and target.samefile(source):
        raise ConfigurationError(f"{target} is the mesh itself", "name another file with -o")
    guard = request.guard(str(source), "try another shape, or correct the method")
    vertices, faces, notes = call_apart(plain_form, source, request, vertices, guard=guard)
    form = CanonicalForm(np.array(vertices), np.array(faces), notes)
    write_form(target, form.mesh)
    return form


def write_form(target: Path, mesh: Mesh) -> None:
    """Write a mesh beside its place, then move it there, so that on a full disk the old file stays.

    Raises
    ------
    ConfigurationError
        If it cannot be written.
    """
    from benchmark.geometry.io import write_mesh

    place = target.resolve()
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=place.parent, prefix=".form-") as folder:
            made = Path(folder, place.name)
            try:
                write_mesh(made, mesh)
            except ConfigurationError as error:
                raise ConfigurationError(error.problem.replace(str(made), str(target)), error.hint) from error
            made.replace(place)
    except OSError as error:
        raise ConfigurationError(
            f"{target}: {error.strerror}", "choose a file in a folder that can be written"
        ) from error


def plain_form(source: Path, request: FormRequest, vertices: int | str | None = None) -> Plain:
    """Prepare a mesh as the benchmark does, and make its form, here; what is returned travels as JSON.

    A method that reads depth images alone is given what a camera sees from the front (z up, facing -y), in a frame that
    fits the mesh.
    """
    from benchmark.geometry.camera import FRONT
    from benchmark.geometry.io import read_mesh
    from benchmark.pipeline.preparation import shape_of
    from benchmark.pipeline.stages.complete import complete
    from benchmark.pipeline.stages.view import half_width_of, seen
    from benchmark.protocols.models import with_model

    spec = variant(request.method, methods(request.plugins))
    maker = with_model(spec)
    if not isinstance(maker, Method):
        raise ConfigurationError(
            f"method '{request.method}' describes shapes without a canonical form", "choose another method"
        )
    reads_meshes = "mesh" in spec.info.inputs
    if vertices is not None and not reads_meshes:
        raise ConfigurationError(f"method '{request.method}' reads depth images, not vertices", "omit --vertices")
    mesh = read_mesh(source)
    if vertices is not None:
        form, noted = _with_vertices(maker, mesh, source.stem, request.seed, vertices)
    else:
        arrays = complete(mesh) if reads_meshes else seen(mesh, FRONT, half_width_of(mesh, FRONT))
        form, noted = form_of(maker, shape_of(arrays, source.stem, request.seed))
    notes = {name: str(note) if note.dtype.kind == "U" else float(note) for name, note in noted.items()}
    return form.vertices.tolist(), form.faces.tolist(), notes


def _with_vertices(
    maker: Method, mesh: Mesh, name: str, seed: int, vertices: int | str
) -> tuple[Mesh, dict[str, NDArray[Any]]]:
    """The form of a mesh at a number of vertices, or at those of the mesh itself, and its notes."""
    from benchmark.geometry.interpolation import nearest_on_surface, vertex_normals
    from benchmark.geometry.preparation import prepare
    from benchmark.pipeline.stages.complete import N_VERTICES

    prepared = prepare(mesh, vertices if isinstance(vertices, int) else N_VERTICES)
    shape = Shape(identifier=name, mesh=prepared.mesh, source_area=prepared.source_area, seed=seed)
    form, noted = form_of(maker, shape)
    if vertices != ALL:
        return form, dict(noted)
    if not np.array_equal(form.faces, prepared.mesh.faces):
        raise ConfigurationError(
            f"forms of method '{maker.info.name}' have vertices of their own", "leave '--vertices all' out"
        )
    points = (mesh.vertices - prepared.centre) / prepared.scale
    places = nearest_on_surface(prepared.mesh, points, vertex_normals(mesh))
    farthest = np.asarray(places.distances.max())
    return mesh.with_vertices(places.carry(form.vertices)), {**noted, "farthest_from_prepared": farthest}
