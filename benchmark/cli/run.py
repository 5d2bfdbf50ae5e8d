"""``plan`` and ``run``: print the jobs of a selection, run the missing ones, print their tables."""

from __future__ import annotations

import math
import shlex
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Sequence

from benchmark.cli.options import OF_JOBS, OF_MODELS, Selection
from benchmark.cli.printing import print_markdown
from benchmark.cli.progress import Bar
from benchmark.commands.plan import Plan, lacking, plan
from benchmark.commands.run import records_after, run_plan, tables_of_run
from benchmark.commands.selection import further_options, outcome
from benchmark.errors import ConfigurationError
from benchmark.machine import available_cores
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import SYNTHETIC_HUMANS
from benchmark.registry.names import base_name
from benchmark.runs.lacking import LackingModel, train_lacking
from benchmark.runs.planning import Estimate, Planned
from benchmark.text import brief, counted, listed, say, say_lines, say_table

#: Jobs that ``plan`` prints one by one; of more, it prints the methods of each data set and input.
_LISTED = 24


def print_plan(selection: Selection, *, traceback: bool = False, every: bool = False) -> bool:
    """Print what a run would do: its jobs, why each has to run, and how long it takes.

    Parameters
    ----------
    selection
        What to run.
    traceback
        Whether to print the errors of failed jobs in full.
    every
        Whether to list each job, even if there are many.

    Returns
    -------
    bool
        Whether all data sets of the selection can be used.
    """
    _check_all_is_alone(selection)
    planned = plan(**selection.arguments(OF_JOBS))
    for note in [*planned.notes, *planned.stand_ins(), *planned.problems_of_files()]:
        say(note, err=True)
    _say_refused(planned)
    lists_each = every or len(planned.jobs) <= _LISTED
    if lists_each:
        names = planned.names
        say_table([(job.state, names[job.record.key], brief(job.reason)) for job in planned.jobs])
    else:
        _say_counts(planned.jobs)
    hint = "" if lists_each else "; --jobs lists each"
    say(f"{len(planned.pending)} of {len(planned.jobs)} jobs to run{hint}")
    _say_time(planned.estimate)
    _say_lacking(_lacking(selection, planned))
    if traceback:
        _say_tracebacks(planned.known_records())
    return not planned.refused


def _lacking(selection: Selection, planned: Plan) -> list[LackingModel]:
    """Return the models that the networks of a selection lack on the data sets that can be used."""
    usable = [name for name in selection.data if name not in planned.refused]
    return lacking(**{**selection.arguments(OF_MODELS), "data": usable})


def _say_refused(planned: Plan) -> None:
    """Print why data sets have no jobs."""
    for name, error in planned.refused.items():
        say(f"refused: {name}: {error}", err=True)


def _say_time(expected: Estimate) -> None:
    """Print how long the jobs of a plan take at most, and how many cannot be estimated."""
    if expected.seconds:
        cores = available_cores()
        wall = _roughly(expected.seconds / cores)
        work = _roughly(expected.seconds)
        line = f"at most about {wall} with {cores} processes ({work} of processor time)"
        if expected.uses_published:
            line += ", if this machine is as fast as that of the published records"
        say(line)
    if expected.unknown:
        say(f"{expected.unknown} of them cannot be estimated: no job of their method has finished")


def _say_tracebacks(records: Iterable[Record]) -> None:
    """Print the errors of failed jobs in full."""
    for record in records:
        if record.traceback:
            say(f"{record.row}: {record.reason}")
            say_lines("  " + record.traceback.rstrip().replace("\n", "\n  "))


def run_selection(
    selection: Selection,
    *,
    size: int | None,
    dask: str,
    timeout: float,
    rerun: Collection[str],
    forms: Sequence[str],
    train: bool = False,
) -> bool:
    """Run the selected jobs, and print how each ended, and the tables.

    Parameters
    ----------
    selection
        What to run.
    size
        Number of processes; 0 runs in this one, None on all cores.
    dask
        Address of the scheduler of a dask cluster; "" for none.
    timeout
        Seconds that a method may take for a shape.
    rerun
        States of jobs that run again.
    forms
        Words ``NAME=DIR`` for forms of other programs, which are scored instead of methods.
    train
        Whether models that the networks of the selection lack are trained first.

    Returns
    -------
    bool
        Whether all jobs could run, and are ok.

    Raises
    ------
    ConfigurationError
        If nothing is selected, or all tables are and some of them, or models are to be trained for
        forms of other programs.
    """
    if not selection.is_something:
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    _check_all_is_alone(selection)
    if train and forms:
        raise ConfigurationError("--forms scores forms that need no model", "drop --train")

    # Train missing models first, so that the plan finds them.
    if train:
        models = _lacking(selection, plan(**selection.arguments(OF_JOBS)))
        _say_lacking(models)
        train_lacking(models, selection.results, selection.data_root, say)
    in_this_process = size == 0 and not dask
    planned = plan(
        **selection.arguments(OF_JOBS),
        rerun=rerun,
        forms=_folders_of_forms(forms),
        in_this_process=in_this_process,
    )
    _announce(planned)
    if size is None:
        size = available_cores()
    ended = _run(planned, size, dask, timeout)
    if any(record.traceback for record in ended):
        say("'plan --traceback', with the same selection, prints errors in full", err=True)
    _print_results(planned, records_after(planned, ended), selection)
    is_complete = not (planned.missed or planned.refused)
    return is_complete and all(record.status == "ok" for record in ended)


