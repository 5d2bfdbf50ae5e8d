"""Twelve shapes on a line, worked by hand: ties, classes of one, files in each format."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from benchmark.errors import ConfigurationError
from benchmark.scoring.evaluation import score
from tests.scoring.line import LABELS, NAMES, D, X
from tests.toy import write_rods

#: Measures of queries by hand. Ranks of what is relevant: a0 1 2 8; b5 1 2 9; c3 10; a2 half of 1 and 2, half of 3 and
#: 4, and 8.
LOG = math.log2
BY_HAND = {
    "a0": {"NN": 1, "FT": 2 / 3, "ST": 2 / 3, "DCG": (2 + 1 / 3) / (2 + 1 / LOG(3)), "mAP": (2 + 3 / 8) / 3},
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
    np.savetxt(folder / "m.txt", D)
    np.savetxt(folder / "m.csv", D, delimiter=",")
    pd.DataFrame(D, NAMES, NAMES).iloc[::-1, :].to_csv(folder / "named.csv")
    (folder / "labels.txt").write_text("".join(f"{name} {label}\n" for name, label in zip(NAMES, LABELS, strict=True)))
    (folder / "plain.txt").write_text("\n".join(LABELS))
    numbers = {label: [str(k) for k, of in enumerate(LABELS) if of == label] for label in "abcde"}
    classes = "".join(f"{label} 0 {len(n)}\n{' '.join(n)}\n" for label, n in numbers.items())
    (folder / "labels.cla").write_text(f"PSB 1\n5 12\n{classes}")
    return folder


def test_queries_are_scored_as_by_hand():
    found = score(pd.DataFrame(D, NAMES, NAMES), dict(zip(NAMES, LABELS, strict=True)))
    for name, measures in BY_HAND.items():
        assert found.queries.loc[name, list(measures)].to_dict() == pytest.approx(measures), name
    assert found.queries.loc[["d30", "e7"], "NN"].isna().all()
    assert found.scores.loc["NN", "score"] == pytest.approx(found.queries["NN"].mean())
    assert found.scores.loc["NN", "chance"] == pytest.approx((8 * 3 / 11 + 2 / 11) / 10)
    assert (found.scores["low"] <= found.scores["score"]).all()
    assert (found.scores["score"] <= found.scores["high"]).all()


@pytest.mark.parametrize("name", ["m.npy", "m.npz", "m.mat", "m.txt", "m.csv"])
@pytest.mark.parametrize("labels", ["labels.txt", "plain.txt", "labels.cla"])
def test_all_formats_give_the_same_scores(name, labels, files):
    found = score(files / name, files / labels)
    np.testing.assert_allclose(found.scores["score"], score(D, LABELS).scores["score"])
    assert list(found.queries["class"]) == LABELS


def test_names_of_a_csv_find_their_labels_and_columns_in_any_order(files):
    found = score(files / "named.csv", files / "labels.txt").queries
    assert list(found.index) == NAMES[::-1]
    assert found.loc["a0", list(BY_HAND["a0"])].to_dict() == pytest.approx(BY_HAND["a0"])


def test_labels_of_a_folder_are_those_of_its_data_set(tmp_path):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    matrix = np.array([[0, 1, 3, 3], [1, 0, 3, 3], [3, 3, 0, 1], [3, 3, 1, 0]])
    expected = {"thick0": "thick", "thick1": "thick", "thin0": "thin", "thin1": "thin"}
    assert score(matrix, rods).queries["class"].to_dict() == expected


@pytest.mark.parametrize(
    ("distances", "labels", "problem"),
    [
        (np.where(np.eye(12, k=3), np.nan, D), LABELS, "NaN or infinite, the first in row 1, column 4"),
        (D - 3, LABELS, "negative"),
        (1 / (1 + D), LABELS, "farthest from itself"),
        (D[:, :11], LABELS, r"shape \(12, 11\), float64, is no N x N matrix"),
        (D, LABELS[:11], "there are 12 rows of distances and 11 labels"),
        (D.astype(complex), LABELS, "is no N x N matrix"),
        (np.triu(D), LABELS, "not symmetric .*; average them with the transpose"),
        (pd.DataFrame(D, NAMES, NAMES), dict.fromkeys(NAMES[1:], "a"), "1 shapes have no label, the first is 'a0'"),
        (pd.DataFrame(D, NAMES, [*NAMES[::-1][:11], "x"]), LABELS, "rows and columns .* have different names"),
        (D, [str(k) for k in range(12)], "no class has two members"),
    ],
)
def test_what_is_no_distance_matrix_is_refused(distances, labels, problem):
    with pytest.raises(ConfigurationError, match=problem):
        score(distances, labels)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("m.npy", b"\x93NUMPY\x01\x00v\x00", "cannot be read"),
        ("m.npz", b"PK", "cannot be read"),
        ("m.mat", b"MATLAB 7.3 MAT-file", "cannot be read"),
        ("m.txt", b"1 2\n3\n", "m.txt cannot be read"),
        ("m.txt", b"", "m.txt is empty"),
        ("m.csv", b"\xff\xfe", "m.csv cannot be read"),
    ],
)
def test_damaged_files_are_named(name, content, problem, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigurationError, match=problem) as caught:
        score(tmp_path / name, LABELS)
    assert caught.value.hint


def test_pickles_are_not_read(tmp_path):
    np.save(tmp_path / "m.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "m.npz", distances=np.array([[print]], dtype=object))
    for name in ("m.npy", "m.npz"):
        with pytest.raises(ConfigurationError, match="cannot be read"):
            score(tmp_path / name, LABELS)


@pytest.mark.parametrize(
    ("text", "problem"), [("a\nb c\n", "lines of 1 and 2 words"), ("", "empty"), ("x a\nx b\n", "names a shape twice")]
)
def test_wrong_labels_are_named(text, problem, tmp_path):
    (tmp_path / "labels.txt").write_text(text)
    with pytest.raises(ConfigurationError, match=problem):
        score(D, tmp_path / "labels.txt")
