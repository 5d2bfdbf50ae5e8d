"""An object of a Python program is a method if its key says all that its forms depend on; else it is refused."""

from __future__ import annotations

import functools
import importlib.util
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from benchmark.api import MethodInfo, canonical_form
from benchmark.code_digest import digest
from benchmark.errors import ConfigurationError
from benchmark.protocols.galleries import galleries
from benchmark.registry import component_of, select
from learned.methods import Learned

INFO = MethodInfo(name="power", title="Power")


def made(k):
    def power(shape):
        return shape.mesh.vertices**k

    return power


def by_default(shape, powers=[1]):  # noqa: B006
    return shape.mesh.vertices ** powers[0]


POWERS = {"k": 1}


def by_global(shape):
    return next(shape.mesh.vertices ** POWERS["k"] for _ in "a")


N = 0


def counted(shape):
    global N
    N += 1
    return N * shape.mesh.vertices


def helper(vertices):
    return vertices ** POWERS["k"]


def by_helper(shape):
    return helper(shape.mesh.vertices)


@functools.wraps(by_default)
def wrapped(shape):
    return by_default(shape)


class Plain:
    info = INFO

    def __init__(self, k):
        self.k = k

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices**self.k)


def class_of(k):
    class Inner:
        info = INFO

        def canonicalise(self, shape):
            return shape.form(shape.mesh.vertices**k)

    return Inner


class Shared:
    info = INFO
    powers: ClassVar = [1]

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices ** self.powers[0])


@dataclass(frozen=True, kw_only=True)
class Power:
    info: ClassVar[MethodInfo] = INFO
    k: Any = 1
    computed: int = field(init=False, default=0)

    def __post_init__(self):
        object.__setattr__(self, "computed", 2 * self.k)

    def canonicalise(self, shape):
        return shape.form(helper_of(shape.mesh.vertices) ** self.computed)


@dataclass(frozen=True)
class Anything:
    value: Any = 0
    info: ClassVar[MethodInfo] = INFO

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices * (2 if isinstance(self.value, float) else 1))


def helper_of(vertices):
    return vertices + np.pi


def changed(value, **attributes):
    for name, held in attributes.items():
        object.__setattr__(value, name, held)
    return value


@pytest.mark.parametrize(
    "value",
    [
        made(1), by_default, by_global, counted, by_helper, wrapped, Plain, Plain(1), Plain(1).canonicalise,
        class_of(1), class_of(1)(), Shared, Shared(), canonical_form(name="power", title="Power")(made(1)),
        lambda shape: shape.mesh, functools.partial(made, 1), changed(Power(), extra=1), changed(Power(), computed=3),
        changed(Power(), computed=2.0),
        Power(k=np.ones(3)), changed(Power(), k=object()), changed(Power(), k=[1]), changed(Learned(), model="m"),
    ],
    ids=lambda value: getattr(value, "__qualname__", type(value).__name__),
)  # fmt: skip
def test_what_depends_on_more_than_file_and_parameters_is_refused(value):
    with pytest.raises(ConfigurationError, match=r"dataclass|pass a number|cannot be created"):
        component_of(value)


@pytest.mark.parametrize(
    ("value", "other"),
    [(0, False), (1, 1.0), (1, True), ("1", Path("1")), ("1j", 1j), ("b'1'", b"1"), ((1,), (1.0,)), ("1", 1)],
    ids=repr,
)
def test_values_that_differ_in_type_alone_are_two_methods(value, other):
    first, second = component_of(Anything(value)), component_of(Anything(other))
    assert first != second
    assert digest(first.key()) != digest(second.key())


@pytest.mark.parametrize("value", [np.int64(2), np.float32(2), np.str_("2")])
def test_an_object_runs_with_the_values_of_its_key(value):
    component = component_of(Anything(value))
    assert type(component.create().value) is type(component.parameters["value"]) is type(value.item())


def module(path, text, name="own"):
    path.write_text(text)
    spec = importlib.util.spec_from_file_location(name, path)
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[name] = loaded
    spec.loader.exec_module(loaded)
    return loaded


TEXT = """import config
from config import SIZE
K = 2
def helper(x, power=3): return x ** power * helper.gain
helper.gain = 2
def flat(shape): return helper(shape.mesh.vertices) * K * config.SIZE * SIZE
class Own:
    factor = 2
"""


def test_constants_that_a_function_reads_are_in_its_key(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "modules", {**sys.modules})
    config = module(tmp_path / "config.py", "SIZE = 4\n", "config")
    own = module(tmp_path / "own.py", TEXT)
    first = component_of(own.flat).key()
    keys = [first]
    for where, name, value in (
        (own, "K", 5), (own, "SIZE", 5), (config, "SIZE", 5), (own.helper, "__defaults__", (5,)),
        (own.helper, "gain", 5), (own, "helper", lambda x: x), (own.flat, "__code__", own.helper.__code__),
    ):  # fmt: skip
        with monkeypatch.context() as patch:
            patch.setattr(where, name, value)
            keys.append(component_of(own.flat).key())
    assert all(keys.count(key) == 1 for key in keys)
    assert component_of(own.flat).key() == first
    own.K = [5]
    with pytest.raises(ConfigurationError, match="'flat' depends on 'K', of type list, which may change"):
        component_of(own.flat)


def test_an_object_that_learns_is_one_row():
    gallery, *_ = galleries(["III-view"], ["animals"])
    assert len(gallery.rows("view", select(["learned"]), named=True)) > 1
    learned = Learned()
    assert [row.given for row in gallery.rows("view", select([learned]), named=True)] == [learned]


def test_an_object_is_one_method_with_the_name_of_no_other():
    power = component_of(Power(k=2))
    assert power.name == "power[k=2]"
    assert power.key() == component_of(Power(k=2)).key() != component_of(Power(k=3)).key()
    assert [each.name for each in select([Power(k=2), Power(k=3), Power(k=2)])] == ["power[k=2]", "power[k=3]"]
    with pytest.raises(ConfigurationError, match="an object with parameters of its own"):
        power.with_parameters({"k": 3})

    def gps(shape):
        return shape.mesh.vertices

    with pytest.raises(ConfigurationError, match="there is another method 'gps', baselines.gps:GPS; rename yours"):
        select([gps])
    other = canonical_form(name="power", title="Power")(helper_of)
    with pytest.raises(ConfigurationError, match="two methods are called 'power'"):
        select([Power(), other])
