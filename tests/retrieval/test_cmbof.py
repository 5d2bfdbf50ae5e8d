"""The scorer on forms that move, turn and mirror, and its matching by the definition."""

import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmark.errors import DatasetError, InvalidMesh
from benchmark.geometry.mesh import Mesh
from benchmark.machine import THREADS
from benchmark.pipeline.outputs import compute_distances
from retrieval.clock import count_words, match
from retrieval.cmbof import CMBOF
from retrieval.codebook import integers_pay, nearest_words, sample_codebook
from retrieval.views import view_sphere
from tests.retrieval.figures import figure, turned

MIRROR = np.diag([1.0, -1.0, 1.0])
SMALL = CMBOF(n_words=300, image_size=128)
VIEWS = view_sphere(2)


@cache
def signature(scorer, mesh):
    """Meshes compare by identity, so that each is drawn once."""
    return scorer.signature(mesh)


def distances(scorer, meshes):
    return scorer.compare([signature(scorer, mesh) for mesh in meshes], 0)


@pytest.fixture(scope="module")
def figures():
    return [figure(seed) for seed in range(6)]


def test_a_form_equals_itself_and_hardly_changes_when_it_moves(figures):
    moved = turned(figures[0], Rotation.random(rng=1).as_matrix())
    moved = moved.with_vertices(7.3 * moved.vertices + np.array([100.0, -3, 20]))
    matrix = distances(SMALL, [*figures, figures[0], moved])
    assert (np.diag(matrix) == 0).all()
    assert (matrix == matrix.T).all()
    assert matrix[0, 6] == 0
    others = matrix[:6, :6][~np.eye(6, dtype=bool)]
    assert others.min() > 15
    assert matrix[0, 7] < 0.4 * others.min()


def test_a_mirror_image_is_another_form_unless_allowed(figures):
    meshes = [*figures, turned(figures[0], MIRROR)]
    plain = distances(SMALL, meshes)
    allowed = distances(CMBOF(n_words=300, image_size=128, allow_mirror=True), meshes)
    assert plain[0, 6] > 0.7 * plain[0, 1:6].min()
    assert allowed[0, 6] < 0.4 * allowed[0, 1:6].min()
    assert (allowed == allowed.T).all()
    assert (np.diag(allowed) == 0).all()
    assert (allowed <= plain).all()


@pytest.mark.parametrize("mirrored", [False, True])
def test_queries_depend_on_the_gallery_alone(figures, mirrored):
    scorer = CMBOF(n_words=50, image_size=64, subdivisions=1, allow_mirror=mirrored)
    *gallery, first, second = (signature(scorer, mesh) for mesh in figures)
    both = compute_distances(scorer, gallery, 1, [first, second])
    assert (compute_distances(scorer, gallery, 1, [second]) == both[1:]).all()
    assert (compute_distances(scorer, gallery[::-1], 1, [second, first])[::-1, ::-1] == both).all()
    assert (scorer.compare_to([*gallery], gallery, 1) == scorer.compare(gallery, 1)).all()
    assert (scorer.compare([*gallery, first], 1)[-1, :-1] != both[0]).any(), (
        "its features are among the words"
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_threads_that_share_a_comparison_change_no_bit(figures, mirrored, monkeypatch):
    scorer = CMBOF(image_size=64, n_words=50, allow_mirror=mirrored)
    gallery = [signature(scorer, figure) for figure in figures]
    monkeypatch.delenv(THREADS, raising=False)
    alone = scorer.compare(gallery, 0), scorer.compare_to(gallery[:2], gallery, 0)
    monkeypatch.setenv(THREADS, "3")
    together = scorer.compare(gallery, 0), scorer.compare_to(gallery[:2], gallery, 0)
    for by_one, by_several in zip(alone, together, strict=True):
        np.testing.assert_array_equal(by_several, by_one)


def test_noise_in_the_last_digits_of_a_form_changes_no_bit_of_its_signature(figures):
    random = np.random.default_rng(0)
    for form in figures:
        noise = (
            5e-13 * np.ptp(form.vertices, axis=0).max() * random.uniform(-1, 1, form.vertices.shape)
        )
        clean, noisy = (
            signature(SMALL, form),
            signature(SMALL, form.with_vertices(form.vertices + noise)),
        )
        assert all(np.array_equal(clean[name], noisy[name]) for name in clean)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.full((3, 3), 7.3), [[0, 1, 2]], "zero extent"),
        (np.eye(3), np.zeros((0, 3)), "no triangles"),
    ],
)
def test_bad_forms_are_named(vertices, faces, message):
    with pytest.raises(InvalidMesh, match=message):
        SMALL.signature(Mesh(vertices, faces))


