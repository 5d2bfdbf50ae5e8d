"""The gallery of a job that can be ranked: its shapes, their signatures, and the distances."""

from __future__ import annotations

import hashlib
import json
import secrets
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Method
from benchmark.api.scoring import Scorer
from benchmark.arrays import ABOUT, Arrays
from benchmark.datasets.base import Entry
from benchmark.errors import ShapeError
from benchmark.execution.processes.opened_files import with_files
from benchmark.pipeline import recipes
from benchmark.pipeline.method_run import MethodRun, ShapeResult, features_of, files_of
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.costs import Cost
from benchmark.pipeline.storage.lock import key_of
from benchmark.pipeline.storage.store import Artefact, Store
from benchmark.plugins.output_checks import distances_of, form_distances
from benchmark.plugins.remote import Foreign


@dataclass(frozen=True)
class Signatures:
    """Facts about the signatures of a gallery, kept beside its distances for a ranking that needs the latter alone.

    Parameters
    ----------
    digest
        Digest of all of them, in the order of the gallery.
    seconds
        Median of a shape.
    environments
        Number of signatures by the environment in which they were made.
    """

    digest: str = ""
    seconds: float = 0.0
    environments: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, found: Iterable[ShapeResult]) -> Signatures:
        """Gather the facts about the signatures of shapes; none where no signature was read."""
        made = [each.features for each in found if each.features is not None]
        if not made:
            return cls()
        seconds = statistics.median(cost.seconds for cost in settled([each.cost for each in made]))
        counts = Counter(each.environment for each in made)
        return cls(_digest(each.digest for each in made), round(seconds, 4), dict(counts))


#: Array beside distances that tells of the signatures.
_SIGNATURES = f"{ABOUT}signatures"


@dataclass
class RankedGallery:
    """The shapes of a job that can be ranked, and their distances, one draw of the scorer at a time.

    Of the distances, which are large, one matrix is held at a time. Where all of them are kept from an earlier ranking,
    no signature is made or read.

    Parameters
    ----------
    store, method_run
        Where the shapes are, and what makes their forms.
    scorer
        What compares the forms; None for descriptors.
    tell
        Told which draw is under way.
    entries, found
        The shapes that have a form and a signature, and what became of them.
    refused, unprepared
        The others, each with the reason; and those of them that no method can get.
    recipes
        What determines the distances of each draw.
    """

    store: Store
    method_run: MethodRun
    scorer: Scorer | None
    tell: Callable[[str], object]
    entries: list[Entry] = field(default_factory=list)
    found: dict[str, ShapeResult] = field(default_factory=dict)
    refused: list[tuple[str, str]] = field(default_factory=list)
    unprepared: list[str] = field(default_factory=list)
    recipes: dict[int | None, recipes.Recipe] = field(default_factory=dict)
    _before: dict[int | None, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls, store: Store, method_run: MethodRun, entries: Sequence[Entry], tell: Callable[[str], object]
    ) -> RankedGallery:
        """Look for the forms, and for the signatures unless all distances are kept."""
        gallery = cls(store, method_run, None if method_run.describes else method_run.scorer, tell)
        gallery._keep(entries, method_run.found)
        if not (method_run.describes or all(map(store.digest_under, gallery.keys))):
            found = dict(gallery.found)
            gallery._keep(gallery.entries, lambda entry: method_run.with_signature(entry, found[entry.identifier]))
        order = {entry.identifier: number for number, entry in enumerate(entries)}
        gallery.refused.sort(key=lambda each: order[each[0]])
        return gallery

    def _keep(self, entries: Iterable[Entry], find: Callable[[Entry], ShapeResult]) -> None:
        """Keep the shapes of which something is found, in their order."""
        self.entries, self.found = [], {}
        for entry in list(entries):
            try:
                self.found[entry.identifier] = find(entry)
                self.entries.append(entry)
            except ShapeError as error:
                self.refused.append((entry.identifier, str(error)))
                if not self.method_run.preparation.is_prepared(entry):
                    self.unprepared.append(entry.identifier)
        forms = [self.method_run.recipe(entry) for entry in self.entries]
        scorer = self.method_run.scorer_spec
        draws = recipes.draws_of(self.method_run.spec, scorer)
        spec = self.method_run.spec
        self.recipes = {draw: recipes.distances_recipe(forms, spec, scorer, draw) for draw in draws}

    @property
    def keys(self) -> list[str]:
        """Names of the distances in the store."""
        return [key_of(recipe) for recipe in self.recipes.values()]

    def matrices(self) -> Iterator[NDArray[Any]]:
        """The distances under each draw, shape (N, N) each."""
        yield from (self.compared(draw).arrays["distances"] for draw in self.recipes)

    def compared(self, draw: int | None) -> Artefact:
        """Make, or find, the distances under a draw."""
        compare = lambda: with_files(self._distances(draw), files_of(self.scorer or self.method_run.method))  # noqa: E731
        found = self.store.get_or_compute(self.recipes[draw], compare, work="rank")
        self._before.setdefault(draw, found.cost.seconds if found.was_cached else 0.0)
        return found

    @property
    def seconds_before(self) -> float:
        """Return the seconds that those comparisons took which had been made before."""
        return sum(self._before.values())

    def _distances(self, draw: int | None) -> Arrays:
        """Distances of one draw, with what is told of the signatures."""
        method, scorer = self.method_run.method, self.scorer
        if len(self.entries) == 1:
            return {"distances": np.zeros((1, 1))}
        if draw is None or scorer is None:
            assert not isinstance(method, Method)  # noqa: S101
            descriptors = [self.found[entry.identifier].answer.arrays["descriptor"] for entry in self.entries]
            found = self._in_order(descriptors, lambda items: distances_of(method, items), method)
            return {"distances": found}
        self.tell(f"comparing {len(self.entries)} forms, {draw + 1} of {len(self.recipes)}")
        # Distances that are kept need no signatures, but those whose file is damaged do.
        signed = [self.method_run.with_signature(entry, self.found[entry.identifier]) for entry in self.entries]
        about = json.dumps(asdict(Signatures.of(signed)), sort_keys=True)
        signatures = list(map(features_of, signed))
        found = self._in_order(signatures, lambda items: form_distances(scorer, items, draw), scorer)
        return {"distances": found, _SIGNATURES: np.array(about)}

    def _in_order(self, items: Sequence[T], compare: Callable[[Sequence[T]], NDArray[Any]], by: object) -> NDArray[Any]:
        """Distances of all pairs; foreign code is given the gallery in an order that tells nothing."""
        return in_shuffled_order(items, compare) if isinstance(by, Foreign) else compare(items)

    @cached_property
    def signatures(self) -> Signatures:
        """Facts about the signatures, from themselves or from beside the distances."""
        if self.method_run.describes or any(each.features is not None for each in self.found.values()):
            return Signatures.of(self.found.values())
        recipe = next(iter(self.recipes.values()))
        first = self.store.find(recipe, wanted=_SIGNATURES.__eq__)
        return Signatures(**json.loads(str(first.arrays[_SIGNATURES]))) if first else Signatures()

    @property
    def digests(self) -> dict[str, str]:
        """Digests of all that the scores come from, stage by stage, in the order of the gallery."""
        found = {
            "shapes": _digest(each.prepared.digest for each in self.found.values()),
            "forms": _digest(each.answer.digest for each in self.found.values()),
            "signatures": self.signatures.digest,
            "distances": _digest(map(self.store.digest_under, self.keys)),
        }
        return {stage: text for stage, text in found.items() if text}


