"""The contract checks: right plugins pass, and each fault is found by the check that is made for it."""

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
    "\n\n    def distances(self, descriptors):\n        k = np.arange(len(descriptors), dtype=float)\n"
    "        return np.abs(k[:, None] - k)"
)


WRITES = "d = shape.geodesics()\n        d.flags.writeable = True\n        d *= 2\n        return shape.form(x)"
COUNTS = "CALLS.append(1)\n        return shape.form(x * {})"
SIGNS = "return shape.form(x * np.where(np.arange(3) == next(COUNT) % 3, -1, 1))"
#: What methods, and a descriptor, keep of the shape or the gallery that they saw first.
STATES = (
    FORM + "return shape.form(x * STATE.setdefault('size', np.ptp(x)))",
    FORM + "return shape.form(x * STATE.setdefault(len(x), np.ptp(x)))",
    FORM + "type(self).first = getattr(self, 'first', np.ptp(x))\n        return shape.form(x * self.first)",
    FORM + "np.first = getattr(np, 'first', np.ptp(x))\n        return shape.form(x * np.first)",
    DESCRIBE + SPREAD + DISTANCES + " / STATE.setdefault('mean', np.mean(d))",
)
#: Forms of eigenvectors with signs that depend on the numbering, or on the position.
SIGNED = ("spectral(shape)", "spectral(shape) * np.sign(spectral(shape)[0])")
PLACED = "spectral(shape) * np.sign((spectral(shape) * x).sum(axis=0))"
SIMILAR = (
    (" - 0.1", "a distance is negative"),
    (" * [1, 2, 3]", "not symmetric"),
    (".max() - np.abs(d[:, None] - d[None]).sum(axis=2)", "from itself; return distances, not similarities"),
    (" @ np.ones((len(d), 1)) @ np.ones((1, len(d))) * 0 + d @ d.T", "from itself; return distances, not similarities"),
    (" * 0 + (1 - np.eye(len(d))) / (1 + np.abs(d[:, None] - d[None]).sum(axis=2))", "far from its copy"),
    (" + (descriptors[0].sort() or 0)", "read-only"),
)
MUTE = "if len(x) < 5: raise UnsupportedShape('')\n        return shape.form(x)"


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


FAULTS = [
    ("citation", RIGHT, "cite='nobody2001'", "neither a key of the suite's bibliography nor one"),
    ("citation", RIGHT, "cite='@misc{me, title = {A}'", "nor one whole BibTeX entry"),
    ("answer", FORM + "return shape.form(x * np.nan)", "", "^tried.py: method 'smooth' .*: 500 of 500 vertices"),
    ("answer", FORM + "return shape.form(0 * x)", "", "at one point"),
    ("answer", FORM + "return shape.form(x[1:])", "", "^tried.py: method 'smooth' .* 499 positions for 500 vertices"),
    ("answer", FORM + "return x", "", "it is of type ndarray, not CanonicalForm; return shape.form"),
    ("answer", FORM + "x[0] = 0\n        return shape.form(x)", "", "work on a copy"),
    ("answer", FORM + "return shape.form(x, **{'a\\0b': 1})", "", "a note called 'a.x00b'; give it a short"),
    ("answer", FORM + "import no_such_package", "", "name packages beyond the core in info.requires"),
    ("answer", FORM + "raise UnsupportedShape('too thin')", "", r"refuses an ordinary surface \(too thin\)"),
    ("answer", "power: int = 2.5\n\n    " + RIGHT, "", "'2.5' does not fit power of smooth"),
    ("answer", FORM + "__import__('multiprocessing').get_context('spawn').Pool(1)", "", "'fork'"),
    ("answer", FORM + "return topp", "", r"^tried.py:40: NameError: name 'topp' is not defined$"),
    ("answer", FORM + "sys.exit(3)", "", r"^tried.py:40: SystemExit: 3$"),
    ("answer", DESCRIBE + "return [1.0, 1j]" + DISTANCES, "", "type complex128; return a vector"),
    ("answer", FORM + WRITES, "", "cannot set WRITEABLE flag"),
    ("answer", FORM + "shape.seed = 7\n        return shape.form(x)", "", "work on a copy"),
    ("repeatable", FORM + COUNTS.format("len(CALLS)"), "", "two runs on one shape differ; draw from .*, keep no state"),
    (
        "repeatable",
        FORM + COUNTS.format("(1 + (len(CALLS) > 2))"),
        "",
        "the answer differs if another shape comes first",
    ),
    ("repeatable", FORM + SIGNS, "", "differ by signs; .* choose the signs of eigenvectors by benchmark.api.oriented"),
    *(("repeatable", state, "", "if another shape comes first; keep no state") for state in STATES),
    ("seed", FORM + "return shape.form(x * (1 + shape.random().random()))", "", "declare deterministic=False"),
    ("seed", FORM + "return shape.form(x * len(shape.identifier))", "", "depends on the name or the seed"),
    ("seed", RIGHT, "deterministic=False", "ignores the seed"),
    ("relabelling", FORM + "return shape.form(x - 0.5 * (x[0] @ x[0]) * x)", "", "break ties by geometry"),
    *(("relabelling", FORM + f"return shape.form({signs})", "", "mirror image") for signs in SIGNED),
    ("rigid motion", FORM + f"return shape.form({PLACED})", "", "mirror image of the form: .*api.oriented"),
    ("rigid motion", FORM + "return shape.form(x * [1, 1, 2])", "", "position of the shape in space"),
    ("scale", FORM + "return shape.form(x / np.sqrt(shape.mesh.area))", "", "or declare 'invariant'"),
    ("scale", RIGHT, "scale='invariant'", "difference 3.0e.00.* or declare 'equivariant'"),
    ("scale", DESCRIBE + SPREAD + DISTANCES, "scale='invariant'", "or declare 'equivariant'"),
    ("scale", DESCRIBE + "return np.array([1.0])" + DISTANCES, "", "does not distinguish poses"),
    ("dissimilarities", DESCRIBE + SPREAD + DISTANCES.replace("np.abs", "np.exp"), "", "not symmetric"),
    ("dissimilarities", DESCRIBE + SPREAD + DISTANCES.replace("return np", "return -np"), "", "a distance is negative"),
    *(("dissimilarities", DESCRIBE + SPREAD + DISTANCES + end, "", message) for end, message in SIMILAR),
    ("dissimilarities", DESCRIBE + SPREAD + POSITIONS, "", "depends on the order of the shapes"),
    ("awkward shapes", FORM + "return shape.form(x + 0 * x[10])", "", "a triangle: tried.py:40: IndexError"),
    ("awkward shapes", FORM + MUTE, "", "a tetrahedron is refused without a reason"),
]


