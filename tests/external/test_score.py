"""Twelve shapes on a line, worked by hand: ties, classes of one, queries beside the gallery, several labels."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

import benchmark
from benchmark.errors import ConfigurationError
from benchmark.external.files import as_distances, read_labels
from benchmark.external.records import keep_distances, method_name
from benchmark.external.scoring import Task
from benchmark.pipeline.storage.store import Store
from benchmark.text import is_name
from tests.records import record
from tests.toy import write_rods
from tests.verbs import call

PLACES = {
    "a0": 0,
    "a1": 1,
    "a2": 2,
    "a9": 9,
    "b4": 4,
    "b5": 5,
    "b6": 6,
    "b12": 12,
    "c3": 3,
    "c20": 20,
    "d30": 30,
    "e7": 7,
}
NAMES, LABELS = list(PLACES), [name[0] for name in PLACES]
X = np.array(list(PLACES.values()), dtype=float)
D = np.abs(X[:, None] - X)

#: Measures of queries by hand. Ranks of what is relevant: a0 1 2 8; b5 1 2 9; c3 10; a2 half of 1 and 2, half of 3 and
#: 4, and 8.
LOG = math.log2
BY_HAND = {
    "a0": {
        "NN": 1,
        "FT": 2 / 3,
        "ST": 2 / 3,
        "DCG": (2 + 1 / 3) / (2 + 1 / LOG(3)),
        "E": 3 / 7,
        "mAP": (2 + 3 / 8) / 3,
    },
    "b5": {"NN": 1, "FT": 2 / 3, "ST": 2 / 3, "DCG": (2 + 1 / LOG(9)) / (2 + 1 / LOG(3)), "mAP": (2 + 3 / 9) / 3},
    "c3": {"NN": 0, "FT": 0, "ST": 0, "DCG": 1 / LOG(10), "E": 2 / 12, "mAP": 1 / 10},
    "a2": {"NN": 0.5, "FT": 0.5, "ST": 2 / 3, "DCG": (1 + 0.5 / LOG(3) + 0.25 + 1 / 3) / (2 + 1 / LOG(3)), "E": 3 / 7},
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The matrix in each format with its labels."""
    folder = tmp_path_factory.mktemp("files")
    np.save(folder / "m.npy", D)
    np.savez_compressed(folder / "m.npz", distances=D, other=X)
    savemat(folder / "m.mat", {"D": D, "n": 12.0})
    D.astype("<f4").tofile(folder / "m.matrix")
    np.savetxt(folder / "m.txt", D)
    np.savetxt(folder / "counted.txt", D, header="12", comments="")
    pd.DataFrame(D, NAMES, NAMES).iloc[::-1, ::-1].to_csv(folder / "m.csv")
    order = [[NAMES[i], *(NAMES[k] for k in np.argsort(row, kind="stable") if k != i)] for i, row in enumerate(D)]
    (folder / "ranked.txt").write_text("\n".join(map(" ".join, order)))
    (folder / "labels.txt").write_text("".join(f"{name} {label}\n" for name, label in zip(NAMES, LABELS, strict=True)))
    (folder / "plain.txt").write_text("\n".join(LABELS))
    numbers = {label: [str(k) for k, of in enumerate(LABELS) if of == label] for label in "abcde"}
    classes = "".join(f"{label} 0 {len(n)}\n{' '.join(n)}\n" for label, n in numbers.items())
    (folder / "labels.cla").write_text(f"PSB 1\n5 12\n{classes}")
    return folder


