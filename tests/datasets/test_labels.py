"""Labels and matrices as other programs give them: each has the figure worked out here, or a
refusal that names it.
"""

import enum
import gzip
import io
import json
import pickle
from collections import Counter
from datetime import date, datetime
from decimal import Decimal
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.io import loadmat, savemat
from scipy.sparse import csc_matrix
from scipy.spatial.distance import pdist, squareform

from benchmark.commands.score import score
from benchmark.datasets.labels import classes_of, read_labels
from benchmark.errors import ConfigurationError

RANDOM = np.random.default_rng(5)
TRUTH = np.repeat([0, 1, 2], 4)
D = squareform(pdist(RANDOM.normal(size=(12, 3)) + TRUTH[:, None] * 1.2))
LABELS = TRUTH.copy()
LABELS[[0, 5, 9]] = -1
NUMBERS = LABELS.tolist()
WORDS = [{-1: "-1", 0: "cat", 1: "dog", 2: "owl"}[label] for label in NUMBERS]
NAMES = [f"s{row}" for row in range(12)]


def nearest_neighbour(labels):
    """NN by its definition: whether the nearest other shape is of the class of a query; class -1
    has no queries.
    """
    counts = Counter(labels)
    queries = [row for row, label in enumerate(labels) if str(label) != "-1" and counts[label] > 1]
    hits = 0
    for query in queries:
        others = [row for row in range(len(labels)) if row != query]
        nearest = min(others, key=lambda row: D[query, row])
        hits += labels[nearest] == labels[query]
    return hits / len(queries), len(queries)


RIGHT = nearest_neighbour(NUMBERS)


def matlab(values):
    """Values as MATLAB saves them and scipy loads them."""
    file = io.BytesIO()
    savemat(file, {"labels": values})
    return loadmat(io.BytesIO(file.getvalue()))["labels"]


def cells(values):
    return np.array([*values, None], dtype=object)[:-1]


class Kind(enum.IntEnum):
    NONE, FIRST, SECOND, THIRD = -1, 0, 1, 2


class Animal(str, enum.Enum):  # noqa: UP042  # its str() is its name
    NONE, CAT, DOG, OWL = "-1", "cat", "dog", "owl"


OBJECTS = {
    "list": NUMBERS,
    "tuple": (*NUMBERS,),
    "iterator": iter(NUMBERS),
    "values of a mapping": dict(zip(NAMES, NUMBERS, strict=True)).values(),
    "array": LABELS,
    "floats": LABELS.astype(float),
    "row": LABELS[None],
    "column": LABELS[:, None],
    "matrix": np.asmatrix(LABELS).T,
    "lists of one": [[label] for label in NUMBERS],
    "tensor": torch.tensor(NUMBERS),
    "tensor of floats": torch.tensor(NUMBERS, dtype=torch.float32),
    "column of a tensor": torch.tensor(NUMBERS)[:, None],
    "tensors without axes": [*torch.tensor(NUMBERS)],
    "arrays of one": [np.array([label]) for label in NUMBERS],
    "numpy scalars": [np.int16(label) for label in NUMBERS],
    "bytes": np.array([str(label).encode() for label in NUMBERS]),
    "list of bytes": [word.encode() for word in WORDS],
    "padded text": np.array([f"{word}  " for word in WORDS]),
    "text of numpy": [np.str_(word) for word in WORDS],
    "objects": np.array(NUMBERS, dtype=object),
    "masked, none hidden": np.ma.masked_array(LABELS, mask=False),
    "series": pd.Series(NUMBERS),
    "series of categories": pd.Series(WORDS, dtype="category"),
    "categorical": pd.Categorical(WORDS),
    "index": pd.Index(NUMBERS),
    "nullable integers": pd.array(NUMBERS, dtype="Int64"),
    "frame of one column": pd.DataFrame({"label": NUMBERS}),
    "numbers of MATLAB": matlab(LABELS[:, None].astype(float)),
    "cells of MATLAB": matlab(cells(WORDS)),
    "cells with numbers of MATLAB": matlab(cells(NUMBERS)),
    "text of MATLAB": matlab(np.array(WORDS)),
    "mixed": [label if row % 3 else float(label) for row, label in enumerate(NUMBERS)],
    "mixed with text": [label if row % 2 else f"{label}.0" for row, label in enumerate(NUMBERS)],
    "minus zero": [-0.0 if label == 0 else label for label in NUMBERS],
    "enumeration of numbers": [Kind(label) for label in NUMBERS],
    "enumeration of text": [Animal(word) for word in WORDS],
    "text of fixed width": [f"{word}\0\0" for word in WORDS],
    "bytes of fixed width": [f"{word}\0".encode() for word in WORDS],
}


