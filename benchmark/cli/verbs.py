"""Signatures of all verbs; the module with the work of a verb is imported when it runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from benchmark.cli import options as shared
from benchmark.cli.options import Selection

RESULTS, SCORER = Path("results"), "cm-bof"


def _end(ok: bool) -> None:
    """Set exit code 1 unless all went well."""
    if not ok:
        raise typer.Exit(1)


def run(
    everything: shared.Everything = False,
    tables: shared.Tables = [],
    methods: shared.Methods = [],
    datasets: shared.Datasets = [],
    input: shared.Input = None,
    scorer: shared.Scorer = SCORER,
    plugins: shared.Plugins = [],
    results: shared.Results = RESULTS,
    data_root: shared.DataRoot = None,
    seed: shared.Seed = 0,
    quick: shared.Quick = False,
    subjects: Annotated[str, Option("--subjects", metavar="A,B", help="Only these, to choose parameters on.")] = "",
    jobs: Annotated[
        int | None, Option("-j", "--jobs", min=0, metavar="N", help="Processes; 0 runs in this one. [all cores]")
    ] = None,
    dask: Annotated[str, Option("--dask", metavar="URL", help="Scheduler of a dask cluster: tcp://HOST:8786.")] = "",
    timeout: shared.Timeout = "2h",  # type: ignore[assignment]  # typer parses it
    retry: Annotated[bool, Option("--retry", help="Run failed jobs again.")] = False,
    force: Annotated[bool, Option("--force", help="Run finished jobs again, too.")] = False,
    forms: Annotated[
        list[str], Option("--forms", metavar="NAME=DIR", help="Score DIR/SHAPE.off of another program instead.")
    ] = [],
) -> None:
    """Run the missing jobs of a selection, then print its tables."""
    from benchmark.cli.run import Again, run, score_forms

    selection = Selection.of(locals())
    if forms:
        score_forms(selection, forms)
        return
    again: Again = "all" if force else "failed" if retry else ""
    _end(run(selection, size=jobs, dask=dask, timeout=timeout, again=again))


def plan(
    everything: shared.Everything = False,
    tables: shared.Tables = [],
    methods: shared.Methods = [],
    datasets: shared.Datasets = [],
    input: shared.Input = None,
    scorer: shared.Scorer = SCORER,
    plugins: shared.Plugins = [],
    results: shared.Results = RESULTS,
    data_root: shared.DataRoot = None,
    seed: shared.Seed = 0,
    quick: shared.Quick = False,
    traceback: Annotated[bool, Option("--traceback", help="Print the error of each failed job in full.")] = False,
) -> None:
    """Show what would run, why, and how long it would take."""
    from benchmark.cli.run import plan

    selection = Selection.of(locals())
    plan(selection, traceback=traceback)


def tables(
    tables: shared.Tables = [],
    methods: shared.Methods = [],
    datasets: shared.Datasets = [],
    input: shared.Input = None,
    scorer: shared.Scorer = SCORER,
    results: shared.Results = RESULTS,
    seed: shared.Seed = 0,
    quick: shared.Quick = False,
    published: shared.Published = False,
    format: Annotated[
        Literal["latex", "markdown", "csv", "json"] | None, Option("--format", help="[markdown; with -o, all]")
    ] = None,
    output: Annotated[Path | None, Option("-o", "--output", metavar="DIR", help="Write files.")] = None,
    check: Annotated[bool, Option("--check", help="Compare with the files in -o DIR; exit 1 if they differ.")] = False,
    force: shared.Force = False,
) -> None:
    """Print or write the tables of finished jobs.

    It needs no data.
    """
    from benchmark.cli import tables as body

    selection = Selection.of(locals())
    _end(body.tables(selection, format, output, check=check, force=force))


def report(
    tables: shared.Tables = [],
    methods: shared.Methods = [],
    datasets: shared.Datasets = [],
    input: shared.Input = None,
    scorer: shared.Scorer = SCORER,
    results: shared.Results = RESULTS,
    data_root: shared.DataRoot = None,
    seed: shared.Seed = 0,
    quick: shared.Quick = False,
    published: shared.Published = False,
    output: Annotated[Path, Option("-o", "--output", metavar="DIR")] = Path("results/report"),
    figure: Annotated[Path | None, Option("--figure", metavar="FILE", help="Draw a .pdf, .png or .svg.")] = None,
    of: Annotated[
        Literal["effect", "scores", "cost", "precision-recall", "scorers"],
        Option("--of", help="Shapes and forms; scores with intervals; score against cost; precision over recall."),
    ] = "effect",
    shapes: Annotated[list[str], Option("--shape", metavar="NAME", help="Shape to show.")] = [],
    force: shared.Force = False,
) -> None:
    """Write HTML pages, or draw a figure.

    Pages show tables, charts, and canonical forms in 3D.
    """
    from benchmark.cli import report as body

    selection = Selection.of(locals())
    if figure is None:
        body.write_pages(selection, output, force=force)
    else:
        body.draw(selection, figure, of, tuple(shapes), force=force)


def compare(
    first: Annotated[str, Argument(metavar="A")],
    second: Annotated[str, Argument(metavar="B")],
    datasets: shared.Datasets = [],
    input: shared.Input = None,
    scorer: shared.Scorer = SCORER,
    results: shared.Results = RESULTS,
    quick: shared.Quick = False,
    published: shared.Published = False,
) -> None:
    """Compare two methods."""
    from benchmark.cli.tables import compare

    selection = Selection.of(locals())
    compare(selection, first, second)


def list_(
    what: Annotated[Literal["methods", "scorers", "datasets", "tables", "models"], Argument(metavar="WHAT")],
    as_json: shared.Json = False,
    plugins: shared.Plugins = [],
    results: shared.Results = RESULTS,
    data_root: shared.DataRoot = None,
) -> None:
    """List methods, scorers, datasets, tables or models."""
    from benchmark.cli.methods import list_

    list_(what, Selection.of(locals()), as_json=as_json)


def describe(method: shared.MethodName, as_json: shared.Json = False, plugins: shared.Plugins = []) -> None:
    """Describe a method: parameters, source, inputs."""
    from benchmark.cli.methods import describe

    describe(method, tuple(plugins), as_json=as_json)


def canonicalise(
    method: shared.Method,
    paths: Annotated[list[Path], Argument(metavar="IN...")],
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="OUT", help="Mesh file [IN-METHOD.off], or folder for several [forms]."),
    ] = None,
    plugins: shared.Plugins = [],
    seed: shared.Seed = 0,
    all_vertices: Annotated[bool, Option("--all-vertices", help="Keep the vertices of a large mesh.")] = False,
    intrinsics: shared.Intrinsics = "",
    mask: shared.Mask = None,
    depth_scale: shared.DepthScale = None,
    picture: shared.Picture = None,
) -> None:
    """Write the canonical form of a mesh, or of depth images.

    A depth image is a 16-bit PNG or TIFF, NPY, NPZ or PFM; a folder or pattern stands for all of its images.
    """
    from benchmark.cli import forms as body

    camera = body.Camera(intrinsics, mask, depth_scale)
    request = body.Request(method, tuple(plugins), seed, camera)
    _end(body.canonicalise(paths, request, output, picture, all_vertices=all_vertices))


def retrieve(
    method: shared.Method,
    dataset: shared.Dataset,
    query: Annotated[Path, Argument(metavar="QUERY")],
    k: Annotated[int, Option("-k", min=1, metavar="N", help="Number of shapes to show.")] = 5,
    scorer: shared.Scorer = SCORER,
    plugins: shared.Plugins = [],
    results: shared.Results = RESULTS,
    data_root: shared.DataRoot = None,
    seed: shared.Seed = 0,
    intrinsics: shared.Intrinsics = "",
    mask: shared.Mask = None,
    depth_scale: shared.DepthScale = None,
    picture: shared.Picture = None,
) -> None:
    """Show the shapes that are nearest to a mesh or a depth image."""
    from benchmark.cli import forms as body

    selection = Selection.of(locals())
    camera = body.Camera(intrinsics, mask, depth_scale)
    body.retrieve(query, dataset, body.Request(method, tuple(plugins), seed, camera), selection, k, picture)


def new(
    kind: Annotated[str, Argument(metavar="KIND")],
    name: Annotated[str, Argument(metavar="NAME")],
) -> None:
    """Write a plugin file that works, and its test.

    KIND is method; for other kinds copy a file of examples/.
    """
    from benchmark.cli.methods import new

    new(kind, name)


def check(
    target: Annotated[str, Argument(metavar="METHOD|FILE")],
    methods: Annotated[list[str], Option("-m", "--method", metavar="METHOD", help="Only this method of a file.")] = [],
    assigned: shared.Assigned = [],
    plugins: shared.Plugins = [],
    timeout: shared.Timeout = "60s",  # type: ignore[assignment]
    traceback: Annotated[bool, Option("--traceback", help="Print the error of each failed check in full.")] = False,
) -> None:
    """Test the contract of a plugin file, or of a method.

    Parameters follow in brackets: FILE[power=1]. The exit code is 1 if a check fails.
    """
    from benchmark.cli.train import check

    _end(check(target, methods, assigned, plugins, timeout, traceback=traceback))


def train(
    method: shared.MethodName,
    table: Annotated[str, Option("-t", "--table", metavar="TABLE", help="Table that the model is for.")] = "I",
    only: Annotated[str, Option("--only", metavar="TRAINING", help="Train only on this.")] = "",
    assigned: shared.Assigned = [],
    data: Annotated[Path | None, Option("--data", metavar="FOLDER", help="Train on your own data.")] = None,
    hold_out: Annotated[str, Option("--hold-out", metavar="A,B", help="Subjects of it to leave out for tests.")] = "",
    init: Annotated[Path | None, Option("--init", metavar="MODEL", help="Folder of a model to begin with.")] = None,
    plugins: shared.Plugins = [],
    results: shared.Results = RESULTS,
    data_root: shared.DataRoot = None,
) -> None:
    """Train the models of a learner.

    An interrupted training goes on, and finished models are skipped.
    """
    from benchmark.cli.train import train

    selection = Selection.of(locals())
    own = data, tuple(filter(None, hold_out.split(","))), init
    train(method, selection, table, only, own, assigned)


def check_data(name: shared.SetName, plugins: shared.Plugins = [], data_root: shared.DataRoot = None) -> None:
    """Check a data set.

    The exit code is 1 if it cannot be used.
    """
    from benchmark.cli.data import check

    _end(check(name, Selection.of(locals())))


def sheet(
    name: shared.SetName,
    output: Annotated[Path | None, Option("-o", "--output", metavar="FILE.png", help="[sheet-NAME.png]")] = None,
    subjects: Annotated[int | None, Option("--subjects", min=1, metavar="N", help="Rows. [all subjects]")] = None,
    poses: Annotated[int, Option("--poses", min=1, metavar="N", help="Columns.")] = 8,
    plugins: shared.Plugins = [],
    data_root: shared.DataRoot = None,
) -> None:
    """Draw a data set at a glance.

    It shows subjects in some poses, as surface and as depth image.
    """
    from benchmark.cli.data import sheet

    sheet(name, Selection.of(locals()), output, subjects, poses)


def export(
    name: shared.SetName,
    output: Annotated[Path, Option("-o", "--output", metavar="DIR", help="New or empty folder.")],
    force: shared.Force = False,
    plugins: shared.Plugins = [],
    data_root: shared.DataRoot = None,
) -> None:
    """Write a data set as files.

    '-d DIR' reads them with the same shapes, classes and cameras.
    """
    from benchmark.cli.data import export

    export(name, Selection.of(locals()), output, force=force)


def merge(
    folders: Annotated[list[Path], Argument(metavar="DIR...")],
    results: shared.Results = RESULTS,
    published: Annotated[
        bool, Option("--published", help="Merge into RESULTS/records, without quick runs and own data.")
    ] = False,
) -> None:
    """Join the records of several results folders.

    The exit code is 1 if they contradict each other.
    """
    from benchmark.cli.share import merge

    _end(merge(folders, results, published=published))


def forget(methods: shared.Methods = [], datasets: shared.Datasets = [], results: shared.Results = RESULTS) -> None:
    """Delete the results of methods or data sets."""
    from benchmark.cli.share import forget

    forget(Selection.of(locals()))


def score(
    distances: Annotated[Path, Argument(metavar="DISTANCES")],
    labels: Annotated[
        Path,
        Option("--labels", metavar="FILE|FOLDER", help=".cla, lines 'label' or 'name label', or a folder."),
    ],
    format: Annotated[Literal["text", "latex", "csv", "json"], Option("--format")] = "text",
    title: Annotated[str, Option("--title", metavar="NAME", help="Name of the row. [name of the file]")] = "",
    results: Annotated[
        Path | None, Option("--results", metavar="DIR", help="Also keep it as an external row in this folder.")
    ] = None,
    dataset: Annotated[str, Option("--dataset", metavar="NAME", help="Data set of that row. [the labels']")] = "",
    input: Annotated[Literal["mesh", "view"], Option("--input", help="Input of that row.")] = "mesh",
) -> None:
    """Score the distances of any program.

    DISTANCES is a symmetric N x N matrix: .npy, .npz, .txt, .csv or .mat.
    """
    from benchmark.cli.score import score

    score(distances, labels, format, title or distances.stem, results, dataset or labels.resolve().stem, input)


#: Verbs in the order of ``--help``, and those of ``data``.
VERBS: tuple[Callable[..., None], ...] = (
    run, plan, tables, report, compare, list_, describe, canonicalise, retrieve, score, check, new, train, merge,
    forget,
)  # fmt: skip
OF_DATA: tuple[Callable[..., None], ...] = (check_data, sheet, export)
