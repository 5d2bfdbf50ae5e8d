"""``rekey`` through the command line: a copy of the suite with results of its own, one edit at a time."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.jobs.rekey.sampling import sample_of
from benchmark.system.fingerprints import FIRST_PARTY
from tests.jobs.rekey.copies import Copy

ROOT = Path(__file__).parents[3]
CHOSEN = ("-m", "classic-mds", "-m", "identity", "--input", "mesh")
BENDS = (0.0, 1.2)


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return Copy(tmp_path_factory.mktemp("rekey"), BENDS, CHOSEN)


@pytest.fixture
def copy(original, tmp_path):
    """The copy as it was, beside it what an edit brings about."""
    kept = tmp_path / "kept"
    shutil.copytree(original.results, kept)
    yield original
    original.git("reset", "-q", "--hard", "first")
    original.git("clean", "-q", "-fd")
    shutil.rmtree(original.results)
    shutil.copytree(kept, original.results)


ORIENTATION = "baselines/_kernels/orientation.py"

AREAS = """def vertex_areas(mesh: Mesh) -> FloatArray:
    \"\"\"Return the barycentric area of each vertex, a third of its triangles, shape (n,), in squared mesh units.\"\"\"
    shares = np.repeat(mesh.face_areas / 3, 3)
    return np.asarray(np.bincount(mesh.faces.ravel(), shares, mesh.n_vertices), dtype=np.float64)
"""
CHOICE = "    negligible = np.abs(moments) <= NEGLIGIBLE * (weights @ np.abs(centred) ** 3)\n"
SPLIT = """def _negligible(moments: FloatArray, weights: FloatArray, centred: FloatArray) -> FloatArray:
    return np.abs(moments) <= NEGLIGIBLE * (weights @ np.abs(centred) ** 3)


