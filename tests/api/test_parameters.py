"""Parameters: what is read from text, what is refused and how, and that each way to write a value
makes one value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum, Flag, IntEnum, StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from msgspec import Meta

from benchmark.api.contracts import CheckedParameters, Interval, Matches
from benchmark.api.parameters import (
    assignments,
    checked,
    declared_parameters,
    format_value,
    non_default_values,
    parameter_values,
    plain_value,
    read_back,
)
from benchmark.errors import ConfigurationError


class Side(Enum):
    """Values that are texts."""

    LEFT = "left"
    RIGHT = "right"


class Level(IntEnum):
    """Values that are numbers."""

    LOW = 1
    HIGH = 2


class Word(StrEnum):
    """Members that are texts."""

    FULL = "full"


class Part(Flag):
    """Values that are added."""

    HEAD = 1
    TAIL = 2


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One field of each kind."""

    whole: int = 2
    number: float = 0.5
    flag: bool = False
    text: str = ""
    optional: int | None = None
    either: int | str = 0
    choice: Literal["mesh", "classic"] = "mesh"
    level: Literal[1, 2] = 1
    pair: tuple[float, float] = (0.0, 1.0)
    levels: tuple[int, ...] = (1, 2)
    path: Path = Path("a")
    made: list[int] = field(default_factory=list)
    least: Annotated[int, Interval(1)] = 1
    share: Annotated[float, Interval(0, 1, closed="neither")] = 0.5
    half_open: Annotated[float, Interval(0, 1, closed="left")] = 0.0
    most: Annotated[float, Interval(high=3)] = 0.0
    name: Annotated[str, Matches("[a-z]*", "lower-case letters")] = ""
    some: Annotated[int, Interval(1)] | None = None
    parts: tuple[Annotated[int, Interval(1)], ...] = ()
    few: tuple[float, ...] | None = None
    filled: Annotated[tuple[int, ...], Meta(min_length=1)] = (1,)
    edges: tuple[tuple[int, float], ...] = ()
    gaps: tuple[int | None, ...] = ()
    mode: Literal["mesh", "view"] | None = None
    start: Literal["mesh", None] = None
    file: Path | None = None
    label: Annotated[str, Matches("[a-z]*", "lower-case letters")] | None = None
    switch: bool | None = None
    sides: tuple[Literal["left", "right"], ...] = ()
    side: Side = Side.LEFT
    height: Level = Level.LOW
    word: Word = Word.FULL
    part: Part = Part.HEAD
    both: tuple[Side, ...] = ()
    no_side: Side | None = None
    on: Literal[True, False] = True
    automatic: float | Literal["auto"] = "auto"
    scales: tuple[float, ...] | Literal["auto"] = "auto"
    words: tuple[str, ...] = ()
    anything: tuple = ()  # type: ignore[type-arg]
    amount: float | str = 1.0
    of_numpy: np.float64 = np.float64(1)  # noqa: RUF009
    default_of_numpy: float = np.float32(0.1)  # type: ignore[assignment]
    complex_number: complex = 1j


@dataclass(frozen=True, kw_only=True)
class Guarded(CheckedParameters):
    """Checks itself."""

    least: Annotated[int, Interval(1)] = 1
    kept: int = field(default=0, init=False)


def read(name: str, value: Any) -> Any:
    return checked(Sample, {name: value})[name]


