"""Options of all commands, as dataclasses from which the click commands are built.

The module of a command is imported when it runs. Every ``--help`` imports this module, so it imports nothing heavy.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import click

from benchmark.cli.declare import (
    EVERY,
    FINISHED,
    NAME_OR_FOLDER,
    PATH,
    argument,
    complete_datasets,
    complete_methods,
    complete_methods_and_files,
    complete_scorers,
    complete_tables,
    flag,
    option,
    timeout_option,
    vertex_count,
)
from benchmark.errors import ConfigurationError
from benchmark.text import DATA_VARIABLE, say

if TYPE_CHECKING:
    from benchmark.execution.sharding import Shard
    from benchmark.pipeline.storage.store import Store

OK, NOT_OK, USAGE, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143

_COUNT = click.IntRange(min=1)
_INPUTS = click.Choice(["view", "mesh"])


def _shard(text: str) -> Shard:
    from benchmark.execution.sharding import Shard

    return Shard.parse(text)


def _require_folder(_: click.Context, __: click.Parameter, root: Path | None) -> Path | None:
    """Return the folder of the official data sets; raise ``ConfigurationError`` if it is missing or the wrong level.

    A folder without sets is valid: a run announces its stand-ins.
    """
    if root is None:
        return None
    if not root.is_dir():
        raise ConfigurationError(
            f"data root {root} is not a readable folder", f"correct --data-root or {DATA_VARIABLE}"
        )
    from benchmark.datasets.catalogue import has_official_sets

    if has_official_sets(root):
        return root
    absolute = root.absolute()
    near = [*absolute.parents[:2], *sorted(path for path in absolute.iterdir() if path.is_dir())]
    if right := next(filter(has_official_sets, near), None):
        raise ConfigurationError(f"data root {root} holds no official data set", f"pass --data-root {right}")
    return root


def _inspected(_: click.Context, __: click.Parameter, plugins: tuple[Path, ...]) -> tuple[Path, ...]:
    """Return the plugin files after inspecting them in a child process."""
    if plugins:
        from benchmark.plugins.inspection import inspect

        inspect(plugins)
    return plugins


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options shared by commands; a subclass selects some of them and declares its own."""

    # fmt: off
    tables: tuple[str, ...] = option("-t", "--table", multiple=True, metavar="TABLE", help="Table; see 'list tables'.",
                                     shell_complete=complete_tables)
    methods: tuple[str, ...] = option("-m", "--method", multiple=True, metavar="METHOD",
                                      shell_complete=complete_methods,
                                      help="Method, all, or finished; see 'list methods'.")
    datasets: tuple[str, ...] = option("-d", "--dataset", multiple=True, type=NAME_OR_FOLDER, metavar="DATASET|FOLDER",
                                       shell_complete=complete_datasets,
                                       help="Set, folder, or humans[subjects=N,poses=M].")
    inputs: tuple[str, ...] = option("--input", multiple=True, type=_INPUTS,
                                     help="Default: both.")
    scorer: str = option("--scorer", metavar="SCORER", default="cm-bof", shell_complete=complete_scorers,
                         help="What compares the forms; see 'list scorers'.")
    plugins: tuple[Path, ...] = option("--plugin", multiple=True, type=PATH, callback=_inspected, metavar="FILE",
                                       help="Python file with methods, scorers or data sets.")
    results: Path = option("--results", type=PATH, default=Path("results"), metavar="DIR")
    data_root: Path | None = option("--data-root", type=PATH, envvar=DATA_VARIABLE, callback=_require_folder,
                                    metavar="DIR", help=f"Folder of the official data sets; also {DATA_VARIABLE}.")
    seed: int = option("--seed", type=int, default=0, help="Base seed of all methods.")
    quick: bool = flag("--quick", help="Fewer poses per subject, and only the paper's methods.")
    everything: bool = flag("--all", help="All tables but camera and robustness (default of 'plan').")
    paper: bool = flag("--paper", help="Only the rows of the paper.")
    repeat: int | None = option("--repeat", type=click.IntRange(min=2), metavar="N",
                                help="Repeat each gallery N times with jittered vertices, and print the spread.")
    shard: Shard | None = option("--shard", type=_shard, metavar="I/N",
                                 help="Run part I of N of the jobs; 'merge' joins the parts.")
    workers: int | None = option("-j", "--jobs", type=_COUNT, metavar="N",
                                 help="Number of parallel jobs. [all cores]")
    executor: str = option("--executor", type=click.Choice(["serial", "processes", "dask"]), default="processes")
    scheduler: str = option("--scheduler", default="", metavar="URL",
                            help="Scheduler of a dask cluster, such as tcp://HOST:8786.")
    timeout: float | None = None
    retry: tuple[str, ...] = option(
        "--retry", multiple=True, help="Run failed jobs of this kind again.",
        type=click.Choice(["failed", "timeout", "crashed", "killed", "memory", "unsupported", "all"]))
    force: bool = flag("--force", help="Replace files in -o DIR that this verb did not write.")
    published: bool = flag("--published", help="Use only published records.")
    # fmt: on

    @property
    def is_narrow(self) -> bool:
        """Return whether methods are selected, so that a table omits others that were never run."""
        return bool(self.methods) and EVERY not in self.methods

    @property
    def is_by_name(self) -> bool:
        """Return whether all methods are selected by name."""
        return self.is_narrow and FINISHED not in self.methods


