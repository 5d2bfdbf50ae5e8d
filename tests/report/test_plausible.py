"""Floors of published figures: by hand, and on Tables I to III."""

import numpy as np
import pytest

from benchmark.reference.paper import CLASSICAL, MEASURES, PRINTED
from tools.plausible import ROUNDING, least_dcg, measures, pose_first, report

SIZES = {"I": (5, 20), "II": (40, 10)}


def test_measures_by_hand():
    relevant = np.array([[True, False, False, True, False], [False, True, True, False, False]])
    nn, first, second, dcg = measures(relevant, 2)[0]
    assert (nn, first, second) == (1, 0.5, 1)
    assert dcg == pytest.approx((1 + 1 / 2) / 2)


@pytest.mark.parametrize("seed", range(5))
def test_no_ranking_has_a_lower_dcg_than_the_bound(seed):
    generator = np.random.default_rng(seed)
    relevant = np.array([generator.permutation([True] * 19 + [False] * 80) for _ in range(30)])
    means = measures(relevant, 19).mean(axis=0)
    assert means[3] >= least_dcg(dict(zip(MEASURES, means, strict=True)), 5, 20)


@pytest.mark.parametrize("table", SIZES)
def test_every_row_is_arithmetically_possible(table):
    assert all(
        PRINTED[table][name]["DCG"] + ROUNDING >= least_dcg(PRINTED[table][name], *SIZES[table]) for name in CLASSICAL
    )


def test_rows_of_table_one_lie_below_simulated_galleries_of_five_but_not_all():
    floor = dict(zip(MEASURES, pose_first(5, 20, 100), strict=True))
    below = {name for name in CLASSICAL for m in ("ST", "DCG") if PRINTED["I"][name][m] + ROUNDING < floor[m]}
    assert {"constrained-mds", "least-squares-mds", "skeleton"} <= below
    assert "classic-mds" not in below


def test_a_row_that_no_ranking_has_is_named():
    """All of the first five matches are of the class, so DCG is at least that of five hits in the first places."""
    lines = report({"none": {"NN": 1.0, "FT": 1.0, "ST": 1.0, "DCG": 0.4}}, 3, 6, steps=1)
    assert lines[0] == "3 classes of 6 shapes"
    assert lines[1].endswith(" .29 .29 .59 .59")
    assert lines[3].endswith("impossible")
