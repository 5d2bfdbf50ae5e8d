"""Records that a table is made of, and whether this code would make them again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.datasets.catalogue import CATALOGUE, is_present
from benchmark.datasets.jittered import parsed_jitter
from benchmark.datasets.own import sources_in
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.execution.plan import data_recipe, difference
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.environment import changed_packages
from benchmark.pipeline.storage.lock import edited, key_of, read_lock, words_of_edit
from benchmark.pipeline.storage.records import EXTERNAL, Place, Record, by_place, models_proven_by, scorer_name
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.inspection import is_passed
from benchmark.plugins.registry import MethodSpec, variant
from benchmark.plugins.scorers import DEFAULT, ScorerSpec, scorer_of, scorers
from benchmark.protocols.galleries import Gallery, galleries, gallery_name
from benchmark.protocols.models import find_models
from benchmark.protocols.tables import TABLES

__all__ = ["Result", "Results", "with_repeats"]


@dataclass(frozen=True)
class Result:
    """The record that stands for one method on one gallery under one input.

    Parameters
    ----------
    record
        What the job kept.
    outdated
        What has changed since it was made; "" where nothing has, or nobody can tell.
    origin
        ``"here"`` if it was made in this results folder, ``"published"`` if it came with the suite.
    repeats
        Records of the same with jittered preparations, by the number of the jitter; those with scores.
    """

    record: Record
    outdated: str = ""
    origin: str = ""
    repeats: Mapping[int, Record] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Results:
    """The records of a results folder, those made here and those that came with it.

    Parameters
    ----------
    store
        The folder.
    known
        Methods by name; of others nobody can tell whether their records are up to date.
    data_root
        The folder that holds the official sets; what is absent is taken as recorded.
    known_scorers
        Scorers by name.
    """

    store: Store
    known: Mapping[str, MethodSpec]
    data_root: Path | None = None
    known_scorers: Mapping[str, ScorerSpec] = field(default_factory=scorers)
    _galleries: dict[tuple[str, bool], dict[str, Gallery]] = field(default_factory=dict, repr=False)
    _data: dict[tuple[str, bool, str, str], dict[str, Any]] = field(default_factory=dict, repr=False)
    _shapes: dict[tuple[str, str], str] = field(default_factory=dict, repr=False)
    _outdated: dict[str, str] = field(default_factory=dict, repr=False)

    def all(
        self, seed: int = 0, *, fresh: bool = False, scorer: str = DEFAULT,
        places: Mapping[Place, list[Record]] | None = None,
    ) -> list[Result]:  # fmt: skip
        """One result for each place: the newest that this code would make again, else the newest with scores.

        Jittered preparations have no place of their own: they go with the result that they repeat.

        Parameters
        ----------
        seed
            Base seed of the runs to look at.
        fresh
            Whether to leave out what is outdated.
        scorer
            Name of the scorer; descriptors, which have none, are in whatever it is.
        places
            What :meth:`records` gave, by place, for a caller that asks several times; None reads them anew.
        """
        wanted = [
            rivals
            for place, rivals in (by_place(self.records()) if places is None else places).items()
            if place.seed == seed and (place.scorer == scorer or not all(map(scorer_name, rivals)))
        ]
        results = [self._best(rivals) for rivals in wanted]
        return with_repeats(result for result in results if not (fresh and result.outdated))

    def records(self) -> list[Record]:
        """All records but those of edits that are undone; of one job the one that was made here."""
        folders = (self.store.published, self.store.records)
        records = {record["key"]: record for folder in folders for record in folder}
        return [record for key, record in records.items() if "-" not in key or key_of(record["recipe"]) == key]

    def _best(self, records: Iterable[Record]) -> Result:
        here = self.store.records
        results = [
            Result(record, self.outdated(record), "here" if record["key"] in here else "published")
            for record in records
        ]

        def worth(result: Result) -> tuple[bool, bool, bool, str, str]:
            record = result.record
            is_available = "unavailable" not in record["recipe"]
            return (
                "-" in record["key"],
                not result.outdated and is_available,
                record["status"] == "ok",
                str(record.get("finished", "")),
                record["key"],
            )

        return max(results, key=worth)

    def outdated(self, record: Record) -> str:
        """Say what has changed since a record was made, as far as can be told; "" if nothing has."""
        if record["key"] not in self._outdated:
            self._outdated[record["key"]] = self._what_changed(record)
        return self._outdated[record["key"]]

    def _what_changed(self, record: Record) -> str:
        recipe = record["recipe"]
        if "unavailable" in recipe:
            return ""
        if not self.store.published_only and (folders := edited(recipe.get("versions", ()))):
            return words_of_edit(folders)
        try:
            now = self._recipe_now(record)
        except BenchmarkError:
            return ""  # an unknown plugin, or a method that cannot be imported here
        if keys.plain(now) != {part: recipe.get(part) for part in now}:
            return difference(record["recipe"], now)
        return changed_packages(record.get("environments", ()))

    def _recipe_now(self, record: Record) -> dict[str, Any]:
        """The parts of the recipe that can be told without the data, and with it where it is here."""
        recipe, components = record["recipe"], read_lock().components
        now: dict[str, Any] = {
            "versions": {name: components[name].golden for name in recipe.get("versions", {}) if name in components}
        }
        if "plugin" in recipe:
            now["plugin"] = self._plugins_now(record)
        gallery = self._gallery(record)
        if gallery is None:
            return now
        place = (gallery.source, gallery.quick, gallery.name, record["input"])
        if place not in self._data:  # all methods share it
            self._data[place] = data_recipe(gallery, record["input"], self._shapes)
        now |= self._data[place]
        if "models" in record["recipe"]:
            try:
                spec, here = variant(record["method"], self.known), self.store.models
                models = find_models(spec, gallery, here, models_proven_by(record))
            except BenchmarkError:
                return now  # its models are elsewhere
            now["models"] = {model.training: model.digest for model in models.values()}
        return now

    def _plugins_now(self, record: Record) -> dict[str, str]:
        """Sources of the plugins of a record; raises ``ConfigurationError`` if one was not passed."""
        module, compared_by = str(record["data"]["module"]), scorer_name(record)
        sources: dict[str, str] = {}
        if module.endswith(".py"):
            if not is_passed(module):
                raise ConfigurationError(f"the plugin {module} was not passed", "pass it with --plugin")
            sources |= sources_in(module)
        sources |= variant(record["method"], self.known).sources
        return sources | (scorer_of(compared_by, self.known_scorers).sources if compared_by else {})

    def _gallery(self, record: Record) -> Gallery | None:
        """The gallery of a record, where it belongs to a table and its data is here."""
        name, quick = record["data"]["name"], bool(record["data"]["quick"])
        if record["family"] == EXTERNAL or name not in CATALOGUE or not is_present(name, self.data_root):
            return None
        if (name, quick) not in self._galleries:
            self._galleries[name, quick] = galleries_of(name, self.data_root, quick=quick)
        return self._galleries[name, quick].get(record["gallery"])


def galleries_of(source: str, data_root: Path | None, *, quick: bool) -> dict[str, Gallery]:
    """Return the galleries of a data set by name, of all its tables; raises ``BenchmarkError`` without its data."""
    tables = [table.identifier for table in TABLES if source in table.datasets and not (quick and table.ablation)]
    return {gallery.name: gallery for gallery in galleries(tables, [source], data_root, quick)}


def with_repeats(results: Iterable[Result]) -> list[Result]:
    """Return the clean results, each with its jittered preparations that the same code made with the same settings."""
    clean: list[Result] = []
    found: dict[tuple[str, str, str, str], dict[int, Record]] = {}
    for result in results:
        record, name = result.record, str(result.record["data"]["name"])
        if jitter := parsed_jitter(name):
            gallery = jitter[0] + record["gallery"].removeprefix(name)
            if record["status"] == "ok":
                found.setdefault(_repeated(record, gallery), {})[jitter[1]] = record
        else:
            clean.append(result)

    def repeats(result: Result) -> dict[int, Record]:
        record = result.record
        rivals = found.get(_repeated(record, record["gallery"]), {})
        return {number: rivals[number] for number in sorted(rivals) if _is_repeat(rivals[number], record)}

    return [replace(result, repeats=repeats(result)) for result in clean] if found else clean


def _repeated(record: Record, gallery: str) -> tuple[str, str, str, str]:
    """Return what two records share if one of them may repeat the other."""
    return gallery, str(record["input"]), str(record["method"]), scorer_name(record)


def _is_repeat(record: Record, of: Record) -> bool:
    """Return whether two records differ in nothing but the source of their shapes."""
    parts = ("parameters", "models", "seed", "scorer", "plugin")
    then, now = record["recipe"], of["recipe"]
    versions, clean = then.get("versions", {}), now.get("versions", {})
    is_same_code = {name: version for name, version in versions.items() if name != "change/jitter"} == clean
    return is_same_code and all(then.get(part) == now.get(part) for part in parts)


@cache
def tables_of(gallery: str, dataset: str, *, quick: bool) -> tuple[str, ...]:
    """Identifiers of the tables in which a gallery is shown; a set that no table uses has one of its own."""
    names = tuple(
        table.identifier
        for table in TABLES
        if dataset in table.datasets
        and gallery in [gallery_name(dataset, part, quick=quick) for part in table.parts]
        and not (quick and table.ablation)
    )
    return names or (dataset,)
