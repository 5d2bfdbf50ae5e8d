"""Records in files of lines: nothing is lost, whatever they lie in, whoever reads meanwhile."""

import os
import shutil
import signal
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.execution.claims import Claims
from benchmark.files import write_text
from benchmark.pipeline.storage.merging import publish
from benchmark.pipeline.storage.record_schema import KINDS
from benchmark.pipeline.storage.records import Records, as_text
from benchmark.pipeline.storage.store import Store
from tests.pipeline.test_records import put_aliens
from tests.records import SHAPES, copy_published, failed, published, record

MADE = (
    record("gps", environments=[{"environment": "{}"}, {"python": "3"}]),
    record("fast-mds", finished="2025-01-01T00:00:00+00:00", per_query={
        "NN": [1, 1.0, 0.0, 1.0, None], "FT": [*[0.5] * 4, None], "ST": [*[0.75] * 4, None], "DCG": [*[0.8] * 4, None],
        "E": [*(k / 100 for k in range(4)), None],
    }, scores={"NN": 0.75, "FT": 0.5, "ST": 0.75, "DCG": 0.8, "E": 0.015}, shapes=[*SHAPES, "owl0"],
        labels=["cat", "cat", "dog", "dog", "owl"], n_shapes=5, n_classes=3),
    record("gps", gallery="balls[radius=2]", data={"name": "balls[radius=2]"}),
    failed(method="skeleton"),
)  # fmt: skip


def texts(records):
    """Records as they are written, by which 1 differs from 1.0."""
    return [as_text(found) for found in records]


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def records(tmp_path):
    """Four records in files of their own."""
    found = Records(tmp_path / "records")
    for each in MADE:
        write_text(found.folder / f"{each['key']}.json", as_text(each))
    return found


def test_gathered_records_are_the_same_in_a_line_each(records):
    before = texts(records)
    assert records.gather() == 4
    assert texts(records) == texts(Records(records.folder)) == before
    assert [records.read(each["key"]) for each in MADE] == list(MADE)
    assert all(each["key"] in records for each in MADE)
    parts = {f"parts/{kind}.jsonl" for kind in KINDS if kind != "code"}  # of version 0.2 alone
    assert set(files(records.folder)) == {"balls.jsonl", "rods.jsonl"} | parts
    lines = files(records.folder)["rods.jsonl"].splitlines()
    assert len(lines) == 3
    assert all(line.startswith(b'{"key":"') for line in lines)
    assert not records.skipped


def test_what_is_gathered_again_is_the_same_file_and_a_later_record_changes_one_line(records):
    records.gather()
    before = files(records.folder)
    assert records.gather() == 0
    records.write(MADE[0])
    assert records.gather() == 1
    assert files(records.folder) == before
    records.write({**MADE[0], "finished": "2027-01-01T00:00:00+00:00"})
    assert records.read(MADE[0]["key"])["finished"].startswith("2027")  # a file counts more than a line
    assert [each["finished"][:4] for each in records] == ["2025", "2026", "2026", "2027"]
    records.gather()
    now = files(records.folder)
    assert {name for name in before if before[name] != now[name]} == {"rods.jsonl"}
    assert len(set(before["rods.jsonl"].splitlines()) - set(now["rods.jsonl"].splitlines())) == 1


def test_what_is_no_record_stays_where_it_is_and_is_told(records):
    put_aliens(records.folder)
    aliens = {path.name for path in records.folder.glob("*.json")} - {f"{each['key']}.json" for each in MADE}
    records.gather()
    assert {path.name for path in records.folder.glob("*.json")} == aliens
    path = records.folder / "rods.jsonl"
    good = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([b"<<<<<<< HEAD", good[0].replace(b"0.5", b"1.5"), b"\xff" + good[1], good[2]]))
    again = Records(records.folder)
    assert len(list(again)) == 2
    assert again.skipped["rods.jsonl:1"] == "it is not JSON"
    assert "Expected `float` <= 1" in again.skipped["rods.jsonl:2"]
    again.write(MADE[2])
    again.gather()
    assert set(path.read_bytes().splitlines()) >= {b"<<<<<<< HEAD", good[2]}
    (records.folder / "parts" / "galleries.jsonl").write_text("[]")
    bare = Records(records.folder)
    assert list(bare) == []
    assert "it refers to missing parts in parts" in bare.skipped.values()


