"""What there is: methods, scorers, data sets, tables and models, and the details of a component."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from benchmark.api.learning import CARD, read_card
from benchmark.api.parameters import format_value
from benchmark.commands.canonicalise import trained_on_people
from benchmark.commands.selection import RESULTS, data_folder
from benchmark.datasets.catalogue import CATALOGUE, is_present
from benchmark.errors import ConfigurationError
from benchmark.protocols.models import MODELS_VARIABLE, model_places
from benchmark.protocols.tables import TABLES
from benchmark.reference.paper import entry_of, source_of
from benchmark.registry import Component, by_name, select_one
from benchmark.registry.names import split_parameters
from benchmark.text import clean_text

Rows = list[dict[str, str]]


def listing(
    what: str,
    *,
    plugins: Sequence[Path] = (),
    results: Path = RESULTS,
    data_root: Path | None = None,
) -> Rows:
    """Return the methods, scorers, datasets, tables or models that there are, a mapping of facts each.

    Parameters
    ----------
    what
        ``"methods"``, ``"scorers"``, ``"datasets"``, ``"tables"`` or ``"models"``.
    plugins
        Plugin files of methods and scorers.
    results, data_root
        The results folder with models; the folder of the official data sets.
    """
    if what == "datasets":
        return _datasets(data_folder(data_root))
    if what == "tables":
        return _tables(data_folder(data_root))
    if what == "models":
        return _models(results)
    return _components("method" if what == "methods" else "scorer", plugins)


def find_component(name: str, plugins: Sequence[Path] = ()) -> Component:
    """Return a method or a scorer by its name."""
    is_scorer = split_parameters(name)[0] in by_name("scorer", plugins)
    return select_one(name, plugins, "scorer" if is_scorer else "method")


def parameters_of(component: Component) -> dict[str, str]:
    """Return the parameters of a method or a scorer, as text."""
    values = component.defaults | {**component.parameters}
    return {name: format_value(value) for name, value in values.items()}


def details_of(component: Component) -> dict[str, str | list[str]]:
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
        "summary": clean_text(component.summary),
        "kind": kind,
        "family": info.family if facts else "",
        "source": source_of(info.cite) or "none",
        "cite": entry_of(info.cite)[0],
        **(facts or {"draws": str(info.draws)}),
        "requires": list(info.requires),
        "missing": list(component.missing_packages()),
        "defined in": component.target,
    }


def _components(kind: Literal["method", "scorer"], plugins: Sequence[Path]) -> Rows:
    """Return methods or scorers; one that cannot be imported has the reason."""
    rows: Rows = []
    for name, component in by_name(kind, plugins).items():
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


def _datasets(root: Path | None) -> Rows:
    """Return the data sets, official or generated, present or absent."""
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


def _tables(root: Path | None) -> Rows:
    rows = []
    for table in TABLES:
        stand_in = (
            f"{', '.join(table.stand_ins)} (stand-in for {table.dataset})"
            if table.stand_ins
            else "not here"
        )
        data = table.dataset if is_present(table.dataset, root) else stand_in
        rows.append({"table": table.identifier, "dataset": data, "caption": table.caption})
    return rows


def _models(results: Path) -> Rows:
    """Return finished models with their training; those trained here precede the shipped ones."""
    folders = {results / "models": "trained here"}
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
