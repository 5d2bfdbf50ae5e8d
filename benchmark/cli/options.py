"""Options of all commands, as dataclasses from which the click commands are built.

The module of a command is imported when it runs. Every ``--help`` imports this module, so it imports nothing heavy.
Its annotations are not text, because the types of fields give those of options.
"""

import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import click

from benchmark.cli.declare import (
    EVERY,
    FINISHED,
    Count,
    DataSet,
    MethodName,
    ScorerName,
    TableName,
    argument,
    flag,
    option,
    timeout_option,
    vertex_count,
)
from benchmark.errors import ConfigurationError
from benchmark.text import DATA_VARIABLE, say

if TYPE_CHECKING:
    from benchmark.pipeline.storage.store import Store

OK, NOT_OK, USAGE, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143


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

    tables: tuple[TableName, ...] = option("-t --table TABLE", "Table; see 'list tables'.", ())
    methods: tuple[MethodName, ...] = option("-m --method METHOD", "Method, all, or finished; see 'list methods'.", ())
    datasets: tuple[DataSet, ...] = option(
        "-d --dataset DATASET|FOLDER", "Set, folder, or humans[subjects=N,poses=M].", ()
    )
    inputs: tuple[Literal["view", "mesh"], ...] = option("--input", "Default: both.", ())
    scorer: ScorerName = option("--scorer SCORER", "What compares the forms; see 'list scorers'.", "cm-bof")
    plugins: tuple[Path, ...] = option(
        "--plugin FILE", "Python file with methods, scorers or data sets.", (), callback=_inspected
    )
    results: Path = option("--results DIR", default=Path("results"))
    data_root: Path | None = option(
        "--data-root DIR", f"Folder of the official data sets; also {DATA_VARIABLE}.",
        envvar=DATA_VARIABLE, callback=_require_folder,
    )  # fmt: skip
    seed: int = option("--seed", "Base seed of all methods.", 0)
    quick: bool = flag("--quick", "Fewer poses per subject, and only the paper's methods.")
    everything: bool = flag("--all", "All tables but camera and robustness (default of 'plan').")
    paper: bool = flag("--paper", "Only the rows of the paper.")
    workers: Count | None = option("-j --jobs N", "Number of parallel jobs. [all cores]")
    executor: Literal["serial", "processes", "dask"] = option("--executor", default="processes")
    scheduler: str = option("--scheduler URL", "Scheduler of a dask cluster, such as tcp://HOST:8786.", "")
    timeout: float | None = None
    retry: tuple[Literal["failed", "timeout", "crashed", "killed", "memory", "unsupported", "all"], ...] = option(
        "--retry", "Run failed jobs of this kind again.", ()
    )
    force: bool = flag("--force", "Replace files in -o DIR that this verb did not write.")
    published: bool = flag("--published", "Use only published records.")

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
_PLAN = ("everything", *_SELECTION, "paper")


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
        fields = [field for name in names if (field := complete.__dataclass_fields__[name]).metadata]

        def call(**values: Any) -> None:
            body = getattr(import_module(f"benchmark.cli.{module}"), function)
            if body(complete(**values)) is False:
                sys.exit(NOT_OK)

        name = function.removesuffix("_")
        parameters = [field.metadata["parameter"](field.name, field.type) for field in fields]
        command = click.Command(name, callback=call, help=inspect.getdoc(options), params=parameters)
        if section == "data":
            _OF_DATA[name] = command
        else:
            SECTIONS.setdefault(section, []).append(command)
        return complete

    return declare


_json = partial(flag, "--json", "Print JSON.")
_method_argument = partial(argument, "METHOD")
_assigned = partial(option, "-o --option NAME=VALUE", default=())


@dataclass(frozen=True, kw_only=True)
class _FrameOptions(RunOptions):
    """Options of depth images."""

    method: MethodName = option("-m --method METHOD", "Method; see 'list methods'.", required=True)
    intrinsics: str = option("--intrinsics FILE|fx,fy,cx,cy", "Camera of a depth image. [file next to it]", "")
    mask: Path | None = option("--mask FILE", "Object in a depth image. [found automatically]")
    depth_scale: float | None = option("--depth-scale N", "Depth units per metre. [1000 for integers, 1 for floats]")


_FRAME = ("intrinsics", "mask", "depth_scale")

# Daily use -----------------------------------------------------------------------------------------------------------


@verb("Daily use", "run.run", *_PLAN, "workers", "executor", "scheduler", "timeout", "retry")
class Run(RunOptions):
    """Run the missing jobs of a selection, then print its tables."""

    timeout: float | None = timeout_option("one job", "2h")
    forms: tuple[str, ...] = option(
        "--forms NAME=DIR", "Instead of methods: score DIR/SHAPE.off, ..., made by another program.", ()
    )
    frame: Path | None = option("--frame", "Write the records as JSON, and print no tables.", hidden=True)