READ = [
    ("whole", "-7", -7),
    ("whole", " 2.0 ", 2),
    ("whole", "1e3", 1000),
    ("whole", 3.0, 3),
    ("whole", np.int64(3), 3),
    ("whole", str(2**70), 2**70), ("number", "2", 2.0), ("number", 2, 2.0), ("number", "-0", 0.0),
    ("number", ".5", 0.5),
    ("number", "+7", 7.0),
    ("number", np.float32(0.25), 0.25),
    ("flag", "True", True),
    ("flag", "false", False),
    ("flag", True, True), ("text", "a=b", "a=b"), ("optional", "3", 3), ("optional", "None", None),
    ("optional", None, None),
    ("either", 3, 3),
    ("either", "three", "three"),
    ("choice", "classic", "classic"),
    ("level", "2", 2), ("level", 2, 2), ("pair", "(1,2)", (1.0, 2.0)), ("pair", [1, 2], (1.0, 2.0)),
    ("levels", "12", (12,)),
    ("levels", "(1, 2, 3)", (1, 2, 3)),
    ("levels", "(1,)", (1,)),
    ("levels", "()", ()),
    ("path", "b", Path("b")), ("share", "0.25", 0.25), ("half_open", "0", 0.0), ("most", "3", 3.0),
    ("made", "12", [12]),
    ("made", "(1, 2)", [1, 2]),
    ("few", "(1, 2)", (1.0, 2.0)),
    ("few", "none", None),
    ("few", [1], (1.0,)),
    ("filled", "(1e1,2)", (10, 2)),
    ("edges", "((1,2),(3,.5))", ((1, 2.0), (3, 0.5))),
    ("gaps", "(1,none)", (1, None)),
    ("mode", "view", "view"),
    ("mode", "none", None),
    ("start", "None", None),
    ("file", "b", Path("b")),
    ("side", "right", Side.RIGHT), ("side", Side.RIGHT, Side.RIGHT), ("height", "2", Level.HIGH),
    ("height", Level.HIGH, Level.HIGH), ("word", "full", Word.FULL), ("part", "2", Part.TAIL),
    ("part", Part.TAIL, Part.TAIL), ("both", "(left,right)", (Side.LEFT, Side.RIGHT)),
    ("both", [Side.LEFT], (Side.LEFT,)), ("no_side", "none", None), ("on", "false", False),
    ("automatic", "auto", "auto"), ("automatic", ".5", 0.5), ("scales", "auto", "auto"),
    ("scales", "(1,2)", (1.0, 2.0)), ("words", "('a,b',c,\"it's\")", ("a,b", "c", "it's")),
    ("anything", "(1,.5,a)", (1, 0.5, "a")), ("either", "3", 3), ("either", "1e3", 1000),
    ("either", "2.5", "2.5"), ("amount", ".5", 0.5), ("amount", "inf", "inf"),
    ("of_numpy", "2", np.float64(2)), ("complex_number", "2j", 2j),
    ("name", "abc", "abc"), ("some", "none", None), ("some", "5", 5), ("parts", "(1,2)", (1, 2)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "value"), READ)
def test_a_value_is_read_as_its_type_wants_it(name: str, text: Any, value: Any) -> None:
    result = read(name, text)
    assert result == value
    assert type(result) is type(value)
    assert math.copysign(1, result) == 1 if result == 0 and isinstance(result, float) else True


