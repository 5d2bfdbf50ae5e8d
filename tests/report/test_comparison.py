"""Differences of a row to others, by hand."""

import json

import numpy as np
import pytest

from benchmark.errors import ConfigurationError
from benchmark.protocols.tables import SYNTHETIC_HUMANS
from benchmark.report.comparison import ABOVE, _p_value, compare_rows, details, summaries
from benchmark.report.notes import QUICK, leads, table_notes
from benchmark.report.statistics import permutation_test
from benchmark.report.tables import table_views
from tests.report.records import LABELS, failed, record

LETTERS = [name for name in "abcdefgh" for _ in range(2)]


def compared(records, first, second=""):
    return compare_rows(table_views(records, methods=[first, second]), first, second)


def tables(records, first, second):
    """Return the heading of the only column, and its tables of scores and of verdicts."""
    ((heading, found),) = details(compared(records, first, second))
    return heading, *found


def test_differences_are_first_minus_second_with_intervals():
    first, second = (
        record("a", 0.5, labels=LETTERS),
        record("b", [0.75] * 8 + [0.5] * 8, labels=LETTERS),
    )
    heading, scores, verdicts = tables([first, second], "a", "b")
    assert heading == "rods, mesh: 8 of 16 queries differ"
    assert scores[0] == ["", "A", "B", "A - B", "95 % interval"]
    assert verdicts[0] == ["", "p", "planned alone", "p", "among the 2 rows"]
    # .125 and 2.365 x .134 / sqrt(8)
    assert scores[1] == ["NN", "0.500", "0.625", "-0.125", "-0.237 to -0.013"]
    # 2 of 16 exchanges of the four classes that differ
    alike = ["0.125", "not significant (8 classes)"]
    assert verdicts[1] == ["NN", *alike, *alike]


def test_few_classes_decide_nothing():
    _, scores, verdicts = tables([record("gps", 0.9), record("skeleton", 0.1)], "gps", "skeleton")
    assert scores[1] == ["NN", "0.900", "0.100", "+0.800", ""]
    assert verdicts[1] == ["NN", *["", "not decidable (3 classes)"] * 2]


def test_classes_that_one_of_the_two_has_seen_in_training_are_no_queries():
    high = [1.0] * 4 + [0.5] * 8
    records = [record("net", high, seen=["cat1"]), record("gps", 0.5)]
    heading, scores, _ = tables(records, "net", "gps")
    seen = "4 queries are of classes seen in training"
    assert heading == f"rods, mesh: 0 of 8 queries differ; {seen}"
    assert scores[1][:4] == ["NN", "0.500", "0.500", "+0.000"]
    records = [record("net", seen=["cat0", "dog4", "owl8"]), record("gps")]
    heading, *found = tables(records, "net", "gps")
    assert heading.startswith("rods, mesh: 0 of 0 queries differ")
    assert found == []


def test_a_quick_run_decides_nothing_and_its_table_says_that_marks_are_no_verdict():
    quick = [record(name, nn, labels=LETTERS, quick=True) for name, nn in (("a", 0.9), ("b", 0.1))]
    assert set(compared(quick, "a").verdict) == {"not decided (quick run)"}
    full = [record(name, nn, labels=LETTERS) for name, nn in (("a", 0.9), ("b", 0.1))]
    (of_quick,), (of_full,) = table_views(quick), table_views(full)
    assert of_quick.marks and table_notes(of_quick)[0].startswith(QUICK)
    assert QUICK not in table_notes(of_full)[0]
    assert "A quick run decides nothing" in leads(of_quick)[0]
    assert "a quick run" not in leads(of_full)[0]


def test_the_significant_difference_is_named():
    records = [record("a", 0.4, labels=LETTERS), record("b", 0.6, labels=LETTERS)]
    _, _, verdicts = tables(records, "a", "b")
    assert verdicts[1] == ["NN", *["0.008", ABOVE] * 2]  # 2 of 2^8
    assert verdicts[2][1::2] == ["1.000", "1.000"]


