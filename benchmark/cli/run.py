"""``plan`` and ``run``: list the jobs of a selection, run those that are missing, and print their tables."""

from __future__ import annotations

import os
import shlex
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.cli.progress import Bar
from benchmark.cli.results import outcome, print_tables
from benchmark.commands.external_rows import check_forms, forms_of
from benchmark.datasets.catalogue import CATALOGUE, is_known, is_present
from benchmark.datasets.changes import split_name
from benchmark.datasets.checking import by_kind, unread_files
from benchmark.errors import ConfigurationError
from benchmark.kernels import compiled_kernels, suite_sources
from benchmark.machine import available_cores
from benchmark.pipeline.data_names import label_data_sets
from benchmark.pipeline.records import Record, read_records
from benchmark.protocols.tables import TABLES, own_table
from benchmark.registry import Component
from benchmark.report.formats import robustness_markdown
from benchmark.report.frames import changed, chosen_records, fold_of
from benchmark.report.tables import table_views
from benchmark.runs.lacking import LackingModel, lacking_models, train_lacking
from benchmark.runs.planning import Planned, estimate, plan_selection
from benchmark.runs.runner import run as run_jobs
from benchmark.runs.runner import with_results
from benchmark.text import brief, counted, listed, nfc, say, say_lines, say_table


def planned_jobs(
    selection: Selection,
    records: Sequence[Record] | None = None,
    rerun: Collection[str] = (),
    forms: Sequence[Component] = (),
    *,
    in_this_process: bool = False,
) -> list[Planned]:
    """Plan a selection; raise ``ConfigurationError`` if it has no job."""
    selection.say_folders(*selection.datasets, *[selection.gallery] * bool(selection.gallery))
    return plan_selection(
        selection.results,
        methods=forms or selection.methods,
        scorer=selection.scorer,
        seed=selection.seed,
        rerun=rerun,
        records=records,
        plugins=selection.plugins,
        in_this_process=in_this_process,
        tables=selection.tables,
        datasets=selection.datasets,
        input=selection.input,
        quick=selection.quick,
        data_root=selection.require_data_root(),
        gallery=selection.gallery,
        gallery_views=selection.gallery_views,
        same_names=selection.same_names,
        subjects=[name for name in nfc(selection.subjects).split(",") if name],
    )


#: Jobs that ``plan`` prints one by one; of more, it prints the methods of each data set and input.
_LISTED = 24


def plan(selection: Selection, *, traceback: bool = False, every: bool = False) -> None:
    """Print the jobs, the reasons to run them, and an estimate of the time."""
    records = read_records(selection.results, published=False)
    jobs = planned_jobs(selection, records)
    pending, cores = [job for job in jobs if job.is_pending], available_cores()
    if every or len(jobs) <= _LISTED:
        names = _names(jobs, records)
        say_table(
            [(job.state, name, brief(job.reason)) for job, name in zip(jobs, names, strict=True)]
        )
    else:
        _say_counts(jobs)
    say(
        f"{len(pending)} of {len(jobs)} jobs to run"
        + "; --jobs lists each" * (not every and len(jobs) > _LISTED)
    )
    expected = estimate(pending, records)
    if expected.seconds:
        work, wall = (_roughly(expected.seconds / share) for share in (1, cores))
        say(f"at most about {wall} with {cores} processes ({work} of processor time)")
    if expected.unknown:
        say(f"{expected.unknown} of them cannot be estimated: no job of their method has finished")
    _say_lacking(_lacking(selection))
    for record in _records_of(jobs, records) if traceback else ():
        if record.traceback:
            say(f"{record.row}: {record.reason}")
            say_lines("  " + record.traceback.rstrip().replace("\n", "\n  "))


