"""Nearest shapes by an index: those of the matrix of all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from retrieval import clock_index, neighbours
from retrieval.clock import Signature, count_words, match_all
from retrieval.clock_index import ClockIndex
from retrieval.cmbof import CMBOF
from retrieval.energy_index import EnergyIndex
from retrieval.features import Features
from retrieval.neighbours import candidates, nearest
from retrieval.spherical_harmonics import SphericalHarmonics
from retrieval.views import N_VIEWS, VIEW_PERMUTATIONS
from tests.retrieval.test_clock import random_signature

pytestmark = pytest.mark.kernels

N_WORDS = 60
CODEBOOK = np.zeros((N_WORDS, 128), dtype=np.uint8)


@pytest.fixture(scope="module")
def family() -> tuple[ClockIndex, np.ndarray]:
    """An index of 12 bodies in 10 poses each, each pose with a tenth of the words of its body drawn anew; all pairs."""
    rng = np.random.default_rng(1)
    forms = []
    for _ in range(12):
        body = random_signature(rng, N_WORDS, keypoints=8)
        words = np.repeat(body.words, body.counts)
        offsets = np.concatenate([[0], np.cumsum(body.view_sizes)]).astype(np.int32)
        for _ in range(10):
            drawn = np.where(rng.random(len(words)) < 0.1, rng.integers(0, N_WORDS, len(words)), words)
            forms.append(count_words(drawn.astype(np.int32), offsets, N_WORDS))
    return ClockIndex.counted(CODEBOOK, forms), match_all(forms)


def matrix_of(found, count):
    whole = np.zeros((count, count))
    for place in range(count):
        shapes, distances = found.of(place)
        assert place not in shapes
        assert (np.diff(distances) >= 0).all()
        whole[place, shapes] = distances
    return whole


def test_neighbours_of_all_shapes_are_the_exact_matrix(family):
    index, exact = family
    found = nearest(index, len(exact))
    assert len(found) == len(exact) and len(found.shapes) == len(exact) * (len(exact) - 1)
    np.testing.assert_array_equal(matrix_of(found, len(exact)), exact)
    again = type(found).from_arrays(found.to_arrays())
    np.testing.assert_array_equal(again.of(3)[0], found.of(3)[0])


def test_of_few_candidates_nearly_all_are_the_nearest(family, monkeypatch):
    index, exact = family
    monkeypatch.setattr(neighbours, "FEWEST_CANDIDATES", 0)
    monkeypatch.setattr(neighbours, "CANDIDATES", 3)

    def recall(index):
        found = matrix_of(nearest(index, 5), len(exact))
        fifth = np.sort(exact + np.diag(np.full(len(exact), np.inf)))[:, 4:5]
        return ((found > 0) & (found <= fifth)).sum() / (5 * len(exact))

    assert recall(index) > 0.95
    shuffled = np.random.default_rng(0).permutation(len(index))
    monkeypatch.setattr(ClockIndex, "closeness", lambda self, forms: exact[forms][:, shuffled])
    assert recall(index) < 0.5


def test_shapes_as_far_away_as_the_last_one_are_kept():
    energies = np.array([[0.0], [1.0], [-1.0], [3.0]])
    found = nearest(EnergyIndex(energies), 1)
    assert found.of(0)[0].tolist() == [1, 2]
    assert found.of(3)[0].tolist() == [1]
    assert nearest(EnergyIndex(energies[:1]), 1).of(0)[0].tolist() == []


def test_a_turn_changes_no_vector():
    signature = random_signature(np.random.default_rng(2), N_WORDS)
    words = np.split(np.repeat(signature.words, signature.counts), np.cumsum(signature.view_sizes)[:-1])
    turned = []
    for turn in VIEW_PERMUTATIONS:
        of_turn = [words[view] for view in turn]
        offsets = np.concatenate([[0], np.cumsum(list(map(len, of_turn)))]).astype(np.int32)
        turned.append(count_words(np.concatenate(of_turn), offsets, N_WORDS))
    found = ClockIndex.counted(CODEBOOK, turned)._histograms(np.arange(24)).toarray()
    np.testing.assert_array_equal(found, np.broadcast_to(found[0], found.shape))
    # Each view shares 1 among its words: the squares of the roots add up to the views that are not empty.
    assert ((found[0] * clock_index.UNIT) ** 2).sum() == pytest.approx((signature.view_sizes > 0).sum(), rel=1e-2)


def test_words_that_many_forms_hold_are_not_looked_for():
    # In view 0 all 20 forms hold word 0, and four at a time one of five others: those are half of all entries.
    words = [[0, 1 + k // 4] for k in range(20)]
    offsets = np.array([0] + [2] * N_VIEWS, dtype=np.int32)
    index = ClockIndex.counted(CODEBOOK, [count_words(np.array(w, np.int32), offsets, N_WORDS) for w in words])
    close = index.closeness(slice(0, 1))[0]
    assert np.flatnonzero(close).tolist() == [0, 1, 2, 3]
    assert close[1] == round(np.sqrt(1 / 2) / clock_index.UNIT) ** 2


def test_the_index_of_a_scorer_is_made_in_parts_and_compares_as_the_scorer_does(monkeypatch):
    rng = np.random.default_rng(3)
    scorer = CMBOF(n_words=40)

    def signature():
        sizes = rng.poisson(2, N_VIEWS)
        descriptors = rng.integers(0, 3, (sizes.sum(), 128)).astype(np.uint8)
        return Features(descriptors, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)).to_arrays()

    signatures = [signature() for _ in range(8)]
    monkeypatch.setattr(clock_index, "FORMS", 3)
    index = ClockIndex.of(scorer, signatures, draw=1)
    features = list(map(Features.from_arrays, signatures))
    np.testing.assert_array_equal(index.codebook, scorer.train_codebook(features, 1))
    np.testing.assert_array_equal(matrix_of(nearest(index, 7), 8), scorer.compare(signatures, 1))

    query = index.with_query(scorer, signatures[2])
    assert len(query) == 9
    assert query.distances(np.array([8, 8]), np.array([2, 5])).tolist() == [
        0.0,
        index.distances(np.array([2]), np.array([5]))[0],
    ]
    assert 2 in candidates(query, 3, range(8, 9))


def test_energies_are_compared_as_the_scorer_does():
    rng = np.random.default_rng(4)
    scorer = SphericalHarmonics()
    signatures = [{"energies": rng.random((32, 16))} for _ in range(20)]
    index = EnergyIndex.of(scorer, signatures, draw=0)
    np.testing.assert_array_equal(matrix_of(nearest(index, 19), 20), scorer.compare(signatures, 0))
    assert len(index.with_query(scorer, signatures[0])) == 21


def test_forms_without_words_have_an_index():
    empty = Signature(*(np.empty(0, np.int32),) * 2, np.zeros(N_VIEWS + 1, np.int32))
    index = ClockIndex.counted(CODEBOOK, [empty, empty])
    assert nearest(index, 1).of(0)[1].tolist() == [0.0]


@pytest.mark.parametrize("rows", [1, 2, 64])
def test_candidates_are_the_closest_others(monkeypatch, rows):
    monkeypatch.setattr(neighbours, "ROWS", rows)
    index = EnergyIndex(np.array([0.0, 1.0, 3.0, 7.0, 15.0])[:, None])
    assert np.sort(candidates(index, 2)).tolist() == [[1, 2], [0, 2], [0, 1], [1, 2], [2, 3]]
    assert candidates(index, 1, range(3, 5)).tolist() == [[2], [3]]
    assert np.sort(candidates(index, 9))[4].tolist() == [0, 1, 2, 3]


def test_of_candidates_that_are_equally_close_the_first_are_taken():
    energies = np.random.default_rng(0).integers(0, 2, (1000, 1)).astype(float)
    found = candidates(EnergyIndex(energies), 90, range(1))
    assert found.tolist() == [np.flatnonzero(energies[:, 0] == energies[0])[1:91].tolist()]
