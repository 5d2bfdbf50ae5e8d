"""Jittered preparations of a row: their spread by hand, and that intervals and tests pass them over."""

import csv
import io
import json

import pytest

from benchmark.report.content import contents
from benchmark.report.formats import as_csv, as_json, markdown
from benchmark.report.results import Result, line_of
from tests.records import record

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


def test_spread_by_hand():
    line = line_of([with_repeats("gps", 0.75, 0.5, 0.6, 0.7)], 1)
    assert line["scores"]["NN"] == 0.75
    assert line["preparation_sd"]["NN"] == pytest.approx(0.1)  # deviations -.1, 0, .1: .02 / 2
    assert line["preparation_sd"]["FT"] == 0


def test_a_row_of_several_galleries_is_repeated_as_a_whole():
    def fold(number, nn, *repeats):
        name = f"humans fold {number}"
        made = [record("gps", gallery=f"humans[jitter={k}] fold {number}", nn=v) for k, v in enumerate(repeats, 1)]
        return Result(record("gps", gallery=name, nn=nn), repeats=dict(enumerate(made, 1)))

    line = line_of([fold(0, 0.5, 0.4, 0.6), fold(1, 0.5, 0.6, 0.8)], 2)
    assert line["n_repeats"] == 2
    assert line["preparation_sd"]["NN"] == pytest.approx(0.02**0.5)  # .5 and .7
    assert line_of([fold(0, 0.5, 0.4, 0.6), fold(1, 0.5, 0.6)], 2)["preparation_sd"] is None  # one is no spread


def test_json_csv_and_notes_have_the_spread_of_rows_that_were_repeated():
    table = of_rows(with_repeats("gps", 0.75, 0.5, 0.6, 0.7), Result(row("pca", 0.5)))
    gps, pca = json.loads(as_json([table]))
    assert gps["preparation_sd"]["NN"] == 0.1
    assert "preparation_sd" not in pca
    lines = list(csv.DictReader(io.StringIO(as_csv([table]))))
    assert [line["preparation_sd_NN"] for line in lines] == ["0.1", ""]
    assert "over 3 preparations of vertices jittered" in markdown(table)
    assert "Gps 0.100 0.000 0.000 0.000" in markdown(table)


def test_intervals_and_tests_are_those_of_the_shapes_as_they_are():
    plain = of_rows(Result(row("gps", 1.0)), Result(row("pca", 0.65)))
    repeated = of_rows(with_repeats("gps", 1.0, 0.7, 1.0), with_repeats("pca", 0.65, 0.5, 0.8))
    assert repeated.significance == plain.significance