@pytest.mark.parametrize(("name", "body", "info", "message"), FAULTS)
def test_a_fault_is_found_by_its_check(name, body, info, message, tmp_path):
    is_first = name in ("answer", "repeatable")
    seen = findings(written(tmp_path / "tried.py", body, info), "" if is_first else name)
    assert seen[name].outcome == "failed", [str(finding) for finding in seen.values()]
    assert re.search(message, seen[name].explanation), seen[name].explanation
    assert not (seen[name].traceback and seen[name].explanation.startswith("tried.py: method"))  # which says all
    if is_first:
        assert list(seen)[-1] == name  # there is nothing to compare


def test_a_right_descriptor_passes(tmp_path):
    found = findings(written(tmp_path / "tried.py", DESCRIBE + "return [shape.geodesics().std()]" + DISTANCES))
    assert {finding.outcome for finding in found.values()} == {"ok"}


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
    assert found["rigid motion"].explanation == found["scale"].explanation == "the depth image has one camera"


def test_a_missing_package_is_no_fault(tmp_path):
    found = findings(written(tmp_path / "tried.py", info="requires=('no_such_package',)"))
    assert [str(f) for f in found.values()] == ["skipped  packages         install no_such_package, then check again"]


SHARES = "counts / weights.sum()}"
EDITS = [
    ("distance_distribution", '{"shares": counts / weights.sum()}', "counts", "answer", "not named arrays"),
    ("distance_distribution", "distances / mean", "distances", "rigid motion", "depends on position or size"),
    ("distance_distribution", SHARES, f"{SHARES[:-1]} + abs(form.vertices[0, 0])}}", "relabelling", "numbering"),
    ("distance_distribution", '"cityblock")', '"cityblock") * 0.0', "dissimilarities", "does not distinguish any"),
    ("distance_distribution", "if not mean > 0:", "if 1 / mean < 0:", "awkward shapes", "a point"),
    ("nearest_view", '"seed{self.training_seed}"', '"a/b"', "training", "model_name is 'a/b'"),
    ("nearest_view", '] = "table"', '] = "tabel"', "training", "split is 'tabel'; choose one of table"),
    ("nearest_view", '"identifiers": data.identifiers,', '"identifiers": ["me"],', "training", "all identifiers"),
    ("nearest_view", "return loaded", "return None", "training", "'load' returns NoneType"),
    ("nearest_view", "hexdigest()", "hexdigest()[::-1]", "training", "has digest"),
]


@pytest.mark.parametrize(("example", "old", "new", "name", "message"), EDITS)
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
    [("while True: time.sleep(0.01)", "3s", 0, 1), ("if len(x) == 3: os.kill(os.getpid(), 11)", "5m", 6, -11)],
)
def test_a_loop_or_a_crash_ends_the_checks_and_says_at_which_line(body, limit, n_ok, code, tmp_path):
    written(tmp_path / "tried.py", FORM + f"{body}\n        return shape.form(x)")
    command = [sys.executable, "-m", "benchmark", "check", tmp_path / "tried.py", "--timeout", limit]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == code
    assert [line.split()[1] for line in done.stdout.splitlines()] == ["ok"] * n_ok
    assert 'tried.py", line 40 in canonicalise' in done.stderr


def test_prints_do_not_stand_among_findings(tmp_path, capsys):
    component = written(tmp_path / "tried.py", FORM + "print('printed')\n        return shape.form(x)")
    assert next(check(component)).outcome == "ok"
    out, err = capsys.readouterr()
    assert "printed" not in out
    assert "printed" in err


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_method_keeps_the_contract(name):
    assert not [str(finding) for finding in findings(by_name("method")[name]).values() if finding.outcome == "failed"]