def run(
    selection: Selection,
    *,
    size: int | None,
    dask: str,
    timeout: float,
    rerun: Collection[str],
    forms: Sequence[str],
    train: bool = False,
) -> bool:
    """Run the selected jobs, or score forms of other programs, and print tables; return whether all jobs are ok.

    With ``train``, models that the networks of the selection lack are trained first.
    """
    if not (
        selection.everything
        or selection.tables
        or selection.methods
        or selection.datasets
        or selection.plugins
    ):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    if train:
        lacking = _lacking(selection)
        _say_lacking(lacking)
        train_lacking(lacking, selection.results, selection.data_root, say)
    records = read_records(selection.results)
    of_programs, in_this_process = _forms(selection, forms), size == 0 and not dask
    jobs = planned_jobs(selection, records, rerun, of_programs, in_this_process=in_this_process)
    for job in jobs if forms else ():
        check_forms(job.record, job.before, job.sides[0].method.given)
    _announce(jobs, selection.data_root, records)
    pending = [job for job in jobs if job.is_pending]
    say(
        f"{len(pending)} of {len(jobs)} jobs to run, {sum(job.state == 'finished' for job in jobs)} finished before"
    )
    names = {job.record.key: name for job, name in zip(jobs, _names(jobs, records), strict=True)}
    missed = _missed(jobs, selection)
    for job in missed:
        remedy = "; --retry runs it again" if job.state == "failed" else ""
        say(f"{job.state:<11}  {names[job.record.key]}  {brief(job.reason)}{remedy}")
    if pending and not any(map(compiled_kernels, suite_sources())):
        say(
            "the first run compiles kernels, which takes minutes; 'python -m benchmark.kernels' does so in advance"
        )
    if in_this_process:
        say(
            "-j 0: plugins run in this process, by one thread, without time limits; nothing of them is kept",
            err=True,
        )
    size = available_cores() if size is None else size
    fine = not missed
    ended: dict[str, Record] = {}
    expected = estimate(pending, records)
    factor = len(pending) / max(
        1, len(pending) - expected.unknown
    )  # jobs of unknown methods take as long as others
    with Bar(len(pending), factor * expected.seconds / max(1, size)) as bar:
        for record in run_jobs(
            jobs,
            selection.results,
            size=size,
            timeout=timeout,
            dask=dask,
            anew="finished" in rerun,
            watch=bar.watch,
        ):
            bar.ended(f"{record.status:<11}  {names[record.key]}  {outcome(record)}")
            ended[record.key] = record
            fine &= record.status == "ok"
    if any(record.traceback for record in ended.values()):
        say("'plan --traceback', with the same selection, prints errors in full", err=True)
    records = with_results(records, jobs, ended)
    if selection.subjects:  # tables show whole galleries
        for record in _records_of(jobs, records):
            say(f"{names[record.key]}  {outcome(record)}")
        return fine
    _print_tables_of(jobs, records, selection)
    if any("|" in name for name in selection.methods):
        say(
            "- The best of several values is tuned on these shapes; choose it on others: --subjects A,B."
        )
    return fine


def _lacking(selection: Selection) -> list[LackingModel]:
    """Return the models that the networks of a selection lack."""
    return lacking_models(
        selection.results,
        methods=selection.methods,
        plugins=selection.plugins,
        input=selection.input,
        data_root=selection.require_data_root(),
        tables=selection.tables,
        datasets=selection.datasets,
        quick=selection.quick,
    )


def _say_lacking(lacking: Sequence[LackingModel]) -> None:
    """Say how many models are lacking, and how long their trainings take."""
    if not lacking:
        return
    counts = Counter(model.method.partition("[")[0] for model in lacking)
    named = ", ".join(f"{count} of {name}" for name, count in counts.items())
    known = [model.seconds for model in lacking if model.seconds is not None]
    takes = f"about {_roughly(sum(known))} of processor time"
    if len(known) < len(lacking):
        takes += f", {len(lacking) - len(known)} of them unknown"
    verb = "is" if len(lacking) == 1 else "are"
    models = counted(len(lacking), "model")
    say(f"{models} {verb} missing ({named}); 'run --train' trains first: {takes}")


def _say_counts(jobs: Sequence[Planned]) -> None:
    """Print how many methods run on each data set and input, and then which cannot, or failed, and why."""
    counts: dict[tuple[str, str], Counter[str]] = {}
    reasons: dict[tuple[str, str], list[str]] = {}
    for job in jobs:
        kind = "to run" if job.is_pending else "done" if job.state == "finished" else "not possible"
        counts.setdefault((job.record.gallery, job.record.input), Counter())[kind] += 1
        if kind == "not possible" or job.state in ("stale", "failed"):
            reasons.setdefault((job.state, brief(job.reason)), []).append(job.record.method)
    kinds = [
        kind
        for kind in ("to run", "done", "not possible")
        if any(of[kind] for of in counts.values())
    ]
    rows = [
        (*place, *(f"{of[kind]:>{len(kind)}}" if of[kind] else "" for kind in kinds))
        for place, of in counts.items()
    ]
    say_table([("data", "input", *kinds), *rows], whole=range(1, 2 + len(kinds)))
    for (state, reason), methods in reasons.items():
        say(f"{state}: {listed(dict.fromkeys(methods))} ({counted(len(methods), 'job')}): {reason}")


def _roughly(seconds: float) -> str:
    """Return a time in words: 40 s, 12 min, 2 h 10 min."""
    minutes = round(seconds / 60)
    return (
        f"{round(seconds)} s"
        if seconds < 90
        else f"{minutes} min"
        if minutes < 60
        else (f"{minutes // 60} h" + f" {minutes % 60} min" * bool(minutes % 60))
    )