@verb("Daily use", "plan.plan", *_PLAN)
class Plan(RunOptions):
    """Show what would run, why, and how long it would take."""

    all_jobs: bool = flag("--all-jobs", "A line for each job, however many there are.")
    traceback: bool = flag("--traceback", "Print the error of each failed job in full.")


_Format = Annotated[str, ("type", click.Choice(["latex", "markdown", "csv", "json"]))]


@verb("Daily use", "show.tables", *_SELECTION, ..., "force", "published", "fresh")
class Tables(RunOptions):
    """Print tables of finished jobs, or write them to files; needs no data."""

    formats: tuple[_Format, ...] = option("--format", "[markdown; with -o, all]", ())
    output: Path | None = option("-o --output DIR", "Write files instead of printing.")
    check: bool = flag("--check", "Compare with the files in -o DIR; exit 1 if they differ.")
    notes: Literal["table", "appendix", "none"] = option(
        "--notes", "LaTeX notes: below each table, in files notes-TABLE.tex, or none.", "table"
    )
    rows_only: bool = flag("--rows-only", "LaTeX: the rows of each table, without float, heading and notes.")
    bibliography: bool = flag("--bibliography", "Print BibTeX entries after LaTeX; with -o, they are a file.")
    everything: bool = flag("--all", "Print whole tables for many methods, too.")
    fresh: bool = flag("--fresh", "Omit rows made by other code or versions.")


@verb("Daily use", "report.report", *_SELECTION, "output", "force", "published")
class Report(RunOptions):
    """Write HTML pages: tables, charts, and canonical forms in 3D.

    They work without a network. Nothing is computed; where data is missing, a page names the run that creates it.
    """

    output: Path = option("-o --output DIR", default=Path("results/report"))
    figure: Path | None = option("--figure FILE", "Draw a figure (.pdf, .png or .svg) instead; see --of.")
    what: Literal["forms", "effect", "cost", "precision-recall", "confusion", "classes"] = option(
        "--of",
        "One subject by all methods; subjects before and after one method; accuracy against cost; precision over"
        " recall; nearest matches by class; scores by class.",
        "forms",
    )
    subjects: tuple[str, ...] = option("--subject NAME", "Subject to show in a figure.", ())
    shapes: tuple[str, ...] = option("--shape NAME", "Shape to show in a figure.", ())
    timeout: float | None = timeout_option("missing forms of a method")


@verb("Daily use", "methods.list_", ..., "plugins", "results", "data_root")
class List(RunOptions):
    """List methods, scorers, data sets, tables or models."""

    what: Literal["methods", "scorers", "datasets", "tables", "models"] = argument()
    as_json: bool = _json()


@verb("Daily use", "methods.describe", ..., "plugins")
class Describe(RunOptions):
    """Describe a method: parameters, source, inputs."""

    method: MethodName = _method_argument()
    as_json: bool = _json()


@verb("Daily use", "forms.canonicalise", "method", "paths", "output", "plugins", "timeout", "seed", "vertices", *_FRAME)
class Canonicalise(_FrameOptions):
    """Write the canonical form of a mesh, or of depth images.

    A depth image is a 16-bit PNG or TIFF, NPY, NPZ or PFM; a folder or pattern stands for all of its images.
    """

    paths: tuple[Path, ...] = argument("IN...")
    output: Path | None = option(
        "-o --output OUT", "Mesh file [IN-METHOD.off in the current folder], or folder for several images [forms]."
    )
    timeout: float | None = timeout_option("the form")
    vertices: int | str | None = option(
        "--vertices N|all", "Number of vertices, or all of the file. [2000]", type=vertex_count
    )
    picture: Path | None = option("--picture OUT.png", "Draw depth and form; for several images, a folder.")


@verb(
    "Daily use", "forms.retrieve", "method", "gallery", "query", "k", "picture", *_FRAME, "scorer", "plugins",
    "results", "data_root", "timeout", "seed",
)  # fmt: skip
class Retrieve(_FrameOptions):
    """Show the shapes of a gallery that are nearest to a depth image or a mesh."""

    gallery: DataSet = option("-d --dataset DATASET|FOLDER", "Data set or folder that was run.", required=True)
    query: Path = argument("QUERY")
    k: Count = option("-k", "Number of shapes to show.", 5)
    picture: Path | None = option("--picture OUT.png", "Draw the forms that were found.")
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

    target: str = argument("METHOD|FILE")
    chosen: tuple[str, ...] = option("-m --method METHOD", "Check only this method of a file.", ())
    assigned: tuple[str, ...] = _assigned("Option for training a learner.")
    timeout: float | None = timeout_option("one check")


