"""Options that several verbs share, and what they select."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli import completion
from benchmark.cli.completion import EVERY, FINISHED
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.text import DATA_VARIABLE, say

if TYPE_CHECKING:
    from benchmark.execution.job_specs import Job
    from benchmark.execution.plan import Shard
    from benchmark.pipeline.storage.records import Record
    from benchmark.pipeline.storage.store import Store
    from benchmark.plugins.scorers import ScorerSpec
    from benchmark.report.results import Result, Results

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

OK, NOT_OK, USAGE, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143

#: Fewest vertices of a prepared mesh.
FEWEST_VERTICES = 4

_UNITS = {"": 1, "s": 1, "m": 60, "h": 3600}

#: Seconds that foreign code may take for one shape, or one check, where nobody says otherwise.
PATIENCE = "10m"


class PathOption(click.ParamType[Path]):
    """A path that the system can look up; whether there is anything is another question."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Refuse what cannot be a path: nothing at all, or more than the system takes."""
        require_path(str(value), param.opts[-1] if param else "path")
        return Path(value)


class NameOrFolder(click.ParamType[str]):
    """The name of a data set, or the path of a folder."""

    name = "name"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Refuse what can be neither."""
        require_path(str(value), param.opts[-1] if param else "name")
        return str(value)


def require_path(text: str, option: str) -> None:
    """Raise ``ConfigurationError`` if a text cannot be a path."""
    if not text:
        raise ConfigurationError(f"{option} is empty", "name a file or a folder; the current one is '.'")
    try:
        os.lstat(text)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return
    except (OSError, ValueError) as error:
        said = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigurationError(f"{option} '{text[:40]}...' cannot be a path: {said}", "correct it") from error


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
    """The plugin files, after a look at them from a process of their own."""
    if plugins:
        from benchmark.plugins.inspection import inspect

        inspect(plugins)
    return plugins


class Duration(click.ParamType[float]):
    """Seconds, written as ``90``, ``90s``, ``10m`` or ``2h``."""

    name = "duration"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse a duration."""
        if isinstance(value, (int, float)):
            return float(value)
        match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", str(value).strip())
        if not match or float(match[1]) == 0:
            self.fail(f"'{value}' is not a duration; write 90s, 10m or 2h", param, ctx)
        return float(match[1]) * _UNITS[match[2]]


class VertexCount(click.ParamType[int | str]):
    """A number of vertices, or ``all`` of them."""

    name = "vertices"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        """Read a number of at least :data:`FEWEST_VERTICES`."""
        text = str(value).strip()
        if text != "all" and not (text.isdecimal() and int(text) >= FEWEST_VERTICES):
            self.fail(f"'{value}' is no number of vertices; write {FEWEST_VERTICES} or more, or all", param, ctx)
        return text if text == "all" else int(text)


class ShardOption(click.ParamType["Shard"]):
    """A part of a plan, written as ``2/3``."""

    name = "shard"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Shard:
        """Parse a part."""
        from benchmark.execution.plan import Shard

        return value if isinstance(value, Shard) else Shard.parse(str(value))


def timeout_option(what: str, default: str = PATIENCE) -> Decorator:
    """Make the option that limits how long foreign code may take for something."""
    return click.option(
        "--timeout", type=Duration(), metavar="TIME", default=default, show_default=True,
        help=f"Time limit for {what}: 90s, 10m, 2h.",
    )  # fmt: skip


def name_skipped(*stores: Store) -> None:
    """Tell on stderr, once, which files among the records are none."""
    for store in stores:
        for line in (*store.published.news(), *store.records.news()):
            say(line, err=True)


def name_unusable(kind: str = "methods") -> None:
    """Tell on stderr which installed packages bring methods, or scorers, that cannot be used."""
    from benchmark.plugins import registry, scorers

    for line in {"methods": registry.unusable, "scorers": scorers.unusable}[kind]():
        say(line, err=True)