def _digest(digests: Iterable[str]) -> str:
    """One digest of several, 16 hexadecimal digits; "" where one of them is not known."""
    found = list(digests)
    return keys.digest(found)[:16] if all(found) else ""


def settled(costs: Sequence[Cost]) -> list[Cost]:
    """Costs without those of first uses, which compile and load; all of them where there are no others."""
    return [cost for cost in costs if not cost.first_use] or list(costs)


T = TypeVar("T")


def in_shuffled_order(items: Sequence[T], compare: Callable[[Sequence[T]], NDArray[Any]]) -> NDArray[Any]:
    """Compare all pairs of items in another order, and return the matrix in theirs.

    Parameters
    ----------
    items
        Descriptors or signatures of N shapes; the order follows from a few measurements of them, and from no name.
    compare
        Returns the dissimilarities of all pairs, shape (N, N).
    """
    places = [_place(item if isinstance(item, Mapping) else {"": np.asarray(item)}) for item in items]
    order = sorted(range(len(items)), key=places.__getitem__)
    back = np.argsort(order)
    return compare([items[number] for number in order])[np.ix_(back, back)]


def _place(arrays: Mapping[str, NDArray[Any]]) -> tuple[Any, ...]:
    """What places are sorted by: measurements to six digits, then every bit, and chance between copies."""
    measurements = []
    for name in sorted(arrays):
        sizes = np.abs(np.asarray(arrays[name], dtype=np.float64)).ravel()
        ramp = np.linspace(1, 2, sizes.size)
        moments = [f"{value:.6g}" for value in (sizes.mean(), (sizes * ramp).mean())] if sizes.size else []
        measurements += [name, str(np.shape(arrays[name])), *moments]
    digest = hashlib.sha256(" ".join(measurements).encode()).hexdigest()
    return digest, [arrays[name].tobytes() for name in sorted(arrays)], secrets.randbits(64)
