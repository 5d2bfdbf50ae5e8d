"""Surfaces that are too large for all pairs, and a tube that straightens."""

from __future__ import annotations

import pytest

from benchmark.api.contracts import Shape, UnsupportedShape
from benchmark.pipeline.outputs import compute_form
from benchmark.registry import by_name, select_one
from tests.baselines.deformable import centre_line, shape_of, straightness, tube
from tests.toy import rod


def test_methods_that_need_all_pairs_refuse_a_large_surface_at_once() -> None:
    large = Shape(identifier="large", mesh=rod(0.1, 0.0, rings=2857, sides=7))
    assert {
        name for name, component in by_name("method").items() if component.info.needs == ("pairs",)
    } == {
        *("classic-mds", "non-metric-mds", "least-squares-mds", "constrained-mds"),
        *("skeleton", "feature-preserved", "sd-gdm"),
    }
    with pytest.raises(UnsupportedShape, match="20001 vertices, where distances of all pairs"):
        compute_form(select_one("classic-mds").create(), large)


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
def test_a_bent_tube_straightens_and_its_edges_hardly_stretch(
    name: str, straight: float, strain: float
) -> None:
    mesh = tube(2.4)
    form = select_one(name).create().canonicalise(shape_of(mesh))
    assert straightness(centre_line(mesh.vertices)) < 0.8
    reached = straightness(centre_line(form.vertices))
    assert reached > straight
    assert form.notes["mean_edge_strain"] < strain
    if name in ("constrained-mds", "feature-preserved"):  # MDS itself leaves some of a thick bend
        targets = select_one("least-squares-mds").create().canonicalise(shape_of(mesh)).vertices
        assert reached == pytest.approx(straightness(centre_line(targets)), abs=0.03)
