"""Methods are chosen by name, by grid, by plugin file and by object."""

from __future__ import annotations

import pickle
import sys

import pytest

from baselines.gps import GPS
from baselines.identity import Identity
from benchmark.errors import ConfigurationError
from benchmark.registry import BUILT_IN, Component, by_name, component_of, select, select_one
from benchmark.registry.names import combinations
from benchmark.registry.selection import components_named, variants
from tests.registry.plugin import write_plugin
from tests.registry.test_objects import Power
from tests.runs.toy import LIGHT_SCORER

FIELDS = 'power: float = 1.0\n    kind: str = "a"\n    sizes: tuple[int, ...] = (1, 2)'


@pytest.fixture
def plugin(tmp_path):
    return write_plugin(tmp_path / "smooth.py", fields=FIELDS)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", [{}]),
        (
            "a=1|2,b=x|y",
            [
                {"a": "1", "b": "x"},
                {"a": "1", "b": "y"},
                {"a": "2", "b": "x"},
                {"a": "2", "b": "y"},
            ],
        ),
        ("a=(1,2)|(3,4)", [{"a": "(1,2)"}, {"a": "(3,4)"}]),
        ("a='1|2,b=3'|\"it's\"", [{"a": "1|2,b=3"}, {"a": "it's"}]),
    ],
)
def test_each_choice_of_values_is_listed_once(text, expected):
    assert combinations(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a='1|2", "has a quote without its other half; close what is opened"),
        ("a=(1|2", "a parenthesis without its other half"),
        ("a=1)|(2", "a parenthesis without its other half"),
    ],
)
def test_what_cannot_be_read_is_named(text, message):
    with pytest.raises(ConfigurationError, match=message):
        combinations(text)


def test_a_grid_makes_a_method_of_each_choice_in_the_order_that_it_is_written_in(plugin):
    known = by_name("method", [plugin])
    names = [component.name for component in variants("smooth[power=2|1|2.0,kind=a|b]", known)]
    assert names == ["smooth[power=2.0]", "smooth[power=2.0,kind=b]", "smooth", "smooth[kind=b]"]
    with pytest.raises(
        ConfigurationError, match=r"'smooth\[power=1.2\]' stands for 2 methods; name one: smooth$"
    ):
        select_one("smooth[power=1|2]", [plugin])


@pytest.mark.parametrize(
    "name",
    [
        "smooth[kind='a|b',sizes=(3)]",
        "smooth[power=0.5,kind='']",
        'smooth[kind="it\'s|no"]',
        "smooth",
    ],
)
def test_the_name_of_a_component_is_read_as_the_same_component(name, plugin):
    component = select_one(name, [plugin])
    assert select_one(component.name, [plugin]) == component
    assert pickle.loads(pickle.dumps(component)) == component  # noqa: S301


def test_another_process_reads_parameters_without_the_file_that_defines_their_types(tmp_path):
    plugin = write_plugin(
        tmp_path / "smooth.py",
        imports='from enum import Enum\nSide = Enum("Side", {"LEFT": "left", "RIGHT": "right"})',
        fields="side: Side = Side.LEFT",
    )
    component = select_one("smooth[side=right]", [plugin])
    assert component.name == "smooth[side=right]"
    assert component.defaults | component.parameters == {"side": "right"}
    assert component.create().side.name == "RIGHT"
    module = sys.modules.pop(component.load().__module__)
    sent = pickle.dumps(component)
    assert module.__name__.encode() not in sent
    assert pickle.loads(sent) == component  # noqa: S301


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ([], ["smooth"]),
        (["gps"], ["gps", "smooth"]),
        (["gps", "smooth[power=2]"], ["gps", "smooth[power=2.0]"]),
        (["smooth", "identity", "gps", "gps"], ["gps", "identity", "smooth"]),
        (["all"], [*BUILT_IN, "smooth"]),
    ],
)
def test_a_plugin_file_runs_its_methods_beside_those_that_are_named(names, expected, plugin):
    assert [component.name for component in select(names, [plugin])] == expected


def test_a_method_of_a_file_in_this_folder_is_told_to_be_one(tmp_path, monkeypatch):
    write_plugin(tmp_path / "smooth.py")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        ConfigurationError, match="unknown method 'smooth'; pass --plugin smooth.py"
    ):
        select(["smooth"])


def test_two_components_of_one_name_are_refused(tmp_path):
    plugin = write_plugin(tmp_path / "smooth.py", name="gps")
    with pytest.raises(
        ConfigurationError, match=r"two methods are called 'gps': baselines.gps:GPS and .*smooth.py"
    ):
        by_name("method", [plugin])
    with pytest.raises(
        ConfigurationError, match="a method is called 'all', which stands for all; rename it"
    ):
        by_name("method", [write_plugin(tmp_path / "all.py", name="all")])


def flat_shape(shape):
    return shape.mesh.vertices * [1, 1, 0]


def test_objects_classes_and_functions_are_methods():
    chosen = select(["gps", Power(k=2), GPS, flat_shape])
    assert [component.name for component in chosen] == ["gps", "power[k=2]", "flat-shape"]
    power, flat = chosen[1:]
    assert power.title == "Power (k=2)"
    assert power.create().k == 2
    assert power.key()["parameters"] == {"k": 2}
    assert flat.title == "Flat shape"
    assert component_of(Identity()).key() == select_one("identity").key()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"fields": "power: float"},
            r"smooth cannot be created: .*; give every parameter a valid default",
        ),
        (
            {"fields": "def __post_init__(self): raise ValueError('odd')"},
            r"created: smooth.py:\d+: ValueError: odd",
        ),
    ],
)
def test_a_class_that_cannot_be_created_is_named(changes, message, tmp_path):
    component = select_one("smooth", [write_plugin(tmp_path / "smooth.py", **changes)])
    with pytest.raises(ConfigurationError, match=message):
        component.create()


@pytest.mark.parametrize("package", ["absent", "absent.part"])
def test_a_missing_package_is_named(tmp_path, package):
    component = select_one(
        "smooth", [write_plugin(tmp_path / "smooth.py", info=f'requires=("{package}", "os.path")')]
    )
    assert component.missing_packages() == (package,)
    with pytest.raises(
        ConfigurationError, match=f"method 'smooth' needs {package}; pip install {package}"
    ):
        component.create()


def test_a_target_that_is_not_there_is_named():
    with pytest.raises(ConfigurationError, match="baselines.gps has no 'GSP'"):
        Component("method", "gps", "baselines.gps:GSP").create()
    with pytest.raises(ConfigurationError, match="has no 'info: ClassVar.MethodInfo.'"):
        Component("method", "gps", "baselines.gps:np").create()


def test_a_file_of_scorers_takes_parameters(tmp_path):
    text = LIGHT_SCORER.read_text()
    path = tmp_path / "light.py"
    path.write_text(text.replace("    def signature", "    bins: int = 64\n\n    def signature"))
    (scorer,) = components_named(f"{path}[bins=32]")
    assert (scorer.kind, scorer.name) == ("scorer", "light[bins=32]")
