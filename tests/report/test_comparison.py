"""Differences of two methods, by hand."""

import pytest

from benchmark.errors import ConfigurationError
from benchmark.report.comparison import compare
from tests.report.records import LABELS, record

LETTERS = [name for name in "abcdefgh" for _ in range(2)]


def test_differences_are_first_minus_second_with_intervals_and_what_p_can_reach():
    first, second = record("a", 0.5, labels=LETTERS), record("b", [0.75] * 8 + [0.5] * 8, labels=LETTERS)
    head, where, nn, *_, note, legend = compare([first, second], "a", "b")
    assert (head, where) == ("a - b", "rods, mesh: 8 of 16 queries differ")
    assert nn.startswith("  NN   0.500 - 0.625 = -0.125  (-0.219 to -0.031)  p 0.12")  # 2 of 16 exchanges
    assert note == "  with 8 classes, no p is below 0.0078"
    assert legend.endswith("does the difference hold for other subjects?")


def test_few_classes_decide_nothing():
    lines = compare([record("gps", 0.9), record("skeleton", 0.1)], "gps", "skeleton")
    assert lines[2] == "  NN   0.900 - 0.100 = +0.800"
    assert lines[-1] == "  not decidable: 3 classes, of at least 8"


def test_classes_that_one_of_the_two_has_seen_in_training_are_no_queries():
    high = [1.0] * 4 + [0.5] * 8
    lines = compare([record("net", high, seen=["cat1"]), record("gps", 0.5)], "net", "gps")
    assert lines[1] == "rods, mesh: 0 of 8 queries differ; 4 queries are of classes seen in training"
    assert lines[2] == "  NN   0.500 - 0.500 = +0.000"
    everything = compare([record("net", seen=["cat0", "dog4", "owl8"]), record("gps")], "net", "gps")
    assert everything[1].startswith("rods, mesh: 0 of 0 queries differ")


def test_a_quick_run_says_how_much_it_is_and_names_no_better_method():
    data = {"name": "rods", "title": "rods", "source": "rods", "quick": True, "n_shapes": 80}
    quick = [record(name, nn, labels=LETTERS, quick=True, data=data) for name, nn in (("a", 0.9), ("b", 0.1))]
    lines = compare(quick, "a", "b")
    assert lines[1].endswith("; quick: 16 of 80 shapes")
    assert not any("better" in line for line in lines)


def test_unequal_galleries_are_refused_with_what_differs():
    first, second = record("gps"), record("skeleton", labels=LABELS[:11], gallery_digest="2")
    with pytest.raises(ConfigurationError, match="ranked 12 and 11 shapes: only gps has owl11"):
        compare([first, second], "gps", "skeleton")
    changed = record("skeleton", gallery_digest="2")
    with pytest.raises(ConfigurationError, match="the files of some shapes have changed"):
        compare([first, changed], "gps", "skeleton")


def test_one_unequal_gallery_is_named_beside_the_others():
    records = [record(m, dataset=d) for m in ("gps", "skeleton") for d in ("rods",)]
    records += [record("gps", dataset="tubes"), record("skeleton", dataset="tubes", gallery_digest="2")]
    lines = compare(records, "gps", "skeleton")
    assert any(line.startswith("not compared: tubes, mesh") for line in lines)


def test_methods_without_a_common_gallery_are_refused():
    with pytest.raises(ConfigurationError, match="no gallery has scores of both gps and skeleton"):
        compare([record("gps"), record("skeleton", dataset="tubes")], "gps", "skeleton")


def test_a_method_without_scores_is_refused_with_those_that_have_some():
    with pytest.raises(ConfigurationError, match="skeletn has no scores.*choose among gps, skeleton"):
        compare([record("gps"), record("skeleton")], "gps", "skeletn")


def test_the_better_method_is_named_where_other_subjects_would_show_it():
    lines = compare([record("a", 0.4, labels=LETTERS), record("b", 0.6, labels=LETTERS)], "a", "b")
    assert lines[2].endswith("  b is better for other subjects")
    assert float(lines[2].split()[-7]) == pytest.approx(2 / 2**8, abs=0.003)
    assert lines[3].endswith("p 1.0000")
