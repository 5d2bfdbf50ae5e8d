"""Several values of a parameter make a method each."""

import pytest

from benchmark.errors import ConfigurationError
from benchmark.plugins.parameters import combinations, split_name
from benchmark.plugins.registry import methods, select, variant, variants


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", [{}]),
        ("a=1", [{"a": "1"}]),
        ("a=1|2,b=x|y", [{"a": "1", "b": "x"}, {"a": "1", "b": "y"}, {"a": "2", "b": "x"}, {"a": "2", "b": "y"}]),
        (" a = 1 | 2 ", [{"a": "1"}, {"a": "2"}]),
        ("a=(1,2)|(3,4)", [{"a": "(1,2)"}, {"a": "(3,4)"}]),
        ("a='1|2,b=3'|\"it's\"", [{"a": "1|2,b=3"}, {"a": "it's"}]),
        ("a=", [{"a": ""}]),
        ("a=it's|''", [{"a": "it's"}, {"a": ""}]),
    ],
)
def test_each_choice_of_values_is_listed_once(text, expected):
    assert combinations(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a=1||2", "'a' has an empty value; write VALUE.VALUE"),
        ("a=1|", "'a' has an empty value"),
        ("a='1|2", "has a quote without its other half; close what is opened"),
        ("a=(1|2", "a parenthesis without its other half"),
        ("a=1,a=2", "'a' is given twice"),
        ("a", "'a' has no value"),
        ("|", "'[|]' has no value"),
    ],
)
def test_what_cannot_be_read_is_named(text, message):
    with pytest.raises(ConfigurationError, match=message):
        combinations(text)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (" gps ", ("gps", "")),
        ("gps[]", ("gps", "")),
        ("a [b=1|2] ", ("a", "b=1|2")),
        ("a[b", None),
        ("a[b]c", None),
        ("a[b][c]", None),
        ("[b]", None),
    ],
)
def test_a_name_is_split_from_what_its_one_pair_of_brackets_holds(name, expected):
    assert split_name(name) == expected


def test_a_grid_makes_a_method_of_each_choice_in_the_order_that_it_is_written_in():
    known = methods()
    chosen = select(["least-squares-mds[start=classic|mesh]"], known)
    assert [spec.name for spec in chosen] == ["least-squares-mds[start=classic]", "least-squares-mds"]
    assert all(spec.named for spec in chosen)
    grid = variants("least-squares-mds[start=mesh|classic,rtol=1e-3|1e-4|1e-3]", known)
    assert len(grid) == 4
    assert len({spec.name for spec in grid}) == 4


def test_where_one_method_is_wanted_a_grid_is_refused():
    with pytest.raises(ConfigurationError, match="stands for 2 methods; name one: least-squares-mds$"):
        variant("least-squares-mds[start=mesh|classic]", methods())
