"""What every classical method owes to repetition, relabelling, motion, scale and shapes that it cannot treat."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmark.api.contracts import Mesh, Method, Shape, UnsupportedShape
from benchmark.pipeline.outputs import compute_descriptor, compute_form
from benchmark.registry import by_name, select_one
from benchmark.registry.known import BUILT_IN
from tests.baselines.deformable import centre_line, moved_to, shape_of, straightness, tube
from tests.baselines.embedding import limbed, moved, sphere
from tests.geometry.surfaces import joined, relabelled
from tests.toy import rod

#: All but those that copy the mesh: nothing to compare with another numbering, place or size.
NAMES = [
    *(name for name, target in BUILT_IN.items() if "baselines" in target and name not in ("identity", "surface-area")),
    "least-squares-mds[start=classic]",
]
#: Largest difference relative to the size of the answer, where rounding decides more than usual.
TOLERANCES = {"accelerated-mds": 1e-4}

TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))
BALL = sphere(150)
TWO_BALLS = joined(BALL, BALL.with_vertices(BALL.vertices + 3))


def answer(method: Any, shape: Shape) -> np.ndarray:
    return compute_form(method, shape).vertices if isinstance(method, Method) else compute_descriptor(method, shape)


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
    np.testing.assert_array_equal(answer(method, shape), expected)
    other, new = relabelled(shape.mesh)
    of_vertices = expected.ndim == 2 and len(expected) == shape.mesh.n_vertices
    expected_there = expected[np.argsort(new)] if of_vertices else expected
    assert_same(answer(method, Shape(identifier="other", mesh=other)), expected_there, tolerance)
    assert_same(answer(method, moved(shape)), expected, tolerance)
    scale = 2.0 if of_vertices and method.info.scale == "equivariant" else 1.0
    assert_same(answer(method, moved(shape, scale=2.0)), scale * expected, 2 * tolerance)
    for mesh, why in ((TRIANGLE, "at least 4 and one"), (TWO_BALLS, "2 pieces")):
        with pytest.raises(UnsupportedShape, match=why):
            answer(method, Shape(identifier="unsupported", mesh=mesh))


def test_methods_that_need_all_pairs_refuse_a_large_surface_at_once() -> None:
    large = Shape(identifier="large", mesh=rod(0.1, 0.0, rings=2857, sides=7))
    needs = {name: component.info.needs for name, component in by_name("method").items() if name in BUILT_IN}
    assert {name for name in NAMES[:-1] if needs[name] == ("pairs",)} == {
        *("classic-mds", "non-metric-mds", "least-squares-mds", "constrained-mds"),
        *("skeleton", "feature-preserved", "sd-gdm"),
    }
    with pytest.raises(UnsupportedShape, match="20001 vertices, where distances of all pairs"):
        answer(select_one("classic-mds").create(), large)


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("name", "straight", "strain"),
    [
        ("constrained-mds", 0.85, 0.08),
        ("feature-preserved", 0.85, 0.08),
        ("mesh-unfolding", 0.97, 0.05),
        ("skeleton", 0.95, 0.15),
    ],
)
def test_a_bent_tube_straightens_and_its_edges_hardly_stretch(name: str, straight: float, strain: float) -> None:
    mesh = tube(2.4)
    form = select_one(name).create().canonicalise(shape_of(mesh))
    assert straightness(centre_line(mesh.vertices)) < 0.8
    reached = straightness(centre_line(form.vertices))
    assert reached > straight
    assert form.notes["mean_edge_strain"] < strain
    if name in ("constrained-mds", "feature-preserved"):  # MDS itself leaves some of a thick bend
        targets = select_one("least-squares-mds").create().canonicalise(shape_of(mesh)).vertices
        assert reached == pytest.approx(straightness(centre_line(targets)), abs=0.03)
