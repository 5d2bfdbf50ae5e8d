"""Twelve shapes on a line, worked by hand: ties, classes of one, files in each format."""

import json
import math
import unicodedata
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from benchmark.commands.score import score
from benchmark.datasets.folder import folder_set
from benchmark.errors import ConfigurationError
from benchmark.protocols.tables import TABLE_MEASURES
from tests.scoring.line import LABELS, NAMES, D, X
from tests.toy import rod, write_off
from tests.verbs import call, refusal

#: Measures of queries by hand. Ranks of what is relevant: a0 1 2 8; a2 half of 1 and 2, half of 3
#: and 4, and 8.
LOG = math.log2
BY_HAND = {
    "a0": {
        "NN": 1,
        "FT": 2 / 3,
        "ST": 2 / 3,
        "DCG": (2 + 1 / 3) / (2 + 1 / LOG(3)),
        "mAP": (2 + 3 / 8) / 3,
    },
    "a2": {
        "NN": 0.5,
        "FT": 0.5,
        "ST": 2 / 3,
        "DCG": (1 + 0.5 / LOG(3) + 0.25 + 1 / 3) / (2 + 1 / LOG(3)),
        "E": 3 / 7,
    },
}


NO_INTERVALS = "no intervals: the queries are of {} classes, fewer than 8"


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
    (folder / "labels.txt").write_text(
        "".join(f"{name} {label}\n" for name, label in zip(NAMES, LABELS, strict=True))
    )
    (folder / "labels.csv").write_text(
        (folder / "labels.txt").read_text().replace(" ", ";"), encoding="utf-8-sig"
    )
    (folder / "plain.txt").write_text("\n".join(LABELS))
    numbers = {label: [str(k) for k, of in enumerate(LABELS) if of == label] for label in "abcde"}
    classes = "".join(f"{label} 0 {len(n)}\n{' '.join(n)}\n" for label, n in numbers.items())
    (folder / "labels.cla").write_text(f"PSB 1\n5 12\n{classes}", encoding="utf-8-sig")
    return folder


def test_queries_are_scored_as_by_hand():
    found = score(pd.DataFrame(D, NAMES, NAMES), dict(zip(NAMES, LABELS, strict=True)))
    for name, measures in BY_HAND.items():
        assert found.queries.loc[name, list(measures)].to_dict() == pytest.approx(measures), name
    assert found.queries.loc[["d30", "e7"], "NN"].isna().all()
    assert found.scores.loc["NN", "score"] == pytest.approx(found.queries["NN"].mean())
    assert found.scores.loc["NN", "chance"] == pytest.approx((8 * 3 / 11 + 2 / 11) / 10)


@pytest.mark.parametrize("n_classes", [7, 8])
def test_scores_of_fewer_than_eight_classes_have_no_interval_and_say_so(n_classes, tmp_path):
    labels = [f"class {k % n_classes}" for k in range(4 * n_classes)] + ["alone"]
    x = np.random.default_rng(2).random(len(labels))
    np.savetxt(tmp_path / "D.txt", distances := np.abs(x[:, None] - x))
    (tmp_path / "labels.txt").write_text("\n".join(f'"{label}"' for label in labels))
    found = score(distances, labels)
    ends = found.scores[["low", "high"]].to_numpy()
    shown = call("score", tmp_path / "D.txt", "--labels", tmp_path / "labels.txt")
    content = call(
        "score", tmp_path / "D.txt", "--labels", tmp_path / "labels.txt", "--format", "json"
    )
    low = json.loads(content[content.index("{") :])["NN"]["low"]
    if n_classes < 8:
        assert np.isnan(ends).all()
        assert NO_INTERVALS.format(7) in found.notes
        assert NO_INTERVALS.format(7) in shown
        assert "--" in shown
        assert low is None
    else:
        assert (ends[:, 0] <= found.scores["score"]).all()
        assert (found.scores["score"] <= ends[:, 1]).all()
        assert not any("no intervals" in note for note in found.notes)
        assert low == pytest.approx(ends[0, 0], abs=1e-6)


@pytest.mark.parametrize("name", ["m.npy", "m.npz", "m.mat", "m.txt", "m.csv"])
@pytest.mark.parametrize("labels", ["labels.txt", "labels.csv", "plain.txt", "labels.cla"])
def test_all_formats_give_the_same_scores(name, labels, files):
    found = score(files / name, files / labels)
    np.testing.assert_allclose(found.scores["score"], score(D, LABELS).scores["score"])
    assert list(found.queries["class"]) == LABELS