def test_a_gallery_without_keypoints_is_named():
    line = SMALL.signature(Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), [[0, 1, 2]]))
    with pytest.raises(DatasetError, match="keypoint"):
        SMALL.compare([line, line], 0)


def histograms(rng, n_words):
    """Histograms of one form, with empty views, and the same as a table (views, words)."""
    sizes = rng.poisson(12, 66) * (rng.uniform(size=66) > 0.1)
    words = (n_words * rng.beta(0.4, 1.0, sizes.sum())).astype(np.int32)  # as unequal as real ones
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    table = np.zeros((66, n_words), dtype=int)
    np.add.at(table, (np.repeat(np.arange(66), sizes), words), 1)
    return count_words(words, offsets, n_words), table


def by_definition(first, second):
    shared = np.minimum(first[:, None], second[None]).sum(axis=2)
    larger = np.maximum(first.sum(axis=1)[:, None], second.sum(axis=1))
    dissimilarity = 1 - np.where(larger == 0, 1.0, shared / np.maximum(larger, 1))
    return min(dissimilarity[np.arange(66), turn].sum() for turn in VIEWS.permutations)


def test_matching_is_that_of_the_definition():
    rng = np.random.default_rng(0)
    forms, tables = zip(*(histograms(rng, 60) for _ in range(7)), strict=True)
    expected = [[by_definition(a, b) for b in tables] for a in tables]
    matrix = match(forms, forms, VIEWS.permutations, 60)
    np.testing.assert_allclose(matrix, expected, atol=1e-11)
    np.testing.assert_array_equal(match(forms[:3], list(forms), VIEWS.permutations, 60), matrix[:3])
    order = rng.permutation(7)
    shuffled = [forms[place] for place in order]
    np.testing.assert_array_equal(
        match(shuffled, shuffled, VIEWS.permutations, 60), matrix[np.ix_(order, order)]
    )


def random_descriptors(seed, count, largest=255):
    return np.random.default_rng(seed).integers(0, largest + 1, (count, 128)).astype(np.uint8)


def test_the_draw_of_words_depends_on_the_seed_but_not_on_the_order_of_shapes():
    parts = [random_descriptors(seed, 300) for seed in range(4)]
    words = sample_codebook(parts, 100, seed=1)
    assert len(np.unique(words, axis=0)) == 100
    np.testing.assert_array_equal(sample_codebook([*parts[::-1], parts[0]], 100, seed=1), words)
    other = sample_codebook(parts, 100, seed=2)
    assert (words[:, None] == other).all(axis=2).sum() < 30
    assert len(sample_codebook(parts[:1], 1000, seed=1)) == 300


@pytest.mark.parametrize("way", [integers_pay, bool])
@pytest.mark.parametrize("largest", [2, 60, 255])
def test_nearest_words_are_exact_and_ties_go_to_the_lower_index(largest, way):
    descriptors, words = random_descriptors(0, 1500, largest), random_descriptors(1, 70, largest)
    words = np.concatenate([words, words[:10], descriptors[:5], 255 - descriptors[:5]])
    squared = ((descriptors[:, None].astype(np.int64) - words[None].astype(np.int64)) ** 2).sum(
        axis=2
    )
    np.testing.assert_array_equal(
        nearest_words(descriptors, words, by_integers=way()), squared.argmin(axis=1)
    )


def test_a_large_gallery_is_compared_by_the_faster_way(monkeypatch):
    signatures = [
        {"descriptors": random_descriptors(k, 60), "view_offsets": np.array([0] + [60] * 66)}
        for k in (0, 1)
    ]
    few = CMBOF(n_words=20).compare(signatures, 0)
    ways = []
    monkeypatch.setattr("retrieval.cmbof.MANY", 120)
    monkeypatch.setattr(
        "retrieval.cmbof.integers_pay", lambda: ways.append("asked") or integers_pay()
    )
    np.testing.assert_array_equal(CMBOF(n_words=20).compare(signatures, 0), few)
    assert ways


EXTREMES = """
import numpy as np
from retrieval.codebook import integers_pay, nearest_words
ends = np.array([0, 255], np.uint8)
rows, words = (np.random.default_rng(seed).choice(ends, (700, 128)) for seed in (0, 1))
squares = (words.astype(float) ** 2).sum(axis=1)
nearest = nearest_words(rows, words, by_integers=integers_pay())
assert (nearest == (2.0 * rows @ words.T.astype(float) - squares).argmax(axis=1)).all()
"""


@pytest.mark.slow
def test_processors_whose_sums_of_bytes_overflow_find_the_same_words():
    subprocess.run(
        [sys.executable, "-c", EXTREMES],
        check=True,
        env=os.environ | {"ONEDNN_MAX_CPU_ISA": "AVX2"},
    )