def test_queries_are_scored_as_by_hand():
    found = benchmark.score(pd.DataFrame(D, NAMES, NAMES), dict(zip(NAMES, LABELS, strict=True)))
    for name, measures in BY_HAND.items():
        assert found.queries.loc[name, list(measures)].to_dict() == pytest.approx(measures), name
    assert found.queries.loc[["d30", "e7"], "NN"].isna().all()
    assert found.scores.loc["NN", "score"] == pytest.approx(found.queries["NN"].mean())
    assert found.scores.loc["NN", "chance"] == pytest.approx((8 * 3 / 11 + 2 / 11) / 10)
    assert (found.scores["low"] <= found.scores["score"]).all()
    assert (found.scores["score"] <= found.scores["high"]).all()
    assert any("2 queries have no relevant shape" in note for note in found.notes)


def test_a_query_beside_the_gallery_with_several_labels_is_scored_as_by_hand():
    queries = np.array([2.4, 29.0])
    found = benchmark.score(np.abs(queries[:, None] - X), LABELS, ["a", ["c", "d"]]).queries
    assert found[["NN", "FT", "ST"]].to_numpy() == pytest.approx(np.array([[1, 2 / 4, 3 / 4], [1, 2 / 3, 2 / 3]]))
    assert found["mAP"].tolist() == pytest.approx([(1 + 2 / 3 + 3 / 5 + 4 / 9) / 4, (1 + 1 + 3 / 9) / 3])
    assert found["labels"].tolist() == ["a", "c;d"]


def test_a_query_of_the_gallery_is_not_its_own_result():
    some = pd.DataFrame(D, NAMES, NAMES).loc[["a0", "c3"]]
    found = benchmark.score(some, dict(zip(NAMES, LABELS, strict=True))).queries
    assert found.loc["a0", list(BY_HAND["a0"])].to_dict() == pytest.approx(BY_HAND["a0"])
    assert found.loc["c3", list(BY_HAND["c3"])].to_dict() == pytest.approx(BY_HAND["c3"])


@pytest.mark.parametrize("name", ["m.npy", "m.npz", "m.mat", "m.matrix", "m.txt", "counted.txt"])
@pytest.mark.parametrize("labels", ["labels.txt", "plain.txt", "labels.cla"])
def test_all_formats_give_the_same_row(name, labels, files):
    row = json.loads(call("score", files / name, "--labels", files / labels, "--format", "json"))
    expected = benchmark.score(D, LABELS).scores
    assert {measure: row[measure] for measure in expected.index} == pytest.approx(expected["score"].to_dict(), abs=1e-6)
    assert row["chance_NN"] == pytest.approx(expected.loc["NN", "chance"], abs=1e-6)


def test_names_of_a_csv_find_their_labels_in_any_order(files):
    row = json.loads(call("score", files / "m.csv", "--labels", files / "labels.txt", "--format", "json"))
    assert row["mAP"] == pytest.approx(benchmark.score(D, LABELS).scores.loc["mAP", "score"], abs=1e-6)


def test_ranked_lists_are_scored_without_ties(files):
    args = ("score", files / "ranked.txt", "--ranked", "--labels", files / "labels.txt")
    row = json.loads(call(*args, "--format", "json"))
    ranks = np.argsort(np.argsort(np.where(np.eye(12), -1, D), axis=1, kind="stable"), axis=1)
    assert row["NN"] == pytest.approx(benchmark.score(ranks, LABELS).scores.loc["NN", "score"], abs=1e-6)
    assert not any("ties" in note for note in row["notes"])


def test_what_a_list_omits_ties_behind_the_rest(tmp_path, files):
    (tmp_path / "short.txt").write_text("a0 a1\n")
    row = json.loads(
        call("score", tmp_path / "short.txt", "--ranked", "--labels", files / "labels.txt", "--format", "json")
    )
    assert (row["NN"], row["FT"]) == (1, pytest.approx((1 + 2 * 2 / 10) / 3, abs=1e-6))


