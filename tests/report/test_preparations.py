"""Jittered preparations of a row: their mean and spread by hand, and what intervals and tests make of them."""

import csv
import io
import json
from statistics import NormalDist

import numpy as np
import pytest

from benchmark.methods.registry import methods
from benchmark.report.cell import cell_of
from benchmark.report.comparison import compare_folders, compare_methods
from benchmark.report.content import contents
from benchmark.report.formats import as_csv, as_json, markdown
from benchmark.report.results import Result, Results
from benchmark.report.statistics.significance import permutation_test, widened
from benchmark.results import open_results
from benchmark.storage.store import Store
from tests.records import record

REACH = NormalDist().inv_cdf(0.975)
SHAPES = [f"{animal}{number}" for animal in ("cat", "dog") for number in range(20)]
LABELS = [shape[:3] for shape in SHAPES]


def row(method, nn, *, jitter=0, **more):
    gallery = f"rods[jitter={jitter}]" if jitter else "rods"
    return record(method, gallery=gallery, nn=nn, shapes=SHAPES, labels=LABELS, n_shapes=40, **more)


def with_repeats(method, nn, *repeats):
    return Result(row(method, nn), repeats={k: row(method, each, jitter=k) for k, each in enumerate(repeats, 1)})


def of_rows(*results):
    (table,) = contents(results, blanks=False)
    return table


def test_mean_and_spread_by_hand():
    cell = cell_of([with_repeats("gps", 0.75, 0.5, 0.6, 0.7)], 1)
    assert cell.scores["NN"] == 0.75
    assert cell.preparation_mean["NN"] == pytest.approx(0.6)
    assert cell.preparation_sd["NN"] == pytest.approx(0.1)  # deviations -.1, 0, .1: .02 / 2
    assert cell.preparation_sd["FT"] == 0


def test_a_row_of_several_galleries_is_repeated_as_a_whole():
    def fold(number, nn, *repeats):
        name = f"humans fold {number}"
        made = [record("gps", gallery=f"humans[jitter={k}] fold {number}", nn=v) for k, v in enumerate(repeats, 1)]
        return Result(record("gps", gallery=name, nn=nn), repeats=dict(enumerate(made, 1)))

    cell = cell_of([fold(0, 0.5, 0.4, 0.6), fold(1, 0.5, 0.6, 0.8)], 2)
    assert [each["NN"] for each in cell.repeats] == pytest.approx([0.5, 0.7])
    assert cell_of([fold(0, 0.5, 0.4, 0.6), fold(1, 0.5, 0.6)], 2).preparation_sd is None  # one is no spread


def test_without_repeats_a_table_reads_as_before():
    table = of_rows(Result(row("gps", 0.5)), Result(row("pca", 0.5)))
    assert "reparation" not in as_json([table]) + as_csv([table]) + markdown(table)


def test_json_csv_and_notes_have_the_spread_of_rows_that_were_repeated():
    table = of_rows(with_repeats("gps", 0.75, 0.5, 0.6, 0.7), Result(row("pca", 0.5)))
    gps, pca = json.loads(as_json([table]))
    assert (gps["n_preparations"], gps["preparation_sd"]["NN"], gps["preparation_mean"]["NN"]) == (3, 0.1, 0.6)
    assert "preparation_sd" not in pca
    lines = list(csv.DictReader(io.StringIO(as_csv([table]))))
    assert [line["preparation_sd_NN"] for line in lines] == ["0.1", ""]
    assert "over 3 preparations of vertices jittered" in markdown(table)
    assert "Gps 0.100 0.000 0.000 0.000" in markdown(table)


def test_rows_that_differ_by_less_than_the_noise_of_preparation_are_not_told_apart():
    best, other = 1.0, 0.65
    before = of_rows(Result(row("gps", best)), Result(row("pca", other)))
    steady = of_rows(with_repeats("gps", best, best, best), with_repeats("pca", other, other, other))
    noisy = of_rows(with_repeats("gps", best, 0.7, 1.0), with_repeats("pca", other, 0.5, 0.8))
    place = ("pca", "mesh", "NN")
    assert not before.significance[place].is_inseparable
    assert steady.significance[place] == before.significance[place]
    assert noisy.significance[place].is_inseparable
    assert "*0.65*" in markdown(noisy)
    assert "*0.65*" not in markdown(before)
    assert noisy.significance[place].low < before.significance[place].low


def test_intervals_add_independent_noise():
    assert widened(0.4, 0.7, 0.5, 0.0) == (0.4, 0.7)
    low, high = widened(0.47, 0.54, 0.5, 0.04 / REACH)
    assert (low, high) == pytest.approx((0.45, 0.5 + 0.0032**0.5))  # 3, 4, 5; and 4, 4
    assert widened(0.1, 0.9, 0.5, 1.0) == (0, 1)


def test_the_test_knows_of_noise_that_no_query_shows():
    # Queries say nothing: the probability is that of so large a normal number.
    nothing = np.zeros((4, 2))
    assert permutation_test(nothing, np.array([1.0, 0.0])).tolist() == [1, 1]
    gains = np.repeat(1e6 * np.array([[1.0, -1.0]]), 2000, axis=0).T.ravel()[:, None]
    gains[:2000] *= 1.5  # a sum of 1e9 whose own noise is some 8e7
    found = permutation_test(gains, np.array([5e8]))
    assert found == pytest.approx(2 * NormalDist().cdf(-1e9 / np.hypot(5e8, 1e6 * np.sqrt(2000 * 3.25))), abs=0.01)
    assert permutation_test(gains) == pytest.approx(1e-4)


@pytest.fixture
def folder(tmp_path):
    store = Store.open(tmp_path / "results")
    made = [row("gps", 0.75), *(row("gps", nn, jitter=k) for k, nn in ((1, 0.5), (2, 0.7)))]
    made += [row("gps", 0.9, jitter=3, code="2"), row("pca", 0.5, jitter=1)]
    for each in made:
        store.records.write(each)
    return tmp_path / "results"


def test_repeats_go_with_the_row_that_they_repeat_and_stand_nowhere_else(folder):
    (only,) = Results(Store.open(folder), methods()).all()
    assert (only.record["gallery"], sorted(only.repeats)) == ("rods", [1, 2])  # the third is of other code
    frame = open_results(folder).records()
    assert len(frame) == 1
    assert frame["NN_preparation_mean"].iloc[0] == pytest.approx(0.6)
    assert frame["NN_preparation_sd"].iloc[0] == pytest.approx(0.02**0.5)


def test_a_comparison_knows_of_the_noise_and_takes_repeats_for_no_pairs():
    def pairs(*results):
        return [each for result in results for each in (result.record, *result.repeats.values())]

    steady = compare_methods(pairs(Result(row("gps", 1.0)), Result(row("pca", 0.65))), "gps", "pca")
    noisy = pairs(with_repeats("gps", 1.0, 0.7, 1.0), with_repeats("pca", 0.65, 0.5, 0.8))
    found = compare_methods(noisy, "gps", "pca")
    assert [each.where for each in found.differences] == ["rods mesh"]
    assert steady.differences[0].probabilities["NN"] < 0.05 < found.differences[0].probabilities["NN"]
    assert found.differences[0].intervals["NN"][0] < steady.differences[0].intervals["NN"][0] < 0
    assert found.differences[0].probabilities["FT"] == steady.differences[0].probabilities["FT"] == 1
    assert len(compare_folders(noisy, noisy).differences) == 2
