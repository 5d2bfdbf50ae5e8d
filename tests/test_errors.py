"""Exceptions of somebody else's code are told whatever they are made of."""

import sys

import pytest

from benchmark.errors import BenchmarkError, UnsupportedShape, message, one_line


class Mute(Exception):
    def __str__(self):
        raise RuntimeError("no")


class Quits(Exception):
    def __str__(self):
        sys.exit(0)


class MuteRefusal(UnsupportedShape):
    __str__ = Mute.__str__


@pytest.mark.parametrize("error", [Mute(), Quits(), MuteRefusal("thin", "feed it")])
def test_a_message_that_cannot_be_read_is_said_to_be_so(error):
    assert message(error) == "its message cannot be read"
    assert one_line(error) == f"{type(error).__name__}: its message cannot be read"


@pytest.mark.parametrize("given", [(5, None), (b"x", ["y"]), ("thin", "feed it")])
def test_problem_and_hint_are_text_whatever_a_method_passes(given):
    error = BenchmarkError(*given)
    assert str(error) == "; ".join(str(part) for part in given if part is not None)
    assert (type(error.problem), type(error.hint)) == (str, str)
