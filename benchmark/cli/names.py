"""``list`` and ``describe``: available names, and details of methods."""

from __future__ import annotations

import json
from collections.abc import Sequence
from inspect import cleandoc
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.commands.listing import details_of, find_component, listing, parameters_of
from benchmark.text import say, say_lines, say_table

#: Columns that fit 80 characters, by kind; the JSON has all.
_COLUMNS = {
    "methods": ("name", "family", "state", "summary"),
    "datasets": ("name", "state", "shapes", "classes", "source"),
    "models": ("training", "model", "origin", "schedule"),
}


def list_(what: str, selection: Selection, *, as_json: bool) -> None:
    """Print the names of a kind."""
    rows = listing(
        what,
        plugins=selection.plugins,
        results=selection.results,
        data_root=selection.data_root,
    )
    if as_json:
        say_lines(json.dumps(rows, indent=1))
    else:
        names = _COLUMNS.get(what, tuple(rows[0]))
        table = [[row.get(name, "") for name in names] for row in rows]
        if what == "tables":
            table = [[name, f"{data}: {caption}"] for name, data, caption in table]
        say_table([names, *table] if what == "datasets" else table, whole=range(len(table[0]) - 1))


def describe(name: str, plugins: Sequence[Path], *, as_json: bool) -> None:
    """Print the details of a method or a scorer."""
    component = find_component(name, plugins)
    facts, parameters = details_of(component), parameters_of(component)
    if as_json:
        say_lines(json.dumps({**facts, "parameters": parameters}, indent=1))
        return
    texts = {
        fact: value if isinstance(value, str) else " and ".join(value)
        for fact, value in facts.items()
    }
    say(f"{texts.pop('name')}: {texts.pop('title')}")
    rows = [(f"  {fact}", text) for fact, text in texts.items() if text]
    chosen = [f"{name}={text}" for name, text in parameters.items()]
    say_table([*rows, ("  parameters", ", ".join(chosen) or "none")], whole=(0,))
    for text in dict.fromkeys(
        cleandoc(base.__doc__ or "") for base in component.load().__mro__ if parameters
    ):
        if "\nParameters\n" in text:
            say_lines(f"\n{text}")
