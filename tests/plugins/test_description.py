"""Parameters in words, and what a docstring says of them."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest

from benchmark.api.contracts import Interval, Matches, OneOf
from benchmark.plugins.parameters import described
from benchmark.plugins.registry import BUILT_IN, methods


@dataclass(frozen=True, kw_only=True)
class Base:
    """Something.

    Parameters
    ----------
    first, second
        One
        of ``two``; see :func:`somewhere`.
    word : str
        A word.

    Returns
    -------
    nothing
        Not a parameter.
    """

    first: Annotated[float, Interval(0, 1)] = 0.5
    second: Annotated[int, Interval(1)] | None = None
    word: Annotated[str, Matches("[a-z]+", "lower-case letters")] = "so"


@dataclass(frozen=True, kw_only=True)
class Derived(Base):
    """Something else."""

    third: Literal["a", "b"] = "a"
    sizes: tuple[int, ...] = (1, 2)
    flag: bool = True
    name: Annotated[str, OneOf(["x", "y"])] = "x"
    hidden: int = field(default=0, init=False)


def test_each_parameter_is_told_in_the_order_of_the_fields():
    told = {each.name: (each.values, each.default, each.meaning) for each in described(Derived)}
    assert told == {
        "first": ("a number of at least 0 and of at most 1", "0.5", "One of two; see somewhere."),
        "second": ("a whole number of at least 1 or none", "none", "One of two; see somewhere."),
        "word": ("lower-case letters", "so", "A word."),
        "third": ("a or b", "a", ""),
        "sizes": ("values in parentheses, each a whole number", "(1,2)", ""),
        "flag": ("true or false", "true", ""),
        "name": ("x or y", "x", ""),
    }
    assert list(told) == ["first", "second", "word", "third", "sizes", "flag", "name"]


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_parameter_of_every_method_is_explained(name):
    for each in described(methods()[name].load()):
        assert each.meaning, each.name
        assert each.values
        assert each.default or each.name == "training"