@pytest.mark.parametrize("labels", OBJECTS.values(), ids=OBJECTS)
def test_one_axis_of_plain_values_has_the_figure_of_a_list(labels):
    found = score(D, labels, "list" if hasattr(labels, "items") else "")
    assert (found.scores.loc["NN", "score"], found.queries["NN"].notna().sum()) == RIGHT


def test_truth_values_and_dates_as_text_are_two_classes():
    for labels in (
        [row < 6 for row in range(12)],
        ["2024-01-01" if k < 6 else "x" for k in range(12)],
    ):
        found = score(D, labels)
        expected = nearest_neighbour([f"class {label}" for label in labels])
        assert (found.scores.loc["NN", "score"], found.queries["NN"].notna().sum()) == expected


ONE_HOT = np.eye(3)[TRUTH]
RECORDS = np.array(list(zip(NAMES, NUMBERS, strict=True)), dtype=[("name", "U4"), ("label", int)])
GAP = [*WORDS[:11], None]
NO_OBJECTS = {
    "NaN": ([*NUMBERS[:11], np.nan], "shapes without a label: 1, the first is 'row 12'"),
    "None": (GAP, "shapes without a label: 1"),
    "NA": ([*NUMBERS[:11], pd.NA], "shapes without a label: 1"),
    "NaT": ([*WORDS[:11], pd.NaT], "shapes without a label: 1"),
    "empty text": ([*WORDS[:11], ""], "shapes without a label: 1"),
    "empty bytes": (np.array([*WORDS[:11], ""]).astype("S"), "shapes without a label: 1"),
    "category without a value": (pd.Categorical(GAP), "shapes without a label: 1"),
    "masked": (np.ma.masked_array(LABELS, np.arange(12) == 11), "shapes without a label: 1"),
    "masked item": ([*WORDS[:11], np.ma.masked], "shapes without a label: 1"),
    "empty cell": (matlab(cells([*WORDS[:11], np.zeros((0, 0))])), "shapes without a label: 1"),
    "NaN in a cell": (matlab(cells([*NUMBERS[:11], np.nan])), "shapes without a label: 1"),
    "one-hot": (ONE_HOT, r"array of shape \(12, 3\), not one axis"),
    "one-hot tensor": (torch.tensor(ONE_HOT), r"shape \(12, 3\)"),
    "nested": ([[[label]] for label in NUMBERS], r"shape \(12, 1, 1\)"),
    "ragged": ([["cat"], ["dog", "owl"]], "label 1 is of type list"),
    "list in a list": ([*WORDS[:11], ["cat"]], "label 12 is of type list"),
    "mapping in a list": ([*WORDS[:11], {"cat": 1}], "label 12 is of type dict"),
    "records": (RECORDS, "records with the fields name, label; pass one of the fields"),
    "no axis": (np.array(1), "type ndarray, not one axis"),
    "one text": (b"aabb", "type bytes"),
    "a set": ({*WORDS}, "type set"),
    "times": (np.array(["2024-01-01"] * 12, dtype="M8[ns]"), "times"),
    "durations": (np.arange(12).astype("m8[s]"), "times"),
    "dates": ([date(2024, 1, 1)] * 12, "label 1 is of type date"),
    "timestamps": (pd.Series([datetime(2024, 1, 1)] * 12), "label 1 is of type Timestamp"),
    "complex": (LABELS.astype(complex), "label 1 is of type complex"),
    "infinite": ([*NUMBERS[:11], np.inf], "label 12 is infinite"),
    "large floats": ([2.0**53 + n for n in NUMBERS], "label 2 is .*, a float that may stand for"),
    "control characters": ([*WORDS[:11], "cat\x07"], r"label 12 holds a control character"),
    "a NUL within": ([*WORDS[:11], "c\0t"], r"label 12 holds a control character"),
    "a blank without width": ([*WORDS[:11], "cat\u200b"], r"label 12 holds a control character"),
    "a mark of direction": (["\u200ecat", *WORDS[1:]], r"label 1 holds a control character"),
    "a mark of the order of bytes": (["\ufeffcat", *WORDS[1:]], r"label 1 holds a control"),
    "decimals": ([Decimal(1)] * 12, "label 1 is of type Decimal"),
    "objects": ([object()] * 12, "label 1 is of type object"),
    "functions": ([print] * 12, "label 1 is of type builtin_function"),
    "truth beside numbers": ([True, 1, False, 0] * 3, "truth values stand beside other labels"),
    "sparse": (csc_matrix(LABELS), "type csc_matrix, not one axis"),
    "sparse tensor": (torch.tensor(NUMBERS).to_sparse(), "no array: .*[sS]parse"),
    "tensor with gradients": (torch.ones(12, requires_grad=True), "no array: .*detach"),
    "bytes in another encoding": (
        ["caf\xe9".encode("latin-1")] * 12,
        "label 1 is no text in UTF-8",
    ),
    "two columns": (pd.DataFrame({"a": WORDS, "b": WORDS}), "frame of 2 columns; .*frame"),
    "a name twice": (pd.Series(WORDS, ["s"] * 12), "names a shape twice, 's'"),
    "a name in two forms": ({"caf\xe9": 1, "cafe\u0301": 2}, "names a shape twice"),
    "a number and its text as names": ({1: "a", "1": "b"}, "names a shape twice, '1'"),
    "tuples as names": ({("a", 1): "a", ("b", 1): "b"}, r"array of shape \(2, 2\)"),
    "no name": (pd.Series(["a", "b"], ["s0", None]), "name 2 is missing"),
    "lists by name": ({"s0": ["a", "b"], "s1": ["a", "b"]}, r"array of shape \(2, 2\)"),
    "a number in two spellings": ([7.5, "7.50", *WORDS[2:]], "'7.5' and '7.50' may be one class"),
    "a leading zero": (["1", "01", *WORDS[2:]], "'1' and '01' may be one class"),
    "no class in another spelling": (["-01", "-01", *WORDS[2:]], "'-1' and '-01' may be one class"),
    "no class by an exponent": (["-1e0", "-1e0", *WORDS[2:]], "'-1' and '-1e0' may be one class"),
    "no class with another minus": (
        ["\N{MINUS SIGN}1", "\N{MINUS SIGN}1", *WORDS[2:]],
        "'-1' and '\N{MINUS SIGN}1' may be one class",
    ),
    "an exponent": (["100", "1e2", *WORDS[2:]], "'100' and '1e2' may be one class"),
}