#: Fields that select finished jobs, a plan, and a run.
_SELECTION = (
    "tables", "methods", "datasets", "scorer", "inputs", "plugins", "results", "data_root", "seed", "quick",
)  # fmt: skip
_PLAN = ("everything", *_SELECTION, "paper", "repeat", "shard")


#: Commands by section of ``--help``, in the order of this module, and those of the group ``data``.
SECTIONS: dict[str, list[click.Command]] = {}
_OF_DATA: dict[str, click.Command] = {}

_Verb = TypeVar("_Verb", bound=RunOptions)


def verb(section: str, place: str, *shared: Any) -> Callable[[type[_Verb]], type[_Verb]]:
    """Build a command from a dataclass of options.

    Parameters
    ----------
    section
        Section of ``--help``, or ``"data"`` for a command of that group.
    place
        Module and function that runs the command; it gets the options, and the exit code is 1 if it returns False.
    shared
        Shared fields of the command in the order of ``--help``; ``...`` stands for its own fields, which come last by
        default.
    """
    module, function = place.split(".")

    def declare(options: type[_Verb]) -> type[_Verb]:
        complete = dataclass(frozen=True, kw_only=True)(options)
        at = shared.index(...) if ... in shared else len(shared)
        own = [name for name in options.__annotations__ if name not in shared]
        names = (*shared[:at], *own, *shared[at + 1 :])
        declared = {name: complete.__dataclass_fields__[name].metadata["parameter"] for name in names}

        def call(**values: Any) -> None:
            body = getattr(import_module(f"benchmark.cli.{module}"), function)
            if body(complete(**values)) is False:
                sys.exit(NOT_OK)

        name = function.removesuffix("_")
        parameters = [make(name) for name, make in declared.items()]
        command = click.Command(name, callback=call, help=inspect.getdoc(options), params=parameters)
        if section == "data":
            _OF_DATA[name] = command
        else:
            SECTIONS.setdefault(section, []).append(command)
        return complete

    return declare


_method_argument = partial(argument, "METHOD", shell_complete=complete_methods)
_json = partial(flag, "--json", help="Print JSON.")
_assigned = partial(option, "-o", "--option", multiple=True, metavar="NAME=VALUE")
_picture = partial(option, "--picture", type=PATH, metavar="OUT.png")


@dataclass(frozen=True, kw_only=True)
class _FrameOptions(RunOptions):
    """Options of depth images."""

    method: str = option("-m", "--method", required=True, metavar="METHOD", help="Method; see 'list methods'.",
                         shell_complete=complete_methods)  # fmt: skip
    intrinsics: str = option(
        "--intrinsics", default="", metavar="FILE|fx,fy,cx,cy", help="Camera of a depth image. [file next to it]"
    )
    mask: Path | None = option(
        "--mask", type=PATH, metavar="FILE", help="Object in a depth image. [found automatically]"
    )
    depth_scale: float | None = option(
        "--depth-scale", type=float, metavar="N", help="Depth units per metre. [1000 for integers, 1 for floats]"
    )


_FRAME = ("intrinsics", "mask", "depth_scale")

# Daily use -----------------------------------------------------------------------------------------------------------


