"""An object of a Python program is a method, and known again only if its name says all that its
forms depend on.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from baselines.smacof import LeastSquaresMDS
from benchmark.api import MethodInfo, canonical_form
from benchmark.code_digest import digest
from benchmark.errors import ConfigurationError
from benchmark.registry import component_of, select, select_one
from learned.methods import Learned
from tests.registry.plugin import write_plugin

INFO = MethodInfo(name="power", title="Power")


def made(k):
    def power(shape):
        return shape.mesh.vertices**k

    return power


class Plain:
    info = INFO

    def __init__(self, k=1):
        self.k = k

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices**self.k)


@dataclass(frozen=True, kw_only=True)
class Power:
    info: ClassVar[MethodInfo] = INFO
    k: Any = 1

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices**self.k)


@pytest.mark.parametrize(
    "value", [made(1), Plain, Plain(1), Power(), canonical_form(name="a", title="A")(made(1))]
)
def test_an_object_of_the_user_is_never_known_again(value):
    first, second = component_of(value), component_of(value)
    assert first.key() == first.key()
    assert digest(first.key()) != digest(second.key())


def test_an_object_of_the_suite_is_known_by_its_name():
    assert component_of(LeastSquaresMDS(rtol=0.01)) == select_one("least-squares-mds[rtol=0.01]")
    assert component_of(Learned) == select_one("learned")


def test_a_learner_with_a_model_is_refused():
    learned = Learned()
    object.__setattr__(learned, "model", Path("m"))
    with pytest.raises(ConfigurationError, match="'learned' has a model already"):
        component_of(learned)


@pytest.mark.parametrize(
    "value", [lambda shape: shape.mesh, Power().canonicalise, type("Faulty", (), {}), 3, "".join]
)
def test_what_is_no_method_is_refused(value):
    with pytest.raises(ConfigurationError, match="is no method or scorer"):
        component_of(value)


def test_a_plugin_that_runs_in_this_process_is_never_known_again(tmp_path):
    component = select_one("smooth", [write_plugin(tmp_path / "smooth.py")])
    assert component.in_this_process().key() != component.in_this_process().key()


def test_an_object_is_one_method_with_the_name_of_no_other():
    power = component_of(Power(k=np.int64(2)))
    assert power.name == "power[k=2]"
    assert [each.name for each in select([Power(k=2), Power(k=3)])] == ["power[k=2]", "power[k=3]"]
    with pytest.raises(ConfigurationError, match="an object with parameters of its own"):
        power.with_parameters({"k": 3})

    def gps(shape):
        return shape.mesh.vertices

    with pytest.raises(
        ConfigurationError, match=r"there is another method 'gps', baselines.gps:GPS; rename yours"
    ):
        select([gps])
    with pytest.raises(ConfigurationError, match=r"two methods are called 'power\[k=2\]'"):
        select([Power(k=2), Power(k=2)])
