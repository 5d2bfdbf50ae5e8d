"""The verbs with their options.

What a verb needs is imported when it runs, so that ``--help`` is fast. A verb parses its words, and
leaves the rest to a function of this package that calls a command and prints what it returns.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Exit, Option

from benchmark.cli import options as shared
from benchmark.cli.options import (
    OF_CAMERA,
    OF_JOBS,
    OF_RECORDS,
    Selection,
    cli,
    data,
    models,
    verb,
)


@verb("everything", *OF_JOBS)
def run_verb(
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
    timeout: shared.TimeoutOption = "2h",  # type: ignore[assignment]  # typer parses it
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
    from benchmark.cli.run import run_selection

    rerun: list[str] = []
    if retry or force:
        rerun.append("failed")
    if force:
        rerun.append("finished")
    return run_selection(
        selection, size=jobs, dask=dask, timeout=timeout, rerun=rerun, forms=forms, train=train
    )


@verb("everything", *OF_JOBS)
def plan_verb(
    selection: Selection,
    traceback: shared.TracebackOption = False,
    every: Annotated[bool, Option("--jobs", help="List every job, even if many.")] = False,
) -> bool:
    """Show what would run, why, and how long it would take."""
    from benchmark.cli.run import print_plan

    return print_plan(selection, traceback=traceback, every=every)


@verb(*OF_RECORDS)
def tables_verb(
    selection: Selection,
    format: Annotated[
        Literal["latex", "markdown", "csv", "json"] | None,
        Option("--format", help="[markdown; with -o, all]"),
    ] = None,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="DIR", help="Write files.")
    ] = None,
    paper: Annotated[
        bool, Option("--paper", help="Also show rows of the paper that never ran.")
    ] = False,
    force: shared.ForceOption = False,
    failed: shared.FailedOption = False,
    submissions: Annotated[
        Path | None,
        Option("--submissions", metavar="DIR", help="Add rows of others, scored here."),
    ] = None,
) -> bool:
    """Print or write the tables of finished jobs.

    It needs no data. The exit code is 1 if a submission has no row.
    """
    from benchmark.cli.results import print_tables, write_tables

    if output is None:
        return print_tables(selection, format, paper=paper, failed=failed, submissions=submissions)
    return write_tables(
        selection,
        output,
        format,
        paper=paper,
        failed=failed,
        force=force,
        submissions=submissions,
    )


@verb(*OF_RECORDS, "data_root")
def report_verb(
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
    force: shared.ForceOption = False,
    failed: shared.FailedOption = False,
) -> None:
    """Write HTML pages, or draw a figure.

    Pages show tables, maps, and canonical forms in 3D.
    """
    from benchmark.cli.results import draw_figure, write_report_pages
    from benchmark.errors import ConfigurationError

    if shapes and figure != "forms":
        raise ConfigurationError(
            "--shape names shapes of a figure of forms", "pass --figure forms, too, or leave it out"
        )
    if figure is None:
        write_report_pages(selection, output or Path("results/report"), failed=failed, force=force)
    else:
        draw_figure(selection, output or Path(f"{figure}.pdf"), figure, shapes, force=force)


@verb("tables", "data", "input", "scorer", "results", "seed", "quick", "published")
def compare_verb(
    selection: Selection,
    first: Annotated[str, Argument(metavar="A", help="A method.")],
    second: Annotated[str, Argument(metavar="B", help="Another method. [all]")] = "",
    format: Annotated[Literal["text", "csv", "json"], Option("--format")] = "text",
) -> None:
    """Test how a method differs from another one, or from all.

    Without B, A is compared with every row of its tables.
    """
    from benchmark.cli.results import print_comparison

    print_comparison(selection, first, second, format)


@verb("plugins", "results", "data_root")
def list_verb(
    selection: Selection,
    what: Annotated[
        Literal["methods", "scorers", "datasets", "tables", "models"], Argument(metavar="WHAT")
    ],
    format: shared.FormatOption = "text",
) -> None:
    """List methods, scorers, datasets, tables or models."""
    from benchmark.cli.names import print_list

    print_list(what, selection, as_json=format == "json")


@verb("plugins")
def describe_verb(
    selection: Selection,
    name: Annotated[str, Argument(metavar="METHOD|SCORER")],
    format: shared.FormatOption = "text",
) -> None:
    """Describe a method or a scorer: parameters, source, inputs."""
    from benchmark.cli.names import print_description

    print_description(name, selection.plugins, as_json=format == "json")


@verb("plugins", "seed", *OF_CAMERA)
def canonicalise_verb(
    selection: Selection,
    method: shared.MethodOption,
    paths: Annotated[list[Path], Argument(metavar="IN")],
    output: Annotated[
        Path, Option("-o", "--output", metavar="OUT", help="Mesh file, or folder for several.")
    ],
) -> bool:
    """Write the canonical form of a mesh, or of depth images.

    A depth image is a 16-bit PNG, TIFF or PGM, NPY, NPZ or PFM; a folder stands for all of its
    images.
    """
    from benchmark.cli.forms import write_forms

    return write_forms(paths, method, selection, output)


@verb("methods", "plugins", "seed")
def demo_verb(
    selection: Selection,
    meshes: Annotated[
        list[Path] | None, Argument(metavar="MESH", help="[a generated cat in two poses]")
    ] = None,
    output: Annotated[Path, Option("-o", "--output", metavar="FILE", help="The page.")] = Path(
        "demo.html"
    ),
    is_closed: Annotated[bool, Option("--no-open", help="Open no browser.")] = False,
) -> bool:
    """Make and open a page on which shapes unfold into forms."""
    from benchmark.cli.demo import write_demo

    return write_demo(meshes or [], output, selection, is_opened=not is_closed)


@verb("scorer", "plugins", "results", "data_root", "seed", "gallery_views", *OF_CAMERA)
def retrieve_verb(
    selection: Selection,
    method: shared.MethodOption,
    dataset: Annotated[
        str, Option("-d", "--dataset", metavar="DATASET|FOLDER", help="Data set or folder.")
    ],
    query: Annotated[Path, Argument(metavar="QUERY", exists=True, dir_okay=False)],
    k: Annotated[int, Option("-k", min=1, metavar="N", help="Number of shapes to show.")] = 5,
    input: Annotated[
        Literal["mesh", "view"] | None,
        Option("--input", help="Input of the gallery. [that of the query]"),
    ] = None,
) -> None:
    """Show the shapes that are nearest to a mesh or a depth image."""
    from benchmark.cli.forms import print_matches

    print_matches(query, dataset, method, selection, k, input)


@cli.command("score", cls=shared.Verb)
def score_verb(
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
        Literal["mesh", "view"] | None, Option("--input", help="Input of that row. [mesh]")
    ] = None,
) -> None:
    """Score the distances of any program.

    DISTANCES is a symmetric N x N matrix (any M x N with --gallery): .npy, .npz, .txt, .csv, .mat,
    or .matrix of PSB.
    """
    from benchmark.cli.scores import print_kept_scores, print_scores_of_file

    title = title or distances.stem
    if results is None:
        print_scores_of_file(distances, labels, order or "", gallery, title, dataset, format, input)
    else:
        print_kept_scores(
            distances,
            labels,
            order or "",
            gallery,
            title,
            dataset,
            format,
            results,
            input or "mesh",
        )


@verb("plugins")
def check_verb(
    selection: Selection,
    target: Annotated[str, Argument(metavar="METHOD|FILE")],
    timeout: shared.TimeoutOption = "10m",  # type: ignore[assignment]
    traceback: shared.TracebackOption = False,
) -> bool:
    """Test the contract of a plugin file, or of a method.

    Parameters follow in brackets: FILE[power=1]. The exit code is 1 if a check fails.
    """
    from benchmark.cli.checks import print_check

    return print_check(target, selection.plugins, timeout, traceback=traceback)


@verb("plugins", "results", "data_root")
def train_verb(
    selection: Selection,
    method: Annotated[str, Argument(metavar="METHOD")],
    target: Annotated[
        str,
        Option("-t", "--table", metavar="TABLE", help="Table of the model, or a training. [I]"),
    ] = "",
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
def merge_verb(
    selection: Selection,
    folders: Annotated[list[Path], Argument(metavar="DIR")],
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
    from benchmark.cli.folders import print_merge

    return print_merge(folders, selection.results, take, rows)


@verb("methods", "data", "results")
def forget_verb(
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
    """Delete results, and files that no record names.

    The results are those of methods or data sets. A file that is not used as a record stays, with
    all files that it names, unless --record names it.
    """
    from benchmark.cli.folders import delete_results

    delete_results(selection, named, unused=unused, is_confirmed=yes)


@verb("data_root", app=data)
def check_data_verb(selection: Selection, name: shared.SetArgument) -> bool:
    """Check a data set.

    The exit code is 1 if it cannot be used.
    """
    from benchmark.cli.data import print_check_of_data

    return print_check_of_data(name, selection.data_root)


@verb("data_root", app=data)
def export_verb(
    selection: Selection,
    name: shared.SetArgument,
    output: Annotated[Path, Option("-o", "--output", metavar="DIR", help="New or empty folder.")],
    views: Annotated[
        bool, Option("--views", help="Also depth images, and a table of their cameras.")
    ] = False,
) -> bool:
    """Write a data set as files.

    '-d DIR' reads them with the same shapes, classes and cameras. The exit code is 1 if a shape
    cannot be written.
    """
    from benchmark.cli.data import write_data

    return write_data(name, selection.data_root, output, views=views)


@models.command(name="fetch", cls=shared.Verb)
def fetch_verb(
    source: Annotated[
        str,
        Option("--from", metavar="FOLDER|URL", help="learned/models of a checkout, or a copy."),
    ],
    names: Annotated[
        list[str] | None,
        Argument(metavar="TRAINING|TRAINING/MODEL", help="[all published models]"),
    ] = None,
) -> None:
    """Bring published models, which an installed suite lacks.

    Only files with the published SHA-256 are kept. The exit code is 1 if a model cannot be had.
    """
    from benchmark.cli.data import print_fetched_models

    if not print_fetched_models(source, names or []):
        raise Exit(1)