@verb("Daily use", "run.run", *_PLAN, "workers", "executor", "scheduler", "timeout", "retry")
class Run(RunOptions):
    """Run the missing jobs of a selection, then print its tables."""

    timeout: float | None = timeout_option("one job", "2h")
    forms: tuple[str, ...] = option(
        "--forms", multiple=True, metavar="NAME=DIR",
        help="Instead of methods: score DIR/SHAPE.off, ..., made by another program.",
    )  # fmt: skip
    frame: Path | None = option(
        "--frame", type=PATH, hidden=True, help="Write the records as JSON, and print no tables."
    )


@verb("Daily use", "plan.plan", *_PLAN)
class Plan(RunOptions):
    """Show what would run, why, and how long it would take."""

    all_jobs: bool = flag("--all-jobs", help="A line for each job, however many there are.")


@verb("Daily use", "show.tables", *_SELECTION, ..., "force", "published", "fresh")
class Tables(RunOptions):
    """Print tables of finished jobs, or write them to files; needs no data."""

    formats: tuple[str, ...] = option(
        "--format", multiple=True, type=click.Choice(["latex", "markdown", "csv", "json"]),
        help="[markdown; with -o, all]",
    )  # fmt: skip
    output: Path | None = option("-o", "--output", type=PATH, metavar="DIR", help="Write files instead of printing.")
    check: bool = flag("--check", help="Compare with the files in -o DIR; exit 1 if they differ.")
    notes: Literal["table", "appendix", "none"] = option(
        "--notes", type=click.Choice(["table", "appendix", "none"]), default="table",
        help="LaTeX notes: below each table, in files notes-TABLE.tex, or none.",
    )  # fmt: skip
    rows_only: bool = flag("--rows-only", help="LaTeX: the rows of each table, without float, heading and notes.")
    bibliography: bool = flag("--bibliography", help="Print BibTeX entries after LaTeX; with -o, they are a file.")
    everything: bool = flag("--all", help="Print whole tables for many methods, too.")
    fresh: bool = flag("--fresh", help="Omit rows made by other code or versions.")


@verb("Daily use", "report.report", *_SELECTION, "output", "force", "published")
class Report(RunOptions):
    """Write HTML pages: tables, charts, canonical forms in 3D, and every query with its nearest shapes.

    They work without a network. Nothing is computed; where data is missing, a page names the run that creates it.
    """

    output: Path = option("-o", "--output", type=PATH, default=Path("results/report"), metavar="DIR")
    figure: Path | None = option(
        "--figure", type=PATH, metavar="FILE", help="Draw a figure (.pdf, .png or .svg) instead; see --of."
    )
    what: str = option(
        "--of", type=click.Choice(["forms", "effect", "cost", "precision-recall", "confusion", "classes"]),
        default="forms",
        help="One subject by all methods; subjects before and after one method; accuracy against cost; precision over"
        " recall; nearest matches by class; scores by class.",
    )  # fmt: skip
    subjects: tuple[str, ...] = option("--subject", multiple=True, metavar="NAME", help="Subject to show in a figure.")
    shapes: tuple[str, ...] = option("--shape", multiple=True, metavar="NAME", help="Shape to show in a figure.")
    timeout: float | None = timeout_option("missing forms of a method")


@verb("Daily use", "methods.list_", ..., "plugins", "results", "data_root")
class List(RunOptions):
    """List methods, scorers, data sets, tables or models."""

    what: str = argument(type=click.Choice(["methods", "scorers", "datasets", "tables", "models"]))
    as_json: bool = _json()


@verb("Daily use", "methods.describe", ..., "plugins")
class Describe(RunOptions):
    """Describe a method: parameters, source, inputs."""

    method: str = _method_argument()
    as_json: bool = _json()


@verb("Daily use", "forms.canonicalise", "method", "paths", "output", "plugins", "timeout", "seed", "vertices", *_FRAME)
class Canonicalise(_FrameOptions):
    """Write the canonical form of a mesh, or of depth images.

    A depth image is a 16-bit PNG or TIFF, NPY, NPZ or PFM; a folder or pattern stands for all of its images.
    """

    paths: tuple[Path, ...] = argument("IN...", type=PATH, nargs=-1, required=True)
    output: Path | None = option(
        "-o", "--output", type=PATH, metavar="OUT",
        help="Mesh file [IN-METHOD.off in the current folder], or folder for several images [forms].",
    )  # fmt: skip
    timeout: float | None = timeout_option("the form")
    vertices: int | str | None = option(
        "--vertices", type=vertex_count, metavar="N|all", help="Number of vertices, or all of the file. [2000]"
    )
    picture: Path | None = _picture(help="Draw depth and form; for several images, a folder.")


