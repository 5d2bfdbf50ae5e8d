"""Records of other releases, and records that contradict themselves: what is used, kept, named and
left alone.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from benchmark.code_digest import digest_of_bytes
from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import StorageError
from benchmark.pipeline.record_checks import MOST_SHAPES
from benchmark.pipeline.record_files import encode_record, read_records, unneeded, write_record
from benchmark.pipeline.record_layout import LAYOUT, convert_older
from tests.pipeline.test_records import made, publishing
from tests.runs.toy import without_processes
from tests.verbs import call, refusal

KEY = "a" * 32

#: What a later release may add: to a record, its data, its models, its notes, and its gallery.
ADDED = {
    "memory": {"peak": 12.5},
    "data": {"name": "pets", "title": "Pets", "source": "pets", "licence": "CC0"},
    "models": [{"training": "t", "data": "d", "digest": "0", "epochs": 3}],
    "notes": {"bridges": {"mean": 1.0, "max": 2.0, "median": 1.0}},
    "against": {
        "gallery": "pets",
        "gallery_digest": "1",
        "input": "mesh",
        "data": {"name": "pets", "title": "Pets", "source": "pets", "licence": "CC0"},
        "shapes": ["cat9", "dog9"],
        "labels": ["cat", "dog"],
        "weights": [1, 2],
    },
}


def content_of(record=None, **changes):
    """Return the content of a record, without its checksum, with changes; None removes a field."""
    content = json.loads(encode_record(record or made())) | changes
    del content["checksum"]
    return {name: value for name, value in content.items() if value is not None}


def signed(content):
    text = msgspec.json.encode(content, order="sorted")
    return msgspec.json.encode(content | {"checksum": digest_of_bytes(text)})


def put(results, content, name=KEY):
    path = results / "runs" / "records" / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else signed(content))
    return path


def kept(results):
    (path,) = (results / "runs" / "records").glob("*.json")
    return json.loads(path.read_bytes())


# Layouts
# ------------------------------------------------------------------------------------------------


def test_a_record_says_its_layout(tmp_path):
    write_record(tmp_path, made())
    assert kept(tmp_path)["layout"] == [*LAYOUT]


@pytest.mark.parametrize("layout", [[*LAYOUT], [LAYOUT[0], LAYOUT[1] + 3]])
def test_unknown_fields_are_kept_by_merge_and_publish(tmp_path, monkeypatch, layout):
    put(tmp_path / "theirs", content_of(**ADDED, layout=layout))
    call("merge", tmp_path / "theirs", "--results", tmp_path / "ours")
    merged = kept(tmp_path / "ours")
    monkeypatch.setattr(publishing, "has_edits", lambda: False)
    monkeypatch.setattr(publishing, "CATALOGUE", {"pets": None})
    publishing.publish(tmp_path / "ours")
    (line,) = (tmp_path / "ours" / "records" / "pets.jsonl").read_text().splitlines()
    for written in (merged, json.loads(line)):
        assert written["layout"] == layout
        assert {name: written[name] for name in ADDED} == ADDED
    assert read_records(tmp_path / "ours", local=False)[0].data.unknown == {"licence": "CC0"}


class Newer(NamedTuple):
    """A results folder with a record in a newer layout, and what is said of that."""

    results: Path
    record: Path
    form: Path
    job: tuple[object, ...]
    problem: str

    @property
    def words(self) -> tuple[object, ...]:
        return "--results", self.results


@pytest.fixture(scope="module", params=[[LAYOUT[0] + 1, 0], [99, 7]], ids=str)
def newer_results(rods, tmp_path_factory, request):
    results = tmp_path_factory.mktemp("newer") / "results"
    job = ("-d", rods, "-m", "identity", "--input", "mesh")
    with without_processes():
        call("run", *job, "-j", 0, "--results", results)
    (path,) = (results / "runs" / "records").glob("*.json")
    content = {"layout": request.param, "key": path.stem, "rows": [{"file": "c" * 32}]}
    path.write_bytes(signed(content))
    (results / "runs" / "forms" / f"{'c' * 32}.npz").write_bytes(b"x")
    write_record(results, made("gps", key="b"))
    major, minor = request.param
    return results, path.name, job, f"its layout, {major}.{minor}, is newer"


@pytest.fixture
def newer(newer_results, tmp_path):
    """Such a folder, with a record that can be read."""
    results, name, job, problem = newer_results
    copy = shutil.copytree(results, tmp_path / "results")
    form = copy / "runs" / "forms" / f"{'c' * 32}.npz"
    return Newer(copy, copy / "runs" / "records" / name, form, job, problem)


def test_a_table_leaves_out_a_record_in_a_newer_layout(newer):
    assert "|gps|" in call("tables", *newer.words).lower()


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_plan_and_a_run_name_a_record_in_a_newer_layout(newer, verb):
    said = call(verb, *newer.job, *newer.words, code=int(verb == "run"))
    assert f"{newer.record}: {newer.problem}" in said


def test_a_merge_takes_no_record_in_a_newer_layout(newer, tmp_path):
    said = call("merge", newer.results, "--results", tmp_path / "other", code=1)
    assert "1 not taken" in said
    assert not (tmp_path / "other" / "runs" / "records" / newer.record.name).exists()


def test_no_record_is_written_over_one_in_a_newer_layout(newer):
    with pytest.raises(StorageError, match=newer.problem):
        write_record(newer.results, msgspec.structs.replace(made(), key=newer.record.stem))


def test_a_record_in_a_newer_layout_is_left_alone_with_its_files(newer):
    before = newer.record.read_bytes()
    call("forget", "-m", "gps", "--yes", *newer.words)
    call("forget", "--unused", "--yes", *newer.words)
    assert newer.record.read_bytes() == before
    assert newer.form.exists()


def test_a_record_in_a_newer_layout_goes_by_its_key_with_its_files(newer):
    call("forget", "--record", newer.record.stem, "--yes", *newer.words)
    assert not newer.record.exists()
    assert not newer.form.exists()


def test_publish_rewrites_no_line_in_a_newer_layout(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(publishing, "has_edits", lambda: False)
    (tmp_path / "records").mkdir()
    newer = signed(content_of(layout=[LAYOUT[0] + 1, 0])) + b"\n"
    (tmp_path / "records" / "pets.jsonl").write_bytes(newer)
    with pytest.raises(ConfigurationError, match="1 lines of .* cannot be read"):
        publishing.publish(tmp_path)
    assert "pets.jsonl:1: its layout, 2.0, is newer than that" in capsys.readouterr().err
    assert (tmp_path / "records" / "pets.jsonl").read_bytes() == newer


def test_a_newer_minor_layout_that_cannot_be_read_is_not_to_be_removed(tmp_path, capsys):
    put(tmp_path, content_of(status="paused", layout=[LAYOUT[0], LAYOUT[1] + 1]))
    assert read_records(tmp_path) == []
    assert "'paused' - at `$.status`; update the suite" in capsys.readouterr().err


@pytest.mark.parametrize(
    "layout", ["1.0", 1, None, [1], [1, 0, 0], [0, 2], [1, -1], [True, 0], [1.0, 0], {}]
)
def test_a_layout_that_is_no_version_is_named(tmp_path, capsys, layout):
    content = content_of() | {"layout": layout}
    put(tmp_path, content)
    assert read_records(tmp_path) == []
    assert "its layout is not [major, minor]" in capsys.readouterr().err


def test_records_without_a_layout_are_converted(tmp_path):
    before = content_of(layout=None)
    assert "layout" not in before
    assert convert_older(before) == before | {"layout": [*LAYOUT]}
    put(tmp_path, before)
    assert read_records(tmp_path) == [made()]


#: The fields of a record of release 0.2.
OF_0_2 = {
    "key": KEY,
    "gallery": "pets",
    "input": "mesh",
    "method": "gps",
    "title": "GPS",
    "family": "control",
    "parameters": {},
    "target": "baselines.gps:GPS",
    "status": "ok",
    "recipe": {"seed": 0, "parameters": {}, "code": {}},
    "data": {"name": "pets", "title": "Pets", "source": "pets", "module": "m", "n_shapes": 2},
    "shapes": ["cat0", "cat1"],
    "labels": ["cat", "cat"],
    "scores": {"NN": 1.0},
    "per_query": {"NN": [1.0, 1.0]},
}


def test_records_of_release_0_2_are_refused_with_the_reason(tmp_path, capsys):
    path = put(tmp_path, msgspec.json.encode(OF_0_2))
    assert read_records(tmp_path) == []
    said = capsys.readouterr().err
    assert f"skipped {path}: it is of release 0.2, which prepared shapes in another way" in said
    assert "run its job again; release 0.2 reads it" in said


# Contradictions
# ------------------------------------------------------------------------------------------------

SHAPES = ["cat0", "cat1", "dog0", "dog1", "owl0"]
MANY = [f"s{number}" for number in range(MOST_SHAPES + 1)]
NN = [0.5, 0.5, 0.5, 0.5, None]


def values(**of_measures):
    return content_of()["per_query"] | of_measures


CONTRADICTIONS = {
    "labels shorter than shapes": ({"labels": ["cat", "cat"]}, "it has 5 shapes and 2 labels"),
    "no values": ({"per_query": {}}, "it has no NN"),
    "two values": ({"per_query": values(NN=[0.5, 0.5])}, "5 queries and 2 values of NN"),
    "no scores": ({"scores": {}}, "it has no NN"),
    "no shapes": ({"shapes": [], "labels": []}, "it has no shapes"),
    "one name nine times": (
        {"shapes": ["cat0"] * 9, "labels": ["cat"] * 9},
        "shape 'cat0' stands there twice",
    ),
    "very many shapes": ({"shapes": MANY, "labels": MANY}, "50,001 shapes, more than 50,000"),
    "another mean": ({"per_query": values(NN=[1.0, *NN[1:]])}, "NN is 0.500000, and the mean"),
    "a mean off by 2e-6": ({"scores": content_of()["scores"] | {"FT": 0.500002}}, "FT is 0.500002"),
    "no value of a query": ({"per_query": values(NN=[None, *NN[1:]])}, "NN is missing"),
    "a value of a lone shape": ({"per_query": values(NN=[0.5] * 5)}, "NN is missing"),
    "no lone shape": ({"lone_queries": 0}, "it has 0 queries without a relevant shape, not 1"),
    "more ties than queries": ({"tied_queries": 5}, "it has 5 queries with ties among 4"),
    "a value without a score": ({"per_query": values(X=NN)}, "it has values of X, and no score"),
    "an error without a score": ({"draw_errors": {"X": 0.1}}, "it has values of X, and no score"),
    "a refused shape with a score": ({"unsupported": [["cat0", "no"]]}, "NN of a refused shape"),
    "a refused stranger": ({"unsupported": [["ant", "no"]]}, "a refused shape, 'ant', is none"),
    "a shape refused twice": (
        {"unsupported": [["cat0", "a"], ["cat0", "b"]]},
        "stands there twice",
    ),
    "an unprepared shape": ({"unprepared": ["cat0"]}, "'cat0', is not refused"),
    "a seen stranger": ({"seen": ["ant"]}, "'ant', is none of its shapes"),
    "files of others": ({"files": {"forms": [KEY]}}, "it has 1 file of forms for 5 shapes"),
    "views of queries": ({"views": 2}, "its queries have 2 views each"),
    "many views": ({"views": 10**9}, "1,000,000,000 views each, more than 1,000"),
    "one class": ({"labels": ["cat"] * 5}, "one class, so that every ranking is perfect"),
    "nothing to find": ({"labels": list("abcde")}, "no query has another shape of its class"),
    "a failure with scores": ({"status": "failed"}, "its status is 'failed', and it has scores"),
    "the key of another result": ({"result_key": "b" * 32}, "its key is not that of its result"),
    "a gallery of other data": ({"gallery": "ants"}, "is not of its data set, 'pets'"),
    "a gallery with one name twice": (
        {"against": ADDED["against"] | {"shapes": ["cat9", "cat9"]}},
        "shape 'cat9' stands there twice",
    ),
    "a gallery without classes": (
        {"against": ADDED["against"] | {"labels": []}},
        "it has 2 shapes and 0 labels",
    ),
}


@pytest.mark.parametrize("kind", CONTRADICTIONS)
def test_a_record_that_contradicts_itself_is_named_with_its_file(tmp_path, capsys, kind):
    changes, fault = CONTRADICTIONS[kind]
    path = put(tmp_path, content_of(**changes))
    assert read_records(tmp_path) == []
    said = capsys.readouterr().err
    assert said.startswith(f"skipped {path}: it contradicts itself: ")
    assert fault in said


def test_rounded_values_do_not_contradict_their_mean(tmp_path):
    put(tmp_path, content_of(scores=content_of()["scores"] | {"FT": 0.5 + 9e-7}))
    assert len(read_records(tmp_path)) == 1


def test_a_file_that_is_not_named_by_its_key_is_named_and_kept(tmp_path, capsys):
    path = put(tmp_path, content_of(), name="b" * 32)
    assert read_records(tmp_path) == []
    assert f"skipped {path}: its name is not its key; name it {KEY}.json" in capsys.readouterr().err


def test_what_a_file_says_of_being_published_does_not_count(tmp_path):
    put(tmp_path, content_of(published=True))
    assert [record.published for record in read_records(tmp_path)] == [False]


def test_a_record_of_other_shapes_than_the_rest_of_its_gallery_is_left_out(tmp_path, capsys):
    for number, method in enumerate(("gps", "identity", "pca")):
        write_record(tmp_path, made(method, key=f"{number}"))
    stranger = made("skeleton", shapes=[f"{name}x" for name in SHAPES], finished="2025-01-01")
    write_record(tmp_path, stranger)
    assert {record.method for record in read_records(tmp_path)} == {"gps", "identity", "pca"}
    assert f"skipped record {KEY} (pets mesh skeleton): its shapes" in capsys.readouterr().err


def test_unread_files_and_the_files_that_they_name_are_not_unneeded(tmp_path):
    path = put(tmp_path, b'{"files": {"forms": ["' + b"1" * 32 + b'"]}, ')
    forms = tmp_path / "runs" / "forms"
    forms.mkdir()
    for digit in "12":
        (forms / f"{digit * 32}.npz").write_bytes(b"")
    assert unneeded(tmp_path, lambda _: True) == ([], [forms / f"{'2' * 32}.npz"])
    _, files = unneeded(tmp_path, lambda _: False, [KEY])
    assert {*files} == {path, *forms.iterdir()}


def test_forget_takes_a_row_or_the_name_of_a_file(tmp_path):
    for number, method in enumerate(("gps", "gps[power=2]", "pca")):
        write_record(tmp_path, made(method, key=f"{number}"))
    words = ("--results", tmp_path)
    for selection in ((), ("--unused", "-m", "gps"), ("--record", KEY, "-m", "gps")):
        assert "one selection is needed" in refusal("forget", *selection, *words)
    assert "there is no record '../x'" in refusal("forget", "--record", "../x", *words)
    assert "this deletes 1 record," in refusal("forget", "--record", "pets mesh gps", *words)
    call("forget", "--record", "pets mesh gps", "--yes", *words)
    call("forget", "--record", "2" * 32, "--yes", *words)
    assert [record.method for record in read_records(tmp_path)] == ["gps[power=2]"]
