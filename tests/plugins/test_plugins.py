"""Plugin files bring modules of their own, and never another plugin's."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.errors import ConfigurationError
from benchmark.plugins import modules, registry

ROOT = Path(__file__).parents[2]

PLUGIN = """
{before}
from benchmark.api.contracts import canonical_form


@canonical_form(name="{name}", title="Stretched")
def stretched(shape):
    {inside}
    return shape.mesh.vertices * {factor}
"""


@pytest.fixture(autouse=True)
def as_before(monkeypatch):
    """Forget what plugins brought."""
    known = set(sys.modules)
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    monkeypatch.setattr(modules._PluginFolders, "folders", [])
    yield
    for name in set(sys.modules) - known:
        del sys.modules[name]


def write(folder, name="one", before="import toy_helper", inside="pass", factor="toy_helper.FACTOR", **modules):
    folder.mkdir(parents=True, exist_ok=True)
    for module, text in modules.items():
        path = folder / Path(*reversed(module.split("_in_"))).with_suffix(".py")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    path = folder / f"{name}.py"
    path.write_text(PLUGIN.format(name=name, before=before, inside=inside, factor=factor))
    return path


class Square:
    """As much of a shape as the plugins above look at."""

    class mesh:  # noqa: N801
        vertices = 1.0

    @staticmethod
    def form(vertices):
        return vertices


def form(path):
    (spec,) = registry.plugin_methods(path)
    return spec.create().canonicalise(Square)


@pytest.mark.parametrize(
    "imports",
    [
        {"before": "import toy_helper"},
        {"before": "from toy_helper import FACTOR", "factor": "FACTOR"},
        {"before": "", "inside": "import toy_helper"},
        {"before": "", "inside": "import importlib; toy_helper = importlib.import_module('toy_helper')"},
    ],
)
def test_a_module_beside_the_plugin_can_be_imported_at_once_and_later(tmp_path, imports):
    assert form(write(tmp_path, toy_helper="FACTOR = 3.0", **imports)) == 3.0
    assert str(tmp_path) not in sys.path


def test_no_bytecode_is_written_which_a_full_disk_could_truncate(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    form(write(tmp_path, toy_helper="FACTOR = 3.0"))
    assert not list(tmp_path.rglob("*.pyc"))


def test_a_module_brings_further_ones_and_packages(tmp_path):
    further = {
        "toy_helper": "from toy_package.inner import FACTOR",
        "inner_in_toy_package": "import toy_last as last\n",
    }
    further["inner_in_toy_package"] += "FACTOR = last.FACTOR"
    path = write(tmp_path, toy_last="FACTOR = 5.0", __init___in_toy_package="", **further)
    assert set(modules.helpers_of(path)) == {"toy_helper", "toy_package", "toy_last"}
    assert form(path) == 5.0


def test_two_plugins_may_share_a_module_or_have_copies_of_one(tmp_path):
    first = write(tmp_path / "a", toy_helper="FACTOR = 3.0")
    second = write(tmp_path / "a", "two")
    third = write(tmp_path / "b", "three", toy_helper="FACTOR = 3.0")
    assert [form(path) for path in (first, second, third)] == [3.0, 3.0, 3.0]


@pytest.mark.parametrize("inside", ["pass", "import toy_helper"])
def test_two_plugins_that_bring_other_modules_of_one_name_are_refused(tmp_path, inside):
    before = "import toy_helper" if inside == "pass" else ""
    first = write(tmp_path / "a", toy_helper="FACTOR = 3.0", before=before, inside=inside)
    second = write(tmp_path / "b", "two", toy_helper="FACTOR = 4.0", before=before, inside=inside)
    with pytest.raises(ConfigurationError) as caught:
        registry.methods([first, second])
    taken, own = tmp_path / "a" / "toy_helper.py", tmp_path / "b" / "toy_helper.py"
    assert (
        caught.value.problem
        == f"plugin {second} brings a module 'toy_helper' ({own}), but that name is used by {taken}"
    )
    assert caught.value.hint == "rename one of them"


@pytest.mark.parametrize("name", ["json", "click", "math"])
def test_a_module_named_like_one_that_is_installed_is_refused(tmp_path, name):
    path = write(tmp_path, before=f"import {name}", factor="1", **{name: ""})
    with pytest.raises(ConfigurationError, match=f"brings a module '{name}' .* name is used by .*; rename one"):
        registry.methods([path])


def test_another_process_finds_it_too(tmp_path):
    path = write(tmp_path, before="", inside="import toy_helper", toy_helper="FACTOR = 3.0")
    (spec,) = registry.plugin_methods(path)
    code = f"""
import pickle
from types import SimpleNamespace
spec = pickle.loads({__import__("pickle").dumps(spec)!r})
print(spec.create().canonicalise(SimpleNamespace(mesh=SimpleNamespace(vertices=1.0), form=lambda v: v)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.stdout.strip() == "3.0", done.stderr


def test_a_path_that_is_no_unicode_is_that_of_a_plugin(tmp_path):
    assert form(write(tmp_path / "\udcff", before="FACTOR = 2", factor="FACTOR")) == 2.0
