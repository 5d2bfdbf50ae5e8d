"""Verification of one record of a bundle: its gallery, its arrays, and the scores that follow from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import Arrays, digest_of
from benchmark.bundles.archive import Archive
from benchmark.bundles.known import Known
from benchmark.bundles.manifest import BundleError, Entry
from benchmark.bundles.outcome import Fault, claim, lie
from benchmark.bundles.writing import FACES
from benchmark.datasets.catalogue import catalogued
from benchmark.errors import BenchmarkError, ShapeError
from benchmark.execution.plan import data_recipe
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.recipes import scorer_recipe
from benchmark.pipeline.stages import measures
from benchmark.pipeline.storage.keys import digest, plain
from benchmark.pipeline.storage.lock import versions_of
from benchmark.pipeline.storage.records import Record, answered_shapes, scorer_name
from benchmark.plugins.output_checks import distances_of, form_distances, signature_of
from benchmark.plugins.registry import BUILT_IN, methods, variant
from benchmark.plugins.scorers import BUILT_IN as SCORERS
from benchmark.plugins.scorers import ScorerSpec, scorer_of, scorers
from benchmark.plugins.serving import unfolded
from benchmark.protocols.galleries import Gallery
from benchmark.report.rounding import number

#: Largest difference between a score that is told and the one that is computed: half of a printed digit.
SCORE_TOLERANCE = 0.005

#: The same of distances, relative to their mean.
DISTANCE_TOLERANCE = 0.01

#: Vertices of the largest form.
_MOST_VERTICES = 1_000_000

Matrix = NDArray[np.float64]


@dataclass
class RowCheck:
    """A record at its verification.

    Parameters
    ----------
    known
        What its gallery is compared with.
    archive, entry, record
        The record, what it was made from, and the bundle that holds them.
    faults
        What has been found.
    gallery
        Its shapes, where their data is here.
    compared
        What labels and inputs were compared with.
    """

    known: Known
    archive: Archive
    entry: Entry
    record: Record
    faults: list[Fault] = field(default_factory=list)
    gallery: Gallery | None = None
    compared: str = ""
    _told: list[Matrix] = field(default_factory=list)

    @property
    def has_lied(self) -> bool:
        """Return whether something was found that is not so."""
        return any(fault.status == "false" for fault in self.faults)

    def computed(self) -> Mapping[str, Any] | None:
        """Compare the gallery, and compute distances and scores again; None where nobody can compute them here.

        Raises
        ------
        BundleError
            If arrays cannot be read, or are none of this kind.
        """
        self._compare_gallery()
        if self.entry.holds == "descriptors":
            scorer = None
        elif scorer := self._scorer():
            pass
        else:
            return None
        items = self._items(scorer)
        self._told = self._matrices(len(items))
        made = self._made(scorer, items) if items else None
        return None if made is None else self.compared_with(made)

    def compared_with(self, matrices: Sequence[Matrix]) -> Mapping[str, Any]:
        """Return the scores of distances that were computed, after a comparison of both with what the bundle tells."""
        record = self.record
        if len(matrices) != len(self._told) or any(map(_differ, matrices, self._told)):
            self.faults.append(lie("distances-differ", f"its distances are not those of its {self.entry.holds}"))
        answered = set(answered_shapes(record))
        places = [place for place, name in enumerate(record["shapes"]) if name in answered]
        found = measures.scores(matrices, record["labels"], places if len(places) < len(record["shapes"]) else None)
        for part in ("scores", "supported"):
            for name, told in record.get(part, {}).items():
                made = found.get(part, {}).get(name)
                if made is None or not abs(made - told) <= SCORE_TOLERANCE:
                    value = "none" if made is None else number(made, 3)
                    said = f"it says {name} {number(told, 3)}, and its {self.entry.holds} give {value}"
                    self.faults.append(lie("scores-differ", said))
                    return found
        return found

    # Gallery -----------------------------------------------------------------------------------------------------

    def _compare_gallery(self) -> None:
        record, name = self.record, str(self.record["data"]["name"])
        self.gallery = self.known.gallery(record)
        if self.gallery is not None:
            self.compared = "data"
            self._compare_with(self.gallery)
        elif there := self.known.record_of_gallery(record):
            self.compared = "records"
            self._compare_labels(dict(zip(there["shapes"], there["labels"], strict=True)))
            self._compare_inputs(there["recipe"])
        elif catalogued(name) is not None:
            said = f"neither the data of '{name}' nor a record of it is here to compare labels and inputs with"
            self.faults.append(claim("gallery-unknown", said, "pass --data-root, or --results with a record of it"))
        sources = [(n, label, self.entry.inputs[n][0]) for n, label in self._labels.items()]
        if not self.has_lied and digest(sources) != record["recipe"].get("gallery"):
            said = "its labels and inputs are not those that its record was made from"
            self.faults.append(lie("inputs-differ", said))

    @property
    def _labels(self) -> dict[str, str]:
        return dict(zip(self.record["shapes"], self.record["labels"], strict=True))

    def _compare_with(self, gallery: Gallery) -> None:
        self._compare_labels({entry.identifier: entry.subject for entry in gallery.entries})
        if self.gallery is not None:
            self._compare_inputs(plain(data_recipe(gallery, self.record["input"])))

    def _compare_labels(self, labels: Mapping[str, str]) -> None:
        name = self.record["gallery"]
        if list(labels) != self.record["shapes"]:
            said = f"its shapes are not those of '{name}' as they are known here"
            fault = lie if catalogued(str(self.record["data"]["name"])) else claim  # two folders may have one name
            self.faults.append(fault("shapes-differ", said, "name the data that it was run on"))
            self.gallery = None
        elif wrong := [shape for shape, label in self._labels.items() if labels[shape] != label]:
            said = f"it calls '{wrong[0]}' a '{self._labels[wrong[0]]}', which is a '{labels[wrong[0]]}'"
            self.faults.append(lie("labels-differ", said))

    def _compare_inputs(self, recipe: Mapping[str, Any]) -> None:
        told = self.record["recipe"]
        for part, what in (("gallery", "meshes"), ("view", "cameras")):
            if not self.has_lied and recipe.get(part) != told.get(part):
                said = f"its {what} are not those of '{self.record['gallery']}' as they are known here"
                self.faults.append(claim("inputs-differ", said, "compare the versions of the data set"))
                self.gallery = None  # forms of other shapes say nothing
                return

    # Arrays ------------------------------------------------------------------------------------------------------

    def _scorer(self) -> ScorerSpec | None:
        name = scorer_name(self.record)
        if name.partition("[")[0] not in SCORERS:
            self.faults.append(
                claim("scorer-unknown", f"scorer '{name:.60}' is not part of the suite", "compare by cm-bof")
            )
            return None
        try:
            found = scorer_of(name, scorers())
        except BenchmarkError as error:
            self.faults.append(claim("scorer-unknown", error.problem, error.hint))
            return None
        component = f"scorer/{found.base_name}"
        if self.record["recipe"].get("versions", {}).get(component) != versions_of([component])[component]:
            said = f"its record was made by another version of the scorer '{found.name}'"
            self.faults.append(claim("scorer-version", said, "ask its author to run it again with this version"))
            return None
        if plain(scorer_recipe(found)) != self.record["recipe"].get("scorer"):
            self.faults.append(lie("scores-differ", f"its record was made by another scorer than '{found.name}'"))
        return found

    def _items(self, scorer: ScorerSpec | None) -> Sequence[Arrays]:
        """Forms, signatures or descriptors of the shapes with a result; none where some are missing."""
        what = self.entry.holds
        found = _unfolded(self.archive, self.entry.arrays, self.entry.key)
        names = answered_shapes(self.record)
        if len(found) != len(names):
            said = f"it has {what} of {len(found)} shapes, and its record names {len(names)}"
            self.faults.append(lie(f"{what}-missing", said, "ask its author for the whole bundle"))
            return []
        for name, arrays in zip(names, found, strict=True):
            _CHECKS[what](name, arrays, scorer)
        stage = "signatures" if what == "signatures" else "forms"
        self._compare_digest(stage, list(map(digest_of, found)), f"{what}-differ", f"its {what} are not those")
        prepared = [self.entry.inputs[name][1] for name in names]
        self._compare_digest("shapes", prepared, "inputs-differ", "its prepared shapes are not those")
        return found

    def _matrices(self, count: int) -> list[Matrix]:
        found = _unfolded(self.archive, self.entry.distances, self.entry.key)
        self._compare_digest(
            "distances", list(map(digest_of, found)), "distances-differ", "its distances are not those"
        )
        for arrays in found:
            matrix = arrays.get("distances")
            if matrix is None or matrix.dtype.kind != "f" or not np.isfinite(matrix).all():
                raise _no_array(self.entry.distances, "no distances, or some that are no finite numbers")
            if count and matrix.shape != (count, count):
                raise _no_array(self.entry.distances, f"distances of shape {matrix.shape} for {count} shapes")
        return [arrays["distances"] for arrays in found]

    def _compare_digest(self, stage: str, digests: list[str], fault: str, said: str) -> None:
        if digest(digests)[:16] != self.record.get("digests", {}).get(stage):
            self.faults.append(lie(fault, f"{said} whose digest its record tells"))

    def _made(self, spec: ScorerSpec | None, items: Sequence[Arrays]) -> list[Matrix] | None:
        """Distances of all pairs under each draw of the scorer; None for a descriptor whose code is not ours."""
        if spec is None:
            base = str(self.record["recipe"].get("method"))
            if base not in BUILT_IN or self.record["target"] != BUILT_IN[base]:
                return None
            method: Any = variant(self.record["method"], methods()).create()
            vectors = [arrays["descriptor"] for arrays in items]
            return [np.zeros((1, 1))] if len(items) == 1 else [distances_of(method, vectors)]
        scorer = spec.create()
        signatures = items
        if self.entry.holds == "forms":
            try:
                signatures = [signature_of(scorer, form_of(arrays)) for arrays in items]
            except ShapeError as error:
                raise BundleError("bad-form", error.problem, "ask its author", "false") from error
        if len(items) == 1:
            return [np.zeros((1, 1))] * spec.info.draws
        return [form_distances(scorer, signatures, draw) for draw in range(spec.info.draws)]


def form_of(arrays: Arrays) -> Mesh:
    """Return a form of a bundle; raises ``InvalidMesh`` if it is none."""
    return Mesh(arrays["vertices"], arrays.get("faces", arrays[FACES]))


def _unfolded(archive: Archive, name: str, key: str) -> list[dict[str, Any]]:
    try:
        return list(unfolded(archive.arrays(name, key)))
    except ValueError as error:
        raise _no_array(name, "arrays that belong to no shape") from error


def _no_array(where: str, what: str) -> BundleError:
    return BundleError("no-arrays", f"'{where}' holds {what}", "ask its author")


def _differ(one: Matrix, other: Matrix) -> bool:
    return one.shape != other.shape or not np.abs(one - other).max() <= DISTANCE_TOLERANCE * max(one.mean(), 1e-30)


def _check_form(name: str, arrays: Arrays, scorer: ScorerSpec | None) -> None:
    try:
        if not len(arrays["vertices"]) <= _MOST_VERTICES:
            raise BundleError("too-large", f"the form of '{name}' has too many vertices", "ask its author")
        form_of(arrays)
    except ShapeError as error:
        raise BundleError("bad-form", f"the form of '{name}': {error.problem}", "ask its author") from error
    except (KeyError, TypeError) as error:
        raise BundleError("no-arrays", f"the form of '{name}' lacks vertices or faces", "ask its author") from error


def _check_signature(name: str, arrays: Arrays, scorer: ScorerSpec | None) -> None:
    """Refuse what the compiled code of a scorer must not be given: it looks at no bound."""
    is_fine = all(a.dtype.kind in "biuf" and np.isfinite(a).all() for a in arrays.values())
    if is_fine and scorer and scorer.base_name == ScorerSpec().base_name:
        is_fine = arrays.keys() == {"descriptors", "view_offsets"} and _are_views(scorer, **arrays)
    elif is_fine:
        is_fine = arrays.keys() == {"energies"} and arrays["energies"].dtype == np.float64
    if not is_fine:
        raise BundleError("no-arrays", f"the signature of '{name}' does not come from its scorer", "ask its author")


def _are_views(scorer: ScorerSpec, descriptors: NDArray[Any], view_offsets: NDArray[Any]) -> bool:
    from retrieval.features import DESCRIPTOR_SIZE

    made: Any = scorer.create()
    return (
        descriptors.dtype == np.uint8
        and descriptors.ndim == 2
        and descriptors.shape[1] == DESCRIPTOR_SIZE
        and view_offsets.dtype == np.int32
        and view_offsets.shape == (made.n_views + 1,)
        and bool(view_offsets[0] == 0 and view_offsets[-1] == len(descriptors) and (np.diff(view_offsets) >= 0).all())
    )


def _check_descriptor(name: str, arrays: Arrays, scorer: ScorerSpec | None) -> None:
    vector = arrays.get("descriptor")
    if vector is None or vector.ndim != 1 or vector.dtype != np.float64 or not np.isfinite(vector).all():
        raise BundleError("no-arrays", f"the descriptor of '{name}' is not a finite vector", "ask its author")


_CHECKS = {"forms": _check_form, "signatures": _check_signature, "descriptors": _check_descriptor}
