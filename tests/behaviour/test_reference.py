"""What the comparison with the reference names, and what a small part of the reference holds."""

import json
from copy import deepcopy

import pytest

from tests.behaviour.reference import MEASURES, REFERENCE, compare, make, summary

ROW = "every, animals (quick), mesh, gps, cm-bof"
SHAPES = "every, animals (quick)"
OTHER = "every, animals (quick), mesh, shape-dna, descriptor"
ROWS = {
    ROW: {"NN": [1.0, 0.0], "DCG": [1.0, 0.63093], "distance": [1234.56, None]},
    OTHER: {"status": ["failed"]},
    SHAPES: {"shape": ["cat0", "cat1"]},
}


def changed(name, values, row=ROW):
    rows = deepcopy(ROWS)
    rows[row][name] = values
    return rows


def test_equal_values_differ_in_nothing():
    assert compare(ROWS, json.loads(json.dumps(ROWS))) == []
    assert compare(ROWS, changed("DCG", [1.0, 0.630931])) == []  # the last of six digits
    assert summary([], 3) == "nothing differs in 3 rows"


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (changed("NN", [0.0, 1.0]), f"{ROW}: NN of 2 of 2, by at most 1"),
        (changed("DCG", [1.0, 0.630928]), f"{ROW}: DCG of 1 of 2, by at most 2e-06"),
        (changed("distance", [1234.57, None]), f"{ROW}: distance of 1 of 2, by at most 0.01"),
        (changed("distance", [1234.56, 2.0]), f"{ROW}: distance of 1 of 2, such as None -> 2.0"),
        (changed("status", ["ok"], OTHER), f"{OTHER}: status of 1 of 1, such as failed -> ok"),
        (changed("NN", [1.0]), f"{ROW}: NN of other queries"),
        (changed("shape", ["cat0", "cat2"], SHAPES), f"{SHAPES}: shape of 1 of 2, such as cat1 -> cat2"),
        (ROWS | {OTHER: {"NN": [1.0, 1.0]}}, f"{OTHER}: status ['failed'] -> None; NN of other queries"),
        ({row: ROWS[row] for row in ROWS if row != ROW}, f"{ROW}: missing"),
        (ROWS | {"quick, animals (quick), view, gps, cm-bof": {}}, "quick, animals (quick), view, gps, cm-bof: new"),
    ],
)
def test_what_changed_is_named(rows, line):
    assert compare(ROWS, rows) == [line]


def test_the_summary_names_methods_and_scorers():
    lines = compare(ROWS, changed("NN", [0.0, 0.0]) | {OTHER: {"status": ["ok"]}})
    assert summary(lines, 3) == "2 of 3 rows differ; methods: gps, shape-dna; scorers: cm-bof, descriptor"


@pytest.mark.slow
def test_a_part_of_it_is_made_twice_alike(tmp_path):
    name = "animals-few[depth-noise=3]"
    first, second = (make(tmp_path / part, None, [name], ["gps", "surface-area"]) for part in ("a", "b"))
    assert compare(first, second) == []
    gallery = f"every, {name} (quick)"
    assert set(first) == {
        gallery,
        f"{gallery}, view, gps, cm-bof",
        f"{gallery}, view, surface-area, descriptor",
    }
    row = first[f"{gallery}, view, gps, cm-bof"]
    assert [len(row[name]) for name in (*MEASURES, "distance")] == [4] * 5
    assert all(value > 0 for value in row["distance"])


def test_the_committed_reference_is_small_and_agrees_with_itself():
    assert REFERENCE.stat().st_size <= 500_000
    rows = json.loads(REFERENCE.read_text(encoding="utf-8"))
    assert compare(rows, rows) == []
    assert list(rows) == sorted(rows)
