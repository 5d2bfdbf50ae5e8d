"""The contract checks: right methods pass, and each fault is found by the check that is made for it."""

import itertools
import os
import platform
import re

import pytest

from benchmark.execution.processes import process as system_processes
from benchmark.plugins import conformance, registry
from benchmark.plugins.conformance import checks
from benchmark.plugins.registry import MethodSpec
from benchmark.text import DATA_VARIABLE

#: Starts processes afresh.
START = system_processes._start

pytestmark = pytest.mark.usefixtures("forked_workers")

TABLE = checks.OF_METHODS_AND_SCORERS

#: Checks that compare answers.
OF_THE_ANSWER = list(TABLE)[list(TABLE).index("answer") + 1 :]

METHOD = """
import itertools
import os
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.api.contracts import CanonicalForm, MethodInfo, UnsupportedShape

CALLS = []
COUNT = itertools.count()


@dataclass({dataclass})
class Tried:
    info: ClassVar[MethodInfo] = MethodInfo({info})
    {field}

    {body}
"""
FORM = "def canonicalise(self, shape):\n        x = shape.mesh.vertices\n        "
LEANS = (
    "y = x - x.mean(axis=0)\n        if y.var() > 0.14 / 3:\n            y = y @ np.linalg.eigh(y.T @ y)[1]\n"
    "            y = y * np.sign((y**3).sum(axis=0))\n        return shape.form(y)"
)
DESCRIBE = "def describe(self, shape):\n        x = shape.mesh.vertices\n        "
SPREAD = "return np.array([shape.geodesics().std(), shape.source_area])"
DISTANCES = (
    "\n\n    def distances(self, descriptors):\n        d = np.stack(descriptors)\n"
    "        return np.abs(d[:, None] - d[None]).sum(axis=2)"
)
PLACES = (
    "\n\n    def distances(self, descriptors):\n        k = np.arange(len(descriptors), dtype=float)\n"
    "        return np.abs(k[:, None] - k)"
)


@pytest.fixture
def findings(tmp_path):
    """Check a method that differs from a right one in what is passed."""
    numbers = itertools.count()

    def check(body=FORM + "return shape.form(x)", info="", field="factor: float = 1.0", dataclass=None):
        path = tmp_path / f"tried_{next(numbers)}.py"
        info = f"name='tried', title='Tried'{', ' if info else ''}{info}" if "name=" not in info else info
        path.write_text(
            METHOD.format(body=body, info=info, field=field, dataclass=dataclass or "frozen=True, kw_only=True")
        )
        return {finding.name: finding for finding in conformance.check(MethodSpec("tried", f"{path}:Tried"))}

    return check


def alone(monkeypatch, name):
    """Leave out all checks that compare answers but one."""
    kept = {key: each for key, each in TABLE.items() if key not in OF_THE_ANSWER or key == name}
    monkeypatch.setattr(checks, "OF_METHODS_AND_SCORERS", kept)


def failed(found):
    return [name for name, finding in found.items() if finding.outcome == "failed"]


def test_a_right_method_passes_every_check(findings):
    found = findings()
    assert failed(found) == []
    assert [name for name, finding in found.items() if finding.outcome == "skipped"] == ["dissimilarities"]
    assert all("\n" not in str(finding) for finding in found.values())


