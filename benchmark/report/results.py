"""Records that a table is made of, and whether this code would make them again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.datasets.catalogue import CATALOGUE, is_present
from benchmark.datasets.jittered import parsed_jitter
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.jobs import recipes
from benchmark.jobs.plan import data_recipe, what_changed
from benchmark.methods.registry import MethodSpec, variant
from benchmark.methods.scorers import DEFAULT, ScorerSpec, scorer_of, scorers
from benchmark.protocols.galleries import Gallery, galleries, gallery_name
from benchmark.protocols.models import find_models
from benchmark.protocols.tables import TABLES
from benchmark.report.outdated_cache import OutdatedCache
from benchmark.storage import keys
from benchmark.storage.records import Place, Record, by_place, models_proven_by, scorer_name
from benchmark.storage.store import Store
from benchmark.system.fingerprints import parse_cache
from benchmark.system.plugins import is_imported

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
    repeats
        Records of the same with jittered preparations, by the number of the jitter; those with scores.
    """

    record: Record
    outdated: str = ""
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
    _work: dict[tuple[str, str, str, Input], dict[str, Any]] = field(default_factory=dict, repr=False)

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
        is_known = all(self._known(record) is not None for rivals in wanted for record in rivals)
        with nullcontext() if is_known else parse_cache():
            results = [self._best(rivals) for rivals in wanted]
        self._outdated_cache.write()
        return with_repeats(result for result in results if not (fresh and result.outdated))

    def records(self, *, heads: bool = False) -> list[Record]:
        """All records, or their heads alone; of one job the one that was made here."""
        folders = (self.store.published, self.store.records)
        found = (record for folder in folders for record in (folder.heads() if heads else folder))
        return list({record["key"]: record for record in found}.values())

    def whole(self, head: Record) -> Record:
        """Return the record of a head, or the head itself where it has gone meanwhile."""
        key = head["key"]
        return self.store.records.read(key, again=True) or self.store.published.read(key, again=True) or head

    def _best(self, records: Iterable[Record]) -> Result:
        results = [Result(record, self.outdated(record)) for record in records]

        def worth(result: Result) -> tuple[bool, bool, str, str]:
            record = result.record
            here = "unavailable" not in record["recipe"]
            return (
                not result.outdated and here,
                record["status"] == "ok",
                str(record.get("finished", "")),
                record["key"],
            )

        return max(results, key=worth)

    def outdated(self, record: Record) -> str:
        """Say what has changed since a record was made, as far as can be told; "" if nothing has."""
        if (told := self._known(record)) is not None:
            return told
        told = self._outdated(record)
        return self._outdated_cache.add(record, told) if self._is_of_suite(record) else told

    def _known(self, record: Record) -> str | None:
        """Return what earlier processes have found out."""
        if "unavailable" in record["recipe"]:
            return ""
        return self._outdated_cache.told(record) if self._is_of_suite(record) else None

    @cached_property
    def _outdated_cache(self) -> OutdatedCache:
        return OutdatedCache(self.store, self.data_root)

    def _is_of_suite(self, record: Record) -> bool:
        """Return whether no plugin has a part in a record."""
        specs = (self.known.get(_base(record["method"])), self.known_scorers.get(_base(scorer_name(record) or DEFAULT)))
        is_own = any(spec is None or spec.is_foreign for spec in specs)
        return not is_own and _base(record["data"]["name"]) in CATALOGUE

    def _outdated(self, record: Record) -> str:
        then = record["recipe"]
        try:
            now = self._recipe_now(record)
        except BenchmarkError:
            return ""  # an unknown plugin, or a method that cannot be imported here
        known_then = {part: then.get(part) for part in now}
        return "" if keys.plain(now) == known_then else what_changed(record, now)

    def _recipe_now(self, record: Record) -> dict[str, Any]:
        """The parts of the recipe that can be told without the data, and with it where it is here."""
        what = (record["method"], scorer_name(record) or DEFAULT, str(record["data"]["module"]), record["input"])
        if what not in self._work:  # galleries share it
            self._work[what] = self._work_now(*what)
        now = dict(self._work[what])
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

    def _work_now(self, method: str, compared_by: str, module: str, input_: Input) -> dict[str, Any]:
        """Parameters and code of a method and a scorer on a set from a module."""
        spec, scorer = variant(method, self.known), scorer_of(compared_by, self.known_scorers)
        if module.endswith(".py") and not is_imported(module):
            raise ConfigurationError(f"the plugin {module} was not passed", "pass it with --plugin")
        return {
            "parameters": spec.resolved_parameters(),
            "scorer": recipes.scorer_recipe(scorer),
            "code": recipes.job_code(module, input_, spec, scorer),
        }

    def _gallery(self, record: Record) -> Gallery | None:
        """The gallery of a record, where it belongs to a table and its data is here."""
        name, quick = record["data"]["name"], bool(record["data"]["quick"])
        if name not in CATALOGUE or not is_present(name, self.data_root):
            return None
        if (name, quick) not in self._galleries:
            tables = [t.identifier for t in TABLES if name in t.datasets and not (quick and t.ablation)]
            found = galleries(tables, [name], self.data_root, quick)
            self._galleries[name, quick] = {gallery.name: gallery for gallery in found}
        return self._galleries[name, quick].get(record["gallery"])


def _base(name: str) -> str:
    """Return a name without its parameters."""
    return name.partition("[")[0]


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
    parts = ("parameters", "models", "seed", "scorer")
    then, now = record["recipe"], of["recipe"]
    code = [{**each.get("code", {}), "source": None} for each in (then, now)]
    return code[0] == code[1] and all(then.get(part) == now.get(part) for part in parts)


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
