"""The list of methods is written down for the next process, and made anew where something has changed."""

import json

import pytest
from click.testing import CliRunner

from benchmark.cli import listing
from benchmark.cli.main import cli
from benchmark.methods import registry
from benchmark.storage import derived


def listed():
    return json.loads(CliRunner().invoke(cli, ["list", "methods", "--json"]).output)


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Count how often the rows are made."""
    count = []
    real = listing.methods
    monkeypatch.setattr(listing, "_REMEMBERED", tmp_path / "methods.json")
    monkeypatch.setattr(listing, "methods", lambda *words: count.append(words) or real(*words))
    return count


def test_rows_are_made_once_and_again_for_other_code_or_packages(made, monkeypatch):
    rows = listed()
    assert [row["name"] for row in rows if "[" not in row["name"]] == list(registry.BUILT_IN)
    assert listed() == rows
    assert len(made) == 1
    with monkeypatch.context() as patch:
        patch.setattr(derived, "installed_names", lambda: "other")
        derived.suite_digest.cache_clear()
        assert listed() == rows
    derived.suite_digest.cache_clear()
    assert len(made) == 2


def test_rows_with_something_broken_are_not_written_down(made, monkeypatch):
    monkeypatch.setitem(registry.BUILT_IN, "pca", "baselines.nowhere:PCA")
    for count in (1, 2):
        assert next(row["state"] for row in listed() if row["name"] == "pca") == "broken"
        assert len(made) == count
