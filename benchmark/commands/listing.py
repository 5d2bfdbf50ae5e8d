"""What there is: methods, scorers, data sets, tables and models, and the details of a component."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

from benchmark.api.learning import CARD, read_card
from benchmark.api.parameters import format_value
from benchmark.commands.canonicalise import trained_on_people
from benchmark.commands.selection import RESULTS, as_paths, data_folder
from benchmark.datasets.catalogue import CATALOGUE, is_present
from benchmark.errors import ConfigurationError, check_known
from benchmark.protocols.models import MODELS_VARIABLE, model_places
from benchmark.protocols.tables import TABLES
from benchmark.reference.paper import entry_of, source_of
from benchmark.registry import Component, by_name, select_one
from benchmark.registry.names import split_parameters
from benchmark.text import clean_text

#: What there are names of.
KindOfName = Literal["methods", "scorers", "datasets", "tables", "models"]

#: Facts by name, a mapping for each method, data set, ...
_Facts = list[dict[str, str]]

#: What is random in most methods. Iterations that start at random have a fixed seed in the code.
_SEEDLESS = "nothing: --seed does not change the form"


def listing(
    what: KindOfName,
    *,
    plugins: str | Path | Iterable[str | Path] = (),
    results: str | Path = RESULTS,
    data_root: str | Path | None = None,
) -> _Facts:
    """Return the methods, scorers, data sets, tables or models that there are.

    Parameters
    ----------
    what
        ``"methods"``, ``"scorers"``, ``"datasets"``, ``"tables"`` or ``"models"``.
    plugins
        Plugin files of methods and scorers.
    results, data_root
        The results folder with models; the folder of the official data sets.

    Raises
    ------
    ConfigurationError
        If there is no such list, or a plugin cannot be loaded.
    """
    check_known("list", [what], get_args(KindOfName))
    if what == "datasets":
        return _datasets(data_folder(data_root))
    if what == "tables":
        return _tables(data_folder(data_root))
    if what == "models":
        return _models(Path(results))
    kind: Literal["method", "scorer"] = "method" if what == "methods" else "scorer"
    components = by_name(kind, as_paths(plugins))
    return [_facts_of(name, component) for name, component in components.items()]


def find_component(name: str, plugins: Sequence[Path] = ()) -> Component:
    """Return a method or a scorer by its name."""
    base, _ = split_parameters(name)
    is_scorer = base in by_name("scorer", plugins)
    return select_one(name, plugins, "scorer" if is_scorer else "method")


def describe(name: str, plugins: str | Path | Iterable[str | Path] = ()) -> dict[str, Any]:
    """Return the details of a method or a scorer, with its ``parameters`` as text.

    Parameters
    ----------
    name
        Its name, with parameters in brackets.
    plugins
        Plugin files that may define it.

    Raises
    ------
    ConfigurationError
        If there is no such method or scorer.
    """
    component = find_component(name, as_paths(plugins))
    return {**details_of(component), "parameters": parameters_of(component)}


def parameters_of(component: Component) -> dict[str, str]:
    """Return the parameters of a method or a scorer, as text."""
    values = component.defaults | {**component.parameters}
    return {name: format_value(value) for name, value in values.items()}


def details_of(component: Component) -> dict[str, str | list[str]]:
    """Return the details of a method or a scorer, by name: texts, and lists of texts."""
    info = component.info
    is_method = component.kind == "method"
    details: dict[str, str | list[str]] = {
        "name": component.name,
        "title": info.title,
        "summary": clean_text(component.summary),
        "kind": _kind_of(component),
        "family": info.family if is_method else "",
        "source": source_of(info.cite) or "none",
        "cite": entry_of(info.cite)[0],
    }
    if is_method:
        details["departs"] = info.departs
        details["inputs"] = list(info.inputs)
        details["scale"] = info.scale
        details["random"] = _SEEDLESS if info.deterministic else "the form depends on --seed"
        details["warning"] = trained_on_people(component)
    else:
        details["draws"] = str(info.draws)
    details["requires"] = list(info.requires)
    details["missing"] = list(component.missing_packages())
    details["defined in"] = component.target
    return details


def _kind_of(component: Component) -> str:
    """Return what a component is: a learner, a descriptor, another method, or a scorer."""
    if component.learns:
        return "learner"
    if component.describes:
        return "descriptor"
    return component.kind


def _facts_of(name: str, component: Component) -> dict[str, str]:
    """Return what the list of methods or scorers says of one of them.

    Parameters
    ----------
    name
        Its name.
    component
        The method or scorer.

    Returns
    -------
    dict of str
        ``name``, ``title``, ``family`` of a method, ``state`` and ``summary``. The state is
        ``"available"``, ``"needs ..."`` for missing packages, or ``"broken"`` if it cannot be
        imported; the summary then says why.
    """
    try:
        facts = {"name": name, "title": component.info.title}
        if component.kind == "method":
            facts["family"] = component.info.family
        missing = component.missing_packages()
        facts["state"] = f"needs {', '.join(missing)}" if missing else "available"
        facts["summary"] = component.summary
    except ConfigurationError as error:
        return {
            "name": name,
            "title": name,
            "family": "",
            "state": "broken",
            "summary": str(error),
        }
    return facts


def _datasets(root: Path | None) -> _Facts:
    """Return facts about each data set, official or generated, as texts by name.

    Parameters
    ----------
    root
        Folder of the official sets, in which they are looked for.
    """
    return [
        {
            "name": name,
            "kind": "official" if dataset.folder else "generated",
            "state": "present" if is_present(name, root) else f"not at {dataset.folder}",
            "shapes": str(dataset.n_shapes or "?"),
            "classes": str(dataset.n_classes),
            "source": dataset.origin or "generated",
            "summary": dataset.summary,
            "url": dataset.url,
            "terms": dataset.terms,
            "use": dataset.other_use or "retrieval",
        }
        for name, dataset in CATALOGUE.items()
    ]


def _tables(root: Path | None) -> _Facts:
    """Return the tables with the data that they would be made of here."""
    tables = []
    for table in TABLES:
        data = "not here"
        if is_present(table.dataset, root):
            data = table.dataset
        elif table.stand_ins:
            data = f"{', '.join(table.stand_ins)} (stand-in for {table.dataset})"
        tables.append({"table": table.identifier, "dataset": data, "caption": table.caption})
    return tables


def _models(results: Path) -> _Facts:
    """Return facts about each finished model: where it comes from, and how it was trained.

    Models that were trained here come first.
    """
    origins = {results / "models": "trained here"}  # of the models in a folder
    for component in by_name("method").values():
        if not component.learns:
            continue
        learner = component.create()
        for folder in model_places(learner):
            is_shipped = folder == learner.shipped_models
            origins.setdefault(folder, "shipped" if is_shipped else MODELS_VARIABLE)
    models = []
    for folder, origin in origins.items():
        for path in sorted(folder.glob(f"*/*/{CARD}")):  # TRAINING/MODEL
            model = path.parent
            facts = {"training": model.parent.name, "model": model.name, "origin": origin}
            models.append({**facts, **_card_facts(model)})
    return models


def _card_facts(folder: Path) -> dict[str, str]:
    """Return the digest and the schedule of a model; of an unusable one, why it is."""
    try:
        card = read_card(folder)
    except ConfigurationError as error:
        return {"digest": "", "schedule": f"unusable: {error}"}
    return {"digest": card.digest[:12], "schedule": card.schedule_in_words}