@pytest.mark.parametrize(
    ("check", "changes", "message"),
    [
        # The class.
        ("class", {"dataclass": "kw_only=True"}, "can be changed after creation"),
        ("class", {"dataclass": "frozen=True"}, "can be passed by position"),
        ("parameters", {"field": "factor: object = np.linalg.norm"}, "do not fit into JSON"),
        ("parameters", {"dataclass": "frozen=True, kw_only=True, eq=False"}, "it is another method"),
        # One answer.
        ("answer", {"body": FORM + "return shape.form(x * np.nan)"}, "500 of 500 vertices are NaN"),
        ("answer", {"body": FORM + "return shape.form(0 * x)"}, "at one point"),
        ("answer", {"body": FORM + "return x"}, "it is of type ndarray, not CanonicalForm; return shape.form"),
        ("answer", {"body": FORM + "x[0] = 0\n        return shape.form(x)"}, "writes into its input"),
        ("answer", {"body": FORM + "import no_such_package"}, "cannot import.*info.requires"),
        ("answer", {"body": FORM + "raise UnsupportedShape('too thin')"}, r"refuses an ordinary surface \(too thin\)"),
        ("answer", {"body": FORM + "raise KeyError('limb')"}, "raises KeyError: 'limb'"),
        ("answer", {"body": DESCRIBE + "return [1.0, 1j]" + DISTANCES}, "type complex128; return a vector"),
        # The shape.
        (
            "input untouched",
            {
                "body": FORM
                + "d = shape.geodesics()\n        d.flags.writeable = True\n        d *= 2\n"
                + "        return shape.form(x)"
            },
            "changes the geodesics of the shape",
        ),
        (
            "input untouched",
            {"body": FORM + "shape.laplacian().mass[:] = 1\n        return shape.form(x)"},
            "changes the vertex areas",
        ),
        ("input untouched", {"body": FORM + "shape.seed = 7\n        return shape.form(x)"}, "changes the attributes"),
        # Two answers.
        (
            "repeatable",
            {"body": FORM + "CALLS.append(1)\n        return shape.form(x * len(CALLS))"},
            "two runs on one shape differ by .*; draw from .*, keep no state between shapes",
        ),
        (
            "repeatable",
            {"body": FORM + "return shape.form(x + np.random.rand(3))", "info": "deterministic=False"},
            r"two runs on one shape differ by .*draw from shape.random\(\)",
        ),
        (
            "repeatable",
            {"body": FORM + "return shape.form(x * np.where(np.arange(3) == next(COUNT) % 3, -1, 1))"},
            r"differ by signs; make the largest entry .* a fixed start \(v0=...\)",
        ),
        (
            "seed",
            {"body": FORM + "return shape.form(x * (1 + shape.random().random()))"},
            "declare deterministic=False",
        ),
        ("seed", {"body": FORM + "return shape.form(x * len(shape.identifier))"}, "depends on the name or the seed"),
        ("seed", {"info": "deterministic=False"}, "ignores the seed"),
        ("relabelling", {"body": FORM + "return shape.form(x - 0.5 * (x[0] @ x[0]) * x)"}, "break ties by geometry"),
        ("relabelling", {"body": FORM + "return shape.form(np.sort(x, axis=0))"}, "numbering of vertices"),
        ("rigid motion", {"body": FORM + "return shape.form(x * [1, 1, 2])"}, "position of the shape in space"),
        ("rigid motion", {"body": FORM + "return shape.form(x * np.abs(x).max())"}, "position of the shape in space"),
        ("mirror", {"body": FORM + LEANS}, "mirrors some shapes and not others"),
        (
            "mirror",
            {"body": FORM + "return shape.form(x * (2 + np.tanh(np.linalg.det(x[[0, 9, 99]]))))"},
            "another form",
        ),
        ("scale", {"body": FORM + "return shape.form(x / np.sqrt(shape.mesh.area))"}, "or declare 'invariant'"),
        ("scale", {"info": "scale='invariant'"}, "difference 1.5e.00.* or declare 'equivariant'"),
        ("scale", {"body": DESCRIBE + SPREAD + DISTANCES, "info": "scale='invariant'"}, "or declare 'equivariant'"),
        (
            "scale",
            {"body": DESCRIBE + "return np.array([shape.source_area**2 + shape.source_area])" + DISTANCES},
            "breaks info.scale",
        ),
        ("scale", {"body": DESCRIBE + "return np.array([1.0])" + DISTANCES}, "does not distinguish poses"),
        (
            "dissimilarities",
            {"body": DESCRIBE + SPREAD + DISTANCES.replace("np.abs", "np.exp")},
            "not symmetric with a zero diagonal",
        ),
        (
            "dissimilarities",
            {"body": DESCRIBE + SPREAD + DISTANCES.replace("return np", "return -np")},
            "return numbers >= 0",
        ),
        (
            "dissimilarities",
            {"body": DESCRIBE + SPREAD + DISTANCES.replace(".sum(axis=2)", ".sum(axis=(1, 2))")},
            r"returned an array of shape \(3,\).*symmetric matrix",
        ),
        (
            "dissimilarities",
            {"body": DESCRIBE + SPREAD + DISTANCES + " * (1 + d[0, 0])"},
            "depends on the order of the descriptors",
        ),
        ("dissimilarities", {"body": DESCRIBE + SPREAD + PLACES}, "depends on the order of the descriptors"),
        # Shapes that are hard to treat.
        ("awkward shapes", {"body": FORM + "return shape.form(x + 0 * x[10])"}, "a triangle: raises IndexError"),
        (
            "awkward shapes",
            {"body": FORM + "return shape.form(x if np.ptp(x, axis=0).min() > 1e-9 else x * np.nan)"},
            "a flat sheet: method 'tried' returned no canonical form: 154 of 154 vertices are NaN",
        ),
        (
            "awkward shapes",
            {"body": FORM + "if len(x) < 5: raise UnsupportedShape('')\n        return shape.form(x)"},
            "a tetrahedron is refused without a reason",
        ),
    ],
)
def test_a_fault_is_found_by_its_check(check, changes, message, findings, in_this_process, monkeypatch):
    if check in OF_THE_ANSWER:  # the others are correct to find fault too, but take time
        alone(monkeypatch, check)
    found = findings(**changes)
    assert check in failed(found), [str(finding) for finding in found.values()]
    assert re.search(message, found[check].explanation), found[check].explanation
    if check == "answer":
        assert {found[name].outcome for name in OF_THE_ANSWER} == {"skipped"}


