"""Records: what is refused by name, which one counts, and how folders are joined and published."""

from __future__ import annotations

import errno
import json
import runpy
import shutil

import msgspec
import numpy as np
import pytest

from benchmark.commands.forget import forget
from benchmark.errors import ConfigurationError
from benchmark.pipeline import environment
from benchmark.pipeline.cache import Cache, StorageError
from benchmark.pipeline.merging import merge_records
from benchmark.pipeline.record_arrays import (
    published_distances,
    read_distances,
    read_form,
    read_prepared,
)
from benchmark.pipeline.record_files import _say_skipped, read_records, unneeded, write_record
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import TABLE_MEASURES
from benchmark.runs.planning import describe_change
from tests.report import records as made_up
from tests.runs.toy import planned, run_toy
from tools import publish as publishing
from tools.publish import portable, publish, write_published


def made(method="gps", *, nn=0.5, finished="2026-01-01", key="a", **changes):
    """Return the record of a job on five pets, the last of which is alone in its class."""
    shapes = ["cat0", "cat1", "dog0", "dog1", "owl0"]
    refused = {name for name, _ in changes.get("unsupported", [])}
    values = [0.0 if name in refused else nn for name in shapes[:4]]
    facts = {
        "key": key * 32,
        "status": "ok",
        "gallery": "pets",
        "gallery_digest": "1",
        "input": "mesh",
        "method": method,
        "title": method,
        "family": "paper",
        "data": {"name": "pets", "title": "Pets", "source": "pets"},
        "shapes": shapes,
        "labels": ["cat", "cat", "dog", "dog", "owl"],
        "scores": dict.fromkeys(TABLE_MEASURES, sum(values) / 4),
        "per_query": {name: [*values, None] for name in TABLE_MEASURES},
        "lone_queries": 1,
        "finished": finished,
        "commit": "c0ffee",
    } | changes
    return msgspec.convert(facts, Record)


def failed(**changes):
    outcome = {"scores": {}, "per_query": {}, "lone_queries": 0}
    return made(status="failed", reason="cat0: no", **outcome, **changes)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"status": "fine"}, r"Invalid enum value 'fine' - at `\$.status`"),
        ({"key": "../../etc"}, r"Expected `str` matching regex .* - at `\$.key`"),
        ({"method": "gps\x1b[2J"}, r"at `\$.method`"),
        ({"scores": {"NN": 1.5}}, r"Expected `float` <= 1.0.* - at `\$.scores\[...\]`"),
        ({"scores": {"NN": "high"}}, r"Expected `float`, got `str` - at `\$.scores\[...\]`"),
    ],
)
def test_what_is_no_record_is_refused_with_its_field(change, fault):
    content = json.loads(msgspec.json.encode(made())) | change
    with pytest.raises(msgspec.ValidationError, match=fault):
        msgspec.json.decode(json.dumps(content), type=Record)


def test_a_record_is_read_as_it_was_written(tmp_path):
    write_record(
        tmp_path,
        made(notes={"bridges": {"mean": 0.5, "max": 2}}, unsupported=[["dog0", "too big"]]),
    )
    (record,) = read_records(tmp_path)
    assert record == made(
        notes={"bridges": {"mean": 0.5, "max": 2}}, unsupported=[("dog0", "too big")]
    )
    assert (record.answered, record.coverage) == ([0, 1, 3, 4], 0.8)


def test_damaged_files_and_lines_are_named_once_and_skipped(tmp_path, capsys):
    write_record(tmp_path, made())
    for name, content in (("broken", b"{"), ("by-hand", msgspec.json.encode(made("shape-dna")))):
        (tmp_path / "runs" / "records" / f"{name}.json").write_bytes(content)
    write_published(tmp_path, [made("identity", key="b"), made("pca", key="c")])
    lines = (tmp_path / "records" / "pets.jsonl").read_text().splitlines()
    (tmp_path / "records" / "pets.jsonl").write_text("\n".join([lines[0][:-9], lines[1]]))
    for _ in range(2):
        assert {record.method for record in read_records(tmp_path)} == {"gps", "pca"}
    assert [line.partition(": it is")[0] for line in capsys.readouterr().err.splitlines()] == [
        f"skipped {tmp_path}/runs/records/broken.json",
        f"skipped {tmp_path}/runs/records/by-hand.json",
        f"skipped {tmp_path}/records/pets.jsonl:1",
    ]


def test_a_record_with_any_flipped_bit_is_passed_over_or_the_same(tmp_path, capsys):
    write_record(tmp_path, made(seconds={"ranking": 0.25}))
    (path,) = (tmp_path / "runs" / "records").iterdir()
    content, known = path.read_bytes(), read_records(tmp_path)
    for place in range(len(content)):
        path.write_bytes(
            content[:place] + bytes([content[place] ^ 1 << place % 8]) + content[place + 1 :]
        )
        assert read_records(tmp_path) in ([], known), content[:place]
    assert (
        "it was changed after it was written, or written by hand; remove it"
        in capsys.readouterr().err
    )


