"""Tasks as text, to be read on another machine: plain data that names everything and carries no code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import benchmark
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.jobs.foreign.specs import ForeignMethodSpec, ForeignScorerSpec
from benchmark.jobs.orders import Order, Ranking, Share, Task
from benchmark.methods.registry import MethodSpec, variant
from benchmark.methods.scorers import ScorerSpec, scorer_of
from benchmark.protocols.models import Model
from benchmark.storage.keys import plain

#: Folder of this suite: what is shipped with it lies elsewhere on another machine.
SUITE = Path(benchmark.__file__).resolve().parents[1]

Content = dict[str, Any]


@dataclass(frozen=True)
class Letter:
    """A task as JSON; it is opened in the process that does it, for that imports plugins."""

    text: str

    def open(self) -> Task:
        """Read the task; raises ``BenchmarkError`` if a method of it cannot be made here."""
        return read(json.loads(self.text))


def written(task: Task) -> Content:
    """A task as mappings, lists, strings and numbers; paths are absolute.

    Parameters
    ----------
    task
        Shapes to treat, or jobs to rank.
    """
    content: Content = {"orders": [written_order(order) for order in task.orders]}
    return content | {"identifiers": list(task.identifiers)} if isinstance(task, Share) else content


def read(content: Mapping[str, Any]) -> Task:
    """The task that :func:`written` described; raises ``BenchmarkError`` if a method of it cannot be made here."""
    orders = tuple(read_order(order) for order in content["orders"])
    return Share(orders, tuple(content["identifiers"])) if "identifiers" in content else Ranking(orders)


def written_order(order: Order) -> Content:
    """One job as plain data."""
    results = order.results.resolve()
    is_folder = not is_known(order.dataset) and is_path(order.dataset)
    models = {model.digest: model for model in order.models.values()}
    return {
        "key": order.key,
        "facts": plain(order.facts),
        "dataset": str(Path(order.dataset).resolve()) if is_folder else order.dataset,
        "data_root": None if order.data_root is None else str(order.data_root.resolve()),
        "identifiers": list(order.identifiers),
        "input": order.input,
        "method": written_method(order.method),
        "seed": order.seed,
        "models": {digest: _written_model(model, results) for digest, model in models.items()},
        "model_of": {identifier: model.digest for identifier, model in order.models.items()},
        "results": str(results),
        "recipe": plain(order.recipe),
        "all_unseen": order.all_unseen,
        "split_size": order.split_size,
        "scorer": written_scorer(order.scorer),
    }


def read_order(content: Mapping[str, Any]) -> Order:
    """The job that :func:`written_order` described."""
    results = Path(content["results"])
    models = {digest: _read_model(found, results) for digest, found in content["models"].items()}
    return Order(
        key=content["key"],
        facts=content["facts"],
        dataset=content["dataset"],
        data_root=None if content["data_root"] is None else Path(content["data_root"]),
        identifiers=tuple(content["identifiers"]),
        input=content["input"],
        method=read_method(content["method"]),
        seed=content["seed"],
        models={identifier: models[digest] for identifier, digest in content["model_of"].items()},
        results=results,
        recipe=content["recipe"],
        all_unseen=content["all_unseen"],
        split_size=content["split_size"],
        scorer=read_scorer(content["scorer"]),
    )


def written_method(spec: MethodSpec) -> Content:
    """A method by its name with parameters, in their one spelling, and where its class is."""
    return {"name": spec.name, "base_name": spec.base_name, "target": spec.target, "named": spec.named}


def read_method(content: Mapping[str, Any]) -> MethodSpec:
    """The method that :func:`written_method` described; raises ``ConfigurationError`` if there is none such here."""
    base = MethodSpec(content["base_name"], content["target"], named=content["named"])
    if base.is_foreign:
        return ForeignMethodSpec(base.base_name, base.target, named=base.named, spelling=content["name"])
    return variant(content["name"], {base.base_name: base})


def written_scorer(spec: ScorerSpec) -> Content:
    """A scorer by its name, where its class is, and its parameters in their one spelling."""
    return {"name": spec.name, "base_name": spec.base_name, "target": spec.target}


def read_scorer(content: Mapping[str, Any]) -> ScorerSpec:
    """The scorer that :func:`written_scorer` described; raises ``ConfigurationError`` if there is none such here."""
    base = ScorerSpec(content["base_name"], content["target"])
    if base.is_foreign:
        return ForeignScorerSpec(base.base_name, base.target, spelling=content["name"])
    return scorer_of(content["name"], {base.base_name: base})


def model_folder(place: list[str], results: Path) -> Path:
    """Where a model lies on this machine.

    Parameters
    ----------
    place
        ``["suite" | "results" | "path", name]``.
    results
        Results folder here.
    """
    kind, name = place
    return {"suite": SUITE, "results": results, "path": Path()}[kind] / name


def _written_model(model: Model, results: Path) -> Content:
    folder = model.folder.resolve()
    for kind, root in (("suite", SUITE), ("results", results)):
        if folder.is_relative_to(root) and not (kind == "suite" and folder.is_relative_to(results)):
            return {"training": model.training, "place": [kind, str(folder.relative_to(root))], "card": model.card}
    return {"training": model.training, "place": ["path", str(folder)], "card": model.card}


def _read_model(content: Mapping[str, Any], results: Path) -> Model:
    return Model(content["training"], model_folder(content["place"], results), content["card"])
