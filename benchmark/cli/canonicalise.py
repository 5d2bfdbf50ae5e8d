"""One mesh file in, its canonical form out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from benchmark.contracts import CanonicalForm, Method
from benchmark.errors import ConfigurationError
from benchmark.methods.registry import methods, variant


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
    from benchmark.geometry.camera import FRONT
    from benchmark.geometry.io import read_mesh, write_mesh
    from benchmark.jobs.preparation import shape_of
    from benchmark.jobs.stages.complete import complete
    from benchmark.jobs.stages.view import half_width_of, seen

    spec = variant(method, methods(plugins))
    maker = spec.create()
    if not isinstance(maker, Method):
        raise ConfigurationError(
            f"method '{method}' describes shapes without a canonical form", "choose another method"
        )
    mesh = read_mesh(source)
    arrays = complete(mesh) if "mesh" in spec.info.inputs else seen(mesh, FRONT, half_width_of(mesh, FRONT))
    form = maker.canonicalise(shape_of(arrays, source.stem, seed))
    # What cannot be told about the form is found before the file is written.
    notes = {name: value if isinstance(value, str) else float(value) for name, value in form.notes.items()}
    write_mesh(target, form.mesh)
    return replace(form, notes=notes)


def canonicalise_facts(
    source: str, target: str, method: str, plugins: list[str], seed: int
) -> tuple[int, dict[str, float | str]]:
    """The same as :func:`canonicalise_file` in plain values: number of vertices, and notes of the form."""
    form = canonicalise_file(Path(source), Path(target), method, [Path(path) for path in plugins], seed)
    return len(form.vertices), dict(form.notes)