def test_published_records_fill_in_for_the_same_shapes_alone(tmp_path):
    write_published(
        tmp_path, [made("identity", key="b"), made("gps", key="c", nn=1.0), made("pca", key="d")]
    )
    write_record(tmp_path, made("gps"))
    assert {(record.method, record.published) for record in read_records(tmp_path)} == {
        ("gps", False),
        ("identity", True),
        ("pca", True),
    }
    write_record(tmp_path, made("gps", gallery_digest="2"), replaces="a" * 32)
    assert {record.method for record in read_records(tmp_path)} == {"gps"}
    assert len(read_records(tmp_path, local=False)) == 3
    write_record(
        tmp_path, made("pca", key="9", finished="2026-01-02")
    )  # the newest record of the gallery counts
    assert {record.method for record in read_records(tmp_path)} == {"gps", "pca", "identity"}


def test_a_folder_of_the_same_name_hides_no_published_records(tmp_path):
    write_published(tmp_path, [made("identity", key="b")])
    own = {"name": "pets", "title": "Pets", "source": "./pets", "path": "/home/pets"}
    write_record(tmp_path, made("gps", gallery_digest="2", data=own))
    assert {record.method for record in read_records(tmp_path)} == {"gps", "identity"}


def merged(folder, *records, into=()):
    """Merge records into those that are here; return the outcome, scores and status here."""
    for record in into:
        write_record(folder / "here", record)
    for number, record in enumerate(records):
        write_record(folder / str(number), record)
    outcome = merge_records(
        [folder / str(number) for number in range(len(records))], folder / "here"
    )
    return outcome, {
        record.method: (record.status, record.scores.get("NN"))
        for record in read_records(folder / "here")
    }


def test_merge_adds_rows_and_prefers_results_to_failures_and_later_failures_to_earlier(tmp_path):
    others = (
        made("gps"),
        made("identity", key="b"),
        failed(method="pca", key="c", finished="2026-03-01"),
    )
    outcome, here = merged(
        tmp_path, *others, into=[failed(method="gps"), failed(method="pca", key="d")]
    )
    assert (len(outcome.added), outcome.known, outcome.conflicts) == (3, 0, [])
    assert here == {"gps": ("ok", 0.5), "identity": ("ok", 0.5), "pca": ("failed", None)}
    assert {
        record.key[0] for record in read_records(tmp_path / "here") if record.method == "pca"
    } == {"c"}
    news = failed(key="f", finished="2026-03-01"), failed(method="pca", key="e"), made()
    outcome, _ = merged(
        tmp_path / "again",
        *news,
        into=[made(), failed(method="pca", key="d", finished="2026-03-01")],
    )
    assert (outcome.added, outcome.known, outcome.conflicts) == ([], 3, [])
    with pytest.raises(StorageError, match=r"holds no records; name a results folder"):
        merge_records([tmp_path / "none"], tmp_path / "here")


@pytest.mark.parametrize(
    ("key", "nn", "finished"), [("a", 0.25, "2026-01-01"), ("b", 0.5, "2026-03-01")]
)
def test_two_results_of_a_row_that_are_not_the_same_are_a_conflict_and_ours_stays(
    tmp_path, key, nn, finished
):
    outcome, here = merged(tmp_path, made(key=key, nn=nn, finished=finished), into=[made()])
    assert [(ours.key[0], theirs.key[0]) for ours, theirs in outcome.conflicts] == [("a", key)]
    assert here == {"gps": ("ok", 0.5)}
    assert [record.key for record in read_records(tmp_path / "here")] == ["a" * 32]


def test_the_row_of_a_colleague_on_the_same_folder_elsewhere_stands_beside_ours(rods, tmp_path):
    theirs = shutil.copytree(rods, tmp_path / "home" / "rods")
    run_toy(theirs, tmp_path / "theirs", "identity", "classic-mds", input=None)
    run_toy(rods, tmp_path / "ours", "gps", "identity", input=None)
    outcome = merge_records([tmp_path / "theirs"], tmp_path / "ours")
    assert (len(outcome.added), outcome.conflicts, outcome.refused) == (2, [], [])
    assert {record.data.path for record in read_records(tmp_path / "ours")} == {str(rods)}
    jobs = planned(rods, tmp_path / "ours", "classic-mds", "identity", "gps", input=None)
    assert {job.state for job in jobs} == {"finished"}
    (theirs / "dataset.toml").write_text('camera = "side"')  # so that all views are others
    run_toy(theirs, tmp_path / "other", "fast-mds", "gps", input="view")
    merge_records([tmp_path / "other"], tmp_path / "ours")
    paths = {
        record.method: record.data.path
        for record in read_records(tmp_path / "ours")
        if record.input == "view"
    }
    assert paths.pop("fast-mds") == str(theirs)
    assert len(paths) == 3


