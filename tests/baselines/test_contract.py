"""What every classical method owes to repetition, relabelling, motion, scale and shapes that it cannot treat."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark.api.contracts import Mesh, Method, Shape, UnsupportedShape
from benchmark.geometry.mesh import edges_of
from benchmark.registry import select_one
from tests.baselines.deformable import centre_line, check_real_body, moved_to, shape_of, straightness, tube
from tests.baselines.embedding import RowsOnly, brute_force_stress, limbed, moved, relabelled, sphere
from tests.baselines.test_perturbation import METHODS

#: Coordinates from the mesh, not from distances: nothing to compare with another numbering, place or size.
CONTROLS = {"identity", "surface-area"}
NAMES = [*sorted(METHODS.keys() - CONTROLS), "least-squares-mds[start=classic]"]

#: Largest difference relative to the size of the answer, where rounding decides more than usual.
TOLERANCES = {"non-metric-mds": 2e-4, "constrained-mds": 2e-4, "feature-preserved": 5e-4, "accelerated-mds": 1e-4}

TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))
BALL = sphere(150)
TWO_BALLS = Mesh(np.concatenate([BALL.vertices, BALL.vertices + 3]), np.concatenate([BALL.faces, BALL.faces + 150]))


def answer(method: Any, shape: Shape) -> np.ndarray:
    return method.canonicalise(shape).vertices if isinstance(method, Method) else method.describe(shape)


def assert_same(answered: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Forms may lie elsewhere in space, descriptors may not."""
    if expected.ndim == 2 and expected.shape[1] == 3:
        answered = moved_to(answered, expected)
    np.testing.assert_allclose(answered, expected, rtol=0, atol=tolerance * np.ptp(expected, axis=0).max())


@pytest.mark.parametrize("name", NAMES)
def test_a_method_keeps_the_contract(name: str) -> None:
    method, shape = select_one(name).create(), limbed(200)
    tolerance = TOLERANCES.get(name.partition("[")[0], 1e-5)
    expected = answer(method, shape)
    assert np.isfinite(expected).all()
    np.testing.assert_array_equal(answer(method, shape), expected)
    other, order = relabelled(shape)
    of_vertices = expected.ndim == 2 and len(expected) == shape.mesh.n_vertices
    assert_same(answer(method, other), expected[order] if of_vertices else expected, tolerance)
    assert_same(answer(method, moved(shape)), expected, tolerance)
    scale = 2.0 if of_vertices and method.info.scale == "equivariant" else 1.0
    assert_same(answer(method, moved(shape, scale=2.0)), scale * expected, 2 * tolerance)
    for mesh in (TRIANGLE, TWO_BALLS):
        with pytest.raises(UnsupportedShape):
            answer(method, Shape(identifier="unsupported", mesh=mesh))


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("name", "straight", "strain"),
    [
        ("constrained-mds", 0.88, 0.08),
        ("feature-preserved", 0.88, 0.08),
        ("mesh-unfolding", 0.98, 0.05),
        ("skeleton", 0.95, 0.15),
    ],
)
def test_a_bent_tube_straightens_and_its_edges_hardly_stretch(name: str, straight: float, strain: float) -> None:
    mesh = tube(2.4)
    form = select_one(name).create().canonicalise(shape_of(mesh))
    assert straightness(centre_line(mesh.vertices)) < 0.8
    reached = straightness(centre_line(form.vertices))
    assert reached > straight
    start, end = edges_of(mesh.faces).ends.T
    before, after = (np.linalg.norm(points[start] - points[end], axis=1) for points in (mesh.vertices, form.vertices))
    strains = np.abs(after / before - 1)
    assert form.notes["mean_edge_strain"] == pytest.approx(strains.mean())
    assert form.notes.get("largest_edge_strain", strains.max()) == pytest.approx(strains.max())
    assert strains.mean() < strain
    if name in ("constrained-mds", "feature-preserved"):  # MDS itself leaves some of a thick bend
        targets = select_one("least-squares-mds").create().canonicalise(shape_of(mesh)).vertices
        assert reached == pytest.approx(straightness(centre_line(targets)), abs=0.02)


@pytest.mark.parametrize(
    ("name", "size", "factor"),
    [
        ("accelerated-mds[samples=50]", 1200, 1.2),
        ("fast-classical-scaling", 1000, 1.2),
    ],
)
def test_the_stress_is_near_that_of_classic_scaling_without_all_pairs(name: str, size: int, factor: float) -> None:
    shape = limbed(size)
    form = select_one(name).create().canonicalise(RowsOnly(identifier="limbed", mesh=shape.mesh))
    classic = select_one("classic-mds").create().canonicalise(shape).notes["stress"]
    assert brute_force_stress(form.vertices, shape.geodesics()) < factor * classic


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "strain"),
    [
        ("constrained-mds", 0.08),
        ("feature-preserved", 0.08),
        ("mesh-unfolding", 0.05),
    ],
)
def test_real_bodies_spread_their_limbs(data_root: Path, name: str, strain: float) -> None:
    form = check_real_body(select_one(name).create(), data_root / "tosca" / "michael6.off")
    assert form.notes["mean_edge_strain"] <= strain