@verb(
    "Daily use", "forms.retrieve", "method", "gallery", "query", "k", "picture", *_FRAME, "scorer", "plugins",
    "results", "data_root", "timeout", "seed",
)  # fmt: skip
class Retrieve(_FrameOptions):
    """Show the shapes of a gallery that are nearest to a depth image or a mesh."""

    gallery: str = option(
        "-d", "--dataset", required=True, type=NAME_OR_FOLDER, metavar="DATASET|FOLDER",
        shell_complete=complete_datasets, help="Data set or folder that was run.",
    )  # fmt: skip
    query: Path = argument("QUERY", type=PATH)
    k: int = option("-k", type=_COUNT, default=5, help="Number of shapes to show.")
    picture: Path | None = _picture(help="Draw the forms that were found.")
    timeout: float | None = timeout_option("the search")


# Own methods and data ------------------------------------------------------------------------------------------------

_NEW = {
    "method": "a method that makes canonical forms",
    "external": "a method that calls a program with mesh files",
    "descriptor": "a descriptor that compares shapes without a form",
    "learner": "a method that is trained",
    "scorer": "a scorer that compares forms",
    "dataset": "a data set",
}


def _new(kind: str) -> click.Command:
    def call(name: str) -> None:
        import_module("benchmark.cli.methods").new(kind, name)

    text = f"Write a working plugin file with {_NEW[kind]} called NAME, and its test, into this folder."
    return click.Command(kind, params=[click.Argument(["name"])], callback=call, help=text)


SECTIONS["Own methods and data"] = [
    click.Group("new", help="Write a plugin to start from, with a test.", commands=list(map(_new, _NEW)))
]


@verb("Own methods and data", "train.check", "target", "chosen", "assigned", "plugins")
class Check(RunOptions):
    """Test the contract of a method, or of everything in a plugin file; exit 1 if it fails.

    Append parameters to either: FILE[power=1].
    """

    target: str = argument("METHOD|FILE", shell_complete=complete_methods_and_files)
    chosen: tuple[str, ...] = option(
        "-m", "--method", multiple=True, metavar="METHOD", help="Check only this method of a file."
    )
    assigned: tuple[str, ...] = _assigned(help="Option for training a learner.")
    timeout: float | None = timeout_option("one check")


@verb("Own methods and data", "train.train", ..., "plugins", "results", "data_root")
class Train(RunOptions):
    """Train the models of a learner; resume an interrupted training, and skip finished models."""

    method: str = _method_argument()
    table: str = option("-t", "--table", default="I", metavar="TABLE", help="Table that the model is for.")
    only: str | None = option("--only", metavar="TRAINING", help="Train only on this, e.g. humans-strict-0-1.")
    configuration: str | None = option("--config", metavar="NAME", help="Configuration of the method.")
    training_seed: int | None = option("--seed", type=int, help="Seed of the training.")
    resolution: int | None = option("--resolution", type=_COUNT, metavar="N", help="Pixels per side.")
    epochs: int | None = option("--epochs", type=_COUNT, metavar="N", help="Passes over the pairs.")
    batch: int | None = option("--batch", type=_COUNT, metavar="N", help="Pairs per step.")
    device: str | None = option("--device", type=click.Choice(["auto", "cpu", "cuda"]), help="Where to train.")
    threads: int | None = option("--threads", type=_COUNT, metavar="N", help="Threads of a training on the CPU.")
    assigned: tuple[str, ...] = _assigned(help="Further options of the method.")
    n_sampled: int | None = option("--sampled", type=_COUNT, metavar="N", help="Number of generated bodies.")
    n_validation: int | None = option(
        "--validation", type=_COUNT, metavar="N", help="Hold back N training subjects for curves and pictures."
    )


_OF_SET = ("name", ..., "plugins", "data_root")


@dataclass(frozen=True, kw_only=True)
class DataOptions(RunOptions):
    """Options of commands for one data set."""

    name: str = argument("NAME|FOLDER", type=NAME_OR_FOLDER, shell_complete=complete_datasets)


@verb("data", "data.list_", ..., "plugins", "data_root")
class ListData(RunOptions):
    """List the data sets: official or generated, present or absent."""

    as_json: bool = _json()


@verb("data", "data.check", *_OF_SET)
class CheckData(DataOptions):
    """Check a data set; exit 1 if it cannot be used."""