def test_files_that_no_other_record_names_are_unneeded(rods, tmp_path):
    run_toy(rods, tmp_path, "identity", "classic-mds", input=None)
    runs, stray = tmp_path / "runs", tmp_path / "runs" / "forms" / "0.npz"
    stray.write_bytes(b"")
    assert unneeded(tmp_path, lambda record: False) == ([], [stray])
    records, files = unneeded(tmp_path, lambda record: record.method == "identity")
    assert {(record.method, record.input) for record in records} == {
        ("identity", "mesh"),
        ("identity", "view"),
    }
    for path in files:
        path.unlink()
    of = {
        stage: {key for record in read_records(tmp_path) for key in record.files[stage]}
        for stage in ("forms", "signatures")
    }
    assert {stage: {path.stem for path in (runs / stage).iterdir()} for stage in of} == of
    assert {path.stem for path in (runs / "records").glob("*.npz")} == {
        record.key for record in read_records(tmp_path)
    }
    assert (
        len(list((runs / "prepared").iterdir())) == 9
    )  # four rods, their views, and the frame of the camera
    every = {path for path in runs.rglob("*.*") if path.is_file()}
    assert set(unneeded(tmp_path, lambda record: True)[1]) == every


def test_a_row_of_two_folders_of_one_name_is_forgotten_by_its_key_alone(tmp_path):
    for key, place in (("a", "/one/pets"), ("b", "/two/pets")):
        own = {"name": "pets", "title": "Pets", "source": place, "path": place}
        write_record(tmp_path, made("gps", key=key, data=own))
    with pytest.raises(ConfigurationError, match="several data sets: /one/pets, /two/pets; pass"):
        forget(records=["pets mesh gps"], results=tmp_path, yes=True)
    forget(records=["a" * 32], results=tmp_path, yes=True)
    assert [record.key for record in read_records(tmp_path)] == ["b" * 32]


@pytest.fixture
def clean(monkeypatch):
    monkeypatch.setattr(publishing, "has_edits", lambda: False)
    monkeypatch.setattr(publishing, "CATALOGUE", {"pets": None})
    monkeypatch.setattr(publishing, "WITH_DISTANCES", "pets")


def test_publish_replaces_earlier_records_and_leaves_out_private_and_quick_ones(tmp_path, clean):
    write_published(tmp_path, [made("gps", key="b", nn=0.25), made("skeleton", key="c")])
    write_record(tmp_path, made("gps", parts={"gps.py": "1"}, traceback="x"))
    write_record(tmp_path, made("own", key="d"))
    write_record(tmp_path, made("mesh-unfolding", key="0", scorer="spherical-harmonics"))
    quick = {"name": "pets", "title": "Pets", "source": "pets", "quick": True}
    write_record(tmp_path, made("identity", key="e", gallery="pets (quick)", data=quick))
    absent = {
        "status": "unavailable",
        "reason": "no model",
        "scores": {},
        "per_query": {},
        "commit": "",
    }
    write_record(tmp_path, made("learned", key="f", **absent))
    for far in (1.0, 2.0):
        Cache(tmp_path).write("records", "a" * 32, {"distances": far * (1 - np.eye(5))})
        added = publish(tmp_path)
    (file,) = (tmp_path / "records" / "distances").iterdir()  # earlier ones go
    published = {record.method: record for record in read_records(tmp_path, local=False)}
    assert [record.method for record in added] == ["gps"]
    assert published.keys() == {"gps", "skeleton"}
    assert (published["gps"].scores["NN"], published["gps"].parts, published["gps"].traceback) == (
        0.5,
        {},
        "",
    )
    assert published_distances(tmp_path, published["gps"].distances) == file
    (tmp_path / "runs" / "records" / f"{'a' * 32}.npz").unlink()
    assert read_distances(tmp_path, published["gps"]).tolist() == (2 * (1 - np.eye(5))).tolist()


def test_publish_refuses_edits_and_two_commits_in_a_table(tmp_path, clean, monkeypatch):
    write_record(tmp_path, made("gps"))
    write_record(tmp_path, made("identity", key="b", commit="beef"))
    with pytest.raises(ConfigurationError, match="the rows of pets mesh were made at beef, c0ffee"):
        publish(tmp_path)
    monkeypatch.setattr(publishing, "has_edits", lambda: True)
    with pytest.raises(ConfigurationError, match="the working tree has changes; commit them"):
        publish(tmp_path)
    monkeypatch.setattr(environment, "has_edits", lambda: True)
    with pytest.raises(SystemExit, match="error: the working tree has changes"):
        runpy.run_path(publishing.__file__, run_name="__main__")
    assert not (tmp_path / "records").exists()


