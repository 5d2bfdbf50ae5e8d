"""Select the records of tables, detect outdated ones, and compute the values of each row."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.datasets.catalogue import CATALOGUE, is_present
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.execution.plan import data_recipe, difference
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.environment import changed_packages
from benchmark.pipeline.storage.lock import edited, read_lock, words_of_edit
from benchmark.pipeline.storage.records import (
    EXTERNAL,
    OTHER_SHAPES,
    Place,
    Record,
    by_place,
    chance_of,
    coverage_of,
    scorer_name,
)
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.inspection import is_passed
from benchmark.plugins.registry import MethodSpec, variant
from benchmark.plugins.scorers import DEFAULT, ScorerSpec, scorer_of, scorers
from benchmark.protocols.galleries import Gallery, galleries, gallery_name
from benchmark.protocols.models import find_models
from benchmark.protocols.tables import TABLES
from benchmark.report.significance import UNIT

__all__ = ["MISSING", "Figures", "Result", "Results", "line_of"]


@dataclass(frozen=True)
class Result:
    """The record for one method on one gallery with one input.

    Parameters
    ----------
    record
        The record of the job.
    outdated
        Change since it was computed; "" if nothing changed or it is unknown.
    origin
        ``"here"`` if it ran in this results folder, ``"published"`` if it came with the suite.
    """

    record: Record
    outdated: str = ""
    origin: str = ""


@dataclass(frozen=True)
class Results:
    """The records of a results folder, both local and published.

    Parameters
    ----------
    store
        Store of the folder.
    known
        Methods by name; it is unknown whether records of others are outdated.
    data_root
        The folder of the official data sets; missing data are assumed to be as recorded.
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

    def all(
        self, seed: int = 0, *, fresh: bool = False, scorer: str = DEFAULT,
        places: Mapping[Place, list[Record]] | None = None,
    ) -> list[Result]:  # fmt: skip
        """Return one result for each place: the newest that is up to date, otherwise the newest with scores.

        Parameters
        ----------
        seed
            Base seed of the runs.
        fresh
            Whether to omit outdated results.
        scorer
            Name of the scorer; descriptors, which have none, are always included.
        places
            Records by place, for repeated calls; None reads them again.
        """
        wanted = [
            rivals
            for place, rivals in sorted((by_place(self.store.all_records()) if places is None else places).items())
            if place.seed == seed and (place.scorer == scorer or not all(map(scorer_name, rivals)))
        ]
        results = _of_same_shapes([self._best(rivals) for rivals in wanted])
        return [result for result in results if not (fresh and result.outdated)]

    def _best(self, records: Iterable[Record]) -> Result:
        own = self.store.records
        results = [
            Result(record, self.outdated(record), "here" if record["key"] in own else "published") for record in records
        ]

        def worth(result: Result) -> tuple[bool, bool, bool, str, str]:
            record = result.record
            is_available = "unavailable" not in record["recipe"]
            return (
                keys.is_edited(record["key"]),
                not result.outdated and is_available,
                record["status"] == "ok",
                str(record.get("finished", "")),
                record["key"],
            )

        return max(results, key=worth)

    def outdated(self, record: Record) -> str:
        """Describe what changed since a record was computed, as far as known; "" if nothing did."""
        recipe = record["recipe"]
        if "unavailable" in recipe:
            return ""
        if not self.store.published_only and (folders := edited(recipe.get("versions", ()))):
            return words_of_edit(folders)
        try:
            now = self._recipe_now(record)
        except BenchmarkError:
            return ""  # an unknown plugin, or a method that cannot be imported
        if keys.plain(now) != {part: recipe.get(part) for part in now}:
            return difference(record["recipe"], now)
        return changed_packages(record.get("environments", ()))

    def _recipe_now(self, record: Record) -> dict[str, Any]:
        """Return the current recipe, as far as it is known with the available data."""
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
        if place not in self._data:  # shared by all methods
            self._data[place] = data_recipe(gallery, record["input"], self._shapes)
        now |= self._data[place]
        if "models" in record["recipe"]:
            try:
                spec, trained = variant(record["method"], self.known), self.store.models
                models = find_models(spec, gallery, trained)
            except BenchmarkError:
                return now  # its models are missing
            now["models"] = {model.training: model.digest for model in models.values()}
        return now

    def _plugins_now(self, record: Record) -> dict[str, str]:
        """Return the sources of the plugins of a record; raise ``ConfigurationError`` if one was not passed."""
        module, compared_by = str(record["data"]["module"]), scorer_name(record)
        sources: dict[str, str] = {}
        if module.endswith(".py") and not is_passed(module):
            raise ConfigurationError(f"the plugin {module} was not passed", "pass it with --plugin")
        sources |= variant(record["method"], self.known).sources
        return sources | (scorer_of(compared_by, self.known_scorers).sources if compared_by else {})

    def _gallery(self, record: Record) -> Gallery | None:
        """Return the gallery of a record, if it belongs to a table and its data are available."""
        name, quick = record["data"]["name"], bool(record["data"]["quick"])
        if record["family"] == EXTERNAL or name not in CATALOGUE or not is_present(name, self.data_root):
            return None
        if (name, quick) not in self._galleries:
            self._galleries[name, quick] = galleries_of(name, self.data_root, quick=quick)
        return self._galleries[name, quick].get(record["gallery"])


