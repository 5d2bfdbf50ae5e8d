"""Output folders keep what users wrote."""

import json
import re

import pytest

from benchmark.errors import ConfigurationError
from benchmark.pipeline.record_files import read_records, write_record
from benchmark.report.output import WRITTEN_LIST, write_files
from benchmark.report.record_facts import scored_by
from benchmark.report.results import Results
from retrieval.cmbof import CMBOF
from tests.report.records import record
from tests.toy import files_of_at_most
from tests.verbs import call


def test_own_files_are_replaced_and_removed_and_no_others(tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    write_files(tmp_path, {"a.md": "1", "b.md": "1"})
    assert not capsys.readouterr().err
    write_files(tmp_path, {"a.md": "2"})
    said = capsys.readouterr().err.replace("\n", " ")
    assert f"removed from {tmp_path}, of an earlier command: b.md" in said
    assert {path.name for path in tmp_path.iterdir()} == {"a.md", "mine.txt", WRITTEN_LIST}
    assert (tmp_path / "a.md").read_text() == "2"


@pytest.mark.parametrize("is_edited", [True, False], ids=["edited", "of a user"])
def test_files_of_users_are_refused_before_anything_is_written(tmp_path, is_edited):
    if is_edited:
        write_files(tmp_path, {"a.md": "1", "b.md": "1"})
    (tmp_path / "b.md").write_text("mine")
    with pytest.raises(ConfigurationError, match=r"b\.md was (edited|not written)"):
        write_files(tmp_path, {"a.md": "2", "b.md": "2"})
    assert (tmp_path / "b.md").read_text() == "mine"
    assert not (tmp_path / "a.md").exists() or (tmp_path / "a.md").read_text() == "1"
    write_files(tmp_path, {"a.md": "2", "b.md": "2"}, force=True)
    assert (tmp_path / "b.md").read_text() == "2"


def test_a_list_that_names_files_elsewhere_or_is_damaged_harms_nothing(tmp_path):
    outside = tmp_path / "outside.txt"
    outside.write_text("kept")
    folder = tmp_path / "out"
    write_files(folder, {"a.md": "1"})
    for text in (
        json.dumps({"../outside.txt": "0", "a\0b": "0", "7": 7}),
        "[[",
        "[1]",
        '{"\udcff": "0"}',
    ):
        (folder / WRITTEN_LIST).write_text(text, errors="surrogateescape")
        write_files(folder, {"a.md": "1"})
    assert outside.read_text() == "kept"


def test_tables_of_another_scorer_or_seed_say_so_and_replace_no_files(tmp_path):
    mirrored = {"scorer": "cm-bof[allow_mirror=true]", "scorer_title": "CM-BOF (allow_mirror=true)"}
    for nn, more in ((0.75, {}), (0.5, mirrored), (0.25, {"seed": 3})):
        write_record(tmp_path, record("gps", nn, **more), "")
    words, names = ("tables", "--results", tmp_path, "-o", tmp_path / "t"), set()
    for options, said, nn in (
        ((), "(12 shapes of 3 classes).", ".75"),
        (
            ("--scorer", mirrored["scorer"]),
            "(12 shapes of 3 classes), scored by CM-BOF (allow\\_mirror=true).",
            ".50",
        ),
        (("--seed", "3"), "(12 shapes of 3 classes), seed 3.", ".25"),
        ((), "(12 shapes of 3 classes).", ".75"),
    ):
        call(*words, *options)
        found = {path.name: path.read_text() for path in (tmp_path / "t").iterdir()}
        (changed,) = [
            text
            for name, text in found.items()
            if name.endswith(".md") and said in " ".join(text.split())
        ]
        assert f"|GPS|{nn}" in changed
        assert "Scored by CM-BOF" in changed
        assert names <= found.keys()
        names |= found.keys()
    assert sum(name.endswith(".csv") for name in names) == 3
    assert all(re.fullmatch(r"[\w.-]+", name) for name in names)
    assert (
        len(
            {
                text.partition("label{")[2][:40]
                for name, text in found.items()
                if name.endswith(".tex")
            }
        )
        == 3
    )
    scores = Results(tmp_path, tuple(read_records(tmp_path))).scores.query(
        "measure == 'NN' and input == 'mesh'"
    )
    assert {(row.scorer, row.seed, row.value) for row in scores.itertuples()} == {
        ("cm-bof", 0, 0.75),
        ("cm-bof[allow_mirror=true]", 0, 0.5),
        ("cm-bof", 3, 0.25),
    }


def test_the_note_of_the_scorer_has_its_number_of_codebooks():
    assert CMBOF.info.draws == 3


def test_a_full_disk_leaves_the_files_as_they_were_and_the_next_write_replaces_them(tmp_path):
    write_files(tmp_path, {"a.md": "1", "b.md": "1"})
    long = "2" * 5000
    with (
        files_of_at_most(4096),
        pytest.raises(OSError, match=f"File too large: '{tmp_path / 'b.md'}'"),
    ):
        write_files(tmp_path, {"a.md": "2", "b.md": long})
    assert {path.name for path in tmp_path.iterdir()} == {"a.md", "b.md", WRITTEN_LIST}
    assert (tmp_path / "a.md").read_text() == "1"
    write_files(tmp_path, {"a.md": "3", "b.md": long})
    assert (tmp_path / "a.md").read_text() == "3"


def test_the_words_of_scorer_and_seed_are_set_off_in_names_of_files():
    for more in ({"scorer": "cm-bof[allow_mirror=true]"}, {"seed": 3}):
        suffix = scored_by([record("gps", 0.5, **more)]).suffix
        assert re.fullmatch(r"-(by-cm-bof-allow_mirror-true-[0-9a-f]{8}|seed-3)", suffix)
