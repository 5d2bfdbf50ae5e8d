"""The verbs; what a verb needs is imported when it runs, so that ``--help`` is fast."""

from __future__ import annotations

import faulthandler
import json
import shlex
import warnings
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from msgspec.structs import replace
from typer import Argument, Option

from benchmark.cli import options as shared
from benchmark.cli.options import Selection, cli, data, verb
from benchmark.errors import ConfigurationError
from benchmark.text import say, say_lines, say_table

_JOBS = (
    "everything",
    "tables",
    "methods",
    "datasets",
    "input",
    "scorer",
    "plugins",
    "results",
    "data_root",
    "seed",
    "quick",
    "subjects",
    "gallery",
    "gallery_views",
    "same_names",
)
_RECORDS = (
    "tables",
    "methods",
    "datasets",
    "input",
    "scorer",
    "results",
    "seed",
    "quick",
    "published",
)
_CAMERA = ("intrinsics", "mask", "depth_scale", "picture")


@verb(*_JOBS)
def run(
    selection: Selection,
    jobs: Annotated[
        int | None,
        Option(
            "-j", "--jobs", min=0, metavar="N", help="Processes; 0 runs in this one. [all cores]"
        ),
    ] = None,
    dask: Annotated[
        str, Option("--dask", metavar="URL", help="Scheduler of a dask cluster: tcp://HOST:8786.")
    ] = "",
    timeout: shared.Timeout = "2h",  # type: ignore[assignment]  # typer parses it
    retry: Annotated[bool, Option("--retry", help="Run failed jobs again.")] = False,
    force: Annotated[bool, Option("--force", help="Run finished jobs again, too.")] = False,
    forms: Annotated[
        list[str],
        Option(
            "--forms", metavar="NAME=DIR", help="Score DIR/SHAPE.off of another program instead."
        ),
    ] = [],
    train: Annotated[
        bool, Option("--train", help="First train the models that are missing.")
    ] = False,
) -> bool:
    """Run the missing jobs of a selection, then print its tables."""
    from benchmark.cli.run import run

    rerun = ["failed", "finished"] if force else ["failed"] if retry else []
    return run(
        selection, size=jobs, dask=dask, timeout=timeout, rerun=rerun, forms=forms, train=train
    )


@verb(*_JOBS)
def plan(
    selection: Selection,
    traceback: shared.Traceback = False,
    every: Annotated[bool, Option("--jobs", help="List each job, also of many.")] = False,
) -> None:
    """Show what would run, why, and how long it would take."""
    from benchmark.cli.run import plan

    plan(selection, traceback=traceback, every=every)


@verb(*_RECORDS)
def tables(
    selection: Selection,
    format: Annotated[
        Literal["latex", "markdown", "csv", "json"] | None,
        Option("--format", help="[markdown; with -o, all]"),
    ] = None,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="DIR", help="Write files.")
    ] = None,
    paper: Annotated[
        bool, Option("--paper", help="Also rows of the paper that never ran.")
    ] = False,
    force: shared.Force = False,
    failed: shared.Failed = False,
) -> None:
    """Print or write the tables of finished jobs.

    It needs no data.
    """
    from benchmark.cli.results import print_tables, recorded, selected_tables
    from benchmark.report.formats import latex, robustness_markdown
    from benchmark.report.frames import scored_by
    from benchmark.report.output import FORMATS, table_files, write_files

    records = recorded(selection, failed=failed)
    views = selected_tables(selection, records, paper=paper)
    is_whole = not (
        selection.tables
        or selection.methods
        or selection.datasets
        or selection.input
        or selection.quick
    )
    robustness = is_whole or "robustness" in selection.tables
    if output is not None:
        formats = [format] if format else FORMATS
        files = table_files(views, records, formats, verdicts=is_whole, robustness=robustness)
        write_files(output, files, force=force, listed=f"written{scored_by(records).suffix}.json")
        say(f"wrote {len(files)} files to {output}")
    elif format == "latex":
        say_lines("\n".join(map(latex, views)))
    elif format:
        say_lines(
            "\n".join(
                table_files(
                    views, records, [format], verdicts=False, robustness=robustness
                ).values()
            )
        )
    else:
        print_tables(views, robustness_markdown(records) if robustness else "")


