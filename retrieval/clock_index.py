"""Index of CM-BOF: the words of a gallery, so that some pairs of forms are compared by clock matching without the rest.

Only views of one orbit of the cube group ever meet. So the vector of a form counts its words orbit by orbit, which no
turn changes: the square roots of their shares of a view, summed over the views of the orbit, whose Euclidean distance
is that of Hellinger. Its leading principal components are kept, rounded to whole numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from benchmark.api.scoring import SignatureArrays
from retrieval.clock import N_ORBITS, ORBIT_SIZES, PLACES, PLACES_MET, ROUNDING, Signature
from retrieval.cmbof import CMBOF
from retrieval.codebook import Descriptors, sample_codebook
from retrieval.features import Features
from retrieval.neighbours import Places, Vectors
from retrieval.views import N_VIEWS, ORBITS

__all__ = ["COMPONENTS", "ClockIndex"]

#: Principal components of a vector; chosen on generated bodies, see docs/appendix/scale.md.
COMPONENTS = 64
#: Forms whose principal components are taken, evenly spaced in the gallery.
SAMPLE = 1000
#: Units of a vector and of the axes of its components: what is rounded is a thousandth of what tells forms apart.
UNIT = 2.0**-10
#: Share of the largest variance below which a component is noise of the arithmetic.
_LEAST_VARIANCE = 1e-9
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
    axes
        Axes of the principal components, shape (4 n_words, c), float32.
    vectors
        Components of each form, shape (N, c), float32.
    """

    codebook: Descriptors
    words: NDArray[Any]
    counts: NDArray[np.uint16]
    offsets: Places
    axes: Vectors
    vectors: Vectors

    @classmethod
    def of(cls, scorer: CMBOF, signatures: Sequence[SignatureArrays], draw: int) -> ClockIndex:
        """Draw the words of a gallery as the scorer does, and count them; a few forms are read at a time, twice."""
        codebook = _codebook(scorer, signatures, draw)
        return cls.counted(codebook, (scorer.quantise(Features.from_arrays(each), codebook) for each in signatures))

    @classmethod
    def counted(cls, codebook: Descriptors, signatures: Iterable[Signature], axes: Vectors | None = None) -> ClockIndex:
        """Put the signatures of forms together, all of one codebook; without axes, they get their own."""
        words, counts, sizes = [], [], []
        for signature in signatures:
            words.append(signature.words.astype(np.min_scalar_type(len(codebook))))
            counts.append(signature.counts.astype(np.uint16))
            sizes.append(np.diff(signature.view_offsets))
        offsets = np.concatenate([[0], np.cumsum(np.concatenate(sizes), dtype=np.int64)])
        found = cls(
            codebook, np.concatenate(words), np.concatenate(counts), offsets, *[np.empty((0, 0), np.float32)] * 2
        )
        axes = found._principal_axes() if axes is None else axes
        return replace(found, axes=axes, vectors=found._along(axes))

    def with_query(self, scorer: CMBOF, signature: SignatureArrays) -> ClockIndex:
        """Return the same with one more form at the end, in words and axes that were found without it."""
        own = scorer.quantise(Features.from_arrays(signature), self.codebook)
        query = self.counted(self.codebook, [own], self.axes)
        return replace(
            self,
            words=np.concatenate([self.words, query.words]),
            counts=np.concatenate([self.counts, query.counts]),
            offsets=np.concatenate([self.offsets, self.offsets[-1] + query.offsets[1:]]),
            vectors=np.concatenate([self.vectors, query.vectors]),
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

    def _histograms(self, forms: NDArray[np.int64]) -> csr_array:
        """Return the square roots of the words' shares by orbit of some forms, shape (n, 4 n_words)."""
        numbers = (forms[:, None] * N_VIEWS + np.arange(N_VIEWS)).ravel()  # of their views
        lengths = self.offsets[numbers + 1] - self.offsets[numbers]
        entries = np.repeat(self.offsets[numbers] - np.cumsum(lengths) + lengths, lengths) + np.arange(lengths.sum())
        views, counts = np.repeat(np.arange(len(numbers)), lengths), self.counts[entries].astype(np.float64)
        shares = counts / np.bincount(views, counts, len(numbers))[views]
        columns = self.words[entries].astype(np.int64) * N_ORBITS + ORBITS[views % N_VIEWS]
        shape = (len(forms), len(self.codebook) * N_ORBITS)
        found = csr_array((shares, (views // N_VIEWS, columns)), shape=shape)
        return found.sqrt()

    def _principal_axes(self) -> Vectors:
        sample = np.unique(np.linspace(0, len(self) - 1, min(len(self), SAMPLE)).astype(np.int64))
        rows = self._histograms(sample).toarray()
        rows -= rows.mean(axis=0)
        variances, sides = np.linalg.eigh(rows @ rows.T)
        kept = np.flatnonzero(variances > _LEAST_VARIANCE * max(variances[-1], UNIT))[-COMPONENTS:]
        axes = rows.T @ (sides[:, kept] / np.sqrt(variances[kept]))
        return np.asarray(np.round(axes / UNIT) * UNIT, dtype=np.float32)

    def _along(self, axes: Vectors) -> Vectors:
        """Components of all forms in units of :data:`UNIT`."""
        found = np.zeros((len(self), max(axes.shape[1], 1)), dtype=np.float32)
        for start in range(0, len(self), FORMS):
            forms = np.arange(start, min(start + FORMS, len(self)))
            found[forms, : axes.shape[1]] = np.round(self._histograms(forms) @ axes.astype(np.float64) / UNIT)
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