def test_a_parameter_without_default_cannot_be_made(findings, in_this_process):
    found = findings(field="factor: float")
    assert "factor without default; every parameter needs one" in found["class"].explanation
    assert failed(found) == ["class", "parameters", "answer"]


def test_a_check_that_raises_costs_itself_alone(findings, in_this_process):
    found = findings(body=FORM + "if shape.seed: raise KeyError('seed')\n        return shape.form(x)")
    assert failed(found) == ["seed"]


def test_a_method_that_reads_the_data_folder_is_found(findings, monkeypatch, tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "cat0.txt").write_text("2.0")
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "data"))
    alone(monkeypatch, "fresh process")
    factor = f"float(open({str(tmp_path / 'data' / 'cat0.txt')!r}).read())"
    found = findings(body=FORM + f"return shape.form(x * {factor})")
    assert failed(found) == ["fresh process"]
    assert "the data folder is hidden" in found["fresh process"].explanation


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("return shape.form(x * os.getpid())", "another process answers differently"),
        (
            f"if os.getpid() != {os.getpid()}: os._exit(1)\n        return shape.form(x)",
            "the process ended without an answer",
        ),
    ],
    ids=["differs", "ends"],
)
def test_another_process_must_answer_the_same(body, message, findings, monkeypatch):
    monkeypatch.setattr(system_processes, "_start", START)
    alone(monkeypatch, "fresh process")
    found = findings(body=FORM + body)
    assert failed(found) == ["fresh process"]
    assert message in found["fresh process"].explanation


RANDOM_START = """from scipy.sparse.linalg import eigsh
        stiffness = shape.laplacian().stiffness
        return shape.form(x * (1 + np.abs(eigsh(stiffness, k=4, tol=1e-11)[1]).sum(axis=1, keepdims=True)))"""