def _check_all_is_alone(selection: Selection) -> None:
    """Raise ``ConfigurationError`` if all tables are selected, and some tables or data by name."""
    if selection.everything and (selection.tables or selection.data):
        raise ConfigurationError("--all selects all tables", "drop --all, or -t and -d")


def _print_results(planned: Plan, records: Sequence[Record], selection: Selection) -> None:
    """Print the tables of a run; of a run of some subjects alone, the outcome of each job.

    Parameters
    ----------
    planned
        The plan of the run.
    records
        All records after it.
    selection
        What was selected.
    """
    if selection.subjects:  # tables show whole galleries
        for record in planned.known_records(records):
            say(f"{planned.names[record.key]}  {outcome(record)}")
    else:
        _print_tables(planned, records, selection)


def _announce(planned: Plan) -> None:
    """Print before a run how many jobs it has, which ones it leaves out, and what may surprise."""
    for note in [*planned.notes, *planned.announcements()]:
        say(note, err=True)
    _say_refused(planned)
    n_finished = sum(job.state == "finished" for job in planned.jobs)
    say(f"{len(planned.pending)} of {len(planned.jobs)} jobs to run, {n_finished} finished before")
    for job in planned.missed:  # they failed before, or cannot run
        remedy = "; --retry runs it again" if job.state == "failed" else ""
        name = planned.names[job.record.key]
        say(f"{job.state:<11}  {name}  {brief(job.reason)}{remedy}")
    if planned.in_this_process:
        say(
            "-j 0: plugins run in this process, by one thread, without time limits; "
            "nothing of them is kept",
            err=True,
        )


def _run(planned: Plan, size: int, dask: str, timeout: float) -> list[Record]:
    """Run the jobs of a plan, and print how each ended, below a bar of progress.

    Parameters
    ----------
    planned
        The plan.
    size
        Number of worker processes; 0 for this process alone.
    dask
        Address of the scheduler of a dask cluster; "" for none.
    timeout
        Seconds that a method may take for a shape.

    Returns
    -------
    list of Record
        The records of the jobs that ran.
    """
    # Some jobs may have no estimate: they count as much as the mean of the others.
    n_pending = len(planned.pending)
    n_estimated = max(1, n_pending - planned.estimate.unknown)
    processor_seconds = planned.estimate.seconds * n_pending / n_estimated
    seconds = processor_seconds / max(1, size)

    records = []
    longest = max((len(planned.names[job.record.key]) for job in planned.pending), default=0)
    bar = Bar(n_pending, seconds)
    # Kernels are compiled by this call, before the bar counts seconds.
    finished = run_plan(planned, size=size, timeout=timeout, dask=dask, watch=bar.watch)
    with bar:
        for record in finished:
            name = planned.names[record.key]
            bar.ended(f"{record.status:<11}  {name:<{longest}}", outcome(record))
            records.append(record)
    return records


def _folders_of_forms(words: Sequence[str]) -> dict[str, str]:
    """Return folders of forms by title, from words ``NAME=DIR``."""
    folders = {}
    for word in words:
        title, _, folder = word.partition("=")
        folders[title] = folder
    if len(folders) < len(words):
        problem = "--forms gives two folders one title"
        raise ConfigurationError(problem, "give each NAME=DIR another NAME")
    if not all(folders) or not all(folders.values()):
        problem = "--forms scores the meshes of folders as forms of a data set"
        raise ConfigurationError(problem, "pass -d FOLDER --forms NAME=DIR, without -m")
    return folders


