"""Merging: which file is written, which of two results stays, and what a merged row says."""

from __future__ import annotations

import json

import pytest

from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import Cache
from benchmark.pipeline.merging import merge_records
from benchmark.pipeline.record_files import read_records, write_record
from tests.pipeline.test_record_layout import content_of, put
from tests.pipeline.test_records import failed, made
from tests.verbs import call, refusal


@pytest.fixture
def folders(tmp_path):
    """Two results folders that differ in two rows."""
    for method, key in (("gps", "a"), ("identity", "b"), ("pca", "c")):
        write_record(tmp_path / "ours", made(method, key=key))
    write_record(tmp_path / "theirs", made("gps", key="d", nn=0.25))
    write_record(tmp_path / "theirs", made("identity", key="e", nn=0.75))
    write_record(tmp_path / "theirs", made("skeleton", key="f"))
    return tmp_path / "ours", tmp_path / "theirs"


def scores(results):
    return {record.method: record.scores["NN"] for record in read_records(results)}


def names(results):
    return sorted(path.name[0] for path in (results / "runs" / "records").glob("*.json"))


def test_a_record_under_the_key_of_another_row_replaces_no_file(tmp_path):
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    write_record(ours, made("gps", key="a"))
    before = (ours / "runs" / "records" / f"{'a' * 32}.json").read_bytes()
    write_record(theirs, made("identity", key="a"))
    said = call("merge", theirs, "--results", ours, code=1)
    assert (
        "not taken: pets mesh identity: its key is that of another row here, pets mesh gps" in said
    )
    assert "records: 0 added, 0 known, 0 in conflict, 1 not taken" in said
    assert (ours / "runs" / "records" / f"{'a' * 32}.json").read_bytes() == before
    write_record(ours, failed(method="identity", key="b"))
    call("merge", theirs, "--take", "theirs", "--results", ours, code=1)
    assert names(ours) == ["a", "b"]


def test_two_folders_with_one_key_for_two_rows_write_the_first(tmp_path):
    write_record(tmp_path / "1", made("gps", key="a"))
    write_record(tmp_path / "2", made("identity", key="a"))
    outcome = merge_records([tmp_path / "1", tmp_path / "2"], tmp_path / "ours")
    assert [record.method for record in outcome.added] == ["gps"]
    assert [refused.record.method for refused in outcome.refused] == ["identity"]
    assert scores(tmp_path / "ours") == {"gps": 0.5}


@pytest.mark.parametrize("there", [b"{", b'{"layout": [2, 0]}', b""])
def test_a_file_that_cannot_be_read_is_not_overwritten(tmp_path, there):
    path = put(tmp_path / "ours", there)
    write_record(tmp_path / "theirs", made("gps"))
    outcome = merge_records([tmp_path / "theirs"], tmp_path / "ours", "theirs")
    assert [refused.reason for refused in outcome.refused] == [
        f"{'a' * 32}.json is there already, and is not used as a record"
    ]
    assert path.read_bytes() == there


def test_a_record_of_other_shapes_of_a_gallery_is_not_taken(tmp_path):
    write_record(tmp_path / "ours", made("gps"))
    others = made("pca", key="b", shapes=["cat0", "cat1", "dog0", "dog1", "emu0"])
    write_record(tmp_path / "theirs", others)
    outcome = merge_records([tmp_path / "theirs"], tmp_path / "ours")
    assert [refused.reason for refused in outcome.refused] == [
        "its shapes or classes are not those of its gallery here"
    ]


def test_contradictions_there_are_counted(tmp_path):
    put(tmp_path / "theirs", content_of(labels=["cat"]))
    said = call("merge", tmp_path / "theirs", "--results", tmp_path / "ours", code=1)
    assert "records: 0 added, 0 known, 0 in conflict, 1 not taken" in said


def test_a_conflict_says_how_to_resolve_it_and_does_nothing(folders):
    ours, theirs = folders
    said = call("merge", theirs, "--results", ours, code=1)
    assert "conflict: pets mesh gps: NN .50 FT .50 ST .50 DCG .50  (-- s) here, NN .25" in said
    advice = f"merge {theirs} --take theirs --record 'pets mesh gps' --results {ours}"
    assert f"to take the other: python -m benchmark {advice}" in said
    assert scores(ours) == {"gps": 0.5, "identity": 0.5, "pca": 0.5, "skeleton": 0.5}


def test_all_conflicts_are_resolved_by_theirs_or_ours(folders):
    ours, theirs = folders
    said = call("merge", theirs, "--take", "ours", "--results", ours)
    assert "records: 1 added, 2 known, 0 in conflict" in said
    assert scores(ours) == {"gps": 0.5, "identity": 0.5, "pca": 0.5, "skeleton": 0.5}
    call("merge", theirs, "--take", "theirs", "--results", ours)
    assert scores(ours) == {"gps": 0.25, "identity": 0.75, "pca": 0.5, "skeleton": 0.5}
    assert names(ours) == ["c", "d", "e", "f"]


