"""Answers of earlier processes about records count while code, packages, models and data are the same."""

import pytest

from benchmark.methods.registry import methods
from benchmark.report import outdated_cache
from benchmark.report.results import Results
from benchmark.storage import derived
from benchmark.storage.records import by_place
from benchmark.storage.store import Store
from tests.records import failed, record

KEPT = record("gps", gallery="animals"), failed(method="pca", gallery="animals")
PLUGIN = (record("gps", gallery="animals", code="2", data={"name": "mine"}),)


@pytest.fixture
def store(tmp_path, monkeypatch):
    """A store whose answers are written to a folder of their own as soon as there is one."""
    monkeypatch.setattr(outdated_cache, "__file__", str(tmp_path / "code" / "outdated_cache.py"))
    monkeypatch.setattr(outdated_cache, "_WORTH", 1)
    return Store.open(tmp_path / "results")


@pytest.fixture
def asked(store, tmp_path, monkeypatch):
    """Ask for all results; returns the methods of the records that had to be compared with this code."""
    compared = []
    told = {"gps": "code", "pca": ""}
    monkeypatch.setattr(Results, "_outdated", lambda _, each: compared.append(each["method"]) or told[each["method"]])

    def ask(records=KEPT):
        compared.clear()
        found = Results(store, methods(), tmp_path / "data").all(places=by_place(records))
        assert {each.record["method"]: each.outdated for each in found} == {
            r["method"]: told[r["method"]] for r in records
        }
        return compared

    return ask


def test_records_are_compared_once(asked):
    assert asked() == ["gps", "pca"]
    assert asked() == []
    assert asked([KEPT[0] | {"commit": "abc"}]) == ["gps"]  # of which the answer may speak


@pytest.mark.parametrize("what", ["code", "package", "model", "data", "damage"])
def test_they_are_compared_again_where_something_is_not_the_same(asked, store, tmp_path, monkeypatch, what):
    asked()
    if what == "code":
        monkeypatch.setattr(outdated_cache, "suite_digest", lambda: "other")
        monkeypatch.setattr(outdated_cache, "read_suite", lambda: "other")
    elif what == "package":
        monkeypatch.setattr(derived, "installed_names", lambda: "other")
        derived.suite_digest.cache_clear()
    elif what == "damage":
        (path,) = (tmp_path / "code" / "__pycache__").iterdir()
        path.write_text(path.read_text().replace("code", "cold"))
    else:
        place = store.models / "t" / "m" / "card.json" if what == "model" else tmp_path / "data" / "tosca" / "cat0.off"
        place.parent.mkdir(parents=True)
        place.write_text("{}")
    assert asked() == ["gps", "pca"]
    derived.suite_digest.cache_clear()


def test_what_is_found_out_while_code_is_edited_is_not_kept(asked, monkeypatch):
    monkeypatch.setattr(outdated_cache, "read_suite", lambda: "edited since")
    asked()
    assert asked() == ["gps", "pca"]


def test_records_of_plugins_are_compared_each_time(asked):
    asked(PLUGIN)
    assert asked(PLUGIN) == ["gps"]
