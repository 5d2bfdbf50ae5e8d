"""``plan`` and ``run``: print the jobs of a selection, run those that are missing, and print their tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence

from benchmark.cli.options import Selection
from benchmark.cli.printing import print_markdown
from benchmark.cli.progress import Bar
from benchmark.commands import plan as planning
from benchmark.commands.plan import Plan
from benchmark.commands.run import records_after, run_plan, tables_of_run
from benchmark.commands.selection import outcome
from benchmark.errors import ConfigurationError
from benchmark.kernel_cache import compiled_kernels, suite_sources
from benchmark.machine import available_cores
from benchmark.pipeline.records import Record
from benchmark.runs.lacking import LackingModel, train_lacking
from benchmark.runs.planning import Estimate, Planned
from benchmark.text import brief, counted, listed, say, say_lines, say_table

#: Jobs that ``plan`` prints one by one; of more, it prints the methods of each data set and input.
_LISTED = 24


def plan(selection: Selection, *, traceback: bool = False, every: bool = False) -> bool:
    """Print the jobs, the reasons to run them, and an estimate of the time; return whether all data can be used."""
    planned = planning.plan(**selection.of_jobs())
    for note in planned.notes:
        say(note, err=True)
    _say_refused(planned)
    is_short = every or len(planned.jobs) <= _LISTED
    if is_short:
        names = planned.names
        say_table([(job.state, names[job.record.key], brief(job.reason)) for job in planned.jobs])
    else:
        _say_counts(planned.jobs)
    hint = "" if is_short else "; --jobs lists each"
    say(f"{len(planned.pending)} of {len(planned.jobs)} jobs to run{hint}")
    _say_time(planned.estimate)
    _say_lacking(_lacking(selection, planned))
    if traceback:
        _say_tracebacks(planned.known_records())
    return not planned.refused


def _lacking(selection: Selection, planned: Plan) -> list[LackingModel]:
    """Return the models that the networks of a selection lack on the data sets that can be used."""
    usable = [name for name in selection.datasets if name not in planned.refused]
    return planning.lacking(**{**selection.of_models(), "data": usable})


def _say_refused(planned: Plan) -> None:
    """Print why data sets have no jobs."""
    for name, error in planned.refused.items():
        say(f"refused: {name}: {error}", err=True)


def _say_time(expected: Estimate) -> None:
    """Print how long the jobs of a plan take at most, and how many cannot be estimated."""
    if expected.seconds:
        cores = available_cores()
        work, wall = _roughly(expected.seconds), _roughly(expected.seconds / cores)
        say(f"at most about {wall} with {cores} processes ({work} of processor time)")
    if expected.unknown:
        say(f"{expected.unknown} of them cannot be estimated: no job of their method has finished")


def _say_tracebacks(records: Iterable[Record]) -> None:
    """Print the errors of failed jobs in full."""
    for record in records:
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
    if not selection.is_something:
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    if train:
        lacking = _lacking(selection, planning.plan(**selection.of_jobs()))
        _say_lacking(lacking)
        train_lacking(lacking, selection.results, selection.data_root, say)
    in_this_process = size == 0 and not dask
    planned = planning.plan(
        **selection.of_jobs(),
        rerun=rerun,
        forms=_forms(forms),
        in_this_process=in_this_process,
    )
    for note in [*planned.notes, *planned.announcements()]:
        say(note, err=True)
    _say_refused(planned)
    n_finished = sum(job.state == "finished" for job in planned.jobs)
    say(f"{len(planned.pending)} of {len(planned.jobs)} jobs to run, {n_finished} finished before")
    for job in planned.missed:
        remedy = "; --retry runs it again" if job.state == "failed" else ""
        name = planned.names[job.record.key]
        say(f"{job.state:<11}  {name}  {brief(job.reason)}{remedy}")
    if planned.pending and not any(map(compiled_kernels, suite_sources())):
        say(
            "the first run compiles kernels, which takes minutes; 'python -m benchmark.kernel_cache' does so in advance"
        )
    if in_this_process:
        say(
            "-j 0: plugins run in this process, by one thread, without time limits; nothing of them is kept",
            err=True,
        )
    ended = _run(planned, available_cores() if size is None else size, dask, timeout)
    if any(record.traceback for record in ended):
        say("'plan --traceback', with the same selection, prints errors in full", err=True)
    records = records_after(planned, ended)
    if selection.subjects:  # tables show whole galleries
        for record in planned.known_records(records):
            say(f"{planned.names[record.key]}  {outcome(record)}")
    else:
        _print_tables(planned, records, selection)
    is_complete = not (planned.missed or planned.refused)
    return is_complete and all(record.status == "ok" for record in ended)


def _run(planned: Plan, size: int, dask: str, timeout: float) -> list[Record]:
    """Run the jobs of a plan below a bar of progress, and print the outcome of each."""
    n_pending = len(planned.pending)
    n_known = max(1, n_pending - planned.estimate.unknown)
    factor = n_pending / n_known  # jobs of unknown methods take as long as others
    ended = []
    with Bar(n_pending, factor * planned.estimate.seconds / max(1, size)) as bar:
        running = run_plan(planned, size=size, timeout=timeout, dask=dask, watch=bar.watch)
        for record in running:
            bar.ended(f"{record.status:<11}  {planned.names[record.key]}  {outcome(record)}")
            ended.append(record)
    return ended


def _forms(words: Sequence[str]) -> dict[str, str]:
    """Return folders of forms by title, from words ``NAME=DIR``."""
    folders = dict(word.partition("=")[::2] for word in words)
    if len(folders) < len(words) or not all(folders) or not all(folders.values()):
        problem = "--forms scores the meshes of folders as forms of a data set"
        raise ConfigurationError(problem, "pass -d FOLDER --forms NAME=DIR, without -m")
    return folders


def _print_tables(planned: Plan, records: Sequence[Record], selection: Selection) -> None:
    """Print the tables of the jobs of a run."""
    shown = tables_of_run(
        planned, records, quick=selection.quick, scorer=selection.scorer, seed=selection.seed
    )
    say()
    print_markdown(shown.markdown())
    if any("|" in name for name in selection.methods):
        say(
            "- The best of several values is tuned on these shapes; choose it on others: --subjects A,B."
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