def _records_of(jobs: Sequence[Planned], records: Iterable[Record]) -> list[Record]:
    keys = {job.record.key for job in jobs}
    return [record for record in records if record.key in keys]


def _names(jobs: Sequence[Planned], records: Iterable[Record]) -> list[str]:
    """Return what each job is called beside records."""
    labelled = label_data_sets([*records, *(job.record for job in jobs)])
    return [str(record.row) for record in labelled[-len(jobs) :]]


def _missed(jobs: Sequence[Planned], selection: Selection) -> list[Planned]:
    """Return the jobs that do not run and have no result, but those that cannot run and were not named."""
    left = [job for job in jobs if not job.is_pending and job.state != "finished"]
    possible = {
        job.record.method for job in jobs if job.state not in ("unsupported", "unavailable")
    }
    if not selection.is_narrow:
        return [job for job in left if job.state not in ("unsupported", "unavailable")]
    return [job for job in left if job.state != "unsupported" or job.record.method not in possible]


def _forms(selection: Selection, forms: Sequence[str]) -> list[Component]:
    """Return forms of other programs, ``NAME=DIR`` each, as methods."""
    folders = dict(form.partition("=")[::2] for form in forms)
    are_named = len(folders) == len(forms) and all(folders) and all(folders.values())
    if not are_named or (forms and (selection.methods or not selection.datasets)):
        problem = "--forms scores the meshes of folders as forms of a data set"
        raise ConfigurationError(problem, "pass -d FOLDER --forms NAME=DIR, without -m")
    return [forms_of(Path(folder), title) for title, folder in folders.items()]


def _print_tables_of(
    jobs: Sequence[Planned], records: Sequence[Record], selection: Selection
) -> None:
    """Print the tables of jobs, with all rows of their galleries, or those of their methods if some are selected."""
    labelled = label_data_sets([*records, *(job.record for job in jobs)])
    known, of_run = labelled[: len(records)], labelled[len(records) :]
    pairs, wanted, sets = set(), set(), set()
    for job, record in zip(jobs, of_run, strict=True):
        pairs.add((record.gallery, record.input))
        for table in (gallery.table for gallery in job.galleries):
            shown = table if table in TABLES else own_table(record.data.name, fold_of(record))
            wanted.add(shown.identifier)
            if not table.is_robustness:
                sets.add(record.data.name)
    every = chosen_records(
        known, quick=selection.quick, scorer=selection.scorer, seed=selection.seed
    )
    of_jobs = [record for record in every if (record.gallery, record.input) in pairs]
    methods = [record.method for record in of_run] if selection.is_narrow else ()
    views = [
        view
        for view in table_views(of_jobs, wanted, methods, sets)
        if view.table.identifier in wanted
    ]
    say()
    is_changed = any(changed(record.data.name) for record in of_run)
    print_tables(views, robustness_markdown(of_jobs) if is_changed else "")


def _announce(jobs: Sequence[Planned], data_root: Path | None, records: Iterable[Record]) -> None:
    """Announce stand-ins, folders that are no longer where they were, and files that are not read."""
    folders = {job.record.data.name: job.record.data.path for job in jobs if job.record.data.path}
    for path in sorted(
        {of.data.path for of in records if folders.get(of.data.name, of.data.path) != of.data.path}
    ):
        # Of a path that no system allows, Path.exists raises an error.
        if not os.path.exists(split_name(path)[0]):  # noqa: PTH110
            forget = shlex.join(["forget", "-d", path])
            say(f"{path} is no longer there; its rows stay in tables until '{forget}'", err=True)
    for name, official in {
        job.record.data.name: job.record.data.stand_in_for for job in jobs
    }.items():
        if official in CATALOGUE and name in CATALOGUE:
            where = f"{data_root or 'DATA_ROOT'}/{CATALOGUE[official].folder}"
            absent = (
                ""
                if is_present(official, data_root)
                else f", which is not at {where}; see --data-root"
            )
            say(f"{name}: generated stand-in for {official}{absent}", err=True)
    for record in {
        job.record.gallery: job.record for job in jobs if job.record.keeps_same_names
    }.values():
        named = len({*record.shapes} & {*record.sides[-1].shapes})
        say(
            f"{record.gallery}: {named} queries have names of its shapes; --same-names leaves these out",
            err=True,
        )
    own = {
        one.source: one.dataset for job in jobs for one in job.galleries if not is_known(one.source)
    }
    for source, dataset in own.items():
        for anomaly in by_kind(unread_files(dataset)):
            say(f"{source}: {anomaly}", err=True)
