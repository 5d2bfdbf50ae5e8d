"""What a run would do, why, and how long it would take."""

from __future__ import annotations

import os
import shlex
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.api.contracts import Input
from benchmark.api.datasets import ShapeSet
from benchmark.commands.external_rows import check_forms, forms_of
from benchmark.commands.selection import (
    RESULTS,
    as_list,
    as_paths,
    as_texts,
    check_input,
    data_folder,
    further_options,
    shadowed_folders,
)
from benchmark.datasets.anomalies import by_kind
from benchmark.datasets.catalogue import CATALOGUE, is_known, is_present
from benchmark.datasets.changes import split_changes
from benchmark.datasets.checking import (
    classes_alike,
    unfinished_files,
    unread_files,
    unreadable_files,
)
from benchmark.defaults import DEFAULT_SCORER
from benchmark.errors import BenchmarkError, ConfigurationError, check_known, check_seed
from benchmark.pipeline.data_names import label_data_sets
from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from benchmark.registry import Component, are_named
from benchmark.registry.names import base_name
from benchmark.runs.lacking import LackingModel, lacking_models
from benchmark.runs.planning import Estimate, Planned, estimate, plan_selection
from benchmark.text import listed, nfc

if TYPE_CHECKING:
    from pandas import DataFrame


#: States of jobs that cannot run.
_IMPOSSIBLE = ("unsupported", "unavailable")

