"""The contract checks: right plugins pass, and each fault is found by the check that is made for
it.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import pytest

from benchmark.check import Finding, check
from benchmark.check.checks import checks_of
from benchmark.registry import Component, by_name
from benchmark.registry.known import BUILT_IN, in_file
from tests.registry.plugin import write_plugin
from tests.verbs import refusal

EXAMPLES = Path(__file__).parents[2] / "examples"

IMPORTS = """
import itertools
import os
import sys
import time

import numpy as np

from benchmark.api import CanonicalForm, UnsupportedShape

from benchmark.geometry.laplacian import eigenpairs

CALLS = []
COUNT = itertools.count()
STATE = {}


def spectral(shape):
    values, functions = eigenpairs(shape.laplacian(), 4)
    return functions[:, 1:] / values[1:]
"""
FORM = "def canonicalise(self, shape):\n        x = shape.mesh.vertices\n        "
RIGHT = FORM + "return shape.form(x)"
DESCRIBE = "def describe(self, shape):\n        x = shape.mesh.vertices\n        "
SPREAD = "return np.array([shape.geodesics().std(), shape.source_area])"
DISTANCES = (
    "\n\n    def distances(self, descriptors):\n        d = np.stack(descriptors)\n"
    "        return np.abs(d[:, None] - d[None]).sum(axis=2)"
)
POSITIONS = (
    "\n\n    def distances(self, descriptors):\n"
    "        k = np.arange(len(descriptors), dtype=float)\n"
    "        return np.abs(k[:, None] - k)"
)


#: What parts of the tables stand for.
PARTS = {
    "{FORM}": FORM,
    "{DESCRIBE}": DESCRIBE,
    "{SPREAD}": SPREAD,
    "{DISTANCES}": DISTANCES,
    "{POSITIONS}": POSITIONS,
}


def rows_of(name: str) -> list[list[str]]:
    """Return the cells of a table beside this file."""
    text = Path(__file__).with_name(name).read_text()
    for part, code in PARTS.items():
        text = text.replace(part, code.replace("\n", "\\n"))
    return [[cell.replace("\\n", "\n") for cell in line.split(" | ")] for line in text.splitlines()]


def written(path: Path, methods: str = RIGHT, info: str = "") -> Component:
    (component,) = in_file(write_plugin(path, imports=IMPORTS, info=info, methods=methods))
    return component


def findings(component: Component, only: str = "") -> dict[str, Finding]:
    """The findings by name, of all checks or of one alone."""
    chosen = {name: run for name, run in checks_of(component).items() if only in ("", name)}
    with patch("benchmark.check.checks_of", lambda _: chosen):
        return {finding.name: finding for finding in check(component)}


def test_a_right_method_passes_every_check(tmp_path):
    found = findings(written(tmp_path / "tried.py", info="cite='@misc{me,\\n  title = {A}}'"))
    assert {finding.outcome for finding in found.values()} == {"ok"}
    assert len(found) == 8
    assert found["citation"].explanation == "cites me"


@pytest.mark.parametrize(("name", "body", "info", "message"), rows_of("faults.txt"))
def test_a_fault_is_found_by_its_check(name, body, info, message, tmp_path):
    is_first = name in ("answer", "repeatable")
    seen = findings(written(tmp_path / "tried.py", body, info), "" if is_first else name)
    assert seen[name].outcome == "failed", [str(finding) for finding in seen.values()]
    assert re.search(message, seen[name].explanation), seen[name].explanation
    assert not (
        seen[name].traceback and seen[name].explanation.startswith("tried.py: method")
    )  # which says all
    if is_first:
        assert list(seen)[-1] == name  # there is nothing to compare


def test_a_method_of_depth_images_gets_one_and_may_have_vertices_of_its_own(tmp_path):
    body = (
        FORM + "if shape.depth is None: raise UnsupportedShape('no depth image')\n"
        "        d = shape.depth[::100, ::100].astype(float)\n"
        "        v = np.stack([*np.indices(d.shape), d], axis=-1).reshape(-1, 3)\n"
        "        return CanonicalForm(v, np.array([[0, 1, 2]], dtype=np.int32))"
    )
    found = findings(written(tmp_path / "tried.py", body, "inputs=('view',)"))
    assert not [finding for finding in found.values() if finding.outcome == "failed"]
    assert found["relabelling"].explanation == "the form has its own vertices"
    assert (
        found["rigid motion"].explanation
        == found["scale"].explanation
        == "the depth image has one camera"
    )


PLAIN = """
from benchmark.api import MethodInfo