@pytest.mark.parametrize("work", ["read", "gather", "publish", "remove"])
def test_a_damaged_line_hides_no_good_one_and_no_work_drops_it(records, work):
    """A copy that is cut off, or one under the key of another record, before its line or behind it."""
    records.gather()
    path = records.folder / "rods.jsonl"
    good = path.read_bytes().splitlines()
    damaged = [good[0][:-9], good[1].replace(b"0.5", b"1.5"), good[2][:8] + good[0][8:40] + good[2][40:]]
    for lines in ([*damaged, *good], [*good, *damaged]):
        path.write_bytes(b"\n".join(lines))
        again = Records(records.folder)
        assert {each["key"] for each in again} == {each["key"] for each in MADE}
        assert [again.read(each["key"]) for each in MADE] == list(MADE)
        if work == "gather":
            again.write(MADE[0])
            assert again.gather() == 1
        elif work == "publish":
            publish([record("fast-mds", data={"source": "rods"})], again)
        elif work == "remove":
            again.remove(MADE[0]["key"])
        left = {each["key"] for each in MADE} - ({MADE[0]["key"]} if work == "remove" else set())
        now = Records(records.folder)
        assert {each["key"] for each in now} >= left
        assert set(path.read_bytes().splitlines()) >= set(damaged)
        assert len([name for name in now.skipped if name.startswith("rods.jsonl:")]) == 3
        if work == "remove":
            assert now.read(MADE[0]["key"]) is None


def test_a_damaged_part_stays_for_whoever_can_repair_it(records):
    records.gather()
    path = records.folder / "parts" / "galleries.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b'"balls[', b'"bills['))
    again = Records(records.folder)
    again.remove(MADE[0]["key"])
    path.write_bytes(path.read_bytes().replace(b'"bills[', b'"balls['))
    assert Records(records.folder).read(MADE[2]["key"]) == MADE[2]


def test_merging_gathers_what_was_made_here_and_not_while_a_run_writes(tmp_path):
    store = Store.open(tmp_path)
    for each in MADE:
        write_text(store.records.folder / f"{each['key']}.json", as_text(each))
    words = ["merge", str(tmp_path), "--results", str(tmp_path)]
    with Claims(store.root) as claims:
        claims.take(MADE[0]["key"])
        run = subprocess.run([sys.executable, "-m", "benchmark", *words], capture_output=True, text=True, check=True)
        assert len(list(store.records.folder.glob("*.json"))) == 4, run.stderr
    done = CliRunner().invoke(cli, words)
    assert done.output == "0 records added, 4 known, 0 conflicts\n"
    assert not list(store.records.folder.glob("*.json"))
    assert texts(Store.open(tmp_path).records) == texts(sorted(MADE, key=lambda each: (each["finished"], each["key"])))


@pytest.mark.parametrize("work", ["gather", "publish", "remove"])
def test_what_is_killed_at_any_of_its_files_loses_no_record_and_goes_on(tmp_path, work):
    """Old records of the places in which work is done may stay until it goes on, and nothing else."""
    data = {"source": "rods"}
    old = [record(name, data=data, rekeyed=[{"from": name}]) for name in ("gps", "fast-mds")]
    new = [record(name, data=data, code="2", finished="2027") for name in ("gps", "fast-mds")]
    keys = {name: {each["key"] for each in found} for name, found in (("old", old), ("new", new))}

    def put():
        shutil.rmtree(tmp_path)
        publish(old, Records(tmp_path))
        for each in new if work == "gather" else ():
            Records(tmp_path).write(each)

    def do():
        {
            "gather": lambda records: records.gather(),
            "publish": lambda records: publish(new, records),
            "remove": lambda records: records.remove(old[0]["key"]),
        }[work](Records(tmp_path))

    needed = {"gather": keys["old"] | keys["new"], "publish": set(), "remove": {old[1]["key"]}}[work]
    put()
    do()
    wanted, kills = texts(Records(tmp_path)), 0
    put()
    while killed(do, at=kills + 1):
        kills += 1
        found = Records(tmp_path)
        left = {each["key"] for each in found}
        assert left >= needed
        assert {each["method"] for each in found} >= ({"fast-mds"} if work == "remove" else {"gps", "fast-mds"})
        assert not found.skipped
        do()
        assert texts(Records(tmp_path)) == wanted
        put()
    assert kills > 3
    assert texts(Records(tmp_path)) == wanted


def killed(do, at):
    """Return whether a process that does something is killed, before the file of this number gets its name or goes."""
    count = 0

    def watch(event, arguments):
        nonlocal count
        if event in ("os.rename", "os.remove"):
            count += 1
            if count == at:
                os.kill(os.getpid(), signal.SIGKILL)

    if (process := os.fork()) == 0:
        sys.addaudithook(watch)
        try:
            do()
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == -signal.SIGKILL


def test_published_records_come_back_from_either_form_key_for_key(tmp_path):
    """A sixteenth of them."""
    copy_published(tmp_path, lambda each: each["key"][:1] == "7")
    records = Records(tmp_path)
    before = {each["key"]: each for each in records}
    assert len(before) > 50
    assert before == {each["key"]: each for each in published() if each["key"] in before}
    records.gather()
    assert texts(Records(tmp_path)) == texts(sorted(before.values(), key=lambda each: (each["finished"], each["key"])))
