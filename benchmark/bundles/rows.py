"""Verify one record of a bundle: its gallery, its arrays, and its scores."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import Arrays, digest_of
from benchmark.bundles.archive import Archive, BundleError, Entry, Fault, Plugin, check_arrays, form_of
from benchmark.bundles.outcomes import RowOutcome
from benchmark.bundles.remaking import remake
from benchmark.datasets.catalogue import catalogued, is_present
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError
from benchmark.execution.plan import data_recipe
from benchmark.execution.processes.calls import call_apart
from benchmark.pipeline.recipes import scorer_recipe
from benchmark.pipeline.stages import measures
from benchmark.pipeline.storage.keys import digest, plain
from benchmark.pipeline.storage.lock import versions_of
from benchmark.pipeline.storage.records import Record, answered_shapes, place, scorer_name
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.output_checks import distances_of, form_distances, signature_of
from benchmark.plugins.registry import BUILT_IN, methods, variant
from benchmark.plugins.remote import unfolded
from benchmark.plugins.scorers import BUILT_IN as SCORERS
from benchmark.plugins.scorers import ScorerSpec, scorer_of, scorers
from benchmark.protocols.galleries import Gallery
from benchmark.report.escaping import number
from benchmark.report.results import galleries_of
from benchmark.report.significance import intervals, queries_of
from retrieval.measures import PRINTED

#: Largest accepted difference between a stated and a computed score: half a unit of the last printed digit.
SCORE_TOLERANCE = 0.005

#: Largest accepted difference between distances, relative to their mean.
DISTANCE_TOLERANCE = 0.01

#: Largest accepted difference after recomputation: for forms and descriptors relative to their size, for signatures the
#: distance by the scorer relative to the mean distance. Other processors change forms by at most 2e-4.
TOLERANCE = {"forms": 0.01, "descriptors": 0.01, "signatures": 0.05}

#: Minimum number of forms to recompute for each record.
FEWEST_AGAIN = 3

_ASK, _EDITED = "ask its author", "it may have been edited; ask its author"

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Request:
    """Request to verify a bundle.

    Parameters
    ----------
    path
        The bundle.
    results, data_root, folders
        Results folder whose records replace missing data, folder of the official data sets, and folders of meshes by
        name of the data set.
    run, n_again
        Whether the plugin of the bundle may run, and the number of forms of each record to recompute.
    limit
        Time limit of a step in seconds.
    """

    path: Path
    results: Path
    data_root: Path | None = None
    folders: Mapping[str, Path] = field(default_factory=dict)
    run: bool = False
    n_again: int = FEWEST_AGAIN
    limit: float | None = None

    @cached_property
    def records(self) -> list[Record]:
        """Local records with scores."""
        return [record for record in Store(self.results / "runs").all_records() if record["status"] == "ok"]


@dataclass
class RowCheck:
    """Verification of a record: its data, its faults, and its recomputed values.

    The gallery is None if the data is missing or differs; the plugin runs only if ``may_run``.
    """

    request: Request
    archive: Archive
    entry: Entry
    record: Record
    plugin: Plugin | None
    may_run: bool
    say: Callable[[str], None]
    faults: list[Fault] = field(default_factory=list)
    gallery: Gallery | None = None
    compared: str = ""
    again: tuple[str, ...] = ()
    apart: float = 0.0

    def __post_init__(self) -> None:
        record = self.record
        self.name, self.answered = str(record["data"]["name"]), answered_shapes(record)
        self.labels = dict(zip(record["shapes"], record["labels"], strict=True))

    def outcome(self) -> RowOutcome:
        """Return the outcome; raise :class:`BundleError` if arrays cannot be read or are of the wrong kind."""
        entry, record = self.entry, self.record
        self._say(f"computing the scores of {len(record['shapes'])} shapes")
        scored = self._scores() or record
        queries = queries_of([[{**record, "per_query": scored["per_query"]}]])
        ends = intervals(queries.values[:, :, 0], queries.labels)
        seconds = record["cost"]["seconds_per_shape"].values()
        scores, told, chance = (
            {name: float(part[name]) for name in PRINTED}
            for part in (scored["scores"], record["scores"], record["chance"])
        )
        return RowOutcome(
            key=entry.key, gallery=record["gallery"], data=self.name, data_title=record["data"]["title"],
            input=record["input"], scorer=scorer_name(record), seed=place(record).seed,
            gallery_digest=str(record["recipe"].get("gallery", "")), faults=tuple(self.faults),
            scores=scores, told=told, chance=chance,
            intervals={name: (float(low), float(high)) for name, (low, high) in zip(PRINTED, ends, strict=True)},
            n_shapes=record["n_shapes"], n_classes=record["n_classes"],
            coverage=len(self.answered) / record["n_shapes"],
            seconds=float(sum(seconds)) if seconds else None, peak_mib=record.get("peak_mib"),
            trained_on=tuple(dict.fromkeys(model["data"] for model in record.get("models", ()))),
            holds=entry.holds, withheld=entry.withheld, compared=self.compared, again=self.again, apart=self.apart,
        )  # fmt: skip

    def _scores(self) -> Mapping[str, Any] | None:
        """Compare the gallery, and return recomputed scores; None if they cannot be computed here."""
        self._compare_gallery()
        is_descriptor, scored, matrices = self.entry.holds == "descriptors", None, list[Matrix]()
        scorer = None if is_descriptor else self._scorer()
        if scorer or is_descriptor:
            items = self._items(scorer)
            matrices = self._distances(len(items))
            computed = self._computed(scorer, items) if items else None
            scored = None if computed is None else self._compare_scores(computed, matrices)
        if not self._is_false and (distances := self._remade()) is not None:
            scored = self._compare_scores([np.array(distances)], matrices)
        if scored is None and not self.faults:
            problem = "its distances come from a package outside the suite"
            self._claim("not-run", problem, "ask its author for a plugin in one file")
        return scored

    def _compare_scores(self, computed: Sequence[Matrix], matrices: Sequence[Matrix]) -> Mapping[str, Any]:
        """Compare recomputed distances and their scores with those of the bundle, and return the scores."""
        record, holds = self.record, self.entry.holds
        if len(computed) != len(matrices) or any(map(_differ, computed, matrices)):
            self._refute("distances-differ", f"its distances are not those of its {holds}")
        answered = set(self.answered)
        places = [number for number, name in enumerate(record["shapes"]) if name in answered]
        scored = measures.scores(computed, record["labels"], places if len(places) < len(record["shapes"]) else None)
        recorded = [(part, *figure) for part in ("scores", "supported") for figure in record.get(part, {}).items()]
        for part, name, value in recorded:
            computed_value = scored.get(part, {}).get(name, np.nan)
            if not abs(computed_value - value) <= SCORE_TOLERANCE:
                problem = f"it says {name} {number(value, 3)}, and its {holds} give {number(computed_value, 3)}"
                self._refute("scores-differ", problem)
                break
        return scored

    @property
    def _is_false(self) -> bool:
        return any(fault.status == "false" for fault in self.faults)

    def _claim(self, name: str, problem: str, hint: str) -> None:
        """Add a fault: the record cannot be checked here and remains a claim."""
        self.faults.append(Fault(name, problem, hint, "claimed"))

    def _refute(self, name: str, problem: str, hint: str = _EDITED) -> None:
        self.faults.append(Fault(name, problem, hint, "false"))

    def _say(self, text: str) -> None:
        self.say(f"{self.record['gallery']} {self.record['input']}: {text}")

    # Gallery -----------------------------------------------------------------------------------------------------

    def _compare_gallery(self) -> None:
        recipe = self.record["recipe"]
        self.gallery = self._gallery_here()
        if self.gallery is not None:
            self.compared = "data"
            labels = {entry.identifier: entry.subject for entry in self.gallery.entries}
            self._compare_labels(labels, plain(data_recipe(self.gallery, self.record["input"])))
        elif similar := self._record_of_gallery():
            self.compared = "records"
            self._compare_labels(dict(zip(similar["shapes"], similar["labels"], strict=True)), similar["recipe"])
        elif catalogued(self.name) is not None:
            problem = f"neither the data of '{self.name}' nor a record of it is here to compare labels and inputs with"
            self._claim("gallery-unknown", problem, "pass --data-root, or --results with a record of it")
        sources = [(shape, label, self.entry.inputs[shape][0]) for shape, label in self.labels.items()]
        if not self._is_false and digest(sources) != recipe.get("gallery"):
            self._refute("inputs-differ", "its labels and inputs differ from those in its record")

    def _gallery_here(self) -> Gallery | None:
        """Return the gallery of the record; None if its data is missing. Paths in the record are ignored."""
        name, request = self.name, self.request
        if name in request.folders:
            name = str(request.folders[name])
        elif catalogued(name) is None or not is_present(name, request.data_root):
            return None
        try:
            named = galleries_of(name, request.data_root, quick=bool(self.record["data"]["quick"]))
        except BenchmarkError:
            return None
        return named.get(self.record["gallery"])

    def _record_of_gallery(self) -> Record | None:
        """Return a local record of the same gallery and input; for a known data set, possibly with other shapes.

        Private folders of different people may have the same name.
        """
        similar = [other for other in self.request.records if place(other)[:2] == place(self.record)[:2]]
        same = [other for other in similar if _gallery_digest(other) == _gallery_digest(self.record)]
        return next(iter(same), similar[-1] if similar and catalogued(self.name) else None)

    def _compare_labels(self, labels: Mapping[str, str], recipe: Mapping[str, Any]) -> None:
        """Compare labels and, if they agree, the meshes and cameras in the recipe."""
        known_here = f"those of '{self.record['gallery']}' as known here"
        wrong = next((shape for shape, label in self.labels.items() if labels.get(shape) != label), None)
        parts = {"gallery": "meshes", "view": "cameras"}
        others = [what for part, what in parts.items() if recipe.get(part) != self.record["recipe"].get(part)]
        if list(labels) != [*self.labels]:
            note = self._refute if catalogued(self.name) else self._claim
            note("shapes-differ", f"its shapes are not {known_here}", "name the data on which it ran")
            self.gallery = None
        elif wrong is not None:
            self._refute("labels-differ", f"it calls '{wrong}' a '{self.labels[wrong]}', which is a '{labels[wrong]}'")
        elif others:
            self._claim("inputs-differ", f"its {others[0]} are not {known_here}", "compare versions of the data set")
            self.gallery = None  # forms of other shapes prove nothing

    # Arrays ------------------------------------------------------------------------------------------------------

    def _scorer(self) -> ScorerSpec | None:
        name, recipe = scorer_name(self.record), self.record["recipe"]
        try:
            if name.partition("[")[0] not in SCORERS:
                raise ConfigurationError(f"scorer '{name:.60}' is not part of the suite", "compare by cm-bof")
            scorer = scorer_of(name, scorers())
        except BenchmarkError as error:
            self._claim("scorer-unknown", error.problem, error.hint)
            return None
        component = f"scorer/{scorer.base_name}"
        if recipe.get("versions", {}).get(component) != versions_of([component])[component]:
            problem = f"its record was scored by another version of the scorer '{scorer.name}'"
            self._claim("scorer-version", problem, "ask its author to run it again with this version")
            return None
        if plain(scorer_recipe(scorer)) != recipe.get("scorer"):
            self._refute("scores-differ", f"its record was scored by another scorer than '{scorer.name}'")
        return scorer

    def _items(self, scorer: ScorerSpec | None) -> Sequence[Arrays]:
        """Return the forms, signatures or descriptors of the shapes with a result; none if some are missing."""
        holds, names = self.entry.holds, self.answered
        items = self._unfolded(self.entry.files[1])
        if len(items) != len(names):
            problem = f"it has {holds} of {len(items)} shapes, and its record names {len(names)}"
            self._refute(f"{holds}-missing", problem, "ask its author for the complete bundle")
            return []
        for name, arrays in zip(names, items, strict=True):
            check_arrays(holds, name, arrays, scorer)
        stage = "signatures" if holds == "signatures" else "forms"
        self._compare_digest(stage, map(digest_of, items), f"{holds}-differ", holds)
        self._compare_digest("shapes", (self.entry.inputs[name][1] for name in names), "inputs-differ", "inputs")
        return items

    def _distances(self, count: int) -> list[Matrix]:
        file = self.entry.files[2]
        items = self._unfolded(file)
        self._compare_digest("distances", map(digest_of, items), "distances-differ", "distances")
        matrices: list[Matrix] = [arrays.get("distances", np.empty(0, int)) for arrays in items]
        for matrix in matrices:
            is_fine = matrix.dtype.kind == "f" and np.isfinite(matrix).all()
            if not is_fine or (count and matrix.shape != (count, count)):
                raise BundleError("no-arrays", f"'{file}' does not contain finite distances of {count} shapes", _ASK)
        return matrices

    def _unfolded(self, file: str) -> list[dict[str, Any]]:
        try:
            return list(unfolded(self.archive.arrays(file, self.entry.key)))
        except ValueError as error:
            raise BundleError("no-arrays", f"'{file}' contains arrays that belong to no shape", _ASK) from error

    def _compare_digest(self, stage: str, digests: Iterable[str], fault: str, what: str) -> None:
        if digest(list(digests))[:16] != self.record.get("digests", {}).get(stage):
            self._refute(fault, f"its {what} do not have the digest in its record")

    def _computed(self, scorer_spec: ScorerSpec | None, items: Sequence[Arrays]) -> list[Matrix] | None:
        """Return the distances of all pairs for each draw of the scorer; None for a descriptor of a plugin."""
        if scorer_spec is None and BUILT_IN.get(str(self.record["recipe"].get("method"))) != self.record["target"]:
            return None
        if len(items) == 1:
            return [np.zeros((1, 1))] * (scorer_spec.info.draws if scorer_spec else 1)
        if scorer_spec is None:
            method: Any = variant(self.record["method"], methods()).create()
            return [distances_of(method, [arrays["descriptor"] for arrays in items])]
        scorer, signatures = scorer_spec.create(), items
        if self.entry.holds == "forms":
            try:
                signatures = [signature_of(scorer, form_of(arrays)) for arrays in items]
            except ShapeError as error:
                raise BundleError("bad-form", error.problem, _ASK, "false") from error
        return [form_distances(scorer, signatures, draw) for draw in range(scorer_spec.info.draws)]

    # Recomputed forms --------------------------------------------------------------------------------------------

    def _remade(self) -> list[list[float]] | None:
        """Recompute forms if allowed, or add a fault if necessary; return distances of a plugin's descriptors."""
        base = str(self.record["recipe"]["method"])
        is_ours = self.plugin is None and base in BUILT_IN
        needs_code = self.plugin is not None and self.entry.holds == "descriptors"
        if (is_ours and self.gallery) or (self.plugin and self.may_run and (self.gallery or needs_code)):
            return self._remake()
        if is_ours and not any(_outcome(other) == _outcome(self.record) for other in self.request.records):
            problem = f"it uses the suite's name '{base}', which neither data nor a record here confirms"
            self._claim("not-made-again", problem, "pass --data-root, -d FOLDER, or --results with its record")
        elif needs_code:
            problem = "its distances come from its plugin, which was not run"
            self._claim("not-run", problem, "pass --run on a machine where you can run untrusted code")
        return None

    def _remake(self) -> list[list[float]] | None:
        names, request = self.answered if self.gallery else [], self.request
        chosen = tuple(secrets.SystemRandom().sample(names, min(max(request.n_again, FEWEST_AGAIN), len(names))))
        self._say(f"making {len(chosen)} forms again")
        content = self.archive.read(self.entry.files[1])  # not in a file, which the plugin could read
        hint = "ask its author, or pass a longer --timeout"
        with TemporaryDirectory(prefix="canonical-forms-") as folder:
            target = f"{self._unpack(self.plugin, Path(folder))}:{self.plugin.attribute}" if self.plugin else ""
            data = (self.gallery.source if self.gallery else "", request.data_root)
            folders = (Path(folder) / "results", request.results / "models")
            arguments = (self.record, self.entry, content, chosen, target, data, folders)
            try:
                what = f"method '{self.record['method']}'"
                remade = call_apart(remake, *arguments, what=what, hint=hint, limit=request.limit, quiet=True)
            except BenchmarkError as error:
                self._claim("not-made-again", error.problem, error.hint)
                return None
        self.again, self.apart = chosen, remade["apart"]
        if self.apart > TOLERANCE[self.entry.holds]:
            problem = f"recomputed forms differ from those of the bundle by up to {self.apart:.2g} of their size"
            if remade["is_same_code"]:
                self._refute("not-made-again", problem, "the forms belong to something else")
            else:
                problem += "; the method here is not the one that made it"
                self._claim("other-code", problem, "verify it with the version of the suite that made it")
        return remade["distances"]  # type: ignore[no-any-return]

    def _unpack(self, plugin: Plugin, folder: Path) -> Path:
        """Write the files of a plugin, with checked names, to an empty folder and return the path of the plugin."""
        for name in plugin.digests:
            path, content = folder / name, self.archive.read(name)
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            except OSError as error:  # a file has the name of a folder
                raise BundleError("damaged", f"'{name}' in it cannot be unpacked: {error.strerror}") from error
        return (folder / plugin.file).resolve()


def _gallery_digest(record: Record) -> object:
    return record["recipe"].get("gallery")


def _outcome(record: Record) -> list[object]:
    """Return the outcome of a record with its stated scores."""
    parts = [record[part] for part in ("scores", "labels", "shapes")]
    return [place(record), answered_shapes(record), _gallery_digest(record), *parts]


def _differ(one: Matrix, other: Matrix) -> bool:
    return one.shape != other.shape or not np.abs(one - other).max() <= DISTANCE_TOLERANCE * max(one.mean(), 1e-30)
