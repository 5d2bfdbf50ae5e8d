"""Installed packages that bring methods or scorers: one that breaks costs its own and one line."""

import json
import re
import sys
from contextlib import suppress

import pytest

from benchmark.cli.main import main
from benchmark.errors import ConfigurationError
from benchmark.plugins import registry, remote, scorers
from benchmark.plugins.inspection import entry_points_of, installed
from tests.plugins.written import write_plugin
from tests.toy import rod, write_off


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install a package that brings methods, given as text for its entry points, with a module of its own."""
    monkeypatch.syspath_prepend(tmp_path)

    def make(name, points=None, kind=registry.MethodSpec, scorer="", **faults):
        module = name.replace("-", "_")
        write_plugin(tmp_path / f"{module}.py", name=name, **faults)
        if scorer:
            (tmp_path / f"{module}.py").write_text(scorer)
        folder = tmp_path / f"{module}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        text = f"{name} = {module}:Tried" if points is None else points
        (folder / "entry_points.txt").write_text(f"[{entry_points_of(kind)}]\n{text}\n")
        installed.cache_clear()

    yield make
    installed.cache_clear()
    for path in tmp_path.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.fixture
def look_here(monkeypatch):
    """Look from this process: to start another takes half a second."""
    monkeypatch.setattr(remote, "call_apart", lambda function, *arguments, **_: function(*arguments))


@pytest.fixture
def call(tmp_path, monkeypatch, capfd):
    """Run the command line in this process, in a folder of its own; returns what it said."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CANONICAL_FORMS_DATA", raising=False)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["benchmark", *arguments])
        with suppress(SystemExit):
            main()
        return capfd.readouterr()

    return run


SCORER = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.api import ScorerInfo

{on_import}


@dataclass(frozen=True, kw_only=True)
class Tried:
    info: ClassVar[ScorerInfo] = ScorerInfo(name="{name}", title="{name}")

    def signature(self, form):
        return {{"size": np.ptp(form.vertices, axis=0)}}

    def compare(self, signatures, draw):
        return np.zeros((len(signatures), len(signatures)))
"""


def usable():
    return [name for name in registry.methods() if name not in registry.BUILT_IN]


def test_a_package_that_ends_hangs_or_patches_costs_its_own_methods_alone(install, monkeypatch):
    monkeypatch.setattr(remote, "LIMIT", 2.0)
    install("ends-it", on_import="exits")
    install("holds-it", on_making="hangs")
    install("patches-it", on_import="import numpy; numpy.asarray = None")
    install("works")
    assert usable() == ["works"]
    assert [line.partition("; ")[0] for line in registry.methods().news] == [
        "installed package ends-it, ends-it: package ends-it ended its process (exit code 0)",
        "installed package holds-it, holds-it: package holds-it does not end: stopped after 2 s",
        "installed package patches-it, patches-it: package patches-it changes numpy.asarray, on which the suite relies",
    ]
    assert registry.variant("works", registry.methods()).create()
    with pytest.raises(ConfigurationError, match="ends-it ended its process .exit code 0.; correct the package"):
        registry.variant("ends-it", registry.methods())
    assert not {"ends_it", "holds_it", "patches_it"} & set(sys.modules)


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        (
            {"on_import": "raises"},
            "odd: method 'odd' cannot be imported: ZeroDivisionError: division by zero; repair odd",
        ),
        ({"on_import": "sys-exits"}, "odd: method 'odd' cannot be imported: SystemExit: 0; repair odd"),
        (
            {"on_import": "import no_such_module"},
            "odd: method 'odd' cannot be imported: ModuleNotFoundError: .*'no_such_",
        ),
        ({"on_making": "raises"}, "odd: odd cannot be created: ZeroDivisionError: .*give every parameter a valid"),
        ({"info": "title=5"}, "odd: title 5 is not a text of one line"),
        ({"points": "odd = odd:Absent"}, "odd: odd has no 'Absent'; correct the entry point"),
        ({"points": "odd = odd"}, "odd: 'odd' is not 'module:class'"),
        ({"points": "Odd Name = odd:Tried"}, "Odd Name: that is not lower-case words joined by hyphens"),
        ({"points": "gps = odd:Tried"}, "gps: another method has this name"),
        ({"points": "odd"}, "all methods: its entry points cannot be read"),
    ],
)
def test_what_an_installed_package_cannot_bring_is_one_line(faults, said, install, look_here):
    install("odd", **faults)
    assert usable() == []
    (line,) = registry.methods().news
    assert re.match(f"installed package odd, {said}", line), line


def test_of_one_package_the_methods_that_work_stay(install, look_here):
    install("both", points="both = both:Tried\nnone = both:Absent")
    assert usable() == ["both"]
    (line,) = registry.methods().news
    assert line.startswith("installed package both, none: both has no 'Absent'")


def test_every_verb_goes_on_beside_a_broken_package(install, call, tmp_path):
    install("ends-it", on_import="exits")
    install("works")
    write_off(tmp_path / "rod.off", rod(0.1, 1.0))
    done = call("list", "methods", "--json")
    assert {"works"} == {row["name"].partition("[")[0] for row in json.loads(done.out)} - set(registry.BUILT_IN)
    assert [line.partition(":")[0] for line in done.err.splitlines()] == ["installed package ends-it, ends-it"]
    made = call("canonicalise", "-m", "works", "rod.off", "-o", "form.off")
    assert made.out.startswith("form.off: 290 vertices")
    done = call("plan", "-m", "ends-it")
    assert done.err.startswith("error: installed package ends-it, ends-it: package ends-it ended its process")
    assert len(done.err.splitlines()) == 1


def test_a_package_whose_scorer_ends_or_prints_at_import_costs_itself_alone(install, call, tmp_path):
    for name, on_import in (("ends-it", "import os; os._exit(0)"), ("talks", "print('hello')"), ("works", "")):
        install(name, kind=scorers.ScorerSpec, scorer=SCORER.format(name=name, on_import=on_import))
    install("takes-it", "cm-bof = takes_it:Tried", scorers.ScorerSpec, SCORER.format(name="cm-bof", on_import=""))
    write_off(tmp_path / "rods" / "thin0.off", rod(0.1, 1.0))
    write_off(tmp_path / "rods" / "thin1.off", rod(0.1, 0.9))
    write_off(tmp_path / "rods" / "wide0.off", rod(0.3, 1.0))
    listed = call("list", "scorers", "--json")
    assert [row["name"] for row in json.loads(listed.out)] == [*scorers.BUILT_IN, "talks", "works"]
    assert [line for line in listed.err.splitlines() if line != "hello"] == [
        "installed package ends-it, ends-it: package ends-it ended its process (exit code 0); correct the package, or "
        "uninstall it: importing it and creating its scorers must not take long",
        "installed package takes-it, cm-bof: another scorer has this name; correct the package, or uninstall it",
    ]
    plain = call("plan", "-d", "rods", "-m", "identity", "--input", "mesh")
    assert (plain.out.count("missing"), plain.err) == (1, "")
    named = call("plan", "-d", "rods", "-m", "identity", "--input", "mesh", "--scorer", "talks")
    assert named.out.startswith("missing      rods mesh identity by talks")
    refused = call("plan", "-d", "rods", "-m", "identity", "--scorer", "ends-it")
    assert refused.err.startswith("error: installed package ends-it, ends-it: package ends-it ended its process")
    assert not {"ends_it", "takes_it"} & set(sys.modules)
