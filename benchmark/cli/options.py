"""Options that several verbs share, each a field from which click's is made, and the decorator that makes verbs.

Every verb imports this module to show its ``--help``, so that nothing heavy is imported here.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli.declare import (
    EVERY,
    FINISHED,
    NAME_OR_FOLDER,
    PATH,
    complete_datasets,
    complete_methods,
    complete_scorers,
    complete_tables,
    flag,
    option,
)
from benchmark.errors import ConfigurationError
from benchmark.text import DATA_VARIABLE, say

if TYPE_CHECKING:
    from benchmark.execution.sharding import Shard
    from benchmark.pipeline.storage.store import Store

Declaration = Callable[[str], list[click.Parameter]]

OK, NOT_OK, USAGE, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143


def _shard(text: str) -> Shard:
    from benchmark.execution.sharding import Shard

    return Shard.parse(text)


def _require_folder(_: click.Context, __: click.Parameter, root: Path | None) -> Path | None:
    """The folder of the official data sets; ``ConfigurationError`` if it is absent or another one is meant.

    A folder without sets is no error by itself: a run says which stand-ins it takes.
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
    """The plugin files, after a process of its own has inspected them."""
    if plugins:
        from benchmark.plugins.inspection import inspect

        inspect(plugins)
    return plugins


def shared(*names: str) -> Any:
    """Declare options of :class:`RunOptions`: one, or several for a parameter that takes them all."""
    fields = RunOptions.__dataclass_fields__
    return lambda _: [made for name in names for made in fields[name].metadata["declaration"](name)]


def _field(*words: str, default: Any = None, **attributes: Any) -> Any:
    default = () if attributes.get("multiple") else default
    declared = {} if default == () else {"default": default}
    return field(default=default, metadata={"declaration": option(*words, **declared, **attributes)})


def _flag_field(*words: str, **attributes: Any) -> Any:
    return field(default=False, metadata={"declaration": flag(*words, **attributes)})


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options that verbs share, handed on whole to whatever reads one; a verb takes some and leaves the others."""

    # fmt: off
    tables: tuple[str, ...] = _field("-t", "--table", multiple=True, metavar="TABLE", help="Table; see 'list tables'.",
                                     shell_complete=complete_tables)
    methods: tuple[str, ...] = _field("-m", "--method", multiple=True, metavar="METHOD",
                                      shell_complete=complete_methods,
                                      help="Method, all, or finished; see 'list methods'.")
    datasets: tuple[str, ...] = _field("-d", "--dataset", multiple=True, type=NAME_OR_FOLDER, metavar="DATASET|FOLDER",
                                       shell_complete=complete_datasets,
                                       help="Set, folder, or humans[subjects=N,poses=M].")
    inputs: tuple[str, ...] = _field("--input", multiple=True, type=click.Choice(["view", "mesh"]),
                                     help="Default: both.")
    scorer: str = _field("--scorer", metavar="SCORER", default="cm-bof", shell_complete=complete_scorers,
                         help="What compares the forms; see 'list scorers'.")
    plugins: tuple[Path, ...] = _field("--plugin", multiple=True, type=PATH, callback=_inspected, metavar="FILE",
                                       help="Python file with methods, scorers or data sets.")
    results: Path = _field("--results", type=PATH, default=Path("results"), metavar="DIR")
    data_root: Path | None = _field("--data-root", type=PATH, envvar=DATA_VARIABLE, callback=_require_folder,
                                    metavar="DIR", help=f"Folder of the official data sets; also {DATA_VARIABLE}.")
    seed: int = _field("--seed", type=int, default=0, help="Base seed of all methods.")
    quick: bool = _flag_field("--quick", help="Fewer poses per subject, and only the paper's methods.")
    everything: bool = _flag_field("--all", help="All tables, methods and inputs (default of 'plan').")
    paper: bool = _flag_field("--paper", help="Only the rows of the paper.")
    repeat: int | None = _field("--repeat", type=click.IntRange(min=2), metavar="N",
                                help="Repeat each gallery N times with jittered vertices, and print the spread.")
    shard: Shard | None = _field("--shard", type=_shard, metavar="I/N",
                                 help="Run part I of N of the jobs; 'merge' joins the parts.")
    workers: int | None = _field("-j", "--jobs", type=click.IntRange(min=1), metavar="N",
                                 help="Number of parallel jobs. [all cores]")
    executor: str = _field("--executor", type=click.Choice(["serial", "processes", "dask"]), default="processes")
    scheduler: str = _field("--scheduler", default="", metavar="URL",
                            help="Scheduler of a dask cluster, such as tcp://HOST:8786.")
    timeout: float | None = None
    retry: tuple[str, ...] = _field(
        "--retry", multiple=True, help="Run failed jobs of this kind again.",
        type=click.Choice(["failed", "timeout", "crashed", "killed", "memory", "unsupported", "all"]))
    force: bool = _flag_field("--force", help="Replace files in -o DIR that this verb did not write.")
    published: bool = _flag_field("--published", help="Use only published records.")
    # fmt: on

    @property
    def is_narrow(self) -> bool:
        """Return whether methods are named, so that a table has no rows for others that were never run."""
        return bool(self.methods) and EVERY not in self.methods

    @property
    def is_by_name(self) -> bool:
        """Return whether each method is asked for by its name."""
        return self.is_narrow and FINISHED not in self.methods


#: Fields of what finished jobs, a plan, and a run are selected by.
SELECTION = (
    "tables", "methods", "datasets", "scorer", "inputs", "plugins", "results", "data_root", "seed", "quick",
)  # fmt: skip
PLAN = ("everything", *SELECTION, "paper", "repeat", "shard")


def verb(function: Callable[..., bool | None]) -> click.Command:
    """Make a verb of a function whose parameters have declarations as defaults; it exits with 1 if that returns False.

    A parameter ``options`` is a :class:`RunOptions` of all values of the verb that have a field there.
    """
    declarations: dict[str, Declaration] = {n: p.default for n, p in inspect.signature(function).parameters.items()}

    def call(**values: Any) -> None:
        fields = {name: value for name, value in values.items() if name in RunOptions.__dataclass_fields__}
        if "options" in declarations:
            values["options"] = RunOptions(**fields)
        if function(**{name: values[name] for name in declarations}) is False:
            sys.exit(NOT_OK)

    return click.Command(
        function.__name__.removesuffix("_"), callback=call, help=inspect.getdoc(function),
        params=[parameter for name, declare in declarations.items() for parameter in declare(name)],
    )  # fmt: skip


# What several verbs say ----------------------------------------------------------------------------------------------


def name_skipped(*stores: Store) -> None:
    """Name on stderr, once, the files among the records that are none."""
    for store in stores:
        for line in (*store.published.news(), *store.records.news()):
            say(line, err=True)


def name_unusable(kind: str = "methods") -> None:
    """Name on stderr the installed packages with methods, or scorers, that cannot be used."""
    from benchmark.plugins import registry, scorers

    for line in {"methods": registry.unusable, "scorers": scorers.unusable}[kind]():
        say(line, err=True)


@contextmanager
def explained(name: str, wanted: str) -> Iterator[None]:
    """Where the body refuses a name that stands for something else, refuse it with the command for that instead.

    Parameters
    ----------
    name
        The name.
    wanted
        What it should stand for: ``"method"`` or ``"data set"``.
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
