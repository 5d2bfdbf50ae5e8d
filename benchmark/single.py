"""One mesh file in, its canonical form out."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from benchmark.contracts import CanonicalForm, Method, Shape
from benchmark.errors import ConfigurationError
from benchmark.registry import methods, select
from benchmark.stages import N_VERTICES


def canonicalise_file(
    source: Path, target: Path, method: str, plugins: Iterable[Path] = (), seed: int = 0
) -> CanonicalForm:
    """Prepare a mesh as the benchmark does, and write the form that a method gives it.

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
    from benchmark.geometry.preparation import prepare

    (spec,) = select([method], methods(plugins))
    maker = spec.create()
    if not isinstance(maker, Method):
        raise ConfigurationError(
            f"method '{method}' describes shapes without a canonical form", "choose another method"
        )
    prepared = prepare(read_mesh(source), N_VERTICES)
    shape = Shape(identifier=source.stem, mesh=prepared.mesh, source_area=prepared.source_area, seed=seed)
    form = maker.canonicalise(shape)
    write_mesh(target, form.mesh)
    return form
