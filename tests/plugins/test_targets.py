"""What the verb ``check`` is asked to check."""

from pathlib import Path

import pytest

from benchmark.errors import ConfigurationError
from benchmark.plugins import conformance

TWO = """
from dataclasses import dataclass
from typing import ClassVar
from benchmark.api.contracts import MethodInfo

@dataclass(frozen=True, kw_only=True)
class First:
    info: ClassVar[MethodInfo] = MethodInfo(name="first", title="First")
    power: float = 1.0

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices * self.power)

@dataclass(frozen=True, kw_only=True)
class Second(First):
    info: ClassVar[MethodInfo] = MethodInfo(name="second", title="Second")
"""


@pytest.fixture
def specs(tmp_path):
    """Specifications of a target, in whose texts FILE stands for the file."""
    (tmp_path / "two.py").write_text(TWO)

    def filled(value):
        return value.replace("FILE", str(tmp_path / "two.py"))

    def of(target):
        kinds = {"name": filled, "methods": tuple, "plugins": lambda names: tuple(Path(filled(name)) for name in names)}
        return conformance.Target(**{key: kinds[key](value) for key, value in target.items()}).specs()

    return of


@pytest.mark.parametrize(
    ("target", "names"),
    [
        ({"name": "FILE"}, ["first", "second"]),
        (
            {"name": "FILE[power=2|3]"},
            ["first[power=2.0]", "first[power=3.0]", "second[power=2.0]", "second[power=3.0]"],
        ),
        ({"name": "FILE", "methods": ("second[power=2]",)}, ["second[power=2.0]"]),
        ({"name": "first[power=2]", "plugins": ("FILE",)}, ["first[power=2.0]"]),
        ({"name": "gps"}, ["gps"]),
    ],
)
def test_methods_are_chosen_by_file_name_and_parameters(target, names, specs):
    assert [spec.name for spec in specs(target)] == names


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ({"name": "FILE[powr=2]"}, "unknown parameter of first 'powr'; did you mean power"),
        ({"name": "FILE[power=2]", "methods": ("first",)}, "parameters were passed with the file and with -m"),
        ({"name": "FILE", "methods": ("gps",)}, "has no method 'gps'; choose from first, second"),
        ({"name": "frist", "plugins": ("FILE",)}, "unknown method 'frist'; did you mean first"),
    ],
)
def test_what_cannot_be_checked_is_named(target, message, specs):
    with pytest.raises(ConfigurationError, match=message):
        specs(target)
