"""Index of CM-BOF: the words of a gallery, so that some pairs of forms are compared by clock matching without the rest.

Only views of one orbit of the cube group ever meet. So the vector of a form counts its words orbit by orbit, which no
turn changes: the square roots of their shares of a view, summed over the views of the orbit. Words of an orbit that
most forms hold are left out, as in a search for texts: they tell little and cost most.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from benchmark.api.scoring import SignatureArrays
from retrieval.clock import N_ORBITS, ORBIT_SIZES, PLACES, PLACES_MET, ROUNDING, Signature
from retrieval.cmbof import CMBOF
from retrieval.codebook import Descriptors, sample_codebook
from retrieval.features import Features
from retrieval.neighbours import Places
from retrieval.views import N_VIEWS, ORBITS

__all__ = ["ClockIndex"]

#: Share of the entries of all vectors that is kept, those of the rarest words; chosen on generated bodies, see
#: docs/appendix/scale.md.
KEPT = 0.5
#: Units of a vector: whole numbers, whose products single precision holds exactly, on every machine and in every order.
UNIT = 2.0**-8
#: Forms that are looked at together.
FORMS = 64
#: Place of the view that each view meets after each of the 24 turns, shape (66, 24).
_MET = np.ascontiguousarray(PLACES_MET.T)


@dataclass(frozen=True, eq=False)
class ClockIndex:
    """The words of each view of each of N forms; see :class:`retrieval.neighbours.GalleryIndex`.

    Parameters
    ----------
    codebook
        The words, shape (n_words, 128), uint8.
    words
        Words of view 0 of form 0 in ascending order, then those of its view 1, and so on, shape (k,), of the smallest
        type that holds them.
    counts
        Their numbers of occurrences, shape (k,), uint16.
    offsets
        First entry of each view of each form, shape (66 N + 1,), int64.
    """

    codebook: Descriptors
    words: NDArray[Any]
    counts: NDArray[np.uint16]
    offsets: Places

    @classmethod
    def of(cls, scorer: CMBOF, signatures: Sequence[SignatureArrays], draw: int) -> ClockIndex:
        """Draw the words of a gallery as the scorer does, and count them; a few forms are read at a time, twice."""
        codebook = _codebook(scorer, signatures, draw)
        return cls.counted(codebook, (scorer.quantise(Features.from_arrays(each), codebook) for each in signatures))

    @classmethod
    def counted(cls, codebook: Descriptors, signatures: Iterable[Signature]) -> ClockIndex:
        """Put the signatures of forms together, all of one codebook."""
        words, counts, sizes = [], [], []
        for signature in signatures:
            words.append(signature.words.astype(np.min_scalar_type(len(codebook))))
            counts.append(signature.counts.astype(np.uint16))
            sizes.append(np.diff(signature.view_offsets))
        offsets = np.concatenate([[0], np.cumsum(np.concatenate(sizes), dtype=np.int64)])
        return cls(codebook, np.concatenate(words), np.concatenate(counts), offsets)

    def with_query(self, scorer: CMBOF, signature: SignatureArrays) -> ClockIndex:
        """Return the same with one more form at the end, in words that were drawn without it."""
        query = self.counted(self.codebook, [scorer.quantise(Features.from_arrays(signature), self.codebook)])
        return replace(
            self,
            words=np.concatenate([self.words, query.words]),
            counts=np.concatenate([self.counts, query.counts]),
            offsets=np.concatenate([self.offsets, self.offsets[-1] + query.offsets[1:]]),
        )

    def __len__(self) -> int:
        return len(self.offsets) // N_VIEWS

    def distances(self, first: Places, second: Places) -> NDArray[np.float64]:
        """See :class:`retrieval.neighbours.GalleryIndex`; those of :func:`retrieval.clock.match_all`, bit by bit."""
        found = np.empty(len(first))
        _match_pairs(first, second, self.words, self.counts, self.offsets, len(self.codebook), found)
        return found

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Plain arrays for an ``.npz`` file."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> ClockIndex:
        """Rebuild it from :meth:`to_arrays`."""
        return cls(**{each.name: arrays[each.name] for each in fields(cls)})

    def closeness(self, forms: slice) -> NDArray[np.float32]:
        """See :class:`retrieval.neighbours.GalleryIndex`: the inner products of the vectors."""
        rows, columns = self._vectors
        return np.asarray((rows[forms] @ columns).toarray())

    @cached_property
    def _vectors(self) -> tuple[csr_array, csr_array]:
        """Vectors of all forms, shape (N, 4 n_words), and their transpose, which is the inverted index."""
        parts = [self._histograms(np.arange(a, min(a + FORMS, len(self)))) for a in range(0, len(self), FORMS)]
        whole = vstack(parts, format="csc")
        held = np.diff(whole.indptr)
        rarest = np.argsort(held, kind="stable")
        rare = whole[:, rarest[np.cumsum(held[rarest]) <= KEPT * whole.nnz]]
        return rare.tocsr(), rare.T.tocsr()

    def _histograms(self, forms: NDArray[np.int64]) -> csr_array:
        """Return the square roots of the words' shares by orbit of some forms, in units of :data:`UNIT`."""
        numbers = (forms[:, None] * N_VIEWS + np.arange(N_VIEWS)).ravel()  # of their views
        lengths = self.offsets[numbers + 1] - self.offsets[numbers]
        entries = np.repeat(self.offsets[numbers] - np.cumsum(lengths) + lengths, lengths) + np.arange(lengths.sum())
        views, counts = np.repeat(np.arange(len(numbers)), lengths), self.counts[entries].astype(np.float64)
        shares = counts / np.bincount(views, counts, len(numbers))[views]
        columns = self.words[entries].astype(np.int64) * N_ORBITS + ORBITS[views % N_VIEWS]
        shape = (len(forms), len(self.codebook) * N_ORBITS)
        found = csr_array((shares, (views // N_VIEWS, columns)), shape=shape)
        found.data = np.round(np.sqrt(found.data) / UNIT).astype(np.float32)
        return found


def _codebook(scorer: CMBOF, signatures: Sequence[SignatureArrays], draw: int) -> Descriptors:
    """The words that :meth:`retrieval.cmbof.CMBOF.train_codebook` draws: those of parts hold those of the whole."""
    words: list[Descriptors] = []
    part: list[Descriptors] = []
    for start in range(0, len(signatures), FORMS):
        part = [signatures[place]["descriptors"] for place in range(start, min(start + FORMS, len(signatures)))]
        if any(map(len, part)):
            words = [sample_codebook([*words, *part], scorer.n_words, draw)]
    return words[0] if words else sample_codebook(part, scorer.n_words, draw)


@njit(cache=True, nogil=True, error_model="numpy")
def _match_pairs(
    first: Places,
    second: Places,
    words: NDArray[Any],
    counts: NDArray[np.uint16],
    offsets: Places,
    n_words: int,
    distances: NDArray[np.float64],
) -> None:
    """Fill the dissimilarities of pairs; pairs with the same first form should follow each other."""
    n_groups = n_words * N_ORBITS
    begins = np.zeros(n_groups + 1, dtype=np.int32)
    ends = np.zeros(n_groups, dtype=np.int32)
    places, own_counts = np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32)
    own_sizes = np.zeros((N_ORBITS, ORBIT_SIZES.max()), dtype=np.int32)
    shared = np.zeros(ORBIT_SIZES.max(), dtype=np.int32)
    similarity = np.zeros(ORBIT_SIZES.max())
    totals = np.zeros(_MET.shape[1])
    indexed = np.int64(-1)
    for pair in range(len(first)):
        if first[pair] != indexed:
            # Inverted index of the first form: the views of an orbit that hold a word.
            indexed = first[pair]
            start = indexed * N_VIEWS
            n_entries = offsets[start + N_VIEWS] - offsets[start]
            places, own_counts = np.empty(n_entries, dtype=np.int32), np.empty(n_entries, dtype=np.int32)
            begins[:] = 0
            for view in range(N_VIEWS):
                size = np.int32(0)
                for entry in range(offsets[start + view], offsets[start + view + 1]):
                    begins[words[entry] * N_ORBITS + ORBITS[view] + 1] += 1
                    size += counts[entry]
                own_sizes[ORBITS[view], PLACES[view]] = size
            for group in range(n_groups):
                begins[group + 1] += begins[group]
                ends[group] = begins[group]
            for view in range(N_VIEWS):
                for entry in range(offsets[start + view], offsets[start + view + 1]):
                    group = words[entry] * N_ORBITS + ORBITS[view]
                    places[ends[group]], own_counts[ends[group]] = PLACES[view], counts[entry]
                    ends[group] += 1
        totals[:] = 0.0
        start = second[pair] * N_VIEWS
        for view in range(N_VIEWS):
            orbit = ORBITS[view]
            shared[:] = 0
            size = np.int32(0)
            for entry in range(offsets[start + view], offsets[start + view + 1]):
                group, count = words[entry] * N_ORBITS + orbit, np.int32(counts[entry])
                size += count
                for posting in range(begins[group], begins[group + 1]):
                    shared[places[posting]] += min(count, own_counts[posting])
            others = own_sizes[orbit]
            for place in range(ORBIT_SIZES[orbit]):
                # Two empty views: 1 / 1.
                larger = max(size, others[place])
                ratio = (shared[place] + (larger == 0)) / max(larger, 1)
                similarity[place] = (ratio + ROUNDING) - ROUNDING
            for turn in range(len(totals)):
                totals[turn] += similarity[_MET[view, turn]]
        distances[pair] = N_VIEWS - totals.max()