def test_formats_of_print(files):
    args = ("score", files / "m.txt", "--labels", files / "plain.txt", "--title", "Mine & yours")
    markdown, latex = call(*args), call(*args, "--format", "latex")
    head = markdown.splitlines()[0]
    assert [cell.strip() for cell in head.strip("|").split("|")][1:] == ["NN", "FT", "ST", "DCG", "E", "nDCG", "mAP"]
    assert "| Chance" in markdown
    assert "| 95 % interval" in markdown
    assert r"Mine \& yours & " in latex
    assert call(*args, "--format", "csv").splitlines()[0].startswith("title,NN,FT,ST,DCG,E,nDCG,mAP,low_NN")


@pytest.mark.parametrize(
    ("distances", "labels", "problem"),
    [
        (np.where(np.eye(12, k=3), np.nan, D), LABELS, "NaN or infinite, the first in row 1, column 4"),
        (D - 3, LABELS, "negative"),
        (1 / (1 + D), LABELS, "farthest from itself"),
        (D[:, :11], LABELS, r"shape \(12, 11\)"),
        (D, LABELS[:11], r"shape \(12, 12\), and the labels are of 11"),
        (D[0], LABELS, "not a matrix"),
        (D.astype(complex), LABELS, "not a matrix"),
        (pd.DataFrame(D, NAMES, NAMES), dict.fromkeys(NAMES[1:], "a"), "the first is 'a0'"),
        (D, [str(k) for k in range(12)], "no class has two members"),
    ],
)
def test_what_is_no_distance_matrix_is_refused(distances, labels, problem):
    with pytest.raises(ConfigurationError, match=problem):
        benchmark.score(distances, labels)


def test_asymmetry_is_stated_and_rows_are_queries():
    skewed = D.copy()
    skewed[0, 1:] = 1 / (1 + D[0, 1:])
    found = benchmark.score(skewed, LABELS)
    assert "not symmetric" in found.notes[0]
    assert found.queries.loc[1, "NN"] == 0  # a0 now finds d30 first
    assert found.queries.loc[5, "mAP"] == pytest.approx(benchmark.score(D, LABELS).queries.loc[5, "mAP"])


def test_similarities_with_a_zero_diagonal_are_below_chance_and_the_note_names_the_cure():
    labels = ["a"] * 6 + ["b"] * 6
    near = np.abs(np.subtract.outer(np.arange(12) + np.repeat([0, 20], 6), np.arange(12) + np.repeat([0, 20], 6)))
    similarities = (near.max() - near) * (1 - np.eye(12))
    assert "subtract them from the largest one" in benchmark.score(similarities, labels).notes[-1]
    for distances, classes in ((near, labels), (D, LABELS)):
        assert not any("similarities" in note for note in benchmark.score(distances, classes).notes)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("m.matrix", b"123", "not 4 N x N"),
        ("m.npy", b"\x93NUMPY\x01\x00v\x00", "cannot be read"),
        ("m.npz", b"PK", "cannot be read"),
        ("m.mat", b"MATLAB 7.3 MAT-file", "cannot be read"),
        ("m.txt", b"1 2\n3\n", "m.txt"),
        ("m.txt", b"", "m.txt"),
        ("m.csv", b"\xff\xfe", "cannot be read"),
    ],
)
def test_damaged_files_are_named(name, content, problem, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigurationError, match=problem) as caught:
        benchmark.score(tmp_path / name, LABELS)
    assert caught.value.hint


def test_pickles_are_not_read(tmp_path):
    np.save(tmp_path / "m.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "m.npz", distances=np.array([[print]], dtype=object))
    for name in ("m.npy", "m.npz"):
        with pytest.raises(ConfigurationError, match="cannot be read"):
            benchmark.score(tmp_path / name, LABELS)


def test_labels_of_a_folder_are_those_of_its_data_set(tmp_path):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    thick = np.array([[0, 1, 3, 3], [1, 0, 3, 3], [3, 3, 0, 1], [3, 3, 1, 0]])
    assert benchmark.score(thick, rods).queries["labels"].to_dict() == {
        "thick0": "thick", "thick1": "thick", "thin0": "thin", "thin1": "thin",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "problem"),
    [("a\nb c\n", "lines of 1 and 2 words"), ("", "empty"), ("x a\nx b\n", "'x' appears twice"), ("x ;\n", "no label")],
)
def test_wrong_labels_are_named(text, problem, tmp_path):
    (tmp_path / "labels.txt").write_text(text)
    with pytest.raises(ConfigurationError, match=problem):
        benchmark.score(D, tmp_path / "labels.txt")