@pytest.mark.parametrize("name", ["pets mesh gps", "a" * 32, "d" * 32])
def test_one_conflict_is_resolved_by_its_row_or_a_key(folders, name):
    ours, theirs = folders
    outcome = merge_records([theirs], ours, "theirs", [name])
    assert [record.method for record in outcome.added] == ["gps", "skeleton"]
    assert [there.method for _, there in outcome.conflicts] == ["identity"]
    assert scores(ours) == {"gps": 0.25, "identity": 0.5, "pca": 0.5, "skeleton": 0.5}


def test_a_row_without_a_conflict_cannot_be_resolved_and_nothing_is_written(folders):
    ours, theirs = folders
    words = ("merge", theirs, "--results", ours)
    said = refusal(*words, "--take", "theirs", "--record", "pets mesh pca")
    assert said.startswith("no two results of row 'pets mesh pca' differ; name one of 'pets mesh")
    assert "pass --take theirs or ours, too" in refusal(*words, "--record", "pets mesh gps")
    assert names(ours) == ["a", "b", "c"]


def test_a_row_of_two_data_sets_is_to_be_named_by_a_key(tmp_path):
    for number, place in enumerate(("x", "y")):
        data = {"name": "pets", "title": "Pets", "source": "pets", "path": f"/{place}/pets"}
        for folder, nn, first in (("ours", 0.5, 0), ("theirs", 0.25, 4)):
            record = made(nn=nn, key=str(first + number), data=data, gallery_digest=place)
            write_record(tmp_path / folder, record)
    with pytest.raises(
        ConfigurationError, match="names rows of several data sets: /x/pets, /y/pets"
    ):
        merge_records([tmp_path / "theirs"], tmp_path / "ours", "theirs", ["pets mesh gps"])
    assert (
        len(merge_records([tmp_path / "theirs"], tmp_path / "ours", "theirs", ["5" * 32]).added)
        == 1
    )


def test_two_folders_that_differ_stay_in_conflict(tmp_path):
    for folder, nn in (("1", 0.25), ("2", 0.75)):
        write_record(tmp_path / folder, made(nn=nn, key=folder))
    write_record(tmp_path / "ours", made())
    outcome = merge_records([tmp_path / "1", tmp_path / "2"], tmp_path / "ours", "theirs")
    assert (len(outcome.added), len(outcome.conflicts)) == (1, 1)
    assert scores(tmp_path / "ours") == {"gps": 0.25}


def test_distances_of_the_result_that_goes_do_not_stay(tmp_path):
    write_record(tmp_path / "ours", made())
    Cache(tmp_path / "ours").write("records", "a" * 32, {})
    write_record(tmp_path / "theirs", made(nn=0.25))
    merge_records([tmp_path / "theirs"], tmp_path / "ours", "theirs")
    assert scores(tmp_path / "ours") == {"gps": 0.25}
    assert not Cache(tmp_path / "ours").has("records", "a" * 32)


def test_all_files_of_a_row_go_with_it(tmp_path):
    write_record(tmp_path / "ours", made(finished="2026-02-01"))
    write_record(tmp_path / "ours", made(key="b", finished="2026-03-01"))
    write_record(tmp_path / "theirs", made(key="c", nn=0.25, finished="2026-01-01"))
    merge_records([tmp_path / "theirs"], tmp_path / "ours", "theirs")
    assert scores(tmp_path / "ours") == {"gps": 0.25}
    assert names(tmp_path / "ours") == ["c"]


def test_a_note_says_where_a_row_came_from_and_the_digest_of_its_plugin(tmp_path):
    parts = {"stretch.py": "12345678abcdef00", "baselines/gps.py": "0" * 16, "numpy": "2.4"}
    write_record(tmp_path / "theirs", made("stretch", parts=parts, title="Stretch"))
    write_record(tmp_path / "theirs", made("other", key="b", title="Other"))
    write_record(tmp_path / "ours", made("identity", key="c", title="Identity"))
    call("merge", tmp_path / "theirs", "--results", tmp_path / "ours")
    said = call("tables", "--results", tmp_path / "ours")
    parent = tmp_path.name
    stretch = f"Stretch ({parent}/theirs: stretch.py 12345678abcdef00)"
    other = f"Other ({parent}/theirs)"
    assert f"Brought from other folders: {other}; {stretch}." in " ".join(
        said.replace("\\", "").split()
    )
    (content,) = [
        json.loads(path.read_bytes())
        for path in (tmp_path / "ours" / "runs" / "records").glob("a*.json")
    ]
    assert content["merged_from"] == {
        "folder": str(tmp_path / "theirs"),
        "plugins": {"stretch.py": "12345678abcdef00"},
    }