@verb("data", "data.export", *_OF_SET)
class Export(DataOptions):
    """Write a data set as files that '-d DIR' reads with the same shapes, classes and cameras."""

    output: Path = option("-o", "--output", required=True, type=PATH, metavar="DIR", help="New or empty folder.")
    layout: str | None = option(
        "--layout", type=click.Choice(["shrec14", "tosca", "frames"]),
        help="shrec14: 0.obj, 1.obj ... and a .cla file; tosca: CLASS + number .off; frames: depth images, of camera"
        " sets.",
    )  # fmt: skip
    force: bool = flag("--force", help="Write into a non-empty folder, replacing files of the same name.")


@verb("data", "data.sheet", *_OF_SET)
class Sheet(DataOptions):
    """Draw a data set at a glance: subjects in some poses, as surface and as depth image."""

    output: Path | None = option(
        "-o", "--output", type=PATH, metavar="FILE.png", help="File to write. [sheet-NAME.png]"
    )
    subjects: int | None = option("--subjects", type=_COUNT, metavar="K", help="Rows. [all subjects]")
    poses: int = option("--poses", type=_COUNT, default=8, metavar="K", help="Columns.")
    perturbations: str | None = option(
        "--perturbations", "--nuisances", metavar="SHAPE", help="Draw only this shape, under each perturbation."
    )


data = click.Group("data", help="List, check, draw or export data sets.", commands=_OF_DATA)
SECTIONS["Own methods and data"].append(data)

# Results -------------------------------------------------------------------------------------------------------------


@verb("Results", "plan.why", *_SELECTION)
class Why(RunOptions):
    """Explain a job: state, reason, versions, cost, failure.

    Several jobs get one line each, unless --all is given.
    """

    target: str = argument("METHOD|KEY", shell_complete=complete_methods)
    everything: bool = flag("--all", help="Explain each job in full.")


@verb("Results", "show.compare", "datasets", "inputs", "scorer", "everything", "plugins", "published", "results")
class Compare(RunOptions):
    """Compare two methods, two results folders, or two scorers.

    For two scorers, print Kendall's tau between their orders of the methods, for each table and measure.
    """

    first: str = argument("A")
    second: str = argument("B")
    everything: bool = flag("--all", help="Compare every pair, with perturbed sets, intervals and tests.")


@verb("Results", "report.paper", *_SELECTION, ..., "force", "published")
class Paper(RunOptions):
    """Write a LaTeX paper of results: protocol, tables, figures, statistics, sources; compile it by 'make' in DIR.

    Without -t and -d it contains Tables I to IV and those of your own data. Files that you edited are kept.
    """

    output: Path = option("-o", "--output", type=PATH, default=Path("results/paper"), metavar="DIR")
    template: Literal["article", "ieee"] = option(
        "--template", type=click.Choice(["article", "ieee"]), default="article", help="LaTeX class."
    )


@verb("Results", "share.merge", ..., "results")
class Merge(RunOptions):
    """Join the records of several results folders; exit 1 if they contradict each other.

    Writes one file per data set and one line per record, unless a run is writing records there.
    """

    folders: tuple[Path, ...] = argument("DIR...", nargs=-1, required=True, type=PATH)
    published: bool = flag("--published", help="Merge into RESULTS/records, without quick runs and own data.")


@verb("Results", "share.prune", ..., "results")
class Prune(RunOptions):
    """Delete data that no record needs, and remains of killed processes."""

    dry_run: bool = flag("--dry-run", help="Only say what would be deleted.")


@verb("Results", "share.submit", "path", "datasets", "inputs", "scorer", "plugins", "results", "data_root", "seed")
class Submit(RunOptions):
    """Write the finished jobs of a method into a bundle that anyone can verify."""

    method: str = _method_argument()
    path: Path = option("-o", "--output", required=True, type=PATH, metavar="BUNDLE.zip", help="File to write.")
    quick: bool = flag("--quick", help="Take the results of --quick.")
    author: str = option("--author", default="", metavar="NAME", help="Author of the row.")
    licence: str = option(
        "--licence", default="", metavar="NAME", help="Licence, such as MIT. [the source's SPDX line]"
    )
    with_forms: bool = flag("--forms", help="Include the forms of your own data.")


