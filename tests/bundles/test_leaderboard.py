"""The page of a folder of bundles."""

from __future__ import annotations

import json
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from benchmark.bundles import leaderboard
from benchmark.bundles.checking import Request
from benchmark.bundles.known import Known
from benchmark.bundles.leaderboard import write_leaderboard
from benchmark.report.html.folder import Folder
from tests.bundles.made import Forgery, command
from tests.bundles.test_verify import edit_score_and_queries, outcome
from tools.browser import CHROMIUM, DESK, DRIVER, PHONE, Browser, chromium

pytestmark = pytest.mark.usefixtures("forked_workers")

HOSTILE = "<img src=x onerror=alert(1)>"


class Page(HTMLParser):
    """Identifiers, and addresses that lead somewhere on the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.identifiers: list[str] = []
        self.addresses: list[str] = []
        self.tags: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.identifiers += [value for name, value in attributes if name == "id"]
        self.addresses += [value for name, value in attributes if name == "href"]


@pytest.fixture
def looked_at(monkeypatch) -> list[str]:
    """Names of the bundles that were looked at, which is done in this process."""
    found: list[str] = []

    def verify(request, say):
        found.append(request.path.name)
        return outcome(request.path)

    monkeypatch.setattr(leaderboard, "verify", verify)
    return found


@pytest.fixture
def bundles(ran, tmp_path, looked_at) -> Path:
    """A verified bundle, one with a hostile title, a claimed one, a forged one, and junk."""
    folder = tmp_path / "bundles"
    folder.mkdir()
    shutil.copy(ran / "flat.zip", folder / "good.zip")
    made = command("submit", "surface-area", "-o", folder / "area.zip", "--results", ran / "results")
    assert made.exit_code == 0, made.output
    hostile = Forgery(ran / "flat.zip")
    hostile.manifest["title"] = hostile.manifest["author"] = HOSTILE
    hostile.record["data"]["title"] = HOSTILE
    hostile.write(folder / "hostile.zip")
    forged = Forgery(ran / "flat.zip")
    edit_score_and_queries(forged)
    forged.write(folder / "forged.zip")
    (folder / "junk.zip").write_text("junk")
    return folder


def write(bundles: Path, output: Path, results: Path = Path("nowhere")) -> str:
    write_leaderboard(bundles, Folder(output), Request(bundles, Known(results)))
    return (output / "index.html").read_text()


def test_verified_and_claimed_rows_stand_apart_and_what_is_false_is_not_shown(bundles, tmp_path):
    text = write(bundles, tmp_path / "page")
    verified, claimed = text.index("<h3>Verified"), text.index("<h3>Claimed")
    rows = {title: text.index(f">{title}</a>") for title in ("Flattened", "Surface area")}
    assert verified < rows["Flattened"] < claimed < rows["Surface area"] < text.index("Not shown")
    refused = text[text.index("Not shown") :]
    assert "forged.zip" in refused
    assert "scores-differ" in refused
    assert "no-zip" in refused
    assert "forged.zip" not in text[: text.index("Not shown")]


def test_titles_are_text_and_every_row_has_a_link_that_stays(bundles, tmp_path):
    text = write(bundles, tmp_path / "page")
    page = Page(text)
    assert "img" not in page.tags
    assert "&lt;img src=x" in text
    rows = [name for name in page.identifiers if name.startswith("row-")]
    assert len(rows) == 3
    assert len(set(page.identifiers)) == len(page.identifiers)
    assert {f"#{row}" for row in rows} <= set(page.addresses)
    for address in page.addresses:
        if address.startswith("#"):
            assert address[1:] in page.identifiers
        elif address.startswith("outcomes/"):
            assert (tmp_path / "page" / address).is_file()
    (bundles / "good.zip").rename(bundles / "renamed.zip")
    (bundles / "hostile.zip").unlink()
    assert {name for name in Page(write(bundles, tmp_path / "page")).identifiers if name.startswith("row-")} < set(rows)


def test_an_outcome_is_kept_by_the_digest_of_the_bundle_and_no_word_of_a_bundle_is(bundles, looked_at, tmp_path):
    write(bundles, tmp_path / "page")
    first = looked_at.copy()
    assert sorted(first) == ["area.zip", "forged.zip", "good.zip", "hostile.zip", "junk.zip"]
    before = {path.name: path.read_bytes() for path in (tmp_path / "page" / "outcomes").iterdir()}
    looked_at.clear()
    write(bundles, tmp_path / "page")
    assert looked_at == ["area.zip"]  # a claim may be told by now
    assert {path.name: path.read_bytes() for path in (tmp_path / "page" / "outcomes").iterdir()} == before
    kept = json.loads(before[f"{outcome(bundles / 'good.zip').digest}.json"])
    assert kept["outcome"]["status"] == "verified"
    looked_at.clear()
    shutil.copy(bundles / "forged.zip", bundles / "good.zip")  # another file under the name of a verified one
    write(bundles, tmp_path / "page")
    assert "Flattened</a>\n<small class='faint'>flat, by Ada" not in (tmp_path / "page" / "index.html").read_text()
    looked_at.clear()
    write(bundles, tmp_path / "page", tmp_path)  # compared with something else
    assert sorted(looked_at) == ["area.zip", "forged.zip", "hostile.zip", "junk.zip"]  # the fifth is one of these


def test_a_folder_without_bundles_and_one_of_something_else_are_refused(bundles, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    told = command("leaderboard", empty, "-o", tmp_path / "page")
    assert "contains no bundle" in str(told.exception)
    (empty / "index.html").write_text("mine")
    told = command("leaderboard", bundles, "-o", empty)
    assert "is not of a report" in str(told.exception)
    assert (empty / "index.html").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs Debian's packages chromium and chromium-driver")
def test_the_page_in_a_browser(bundles, tmp_path):
    """Sorted by a key, a link that leads to its row, nothing beyond the edge of a telephone, no complaints."""
    pytest.importorskip("selenium", reason="needs the Python package selenium")
    write(bundles, tmp_path / "page")
    with chromium(tmp_path / "profile") as driver:
        browser = Browser(driver, tmp_path / "page")
        for size in (DESK, PHONE):
            browser.open("index.html", size)
            assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
            wide = browser.run(
                "return [...document.querySelectorAll('.frame')].some((f) => f.scrollWidth > f.clientWidth)"
            )
            assert wide == (size == PHONE)  # where it scrolls within its frame
        column = "return [...document.querySelectorAll('tbody')][0].rows[0].cells[0].querySelector('a').textContent"
        browser.run("document.querySelector('thead th button').focus()")
        first = browser.run(column)
        browser.press("\ue007")  # Enter
        once = browser.run(column)
        browser.press("\ue007")
        assert {once, browser.run(column)} == {"Flattened", HOSTILE}
        assert first in ("Flattened", HOSTILE)
        row = browser.run("return document.querySelector('tbody tr').id")
        browser.open(f"index.html#{row}", PHONE)
        place = browser.run("return document.querySelector('tr:target').getBoundingClientRect().top")
        assert 0 < place < PHONE[1]
        assert browser.complaints() == []
