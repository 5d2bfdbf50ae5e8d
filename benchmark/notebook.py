"""The benchmark from Python: run jobs in this process, and compute the form of arrays.

>>> import benchmark
>>> from baselines.classic_mds import ClassicMDS
>>> jobs = benchmark.run(data="tosca", methods=["gps", ClassicMDS(), my_function])    # doctest: +SKIP
>>> form = benchmark.canonicalise(vertices, faces, "gps")                             # doctest: +SKIP
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from benchmark.api.contracts import CanonicalForm, Input, Shape
from benchmark.depth_forms import form_maker, form_with_fit
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.registry import select, select_one
from benchmark.text import DATA_VARIABLE, EVERY

if TYPE_CHECKING:
    from pandas import DataFrame


def run(
    data: str | Path | Sequence[str | Path],
    methods: Any = (),
    *,
    input: Input = "mesh",
    scorer: str = "cm-bof",
    plugins: Iterable[str | Path] = (),
    results: str | Path = "results",
    data_root: str | Path | None = None,
    quick: bool = False,
    seed: int = 0,
    again: bool = False,
    watch: Callable[[Any], object] = lambda _: None,
) -> DataFrame:
    """Run the jobs of a selection that have no record, in this process, and return all of them.

    Parameters
    ----------
    data
        Names or folders of data sets.
    methods
        Names, objects, classes, and functions from a shape to positions; all methods by default.
    input
        Complete surfaces, or one depth view of each.
    scorer, plugins
        Name of the scorer; plugin files of methods, scorers and data sets.
    results, data_root
        The results folder; the folder of the official data sets, by default ``CANONICAL_FORMS_DATA``.
    quick
        Whether to leave out most poses.
    seed
        Base seed.
    again
        Whether to run finished jobs again.
    watch
        Called with the progress.

    Returns
    -------
    pandas.DataFrame
        One line a job, as in :attr:`benchmark.report.results.Results.jobs`: a job that failed has a ``status`` and a
        ``reason``.

    Raises
    ------
    ConfigurationError
        If a name is unknown, or a value is invalid.
    """
    from benchmark.datasets.catalogue import sources
    from benchmark.pipeline.records import read_records
    from benchmark.protocols.galleries import galleries
    from benchmark.report.results import Results
    from benchmark.runs.planning import plan
    from benchmark.runs.runner import run as run_jobs

    files, folder = [Path(path).resolve() for path in plugins], Path(results)
    root = data_root or os.environ.get(DATA_VARIABLE)
    names = [str(name) for name in _listed(data)]
    shapes = galleries((), sources(names, files), Path(root) if root else None, quick)
    wanted = _listed(methods)
    chosen, by = select(wanted, files), select_one(scorer, files, "scorer")
    options: dict[str, Any] = {"scorer": by, "seed": seed, "named": bool(wanted) and EVERY not in wanted}
    jobs = plan(shapes, [input], chosen, folder, again=["failed", "finished"] if again else ["failed"], **options)
    ended = {job.record.key: record for job, record in run_jobs(jobs, folder, size=0, watch=watch)}
    records = {record.key: record for record in read_records(folder, published=False)} | ended
    return Results(folder, tuple(records[job.record.key] for job in jobs if job.state != "unsupported")).jobs


def canonicalise(
    vertices: ArrayLike, faces: ArrayLike, method: Any = "gps", *, n_vertices: int = 2000, seed: int = 0
) -> CanonicalForm:
    """Return the canonical form of a surface, prepared as in a run: cleaned, in one piece, decimated, of unit area.

    Parameters
    ----------
    vertices
        Coordinates, shape (n, 3).
    faces
        Vertex indices of the triangles, shape (m, 3).
    method
        A name, an object, a class, or a function from a shape to positions.
    n_vertices
        Largest number of vertices of the prepared surface.
    seed
        Seed of random choices.

    Returns
    -------
    CanonicalForm
        Form of the prepared surface, which has other vertices than the given one, in units of the root of its area.

    Raises
    ------
    ShapeError
        If the surface cannot be prepared, or the method refuses it.
    ConfigurationError
        If there is no such method, or it computes no forms.
    """
    maker = form_maker(select([method])[0])
    prepared = prepare(Mesh(vertices, faces), n_vertices)  # type: ignore[arg-type]
    shape = Shape(identifier="shape", mesh=prepared.mesh, source_area=prepared.source_area, seed=seed)
    return form_with_fit(maker, shape, prepared.notes)


def _listed(values: Any) -> list[Any]:
    return list(values) if isinstance(values, list | tuple) else [values]
