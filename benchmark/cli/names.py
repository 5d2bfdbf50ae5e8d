"""``list`` and ``describe``: available names, and details of methods."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.commands.listing import (
    KindOfName,
    describe,
    details_of,
    find_component,
    listing,
    parameters_of,
)
from benchmark.registry.documented import describe_parameters
from benchmark.text import say, say_lines, say_table

#: Columns that fit 80 characters, by kind; the JSON has all.
_COLUMNS = {
    "methods": ("name", "family", "summary"),
    "scorers": ("name", "title", "summary"),
    "datasets": ("name", "state", "shapes", "classes", "source"),
    "tables": ("table", "dataset", "caption"),
    "models": ("training", "model", "origin", "schedule"),
}

#: Columns of numbers.
_NUMBERS = ("shapes", "classes")


def print_list(what: KindOfName, selection: Selection, *, as_json: bool) -> None:
    """Print all names of a kind, with facts about each.

    Parameters
    ----------
    what
        The kind, such as ``"methods"`` or ``"datasets"``.
    selection
        Plugins, results folder and folder of the official data.
    as_json
        Whether to print JSON instead of a table.
    """
    rows = listing(
        what,
        plugins=selection.plugins,
        results=selection.results,
        data_root=selection.data_root,
    )
    if as_json:
        say_lines(json.dumps(rows, indent=1))
        return
    # A terminal shows the most important facts alone.
    columns = _COLUMNS[what]
    lines = [[*columns], *(_values_of(row, columns) for row in rows)]
    if what == "tables":
        lines = [[name, f"{data}: {caption}"] for name, data, caption in lines]
    # The last column is a sentence, which may be wrapped; the others are not.
    whole = range(len(lines[0]) - 1)
    numbers = [columns.index(name) for name in _NUMBERS if name in columns]
    say_table(lines, whole, numbers)


def _values_of(row: Mapping[str, str], columns: Sequence[str]) -> list[str]:
    """Return the facts of a row in some columns, and a blank for one that it lacks.

    The summary of a method or scorer that cannot be used begins with the reason.
    """
    facts = dict(row)
    if "summary" in facts and "state" not in columns and facts["state"] != "available":
        facts["summary"] = f"{facts['state']}: {facts['summary']}"
    return [facts.get(name, "") for name in columns]


def print_description(name: str, plugins: Sequence[Path], *, as_json: bool) -> None:
    """Print the details of a method or a scorer, and its parameters with what each means.

    Parameters
    ----------
    name
        Name of the method or scorer.
    plugins
        Plugin files that may define it.
    as_json
        Whether to print JSON instead of a table.
    """
    if as_json:
        say_lines(json.dumps(describe(name, plugins), indent=1))
        return
    component = find_component(name, plugins)
    facts = {}
    for fact, value in details_of(component).items():
        facts[fact] = value if isinstance(value, str) else " and ".join(value)
    parameters = parameters_of(component)
    say(f"{facts.pop('name')}: {facts.pop('title')}")
    rows = [(f"  {fact}", text) for fact, text in facts.items() if text]
    if not parameters:
        rows.append(("  parameters", "none"))
        say_table(rows, whole=(0,))
        return
    say_table(rows, whole=(0,))
    say("  parameters")
    meanings = describe_parameters(component.load())
    rows = []
    for parameter, value in parameters.items():
        rows.append((f"    {parameter} = {value}", meanings.get(parameter, "")))
    say_table(rows, whole=(0,))