REFUSED = [
    ("whole", "many", "'many' does not fit whole of Sample; write a whole number"),
    ("whole", "2.5", "write a whole number"),
    ("whole", "inf", "write a whole number"),
    ("whole", True, "'True' does not fit whole"),
    ("whole", "", "'' does not fit whole of Sample; write a whole number"),
    ("whole", None, "write a whole number"),
    ("number", "nan", "'nan' does not fit number of Sample; write a finite number"),
    ("number", math.nan, "a finite number"),
    ("number", "inf", "a finite number"),
    ("flag", "yes", "write true or false"),
    ("text", 3, "write text"),
    ("text", "a\0", "write printable text"),
    ("optional", "x", "write a whole number, or none"),
    ("choice", "clasic", "unknown choice of Sample 'clasic'; did you mean classic?"),
    ("choice", "zzz", "unknown choice of Sample 'zzz'; choose one of classic, mesh"),
    ("choice", 3, "'3' does not fit choice of Sample; write text"),
    ("level", "3", "unknown level of Sample '3'; choose one of 1, 2"),
    ("pair", "(1,2,3)", "write a list in parentheses of length 2"),
    ("pair", 3, "write a list in parentheses"),
    ("pair", "(1,2", "parenthesis"),
    ("pair", "(1,nan)", "a finite number"),
    ("levels", "(1,2.5)", "write a whole number"),
    ("made", "a", "write a whole number"),
    ("few", "x", "write a number"),
    ("few", 3, "write a list in parentheses, or none"),
    ("few", "(1,inf)", "write a finite number"),
    ("filled", "()", "write a list in parentheses of length of at least 1"),
    ("edges", "((1,nan),)", "write a finite number"),
    ("edges", "((1,2,3),)", "write a list in parentheses of length 2"),
    ("mode", "vieww", "unknown mode of Sample 'vieww'; did you mean view?"),
    ("label", "A", "write lower-case letters"),
    ("switch", "yes", "write true, false or none"),
    ("sides", "(left,up)", "'(left,up)' does not fit sides of Sample; write one of its choices"),
    ("start", "x", "unknown start of Sample 'x'; choose one of mesh, none"),
    ("path", 3, "'3' does not fit path of Sample; write what Path accepts"),
    ("least", "0", "'0' does not fit least of Sample; write a whole number of at least 1"),
    ("least", np.int64(0), "write a whole number of at least 1"),
    ("share", "0", "write a number above 0"), ("share", "1", "write a number below 1"),
    ("half_open", "1", "write a number below 1"),
    ("half_open", "-.1", "write a number of at least 0"),
    ("most", "3.1", "write a number of at most 3"), ("most", "-inf", "write a finite number"),
    ("name", "A", "'A' does not fit name of Sample; write lower-case letters"),
    ("name", "a\n", "does not fit name of Sample"),
    ("some", "0", "write a whole number of at least 1"),
    ("parts", "(1,0)", "write a whole number of at least 1"),
    ("side", "up", "unknown side of Sample 'up'; choose one of left, right"),
    ("side", "Side.LEFT", "choose one of left, right"),
    ("height", "HIGH", "unknown height of Sample 'HIGH'; choose one of 1, 2"),
    ("wole", "1", "unknown parameter of Sample 'wole'; did you mean whole"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "message"), REFUSED)
def test_what_does_not_fit_is_refused_with_what_would(name: str, text: Any, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        read(name, text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "text", "value"), READ)
def test_the_text_of_a_value_is_read_as_this_value(name: str, text: Any, value: Any) -> None:
    plain = plain_value(value)
    assert type(plain).__module__ == "builtins"
    assert read(name, format_value(value)) == value
    assert read_back(Sample, {name: text}, "Sample") == {name: value}


class Kernel:
    """What a user may take as the type of a parameter, without a text of its own."""

    def __init__(self, width: str) -> None:
        self.width = width

    def __repr__(self) -> str:
        return "Kernel()"


@pytest.mark.parametrize("type_of_field", [Kernel, frozenset[int]])
def test_a_value_without_a_text_from_which_it_is_read_is_refused(type_of_field: type) -> None:
    wrong = type("Wrong", (), {"__annotations__": {"field": type_of_field}})
    with pytest.raises(ConfigurationError, match=r"field of a method cannot be written as text: '"):
        read_back(dataclass(wrong), {"field": "(1,2)"}, "a method")


def test_none_is_chosen_where_a_parameter_has_no_default() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Needed:
        most: int | None

    assert non_default_values(Needed, {"most": "none"}) == {"most": None}
    assert non_default_values(Sample, {"optional": "none"}) == {}


def test_non_default_settings_come_in_the_order_of_the_fields_() -> None:
    given = {"share": "0.25", "pair": "(0,2)", "whole": "3", "text": ""}
    assert list(non_default_values(Sample, given).items()) == [
        ("whole", 3),
        ("pair", (0.0, 2.0)),
        ("share", 0.25),
    ]