def canonical_signs("""
TIES = "baselines/_kernels/ties.py"

SAME = {
    "a local": [(ORIENTATION, "extremes", "farthest_out")],
    "a parameter": [(ORIENTATION, "eigenvalues", "spectrum")],
    "an annotation": [("benchmark/geometry/mesh.py", "def area(self) -> float:", "def area(self) -> 'float':")],
    "the text of an error": [("benchmark/geometry/io.py", "faces name vertices", "triangles name vertices")],
    "a function that is split": [
        (ORIENTATION, CHOICE, "    negligible = _negligible(moments, weights, centred)\n"),
        (ORIENTATION, "def canonical_signs(", SPLIT),
    ],
    "a function that is moved": [
        (ORIENTATION, AREAS, ""),
        (ORIENTATION, "ties import largest\n", "ties import largest, vertex_areas\n"),
        (TIES, "from benchmark.api.contracts import FloatArray\n",
         "from benchmark.api.contracts import FloatArray\nfrom benchmark.geometry.mesh import Mesh\n"),
        (TIES, "def largest(", f"{AREAS}\n\ndef largest("),
    ],
}  # fmt: skip

DIFFERENT = {
    "a constant in a kernel": ([("benchmark/geometry/geodesics.py", "0.5 * (matrix", "0.51 * (matrix")], "differs"),
    "an operator two calls away": ([(ORIENTATION, "weights @ centred**3", "weights @ centred**2")], "differs"),
    "a default of a parameter": (
        [("baselines/classic_mds.py", 'metric: Metric = "geodesic"', 'metric: Metric = "biharmonic"')],
        "more than code changed: parameters changed: metric geodesic -> biharmonic",
    ),
    "a tolerance that only matters for refused shapes": (
        [("benchmark/geometry/cleaning.py", "_EXTENTS = (1e-100,", "_EXTENTS = (1e-102,")],
        "differs",
    ),
    "a number of vertices": ([("benchmark/jobs/stages/complete.py", "= 2000", "= 150")], "differs"),
}  # fmt: skip


def replaced_everywhere(copy, before, after):
    return [
        (str(path.relative_to(copy.root)), before, after)
        for package in FIRST_PARTY
        for path in (copy.root / package).rglob("*.py")
        if before in path.read_text()
    ]


@pytest.mark.slow
def test_a_function_that_is_renamed_with_its_callers_moves_all_rows(copy):
    everywhere = replaced_everywhere(copy, "canonical_signs", "settled_signs")
    before = {record["key"]: record for record in copy.records()}
    code, said = copy.edited(*everywhere)
    assert code == 0, said
    assert "1 rows moved, 0 stay, 1 have the keys of this code" in said
    assert copy.planned() == "0 of 2 jobs to run"
    (moved,) = [record for record in copy.records() if record["key"] not in before]
    (note,) = moved["rekeyed"]
    assert note["last_stage"] == "form" and {"thin9", "thick9"} <= set(note["shapes"]) and len(note["shapes"]) == 5
    old = next(record for record in before.values() if record["method"] == moved["method"])
    kept = {name: part for name, part in moved.items() if name not in ("key", "recipe", "rekeyed", "artefacts")}
    assert kept == {name: part for name, part in old.items() if name in kept}
    # The arrays came along: forms are found under the new keys.
    assert all((copy.results / "runs/artefacts" / key[:2] / f"{key}.npz").is_file() for key in moved["artefacts"])
    assert "rekeyed" in copy.run("why", moved["key"])[1]
    assert "1 have the keys" not in copy.run("rekey", "--from", "HEAD")[1]


@pytest.mark.slow
def test_what_no_sample_reaches_is_told_by_name_and_its_rows_stay(copy):
    refusal = "        raise UnsupportedShape("
    code, said = copy.edited(("baselines/_kernels/checks.py", refusal, f"        number = 1\n{refusal}"))
    assert code == 1
    assert "not run by any sample: baselines._kernels.checks." in said
    assert "0 rows moved, 1 stay, 1 have the keys of this code" in said
    assert copy.planned() == "1 of 2 jobs to run"


@pytest.mark.slow
def test_one_difference_refuses_the_rows_that_it_concerns_and_no_others(copy):
    code, said = copy.edited((ORIENTATION, "< 0, -1.0, 1.0", "< 0, 1.0, -1.0"))
    assert code == 1, said
    assert "rods mesh classic-mds: form of" in said and "'vertices' by up to" in said
    assert "0 rows moved, 1 stay, 1 have the keys of this code" in said


@pytest.mark.exhaustive
@pytest.mark.parametrize("edits", SAME.values(), ids=SAME)
def test_edits_that_change_no_digit_move_all_rows(copy, edits):
    code, said = copy.edited(*edits)
    assert code == 0, said
    assert copy.planned() == "0 of 2 jobs to run"


@pytest.mark.exhaustive
def test_a_module_that_is_renamed_moves_all_rows(copy):
    (copy.root / TIES).rename(copy.root / "baselines/_kernels/equals.py")
    code, said = copy.edited(*replaced_everywhere(copy, "_kernels.ties", "_kernels.equals"))
    assert code == 0, said
    assert copy.planned() == "0 of 2 jobs to run"


@pytest.mark.exhaustive
@pytest.mark.parametrize(("edits", "expected"), DIFFERENT.values(), ids=DIFFERENT)
def test_edits_that_change_a_digit_are_refused(copy, edits, expected):
    code, said = copy.edited(*edits)
    assert code == 1, said
    assert expected in said


def test_a_sample_has_a_pair_further_classes_and_what_was_refused():
    record = {
        "shapes": ["a0", "a1", "a2", "b0", "b1", "c0", "c1"],
        "labels": ["a", "a", "a", "b", "b", "c", "c"],
        "unsupported": [["b9", "why"], ["c8", "why"], ["c9", "why"]],
    }
    assert sample_of(record, 3) == ("a0", "a2", "c0", "b9", "c9")
    assert sample_of(record, 4) == ("a0", "a2", "c0", "b1", "b9", "c9")
    assert sample_of(record, 6)[:6] == ("a0", "a2", "c0", "b1", "a1", "b0")
    alone = {"shapes": ["a0", "b0"], "labels": ["a", "b"], "unsupported": []}
    assert set(sample_of(alone, 3)) == {"a0", "b0"}


def test_a_commit_that_is_none_is_refused(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "benchmark", "rekey", "--from", "no-such-commit", "--results", str(tmp_path)],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 2
    assert "holds no record with scores" in done.stderr