@pytest.mark.parametrize(("labels", "problem"), NO_OBJECTS.values(), ids=NO_OBJECTS)
def test_what_is_no_axis_of_plain_values_is_refused_by_its_name(labels, problem):
    with pytest.raises(ConfigurationError, match=problem) as caught:
        score(D, labels)
    assert caught.value.hint


def test_labels_by_name_may_be_arrays_of_one():
    named = {name: torch.tensor([label]) for name, label in zip(NAMES, NUMBERS, strict=True)}
    assert classes_of(named) == classes_of(dict(zip(NAMES, NUMBERS, strict=True)))
    assert classes_of(pd.Series(["a", "b"], [1.0, 2.0])) == {"1": "a", "2": "b"}
    assert classes_of({b"x": "a"}) == {"x": "a"}


# Text
# --------------------------------------------------------------------------------------------

NAMED = dict(zip(NAMES, WORDS, strict=True))


def lines(joint=",", end="\n", first=(), quote="", last=""):
    rows = [f"{name}{joint}{quote}{word}{quote}{last}" for name, word in NAMED.items()]
    return end.join([*first, *rows]) + end


TEXTS = {
    "commas": lines(),
    "commas and blanks": lines(", "),
    "semicolons": lines(";"),
    "tabs": lines("\t"),
    "tabs and blanks": lines(" \t "),
    "blanks": lines("   "),
    "quotes": lines(quote='"'),
    "header": lines(first=["name,label"]),
    "header in quotes": lines(first=['"Shape";"Class"'], joint=";"),
    "header of blanks": lines(" ", first=["name label"]),
    "header of pandas": pd.DataFrame({"name": NAMES, "label": WORDS}).to_csv(index=False),
    "series of pandas": pd.Series(WORDS, NAMES).to_csv(),
    "named series of pandas": pd.Series(WORDS, NAMES, name="label").to_csv(),
    "named series with tabs": pd.Series(WORDS, NAMES, name="class").to_csv(sep="\t"),
    "index of pandas": pd.Series(WORDS, NAMES, name="label").to_csv(index_label="name"),
    "table of R": lines(first=['"","x"']),
    "CRLF": lines(end="\r\n"),
    "CR": lines(end="\r"),
    "byte-order mark": "\ufeff" + lines(),
    "comments": lines(first=["# name,label"]),
    "empty lines": lines(end="\n\n"),
    "trailing separators": lines(last=","),
    "trailing semicolons": lines(" ", last=";"),
    "without a last line break": lines().strip(),
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_lists_of_names_and_labels_are_read_alike(text, tmp_path):
    path = tmp_path / "labels.csv"
    path.write_bytes(text.encode())
    found = score(pd.DataFrame(D, NAMES, NAMES), path)
    assert (found.scores.loc["NN", "score"], found.queries["NN"].notna().sum()) == RIGHT


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_lists_of_labels_alone_are_read_in_each_encoding(encoding, tmp_path):
    path = tmp_path / "labels.txt"
    path.write_text("\n".join(WORDS), encoding=encoding)
    assert score(D, path).scores.loc["NN", "score"] == RIGHT[0]


INNER = [f"{kind};{k % 2}" for k, kind in enumerate(["Chair"] * 4 + ["Table"] * 4 + ["Light"] * 4)]


def test_a_separator_that_is_not_in_each_line_is_text(tmp_path):
    path = tmp_path / "labels.tsv"
    path.write_text("s0\tChair\ns1\tChair\ns2\tChair;Bench\ns3\tBig, red chair\n")
    assert read_labels(path) == {
        "s0": "Chair",
        "s1": "Chair",
        "s2": "Chair;Bench",
        "s3": "Big, red chair",
    }
    path.write_text("".join(f's{k},"{label}"\n' for k, label in enumerate(INNER)))
    assert read_labels(path) == dict(zip(NAMES, INNER, strict=True))
    path.write_text("".join(f'"{label}"\n' for label in INNER))
    assert read_labels(path) == INNER
    path.write_text('s0,"a ""b"", c"\ns1,d\n')
    assert read_labels(path) == {"s0": 'a "b", c', "s1": "d"}


ONE_EACH = "put cells that hold a separator in quotes"
NO_TEXTS = {
    "semicolon in each class": (
        "s0,Chair;x\ns1,Chair;y\n",
        f"semicolons and commas divide.*{ONE_EACH}",
    ),
    "comma in each class": ("s0\tChair, x\ns1\tChair, y\n", "tabs and commas divide"),
    "comma in each class by blanks": ("s0 a,x\ns1 a,y\n", "commas and blanks divide"),
    "blank in each class": ("s0,a b\ns1,c b\n", "commas and blanks divide"),
    "all separators": ("s0 a,x;y\ns1 b,z;y\n", "semicolons and commas and blanks divide"),
    "labels with separators": ("Chair a\nChair;a\n", "lines of 1 and 2 words; .*in quotes"),
    "labels of two words": (
        "Chair a\nChair b\n",
        "twice, 'Chair'; .*labels alone, put .*in quotes",
    ),
    "three columns": ("s0,a,b\ns1,c,d\n", "lines of 3 words"),
    "row numbers of pandas": (",name,label\n0,s0,a\n1,s1,b\n", "lines of 3 words.*index=False"),
    "labels before names": ("label,name\na,s0\nb,s1\n", "labels first; write the name before"),
    "one title": ("label\na\nb\n", "first line, 'label', may name the columns; delete it"),
    "a title alone": ("name,label\n", "no line but its header"),
    "a name is missing": ("s0,a\n,b\n", "name 2 is missing"),
    "the first name is missing": (",a\ns1,b\n", "name 1 is missing"),
    "a label is missing": ("s0,a\ns1,\n", "shapes without a label: 1, the first is 's1'"),
    "a trailing separator": ("s0;a;\ns1;b\n", "lines of 2 and 3 words"),
    "for Excel": ("sep=;\ns0;a\ns1;b\n", "'sep=;', is for Excel.*; delete the first line"),
    "JSON": (json.dumps(NAMED), "begins with '{', as JSON"),
    "a printed list": (str(WORDS), r"begins with '\['"),
    "a quote without an end": ('s0,"a\ns1,b\n', "not a readable list of labels"),
    "a number in two spellings": ("s0,7.5\ns1,7.50\n", "'7.5' and '7.50' may be one class"),
    "another encoding": ("s0,caf\xe9\n".encode("latin-1"), "byte 7 is no text in UTF-8"),
}


@pytest.mark.parametrize(("text", "problem"), NO_TEXTS.values(), ids=NO_TEXTS)
def test_text_that_is_no_list_of_labels_says_what_to_do(text, problem, tmp_path):
    path = tmp_path / "labels.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigurationError, match=problem) as caught:
        read_labels(path)
    assert caught.value.hint


def content_of(save, *arguments):
    file = io.BytesIO()
    save(file, *arguments)
    return file.getvalue()


def archive(name):
    import zipfile

    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as zipped:
        zipped.writestr(name, "x")
    return file.getvalue()


FORMATS = {
    "x.npy": (content_of(np.save, LABELS), "a NumPy array"),
    "x.npz": (content_of(np.savez, LABELS), "an archive of NumPy"),
    "x.mat": (content_of(savemat, {"labels": LABELS}), "a MATLAB file"),
    "x.h5": (b"\x89HDF\r\n\x1a\n" + bytes(64), "an HDF5 file"),
    "x.pkl": (pickle.dumps(NUMBERS), "a pickle of Python"),
    "x.pt": (content_of(lambda file: torch.save(torch.tensor(NUMBERS), file)), "a file of PyTorch"),
    "x.xlsx": (archive("xl/workbook.xml"), "a workbook of Excel"),
    "x.xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(64), "a workbook of Excel"),
    "x.zip": (archive("labels.txt"), "a ZIP archive"),
    "x.parquet": (b"PAR1" + bytes(64), "a Parquet table"),
    "x.txt.gz": (gzip.compress(lines().encode()), "compressed by gzip .*gunzip"),
    "x.png": (b"\x89PNG\r\n\x1a\n" + bytes(64), "byte 1 is no text"),
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats_that_are_no_text_are_named(name, tmp_path):
    content, kind = FORMATS[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigurationError, match=f"{name}: .*{kind}.*; write"):
        read_labels(tmp_path / name)
    (tmp_path / "x.txt").write_bytes(content)
    with pytest.raises(ConfigurationError, match=f"{kind}.*; write the matrix"):
        score(tmp_path / "x.txt", NUMBERS)


# Matrices
# --------------------------------------------------------------------------------------------


def table(joint, point=".", end="\n"):
    return "".join(joint.join(f"{d:.17g}".replace(".", point) for d in row) + end for row in D)


MATRICES = {
    "array": D,
    "list": D.tolist(),
    "tuples": tuple(map(tuple, D)),
    "tensor": torch.tensor(D),
    "list of tensors": [*torch.tensor(D)],
    "matrix": np.asmatrix(D),
    "objects": D.astype(object),
    "frame": pd.DataFrame(D),
    "masked, none hidden": np.ma.masked_array(D, mask=False),
    "masked diagonal": np.ma.masked_array(D, mask=np.eye(12)),
    "nullable": pd.DataFrame(D).astype("Float64"),
    "longer floats": D.astype(np.longdouble),
    "commas": table(","),
    "commas and blanks": table(", "),
    "semicolons": table(";"),
    "tabs": table("\t"),
    "blanks": table("  "),
    "decimal commas and semicolons": table(";", ","),
    "decimal commas and tabs": table("\t", ","),
    "decimal commas and blanks": table(" ", ","),
    "trailing commas": table(",", end=",\n"),
    "rows of MATLAB": table(" ", end=";\n"),
    "CRLF": table(",", end="\r\n"),
}


@pytest.mark.parametrize("given", MATRICES.values(), ids=MATRICES)
def test_matrices_of_any_kind_have_the_figure_of_an_array(given, tmp_path):
    if isinstance(given, str):
        (tmp_path / "m.txt").write_bytes(given.encode())
        given = tmp_path / "m.txt"
    found = score(given, NUMBERS)
    np.testing.assert_allclose(found.distances, D, rtol=1e-15)
    assert found.scores.loc["NN", "score"] == RIGHT[0]


def triangle(first=()):
    return "\n".join([*first, *(" ".join(map(str, row[: k + 1])) for k, row in enumerate(D))])


def with_names(joint=" "):
    return [joint.join([name, *map(str, row)]) for name, row in zip(NAMES, D, strict=True)]


NO_MATRICES = {
    "condensed": (pdist(np.arange(24.0).reshape(12, 2)), r"shape \(66,\).*; .*squareform"),
    "condensed, a line": (" ".join(map(str, pdist(D))), r"shape \(1, 66\).*; .*squareform"),
    "condensed, lines": ("\n".join(map(str, pdist(D))), r"shape \(66, 1\).*; .*squareform"),
    "sparse": (csc_matrix(D), "type csc_matrix is no N x N matrix"),
    "three axes": (D[None], r"array of shape \(1, 12, 12\)"),
    "complex": (D.astype(complex), "complex128, is no N x N"),
    "text": (D.astype(str), "is no N x N"),
    "times": (D.astype("m8[s]"), "is no N x N"),
    "records": (np.zeros((12, 12), dtype=[("a", float)]), "is no N x N"),
    "large whole numbers": (D.astype("u8") + 2**60, "whole numbers up to .*; divide them"),
    "ragged": ([[0, 1], [1]], "not a matrix of numbers"),
    "tensor with gradients": (torch.tensor(D, requires_grad=True), "not a matrix.*detach"),
    "masked": (np.ma.masked_array(D, np.isclose(D, D[0, 1])), "NaN or infinite"),
    "dates": ([[date(2024, 1, 1)] * 2] * 2, "not a matrix of numbers"),
    "a name of two": (pd.DataFrame(D, [("a", k) for k in NAMES], NAMES), "name 1 is of type tuple"),
    "for Excel": ("sep=,\n" + table(","), "'sep=,', is for Excel.*; delete the first line"),
    "Orange": ("\n".join(["12 labeled", *with_names("\t")]), "'12 labeled', is no row.*; delete"),
    "PHYLIP": ("\n".join(["   12", *with_names()]), "first line, '12', is no row.*; delete"),
    "a count of rows": ("12\n" + table(" "), "first line, '12', is no row.*; delete"),
    "lower triangle": (triangle(), "one triangle of a matrix; write the whole matrix"),
    "lower triangle of PHYLIP": (triangle(["12"]), "one triangle of a matrix"),
    "printed array": (str(D.tolist()), "brackets"),
    "two separators": ("a;1,b;2\nb;1,c;2\n", "semicolons and commas divide"),
}


@pytest.mark.parametrize(("given", "problem"), NO_MATRICES.values(), ids=NO_MATRICES)
def test_what_is_no_matrix_says_what_to_do(given, problem, tmp_path):
    if isinstance(given, str):
        (tmp_path / "m.txt").write_text(given)
        given = tmp_path / "m.txt"
    with pytest.raises(ConfigurationError, match=problem) as caught:
        score(given, NUMBERS)
    assert caught.value.hint


@pytest.mark.parametrize("first", [0, 1])
def test_an_archive_that_numbers_its_rows_in_another_order_is_refused(tmp_path, first):
    numbers = np.arange(first, first + 12)
    np.savez(tmp_path / "d.npz", distances=D, ids=numbers)
    assert score(tmp_path / "d.npz", NUMBERS).scores.loc["NN", "score"] == RIGHT[0]
    np.savez(tmp_path / "d.npz", distances=D, ids=np.roll(numbers, 1))
    with pytest.raises(ConfigurationError, match="'ids' numbers the rows in another order"):
        score(tmp_path / "d.npz", NUMBERS)


@pytest.mark.parametrize("dtype", ["i8", "u2", "U"])
def test_an_archive_names_its_rows_by_texts_or_whole_numbers(tmp_path, dtype):
    """Of a data set whose models have numbers, matrix and labels may have different orders."""
    names = 7 * np.arange(12) + 100
    order = RANDOM.permutation(12)
    shuffled = {"D": D[np.ix_(order, order)], "id": names[order].astype(dtype)}
    np.savez(tmp_path / "d.npz", **shuffled, n_vertices=np.full(12, 5000))
    savemat(tmp_path / "d.mat", shuffled)
    labels = {str(name): word for name, word in zip(names, WORDS, strict=True)}
    for file in ("d.npz", "d.mat"):
        assert score(tmp_path / file, labels).scores.loc["NN", "score"] == RIGHT[0]
        with pytest.raises(ConfigurationError, match="name their shapes, and the labels do not"):
            score(tmp_path / file, NUMBERS)


def test_an_archive_names_the_rows_and_columns_of_a_rectangle(tmp_path):
    rows, columns = (RANDOM.permutation(size) for size in (5, 7))
    queries = dict(zip(NAMES[:5], WORDS, strict=False))
    gallery = dict(zip(NAMES[5:], WORDS, strict=False))
    right = score(D[:5, 5:], [*queries.values()], gallery=[*gallery.values()]).scores
    np.savez(
        tmp_path / "d.npz",
        D=D[:5, 5:][np.ix_(rows, columns)],
        queries=np.array(NAMES[:5])[rows],
        gallery=np.array(NAMES[5:])[columns],
    )
    found = score(tmp_path / "d.npz", queries, gallery=gallery).scores
    pd.testing.assert_frame_equal(found, right)
    np.savez(tmp_path / "d.npz", D=D[:6, 6:], names=NAMES[:6])
    halves = [dict(zip(names, WORDS, strict=False)) for names in (NAMES[:6], NAMES[6:])]
    with pytest.raises(ConfigurationError, match="those of the rows or of the columns"):
        score(tmp_path / "d.npz", halves[0], gallery=halves[1])


def test_classes_that_differ_in_spelling_alone_are_named():
    classes = [name for name in ("cat", "Cat", "big dog", "big-dog", "cow", "crow") for _ in "ab"]
    said = "classes that differ in spelling alone count as two: "
    (note,) = (note for note in score(D, classes).notes if "spelling" in note)
    assert note == f"{said}'cat' and 'Cat', 'big dog' and 'big-dog'"
    found = score(D[:6, 6:], WORDS[:6], gallery=["cat", "CAT", "dog", "dog", "cat", "cat"])
    assert any("'cat' and 'CAT'" in note for note in found.notes)
    named = dict(zip(["a-1", "a_1", *NAMES[2:]], ["-1", "-1", *WORDS[2:]], strict=True))
    assert not any("spelling" in note for note in score(D, named).notes)


def test_names_of_a_frame_are_read_like_those_of_labels():
    for index in (np.array(NAMES, dtype="S"), pd.Categorical(NAMES), np.array(NAMES, dtype=object)):
        frame = pd.DataFrame(D, index, NAMES)
        assert score(frame, NAMED).scores.loc["NN", "score"] == RIGHT[0]
    numbered = pd.DataFrame(D, np.arange(12.0) * 3, np.arange(12) * 3)
    labels = {f"{3 * row}": word for row, word in enumerate(WORDS)}
    assert score(numbered, labels).scores.loc["NN", "score"] == RIGHT[0]
    assert all(a < b for a, b in pairwise(numbered.index))