#: States of jobs that may run again.
_RERUN = ("failed", "finished")


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """The jobs of a selection, with their states; a notebook shows them as a table.

    Parameters
    ----------
    results
        The results folder.
    jobs
        The jobs.
    records
        Records of the results folder before the run.
    data_root
        Folder of the official data sets.
    rerun
        States of jobs that run again.
    is_narrow
        Whether methods were named.
    in_this_process
        Whether plugins run in this process, and nothing of them is kept.
    notes
        Names that mean other data than a folder of the same name.
    refused
        Errors of data sets that cannot be used, by the names that were passed. Those of the others
        have jobs.
    """

    results: Path
    jobs: tuple[Planned, ...]
    records: tuple[Record, ...]
    data_root: Path | None = None
    rerun: tuple[str, ...] = ()
    is_narrow: bool = False
    in_this_process: bool = False
    notes: tuple[str, ...] = ()
    refused: Mapping[str, BenchmarkError] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return how many jobs there are to run."""
        return f"Plan({len(self.pending)} of {len(self.jobs)} jobs to run)"

    @property
    def pending(self) -> list[Planned]:
        """The jobs that a run would do."""
        return [job for job in self.jobs if job.is_pending]

    @cached_property
    def estimate(self) -> Estimate:
        """Upper bound for the seconds of the jobs on one core, and how many cannot be estimated."""
        return estimate(self.pending, self.records)

    @cached_property
    def names(self) -> dict[str, str]:
        """What each job is called beside records, by its key."""
        labelled = label_data_sets([*self.records, *(job.record for job in self.jobs)])
        of_jobs = labelled[len(self.records) :]
        return {
            job.record.key: str(record.row) for job, record in zip(self.jobs, of_jobs, strict=True)
        }

    @property
    def scorer(self) -> str:
        """Name of the scorer of the jobs in its normal form; the default one if none needs any."""
        scorers = [job.record.scorer for job in self.jobs if job.record.scorer]
        return scorers[0] if scorers else DEFAULT_SCORER

    @property
    def missed(self) -> list[Planned]:
        """The jobs without a result that do not run, but those that cannot and were not named."""
        left = [job for job in self.jobs if not job.is_pending and job.state != "finished"]
        if not self.is_narrow:
            return [job for job in left if job.state not in _IMPOSSIBLE]
        possible = {job.record.method for job in self.jobs if job.state not in _IMPOSSIBLE}
        return [
            job for job in left if job.state != "unsupported" or job.record.method not in possible
        ]

    @property
    def frame(self) -> DataFrame:
        """One row per job: ``data``, ``input``, ``method``, ``state``, ``reason`` and ``runs``."""
        from pandas import DataFrame

        return DataFrame(
            {
                "job": list(self.names.values()),
                "data": [job.record.gallery for job in self.jobs],
                "input": [job.record.input for job in self.jobs],
                "method": [job.record.method for job in self.jobs],
                "state": [job.state for job in self.jobs],
                "reason": [job.reason for job in self.jobs],
                "runs": [job.is_pending for job in self.jobs],
            }
        ).set_index("job")

    def known_records(self, records: Iterable[Record] | None = None) -> list[Record]:
        """Return the records of the jobs among some records, by default those of before the run."""
        if records is None:
            records = self.records
        keys = {job.record.key for job in self.jobs}
        return [record for record in records if record.key in keys]

    def announcements(self) -> list[str]:
        """Say which data are stand-ins, which folders are gone, and which files are not read."""
        return [
            *self._folders_that_are_gone(),
            *self.stand_ins(),
            *self._queries_of_the_gallery(),
            *self.problems_of_files(),
        ]

    def _folders_that_are_gone(self) -> Iterable[str]:
        """Say which folders are gone whose results are still stored.

        This is so after a folder of data was moved: the old rows would stand in tables beside those
        of the new place, under the same name.
        """
        present = {}  # folder of each data set of this plan, by its name
        for job in self.jobs:
            data = job.record.data
            if data.path:
                present[data.name] = data.path
        elsewhere = set()
        for record in self.records:
            data = record.data
            if present.get(data.name, data.path) != data.path:
                elsewhere.add(data.path)
        for path in sorted(elsewhere):
            # Path.exists would raise an error for a path that the system does not allow.
            if not os.path.exists(split_changes(path)[0]):  # noqa: PTH110
                words = ["forget", "-d", path]
                words += further_options(self.results, DEFAULT_SCORER, 0, None)
                forget = shlex.join(words)
                yield f"{path} is no longer there; its rows stay in tables until '{forget}'"

    def stand_ins(self) -> Iterable[str]:
        """Say which data are stand-ins, and where absent official data come from."""
        names_of_stand_ins = defaultdict[str, dict[str, None]](dict)  # by the official set
        for job in self.jobs:
            data = job.record.data
            if data.stand_in_for in CATALOGUE and data.name in CATALOGUE:
                names_of_stand_ins[data.stand_in_for][data.name] = None
        for official, names in names_of_stand_ins.items():
            absent = ""
            if not is_present(official, self.data_root):
                where = f"{self.data_root or 'DATA_ROOT'}/{CATALOGUE[official].folder}"
                url = CATALOGUE[official].url
                absent = f", which is not at {where}; see --data-root; it comes from {url}"
            yield f"{listed(names)}: generated stand-in for {official}{absent}"

    def _queries_of_the_gallery(self) -> Iterable[str]:
        """Say how many queries have names of shapes of their gallery."""
        keeping = [job.record for job in self.jobs if job.record.keeps_same_names]
        for gallery, record in {record.gallery: record for record in keeping}.items():
            named = len({*record.shapes} & {*record.sides[-1].shapes})
            yield (
                f"{gallery}: {named} queries have names of its shapes; --same-names leaves these "
                "out"
            )

    def problems_of_files(self) -> list[str]:
        """Say what in the data folders of the user may be meant otherwise.

        These are files that cannot be read or are not used, and classes of nearly the same name.
        """
        folders: dict[str, ShapeSet] = {}
        for job in self.jobs:
            for gallery in job.galleries:
                if not is_known(gallery.source):
                    folders[gallery.source] = gallery.dataset
        problems = []
        for source, dataset in folders.items():
            anomalies = [
                *unreadable_files(dataset),
                *unread_files(dataset),
                *unfinished_files(dataset, dataset.shapes),
                *classes_alike(dataset),
            ]
            problems += [f"{source}: {anomaly}" for anomaly in by_kind(anomalies)]
        return problems

    def _repr_html_(self) -> str:
        """Show the jobs as a table."""
        return str(self.frame.to_html())


def plan(
    data: str | Path | Iterable[str | Path] = (),
    methods: Any = (),
    *,
    tables: str | Iterable[str] = (),
    input: Input | None = None,
    scorer: str = DEFAULT_SCORER,
    plugins: str | Path | Iterable[str | Path] = (),
    forms: Mapping[str, str | Path] | None = None,
    results: str | Path = RESULTS,
    data_root: str | Path | None = None,
    quick: bool = False,
    subjects: str | Iterable[str] | None = None,
    gallery: str | Path = "",
    gallery_views: int = 0,
    same_names: bool = False,
    seed: int = 0,
    rerun: str | Iterable[str] = (),
    in_this_process: bool = False,
) -> Plan:
    """Say what :func:`benchmark.run` would do with the same selection, why, and how long it takes.

    Parameters
    ----------
    data, methods, input, scorer, plugins, results, data_root, quick
        As for :func:`benchmark.run`; ``input=None`` is both.
    gallery, gallery_views, same_names, seed
        As for :func:`benchmark.run`.
    tables
        Identifiers of tables whose data are selected; without data and tables, I to IV, I-view to
        III-view.
    forms
        Folders with forms of another program by title, to be scored instead of methods.
    subjects
        Names of the only subjects to rank, to choose parameters on; all by default.
    rerun
        States of jobs that run again: ``"failed"``, ``"finished"``.
    in_this_process
        Whether plugins run in this process.

    Raises
    ------
    ConfigurationError
        If a name is unknown, or nothing is selected, be it of a single method, table or data set
        that is named.
    DatasetError
        If a data set cannot be used. Of several, those that can are planned, and the errors of the
        others are those of :attr:`Plan.refused`.
    """
    check_input(input)
    check_seed(seed)
    rerun_states = as_texts(rerun)
    check_known("state of jobs that run again", rerun_states, _RERUN)
    sets = as_texts(data)
    selected_methods = as_list(methods)
    selected_tables = as_texts(tables)
    root = data_folder(data_root)
    of_programs = _forms_as_methods(forms or {}, selected_methods, sets)
    chosen = of_programs or selected_methods
    folder = Path(results)
    records = read_records(folder)
    gallery = str(gallery)
    jobs_of = partial(
        plan_selection,
        folder,
        methods=chosen,
        scorer=scorer,
        seed=int(seed),  # of numpy's integers, none can stand in a record
        rerun=rerun_states,
        records=records,
        plugins=as_paths(plugins),
        in_this_process=in_this_process,
        tables=selected_tables,
        input=input,
        quick=quick,
        data_root=root,
        gallery=gallery,
        gallery_views=gallery_views,
        same_names=same_names,
        subjects=_named_subjects(subjects),
    )
    refused: dict[str, BenchmarkError] = {}
    try:
        jobs = jobs_of(datasets=sets)
    except BenchmarkError:
        refused = _refused(sets, jobs_of)
        usable = [name for name in sets if name not in refused]
        if not (refused and usable):
            raise
        jobs = jobs_of(datasets=usable)
    if not refused:
        _check_have_jobs(selected_methods, selected_tables, jobs)
    if of_programs:
        for job in jobs:
            check_forms(job.record, job.before, job.job.method.given)
    return Plan(
        folder,
        tuple(jobs),
        tuple(records),
        root,
        tuple(rerun_states),
        is_narrow=are_named(selected_methods),
        in_this_process=in_this_process,
        notes=tuple(shadowed_folders(filter(None, [*sets, gallery]), root)),
        refused=refused,
    )


def _check_have_jobs(
    methods: Sequence[Any], tables: Sequence[str], jobs: Sequence[Planned]
) -> None:
    """Raise ``ConfigurationError`` if a method or a table is named that has no job."""
    filled: set[str] = set()
    for gallery in chain.from_iterable(job.galleries for job in jobs):
        filled |= {gallery.table.identifier, gallery.table.part_of}
    empty = [name for name in tables if name not in filled]
    if empty:
        problem = f"table {listed(empty)} has no job in this selection"
        raise ConfigurationError(problem, "drop this table, or -d, -m or --input")
    if not are_named(methods):
        return
    running = {job.job.method.base_name for job in jobs}
    names = [name for name in methods if isinstance(name, str)]
    idle = [name for name in names if base_name(name.strip()) not in running]
    if idle:
        problem = f"{listed(idle)} has no row in the selected tables"
        raise ConfigurationError(problem, "drop it, or -t or --input")


def _named_subjects(subjects: str | Iterable[str] | None) -> list[str]:
    """Return the names of subjects, which may stand in one text with commas; None names none.

    Raise ``ConfigurationError`` if a list without names was passed: it would select all.
    """
    if subjects is None:
        return []
    if isinstance(subjects, str):
        subjects = subjects.split(",")
    # A name that stands there twice would make another gallery of the same shapes.
    names = [*dict.fromkeys(nfc(name) for name in as_texts(subjects) if name)]
    if not names:
        raise ConfigurationError("no subject is named", "name one, or omit subjects for all")
    return names


def _refused(sets: Iterable[str], jobs_of: Callable[..., object]) -> dict[str, BenchmarkError]:
    """Return the data sets that have no jobs each alone, with their errors."""
    refused = {}
    for name in sets:
        try:
            jobs_of(datasets=[name])
        except BenchmarkError as error:
            refused[name] = error
    return refused


def lacking(
    data: str | Path | Iterable[str | Path] = (),
    methods: Any = (),
    *,
    tables: str | Iterable[str] = (),
    input: Input | None = None,
    plugins: str | Path | Iterable[str | Path] = (),
    results: str | Path = RESULTS,
    data_root: str | Path | None = None,
    quick: bool = False,
    subjects: str | Iterable[str] | None = None,
    gallery: str | Path = "",
    gallery_views: int = 0,
    same_names: bool = False,
) -> list[LackingModel]:
    """Return the missing models of the selected networks that can be trained here.

    Parameters
    ----------
    data, methods, tables
        Data sets, methods and tables that are selected; empty for all.
    input
        ``"mesh"`` or ``"view"``; both by default.
    plugins
        Plugin files that may define methods.
    results
        The results folder, which may hold models.
    data_root
        Folder of the official data sets.
    quick
        Whether a quick run is meant.
    subjects, gallery, gallery_views, same_names
        As for :func:`benchmark.plan`.
    """
    check_input(input)
    return lacking_models(
        Path(results),
        methods=as_list(methods),
        plugins=as_paths(plugins),
        input=input,
        data_root=data_folder(data_root),
        tables=as_texts(tables),
        datasets=as_texts(data),
        quick=quick,
        subjects=_named_subjects(subjects),
        gallery=str(gallery),
        gallery_views=gallery_views,
        same_names=same_names,
    )


def _forms_as_methods(
    forms: Mapping[str, str | Path], methods: Sequence[Any], data: Sequence[str]
) -> list[Component]:
    """Return forms of other programs as methods.

    Raise ``ConfigurationError`` unless they alone are selected.
    """
    if forms and (methods or not data):
        problem = "--forms scores the meshes of folders as forms of a data set"
        raise ConfigurationError(problem, "pass -d FOLDER --forms NAME=DIR, without -m")
    return [forms_of(Path(folder), title) for title, folder in forms.items()]
