"""Intervals and tests: by hand, against scipy, and as tables show them."""

import numpy as np
import pytest
from scipy import stats

from benchmark.report.content import contents
from benchmark.report.formats import render
from benchmark.report.results import Result
from benchmark.report.significance import (
    ALPHA,
    class_permutation_test,
    holm,
    intervals,
    least_class_probability,
    permutation_test,
)
from tests.records import MEASURES, record

#: Millionths, in which queries are counted.
ONE = 1e6


def column(*values):
    return ONE * np.array(values, dtype=float)[:, None]


# Intervals -----------------------------------------------------------------------------------------------------------


def test_of_two_classes_of_which_one_is_found_the_interval_is_everything():
    # Means of two draws are 0, 1/2 and 1 in a quarter, a half and a quarter of the samples.
    assert intervals(column(1, 1, 0, 0), "aabb").tolist() == [[0, 1]]


def test_intervals_are_those_of_scipy():
    generator = np.random.default_rng(5)
    labels = np.repeat(np.arange(12), generator.integers(3, 9, 12))
    values = np.rint(ONE * np.clip(generator.normal(0.1 * (labels % 6), 0.2), 0, 1))
    sums, sizes = np.bincount(labels, weights=values), np.bincount(labels)
    peer = stats.bootstrap(
        (sums, sizes), lambda s, n, axis: s.sum(axis=axis) / n.sum(axis=axis), paired=True, n_resamples=20_000,
        method="percentile", rng=1,
    ).confidence_interval  # fmt: skip
    ((low, high),) = intervals(values[:, None], labels)
    assert high - low > 0.1
    assert [low, high] == pytest.approx([peer.low / ONE, peer.high / ONE], abs=0.004)


def test_a_row_without_some_queries_has_an_interval_of_the_others():
    values = np.hstack([column(1, 1, 0, 0), column(1, 1, np.nan, np.nan), np.full((4, 1), np.nan)])
    found = intervals(values, "aabb")
    assert found[:2].tolist() == [[0, 1], [1, 1]]
    assert np.isnan(found[2]).all()


# Tests ---------------------------------------------------------------------------------------------------------------


def test_probability_by_hand():
    # Of five equal gains, two of the 32 ways to exchange give as large a sum; no gain is as likely as can be.
    assert permutation_test(column(1, 1, 1, 1, 1)) == pytest.approx(2 / 32, abs=0.01)
    assert permutation_test(column(0, 0, 0)) == 1
    assert permutation_test(column(1, -1)) == 1


def test_probability_over_classes_by_hand():
    # Three classes gain, the fourth loses less: of 16 ways to exchange, all four alike and one turned are as large.
    gains = column(1, 1, 1, 1, 1, 1, -0.5, -0.5)
    assert class_permutation_test(gains, "aabbccdd").tolist() == [4 / 16]
    assert class_permutation_test(column(1, 1, 0, 0), "aabb").tolist() == [1.0]
    assert class_permutation_test(column(1, 1, 1, 1, 1), "abcde").tolist() == [least_class_probability(5)] == [0.0625]
    assert least_class_probability(40) == pytest.approx(1e-4)


def test_probabilities_over_many_classes_are_those_over_as_many_queries():
    gains = np.rint(ONE * np.random.default_rng(4).normal(0.1, 0.4, (60, 2)))
    whole = class_permutation_test(np.repeat(gains, 3, axis=0), np.repeat(np.arange(60), 3).tolist())
    assert whole.tolist() == permutation_test(gains).tolist()