@verb(*_RECORDS, "data_root")
def report(
    selection: Selection,
    output: Annotated[
        Path | None,
        Option(
            "-o", "--output", metavar="OUT", help="Folder [results/report], or figure [KIND.pdf]."
        ),
    ] = None,
    figure: Annotated[
        Literal["forms", "map"] | None,
        Option("--figure", help="Draw a .pdf, .png or .svg instead."),
    ] = None,
    shapes: Annotated[list[str], Option("--shape", metavar="NAME", help="Shape to show.")] = [],
    force: shared.Force = False,
    failed: shared.Failed = False,
) -> None:
    """Write HTML pages, or draw a figure.

    Pages show tables, maps, and canonical forms in 3D.
    """
    from benchmark.cli.results import draw, recorded, selected_tables
    from benchmark.report.output import write_files
    from benchmark.report.pages import report_files

    if figure:
        draw(selection, output or Path(f"{figure}.pdf"), figure, shapes, force=force)
        return
    records, folder = recorded(selection, failed=failed), output or Path("results/report")
    views = selected_tables(selection, records, paper=selection.published)
    files = report_files(selection.results, views, selection.data_root)
    write_files(folder, files, force=force)
    say(f"wrote {folder / 'index.html'} and {len(files) - 1} other files")


@verb("tables", "datasets", "input", "scorer", "results", "seed", "quick", "published")
def compare(
    selection: Selection,
    first: Annotated[str, Argument(metavar="A")],
    second: Annotated[str, Argument(metavar="[B]")] = "",
    format: Annotated[Literal["text", "csv", "json"], Option("--format")] = "text",
) -> None:
    """Test the differences of a method to another one, or to every row of its tables."""
    from benchmark.cli.results import recorded, selected_tables
    from benchmark.report.comparison import compare, details, summaries

    records = recorded(selection, failed=True)
    found = compare(
        selected_tables(replace(selection, methods=[first, second]), records), first, second
    )
    if format == "csv":
        say_lines(found.to_csv(index=False, float_format="%.6f"))
    elif format == "json":
        say_lines(found.to_json(orient="records", indent=1, double_precision=6))
    elif second:
        for line in details(found):
            say(line)
    else:
        for heading, rows in summaries(found):
            say(heading)
            say_table(rows, whole=range(1, 6))


@verb("plugins", "results", "data_root")
def list_(
    selection: Selection,
    what: Annotated[
        Literal["methods", "scorers", "datasets", "tables", "models"], Argument(metavar="WHAT")
    ],
    format: shared.Format = "text",
) -> None:
    """List methods, scorers, datasets, tables or models."""
    from benchmark.cli.names import list_

    list_(what, selection, as_json=format == "json")


@verb("plugins")
def describe(
    selection: Selection,
    name: Annotated[str, Argument(metavar="METHOD|SCORER")],
    format: shared.Format = "text",
) -> None:
    """Describe a method or a scorer: parameters, source, inputs."""
    from benchmark.cli.names import describe

    describe(name, selection.plugins, as_json=format == "json")


@verb("plugins", "seed", *_CAMERA)
def canonicalise(
    selection: Selection,
    method: shared.Method,
    paths: Annotated[list[Path], Argument(metavar="IN...")],
    output: Annotated[
        Path, Option("-o", "--output", metavar="OUT", help="Mesh file, or folder for several.")
    ],
) -> bool:
    """Write the canonical form of a mesh, or of depth images.

    A depth image is a 16-bit PNG, TIFF or PGM, NPY, NPZ or PFM; a folder stands for all of its
    images.
    """
    from benchmark.cli.forms import canonicalise

    return canonicalise(paths, method, selection, output)