def test_a_default_is_known_in_each_way_to_write_it() -> None:
    given = {"side": "left", "height": Level.LOW, "of_numpy": "1", "default_of_numpy": 0.1}
    assert non_default_values(Sample, given) == {"default_of_numpy": 0.1}
    assert non_default_values(Sample, {"side": Side.RIGHT}) == {"side": "right"}
    assert non_default_values(Sample, {"default_of_numpy": np.float32(0.1)}) == {}


class NotDecorated(Guarded):
    """Its default is that of the class from which it inherits."""

    least: Annotated[int, Interval(1)] = 2


@dataclass(frozen=True, kw_only=True)
class NotDeclared(Guarded):
    """Likewise."""

    least = 2


@dataclass(frozen=True, kw_only=True)
class NotDeclaredList(Sample):
    """Likewise, of a default that is made for each object."""

    made = (1, 2)


@pytest.mark.parametrize("cls", [NotDecorated, NotDeclared, NotDeclaredList])
def test_a_default_that_python_ignores_is_named(cls: type) -> None:
    message = f"{cls.__name__} sets (least|made), but does not declare it as a parameter; write "
    with pytest.raises(ConfigurationError, match=message):
        declared_parameters(cls)


def test_a_default_of_a_class_that_inherits_is_its_own() -> None:
    @dataclass(frozen=True, kw_only=True, slots=True)
    class Own(Guarded):
        least: Annotated[int, Interval(1)] = 2
        made: list[int] = field(default_factory=list)

    assert [default for _, default in declared_parameters(Own).values()] == [2, []]
    assert Own().least == 2


def test_a_class_may_check_itself() -> None:
    assert Guarded() == Guarded(least=1)
    assert Guarded(least="2").least == 2  # type: ignore[arg-type]
    with pytest.raises(
        ConfigurationError,
        match="'0' does not fit least of Guarded; write a whole number of at least 1",
    ):
        replace(Guarded(), least=0)
    assert parameter_values(Guarded()) == {"least": 1}


def test_a_type_that_is_unknown_at_run_time_is_named() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Unresolved:
        fraction: Fraction = 3  # type: ignore[name-defined]  # noqa: F821

    with pytest.raises(
        ConfigurationError, match="a type of Unresolved is unknown: name 'Fraction' is not defined"
    ):
        checked(Unresolved, {})


@pytest.mark.parametrize(
    ("type_of_field", "message"),
    [
        ("np.flaot64", "a type of Wrong is unknown: .*flaot64.*; correct it"),
        ("int | 'str'", "a type of Wrong is unknown: unsupported operand .*; correct it"),
        (
            "Annotated[int | None, Interval(1)]",
            "the type of field of Wrong is none of a parameter: .*; declare it as docs",
        ),
    ],
)
def test_a_type_that_no_parameter_can_have_is_named(type_of_field: str, message: str) -> None:
    wrong = type("Wrong", (), {"__annotations__": {"field": type_of_field}, "__module__": __name__})
    with pytest.raises(ConfigurationError, match=message):
        checked(dataclass(wrong), {"field": "1"})


def test_values_are_written_in_one_way() -> None:
    values = (2.0, 1e-3, 0.1 + 0.2, 3, True, None, "a", (1, 2.5), (3,), (), ("a,b", "c"), Side.LEFT)
    texts = (
        "2.0",
        "0.001",
        "0.30000000000000004",
        "3",
        "true",
        "none",
        "a",
        "(1,2.5)",
        "(3)",
        "()",
        "('a,b',c)",
        "left",
    )
    assert tuple(map(format_value, values)) == texts


def test_assignments_are_read() -> None:
    assert assignments("") == {}
    assert assignments(" a = 1 , b=x=y ") == {"a": "1", "b": "x=y"}
    assert assignments("a=(1,2),b=") == {"a": "(1,2)", "b": ""}
    assert assignments(["a=1,2", "b = 3"]) == {"a": "1,2", "b": "3"}