@contextmanager
def told_what_it_is(name: str, wanted: str) -> Iterator[None]:
    """Refuse, of the unknown names that the body refuses, one that means something else with the command for that.

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


def _option(*words: str, multiple: bool = False, is_flag: bool = False, default: Any = None, **given: Any) -> Any:
    """Return the field of an option, with what click is to know of it."""
    default = () if multiple else False if is_flag else default
    given = {"show_default": not is_flag and not multiple and default is not None} | given
    return field(default=default, metadata={"click": (words, {"multiple": multiple, "is_flag": is_flag, **given})})


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of ``run``, handed on whole to whatever reads one; other verbs take some and leave out the others.

    An option is a field here, from which :func:`add_options` makes that of click.

    Parameters
    ----------
    tables, methods, datasets, inputs, scorer
        Names of what is run, as they are written; empty for all.
    plugins
        Files with methods, scorers and data sets.
    results, data_root
        Folders of the results and of the official data sets.
    seed
        Base seed of all methods.
    quick
        Whether to leave out poses, and methods that the paper does not have.
    paper
        Whether the rows of the paper are meant alone.
    everything
        Whether all tables are meant where none is named.
    published
        Whether to read published records alone.
    repeat
        Jittered preparations of each gallery; None for none.
    shard
        Part of the plan; None for all of it.
    retry
        Kinds of failure to run again.
    force
        Whether to replace files that the verb did not write.
    executor, workers, scheduler
        See :func:`benchmark.cli.run_plan.make_pool`.
    timeout
        Seconds of work after which a job is stopped; None for no limit.
    """

    # fmt: off
    tables: tuple[str, ...] = _option("-t", "--table", multiple=True, metavar="TABLE", help="Table; see 'list tables'.",
                                      shell_complete=completion.tables)
    methods: tuple[str, ...] = _option("-m", "--method", multiple=True, metavar="METHOD",
                                       shell_complete=completion.methods,
                                       help="Method, all, or finished; see 'list methods'.")
    datasets: tuple[str, ...] = _option("-d", "--dataset", multiple=True, type=NameOrFolder(),
                                        metavar="DATASET|FOLDER", shell_complete=completion.datasets,
                                        help="Set, folder, or humans[subjects=N,poses=M].")
    inputs: tuple[str, ...] = _option("--input", multiple=True, type=click.Choice(["view", "mesh"]),
                                      help="Default: both.")
    scorer: str = _option("--scorer", metavar="SCORER", default="cm-bof", shell_complete=completion.scorers,
                          help="What compares the forms; see 'list scorers'.")
    plugins: tuple[Path, ...] = _option("--plugin", multiple=True, type=PathOption(), callback=_inspected,
                                        metavar="FILE", help="Python file with methods, scorers or data sets.")
    results: Path = _option("--results", type=PathOption(), default=Path("results"), metavar="DIR")
    data_root: Path | None = _option("--data-root", type=PathOption(), envvar=DATA_VARIABLE, callback=_require_folder,
                                     metavar="DIR", help=f"Folder of the official data sets; also {DATA_VARIABLE}.")
    seed: int = _option("--seed", type=int, default=0, help="Base seed of all methods.")
    quick: bool = _option("--quick", is_flag=True, help="Fewer poses per subject, and only the paper's methods.")
    everything: bool = _option("--all", is_flag=True, help="All tables, methods and inputs (default of 'plan').")
    paper: bool = _option("--paper", is_flag=True, help="Only the rows of the paper.")
    repeat: int | None = _option("--repeat", type=click.IntRange(min=2), metavar="N",
                                 help="Repeat each gallery N times with jittered vertices, and print the spread.")
    shard: Shard | None = _option("--shard", type=ShardOption(), metavar="I/N",
                                  help="Run part I of N of the jobs; 'merge' joins the parts.")
    workers: int | None = _option("-j", "--jobs", type=click.IntRange(min=1), metavar="N",
                                  help="Number of parallel jobs. [all cores]")
    executor: str = _option("--executor", type=click.Choice(["serial", "processes", "dask"]), default="processes")
    scheduler: str = _option("--scheduler", default="", show_default=False, metavar="URL",
                             help="Scheduler of a dask cluster, such as tcp://HOST:8786.")
    timeout: float | None = None
    retry: tuple[str, ...] = _option(
        "--retry", multiple=True, help="Run failed jobs of this kind again.",
        type=click.Choice(["failed", "timeout", "crashed", "killed", "memory", "unsupported", "all"]))
    force: bool = _option("--force", is_flag=True, help="Replace files in -o DIR that this verb did not write.")
    published: bool = _option("--published", is_flag=True, help="Use only published records.")
    # fmt: on

    @classmethod
    def of(cls, options: dict[str, Any]) -> RunOptions:
        """Take what belongs to a run from the options of a verb."""
        return cls(**{name: options[name] for name in cls.__dataclass_fields__ if name in options})

    @property
    def is_narrow(self) -> bool:
        """Return whether methods are named, so that a table has no rows for others that were never run."""
        return bool(self.methods) and EVERY not in self.methods

    @property
    def is_by_name(self) -> bool:
        """Return whether each method is asked for by its name."""
        return self.is_narrow and FINISHED not in self.methods

    def store(self, output: Path | None = None) -> Store:
        """Open the results folder to read from it.

        Parameters
        ----------
        output
            Folder of the files that are made of it. In ``RESULTS/tables``, where the suite keeps its published tables,
            they are made from published records alone, where there are any.
        """
        from benchmark.pipeline.storage.store import Store

        store = Store.open(self.results)
        is_published = self.published or (
            output is not None and output.resolve() == (self.results / "tables").resolve() and store.published.has_files
        )
        return replace(store, published_only=is_published)

    def _methods(self, store: Store) -> tuple[str, ...]:
        """Names of methods, with those of all finished jobs where these are asked for."""
        from benchmark.plugins.registry import methods, variants

        if FINISHED not in self.methods:
            return self.methods
        known, found = methods(self.plugins), []
        for record in (*store.published, *store.records):
            with suppress(ConfigurationError):  # one of a plugin that was not passed, or of parameters of old
                found += [spec.name for spec in variants(record["method"], known) if record["status"] == "ok"]
        if not found:
            raise ConfigurationError(f"no job under {self.results} has finished", "name methods, or run some first")
        return tuple(dict.fromkeys([*(name for name in self.methods if name != FINISHED), *found]))

    def jobs(self, store: Store) -> list[Job]:
        """Plan the run, or the shard of it; without tables and data sets, those of plugin files are meant."""
        from benchmark.datasets.catalogue import sources
        from benchmark.datasets.own import data_sets_of
        from benchmark.execution.plan import JobSettings, make_plan, require_jobs
        from benchmark.plugins.registry import methods, select
        from benchmark.protocols.galleries import galleries
        from benchmark.protocols.tables import INPUTS

        specs = select(self._methods(store), methods(self.plugins), self.plugins)
        if not self.methods or EVERY in self.methods:
            name_unusable()
        named = self.datasets if self.datasets or self.tables or self.everything else tuple(data_sets_of(self.plugins))
        chosen = galleries(self.tables, sources(named, self.plugins), self.data_root, self.quick, self.repeat or 0)
        for gallery in chosen:
            for asked in self.inputs:
                gallery.check_input(asked)
        inputs = [input_ for input_ in INPUTS if not self.inputs or input_ in self.inputs]
        planned = make_plan(
            chosen, inputs, specs, store, JobSettings(self.seed, frozenset(self.retry), self.scorer_spec())
        )
        name_skipped(store)
        require_jobs(planned)
        planned = self._of_paper(planned) if self.paper else planned
        if self.shard is None:
            return planned
        say(self.shard.told(planned))
        return self.shard.of(planned)

    def _of_paper(self, planned: list[Job]) -> list[Job]:
        """Return the jobs that rows of the paper are made of; raises ``ConfigurationError`` if there are none."""
        from benchmark.protocols.tables import TABLES
        from benchmark.reference import paper
        from benchmark.report.content import row_of

        tables = {table.identifier: table for table in TABLES}
        found = [
            job
            for job in planned
            if job.table in tables and row_of(tables[job.table], job.facts) in paper.rows(job.table)
        ]
        if not found:
            raise ConfigurationError(
                "no row of the paper is selected", "drop --paper, or select of Tables I to IV and their methods"
            )
        return found

    def scorer_spec(self) -> ScorerSpec:
        """The scorer; raises ``ConfigurationError`` if there is none of this name."""
        from benchmark.plugins.scorers import scorer_of, scorers

        return scorer_of(self.scorer, scorers(self.plugins))

    def allows(self, record: Record) -> bool:
        """Return whether a record is of the data sets, by name or by path, and of the inputs, where some are named."""
        asked = {*self.datasets, *map(os.path.realpath, self.datasets)}
        is_of_set = not asked or bool(asked & _names(record["data"]))
        return is_of_set and (not self.inputs or record["input"] in self.inputs)

    def results_of(self, store: Store) -> Results:
        """The records of a store, looked at with the methods and scorers that are known."""
        from benchmark.plugins.registry import methods
        from benchmark.plugins.scorers import scorers
        from benchmark.report.results import Results

        return Results(store, methods(self.plugins), self.data_root, scorers(self.plugins))

    def recorded(self, store: Store, *, fresh: bool = False) -> list[Result]:
        """The records that the selection stands for, whether or not their data and models are here.

        Parameters
        ----------
        store
            Where the records are.
        fresh
            Whether to leave out those that this code would not make again.

        Raises
        ------
        ConfigurationError
            If there is none, or a method or a table is unknown.
        """
        from benchmark.datasets.catalogue import is_known, is_path
        from benchmark.pipeline.storage.records import EXTERNAL
        from benchmark.plugins.registry import methods, select
        from benchmark.protocols.tables import TABLES

        found = self.results_of(store).all(self.seed, fresh=fresh, scorer=self.scorer_spec().name)
        finished = FINISHED in self.methods
        names: set[str] = set()
        if self.is_narrow and not finished:
            names = {result.record["method"] for result in found if result.record["family"] == EXTERNAL}
            names &= set(self.methods)
            others = [name for name in self.methods if name not in names]
            names |= {spec.name for spec in select(others, methods(self.plugins))} if others else set()

        def is_chosen(result: Result) -> bool:
            record = result.record
            return (
                bool(record["data"]["quick"]) == self.quick
                and (not names or record["method"] in names)
                and (not finished or record["status"] == "ok")
                and self.allows(record)
            )

        name_skipped(store)
        sets = set().union(*(_names(result.record["data"]) for result in found))
        for name in self.datasets:
            if found and not {name, os.path.realpath(name)} & sets and not (is_known(name) or is_path(name)):
                raise did_you_mean("data set", name, {result.record["data"]["name"] for result in found})
        tables = {table.identifier for table in TABLES} | {result.record["data"]["name"] for result in found}
        for name in self.tables:
            if name not in tables:
                raise did_you_mean("table", name, tables)
        chosen = [result for result in found if is_chosen(result)]
        if not chosen:
            less = (
                "select less; of shapes of which --quick leaves out none, drop --quick" if self.quick else "select less"
            )
            raise ConfigurationError(
                f"no finished job under {self.results} fits the selection", f"run it first, or {less}"
            )
        return chosen


def _names(data: Mapping[str, str]) -> set[str]:
    """Return what a data set may be called; under a perturbation, also what the clean set may be."""
    from benchmark.datasets.perturbations.dataset import parsed

    given = {data["name"], data["source"]}
    clean = {found[0] for name in given if (found := parsed(name))}
    return {name for each in given | clean for name in (each, os.path.realpath(each))}


def add_options(*names: str) -> Decorator:
    """Add options of :class:`RunOptions` by the names of their fields to a verb, in the order of its ``--help``."""

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        for each in (RunOptions.__dataclass_fields__[name] for name in reversed(names)):
            words, given = each.metadata["click"]
            command = click.option(*words, each.name, default=each.default, **given)(command)
        return command

    return add


#: Fields of what finished jobs, a plan, and a run are selected by.
SELECTION = (
    "tables", "methods", "datasets", "scorer", "inputs", "plugins", "results", "data_root", "seed", "quick",
)  # fmt: skip
PLAN = ("everything", *SELECTION, "paper", "repeat", "shard")