@verb("scorer", "plugins", "results", "data_root", "seed", "gallery_views", *_CAMERA)
def retrieve(
    selection: Selection,
    method: shared.Method,
    dataset: Annotated[
        str, Option("-d", "--dataset", metavar="DATASET|FOLDER", help="Data set or folder.")
    ],
    query: Annotated[Path, Argument(metavar="QUERY", exists=True, dir_okay=False)],
    k: Annotated[int, Option("-k", min=1, metavar="N", help="Number of shapes to show.")] = 5,
    input: Annotated[
        Literal["mesh", "view"] | None, Option("--input", help="Of the gallery. [the query's]")
    ] = None,
) -> None:
    """Show the shapes that are nearest to a mesh or a depth image."""
    from benchmark.cli.forms import retrieve

    retrieve(query, dataset, method, selection, k, input)


@cli.command(cls=shared.Verb)
def score(
    distances: Annotated[Path, Argument(metavar="DISTANCES")],
    labels: Annotated[
        Path,
        Option(
            "--labels",
            metavar="FILE|FOLDER",
            help=".cla, lines 'label' or 'name label', or a folder.",
        ),
    ],
    order: Annotated[
        Literal["list", "number", "listing", "natural"] | None,
        Option(
            "--order",
            help="Order of rows without names: that of a .cla or its numbers, or of a folder.",
        ),
    ] = None,
    gallery: Annotated[
        Path | None, Option("--gallery", metavar="FILE|FOLDER", help="Labels of the columns.")
    ] = None,
    format: Annotated[Literal["text", "latex", "csv", "json"], Option("--format")] = "text",
    title: Annotated[
        str, Option("--title", metavar="NAME", help="Name of the row. [name of the file]")
    ] = "",
    results: Annotated[
        Path | None,
        Option("--results", metavar="DIR", help="Also keep it as an external row in this folder."),
    ] = None,
    dataset: Annotated[
        str, Option("--dataset", metavar="NAME", help="Data set of that row. [the labels']")
    ] = "",
    input: Annotated[
        Literal["mesh", "view"], Option("--input", help="Input of that row.")
    ] = "mesh",
) -> None:
    """Score the distances of any program.

    DISTANCES is a symmetric N x N matrix (any M x N with --gallery): .npy, .npz, .txt, .csv, .mat,
    or .matrix of PSB.
    """
    from benchmark.commands.external_rows import keep_distances, record_beside
    from benchmark.commands.score import score

    if gallery and results is not None:
        raise ConfigurationError(
            "a row that is kept has the queries as its gallery", "omit --gallery or --results"
        )
    title, name = title or distances.stem, dataset or labels.resolve().stem
    if results is not None:
        record_beside(
            results, name, input, title
        )  # or say before all work that there can be no row
    elif dataset:
        raise ConfigurationError(
            "--dataset names the data of a row that is kept", "pass --results, too"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # among the notes
        evaluation = score(distances, labels, order or "", gallery)
    record = (
        keep_distances(results, evaluation, title, name, input) if results is not None else None
    )
    for note in evaluation.notes:
        say(note, err=True)
    scores = evaluation.scores.rename_axis(title)
    if format == "csv":
        say_lines(scores.to_csv(float_format="%.6f"))
    elif format == "json":
        content = {
            "title": title,
            "n_shapes": len(evaluation.queries),
            **scores.round(6).astype(object).where(scores.notna(), None).T.to_dict(),
        }
        say_lines(json.dumps(content, indent=1))
    elif format == "latex":
        from benchmark.reference.paper import MEASURES
        from benchmark.report.formats import latex_row, latex_title
        from benchmark.report.frames import hundredths

        say_lines(f"% {' '.join(MEASURES)}")
        say_lines(latex_row(latex_title(title), *map(hundredths, scores.score[[*MEASURES]])))
    else:
        say_lines(scores.to_string(float_format="{:.2f}".format, na_rep="--"))
    if record:
        chosen = shlex.join(["-d", record.data.name, "--results", str(results)])
        say(f"kept as {record.method}: 'tables {chosen}' and 'report {chosen}' show it", err=True)


@verb("plugins")
def check(
    selection: Selection,
    target: Annotated[str, Argument(metavar="METHOD|FILE")],
    timeout: shared.Timeout = "10m",  # type: ignore[assignment]
    traceback: shared.Traceback = False,
) -> bool:
    """Test the contract of a plugin file, or of a method.

    Parameters follow in brackets: FILE[power=1]. The exit code is 1 if a check fails.
    """
    from benchmark.check import check
    from benchmark.registry import find

    faulthandler.enable(2)  # names the line of a crash
    outcomes = Counter[str]()
    for component in find(target, selection.plugins):
        for finding in check(component, timeout):
            say(f"{component.name}  {finding}", indent=len(component.name) + 28)
            outcomes[finding.outcome] += 1
            if traceback:
                say_lines(finding.traceback)
            elif finding.traceback:
                say("'check --traceback' prints the error in full", err=True)
    counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
    say(f"{'the contract is broken' if outcomes['failed'] else 'no fault was found'}: {counts}")
    return not outcomes["failed"]


@verb("plugins", "results", "data_root")
def train(
    selection: Selection,
    method: Annotated[str, Argument(metavar="METHOD")],
    target: Annotated[
        str, Option("-t", "--table", metavar="TABLE", help="Table of the model, or a training.")
    ] = "I",
    assigned: Annotated[
        list[str], Option("-o", "--option", metavar="NAME=VALUE", help="Option of the training.")
    ] = [],
    data: Annotated[
        Path | None, Option("--data", metavar="FOLDER", help="Train on your own data.")
    ] = None,
    hold_out: Annotated[
        str, Option("--hold-out", metavar="A,B", help="Subjects of it to leave out for tests.")
    ] = "",
) -> None:
    """Train the models of a learner.

    An interrupted training goes on, and finished models are skipped.
    """
    from benchmark.api.learning import Learner
    from benchmark.api.parameters import assignments
    from benchmark.protocols.pairs import training_data, trainings_of
    from benchmark.protocols.trainings import own_training
    from benchmark.registry import select_one

    spec = select_one(method, selection.plugins)
    learner = spec.create() if spec.learns else None
    if not isinstance(learner, Learner):
        raise ConfigurationError(
            f"method '{method}' is not a learner", "choose one, such as 'learned'"
        )
    settings = assignments(assigned)
    if data is not None:
        trainings = [own_training(data, tuple(filter(None, hold_out.split(","))))]
    else:
        trainings = trainings_of(learner, target, selection.require_data_root())
    for training in trainings:
        say(f"{spec.name}, {training.name}")
        folder = selection.results / "models" / training.name / learner.model_name
        learner.train(training_data(training, selection.data_root, say), folder, settings, say)
        say(f"the model is in {folder}")


@verb("results")
def merge(
    selection: Selection,
    folders: Annotated[list[Path], Argument(metavar="DIR...")],
    take: Annotated[
        Literal["ours", "theirs"] | None,
        Option("--take", help="Keep these results of rows that differ. [ours, exit code 1]"),
    ] = None,
    rows: Annotated[
        list[str],
        Option(
            "--record", metavar="ROW|KEY", help="Only this record, by its row or its key. [all]"
        ),
    ] = [],
) -> bool:
    """Join the records of several results folders.

    It replaces failures by results, and no result by another one unless --take says so. The exit
    code is 1 if two results of a row differ, or a record there cannot be taken.
    """
    from benchmark.cli.results import outcome
    from benchmark.pipeline.cache import writing
    from benchmark.pipeline.merging import merge

    if rows and not take:
        raise ConfigurationError(
            "--record names a conflict to resolve", "pass --take theirs or ours, too"
        )
    results = selection.results
    others = [folder for folder in folders if folder.resolve() != results.resolve()]
    with writing(results):
        merged = merge(others, results, take, rows)
    for existing, other in merged.conflicts:
        say(f"conflict: {existing.row}: {outcome(existing)} here, {outcome(other)} there")
        folder = other.merged_from.folder if other.merged_from else "DIR"
        words = ["merge", folder, "--take", "theirs", "--record", str(existing.row)]
        words += ["--results", str(results)] if results != Selection().results else []
        say(f"the one here stays; to take the other: python -m benchmark {shlex.join(words)}")
    for refused in merged.refused:
        say(f"not taken: {refused.record.row}: {refused.reason}")
    counts = [
        f"{len(merged.added)} added",
        f"{merged.known} known",
        f"{len(merged.conflicts)} in conflict",
    ]
    if n_lost := len(merged.refused) + merged.n_skipped:
        counts.append(f"{n_lost} not taken")
    say(f"records: {', '.join(counts)}")
    return not (merged.conflicts or n_lost)


@verb("methods", "datasets", "results")
def forget(
    selection: Selection,
    named: Annotated[
        list[str],
        Option(
            "--record", metavar="ROW|KEY", help="Record by its row, or by the name of its file."
        ),
    ] = [],
    unused: Annotated[
        bool, Option("--unused", help="Delete only files that no record names.")
    ] = False,
    yes: Annotated[bool, Option("--yes", help="Delete them, and do not only name them.")] = False,
) -> None:
    """Delete the results of methods or data sets, and files that no record names.

    A file that is not used as a record stays, with all files that it names, unless --record names
    it.
    """
    from benchmark.cli.results import outcome
    from benchmark.pipeline.cache import storing, writing
    from benchmark.pipeline.data_names import label_data_sets
    from benchmark.pipeline.records import Record, local_files, read_records, unneeded

    has_selection = bool(selection.methods or selection.datasets)
    if has_selection + bool(named) + unused != 1:
        raise ConfigurationError(
            "one selection is needed",
            "name methods with -m or data sets with -d, name records with --record, or pass --unused",
        )
    every = read_records(selection.results, published=False)
    known = {path.stem for path in local_files(selection.results)}
    known |= {str(record.row) for record in every}
    if unknown := {*named} - known:
        problem = f"there is no record '{min(unknown)}' under {selection.results}"
        hint = "name a row as 'plan' and 'merge' do, or a file of runs/records without '.json'"
        raise ConfigurationError(problem, hint)

    labelled = label_data_sets(every)
    of_data = {record.key for record in selection.records_of_data(labelled)}

    def is_unwanted(record: Record) -> bool:
        is_of_method = {record.method, record.method.partition("[")[0]} & {*selection.methods}
        is_selected = bool(is_of_method or not selection.is_narrow)
        return has_selection and record.key in of_data and is_selected

    with writing(selection.results):
        records, files = unneeded(selection.results, is_unwanted, named)
        if has_selection and not records:
            problem = f"no record under {selection.results} fits the selection"
            methods = sorted({record.method for record in every})
            raise ConfigurationError(problem, f"there are {', '.join(methods) or 'no records'}")
        for record in records:
            say(f"{record.row}  {outcome(record)}")
        n_records = sum(path.suffix == ".json" for path in files)
        n_forms = sum(path.parent.name == "forms" for path in files)
        size = sum(path.stat().st_size for path in files) / 1e6
        what = f"{n_records} records, {n_forms} forms, {size:.1f} MB"
        if not yes:
            raise ConfigurationError(f"this deletes {what}", "pass --yes")
        with storing(selection.results):
            for path in files:
                path.unlink(missing_ok=True)
        say(f"deleted {what}")


@verb("data_root", app=data)
def check_data(selection: Selection, name: shared.SetName) -> bool:
    """Check a data set.

    The exit code is 1 if it cannot be used.
    """
    from benchmark.cli.progress import counting
    from benchmark.datasets.checking import check_source

    root = selection.require_data_root()
    selection.say_folders(name)
    report = check_source(name, root, partial(counting, f"checking {name}"))
    for line in report.lines():
        say(line)
    return report.usable


@verb("data_root", app=data)
def export(
    selection: Selection,
    name: shared.SetName,
    output: Annotated[Path, Option("-o", "--output", metavar="DIR", help="New or empty folder.")],
) -> bool:
    """Write a data set as files.

    '-d DIR' reads them with the same shapes, classes and cameras. The exit code is 1 if a shape
    cannot be written.
    """
    from benchmark.cli.progress import counting
    from benchmark.datasets.export import export

    selection.say_folders(name)
    watched = partial(counting, f"writing {name}")
    written, problems = export(selection.open_dataset(name), output, watched=watched)
    for problem in problems:
        say(f"not written: {problem}", err=True)
    say(f"wrote {len(written)} files to {output}; use them with -d {output}")
    return not problems
