"""Run jobs, from Python or for the command line.

>>> import benchmark
>>> from baselines.classic_mds import ClassicMDS
>>> methods = ["gps", ClassicMDS(), my_function]                       # doctest: +SKIP
>>> jobs = benchmark.run(data="tosca", methods=methods)                # doctest: +SKIP
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.api.contracts import Input
from benchmark.commands.kernels import compile_kernels_of
from benchmark.commands.plan import Plan, plan
from benchmark.commands.printable_tables import Tables
from benchmark.commands.selection import as_paths
from benchmark.defaults import DEFAULT_SCORER
from benchmark.machine import available_cores
from benchmark.pipeline.data_names import label_data_sets
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import TABLES
from benchmark.report.formats import records_of_robustness
from benchmark.report.record_facts import change_of, chosen_records, fold_of, tables_of
from benchmark.report.results import Results
from benchmark.report.tables import table_views
from benchmark.runs.planning import Planned
from benchmark.runs.runner import result_of, run_jobs, with_results
from benchmark.text import say

if TYPE_CHECKING:
    from pandas import DataFrame

#: Seconds between lines of progress.
_INTERVAL = 15.0


def run(
    data: str | Path | Iterable[str | Path],
    methods: Any = (),
    *,
    input: Input = "mesh",
    scorer: str = DEFAULT_SCORER,
    plugins: str | Path | Iterable[str | Path] = (),
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
    """Run methods on data sets, unless they have run before, and return one row per job.

    Your own objects and functions run in this process, and in each call. All other methods run in
    worker processes, and their results are kept.

    Parameters
    ----------
    data
        Names or folders of data sets.
    methods
        Names, objects, classes, and functions from a shape to positions; all methods by default.
    input
        ``"mesh"`` for complete surfaces, ``"view"`` for one depth view of each.
    scorer
        Name of the scorer.
    plugins
        Plugin files that define methods and scorers.
    results
        The results folder.
    data_root
        Folder of the official data sets, by default ``CANONICAL_FORMS_DATA``.
    quick
        Whether to leave out most poses.
    gallery
        Name or folder of other shapes, in which the data are queries; by default, the data rank
        each other.
    gallery_views
        Number of cameras around each shape of the gallery, if the queries are views; 0 for none.
    same_names
        Whether a shape of the gallery is left out if it has the name of the query.
    seed
        Base seed.
    again
        Whether to run finished jobs again.
    watch
        Called with the progress; by default, a line on stderr says now and then how far the run is.

    Returns
    -------
    pandas.DataFrame
        One row per job, as in :attr:`benchmark.report.results.Results.jobs`: a job that failed has
        a ``status`` and a ``reason``.

    Raises
    ------
    ConfigurationError
        If a name is unknown, or a value is invalid.
    DatasetError
        If none of the data sets can be used; if some can, it warns of the others.
    """
    rerun = ["failed", "finished"] if again else ["failed"]
    planned = plan(
        data,
        methods,
        input=input,
        scorer=scorer,
        plugins=[path.resolve() for path in as_paths(plugins)],
        results=Path(results).absolute(),
        data_root=data_root,
        quick=quick,
        gallery=gallery,
        gallery_views=gallery_views,
        same_names=same_names,
        seed=seed,
        rerun=rerun,
    )
    for name, error in planned.refused.items():
        warnings.warn(f"{name} is refused: {error}", stacklevel=2)
    ended = list(run_plan(planned, watch=watch))
    return jobs_of(planned, ended).jobs


def run_plan(
    plan: Plan,
    *,
    size: int | None = None,
    timeout: float = 7200.0,
    dask: str = "",
    watch: Callable[[Any], object] | None = None,
) -> Iterator[Record]:
    """Compile the kernels of a plan, then return an iterator that runs its jobs.

    It yields the record of each job as it ends. The workers of a dask cluster compile kernels for
    themselves.

    Parameters
    ----------
    plan
        See :func:`benchmark.plan`.
    size
        Number of worker processes; by default, as many as there are cores.
    timeout
        Seconds that a method may take for a shape.
    dask
        Address of the scheduler of a dask cluster that does the work instead.
    watch
        Called with the progress; by default, a line on stderr says now and then how far the run is.
    """
    if not dask:
        compile_kernels_of(plan)
    if size is None:
        size = available_cores()
    return run_jobs(
        plan.jobs,
        plan.results,
        size=size,
        timeout=timeout,
        dask=dask,
        anew="finished" in plan.rerun,
        watch=watch or _lines_of_progress(),
    )


def jobs_of(plan: Plan, ended: Iterable[Record]) -> Results:
    """Return the jobs of a plan after a run, with the records of those that ended in it."""
    by_key = {record.key: record for record in ended}
    records = [result_of(job, by_key) for job in plan.jobs]
    finished = [record for record in records if record is not None]
    return Results(plan.results, tuple(label_data_sets(finished)))


def records_after(plan: Plan, ended: Iterable[Record]) -> list[Record]:
    """Return the records of a results folder after a run of a plan."""
    return with_results(plan.records, plan.jobs, {record.key: record for record in ended})


def tables_of_run(plan: Plan, records: Sequence[Record]) -> Tables:
    """Return the tables that a run has filled, with all rows that earlier runs put into them.

    If methods were named, only their rows are printed.

    Parameters
    ----------
    plan
        The plan of the run.
    records
        All records after the run; see :func:`records_after`.
    """
    # All records are labelled at once, so that two folders of one name get different labels.
    labelled = label_data_sets([*records, *(job.record for job in plan.jobs)])
    all_records = labelled[: len(records)]
    of_run = labelled[len(records) :]
    identifiers, datasets = _places_of_jobs(plan.jobs, of_run)

    # Take all records of the same galleries, also from earlier runs.
    galleries = {(record.gallery, record.input) for record in of_run}
    first = of_run[0]
    chosen = chosen_records(
        all_records, quick=first.data.quick, scorer=plan.scorer, seed=first.seed
    )
    chosen = [record for record in chosen if (record.gallery, record.input) in galleries]
    methods = [record.method for record in of_run] if plan.is_narrow else ()
    views = table_views(chosen, identifiers, methods, datasets)
    of_robustness: list[Record] = []
    if any(change_of(record.data.name) for record in of_run):
        of_robustness = records_of_robustness(chosen, methods)
    return Tables(
        tuple(view for view in views if view.table.identifier in identifiers),
        tuple(chosen),
        of_robustness=tuple(of_robustness),
    )


def _places_of_jobs(
    jobs: Sequence[Planned], records: Sequence[Record]
) -> tuple[set[str], set[str]]:
    """Return in which tables jobs have rows, and of which data sets these are.

    Parameters
    ----------
    jobs
        The jobs.
    records
        The record of each job; two data sets never have one name.

    Returns
    -------
    identifiers : set of str
        Identifiers of the tables.
    datasets : set of str
        Names of the data sets of tables other than that of robustness.
    """
    identifiers = set[str]()
    datasets = set[str]()
    for job, record in zip(jobs, records, strict=True):
        for gallery in job.galleries:
            table = gallery.table
            if not table.is_robustness:
                datasets.add(record.data.name)
            if table in TABLES:
                identifiers.add(table.identifier)
            else:  # it was made for this data set, which may have tables under another name
                shown = tables_of(record.data.name, fold_of(record))
                identifiers.update(table.identifier for table in shown)
    return identifiers, datasets


def _lines_of_progress() -> Callable[[Any], None]:
    """Return a function that is called often, and prints how far a run is every few seconds."""
    last = -math.inf

    def watch(state: Any) -> None:
        """Print how far the run is, unless that was done a moment ago."""
        nonlocal last
        now = time.monotonic()
        if now - last >= _INTERVAL:
            last = now
            working = "; ".join(state.working) or "starting"
            say(f"{state.done}/{state.total} steps, {working}", err=True)

    return watch