class Plain:
    info = MethodInfo(name="plain", title="Plain")

    def __init__(self, time=0.02, *, name=""):
        self.time = time

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices)
"""


def test_arguments_of_a_plain_class_are_no_parameters_and_it_says_how_to_make_them_some(tmp_path):
    (tmp_path / "plain.py").write_text(PLAIN)
    (component,) = in_file(tmp_path / "plain.py")
    found = findings(component)
    assert found["parameters"].outcome == "failed"
    assert found["answer"].outcome == "ok"
    said = found["parameters"].explanation
    assert said.startswith("time, name of __init__ cannot be chosen")
    assert "@dataclass(frozen=True) and write 'time: float = 0.02'" in said


@pytest.mark.parametrize(
    "base", ["benchmark.api.Method", "torch.nn.Module", "builtins.dict", "benchmark.api.Descriptor"]
)
def test_arguments_that_a_class_inherits_without_a_name_are_no_fault(tmp_path, base):
    module, _, name = base.rpartition(".")
    text = PLAIN.replace("class Plain:", f"from {module} import {name}\n\nclass Plain({name}):")
    start = text.index("    def __init__")
    text = text[:start] + text[text.index("    def canonicalise") :]
    (tmp_path / "plain.py").write_text(text)
    (component,) = in_file(tmp_path / "plain.py")
    assert "parameters" not in checks_of(component)


def test_a_length_that_follows_the_size_of_the_shape_as_on_the_page_of_plugins(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "reference" / "plugins.md").read_text()
    line = "step = 0.05 * np.sqrt(shape.mesh.area)"
    assert line in page
    moved = "return shape.form(x + step * np.sign(x - x.mean(axis=0)))"
    followed = written(tmp_path / "tried.py", f"{FORM}{line}\n        {moved}")
    assert findings(followed, "scale")["scale"].outcome == "ok"
    fixed = findings(written(tmp_path / "fixed.py", f"{FORM}step = 0.05\n        {moved}"), "scale")
    assert "multiply lengths by np.sqrt(shape.mesh.area)" in fixed["scale"].explanation


def test_a_missing_package_is_no_fault(tmp_path):
    found = findings(written(tmp_path / "tried.py", info="requires=('no_such_package',)"))
    assert [str(f) for f in found.values()] == [
        "skipped  packages         install no_such_package, then check again"
    ]


@pytest.mark.parametrize(("example", "old", "new", "name", "message"), rows_of("edits.txt"))
def test_a_fault_of_a_scorer_or_learner_is_found(example, old, new, name, message, tmp_path):
    text = (EXAMPLES / f"{example}.py").read_text()
    assert old in text
    (tmp_path / "edited.py").write_text(text.replace(old, new))
    (component,) = in_file(tmp_path / "edited.py")
    seen = findings(component, name)
    assert seen[name].outcome == "failed", [str(finding) for finding in seen.values()]
    assert message in seen[name].explanation


@pytest.mark.parametrize(
    ("body", "limit", "n_ok", "code"),
    [
        ("while True: time.sleep(0.01)", "3s", 0, 1),
        ("if len(x) == 3: os.kill(os.getpid(), 11)", "5m", 6, -11),
    ],
)
def test_a_loop_or_a_crash_ends_the_checks_and_says_at_which_line(
    body, limit, n_ok, code, tmp_path
):
    written(tmp_path / "tried.py", FORM + f"{body}\n        return shape.form(x)")
    command = [
        sys.executable,
        "-m",
        "benchmark",
        "check",
        tmp_path / "tried.py",
        "--timeout",
        limit,
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == code
    assert [line.split()[1] for line in done.stdout.splitlines()] == ["ok"] * n_ok
    assert 'tried.py", line 40 in canonicalise' in done.stderr


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("mine", "mine"), "two methods are called 'mine'"),
        (("gps",), "two methods are called 'gps': baselines.gps:GPS and"),
    ],
)
def test_a_file_whose_names_no_run_would_take_is_refused(tmp_path, names, message):
    lines = ["from benchmark.api import canonical_form"]
    for number, name in enumerate(names):
        lines.append(f'@canonical_form(name="{name}", title="Mine")')
        lines.append(f"def method{number}(shape): return shape.mesh.vertices")
    (tmp_path / "own.py").write_text("\n".join(lines))
    assert message in refusal("check", tmp_path / "own.py")


def test_prints_do_not_stand_among_findings(tmp_path, capsys):
    component = written(
        tmp_path / "tried.py", FORM + "print('printed')\n        return shape.form(x)"
    )
    assert next(check(component)).outcome == "ok"
    out, err = capsys.readouterr()
    assert "printed" not in out
    assert "printed" in err


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_method_keeps_the_contract(name):
    assert not [
        str(finding)
        for finding in findings(by_name("method")[name]).values()
        if finding.outcome == "failed"
    ]
