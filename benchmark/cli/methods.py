"""``list``, ``describe`` and ``new``: available names, details of methods, and plugin templates."""

from __future__ import annotations

import dataclasses
import json
import shutil
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmark.api.parameters import format_value
from benchmark.cli.options import Selection, explained, name_unusable
from benchmark.errors import ConfigurationError
from benchmark.plugins import registry
from benchmark.plugins.registry import MethodSpec, variant
from benchmark.plugins.specs import PluginSpec
from benchmark.text import aligned, clean, say, say_lines

Rows = list[dict[str, str]]

#: Columns of ``list datasets``, which fit 80 characters; the JSON has all.
_COLUMNS = ("name", "state", "shapes", "classes", "source")

#: Sets whose trainings contain people only.
_PEOPLE = ("humans", "shrec14-synthetic")

_KINDS = {"paper": "a row of the paper", "control": "a yardstick", "extended": "beyond the paper"}


def list_(what: str, options: Selection, *, as_json: bool) -> None:
    """Print the names of a kind."""
    kinds = {"methods": _methods, "scorers": _scorers, "datasets": _datasets, "tables": _tables, "models": _models}
    if what in ("datasets", "tables"):
        options.require_data_root()
    rows = kinds[what](options)
    if as_json:
        say_lines(json.dumps(rows, indent=1))
    else:
        table = [list(row.values()) for row in rows]
        if what == "datasets":
            table = [[*_COLUMNS], *([row[name] for name in _COLUMNS] for row in rows)]
        for line in aligned(table):
            say(line)
    if what in ("methods", "scorers"):
        name_unusable(what)


def _state(spec: PluginSpec[Any, Any]) -> str:
    missing = spec.missing_packages()
    return f"needs {', '.join(missing)}" if missing else "available"


def _methods(options: Selection) -> Rows:
    """Return all methods; one that cannot be imported has the reason."""
    rows: Rows = []
    for name, spec in registry.methods(options.plugins).items():
        try:
            info, state = spec.info, _state(spec)
        except ConfigurationError as error:
            rows.append({"name": name, "title": name, "family": "", "state": "broken", "summary": str(error)})
            continue
        rows.append({"name": name, "title": info.title, "family": info.family, "state": state, "summary": info.summary})
    return rows


def _scorers(options: Selection) -> Rows:
    from benchmark.plugins.scorers import scorers

    return [
        {"name": name, "title": spec.info.title, "state": _state(spec), "summary": spec.info.summary}
        for name, spec in scorers(options.plugins).items()
    ]


