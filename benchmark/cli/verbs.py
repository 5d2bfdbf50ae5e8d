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

from typer import Argument, Exit, Option

from benchmark.cli import options as shared
from benchmark.cli.options import Selection, cli, data, models, verb
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
) -> bool:
    """Show what would run, why, and how long it would take."""
    from benchmark.cli.run import plan

    return plan(selection, traceback=traceback, every=every)


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
    from benchmark.cli.printing import print_markdown
    from benchmark.commands.tables import tables
    from benchmark.report.output import FORMATS

    shown = tables(**selection.of_tables(), paper=paper, failed=failed)
    for note in shown.notes:
        say(note, err=True)
    if output is not None:
        files = shown.write(output, [format] if format else FORMATS, force=force)
        say(f"wrote {len(files)} files to {output}")
    elif format == "latex":
        say_lines(shown.latex())
    elif format:
        say_lines("\n".join(shown.texts(format)))
    else:
        print_markdown(shown.markdown())


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
    from benchmark.cli.results import draw
    from benchmark.commands.tables import tables
    from benchmark.report.output import write_files
    from benchmark.report.pages import report_files

    if figure:
        draw(selection, output or Path(f"{figure}.pdf"), figure, shapes, force=force)
        return
    shown = tables(**selection.of_tables(), paper=selection.published, failed=failed)
    for note in shown.notes:
        say(note, err=True)
    folder = output or Path("results/report")
    files = report_files(selection.results, shown.views, selection.data_root)
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
    from benchmark.commands.compare import compare
    from benchmark.report.comparison import details, summaries

    found = compare(first, second, tables=selection.tables, **selection.of_records())
    for note in found.attrs["notes"]:
        say(note, err=True)
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


@verb("methods", "plugins", "seed")
def demo(
    selection: Selection,
    meshes: Annotated[
        list[Path] | None, Argument(metavar="[MESH]...", help="[a generated cat in two poses]")
    ] = None,
    output: Annotated[Path, Option("-o", "--output", metavar="FILE", help="The page.")] = Path(
        "demo.html"
    ),
    is_closed: Annotated[bool, Option("--no-open", help="Open no browser.")] = False,
) -> bool:
    """Make a page on which shapes unfold into their canonical forms, and open it."""
    from benchmark.cli.demo import demo

    return demo(meshes or [], output, selection, is_opened=not is_closed)


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
    if gallery and results is not None:
        raise ConfigurationError(
            "a row that is kept has the queries as its gallery", "omit --gallery or --results"
        )
    if dataset and results is None:
        raise ConfigurationError(
            "--dataset names the data of a row that is kept", "pass --results, too"
        )
    title = title or distances.stem
    record = None
    if results is not None:
        from benchmark.commands.external_rows import score_and_keep  # whose rows need the runner

        evaluation, record = score_and_keep(
            distances,
            labels,
            order or "",
            results=results,
            title=title,
            dataset=dataset,
            input=input,
        )
    else:
        from benchmark.commands.score import score

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # among the notes
            evaluation = score(distances, labels, order or "", gallery)
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
        from benchmark.report.formats import latex_of_scores

        say_lines("\n".join(latex_of_scores(title, scores["score"])))
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
    from benchmark.api.parameters import assignments
    from benchmark.commands.train import train

    train(
        method,
        target,
        options=assignments(assigned),
        data=data,
        hold_out=hold_out.split(","),
        plugins=selection.plugins,
        results=selection.results,
        data_root=selection.data_root,
    )


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
    from benchmark.commands.merge import merge
    from benchmark.commands.selection import outcome

    results = selection.results
    merged = merge(folders, results, take=take, records=rows)
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
    from benchmark.commands.forget import forget
    from benchmark.commands.selection import outcome

    forgotten = forget(
        selection.methods,
        selection.datasets,
        records=named,
        unused=unused,
        results=selection.results,
        yes=yes,
    )
    for record in forgotten.records:
        say(f"{record.row}  {outcome(record)}")
    if not yes:
        raise ConfigurationError(f"this deletes {forgotten}", "pass --yes")
    say(f"deleted {forgotten}")


@verb("data_root", app=data)
def check_data(selection: Selection, name: shared.SetName) -> bool:
    """Check a data set.

    The exit code is 1 if it cannot be used.
    """
    from benchmark.cli.progress import counting
    from benchmark.commands.selection import data_folder, shadowed_folders
    from benchmark.datasets.checking import check_source

    root = data_folder(selection.data_root)
    for note in shadowed_folders([name], root):
        say(note, err=True)
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
    from benchmark.commands.export import export
    from benchmark.commands.selection import data_folder, shadowed_folders

    root = data_folder(selection.data_root)
    for note in shadowed_folders([name], root):
        say(note, err=True)
    watched = partial(counting, f"writing {name}")
    written, problems = export(name, output, data_root=root, watched=watched)
    for problem in problems:
        say(f"not written: {problem}", err=True)
    say(f"wrote {len(written)} files to {output}; use them with -d {output}")
    return not problems


@models.command(name="fetch", cls=shared.Verb)
def fetch_models(
    source: Annotated[
        str,
        Option("--from", metavar="FOLDER|URL", help="learned/models of a checkout, or a copy."),
    ],
    names: Annotated[
        list[str] | None,
        Argument(metavar="[TRAINING|TRAINING/MODEL]...", help="[all published models]"),
    ] = None,
) -> None:
    """Bring published models, which an installed suite lacks.

    Only files with the published SHA-256 are kept. The exit code is 1 if a model cannot be had.
    """
    from benchmark.cli.progress import counting
    from benchmark.commands.models import fetch_models, in_words

    watched = partial(counting, f"fetching models from {source}")
    fetched = fetch_models(source, names or [], watched=watched)
    for model, problem in fetched.problems.items():
        say(f"{model}: {problem}", err=True)
    say(in_words(fetched))
    if fetched.problems:
        raise Exit(1)
