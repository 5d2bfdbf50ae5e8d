"""``canonicalise`` and ``check``: one method at a time."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import click

from benchmark.cli import completion
from benchmark.cli.options import NOT_OK, OK, PathOption, VertexCount, plugin_option, timeout_option
from benchmark.errors import ConfigurationError
from benchmark.system.text import say, say_lines

#: Characters of a method with its parameters that do not belong into the name of a file.
_NOT_IN_NAMES = r"[^\w.,=()\[\]-]"


@click.command()
@click.option(
    "-m", "--method", "method", required=True, metavar="METHOD", help="Method; see 'list methods'.",
    shell_complete=completion.methods,
)  # fmt: skip
@click.argument("source", type=PathOption(), metavar="IN")
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    metavar="OUT",
    help="Mesh file to write; by default IN-METHOD.off in the current folder.",
)
@plugin_option
@timeout_option("making the form")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option(
    "--vertices", type=VertexCount(), metavar="N|all", help="Vertices of the form; all: those of the file. [2000]"
)
def canonicalise(
    method: str,
    source: Path,
    output: Path | None,
    plugins: tuple[Path, ...],
    timeout: float,
    seed: int,
    vertices: int | str | None,
) -> None:
    """Write the canonical form of one mesh."""
    from benchmark.cli.canonicalise import canonicalise_file

    if not source.name:
        raise ConfigurationError(f"{source} is no file", "name a mesh")
    target = output or Path(f"{source.stem}-{re.sub(_NOT_IN_NAMES, '_', method)}.off")
    if output is None and source.resolve().parent == Path.cwd():
        raise ConfigurationError(
            f"{target} beside {source} would become part of the data", f"name a file with -o, such as -o forms/{target}"
        )
    form = canonicalise_file(source, target, method, plugins, seed, timeout, vertices)
    facts = ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in form.notes.items()
    )
    say(f"{target}: {len(form.vertices)} vertices{', ' + facts if facts else ''}")


@click.command()
@click.argument("target", metavar="METHOD|FILE", shell_complete=completion.methods_or_files)
@click.option("-m", "--method", "chosen", multiple=True, metavar="METHOD", help="Of a file, check this method alone.")
@click.option("-o", "--option", "options", multiple=True, metavar="NAME=VALUE", help="How to train a learner for it.")
@plugin_option
@timeout_option("one check")
def check(
    target: str, chosen: tuple[str, ...], options: tuple[str, ...], plugins: tuple[Path, ...], timeout: float
) -> None:
    """Check that a method, or all that a plugin file brings, keeps the contract; exit 1 if it does not.

    Parameters are written behind either: FILE[power=1].
    """
    from benchmark.methods.conformance import Target, check_apart
    from benchmark.parameters.values import assignments

    named = Target(target, chosen, tuple(map(str, plugins)), tuple(assignments(options).items()))
    report = check_apart(named, timeout)
    say_lines(str(report))
    sys.exit(OK if report else NOT_OK)
