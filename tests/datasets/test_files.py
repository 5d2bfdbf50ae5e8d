"""Files of a data set: digests that are made once."""

import os
from pathlib import Path

import pytest

from benchmark import files
from benchmark.datasets.folder import folder_set
from tests.toy import write_rods


@pytest.fixture
def opened(monkeypatch):
    """Names of the files that were read, in order."""
    names = []
    original = Path.open

    def counted(path, *arguments, **options):
        names.append(path.name)
        return original(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", counted)
    files._digest.cache_clear()
    return names


def test_a_file_is_read_once_until_it_changes(tmp_path, opened):
    dataset = folder_set(write_rods(tmp_path / "rods"))
    opened.clear()
    first = [dataset.key(entry) for entry in dataset.shapes]
    again = [folder_set(dataset.folder).key(entry) for entry in dataset.shapes]
    assert first == again
    assert opened == [entry.path.name for entry in dataset.shapes]
    changed = dataset.shapes[2].path
    text = changed.read_text()
    changed.write_text(text.replace("0.1", "0.2"))
    assert len(text) == changed.stat().st_size
    os.utime(changed, ns=(0, 0))
    opened.clear()
    assert [dataset.key(e) == r for e, r in zip(dataset.shapes, first, strict=True)] == [True] * 2 + [False] + [
        True
    ] * 3
    assert opened == [changed.name]