@pytest.fixture
def beside(tmp_path):
    """A results folder with a row of the same shapes, and one of a part of them."""
    results = tmp_path / "results"
    ours = record(
        scores=dict.fromkeys(("NN", "FT", "ST", "DCG"), 0.5), gallery="line",
        shapes=NAMES, labels=LABELS, n_shapes=12, n_classes=5, data={"n_shapes": 12, "n_classes": 5},
    )  # fmt: skip
    part = record(gallery="line held out", data={"name": "line"})
    for one in (ours, part):
        Store.open(results).write_record(one)
    return results


def test_an_external_row_stands_beside_ours_with_significance(beside, files, tmp_path):
    kept = ("--results", beside, "--dataset", "line", "--title", "Theirs")
    call("score", files / "m.txt", "--labels", files / "plain.txt", *kept)
    rows = json.loads(call("tables", "-d", "line", "--results", beside, "--format", "json"))
    theirs = next(row for row in rows if row["method"] == "external-theirs")
    assert {row["method"] for row in rows} == {"classic-mds", "external-theirs"}
    assert theirs["NN"] == pytest.approx(benchmark.score(D, LABELS).scores.loc["NN", "score"], abs=1e-6)
    assert theirs["seconds"] is None
    assert theirs["outdated"] is None
    assert any(row["p_best"]["NN"] is not None for row in rows)
    assert "| Theirs (external) ‡" in call("tables", "-d", "line", "--results", beside)
    assert "Theirs (external)" in call("tables", "-d", "line", "--results", beside, "--format", "latex")
    said = call("compare", "external-theirs", "classic-mds", "--results", beside)
    assert "line mesh: " in said
    call("report", "-d", "line", "--results", beside, "-o", tmp_path / "report")
    assert "Theirs (external)" in (tmp_path / "report" / "index.html").read_text() + "".join(
        path.read_text() for path in (tmp_path / "report").glob("table*.html")
    )


def test_rows_of_other_shapes_are_refused_with_a_name(beside, files, tmp_path):
    (tmp_path / "labels.txt").write_text("".join(f"x{name} {name[0]}\n" for name in NAMES))
    kept = ("--results", beside, "--dataset", "line")
    task = Task.of(as_distances(D), read_labels(tmp_path / "labels.txt"))
    with pytest.raises(ConfigurationError, match="the first that differs is 'xa0'"):
        keep_distances(Store.open(beside), task, "Theirs", "line", "mesh")
    call("score", files / "m.txt", "--labels", files / "labels.txt", *kept)  # those with its names are taken
    with pytest.raises(ConfigurationError, match="no row of 'tosca' is here"):
        keep_distances(Store.open(tmp_path / "empty"), task, "Theirs", "tosca", "mesh")
    keep_distances(Store.open(tmp_path / "empty"), task, "Theirs", "mine", "mesh")
    other = Task.of(as_distances(D), read_labels(files / "labels.txt"))
    with pytest.raises(ConfigurationError, match="or name another --dataset"):
        keep_distances(Store.open(tmp_path / "empty"), other, "Ours", "mine", "mesh")


def test_titles_that_differ_in_signs_alone_have_rows_of_their_own():
    names = [method_name(title) for title in ("A", "A+", "A-", "論文", "他", "x" * 70, "x" * 71, "Our method")]
    assert len(set(names)) == len(names) and all(is_name(name) for name in names)
    assert (names[0], names[-1]) == ("external-a", "external-our-method")