def galleries_of(source: str, data_root: Path | None, *, quick: bool) -> dict[str, Gallery]:
    """Return the galleries of a data set in all tables, by name; raise ``BenchmarkError`` without its data."""
    tables = [table.identifier for table in TABLES if source in table.datasets and not (quick and table.ablation)]
    return {gallery.name: gallery for gallery in galleries(tables, [source], data_root, quick)}


def _of_same_shapes(results: list[Result]) -> list[Result]:
    """Return the results; those on other shapes than the newest one of their gallery and input are outdated."""
    shapes = {}
    for record in sorted((result.record for result in results), key=lambda record: str(record.get("finished", ""))):
        if record["status"] == "ok":
            shapes[record["gallery"], record["input"]] = record["shapes"], record["labels"]

    def is_other(record: Record) -> bool:
        newest = shapes.get((record["gallery"], record["input"]))
        return record["status"] == "ok" and newest != (record["shapes"], record["labels"])

    return [replace(r, outdated=OTHER_SHAPES) if not r.outdated and is_other(r.record) else r for r in results]


@cache
def tables_of(gallery: str, dataset: str, *, quick: bool) -> tuple[str, ...]:
    """Return the identifiers of the tables that show a gallery; data sets in no table have their own."""
    names = tuple(
        table.identifier
        for table in TABLES
        if dataset in table.datasets
        and gallery in [gallery_name(dataset, part, quick=quick) for part in table.parts]
        and not (quick and table.ablation)
    )
    return names or (dataset,)


Figures = Mapping[str, float]

#: Status of a line without a record.
MISSING = "missing"

_EMPTY: Mapping[str, Any] = {
    "status": MISSING, "reason": "", "scores": None, "coverage": 0.0, "deviation": None,
    "chance": None, "supported": {}, "codebook_deviation": None, "n_averaged": 0,
    "n_wanted": 1, "is_complete": False, "n_shapes": None, "n_classes": None, "n_queries": 0, "n_tied": 0,
    "unsupported": (), "seen": (), "models": (), "notes": {}, "phases": {}, "seconds": None, "peak_mib": None,
    "origin": "", "outdated": "", "records": (),
}  # fmt: skip


