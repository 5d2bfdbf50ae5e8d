"""Errors are text on one line, with the place where they were raised."""

import pytest

from benchmark.errors import BenchmarkError, UnsupportedShape, locate, one_line


@pytest.mark.parametrize("given", [(5, None), (b"x", ["y"]), ("thin", "feed it")])
def test_problem_and_hint_are_text_whatever_a_method_passes(given):
    error = BenchmarkError(*given)
    assert str(error) == "; ".join(str(part) for part in given if part is not None)
    assert (type(error.problem), type(error.hint)) == (str, str)


def test_an_error_is_named_on_one_line_with_file_and_line():
    assert one_line(ValueError("a\n b")) == "ValueError: a b"
    assert one_line(UnsupportedShape("thin", "feed it")) == "thin; feed it"
    try:
        raise KeyError
    except KeyError as error:
        assert locate(error) == f"test_errors.py:{error.__traceback__.tb_lineno}: KeyError"