def test_names_of_a_csv_find_their_labels_and_columns_in_any_order(files):
    found = score(files / "named.csv", files / "labels.txt").queries
    assert list(found.index) == NAMES[::-1]
    assert found.loc["a0", list(BY_HAND["a0"])].to_dict() == pytest.approx(BY_HAND["a0"])


SMALL = np.array([[0, 1, 4, 3], [1, 0, 5, 2], [4, 5, 0, 1], [3, 2, 1, 0]])
KEYS = ("7", "5", "6", "12")
OWN = dict(zip(KEYS, ("cat", "cat", "dog", "dog"), strict=True))
PLAIN = "0,1,4,3\n1,0,5,2\n4,5,0,1\n3,2,1,0\n"


@pytest.mark.parametrize(
    "path", sorted(Path(__file__).with_name("inputs").iterdir()), ids=lambda path: path.stem
)
def test_names_that_are_numbers_are_found_in_any_text(path):
    found = score(path, OWN)
    assert list(found.queries.index) == list(KEYS)
    assert found.scores.loc["FT", "score"] == 1


@pytest.mark.parametrize("cell", ["", "None", "inf", "nan", "-3", "-1e-7", "99", "x"])
def test_the_diagonal_is_ignored(cell, tmp_path):
    (tmp_path / "m.csv").write_text(PLAIN.replace("0", cell))
    found = score(tmp_path / "m.csv", list(OWN.values()))
    np.testing.assert_array_equal(found.distances, SMALL)
    holed = np.array(SMALL, dtype=object)
    np.fill_diagonal(holed, None if cell in ("", "None", "x") else float(cell))
    for given in (holed, holed.tolist(), pd.DataFrame(holed), np.ma.masked_array(SMALL, np.eye(4))):
        assert score(given, list(OWN.values())).scores.equals(found.scores)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("0;1,234;999\n1,234;0;5\n999;5;0", "commas may be decimal or divide thousands"),
        ("0;1,5;9.5\n1,5;0;5\n9.5;5;0", "commas may be decimal or divide thousands"),
        (PLAIN.encode("utf-16-le"), "binary, or in UTF-16 without a byte-order mark"),
        (PLAIN[:-5], "row 4 has length 2, not 4"),
        (PLAIN[:-8], "the distances name their shapes, and the labels do not"),  # as four names
    ],
)
def test_text_that_may_mean_two_things_is_refused(text, problem, tmp_path):
    (tmp_path / "m.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigurationError, match=problem):
        score(tmp_path / "m.csv", ["a"] * len(text.splitlines()))


def test_rows_without_names_have_the_order_that_all_agree_on_or_that_is_named(tmp_path):
    psb = "PSB 1\n2 4\n\ndog 0 2\n3\n2\n\ncat 0 2\n0\n1\n"
    (tmp_path / "c.cla").write_text(psb)
    by_list = SMALL[np.ix_([3, 2, 0, 1], [3, 2, 0, 1])]
    by_list.astype("<f4").tofile(tmp_path / "m.matrix")
    pd.DataFrame(SMALL).to_csv(tmp_path / "row-numbers.csv")
    for given in (SMALL, tmp_path / "row-numbers.csv"):
        with pytest.raises(
            ConfigurationError,
            match="from row 1: list: 3, 2, 0; number: 0, 1, 2; pass --order list",
        ):
            score(given, tmp_path / "c.cla")
        labels = {"3": "a", "0": "a", "1": "b", "2": "b"}
        with pytest.raises(
            ConfigurationError, match="list: 3, 0, 1; number: 0, 1, 2; pass --order list or number"
        ):
            score(given, labels)
        assert list(score(given, labels, order="list").queries.index) == list("3012")
        assert score(given, tmp_path / "c.cla", order="number").scores.loc["FT", "score"] == 1
    for found in (
        score(by_list, tmp_path / "c.cla", "list"),
        score(tmp_path / "m.matrix", tmp_path / "c.cla"),
    ):
        assert found.queries["class"].to_dict() == {"3": "dog", "2": "dog", "0": "cat", "1": "cat"}
        assert found.scores.loc["FT", "score"] == 1
    assert list(score(pd.DataFrame(SMALL, range(1, 5), range(1, 5)), OWN).queries.index) == list(
        KEYS
    )
    shuffled = pd.DataFrame(by_list, [3, 2, 0, 1], [3, 2, 0, 1])
    assert score(shuffled, pd.Series(["cat", "cat", "dog", "dog"])).scores.loc["FT", "score"] == 1
    for labels, order in ((tmp_path / "c.cla", "natural"), (list("aabb"), "list")):
        with pytest.raises(
            ConfigurationError, match="order .*'(natural|list)'; (choose one of list, number|omit)"
        ):
            score(SMALL, labels, order)
    for name in ("cat1", "cat2", "cat10", "dog1"):
        (tmp_path / f"{name}.off").touch()
    (tmp_path / "meshes").mkdir()
    for number in range(4):
        (tmp_path / "meshes" / f"m{number}.off").touch()
    (tmp_path / "meshes" / "c.cla").write_text(psb)
    assert list(score(tmp_path / "m.matrix", tmp_path / "meshes").queries.index) == [
        "m3",
        "m2",
        "m0",
        "m1",
    ]
    (tmp_path / "c.cla").unlink()
    said = (
        "row 2: listing: cat10, cat2, dog1; natural: cat2, cat10, dog1; "
        "pass --order listing or natural"
    )
    assert said in refusal("score", tmp_path / "m.matrix", "--labels", tmp_path)
    called = call("score", tmp_path / "m.matrix", "--labels", tmp_path, "--order", "listing")
    assert called.startswith("ranked, but no queries: 1 of 4 shapes")
    classes = score(SMALL, tmp_path, "listing").queries["class"].to_dict()
    assert [*classes.items()] == [
        ("cat1", "cat"),
        ("cat10", "cat"),
        ("cat2", "cat"),
        ("dog1", "dog"),
    ]


def test_shapes_of_class_minus_one_are_ranked_and_no_queries(tmp_path):
    (tmp_path / "c.cla").write_text(
        "PSB 1\n3 6\n\ncat 0 2\n0\n1\n\ndog 0 2\n2\n3\n\n-1 0 2\n4\n5\n"
    )
    x = np.array([0, 0.1, 5, 5.1, 10, 20])
    found = score(np.abs(x[:, None] - x), tmp_path / "c.cla")
    assert found.scores.loc["NN", "score"] == 1
    assert found.queries["NN"].notna().sum() == 4
    assert found.notes == (
        "ranked, but no queries: 2 of 6 shapes (alone in their class, or of class -1)",
        NO_INTERVALS.format(2),
    )
    for number in range(6):
        write_off(tmp_path / f"m{number}.off", rod(0.1, 0.1 * number))
    classes = [entry.subject for entry in folder_set(tmp_path).shapes]
    assert classes[:4] == ["cat", "cat", "dog", "dog"]
    assert len({*classes}) == 4
    assert "ranked, but no queries: 2 of 6 shapes" in call("data", "check", tmp_path)


HERE = Path(__file__).parent / "labels"


@pytest.mark.parametrize(
    "labels",
    [
        HERE / "minus-one.txt",
        [*"aaabbbccc", -1, -1.0, "-1.000e+00"],
        dict(enumerate([*"aaabbbccc", *[-1] * 3])),
    ],
)
def test_class_minus_one_is_no_query_wherever_labels_come_from(labels, tmp_path):
    found = score(HERE / "D.txt", labels, "list" if isinstance(labels, dict) else "")
    assert (found.scores.loc["NN", "score"], found.queries["NN"].notna().sum()) == (1, 9)
    beside = score(
        np.loadtxt(HERE / "D.txt") + 1,
        labels,
        "list" if isinstance(labels, dict) else "",
        gallery=labels,
    )
    assert beside.queries["NN"].notna().sum() == 9
    for number in range(3):
        write_off(tmp_path / "-1" / f"m{number}.off", rod(0.1, 0.1 * number))
    assert len({entry.subject for entry in folder_set(tmp_path).shapes}) == 3


@pytest.mark.parametrize("missing", [None, math.nan, pd.NA, "", " ", "NaN", "?", "--"])
def test_shapes_without_a_label_are_counted_and_the_first_is_named(missing, tmp_path):
    labels = [*LABELS[:9], *[missing] * 3]
    with pytest.raises(
        ConfigurationError, match="shapes without a label: 3, the first is 'row 10'"
    ):
        score(D, labels)
    with pytest.raises(
        ConfigurationError, match=f"shapes without a label: 3, the first is '{NAMES[9]}'"
    ):
        score(pd.DataFrame(D, NAMES, NAMES), pd.Series(labels, NAMES))
    if str(missing).strip():
        (tmp_path / "labels.csv").write_text(
            "".join(f"{a},{b}\n" for a, b in zip(NAMES, labels, strict=True))
        )
        with pytest.raises(ConfigurationError, match="shapes without a label: 3"):
            score(D, tmp_path / "labels.csv")


def test_one_class_is_refused_and_numbers_are_one_class_however_they_are_written():
    for gallery in (None, ["a"] * 12):
        with pytest.raises(
            ConfigurationError, match="there is one class .'a'., so every ranking is perfect"
        ):
            score(D, ["a"] * 12, gallery=gallery)
    mixed = score(
        HERE / "D.txt", [1, 1.0, "1", 20, "20.0", "2.000e+01", 3, 3, np.float64(3), 7, 7.5, "08"]
    )
    assert (mixed.scores.loc["NN", "score"], mixed.queries["NN"].notna().sum()) == (1, 9)


def test_distances_with_names_need_labels_with_names_or_an_order():
    frame = pd.DataFrame(D, NAMES, NAMES)
    with pytest.raises(
        ConfigurationError, match="the distances name their shapes, .* --order list"
    ):
        score(frame, LABELS)
    assert score(frame, LABELS, "list").scores.equals(score(D, LABELS).scores)


def test_queries_that_are_in_the_gallery_are_noted():
    frame, labels = pd.DataFrame(D, NAMES, NAMES), dict(zip(NAMES, LABELS, strict=True))
    assert any(
        "12 queries are at distance 0" in note
        for note in score(frame, labels, gallery=labels).notes
    )
    assert not any("distance 0" in note for note in score(frame + 1, labels, gallery=labels).notes)


def test_a_gallery_of_one_shape_is_refused_and_measures_of_two_results_are_those_that_differ():
    with pytest.raises(ConfigurationError, match="the gallery holds one shape"):
        score([[1.0], [2.0]], ["a", "b"], gallery=["a"])
    table = score([[0, 1, 2], [1, 0, 2], [2, 2, 0]], ["a", "a", "b"]).scores
    assert list(table.index) == ["NN", "FT", "nDCG", "mAP"]


def test_e_is_left_out_where_no_distance_moves_it():
    assert "E" not in score(D, LABELS).scores.index
    x = np.arange(34.0) ** 2
    assert "E" in score(np.abs(x[:, None] - x), ["a"] * 17 + ["b"] * 17).scores.index
    assert "E" not in score(np.abs(x[:33, None] - x[:33]), ["a"] * 17 + ["b"] * 16).scores.index


def test_a_row_of_latex_is_escaped_and_has_the_measures_of_the_tables(tmp_path):
    np.savetxt(path := tmp_path / "cm_bof_50%_run#2.txt", D)
    (tmp_path / "l.txt").write_text("\n".join(LABELS))
    found = score(D, LABELS).scores.score
    numbers = " & ".join(f"{found[name]:.2f}"[1:] for name in TABLE_MEASURES)
    out = call("score", path, "--labels", tmp_path / "l.txt", "--format", "latex").splitlines()
    assert out[-2:] == [
        f"% {' '.join(TABLE_MEASURES)}",
        rf"cm\_\allowbreak{{}}bof\_\allowbreak{{}}50\%\_\allowbreak{{}}run\#2 & {numbers} \\",
    ]


def test_similarities_are_refused_or_warned_of():
    with pytest.warns(
        UserWarning, match="the nearest are of other classes more often than by chance"
    ):
        found = score(np.where(np.eye(4), 0, 6 - SMALL), list(OWN.values()))
    assert found.scores.loc["NN", "score"] == 0
    with pytest.raises(ConfigurationError, match="set the diagonal of distances to 0"):
        score(6 - SMALL, list(OWN.values()))
    with pytest.warns(UserWarning, match="the nearest are of other classes"):
        score(np.where(np.eye(4), np.inf, 6 - SMALL), list(OWN.values()))
    x = np.array([0, 0.1, 5, 10, 5.1, 10.1])
    assert score(np.abs(x[:, None] - x), list("aabbcc")).notes == (NO_INTERVALS.format(3),)
    assert score(np.ones((4, 4)), list("aabb")).notes == (NO_INTERVALS.format(2),)


@pytest.mark.parametrize("kind", ["int8", "uint16", "int32", "single", "double"])
def test_a_mat_file_holds_one_full_matrix_of_any_numbers(kind, tmp_path):
    savemat(tmp_path / "m.mat", {"D": SMALL.astype(kind), "labels": np.arange(4)})
    assert score(tmp_path / "m.mat", list(OWN.values())).scores.loc["FT", "score"] == 1
    savemat(
        tmp_path / "m.mat", {"D": SMALL.astype(kind), "distances": csc_matrix(SMALL), "E": SMALL}
    )
    with pytest.raises(ConfigurationError, match="2 full matrices of real numbers: D, E"):
        score(tmp_path / "m.mat", list(OWN.values()))


@pytest.mark.parametrize("name", ["m.npz", "m.mat"])
def test_names_in_a_file_of_arrays_find_their_labels(name, tmp_path):
    order, path = [2, 0, 3, 1], tmp_path / name
    content = {
        "D": SMALL[np.ix_(order, order)],
        "kind": np.array([*"aabb"]),
        "names": np.array([KEYS[k] for k in order], dtype="U" if name == "m.mat" else "S"),
    }
    savemat(path, content) if name == "m.mat" else np.savez(path, **content)
    found = score(path, OWN)
    assert (list(found.queries.index), found.scores.loc["FT", "score"]) == (
        [KEYS[k] for k in order],
        1,
    )


def test_damage_is_found(files, tmp_path):
    D.astype("<f4").tofile(files / "m.matrix")
    for name in ("m.npy", "m.npz", "m.mat", "m.matrix"):
        content = (files / name).read_bytes()
        for end in (
            *range(0, len(content), len(content) // 30),
            *range(len(content) - 20, len(content)),
        ):
            (tmp_path / name).write_bytes(content[:end])
            with pytest.raises(ConfigurationError):
                score(tmp_path / name, LABELS)
    (tmp_path / "m.npy").write_bytes((files / "m.npy").read_bytes() * 2)  # as numpy.save appends
    with pytest.raises(ConfigurationError, match="bytes follow"):
        score(tmp_path / "m.npy", LABELS)
    D.astype(">f4").tofile(tmp_path / "m.matrix")
    with pytest.raises(ConfigurationError, match="write it with the lowest byte first"):
        score(tmp_path / "m.matrix", LABELS)


@pytest.mark.parametrize(
    ("distances", "labels", "problem"),
    [
        (
            np.where(np.eye(12, k=3), np.nan, D),
            LABELS,
            "NaN or infinite, the first in row 1, column 4",
        ),
        (D - 3, LABELS, "negative"),
        (1 / (1 + D), LABELS, "farthest from itself"),
        (D[:, :11], LABELS, r"shape \(12, 11\), float64, is no N x N matrix"),
        (D, LABELS[:11], "there are 12 rows of distances and 11 labels"),
        (D.astype(complex), LABELS, "is no N x N matrix"),
        (np.triu(D), LABELS, "not symmetric .*; average them with the transpose"),
        (
            pd.DataFrame(D, NAMES, NAMES),
            dict.fromkeys(NAMES[1:], "a"),
            "shapes without a label: 1, the first is 'a0'",
        ),
        (
            pd.DataFrame(D, NAMES, [*NAMES[::-1][:11], "x"]),
            LABELS,
            "rows and columns .* have different names",
        ),
        (D, [f"x{k}" for k in range(12)], "no class has two members"),
    ],
)
def test_what_is_no_distance_matrix_is_refused(distances, labels, problem):
    with pytest.raises(ConfigurationError, match=problem):
        score(distances, labels)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("m.npy", b"\x93NUMPY\x01\x00v\x00", "not a readable matrix of distances"),
        ("m.npz", b"PK", "not a readable matrix of distances"),
        ("m.mat", b"MATLAB 7.3 MAT-file", "m.mat: it is an HDF5 file"),
        ("m.txt", b"1 2\n3\n", "m.txt: row 2 has length 1, not 2"),
        ("m.txt", b"", "m.txt: it is empty"),
        ("m.txt", b"0 1_0\n1_0 0\n", "not a matrix of numbers.*1_0"),
        ("m.txt", "0 \u0661\n1 0\n".encode(), "not a matrix of numbers"),
        ("m.csv", b"\xff\xfe", "m.csv: it is empty"),
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
        with pytest.raises(ConfigurationError, match="it holds objects of Python") as caught:
            score(tmp_path / name, LABELS)
        assert "allow_pickle" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_the_first_bytes_say_whether_a_file_is_an_array_or_an_archive(suffix, tmp_path):
    path = tmp_path / f"m{suffix}"
    for save in (np.save, np.savez):
        with path.open("wb") as file:
            save(file, D)
        assert score(path, LABELS).scores.equals(score(D, LABELS).scores)
    for content in (b"\x89PNG", b"0 1\n1 0\n", b"\x80\x04N."):
        path.write_bytes(content)
        with pytest.raises(ConfigurationError, match=r"it is no array of NumPy") as caught:
            score(path, LABELS)
        assert "allow_pickle" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a\nb c\n", "lines of 1 and 2 words"),
        ("", "empty"),
        ("x a\nx b\n", "names a shape twice"),
        ('"x\ny\n', "end of data"),
    ],
)
def test_wrong_labels_are_named(text, problem, tmp_path):
    (tmp_path / "labels.txt").write_text(text)
    with pytest.raises(ConfigurationError, match=problem):
        score(D, tmp_path / "labels.txt")