def test_a_solver_that_starts_at_random_is_warned_of(findings, monkeypatch):
    alone(monkeypatch, "fresh process")
    found = findings(body=FORM + RANDOM_START)
    assert found["fresh process"].outcome == "warning"
    difference = re.search(r"two processes differ by (\S+) of the largest", found["fresh process"].explanation)
    assert 0 < float(difference[1]) < 1e-9
    assert "fixed start (v0=...)" in found["fresh process"].explanation
    fixed = RANDOM_START.replace("k=4,", "k=4, v0=np.arange(len(x), dtype=float),")
    assert findings(body=FORM + fixed)["fresh process"].outcome == "ok"


@pytest.mark.parametrize(
    ("moved", "outcome", "message"),
    [
        ("0.0", "ok", "changes no bit"),
        ("1e-12", "ok", r"changes [\d.e-]+ of the largest number, too little"),
        ("1e-4", "warning", r"changes [\d.e-]+ of the largest number, so scores will differ between machines"),
    ],
)
def test_what_another_processor_changes_is_told(moved, outcome, message, findings, in_this_process, monkeypatch):
    alone(monkeypatch, "other processor")
    monkeypatch.setattr(checks.platform, "machine", lambda: "x86_64")
    monkeypatch.delenv(checks.KERNEL, raising=False)
    found = findings(body=FORM + f"return shape.form(x * (1 + {moved} * ('{checks.KERNEL}' in os.environ)))")
    assert found["other processor"].outcome == outcome
    assert re.search(message, found["other processor"].explanation)
    assert checks.KERNEL not in os.environ


@pytest.mark.skipif(platform.machine() != "x86_64", reason="kernels are chosen on x86-64")
def test_the_other_kernel_is_really_another(findings, monkeypatch):
    monkeypatch.setattr(system_processes, "_start", START)  # libraries choose their kernels when they load
    alone(monkeypatch, "other processor")
    monkeypatch.delenv(checks.KERNEL, raising=False)
    body = (
        "from threadpoolctl import threadpool_info\n        "
        "kernels = {found.get('architecture', 'Nehalem') for found in threadpool_info()}\n        "
        "return shape.form(x * (2 if kernels == {'Nehalem'} else 1))"
    )
    assert findings(body=FORM + body)["other processor"].outcome == "warning"


def test_a_right_descriptor_passes(findings, in_this_process):
    assert failed(findings(body=DESCRIBE + "return np.array([shape.geodesics().std()])" + DISTANCES)) == []
    found = findings(body=DESCRIBE + "return np.array([shape.source_area])" + DISTANCES)
    assert {finding.outcome for finding in found.values()} == {"ok"}


def test_a_method_of_depth_images_gets_one_and_may_have_vertices_of_its_own(findings, in_this_process):
    body = (
        FORM + "if shape.depth is None: raise UnsupportedShape('no depth image')\n"
        "        d = shape.depth[::100, ::100].astype(float)\n"
        "        v = np.stack([*np.indices(d.shape), d], axis=-1).reshape(-1, 3)\n"
        "        return CanonicalForm(v, np.array([[0, 1, 2]], dtype=np.int32))"
    )
    found = findings(body=body, info="inputs=('view',)")
    assert failed(found) == []
    assert found["relabelling"].explanation == "the form has its own vertices"
    assert found["rigid motion"].explanation == found["scale"].explanation == "the depth image has one camera"
    assert found["awkward shapes"].explanation == (
        "refuses a triangle, a tetrahedron, a flat sheet, two pieces, an open surface, each with a reason"
    )


def test_a_missing_package_is_no_fault(findings):
    found = findings(info="requires=('no_such_package',)", body=FORM + "import no_such_package")
    assert [str(finding) for finding in found.values()] == [
        "skipped  requirements     unavailable: install no_such_package, then check again"
    ]


#: Methods of the paper's tables and one control are tried always, others when asked: each takes some ten seconds.
ALWAYS = tuple(name for name, spec in registry.methods().items() if spec.info.family == "paper")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in ALWAYS else pytest.mark.exhaustive)
        for name in registry.BUILT_IN
    ],
)
def test_every_built_in_method_keeps_the_contract(name):
    report = conformance.check_target(name)
    assert report, f"\n{report}"
