import numpy as np
import pytest

from baselines._kernels.sampling import farthest_points
from baselines.nystrom_mds import NystromMDS
from tests.baselines.embedding import PointShape, limbed, sphere, spread


@pytest.mark.parametrize(("samples", "rank"), [(60, 25)])
def test_the_form_is_that_of_the_published_formula(samples, rank):
    shape = limbed(250)
    chosen = farthest_points(shape, samples)
    rows = shape.geodesics_from(chosen) ** 2
    between = (rows[:, chosen] + rows[:, chosen].T) / 2
    left, sizes, right = np.linalg.svd(between)
    inverse = right[:rank].T / sizes[:rank] @ left[:, :rank].T
    squared = rows.T @ inverse @ rows
    centre = np.eye(250) - 1 / 250
    values, vectors = np.linalg.eigh(-0.5 * centre @ (squared + squared.T) / 2 @ centre)
    expected = spread(vectors[:, -3:] * np.sqrt(np.maximum(values[-3:], 0)))
    form = NystromMDS(samples=samples, rank=rank).canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), expected, atol=1e-6 * expected.max())
    assert (form.notes["samples"], form.notes["rank"]) == (samples, rank)


def test_points_in_space_are_recovered_from_few_rows():
    # Squared Euclidean distances in space have rank five, so that five eigenvalues say all.
    points = sphere(200).vertices * [3.0, 2.0, 1.0]
    form = NystromMDS(samples=12, rank=5).canonicalise(PointShape(points))
    np.testing.assert_allclose(spread(form.vertices), spread(points), atol=1e-8)
