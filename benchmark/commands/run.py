"""The benchmark from Python: run jobs, and compute the form of arrays.

>>> import benchmark
>>> from baselines.classic_mds import ClassicMDS
>>> jobs = benchmark.run(data="tosca", methods=["gps", ClassicMDS(), my_function])    # doctest: +SKIP
>>> form = benchmark.canonicalise(vertices, faces, "gps")                             # doctest: +SKIP
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from benchmark.api.contracts import CanonicalForm, Input
from benchmark.commands.forms import form_maker, form_of_surface
from benchmark.geometry.mesh import Mesh
from benchmark.machine import available_cores
from benchmark.registry import select
from benchmark.text import DATA_VARIABLE, say

if TYPE_CHECKING:
    from pandas import DataFrame

#: Seconds between lines of progress.
_INTERVAL = 15.0


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
    gallery: str | Path = "",
    gallery_views: int = 0,
    same_names: bool = False,
    seed: int = 0,
    again: bool = False,
    watch: Callable[[Any], object] | None = None,
) -> DataFrame:
    """Run the jobs of a selection that have no record, and return all of them.

    Your own objects and functions run in this process, everything else in workers, as on the
    command line.

    Parameters
    ----------
    data
        Names or folders of data sets.
    methods
        Names, objects, classes, and functions from a shape to positions; all methods by default.
        Your own objects and functions run in each call; what those of a plugin file made is kept.
    input
        Complete surfaces, or one depth view of each.
    scorer, plugins
        Name of the scorer; plugin files of methods and scorers.
    results, data_root
        The results folder; the folder of the official data sets, by default
        ``CANONICAL_FORMS_DATA``.
    quick
        Whether to leave out most poses.
    gallery, same_names
        Name or folder of the shapes that are ranked for the data, which are queries, and whether
        one of the same name is left out; by default all other shapes of the data.
    gallery_views
        Number of cameras around each shape that show the gallery, by default the data, to views; 0
        for none.
    seed
        Base seed.
    again
        Whether to run finished jobs again.
    watch
        Called with the progress; by default, a line on stderr says now and then how far the run is.

    Returns
    -------
    pandas.DataFrame
        One line a job, as in :attr:`benchmark.report.results.Results.jobs`: a job that failed has a
        ``status`` and a ``reason``.

    Raises
    ------
    ConfigurationError
        If a name is unknown, or a value is invalid.
    """
    from benchmark.pipeline.data_names import label_data_sets
    from benchmark.report.results import Results
    from benchmark.runs.planning import plan_selection
    from benchmark.runs.runner import result_of
    from benchmark.runs.runner import run as run_jobs

    folder, root = Path(results).absolute(), data_root or os.environ.get(DATA_VARIABLE)
    jobs = plan_selection(
        folder,
        datasets=[str(name) for name in _listed(data)],
        methods=_listed(methods),
        plugins=[Path(path).resolve() for path in plugins],
        scorer=scorer,
        input=input,
        data_root=Path(root) if root else None,
        quick=quick,
        seed=seed,
        gallery=str(gallery) if gallery else "",
        gallery_views=gallery_views,
        same_names=same_names,
        rerun=["failed", "finished"] if again else ["failed"],
    )
    running = run_jobs(
        jobs, folder, size=available_cores(), anew=again, watch=watch or _lines_of_progress()
    )
    ended = {record.key: record for record in running}
    return Results(
        folder, tuple(label_data_sets([*filter(None, (result_of(job, ended) for job in jobs))]))
    ).jobs


def canonicalise(
    vertices: ArrayLike,
    faces: ArrayLike,
    method: Any = "gps",
    *,
    n_vertices: int = 2000,
    seed: int = 0,
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
        In units of the root of the area. It has the given vertices in their order, unless some were
        removed; then those of the prepared surface, and ``vertex_map``, shape (n,), names the
        nearest given vertex to each. Without a map, forms of other triangles than ``faces`` have
        vertices of their own.

    Raises
    ------
    ShapeError
        If the surface cannot be prepared, or the method refuses it.
    ConfigurationError
        If there is no such method, or it computes no forms.
    """
    maker = form_maker(select([method])[0])
    mesh = Mesh(vertices, faces)  # type: ignore[arg-type]
    return form_of_surface(maker, mesh, n_vertices=n_vertices, seed=seed)


def _lines_of_progress() -> Callable[[Any], None]:
    shown = -_INTERVAL

    def watch(state: Any) -> None:
        nonlocal shown
        if time.monotonic() - shown >= _INTERVAL:
            shown = time.monotonic()
            say(
                f"{state.done}/{state.total} steps, {'; '.join(state.working) or 'starting'}",
                err=True,
            )

    return watch


def _listed(values: Any) -> list[Any]:
    return list(values) if isinstance(values, list | tuple) else [values]