def test_publish_deletes_no_line_that_it_cannot_read(tmp_path, clean):
    (tmp_path / "records").mkdir()
    for name, text in (("pets.jsonl", b"{}\n"), ("other.jsonl", b"\xff\n")):
        (tmp_path / "records" / name).write_bytes(text)
    write_record(tmp_path, made("gps"))
    with pytest.raises(
        ConfigurationError,
        match="2 lines of .*records cannot be read; do with each what is said above",
    ):
        publish(tmp_path)
    assert {path.name: path.read_bytes() for path in (tmp_path / "records").iterdir()} == {
        "pets.jsonl": b"{}\n",
        "other.jsonl": b"\xff\n",
    }


def test_published_lines_are_the_same_bytes_in_any_order(tmp_path):
    rows = [
        made(name, key=key) for name, key in zip(("gps", "pca", "identity"), "abc", strict=True)
    ]
    write_published(tmp_path / "one", map(portable, rows))
    write_published(tmp_path / "two", map(portable, reversed(rows)))
    texts = [(tmp_path / name / "records" / "pets.jsonl").read_bytes() for name in ("one", "two")]
    assert texts[0] == texts[1]


def test_changes_are_named():
    before = {"baselines/gps.py": "0" * 16, "numpy": "2.3", "its parameters": "{}", "the data": "1"}
    assert describe_change(before, before | {"baselines/gps.py": "1" * 16}) == "gps.py changed"
    everything = {
        "baselines/gps.py": "1" * 16,
        "numpy": "2.4",
        "its parameters": "{2}",
        "the data": "2",
        "scipy": "1",
    }
    assert describe_change(before, everything) == "gps.py, its parameters, numpy, 2 more changed"
    assert describe_change({}, {}) == "the code changed"


def test_the_published_records_of_the_suite_are_records(capsys):
    assert read_records(environment.ROOT / "results", local=False)
    assert capsys.readouterr().err == ""


def test_stored_arrays_that_cannot_be_are_named_and_count_as_missing(tmp_path, capsys):
    keys = {"forms": "f" * 32, "prepared": "0" * 32}
    own = made_up.record("gps", files={stage: [key] * 12 for stage, key in keys.items()})
    cache = Cache(tmp_path)
    corner = {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]])}
    for damaged in ({"vertices": np.full((3, 3), np.nan)}, {"faces": np.array([[0, 1, 7]])}):
        _say_skipped.cache_clear()
        for stage, key in keys.items():
            cache.write(stage, key, corner | damaged)
        assert read_form(tmp_path, own, "cat0") is read_prepared(tmp_path, own, "cat0") is None
        said = capsys.readouterr().err
        assert "skipped the stored form of 'cat0' on rods: " in " ".join(said.split())
        assert "skipped the stored surface of 'cat0': " in " ".join(said.split())
    for distances in (np.full((12, 12), np.nan), np.zeros((12, 12)).astype(str)):
        _say_skipped.cache_clear()
        cache.write("records", own.key, {"distances": distances})
        assert read_distances(tmp_path, own) is None
        assert "distances of rods mesh gps: they are no finite" in capsys.readouterr().err
    cache.write("forms", keys["forms"], corner)
    assert np.array_equal(read_form(tmp_path, own, "cat0").vertices, np.eye(3))


def test_a_stored_file_that_is_damaged_is_named(tmp_path, capsys):
    own = made_up.record("gps", files={"prepared": ["0" * 32] * 12})
    for stage, key in (("prepared", "0" * 32), ("records", own.key)):
        (tmp_path / "runs" / stage).mkdir(parents=True)
        (tmp_path / "runs" / stage / f"{key}.npz").write_bytes(b"PK")
    assert read_prepared(tmp_path, own, "cat0") is read_distances(tmp_path, own) is None
    said = capsys.readouterr().err.replace("\n", "")
    assert said.count(".npz: it is damaged; run its job again with --force") == 2


def test_a_stored_file_that_may_not_be_opened_costs_a_page_its_arrays_alone(
    tmp_path, capsys, monkeypatch
):
    own = made_up.record("gps", files={"prepared": ["0" * 32] * 12})
    corner = {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]])}
    Cache(tmp_path).write("prepared", "0" * 32, corner)
    Cache(tmp_path).write("records", own.key, {"distances": np.zeros((12, 12))})
    assert read_distances(tmp_path, own) is not None

    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr("benchmark.pipeline.cache.zipfile.ZipFile", refuse)
    assert read_prepared(tmp_path, own, "cat0") is read_distances(tmp_path, own) is None
    said = capsys.readouterr().err.replace("\n", "")
    assert said.count(".npz: Permission denied") == 2