@pytest.mark.exhaustive
@pytest.mark.parametrize("sizes", [(20,) * 5, (11, 6, 7, 9, 4, 8, 20, 12, 3), (10,) * 40])
def test_at_most_six_in_a_hundred_galleries_without_a_difference_are_called_different(sizes):
    generator, n_galleries = np.random.default_rng(0), 2000
    of_query = np.repeat(np.arange(len(sizes)), sizes)
    poses = generator.normal(0, 0.2, (len(of_query), n_galleries))
    subjects = generator.normal(0, 0.1, (len(sizes), n_galleries))[of_query]

    def share(probabilities):
        return np.mean(np.concatenate(list(probabilities)) < ALPHA)

    parts = range(0, n_galleries, 250)
    # Other poses: the subjects are these, and their effects have no mean. Other subjects: effects are random.
    these = np.rint(ONE * (poses + subjects - subjects.mean(axis=0)))
    others = np.rint(ONE * (poses + subjects))
    assert share(permutation_test(these[:, k : k + 250]) for k in parts) <= 0.06
    assert share(class_permutation_test(others[:, k : k + 250], of_query.tolist()) for k in parts) <= 0.06
    assert share(permutation_test(others[:, k : k + 250]) for k in parts) > 0.2


def test_probabilities_are_those_of_scipy():
    generator = np.random.default_rng(3)
    first, second = np.rint(ONE * generator.random((2, 60, 3)))
    second += np.rint(ONE * np.array([0.0, 0.08, 0.2]))
    found = permutation_test(second - first)
    for k in range(3):
        peer = stats.permutation_test(
            (first[:, k], second[:, k]), lambda a, b, axis: (b - a).mean(axis=axis), permutation_type="samples",
            vectorized=True, n_resamples=9999, rng=k,
        )  # fmt: skip
        assert found[k] == pytest.approx(peer.pvalue, abs=0.02)
    assert found[0] > 0.05 > found[2]


def test_a_figure_is_judged_alike_alone_and_beside_others():
    generator = np.random.default_rng(4)
    values = np.rint(ONE * generator.normal(0.03, 0.2, (40, 3)))
    values[:20, 1] = np.nan
    alone = [intervals(values[:, [k]], np.arange(40) // 5)[0].tolist() for k in range(3)]
    assert intervals(values, np.arange(40) // 5).tolist() == alone
    gains = np.nan_to_num(values)
    alone = [float(permutation_test(gains[:, [k]])[0]) for k in range(3)]
    assert permutation_test(gains).tolist() == alone


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


# Queries -------------------------------------------------------------------------------------------------------------


# Tables --------------------------------------------------------------------------------------------------------------

N = 12
SHAPES = [f"{animal}{k}" for animal in ("cat", "dog", "fox", "hen") for k in range(N)]


def of(method, hits, family="extended"):
    """A method that finds the first shapes of each class."""
    values = [float(int(shape[3:]) < hits) for shape in SHAPES]
    mean = float(np.mean(values))
    return record(
        method, family=family, shapes=SHAPES, labels=[shape[:3] for shape in SHAPES], n_shapes=len(SHAPES), n_classes=4,
        per_query=dict.fromkeys(MEASURES, values), scores=dict.fromkeys(MEASURES, mean),
        codebook_deviation=dict.fromkeys(MEASURES, 0.02),
    )  # fmt: skip


@pytest.fixture(scope="module")
def table():
    records = [of("best", 10), of("near", 9), of("far", 3), of("oracle", 12, "control")]
    (found,) = contents([Result(each) for each in records])
    return found


def test_the_best_form_is_bold_what_cannot_be_told_from_it_italic_and_controls_neither(table):
    lines = render([table], ["markdown"])["table-rods.md"].splitlines()
    shown = {line.split("|")[1].strip(): line.split("|")[2].strip() for line in lines if line.startswith("| ")}
    assert {name: shown[name] for name in ("Best", "Near", "Far", "Oracle")} == {
        "Best": "**0.83**", "Near": "*0.75*", "Far": "0.25", "Oracle": "1.00",
    }  # fmt: skip
    assert "- Bold: best of the column, excluding controls; italic:" in "\n".join(lines)
    latex = render([table], ["latex"])["table-rods.tex"]
    assert r"Best & \textbf{0.83}" in latex
    assert r"Near & \textit{0.75}" in latex