def test_a_rectangular_matrix_has_rows_of_queries(tmp_path):
    matrix = pd.DataFrame([[1, 2, 2, 4], [4, 3, 2, 1], [1, 1, 1, 1]], ["x", "y", "z"], [*"1357"])
    queries, gallery = (
        {"x": "a", "y": "b", "z": "c"},
        {"7": "b", "5": "b", "3": "a", "1": "a", "9": "d"},
    )
    matrix.iloc[:, ::-1].to_csv(tmp_path / "named.csv")
    np.savetxt(tmp_path / "plain.txt", matrix)
    savemat(tmp_path / "m.mat", {"D": matrix.to_numpy(), "E": np.eye(3)})
    matrix.to_numpy("<f4").tofile(tmp_path / "m.matrix")
    for given, *labels in (
        (matrix, queries, gallery),
        (tmp_path / "named.csv", queries, gallery),
        *(
            (given, [*"abc"], [*"aabb"])
            for given in (matrix.to_numpy(), *sorted(tmp_path.glob("*.[tm]*")))
        ),
    ):
        found = score(given, labels[0], gallery=labels[1])
        assert found.scores.loc["FT", ["score", "chance"]].tolist() == [(0.75 + 1) / 2, 0.5], given
        left_out = "2 queries; 1 left out, as the gallery has no shape of their class"
        assert found.notes == (left_out, NO_INTERVALS.format(2))
    for wrong, problem in (
        (matrix.replace(4, np.inf), "the first in row 1, column 4"),
        (-matrix, "negative"),
    ):
        with pytest.raises(ConfigurationError, match=problem):
            score(wrong, queries, gallery=gallery)
    with pytest.raises(
        ConfigurationError, match="no query has a shape of its class in the gallery"
    ):
        score(matrix, dict.fromkeys("xyz", "q"), gallery=gallery)
    for name, of in (("queries.txt", queries), ("gallery.txt", gallery)):
        (tmp_path / name).write_text("".join(f"{shape} {label}\n" for shape, label in of.items()))
    labels = ("--labels", tmp_path / "queries.txt", "--gallery", tmp_path / "gallery.txt")
    assert "2 queries; 1 left out" in call("score", tmp_path / "named.csv", *labels)
    assert "the queries as its gallery" in refusal(
        "score", tmp_path / "named.csv", *labels, "--results", tmp_path
    )


def test_names_and_labels_may_have_other_forms_of_unicode():
    names = [f"caf\u00e9{number}" for number in range(4)]
    decomposed = [unicodedata.normalize("NFD", name) for name in names]
    frame = pd.DataFrame(np.ones((4, 4)) - np.eye(4), decomposed, decomposed)
    score(frame, dict(zip(names, "aabb", strict=True)))
    score(frame.set_axis(names).set_axis(names, axis=1), dict(zip(decomposed, "aabb", strict=True)))
