"""The cache of sources: taken over by the next process, and never out of date."""

import json

import pytest

from benchmark.system import fingerprints


@pytest.fixture
def source(tmp_path, monkeypatch):
    """A module, and a process that has parsed nothing."""
    monkeypatch.setattr(fingerprints, "_PARSED", {})
    path = tmp_path / "module.py"
    path.write_text("x = 1\n")
    fingerprints.clear_cache()
    yield path
    fingerprints.clear_cache()


def parsed(source, monkeypatch):
    """How often something is parsed while the fingerprint of a module is taken anew."""
    count = []
    real = fingerprints._parse
    monkeypatch.setattr(fingerprints, "_parse", lambda *words: count.append(words) or real(*words))
    fingerprints._PARSED.clear()
    fingerprints.clear_cache()
    with fingerprints.parse_cache(source.parent):
        digest = fingerprints.fingerprint(str(source)).digest
    return len(count), digest


def test_a_source_is_parsed_once_and_again_when_it_changes(source, monkeypatch):
    first, digest = parsed(source, monkeypatch)
    assert first == 1
    assert parsed(source, monkeypatch) == (0, digest)
    source.write_text("x = 2\n")
    again, other = parsed(source, monkeypatch)
    assert (again, other != digest) == (1, True)


@pytest.mark.parametrize("damage", ["", "[1, 2", "{}", "[[1]]", '[["a", "b", "c", ["d"], "e"]]'])
def test_a_damaged_file_is_as_good_as_none(source, monkeypatch, damage):
    _, digest = parsed(source, monkeypatch)
    (kept,) = source.parent.glob("parsed-sources-*.json")
    assert json.loads(kept.read_text())
    kept.write_text(damage)
    assert parsed(source, monkeypatch) == (1, digest)
