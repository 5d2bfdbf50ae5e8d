"""The table is made of what the variants left, and the document of the committed figures."""

import json

import numpy as np
import pytest

from tools.portability.document import DOCUMENT, SCORES, absent_methods, compare, document, with_scores

FORM = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 0.5]])


def left_behind(folder, nn, form, normal=FORM):
    folder.mkdir()
    (folder / "scores.json").write_text(json.dumps({"gps mesh": {"nn": nn, "ft": 0.5, "st": 0.5, "dcg": 0.5}}))
    np.savez(folder / "mesh-cat0.npz", **{"gps:form": form, "gps:normal": normal, "gps:faces": np.array([[0, 1, 2]])})
    return folder


def found_in(folders):
    return with_scores(compare(folders), folders)


def test_differences_are_taken_over_all_variants(tmp_path):
    turned = FORM @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + 5
    moved = FORM.copy()
    moved[1, 0] += 1e-3
    folders = {
        "one": left_behind(tmp_path / "one", 0.70, FORM),
        "two": left_behind(tmp_path / "two", 0.70, turned),
        "three": left_behind(tmp_path / "three", 0.75, moved, moved),
    }
    found = found_in(folders)
    (row,) = found["rows"]
    assert row["measures"]["nn"] == [0.70, 0.70, 0.75]
    assert (row["shapes"], row["same"]) == (1, 0)
    assert 1e-4 < row["form_moves"] < 1e-3
    text = document(found)
    assert "| gps | mesh | 0.0500 | 0.0000 | 0.0000 | 0.0000 | 0 of 1 |" in text
    assert "Beyond the goal: gps (mesh)." in text


def test_the_same_bytes_need_no_scores(tmp_path):
    turned = FORM @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + 5
    folders = {
        "one": left_behind(tmp_path / "one", 0.7, FORM),
        "two": left_behind(tmp_path / "two", 0.9, turned),
    }
    found = found_in(folders)
    (row,) = found["rows"]
    assert "measures" not in row
    assert row["same"] == 1
    assert row["form_moves"] < 1e-12
    assert "| gps | mesh | 0.0000 | 0.0000 | 0.0000 | 0.0000 | 1 of 1 |" in document(found)


def test_the_document_is_that_of_the_committed_figures(pytestconfig):
    root = pytestconfig.rootpath
    assert (root / DOCUMENT).read_text() == document(json.loads((root / SCORES).read_text()))


def test_every_method_that_does_not_learn_has_its_rows(pytestconfig):
    from tools.portability._worker import INPUTS, METHODS

    found = json.loads((pytestconfig.rootpath / SCORES).read_text())
    rows, absent = found["rows"], absent_methods(found)
    inputs = [name for name in INPUTS if name in {row["input"] for row in rows}]
    assert inputs
    assert [(row["method"], row["input"]) for row in rows] == [
        (name, i) for name in METHODS if name not in absent for i in inputs
    ]
    told = (pytestconfig.rootpath / DOCUMENT).read_text().rpartition("Not yet measured: ")[2]
    assert not absent or told == f"{', '.join(absent)}.\n"


def test_no_method_moves_a_measure_beyond_the_goal(pytestconfig):
    assert "Beyond the goal" not in (pytestconfig.rootpath / DOCUMENT).read_text()


@pytest.mark.parametrize("other", [None, FORM[:3]])
def test_an_answer_that_is_missing_or_of_other_size_is_infinitely_far(tmp_path, other):
    one, two = (left_behind(tmp_path / name, 0.7, FORM) for name in ("one", "two"))
    np.savez(two / "mesh-cat0.npz", **({} if other is None else {"gps:form": other, "gps:normal": other}))
    (row,) = compare({"one": one, "two": two})
    assert row["form_moves"] == float("inf")
    assert row["same"] == 0