def _print_tables(planned: Plan, records: Sequence[Record], selection: Selection) -> None:
    """Print the tables that a run has filled, and what to do next.

    Parameters
    ----------
    planned
        The plan of the run.
    records
        All records after it.
    selection
        What was selected.
    """
    tables = tables_of_run(planned, records)
    say()
    print_markdown(tables.markdown())
    if any("|" in name for name in selection.methods):
        say(
            "- The best of several values is tuned on these shapes; choose it on others: "
            "--subjects A,B."
        )
    if tables.views:  # the table of robustness has no pages
        say("next, for classes, failed queries, and forms in 3D:", err=True)
        command = _report_of(selection, planned)
        say(f"  {command}", err=True, is_wrapped=False)  # it can be copied


def _report_of(selection: Selection, planned: Plan) -> str:
    """Return the command that writes the report of a run.

    It has each option without which the report would be of other jobs or data.

    Parameters
    ----------
    selection
        What was selected.
    planned
        The plan of the run, which takes all draws of a set for its first one.
    """
    words = ["python", "-m", "benchmark", "report"]
    sets = dict.fromkeys(selection.data)
    if sets:
        ran = [job.record.data.name for job in planned.jobs]
        sets |= dict.fromkeys(name for name in ran if name in SYNTHETIC_HUMANS[1:])
    for option, names in (("-t", selection.tables), ("-d", sets)):
        for name in names:
            words += [option, str(name)]
    if selection.quick:
        words.append("--quick")
    words += further_options(selection.results, planned.scorer, selection.seed, selection.data_root)
    return shlex.join(words)


def _say_lacking(models: Sequence[LackingModel]) -> None:
    """Print how many trained models are lacking, and how long it takes to train them."""
    if not models:
        return
    counts = Counter(base_name(model.method) for model in models)
    names = ", ".join(f"{count} of {name}" for name, count in counts.items())

    verb = "is" if len(models) == 1 else "are"
    number = counted(len(models), "model")
    duration = _duration_of_trainings([model.seconds for model in models])
    say(f"{number} {verb} missing ({names}); 'run --train' trains first: {duration}")


def _duration_of_trainings(seconds: Sequence[float | None]) -> str:
    """Return how long trainings take, in words.

    Parameters
    ----------
    seconds
        Seconds of processor time of each; None for a method that does not say.
    """
    known = [each for each in seconds if each is not None]
    n_unknown = len(seconds) - len(known)
    if not known:
        return "it is not known how long that takes"
    duration = f"about {_roughly(sum(known))} of processor time"
    if n_unknown:
        duration += f" for {len(known)} of them; it is not known how long the others take"
    return duration


#: What becomes of jobs, in the order of the columns that count them.
_FATES = ("to run", "done", "not possible")


def _fate(job: Planned) -> str:
    """Return what becomes of a job."""
    if job.is_pending:
        return "to run"
    if job.state == "finished":
        return "done"
    return "not possible"


def _say_counts(jobs: Sequence[Planned]) -> None:
    """Print how many jobs of each data set will run, are done, or cannot run; then why.

    This takes the place of a list of all jobs.
    """
    counts = defaultdict[tuple[str, str], Counter[str]](Counter)  # by data set and input
    for job in jobs:
        counts[job.record.gallery, job.record.input][_fate(job)] += 1
    total = sum(counts.values(), Counter[str]())
    fates = [fate for fate in _FATES if total[fate]]
    rows = [["data", "input", *fates]]
    for place, count in counts.items():
        numbers = [str(count[fate] or "").rjust(len(fate)) for fate in fates]
        rows.append([*place, *numbers])
    say_table(rows, whole=range(1, 2 + len(fates)))
    _say_reasons(jobs)


def _say_reasons(jobs: Sequence[Planned]) -> None:
    """Print why jobs cannot run, or have to run again, each reason once with its methods."""
    reasons = defaultdict[tuple[str, str], list[str]](list)  # methods by state and reason
    for job in jobs:
        if _fate(job) == "not possible" or job.state in ("stale", "failed"):
            reasons[job.state, brief(job.reason)].append(job.record.method)
    for (state, reason), methods in reasons.items():
        number = counted(len(methods), "job")
        say(f"{state}: {listed(dict.fromkeys(methods))} ({number}): {reason}")


def _roughly(seconds: float) -> str:
    """Return a time in words: 40 s, 12 min, 2 h 10 min."""
    if seconds < 90:
        return f"{math.ceil(seconds)} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    if not hours:
        return f"{minutes} min"
    if not minutes:
        return f"{hours} h"
    return f"{hours} h {minutes} min"