def line_of(results: Sequence[Result], n_galleries: int) -> dict[str, Any]:
    """Return the values of one job, or the means over several: galleries of folds, seeds of a training.

    A gallery or a training without a result counts as 0, so that a crash is never an advantage.

    Parameters
    ----------
    results
        One for each job that has a record.
    n_galleries
        Expected number of galleries.

    Returns
    -------
    dict
        ``status`` ("missing" without a record) and ``reason``; ``scores`` by measure, or None, and ``coverage``, means
        over galleries; ``deviation``, their standard deviation (n - 1) over galleries if there are several, otherwise
        over trainings, None for a single job; ``chance``; ``supported`` and ``codebook_deviation`` of a
        single job;
        ``n_averaged`` and ``n_wanted``, the numbers of averaged and of expected jobs, and ``is_complete``, whether they
        are equal; ``n_shapes``, ``n_classes``, ``n_queries``, and ``n_tied`` (queries with ties for the first rank,
        whose NN is a mean over orders);
        ``unsupported`` and ``seen`` shapes, ``models``, ``notes``; seconds per shape by phase (``phases``, medians over
        the jobs) and their sum (``seconds``); ``peak_mib``, ``origin``, ``outdated``, and the ``records`` with scores.
    """
    if not results:
        return dict(_EMPTY)
    scored = [result for result in results if result.record.get("scores")]
    records = [result.record for result in scored]
    n_wanted = len(results) + max(n_galleries - len({result.record["gallery"] for result in results}), 0)
    if not scored:
        first = results[0].record
        status = {"status": first["status"], "reason": first.get("reason", "")}
        return {**_EMPTY, **status, "n_wanted": n_wanted}
    is_single, first = n_wanted == 1, records[0]
    only = first if is_single else {}
    galleries = _of_galleries([result.record for result in results], [*first["scores"], "coverage"], n_galleries)
    scores = _means(galleries)
    phases = [record["cost"]["seconds_per_shape"] for record in records]
    seconds = {
        phase: statistics.median(of_job[phase] for of_job in phases if phase in of_job)
        for phase in dict.fromkeys(phase for of_job in phases for phase in of_job)
    }
    failures = [
        f"{result.record['gallery']}: {result.record.get('reason', result.record['status'])}"
        for result in results
        if result not in scored
    ]
    spread_over = galleries if len(galleries) > 1 else [record["scores"] for record in records]
    return {
        **_EMPTY,
        "status": "ok",
        "reason": "; ".join(failures) or "not run",
        "coverage": scores.pop("coverage"),
        "scores": scores,
        "deviation": None if is_single else _deviations(spread_over, scores),
        "chance": _means([chance_of(record) for record in records]),
        "supported": only.get("supported", {}),
        "codebook_deviation": only.get("codebook_deviation"),
        "n_averaged": len(scored),
        "is_complete": len(scored) == n_wanted,
        "n_wanted": n_wanted,
        "n_shapes": only.get("n_shapes") or len({shape for record in records for shape in record["shapes"]}),
        "n_classes": only.get("n_classes") or len({label for record in records for label in record["labels"]}),
        "n_queries": sum(value is not None for record in records for value in record["per_query"]["NN"]),
        "n_tied": sum(_n_tied(record) for record in records if record.get("tied_queries")),
        "unsupported": _union(tuple(refused) for record in records for refused in record["unsupported"]),
        "seen": _union(shape for record in records for shape in record.get("seen", ())),
        "models": [*{model["digest"]: model for record in records for model in record.get("models", ())}.values()],
        "notes": first.get("notes") or {},
        "phases": seconds,
        "seconds": sum(seconds.values()) if seconds else None,
        "peak_mib": max((peak for record in records if (peak := record.get("peak_mib")) is not None), default=None),
        "origin": " and ".join(sorted({result.origin for result in scored} - {""})),
        "outdated": "; ".join(_union(result.outdated for result in scored if result.outdated)),
        "records": tuple(records),
    }


def _of_galleries(records: Iterable[Record], names: Sequence[str], n_galleries: int) -> list[Figures]:
    """Return scores and coverage of each gallery, averaged over trainings, so that galleries have equal weight."""
    galleries: dict[str, list[Figures]] = {}
    for record in records:
        figures = dict.fromkeys(names, 0.0) | record.get("scores", {}) | {"coverage": coverage_of(record)}
        galleries.setdefault(record["gallery"], []).append({name: figures[name] for name in names})
    missing = [dict.fromkeys(names, 0.0)] * (n_galleries - len(galleries))
    return [*map(_means, galleries.values()), *missing]


def _means(figures: Sequence[Figures]) -> dict[str, float]:
    return {name: statistics.fmean(row[name] for row in figures) for name in figures[0]}


def _deviations(figures: Sequence[Figures], names: Iterable[str]) -> dict[str, float] | None:
    if len(figures) < 2:
        return None
    return {name: statistics.stdev(row[name] for row in figures) for name in names}


def _union(items: Iterable[Any]) -> list[Any]:
    return [*dict.fromkeys(items)]


def _n_tied(record: Record) -> int:
    """Count the queries with tied first ranks: their NN is no multiple of 1 over the number of draws."""
    draws = len((record["recipe"].get("scorer") or {}).get("codebooks", (0,)))
    hits = [value * draws for value in record["per_query"]["NN"] if value is not None]
    return sum(abs(count - round(count)) > draws * UNIT for count in hits)