def test_a_row_is_compared_with_every_row_of_its_tables_in_their_order_by_the_test_of_the_marks():
    values = {"gps": [0.9] * 8 + [0.3] * 8, "classic-mds": 0.1, "mine": 0.5, "skeleton": 0.48}
    records = [record(name, nn, labels=LETTERS, dataset="tosca") for name, nn in values.items()]
    seen = record(
        "learned", 0.5, labels=LETTERS, dataset="tosca", input_="view", models=[], seen=["a0"]
    )
    other_block = record("shape-dna", 0.9, labels=LETTERS, dataset="tosca", scorer="")
    frame = compared([*records, seen, other_block], "mine")
    assert list(frame.other[::4]) == ["classic-mds", "gps", "skeleton", "learned", "shape-dna"]
    of_nn = frame[frame.measure == "NN"].set_index("other")
    assert list(of_nn.difference.round(3)) == [0.4, -0.1, 0.02, 0.0, -0.4]
    order = ["classic-mds", "gps", "skeleton", "mine"]  # of the rows of the table
    block = [[[nn, 0.5, 0.6, 0.7] for nn in np.broadcast_to(values[name], 16)] for name in order]
    assert list(of_nn.p[:3]) == list(permutation_test(block, LETTERS)[3, :3, 0])
    alike, small = "not significant (8 classes)", "significant, within the scatter of codebooks"
    assert list(of_nn.verdict) == [ABOVE, alike, small, "not decidable (7 classes)", ABOVE]
    assert list(of_nn["rows"]) == [4, 4, 4, 5, 5]
    for other in of_nn.index:
        for pair in (("mine", other), (other, "mine")):
            found = compared([*records, seen, other_block], *pair)
            assert found.verdict[0] == of_nn.verdict[other], "a comparison has one verdict"
    ((heading, (head, first, *_)),) = summaries(frame)
    place = "Table III on tosca, ours"
    assert heading == f"{place}: mine - each row, 14 to 16 queries, among the 4 to 5 rows"
    assert [*zip(head, first, strict=True)][1:3] == [("NN", "+.40"), ("FT", "+.00")]
    assert first[0::5] == ["Classic MDS", "significant, above the scatter (NN)"]
    assert len(json.loads(frame.to_json(orient="records"))) == 20


def test_of_a_row_the_strongest_verdict_is_said_with_its_measures():
    """The first measure may be as good, and another one differ."""
    rows = [record("a", 0.5, labels=LETTERS), record("b", 0.52, labels=LETTERS)]
    frame = compared(rows, "a")
    shuffled = frame.iloc[[1, 0, 2, 3]].reset_index(drop=True)
    for each in (frame, shuffled):
        ((_, (_, line)),) = summaries(each)
        assert line[-1] == "significant, within the scatter of codebooks (NN)"


@pytest.mark.parametrize(
    ("errors", "nn", "verdict"),
    [
        ({}, 0.57, ABOVE),
        ({"NN": 0.03}, 0.57, "significant, within the scatter of codebooks"),
        ({"NN": 0.001}, 0.51, ABOVE),
    ],
)
def test_the_scatter_of_codebooks_is_that_of_the_records_and_else_a_measured_one(
    errors, nn, verdict
):
    rows = [
        record(name, value, labels=LETTERS, draw_errors=errors)
        for name, value in (("a", 0.5), ("b", nn))
    ]
    assert compared(rows, "a", "b").verdict[0] == verdict


def test_a_row_without_a_gallery_is_compared_without_a_verdict():
    folds = [
        record("a", dataset="people[draw=0]", fold=f"fold {k}", labels=LETTERS) for k in range(3)
    ]
    part = record("b", dataset="people[draw=0]", fold="fold 0", labels=LETTERS)
    assert set(compared([*folds, part], "a").verdict) == {"incomplete"}


@pytest.mark.parametrize(
    ("p", "text"),
    [(0.0498, "<0.050"), (0.05, "0.050"), (0.0494, "0.049"), (0.0001, "0.000"), (np.nan, "")],
)
def test_a_significant_p_value_is_not_rounded_up_to_one_that_is_not(p, text):
    assert _p_value(p) == text


def test_shapes_that_one_of_two_rows_refused_are_counted():
    both = [("a0", "two pieces")]
    rows = [
        record("a", labels=LETTERS, unsupported=both),
        record("b", labels=LETTERS, unsupported=[*both, ("b2", "too thin")]),
    ]
    says = "1 shape without a result by one of the two count 0"
    heading, *_ = tables(rows, "a", "b")
    assert heading == f"rods, mesh: 0 of 16 queries differ; {says}"
    ((_, (_, line)),) = summaries(compared(rows, "a"))
    assert line[-1] == f"not significant (8 classes); {says}"
    # Networks rank the first draw alone; what a form refuses in another one is not compared.
    draws = {name: {"dataset": name, "labels": LETTERS} for name in SYNTHETIC_HUMANS[:2]}
    first, second = draws.values()
    rows = [
        record("gps", **first),
        record("gps", unsupported=both, **second),
        record("learned", input_="view", models=[], **first),
    ]
    views = table_views(rows, ["I"])
    assert set(compare_rows(views, "gps", "learned")["refused"]) == {0}


@pytest.mark.parametrize(
    ("others", "message"),
    [
        (
            [record("skeleton", labels=LABELS[:11], gallery_digest="2", finished="2020")],
            "ranks another version",
        ),
        ([record("skeleton", dataset="tubes")], "no table has scores of both gps and skeleton"),
        ([record("other")], "skeleton has no scores; run it, or choose among gps, other"),
        ([failed("skeleton")], r"skeleton has no scores \(failed: it fell\); run it, or choose"),
    ],
)
def test_rows_that_cannot_be_compared_are_refused(others, message):
    with pytest.raises(ConfigurationError, match=message):
        compared([record("gps"), *others], "gps", "skeleton")


def test_without_any_scores_no_other_row_is_proposed():
    with pytest.raises(ConfigurationError, match=r"\(failed: it fell\); run it$"):
        compared([failed("gps")], "gps")
