"""Options of the verbs: those that several share, and the selection that they make.

Every ``--help`` imports this module, so it imports nothing heavy.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from functools import partial, wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from msgspec import Struct
from msgspec.structs import asdict
from typer import Argument, Exit, Option, Typer
from typer.core import TyperArgument, TyperCommand

from benchmark.cli.examples import example_of
from benchmark.defaults import DATA_VARIABLE, DEFAULT_SCORER

_application = partial(
    Typer, no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False
)
cli = _application(context_settings={"help_option_names": ["-h", "--help"]})
data = _application(help="Check or export data sets.")
cli.add_typer(data, name="data")
models = _application(help="Fetch trained models.")
cli.add_typer(models, name="models")

#: Seconds of the units of a duration.
_SECONDS = {"": 1, "s": 1, "m": 60, "h": 3600}


def parse_duration(text: str | float) -> float:
    """Parse a duration such as ``90``, ``90s``, ``10m`` or ``2h``; return seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", str(text).strip())
    if not match or float(match[1]) == 0:
        raise ValueError(f"'{text}' is not a duration; write 90s, 10m or 2h")
    return float(match[1]) * _SECONDS[match[2]]


def _without_type(ctx: Any) -> None:
    """Stand for the type of an argument, which is that of Python: ``list[Path]``."""


def _check_values(ctx: Any, parameter: Any, values: Any) -> None:
    """Refuse an empty value, which is mostly a variable that was not set, and a ``~`` that is left.

    An empty path would be the working folder, and ``~`` a new folder of that name.
    """
    name = max(parameter.opts, key=len)
    if isinstance(parameter, TyperArgument):
        name = parameter.metavar
    every = values if isinstance(values, list | tuple) else [values]
    for value in every:
        if value == "":
            ctx.fail(f"{name} is empty")
        if isinstance(value, str) and value.startswith("~/"):
            ctx.fail(f"{name}: no shell has replaced the ~ of '{value}', write $HOME in its place")


class Verb(TyperCommand):
    """A command that refuses what a shell has left empty, and an option that is given twice."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of a command line."""
        values, _, given = self.make_parser(ctx).parse_args([*args])
        for option in given:
            _check_values(ctx, option, values.get(option.name))
            is_flag = getattr(option, "is_flag", False)
            takes_several = getattr(option, "multiple", True)
            if given.count(option) > 1 and not (takes_several or is_flag):
                ctx.fail(f"{max(option.opts, key=len)} is given twice")
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options; the type of an argument only if it lists choices."""
        for parameter in self.params:
            if not isinstance(parameter, TyperArgument):
                continue
            if "|" not in (parameter.display_type_rich(ctx) or ""):
                parameter.display_type_rich = _without_type  # type: ignore[method-assign]
        super().format_options(ctx, formatter)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write an example below the options."""
        example = example_of(ctx.command_path)
        if example:
            with formatter.section("Example"):
                formatter.write_text(example)


# Options of several verbs, by their types
# ------------------------------------------------------------------------------------------------

MethodOption = Annotated[
    str, Option("-m", "--method", metavar="METHOD", help="Method; see 'list methods'.")
]
ForceOption = Annotated[bool, Option("--force", help="Replace files that this verb did not write.")]
FormatOption = Annotated[Literal["text", "json"], Option("--format")]
FailedOption = Annotated[bool, Option("--failed", help="Also show methods that fail in every job.")]
TimeoutOption = Annotated[
    float, Option("--timeout", parser=parse_duration, metavar="TIME", help="Limit: 90s, 10m, 2h.")
]
TracebackOption = Annotated[bool, Option("--traceback", help="Print errors in full.")]
SetArgument = Annotated[str, Argument(metavar="NAME|FOLDER")]


# Options that select
# ------------------------------------------------------------------------------------------------

#: Names of the options that select models, jobs and records, and of the arguments of commands.
OF_MODELS = (
    "data",
    "methods",
    "tables",
    "input",
    "plugins",
    "results",
    "data_root",
    "quick",
    "subjects",
    "gallery",
    "gallery_views",
    "same_names",
)
OF_JOBS = (
    *OF_MODELS,
    "scorer",
    "seed",
)
OF_RECORDS = (
    "methods",
    "tables",
    "data",
    "input",
    "scorer",
    "results",
    "seed",
    "quick",
    "published",
)