@verb("Results", "share.verify", "folders", "results", "data_root")
class Verify(RunOptions):
    """Compute the scores of a bundle again; none of its code runs without --run.

    Exit 0 if everything is verified, 1 if something is claimed or false, 2 if it cannot be read.
    """

    bundle: Path = argument("BUNDLE.zip", type=PATH)
    folders: tuple[str, ...] = option(
        "-d", "--dataset", multiple=True, type=NAME_OR_FOLDER, metavar="FOLDER",
        help="Folder of the meshes that it was run on.",
    )  # fmt: skip
    run: bool = flag("--run", help="Run the author's plugin with your rights, to make forms again.")
    again: int = option(
        "--again", type=click.IntRange(min=3), default=3, metavar="N", help="Number of forms per record to make again."
    )
    timeout: float | None = timeout_option("each step")
    into: Path | None = option("--into", type=PATH, metavar="DIR", help="Results folder whose reports show its rows.")
    as_json: bool = _json()


# Set-up and others ---------------------------------------------------------------------------------------------------


@verb("Set-up", "compilation.compile_")
class Compile(RunOptions):
    """Compile the kernels and build the body model in advance; otherwise the first run does."""

    processes: int | None = option("-j", "--jobs", type=_COUNT, metavar="N", help="Processes; all cores by default.")


@verb("Set-up", "main.completion")
class Completion(RunOptions):
    """Print a shell completion script: eval "$(canonical-forms completion bash)"."""

    shell: str = argument(type=click.Choice(["bash", "zsh", "fish"]))


@verb("Others", "share.score")
class Score(RunOptions):
    """Score a distance matrix or ranked lists of any program.

    DISTANCES is an N x N or queries x gallery matrix: text, CSV, .npy, .npz, .mat, or PSB's .matrix.
    """

    distances: Path = argument("DISTANCES", type=PATH)
    labels: Path = option(
        "--labels", required=True, type=PATH, metavar="FILE|FOLDER",
        help="Labels: .cla, lines 'label' or 'name label', or a folder of shapes.",
    )  # fmt: skip
    query_labels: Path | None = option(
        "--query-labels", type=PATH, metavar="FILE|FOLDER", help="Labels of the rows, if they are not the columns."
    )
    ranked: bool = flag("--ranked", help="DISTANCES holds ranked lists: a query and its results per line.")
    format: str = option("--format", type=click.Choice(["markdown", "latex", "csv", "json"]), default="markdown")
    title: str = option("--title", default="", help="Name of the row. [name of the file]")
    folder: Path | None = option(
        "--results", type=PATH, metavar="DIR", help="Also keep it as an external row in this folder."
    )
    dataset: str = option("--dataset", default="", metavar="NAME", help="Data set of that row. [name of the labels]")
    input: Literal["mesh", "view"] = option(
        "--input", type=click.Choice(["mesh", "view"]), default="mesh", help="Input of that row."
    )


# Shared messages -----------------------------------------------------------------------------------------------------


def name_skipped(*stores: Store) -> None:
    """Print once, on stderr, which files among the records are not records."""
    for store in stores:
        for line in (*store.published.news(), *store.records.news()):
            say(line, err=True)


def name_unusable(kind: str = "methods") -> None:
    """Print on stderr which installed packages with methods or scorers cannot be used."""
    from benchmark.plugins.registry import methods
    from benchmark.plugins.scorers import scorers

    for line in (methods() if kind == "methods" else scorers()).news:
        say(line, err=True)


@contextmanager
def explained(name: str, wanted: str) -> Iterator[None]:
    """Improve the error for a name of another kind: suggest the command that accepts it.

    Parameters
    ----------
    name
        The name.
    wanted
        Expected kind of name: ``"method"`` or ``"data set"``.
    """
    try:
        yield
    except ConfigurationError as error:
        from benchmark.datasets.catalogue import is_known
        from benchmark.plugins.registry import BUILT_IN
        from benchmark.plugins.scorers import scorers
        from benchmark.protocols.tables import TABLES

        base = name.partition("[")[0]
        kinds = {
            "method": (base in BUILT_IN, f"describe {name}"),
            "data set": (is_known(name) or Path(name).is_dir(), f"data check {name}"),
            "scorer": (base in scorers(), "list scorers"),
            "table": (name in {table.identifier for table in TABLES}, "list tables"),
            "file": (Path(name).is_file(), f"check {name}"),
        }
        for kind, (is_it, command) in kinds.items():
            if is_it and kind != wanted:
                raise ConfigurationError(f"'{name}' is a {kind}, not a {wanted}", f"see '{command}'") from error
        raise
