"""Output folders keep what users wrote."""

import json

import pytest

from benchmark.errors import ConfigurationError
from benchmark.report.output import LIST, write_files


def test_own_files_are_replaced_and_removed_and_no_others(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    write_files(tmp_path, {"a.md": "1", "b.md": "1"})
    write_files(tmp_path, {"a.md": "2"})
    assert {path.name for path in tmp_path.iterdir()} == {"a.md", "mine.txt", LIST}
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
    for text in (json.dumps({"../outside.txt": "0", "a\0b": "0", "7": 7}), "[[", "[1]", '{"\udcff": "0"}'):
        (folder / LIST).write_text(text, errors="surrogateescape")
        write_files(folder, {"a.md": "1"})
    assert outside.read_text() == "kept"