#: Options of the verbs that read depth images.
OF_CAMERA = ("intrinsics", "mask", "depth_scale", "picture")


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
    data: Annotated[
        list[str],
        Option("-d", "--dataset", metavar="DATASET|FOLDER", help="Data set, or your folder."),
    ] = []
    input: Annotated[
        Literal["mesh", "view"] | None,
        Option("--input", help="Complete surface or depth image. [both]"),
    ] = None
    scorer: Annotated[
        str,
        Option(
            "--scorer",
            metavar="SCORER",
            help="Scorer; see 'list scorers'. [cm-bof]",
            show_default=False,
        ),
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
        str | None,
        Option("--subjects", metavar="A,B", help="Only these subjects, for choosing parameters."),
    ] = None
    gallery: Annotated[
        str,
        Option(
            "--gallery", metavar="DATASET|FOLDER", help="Rank these shapes for each query of -d."
        ),
    ] = ""
    gallery_views: Annotated[
        int,
        Option(
            "--gallery-views",
            min=0,
            metavar="N",
            help="Render each shape of the gallery with N cameras.",
        ),
    ] = 0
    same_names: Annotated[
        bool,
        Option(
            "--same-names", help="Leave the shape with the name of the query out of the gallery."
        ),
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
            help="Depth units per metre. [1000 for integers, 1 for floats]",
        ),
    ] = None
    picture: Annotated[
        Path | None,
        Option("--picture", metavar="FILE", help="Draw the forms; a folder for several."),
    ] = None

    @property
    def is_something(self) -> bool:
        """Return whether anything is selected, or everything by name."""
        selected = self.tables or self.methods or self.data or self.plugins
        return self.everything or bool(selected)

    def arguments(self, names: Iterable[str]) -> dict[str, Any]:
        """Return some options by their names, as the arguments of a command."""
        return {name: getattr(self, name) for name in names}


def verb(
    *names: str, app: Typer = cli
) -> Callable[[Callable[..., bool | None]], Callable[..., None]]:
    """Return a decorator that makes a function a verb of the command line.

    The first argument of the function is a :class:`Selection`, all others become options of the
    verb. The function ``tables_verb`` makes the verb ``tables``. If it returns False, because not
    all went well, the exit code is 1.

    Parameters
    ----------
    names
        Names of the options of :class:`Selection` that the verb has, beside its own.
    app
        The application that gets the verb.
    """
    types = get_type_hints(Selection, include_extras=True)
    defaults = asdict(Selection())
    of_selection = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=types[name])
        for name, default in defaults.items()
        if name in names
    ]

    def decorate(function: Callable[..., bool | None]) -> Callable[..., None]:
        """Add a function to the application as a verb."""

        @wraps(function)
        def run(**values: Any) -> None:
            """Call the function with the values of all options."""
            selection = Selection(**{name: values.pop(name) for name in names})
            if function(selection, **values) is False:
                raise Exit(1)

        _, *own = signature(function, eval_str=True).parameters.values()
        _set_parameters(run, [*of_selection, *own])
        name, _, _ = function.__name__.partition("_")
        return app.command(name, cls=Verb)(run)

    return decorate


def _set_parameters(function: Callable[..., None], parameters: Iterable[Parameter]) -> None:
    """Give a function with ``**values`` a signature, from which Typer makes options.

    Parameters
    ----------
    function
        The function, which is changed.
    parameters
        What it takes, as keywords. Those without a default come first: they are positional on the
        command line.
    """
    keywords = [parameter.replace(kind=Parameter.KEYWORD_ONLY) for parameter in parameters]
    keywords.sort(key=lambda parameter: parameter.default is not Parameter.empty)
    function.__signature__ = Signature(keywords)  # type: ignore[attr-defined]
    function.__annotations__ = {parameter.name: parameter.annotation for parameter in keywords}
