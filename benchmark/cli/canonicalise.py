"""One mesh file in, its canonical form out."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from benchmark.contracts import CanonicalForm, Mesh, Method, Shape
from benchmark.errors import ConfigurationError
from benchmark.jobs.stages import N_VERTICES
from benchmark.methods.registry import methods, select


def canonicalise_file(
    source: Path, target: Path, method: str, plugins: Iterable[Path] = (), seed: int = 0
) -> CanonicalForm:
    """Prepare a mesh as the benchmark does, and write the form that a method gives it.

    A method that reads depth images alone is given what a camera sees from the front (z up, facing -y), in a frame that
    fits the mesh.

    Parameters
    ----------
    source, target
        Mesh files; the extension says the format.
    method
        Name of a method that makes forms.
    plugins
        Python files with further methods.
    seed
        Base seed.

    Raises
    ------
    ConfigurationError
        If the method is unknown or has no canonical form.
    ShapeError
        If the mesh cannot be read or treated.
    """
    from benchmark.geometry.io import read_mesh, write_mesh

    (spec,) = select([method], methods(plugins))
    maker = spec.create()
    if not isinstance(maker, Method):
        raise ConfigurationError(
            f"method '{method}' describes shapes without a canonical form", "choose another method"
        )
    prepare = _complete if "mesh" in spec.info.inputs else _seen
    form = maker.canonicalise(prepare(read_mesh(source), source.stem, seed))
    write_mesh(target, form.mesh)
    return form


def _complete(mesh: Mesh, name: str, seed: int) -> Shape:
    from benchmark.geometry.preparation import prepare

    prepared = prepare(mesh, N_VERTICES)
    return Shape(identifier=name, mesh=prepared.mesh, source_area=prepared.source_area, seed=seed)


def _seen(mesh: Mesh, name: str, seed: int) -> Shape:
    from benchmark.geometry.cleaning import clean
    from benchmark.geometry.depth import FRONT, depth_surface, fit_half_width

    surface = clean(mesh)[0]
    view = depth_surface(surface, FRONT, fit_half_width([surface], FRONT))
    area = view.surface.area
    unit = view.surface.with_vertices(view.surface.vertices / area**0.5)
    return Shape(identifier=name, mesh=unit, depth=view.depth, source_area=area, seed=seed)
