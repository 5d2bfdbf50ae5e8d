"""Options of the verbs: those that several share, and the selection that they make.

Every ``--help`` imports this module, so it imports nothing heavy.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial, wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from msgspec import Struct
from msgspec.structs import asdict
from typer import Argument, Exit, Option, Typer
from typer.core import TyperCommand

from benchmark.defaults import DATA_VARIABLE, DEFAULT_SCORER

_application = partial(
    Typer, no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False
)
cli = _application(context_settings={"help_option_names": ["-h", "--help"]})
data = _application(help="Check or export data sets.")
cli.add_typer(data, name="data")
models = _application(help="Fetch trained models.")
cli.add_typer(models, name="models")

_UNITS = {"": 1, "s": 1, "m": 60, "h": 3600}


def duration(text: str | float) -> float:
    """Parse a duration such as ``90``, ``90s``, ``10m`` or ``2h``; return seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", str(text).strip())
    if not match or float(match[1]) == 0:
        raise ValueError(f"'{text}' is not a duration; write 90s, 10m or 2h")
    return float(match[1]) * _UNITS[match[2]]


class Verb(TyperCommand):
    """A command that refuses an option of one value that is given twice."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of a command line."""
        _, _, given = self.make_parser(ctx).parse_args([*args])
        for option in given:
            if given.count(option) > 1 and not (
                getattr(option, "multiple", True) or getattr(option, "is_flag", False)
            ):
                ctx.fail(f"{max(option.opts, key=len)} is given twice")
        return super().parse_args(ctx, args)


Method = Annotated[
    str, Option("-m", "--method", metavar="METHOD", help="Method; see 'list methods'.")
]
Force = Annotated[bool, Option("--force", help="Replace files that this verb did not write.")]
Format = Annotated[Literal["text", "json"], Option("--format")]
Failed = Annotated[bool, Option("--failed", help="Also show methods that fail in every job.")]
Timeout = Annotated[
    float, Option("--timeout", parser=duration, metavar="TIME", help="Limit: 90s, 10m, 2h.")
]
Traceback = Annotated[bool, Option("--traceback", help="Print errors in full.")]
SetName = Annotated[str, Argument(metavar="NAME|FOLDER")]


class Selection(Struct, frozen=True, kw_only=True):
    """What the shared options select; see :func:`verb`."""

    everything: Annotated[
        bool, Option("--all", help="Tables I to IV, I-view to III-view (default of 'plan').")
    ] = False
    tables: Annotated[
        list[str], Option("-t", "--table", metavar="TABLE", help="Table; see 'list tables'.")
    ] = []
    methods: Annotated[
        list[str],
        Option("-m", "--method", metavar="METHOD", help="Method, or all; see 'list methods'."),
    ] = []
    datasets: Annotated[
        list[str],
        Option("-d", "--dataset", metavar="DATASET|FOLDER", help="Data set, or your folder."),
    ] = []
    input: Annotated[Literal["mesh", "view"] | None, Option("--input", help="Default: both.")] = (
        None
    )
    scorer: Annotated[
        str, Option("--scorer", metavar="SCORER", help="Scorer; see 'list scorers'.")
    ] = DEFAULT_SCORER
    plugins: Annotated[
        list[Path], Option("--plugin", metavar="FILE", help="File with methods or scorers.")
    ] = []
    results: Annotated[Path, Option("--results", metavar="DIR", help="Results folder.")] = Path(
        "results"
    )
    data_root: Annotated[
        Path | None,
        Option(
            "--data-root",
            metavar="DIR",
            envvar=DATA_VARIABLE,
            help="Folder of the official data sets.",
        ),
    ] = None
    seed: Annotated[int, Option("--seed", metavar="N", help="Base seed of all methods.")] = 0
    quick: Annotated[
        bool, Option("--quick", help="Fewer poses per subject, and only the paper's methods.")
    ] = False
    subjects: Annotated[
        str, Option("--subjects", metavar="A,B", help="Only these, to choose parameters on.")
    ] = ""
    gallery: Annotated[
        str, Option("--gallery", metavar="DATASET|FOLDER", help="Gallery of the queries in -d.")
    ] = ""
    gallery_views: Annotated[
        int,
        Option(
            "--gallery-views", min=0, metavar="N", help="Show it to N cameras around each shape."
        ),
    ] = 0
    same_names: Annotated[
        bool, Option("--same-names", help="Leave out of it what has the query's name.")
    ] = False
    published: Annotated[bool, Option("--published", help="Only published records.")] = False
    intrinsics: Annotated[
        str,
        Option(
            "--intrinsics",
            metavar="FILE|fx,fy,cx,cy",
            help="Camera of a depth image. [file next to it]",
        ),
    ] = ""
    mask: Annotated[
        Path | None, Option("--mask", metavar="FILE", help="Object in a depth image. [found]")
    ] = None
    depth_scale: Annotated[
        float | None,
        Option(
            "--depth-scale",
            metavar="N",
            help="Depth units a metre. [1000 for integers, 1 for floats]",
        ),
    ] = None
    picture: Annotated[
        Path | None,
        Option("--picture", metavar="FILE", help="Draw the forms; a folder for several."),
    ] = None

    @property
    def is_something(self) -> bool:
        """Return whether anything is selected, or everything by name."""
        selected = self.tables or self.methods or self.datasets or self.plugins
        return self.everything or bool(selected)

    def of_models(self) -> dict[str, Any]:
        """Return what selects models, by the arguments of a command."""
        return {
            "data": self.datasets,
            "methods": self.methods,
            "tables": self.tables,
            "input": self.input,
            "plugins": self.plugins,
            "results": self.results,
            "data_root": self.data_root,
            "quick": self.quick,
        }

    def of_jobs(self) -> dict[str, Any]:
        """Return what selects jobs, by the arguments of a command."""
        return {
            **self.of_models(),
            "scorer": self.scorer,
            "seed": self.seed,
            "subjects": self.subjects,
            "gallery": self.gallery,
            "gallery_views": self.gallery_views,
            "same_names": self.same_names,
        }

    def of_records(self) -> dict[str, Any]:
        """Return what selects records but for tables and methods, by the arguments of a command."""
        return {
            "results": self.results,
            "data": self.datasets,
            "input": self.input,
            "scorer": self.scorer,
            "seed": self.seed,
            "quick": self.quick,
            "published": self.published,
        }

    def of_tables(self) -> dict[str, Any]:
        """Return what selects tables, by the arguments of a command."""
        return {"names": self.tables, "methods": self.methods, **self.of_records()}


def verb(
    *shared: str, app: Typer = cli
) -> Callable[[Callable[..., bool | None]], Callable[..., None]]:
    """Return a decorator that adds a verb with options of :class:`Selection`, which is its first argument.

    The exit code is 1 if the verb returns False: not all went well.
    """
    types = get_type_hints(Selection, include_extras=True)
    options = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=types[name])
        for name, default in asdict(Selection()).items()
        if name in shared
    ]

    def decorate(function: Callable[..., bool | None]) -> Callable[..., None]:
        _, *own = signature(function, eval_str=True).parameters.values()

        @wraps(function)
        def run(**values: Any) -> None:
            if (
                function(Selection(**{name: values.pop(name) for name in shared}), **values)
                is False
            ):
                raise Exit(1)

        parameters = [
            *options,
            *(parameter.replace(kind=Parameter.KEYWORD_ONLY) for parameter in own),
        ]
        parameters.sort(
            key=lambda parameter: parameter.default is not Parameter.empty
        )  # required ones first
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return app.command(function.__name__.partition("_")[0], cls=Verb)(run)

    return decorate
