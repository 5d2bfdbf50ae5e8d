"""Signatures of all verbs; the module with the work of a verb is imported when it runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from benchmark.cli import options as shared
from benchmark.cli.options import Selection, verb

_JOBS = (
    "everything", "tables", "methods", "datasets", "input", "scorer", "plugins", "results", "data_root", "seed",
    "quick", "subjects",
)  # fmt: skip
_RECORDS = ("tables", "methods", "datasets", "input", "scorer", "results", "seed", "quick", "published")
_DATA = ("plugins", "data_root")


def _end(ok: bool) -> None:
    """Set exit code 1 unless all went well."""
    if not ok:
        raise typer.Exit(1)


@verb(*_JOBS)
def run(
    selection: Selection,
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
    from benchmark.cli.run import run, score_forms

    if forms:
        score_forms(selection, forms)
    else:
        again = ["failed", "finished"] if force else ["failed"] if retry else []
        _end(run(selection, size=jobs, dask=dask, timeout=timeout, again=again))


@verb(*_JOBS)
def plan(selection: Selection, traceback: shared.Traceback = False) -> None:
    """Show what would run, why, and how long it would take."""
    from benchmark.cli.run import plan

    plan(selection, traceback=traceback)


@verb(*_RECORDS)
def tables(
    selection: Selection,
    format: Annotated[
        Literal["latex", "markdown", "csv", "json"] | None, Option("--format", help="[markdown; with -o, all]")
    ] = None,
    output: Annotated[Path | None, Option("-o", "--output", metavar="DIR", help="Write files.")] = None,
    force: shared.Force = False,
) -> None:
    """Print or write the tables of finished jobs.

    It needs no data.
    """
    from benchmark.cli.tables import tables

    tables(selection, format, output, force=force)


@verb(*_RECORDS, "data_root")
def report(
    selection: Selection,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="OUT", help="Folder [results/report], or figure [KIND.pdf].")
    ] = None,
    figure: Annotated[
        Literal["effect", "scores", "cost", "precision-recall", "scorers"] | None,
        Option("--figure", help="Draw a .pdf, .png or .svg instead; effect shows shapes and forms."),
    ] = None,
    shapes: Annotated[list[str], Option("--shape", metavar="NAME", help="Shape to show.")] = [],
    force: shared.Force = False,
) -> None:
    """Write HTML pages, or draw a figure.

    Pages show tables, charts, and canonical forms in 3D.
    """
    from benchmark.cli.report import draw, write_pages

    if figure is None:
        write_pages(selection, output or Path("results/report"), force=force)
    else:
        draw(selection, output or Path(f"{figure}.pdf"), figure, shapes, force=force)


@verb("datasets", "input", "scorer", "results", "quick", "published")
def compare(
    selection: Selection,
    first: Annotated[str, Argument(metavar="A")],
    second: Annotated[str, Argument(metavar="B")],
) -> None:
    """Compare two methods."""
    from benchmark.cli.tables import compare

    compare(selection, first, second)


@verb("plugins", "results", "data_root")
def list_(
    selection: Selection,
    what: Annotated[Literal["methods", "scorers", "datasets", "tables", "models"], Argument(metavar="WHAT")],
    format: shared.Format = "text",
) -> None:
    """List methods, scorers, datasets, tables or models."""
    from benchmark.cli.methods import list_

    list_(what, selection, as_json=format == "json")


@verb("plugins")
def describe(selection: Selection, method: shared.MethodName, format: shared.Format = "text") -> None:
    """Describe a method: parameters, source, inputs."""
    from benchmark.cli.methods import describe

    describe(method, selection.plugins, as_json=format == "json")


@verb("plugins", "seed")
def canonicalise(
    selection: Selection,
    method: shared.Method,
    paths: Annotated[list[Path], Argument(metavar="IN...")],
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="OUT", help="Mesh file [IN-METHOD.off], or folder for several [forms]."),
    ] = None,
    all_vertices: Annotated[bool, Option("--all-vertices", help="Keep the vertices of a large mesh.")] = False,
    intrinsics: shared.Intrinsics = "",
    mask: shared.Mask = None,
    depth_scale: shared.DepthScale = None,
    picture: shared.Picture = None,
) -> None:
    """Write the canonical form of a mesh, or of depth images.

    A depth image is a 16-bit PNG or TIFF, NPY, NPZ or PFM; a folder or pattern stands for all of its images.
    """
    from benchmark.cli.forms import Camera, Request, canonicalise

    request = Request(method, selection, Camera(intrinsics, mask, depth_scale))
    _end(canonicalise(paths, request, output, picture, all_vertices=all_vertices))


@verb("scorer", "plugins", "results", "data_root", "seed")
def retrieve(
    selection: Selection,
    method: shared.Method,
    dataset: Annotated[str, Option("-d", "--dataset", metavar="DATASET|FOLDER", help="Data set or folder.")],
    query: Annotated[Path, Argument(metavar="QUERY")],
    k: Annotated[int, Option("-k", min=1, metavar="N", help="Number of shapes to show.")] = 5,
    intrinsics: shared.Intrinsics = "",
    mask: shared.Mask = None,
    depth_scale: shared.DepthScale = None,
    picture: shared.Picture = None,
) -> None:
    """Show the shapes that are nearest to a mesh or a depth image."""
    from benchmark.cli.forms import Camera, Request, retrieve

    retrieve(query, dataset, Request(method, selection, Camera(intrinsics, mask, depth_scale)), k, picture)


def new(
    kind: Annotated[str, Argument(metavar="KIND")],
    name: Annotated[str, Argument(metavar="NAME")],
) -> None:
    """Write a plugin file that works, and its test.

    KIND is method; for other kinds copy a file of examples/.
    """
    from benchmark.cli.methods import new

    new(kind, name)


@verb("plugins")
def check(
    selection: Selection,
    target: Annotated[str, Argument(metavar="METHOD|FILE")],
    methods: Annotated[list[str], Option("-m", "--method", metavar="METHOD", help="Only this method of a file.")] = [],
    assigned: shared.Assigned = [],
    timeout: shared.Timeout = "60s",  # type: ignore[assignment]
    traceback: shared.Traceback = False,
) -> None:
    """Test the contract of a plugin file, or of a method.

    Parameters follow in brackets: FILE[power=1]. The exit code is 1 if a check fails.
    """
    from benchmark.cli.train import check

    _end(check(target, methods, assigned, selection.plugins, timeout, traceback=traceback))


@verb("plugins", "results", "data_root")
def train(
    selection: Selection,
    method: shared.MethodName,
    target: Annotated[str, Option("-t", "--table", metavar="TABLE", help="Table of the model, or a training.")] = "I",
    assigned: shared.Assigned = [],
    data: Annotated[Path | None, Option("--data", metavar="FOLDER", help="Train on your own data.")] = None,
    hold_out: Annotated[str, Option("--hold-out", metavar="A,B", help="Subjects of it to leave out for tests.")] = "",
    init: Annotated[Path | None, Option("--init", metavar="MODEL", help="Folder of a model to begin with.")] = None,
) -> None:
    """Train the models of a learner.

    An interrupted training goes on, and finished models are skipped.
    """
    from benchmark.cli.train import train

    train(method, selection, target, [*assigned, *([f"init={init}"] if init else [])], data, hold_out)


@verb(*_DATA)
def check_data(selection: Selection, name: shared.SetName) -> None:
    """Check a data set.

    The exit code is 1 if it cannot be used.
    """
    from benchmark.cli.data import check

    _end(check(name, selection))


@verb(*_DATA)
def sheet(
    selection: Selection,
    name: shared.SetName,
    output: Annotated[Path | None, Option("-o", "--output", metavar="FILE.png", help="[sheet-NAME.png]")] = None,
) -> None:
    """Draw a data set at a glance.

    It shows subjects in some poses, as surface and as depth image.
    """
    from benchmark.cli.data import sheet

    sheet(name, selection, output)


@verb(*_DATA)
def export(
    selection: Selection,
    name: shared.SetName,
    output: Annotated[Path, Option("-o", "--output", metavar="DIR", help="New or empty folder.")],
    force: shared.Force = False,
) -> None:
    """Write a data set as files.

    '-d DIR' reads them with the same shapes, classes and cameras. The exit code is 1 if a shape cannot be written.
    """
    from benchmark.cli.data import export

    _end(export(name, selection, output, force=force))


@verb("results")
def merge(
    selection: Selection,
    folders: Annotated[list[Path], Argument(metavar="DIR...")],
    published: Annotated[
        bool, Option("--published", help="Merge into RESULTS/records, without quick runs and own data.")
    ] = False,
) -> None:
    """Join the records of several results folders.

    The exit code is 1 if they contradict each other.
    """
    from benchmark.cli.share import merge

    _end(merge(folders, selection.results, published=published))


@verb("methods", "datasets", "results")
def forget(selection: Selection) -> None:
    """Delete the results of methods or data sets."""
    from benchmark.cli.share import forget

    forget(selection)


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