@verb("Own methods and data", "train.train", ..., "plugins", "results", "data_root")
class Train(RunOptions):
    """Train the models of a learner; resume an interrupted training, and skip finished models."""

    method: MethodName = _method_argument()
    table: str = option("-t --table TABLE", "Table that the model is for.", "I")
    only: str | None = option("--only TRAINING", "Train only on this, e.g. humans-strict-0-1.")
    configuration: str | None = option("--config NAME", "Configuration of the method.")
    training_seed: int | None = option("--seed", "Seed of the training.")
    resolution: Count | None = option("--resolution N", "Pixels per side.")
    epochs: Count | None = option("--epochs N", "Passes over the pairs.")
    batch: Count | None = option("--batch N", "Pairs per step.")
    device: Literal["auto", "cpu", "cuda"] | None = option("--device", "Where to train.")
    threads: Count | None = option("--threads N", "Threads of a training on the CPU.")
    assigned: tuple[str, ...] = _assigned("Further options of the method.")
    n_sampled: Count | None = option("--sampled N", "Number of generated bodies.")
    n_validation: Count | None = option("--validation N", "Hold back N training subjects for curves and pictures.")


_OF_SET = ("name", ..., "plugins", "data_root")


@dataclass(frozen=True, kw_only=True)
class DataOptions(RunOptions):
    """Options of commands for one data set."""

    name: DataSet = argument("NAME|FOLDER")


@verb("data", "methods.list_", "as_json", "plugins", "data_root")
class ListData(List):
    """List the data sets: official or generated, present or absent."""

    what: Literal["datasets"] = "datasets"


@verb("data", "data.check", *_OF_SET)
class CheckData(DataOptions):
    """Check a data set; exit 1 if it cannot be used."""


@verb("data", "data.export", *_OF_SET)
class Export(DataOptions):
    """Write a data set as files that '-d DIR' reads with the same shapes, classes and cameras."""

    output: Path = option("-o --output DIR", "New or empty folder.", required=True)
    force: bool = flag("--force", "Write into a non-empty folder, replacing files of the same name.")


@verb("data", "data.sheet", *_OF_SET)
class Sheet(DataOptions):
    """Draw a data set at a glance: subjects in some poses, as surface and as depth image."""

    output: Path | None = option("-o --output FILE.png", "File to write. [sheet-NAME.png]")
    subjects: Count | None = option("--subjects K", "Rows. [all subjects]")
    poses: Count = option("--poses K", "Columns.", 8)
    perturbations: str | None = option(
        "--perturbations --nuisances SHAPE", "Draw only this shape, under each perturbation."
    )


data = click.Group("data", help="List, check, draw or export data sets.", commands=_OF_DATA)
SECTIONS["Own methods and data"].append(data)

# Results -------------------------------------------------------------------------------------------------------------


@verb("Results", "show.compare", "datasets", "inputs", "scorer", "everything", "plugins", "published", "results")
class Compare(RunOptions):
    """Compare two methods."""

    first: str = argument("A")
    second: str = argument("B")
    everything: bool = flag("--all", "Compare every pair, with perturbed sets, intervals and tests.")


@verb("Results", "share.merge", ..., "results")
class Merge(RunOptions):
    """Join the records of several results folders; exit 1 if they contradict each other.

    Writes one file per data set and one line per record, unless a run is writing records there.
    """

    folders: tuple[Path, ...] = argument("DIR...")
    published: bool = flag("--published", "Merge into RESULTS/records, without quick runs and own data.")


# Set-up and others ---------------------------------------------------------------------------------------------------


@verb("Others", "share.score")
class Score(RunOptions):
    """Score a distance matrix or ranked lists of any program.

    DISTANCES is an N x N or queries x gallery matrix: text, CSV, .npy, .npz, .mat, or PSB's .matrix.
    """

    distances: Path = argument("DISTANCES")
    labels: Path = option(
        "--labels FILE|FOLDER", "Labels: .cla, lines 'label' or 'name label', or a folder of shapes.", required=True
    )
    query_labels: Path | None = option("--query-labels FILE|FOLDER", "Labels of the rows, if they are not the columns.")
    ranked: bool = flag("--ranked", "DISTANCES holds ranked lists: a query and its results per line.")
    format: Literal["markdown", "latex", "csv", "json"] = option("--format", default="markdown")
    title: str = option("--title", "Name of the row. [name of the file]", "")
    folder: Path | None = option("--results DIR", "Also keep it as an external row in this folder.")
    dataset: str = option("--dataset NAME", "Data set of that row. [name of the labels]", "")
    input: Literal["mesh", "view"] = option("--input", "Input of that row.", "mesh")


# Shared messages -----------------------------------------------------------------------------------------------------


def name_skipped(*stores: "Store") -> None:
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
