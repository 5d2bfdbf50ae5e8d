"""Differences of two methods, by hand."""

import pytest

from benchmark.errors import ConfigurationError
from benchmark.report.comparison import compare
from tests.report.records import LABELS, by_class, record


def test_differences_intervals_and_both_tests_are_printed():
    first = record("gps", 0.5)
    second = record("skeleton", by_class({"cat": 0.75, "dog": 0.75, "owl": 0.5}))
    head, where, nn, *_ = compare([first, second], "gps", "skeleton")
    assert head == "gps -> skeleton"
    assert where == "rods, mesh: 8 of 12 queries differ"
    assert nn.startswith("  NN   0.500 -> 0.667  +0.167  (+0.000 to +0.250)  p over classes 0.5000, over queries 0.0")
    assert "with 3 classes, no p over classes is below 0.25" in compare([first, second], "gps", "skeleton")[-2]


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
    labels = [name for name in "abcdefgh" for _ in range(2)]
    lines = compare([record("a", 0.4, labels=labels), record("b", 0.6, labels=labels)], "a", "b")
    assert lines[2].endswith("p over classes 0.0078, over queries 0.0001  b is better for other subjects")
