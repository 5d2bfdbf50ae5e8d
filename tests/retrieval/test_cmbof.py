from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from benchmark.errors import ConfigurationError, DatasetError, InvalidMesh
from benchmark.geometry.mesh import Mesh
from benchmark.registry import select_one
from retrieval.cmbof import CMBOF, Features, Signature
from tests.retrieval.figures import figure, turned

MIRROR = np.diag([1.0, -1.0, 1.0])
SMALL = CMBOF(n_words=300, image_size=128)


@cache
def extract(scorer: CMBOF, mesh: Mesh) -> Features:
    """Meshes compare by identity, so that each is drawn once."""
    return scorer.extract(mesh)


def signatures(scorer: CMBOF, meshes: list[Mesh]) -> list[Signature]:
    features = [extract(scorer, mesh) for mesh in meshes]
    codebook = scorer.train_codebook(features)
    return [scorer.quantise(part, codebook) for part in features]


def distances(scorer: CMBOF, meshes: list[Mesh]) -> NDArray[Any]:
    return scorer.distances(signatures(scorer, meshes))


@pytest.fixture(scope="module")
def figures() -> list[Mesh]:
    return [figure(seed) for seed in range(6)]


@pytest.mark.parametrize(("subdivisions", "n_views"), [(0, 6), (1, 18)])
def test_views_of_each_subdivision_are_described_and_compared(
    figures: list[Mesh], subdivisions: int, n_views: int
) -> None:
    scorer = CMBOF(n_words=300, image_size=64, subdivisions=subdivisions, allow_mirror=True)
    assert len(extract(scorer, figures[0]).view_offsets) == scorer.n_views + 1 == n_views + 1
    matrix = distances(scorer, [figures[0], figures[1], turned(figures[0], MIRROR)])
    assert matrix[0, 2] < 0.6 * matrix[0, 1] < 0.6 * n_views


def test_a_subdivision_without_views_is_refused_and_the_default_has_no_name_of_its_own() -> None:
    assert select_one("cm-bof[subdivisions=2]", kind="scorer").name == "cm-bof"
    for wrong in ("-1", "4", "1.5"):
        with pytest.raises(ConfigurationError, match="subdivisions"):
            select_one(f"cm-bof[subdivisions={wrong}]", kind="scorer")


def test_a_form_equals_itself_and_differs_from_others(figures: list[Mesh]) -> None:
    matrix = distances(SMALL, [*figures, figures[0]])
    assert (np.diag(matrix) == 0).all()
    assert matrix[0, 6] == 0
    assert matrix[:6, :6][~np.eye(6, dtype=bool)].min() > 15


def test_any_rotation_translation_and_scale_hardly_matter_with_pose_normalisation(figures: list[Mesh]) -> None:
    moved = turned(figures[0], Rotation.random(rng=1).as_matrix())
    moved = moved.with_vertices(7.3 * moved.vertices + np.array([100.0, -3, 20]))
    matrix = distances(SMALL, [*figures, moved])
    assert matrix[0, 6] < 0.4 * matrix[0, 1:6].min()


def test_a_mirror_image_is_another_form_unless_allowed(figures: list[Mesh]) -> None:
    meshes = [*figures, turned(figures[0], MIRROR)]
    plain = distances(SMALL, meshes)
    allowed = distances(CMBOF(n_words=300, image_size=128, allow_mirror=True), meshes)
    assert plain[0, 6] > 0.7 * plain[0, 1:6].min()
    assert allowed[0, 6] < 0.4 * allowed[0, 1:6].min()
    np.testing.assert_array_equal(allowed, allowed.T)
    assert (np.diag(allowed) == 0).all()
    assert (allowed <= plain).all()


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((4, 3)), [[0, 1, 2]], "zero extent"),
        (np.full((3, 3), 7.3), [[0, 1, 2]], "zero extent"),
        (np.eye(3), np.zeros((0, 3)), "no triangles"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "NaN"),
    ],
)
def test_bad_forms_are_named(vertices: ArrayLike, faces: ArrayLike, message: str) -> None:
    with pytest.raises(InvalidMesh, match=message):
        SMALL.extract(Mesh(vertices, faces))


def test_a_gallery_without_keypoints_is_named() -> None:
    features = SMALL.extract(Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), [[0, 1, 2]]))
    with pytest.raises(DatasetError, match="keypoint"):
        SMALL.train_codebook([features])


def test_noise_in_the_last_digits_of_a_form_changes_no_bit_of_its_features(figures: list[Mesh]) -> None:
    random = np.random.default_rng(0)
    for form in figures:
        size = np.ptp(form.vertices, axis=0).max()
        noisy = form.with_vertices(form.vertices + 5e-13 * size * random.uniform(-1, 1, form.vertices.shape))
        assert not np.array_equal(noisy.vertices, form.vertices)
        clean, disturbed = extract(SMALL, form), extract(SMALL, noisy)
        np.testing.assert_array_equal(disturbed.descriptors, clean.descriptors)
        np.testing.assert_array_equal(disturbed.view_offsets, clean.view_offsets)
