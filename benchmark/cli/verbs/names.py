"""``list`` and ``describe``: what can be named."""

from __future__ import annotations

from pathlib import Path

import click

from benchmark.cli import completion
from benchmark.cli.options import add_options, name_unusable, told_what_it_is
from benchmark.cli.verbs.data import COLUMNS, print_rows
from benchmark.text import say


@click.command("list")
@click.argument("what", type=click.Choice(["methods", "scorers", "datasets", "tables", "models"]))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@add_options("plugins", "results", "data_root")
def list_(what: str, as_json: bool, plugins: tuple[Path, ...], results: Path, data_root: Path | None) -> None:
    """List methods, scorers, data sets, tables or models."""
    from benchmark.cli import listing

    rows = {
        "methods": lambda: listing.methods(plugins),
        "scorers": lambda: listing.scorers(plugins),
        "datasets": lambda: listing.datasets(data_root, plugins),
        "tables": lambda: listing.tables(data_root),
        "models": lambda: listing.models(results),
    }[what]()
    print_rows(rows, as_json, COLUMNS if what == "datasets" else ())
    if what in ("methods", "scorers"):
        name_unusable(what)


@click.command()
@click.argument("method", metavar="METHOD", shell_complete=completion.methods)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@add_options("plugins")
def describe(method: str, as_json: bool, plugins: tuple[Path, ...]) -> None:
    """Describe a method: parameters, source, inputs."""
    import json
    import shutil

    from benchmark.cli.description import facts_of, lines_of
    from benchmark.plugins.registry import methods, variant

    with told_what_it_is(method, "method"):
        spec = variant(method, methods(plugins))
    facts = facts_of(spec)
    if as_json:
        click.echo(json.dumps(facts, indent=1))
        return
    for line in lines_of(facts, shutil.get_terminal_size((100, 24)).columns):
        say(line)