def _datasets(options: Selection) -> Rows:
    """Return the data sets, official or generated, present or absent; those of plugin files come last."""
    from benchmark.datasets.catalogue import CATALOGUE, is_present
    from benchmark.datasets.own import open_own, own_sets

    rows = [
        {
            "name": name,
            "kind": "official" if known.folder else "generated",
            "state": "present" if is_present(name, options.data_root) else f"not at {known.folder}",
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
    for own in map(open_own, own_sets(options.plugins).values()):
        classes = {entry.subject for entry in own.shapes}
        facts = {"name": own.name, "kind": "plugin", "state": "present", "shapes": str(len(own.shapes))}
        facts |= {"classes": str(len(classes)), "source": own.code[-1], "summary": own.summary}
        rows.append({**facts, "url": "", "terms": "", "use": "retrieval"})
    return rows


def _tables(options: Selection) -> Rows:
    from benchmark.datasets.catalogue import is_present
    from benchmark.protocols.tables import TABLES

    rows = []
    for table in TABLES:
        present = [name for name in (table.dataset, *table.any_of) if name and is_present(name, options.data_root)]
        none = f"none of {len(table.any_of)} sets is here" if table.any_of else ""
        data = ", ".join(present) or none or f"{table.stand_in} (stand-in for {table.dataset})"
        caption = table.caption_over(len(table.folds))
        rows.append({"table": table.identifier, "dataset": data, "caption": caption})
    return rows


def _models(options: Selection) -> Rows:
    """Return finished models with their training and validation; those trained here precede the shipped ones."""
    from benchmark.api.learning import CARD, Learner, read_card
    from benchmark.pipeline.storage.store import Store
    from benchmark.protocols.models import MODELS_VARIABLE, model_places

    folders = {Store(options.results / "runs").models: "trained here"}
    for method in (spec.create() for spec in registry.methods().values() if spec.learns):
        if isinstance(method, Learner):
            for folder in model_places(method):
                folders.setdefault(folder, "shipped" if folder == method.shipped_models else MODELS_VARIABLE)
    rows = []
    for folder, origin in folders.items():
        for path in sorted(folder.glob(f"*/*/{CARD}")):
            try:
                card = read_card(path.parent)
                digest, schedule = card.digest[:12], card.schedule_in_words
            except ConfigurationError as error:
                digest, schedule = "", f"unusable: {error}"
            row = {"training": path.parent.parent.name, "model": path.parent.name, "origin": origin}
            rows.append({**row, "digest": digest, "schedule": schedule})
    return rows


def describe(method: str, plugins: Iterable[Path], *, as_json: bool) -> None:
    """Print the details of a method."""
    with explained(method, "method"):
        spec = variant(method, registry.methods(plugins))
    facts = _facts(spec)
    if as_json:
        say_lines(json.dumps(facts, indent=1))
        return
    for line in _fact_lines(facts, shutil.get_terminal_size((100, 24)).columns):
        say(line)


def trained_on_people(spec: MethodSpec) -> str:
    """Return a warning if a model was trained on people only; "" otherwise, or if the table determines the model."""
    from benchmark.protocols.trainings import TRAININGS

    if spec.is_foreign or not spec.learns or spec.missing_packages():
        return ""
    folder = getattr(spec.create(), "model_folder", None)
    training = TRAININGS.get(folder.parent.name) if isinstance(folder, Path) else None
    if training is None or training.dataset not in _PEOPLE:
        return ""
    return f"its model of training '{training.name}' was shown people alone: it turns any other shape into a person"


def _facts(spec: MethodSpec) -> dict[str, Any]:
    """Return the details of a method in JSON types."""
    from benchmark.reference.paper import source_of

    info = spec.info
    chosen = {name: format_value(value) for name, value in spec.parameters.items()}
    return {
        "name": spec.name,
        "title": info.title,
        "family": info.family,
        "kind": "learner" if spec.learns else "descriptor" if spec.describes else "method",
        "summary": clean(spec.summary),
        "source": source_of(info.cite),
        "departs": info.departs,
        "inputs": list(info.inputs),
        "scale": info.scale,
        "deterministic": info.deterministic,
        "warning": trained_on_people(spec),
        "requires": list(info.requires),
        "missing": list(spec.missing_packages()),
        "defined_in": spec.target,
        "parameters": [dataclasses.asdict(text) | {"chosen": chosen.get(text.name)} for text in spec.parameter_texts],
    }


def _fact_lines(facts: Mapping[str, Any], width: int) -> list[str]:
    """Return the details as lines: one for each fact, two or more for each parameter."""
    needs = ", ".join(facts["requires"]) or "nothing beyond the core"
    if facts["missing"]:
        needs += f" (not installed: {', '.join(facts['missing'])})"
    rows = {
        "": facts["summary"],
        "kind": f"{facts['kind']}, {_KINDS.get(facts['family'], facts['family'])}",
        "source": facts["source"] or "none",
        "departs": facts["departs"],
        "inputs": " and ".join(facts["inputs"]),
        "scale": facts["scale"],
        "random": "no" if facts["deterministic"] else "yes: the form depends on --seed",
        "warning": facts["warning"],
        "needs": needs,
        "defined in": facts["defined_in"],
    }
    lines = [f"{facts['name']}: {facts['title']}"]
    for name, text in rows.items():
        if text or name not in ("departs", "warning"):
            lines += _wrapped(f"  {name:<12}" if name else "  ", text, width)
    lines.append("  parameters" + ("" if facts["parameters"] else "  none"))
    for parameter in facts["parameters"]:
        chosen = "" if parameter["chosen"] is None else f", here {parameter['chosen']}"
        values = f"{parameter['values']}; default {parameter['default'] or repr('')}{chosen}"
        lines += _wrapped(f"    {parameter['name']:<16}", values, width)
        lines += _wrapped(" " * 20, parameter["meaning"], width) if parameter["meaning"] else []
    return lines


def _wrapped(head: str, text: str, width: int) -> list[str]:
    width = max(20 + len(head), width)
    blank = " " * len(head)
    return textwrap.wrap(clean(text), width, initial_indent=head, subsequent_indent=blank, break_on_hyphens=False) or [
        head
    ]


def new(kind: str, name: str) -> None:
    """Write a plugin of a kind."""
    from benchmark.new import new_method

    if kind != "method":
        raise ConfigurationError(f"there is no template for a {kind}", "copy the one in examples/")
    paths = new_method(name)
    for path in paths:
        say(path)
    say(f"next: edit it, then 'python -m benchmark check {paths[0]}'", err=True)
