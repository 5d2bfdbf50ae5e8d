"""Rows of ``list``, as plain values."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.errors import ConfigurationError

if TYPE_CHECKING:
    from benchmark.protocols.tables import Table

Rows = list[dict[str, str]]


def methods(plugins: Iterable[Path] = ()) -> Rows:
    """Name, family, availability and summary of each method, and of each variant that has rows of its own.

    A method that cannot be imported says why.
    """
    from benchmark.plugins import registry
    from benchmark.protocols.tables import VARIANTS

    rows: Rows = []
    for name, spec in registry.methods(plugins).items():
        try:
            info, missing = spec.info, spec.missing_packages()
        except ConfigurationError as error:
            rows.append({"name": name, "title": name, "family": "", "state": "broken", "summary": str(error)})
            continue
        state = f"needs {', '.join(missing)}" if missing else "available"
        rows.append({"name": name, "title": info.title, "family": info.family, "state": state, "summary": info.summary})
        for variant in map(spec.with_parameters, VARIANTS.get(name, ())):
            chosen = ", ".join(f"{key}={value}" for key, value in variant.parameters.items())
            other = {"name": variant.name, "title": variant.title, "family": "extended", "summary": f"with {chosen}"}
            rows.append({**rows[-1], **other})
    return rows


def scorers(plugins: Iterable[Path] = ()) -> Rows:
    """Name, availability and summary of each scorer."""
    from benchmark.plugins.scorers import scorers as known

    rows = []
    for name, spec in known(plugins).items():
        missing = spec.missing_packages()
        state = f"needs {', '.join(missing)}" if missing else "available"
        rows.append({"name": name, "title": spec.info.title, "state": state, "summary": spec.info.summary})
    return rows


def datasets(data_root: Path | None, plugins: Iterable[Path] = ()) -> Rows:
    """Name, presence, size and source of each data set, those of plugin files last."""
    from benchmark.datasets.catalogue import CATALOGUE, is_present
    from benchmark.datasets.own import data_sets_of, open_own

    opened = [open_own(source) for source in data_sets_of(plugins).values()]
    return [
        {
            "name": name,
            "kind": "official" if known.folder else "generated",
            "state": "present" if is_present(name, data_root) else f"not at {known.folder}",
            "shapes": str(known.n_shapes or "?"),
            "classes": str(known.n_classes),
            "source": known.origin or "generated",
            "summary": known.summary,
            "url": known.url,
            "terms": known.terms,
            "use": known.other_use or "retrieval",
        }
        for name, known in CATALOGUE.items()
    ] + [
        {
            "name": own.name,
            "kind": "plugin",
            "state": "present",
            "shapes": str(len(own.entries)),
            "classes": str(len({entry.subject for entry in own.entries})),
            "source": own.code,
            "summary": own.made.info.summary,
            "url": "",
            "terms": "",
            "use": "retrieval",
        }
        for own in opened
    ]


def tables(data_root: Path | None) -> Rows:
    """Numeral, the data set that would be used, and caption of each table."""
    from benchmark.protocols.tables import TABLES

    return [
        {
            "table": table.identifier,
            "dataset": _data_of(table, data_root),
            "caption": table.caption_over(len(table.folds)),
        }
        for table in TABLES
    ]


def _data_of(table: Table, data_root: Path | None) -> str:
    from benchmark.datasets.catalogue import is_present

    present = [name for name in (table.dataset, *table.any_of) if name and is_present(name, data_root)]
    if present or table.any_of:
        return ", ".join(present) or f"none of {len(table.any_of)} sets is here"
    return f"{table.stand_in} (stand-in for {table.dataset})"


def models(results: Path) -> Rows:
    """Finished models, those trained here before the shipped ones: what made them, and how well they do."""
    from benchmark.api.learning import CARD, Learner, read_card
    from benchmark.pipeline.storage.store import Store
    from benchmark.plugins import registry
    from benchmark.protocols.models import MODELS_VARIABLE, model_places

    folders = {Store(results / "runs").models: "trained here"}
    for spec in registry.methods().values():
        method = spec.create() if spec.learns else None
        if isinstance(method, Learner):
            for folder in model_places(method):
                folders.setdefault(folder, "shipped" if folder == method.shipped_models else MODELS_VARIABLE)
    rows = []
    for folder, origin in folders.items():
        for path in sorted(folder.glob(f"*/*/{CARD}")):
            try:
                card = read_card(path.parent)
                digest, schedule = card["digest"][:12], str(card.get("schedule_in_words", ""))
            except ConfigurationError as error:
                digest, schedule = "", f"unusable: {error}"
            rows.append(
                {
                    "training": path.parent.parent.name,
                    "model": path.parent.name,
                    "origin": origin,
                    "digest": digest,
                    "schedule": schedule,
                }
            )
    return rows
