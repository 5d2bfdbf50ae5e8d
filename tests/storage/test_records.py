"""Records are whole or absent, and what is no record harms nothing."""

import json

import pytest

from benchmark.storage.records import Records, by_place, is_record, outcome, portable
from tests.records import failed, record


@pytest.fixture
def records(tmp_path):
    return Records(tmp_path / "records")


def test_a_record_comes_back_as_it_was_and_a_later_one_replaces_it(records):
    first, second = record(nn=0.5), record(nn=0.75)
    assert first["key"] == second["key"]
    records.write(first)
    assert records.read(first["key"]) == first
    records.write(second)
    assert records.read(first["key"]) == second
    assert list(records) == [second]
    records.remove(first["key"])
    records.remove(first["key"])
    assert first["key"] not in records
    assert records.read(first["key"]) is None


def test_what_json_does_not_have_is_refused_and_the_old_record_stays(records):
    records.write(record(nn=0.5))
    with pytest.raises(ValueError, match="JSON"):
        records.write(record(nn=0.5, peak_mib=float("nan")))
    assert list(records) == [record(nn=0.5)]
    assert len(list(records.folder.iterdir())) == 1


def test_the_order_is_that_of_their_ends_wherever_they_lie(records, tmp_path):
    made = [record(m, finished=f"2026-01-0{k}T00:00:00+00:00") for k, m in ((3, "pca"), (1, "gps"), (2, "random"))]
    other = Records(tmp_path / "other")
    for one, two in zip(made, reversed(made), strict=True):
        records.write(one)
        other.write(two)
    assert [r["method"] for r in records] == [r["method"] for r in other] == ["gps", "random", "pca"]


def without(found, *path):
    """A copy of a record without one of its parts."""
    copied = json.loads(json.dumps(found))
    inner = copied
    for name in path[:-1]:
        inner = inner[name]
    del inner[path[-1]]
    return copied


GOOD = record()
ALIENS = {
    "another object": {"a": 1},
    "a list": [GOOD],
    "a number": 7,
    "no data": without(GOOD, "data"),
    "data without a name": without(GOOD, "data", "name"),
    "no title": without(GOOD, "title"),
    "no scores": without(GOOD, "scores"),
    "a measure is missing": without(GOOD, "scores", "FT"),
    "no chance": without(GOOD, "chance"),
    "no cost": without(GOOD, "cost"),
    "no queries": without(GOOD, "per_query"),
    "a score beyond 1": {**GOOD, "scores": {**GOOD["scores"], "NN": 1.5}},
    "a score that is no number": {**GOOD, "scores": {**GOOD["scores"], "NN": "best"}},
    "a score that is NaN": {**GOOD, "scores": {**GOOD["scores"], "NN": float("nan")}},
    "queries of fewer shapes": {**GOOD, "per_query": {**GOOD["per_query"], "NN": [1.0]}},
    "labels of fewer shapes": {**GOOD, "labels": ["cat"]},
    "an unknown input": {**GOOD, "input": "touch"},
    "a seed in words": {**GOOD, "recipe": {**GOOD["recipe"], "seed": "zero"}},
    "the name of another job": {**GOOD, "key": "0" * 32},
}


def put_aliens(folder):
    """Lay everything into a folder of records that is none; returns the number of files that can be read."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(ALIENS.values()):
        key = f"{number:032x}"
        named = {**content, "key": key} if isinstance(content, dict) and content.get("key") == GOOD["key"] else content
        (folder / f"{key}.json").write_text(json.dumps(named))
    (folder / "half.json").write_text(json.dumps(GOOD)[:-9])
    (folder / "empty.json").write_text("")
    (folder / "bytes.json").write_bytes(b"\xff\xfe\x00")
    (folder / "deep.json").write_text("[" * 100_000 + "]" * 100_000)
    (folder / "folder.json").mkdir()
    (folder / "dangling.json").symlink_to(folder / "nowhere")
    (folder / "notes.txt").write_text("mine")


@pytest.mark.parametrize("name", [name for name in ALIENS if name != "the name of another job"])
def test_what_is_no_record_is_told(name):
    assert is_record(GOOD)
    assert not is_record(ALIENS[name])


def test_what_is_no_record_is_passed_over(records):
    put_aliens(records.folder)
    records.write(GOOD)
    records.write(failed(method="pca"))
    assert {found["key"] for found in records} == {GOOD["key"], failed(method="pca")["key"]}
    assert records.read("0" * 32) is None
    assert records.read("half") is None


def test_a_failure_needs_no_scores_but_a_place():
    assert is_record(failed())
    assert not is_record(without(failed(), "data"))


def test_the_outcome_is_what_came_out_wherever_and_whenever():
    same = record(finished="2027-01-01T00:00:00+00:00", peak_mib=1, wall_seconds=9.0, artefacts=["cd"])
    assert outcome(same) == outcome(record())
    assert outcome(record(nn=0.5)) != outcome(record(nn=0.75))
    assert outcome(record(labels=["a", "a", "b", "b"])) != outcome(record())


def test_what_travels_does_not_name_files_of_this_machine():
    assert set(record()) - set(portable(record())) == {"artefacts"}


def test_the_file_has_one_part_a_line_and_no_place_depends_on_the_order_of_writing(records):
    records.write(dict(reversed(GOOD.items())))
    lines = (records.folder / f"{GOOD['key']}.json").read_text().splitlines()
    assert len(lines) == len(GOOD) + 2
    assert [line.partition(":")[0] for line in lines] == ["{", *(f'"{name}"' for name in sorted(GOOD)), "}"]


def test_records_of_one_place_share_gallery_input_method_and_seed():
    old, new = record(code="1"), record(code="2")
    assert old["key"] != new["key"]
    assert list(by_place([old, new, record("pca")]).values()) == [[old, new], [record("pca")]]
