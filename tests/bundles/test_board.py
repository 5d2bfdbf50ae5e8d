"""Rows of bundles in a report: verified apart from claimed, and nothing that is false."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmark.bundles.outcomes import boards, keep
from benchmark.errors import ConfigurationError
from tests.bundles.made import Forgery, command
from tests.bundles.test_verify import edit_score_and_queries, outcome
from tests.verbs import call

pytestmark = pytest.mark.usefixtures("forked_workers")

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture
def kept(ran, tmp_path) -> Path:
    """A results folder that keeps a verified bundle, one with a hostile title, and a claimed one."""
    hostile = Forgery(ran / "flat.zip")
    hostile.manifest["title"] = hostile.manifest["author"] = HOSTILE
    hostile.record["data"]["title"] = HOSTILE
    call("submit", "surface-area", "-o", tmp_path / "area.zip", "--results", ran / "results")
    for bundle in (ran / "flat.zip", hostile.write(tmp_path / "hostile.zip"), tmp_path / "area.zip"):
        keep(outcome(bundle), tmp_path / "kept")
    return tmp_path / "kept"


def statuses(results: Path) -> dict[str, object]:
    return {str(row[0]): row[2] for _, rows in boards(results) for row in rows}


def test_rows_that_can_be_compared_share_a_table_and_say_what_they_are(kept):
    assert statuses(kept) == {
        "Flattened (flat)": "verified", f"{HOSTILE} (flat)": "verified", "Surface area (surface-area)": "claimed",
    }  # fmt: skip
    by_form, by_descriptor = sorted(boards(kept), key=lambda board: -len(board[1]))
    assert "scored by spherical-harmonics[n_degrees=2]" in by_form[0]
    assert "by descriptors" in by_descriptor[0]


def test_the_report_shows_them_as_text(kept, ran, tmp_path):
    call("merge", ran / "results", "--results", kept)
    call("report", "--results", kept, "-m", "surface-area", "-o", tmp_path / "report")
    text = (tmp_path / "report" / "index.html").read_text()
    shown = text[text.index("<h2>Bundles") : text.index("<section id='failures'")]
    assert "<img" not in shown
    assert "&lt;img src=x" in shown
    assert len(re.findall(r">verified</td>", shown)) == 2
    assert len(re.findall(r">claimed</td>", shown)) == 1


def test_what_is_false_or_no_outcome_is_refused(ran, tmp_path):
    forged = Forgery(ran / "flat.zip")
    edit_score_and_queries(forged)
    told = command("verify", forged.write(tmp_path / "forged.zip"), "--into", tmp_path)
    assert (told.exit_code, "the bundle is false" in told.stderr) == (1, True)
    assert not (tmp_path / "bundles").exists()
    (tmp_path / "bundles").mkdir()
    (tmp_path / "bundles" / "a.json").write_text(json.dumps({"rows": []}))
    with pytest.raises(ConfigurationError, match="is not the outcome of a bundle"):
        boards(tmp_path)


@pytest.mark.parametrize(
    "name", ["\x1b[31mred\nline", "abc\u202edcba", "a\ud800b", "a\0b", "../../pwned", r"\input{/etc/passwd}"]
)
def test_a_hostile_name_is_refused_or_printed_in_its_line(ran, tmp_path, name):
    hostile = Forgery(ran / "flat.zip")
    hostile.manifest["title"] = hostile.manifest["author"] = hostile.record["data"]["title"] = name
    hostile.record["gallery"] = name
    told = command("verify", hostile.write(tmp_path / "hostile.zip"), "--into", tmp_path)
    *_, row, last = told.stdout.splitlines()
    assert told.stdout.replace("\n", "").isprintable()
    if "\0" in name or "\ud800" in name:
        assert row.startswith("false       [record-edited] ")
        assert "hostile.zip: false" in last
    else:
        assert row.startswith("verified    ")
        ((heading, rows),) = boards(tmp_path)
        assert (name in heading, rows[0][1]) == (True, name)
