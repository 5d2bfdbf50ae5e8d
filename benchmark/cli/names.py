"""``list`` and ``describe``: available names, and details of methods."""

from __future__ import annotations

import json
from collections.abc import Iterable
from inspect import cleandoc
from pathlib import Path

from benchmark.api.learning import CARD, read_card
from benchmark.api.parameters import format_value
from benchmark.cli.options import Selection
from benchmark.datasets.catalogue import CATALOGUE, is_present
from benchmark.errors import ConfigurationError
from benchmark.protocols.models import MODELS_VARIABLE, model_places, people_training
from benchmark.protocols.tables import TABLES
from benchmark.reference.paper import entry_of, source_of
from benchmark.registry import Component, by_name, select_one
from benchmark.registry.names import split_name
from benchmark.text import clean, say, say_lines, say_table

Rows = list[dict[str, str]]

#: Columns that fit 80 characters, by kind; the JSON has all.
_COLUMNS = {
    "methods": ("name", "family", "state", "summary"),
    "datasets": ("name", "state", "shapes", "classes", "source"),
    "models": ("training", "model", "origin", "schedule"),
}


def list_(what: str, selection: Selection, *, as_json: bool) -> None:
    """Print the names of a kind."""
    kinds = {"datasets": _datasets, "tables": _tables, "models": _models}
    rows = kinds[what](selection) if what in kinds else _components(what, selection)
    if as_json:
        say_lines(json.dumps(rows, indent=1))
    else:
        names = _COLUMNS.get(what, tuple(rows[0]))
        table = [[row.get(name, "") for name in names] for row in rows]
        if what == "tables":
            table = [[name, f"{data}: {caption}"] for name, data, caption in table]
        say_table([names, *table] if what == "datasets" else table, whole=range(len(table[0]) - 1))


def _components(what: str, selection: Selection) -> Rows:
    """Return methods or scorers; one that cannot be imported has the reason."""
    rows: Rows = []
    for name, component in by_name(
        "method" if what == "methods" else "scorer", selection.plugins
    ).items():
        try:
            missing = component.missing_packages()
            family = {"family": component.info.family} if component.kind == "method" else {}
            state = f"needs {', '.join(missing)}" if missing else "available"
            facts = {"name": name, "title": component.info.title, **family, "state": state}
            rows.append({**facts, "summary": component.summary})
        except ConfigurationError as error:
            rows.append(
                {
                    "name": name,
                    "title": name,
                    "family": "",
                    "state": "broken",
                    "summary": str(error),
                }
            )
    return rows


def _datasets(selection: Selection) -> Rows:
    """Return the data sets, official or generated, present or absent."""
    root = selection.require_data_root()
    return [
        {
            "name": name,
            "kind": "official" if known.folder else "generated",
            "state": "present" if is_present(name, root) else f"not at {known.folder}",
            "shapes": str(known.n_shapes or "?"),
            "classes": str(known.n_classes),
            "source": known.origin or "generated",
            "summary": known.summary,
            "url": known.url,
            "terms": known.terms,
            "use": known.other_use or "retrieval",
        }
        for name, known in CATALOGUE.items()
    ]


def _tables(selection: Selection) -> Rows:
    root, rows = selection.require_data_root(), []
    for table in TABLES:
        stand_in = (
            f"{', '.join(table.stand_ins)} (stand-in for {table.dataset})"
            if table.stand_ins
            else "not here"
        )
        data = table.dataset if is_present(table.dataset, root) else stand_in
        rows.append({"table": table.identifier, "dataset": data, "caption": table.caption})
    return rows


def _models(selection: Selection) -> Rows:
    """Return finished models with their training; those trained here precede the shipped ones."""
    folders = {selection.results / "models": "trained here"}
    for learner in (
        component.create() for component in by_name("method").values() if component.learns
    ):
        for folder in model_places(learner):
            folders.setdefault(
                folder, "shipped" if folder == learner.shipped_models else MODELS_VARIABLE
            )
    return [
        {
            "training": path.parent.parent.name,
            "model": path.parent.name,
            "origin": origin,
            **_model(path.parent),
        }
        for folder, origin in folders.items()
        for path in sorted(folder.glob(f"*/*/{CARD}"))
    ]


def _model(folder: Path) -> dict[str, str]:
    try:
        card = read_card(folder)
    except ConfigurationError as error:
        return {"digest": "", "schedule": f"unusable: {error}"}
    return {"digest": card.digest[:12], "schedule": card.schedule_in_words}


def trained_on_people(component: Component) -> str:
    """Return a warning if a model was trained on people only; "" otherwise, or if the table determines the model."""
    training = "" if component.missing_packages() else people_training(component.create())
    shown = f"its model of training '{training}' was shown people alone: it turns any other shape into a person"
    return training and shown


def describe(name: str, plugins: Iterable[Path], *, as_json: bool) -> None:
    """Print the details of a method or a scorer."""
    is_scorer = split_name(name)[0] in by_name("scorer", plugins)
    component = select_one(name, plugins, "scorer" if is_scorer else "method")
    facts, cls = _facts(component), component.load()
    parameters = {
        name: format_value(value)
        for name, value in (component.defaults | {**component.parameters}).items()
    }
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
    for text in dict.fromkeys(cleandoc(base.__doc__ or "") for base in cls.__mro__ if parameters):
        if "\nParameters\n" in text:
            say_lines(f"\n{text}")


def _facts(component: Component) -> dict[str, str | list[str]]:
    """Return the details of a method or a scorer by name."""
    info, facts = component.info, dict[str, str | list[str]]()
    kind = (
        "learner" if component.learns else "descriptor" if component.describes else component.kind
    )
    if component.kind == "method":
        facts = {
            "departs": info.departs,
            "inputs": list(info.inputs),
            "scale": info.scale,
            "random": "" if info.deterministic else "the form depends on --seed",
            "warning": trained_on_people(component),
        }
    return {
        "name": component.name,
        "title": info.title,
        "summary": clean(component.summary),
        "kind": kind,
        "family": info.family if facts else "",
        "source": source_of(info.cite) or "none",
        "cite": entry_of(info.cite)[0],
        **(facts or {"draws": str(info.draws)}),
        "requires": list(info.requires),
        "missing": list(component.missing_packages()),
        "defined in": component.target,
    }
