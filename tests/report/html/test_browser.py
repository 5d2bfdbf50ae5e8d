"""The report in a browser: Debian's chromium without a screen, the report opened from its folder."""

import time
from pathlib import Path

import numpy as np
import pytest

from benchmark.methods.registry import methods
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import contents
from benchmark.report.html.folder import Folder
from benchmark.report.html.site import write_report
from benchmark.report.results import Results
from benchmark.storage.store import Store
from tests.records import failed
from tests.toy import write_rods
from tools.browser import CHROMIUM, DRIVER, PHONE, Browser, chromium

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs Debian's packages chromium and chromium-driver"),
]

ROOT = Path(__file__).parents[3]

SCENES = ("scene", "scene2")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The report of a small run: two methods that make forms, a descriptor, and a failure with a name from outside."""
    from click.testing import CliRunner

    from benchmark.cli.main import cli

    base = tmp_path_factory.mktemp("site")
    write_rods(base / "rods")
    results = base / "results"
    chosen = ["-m", "identity", "-m", "pca", "-m", "surface-area"]
    run = ["run", "-d", str(base / "rods"), "--executor", "serial", "--results", str(results), *chosen]
    assert CliRunner().invoke(cli, run).exit_code == 0
    store = Store.open(results)
    example = next(iter(store.records))
    name = "<img src=x onerror=alert(1)>"
    store.write_record(
        failed("crashed", name, method="fell", title=name, gallery=example["gallery"], data=example["data"])
    )
    known = methods()
    artefacts = ArtefactReader(store, known)
    written = write_report(contents(Results(store, known).all()), artefacts, Folder(base / "report"), "report")
    assert (written.n_forms, written.n_distances, written.n_ranked) == (24, 6, 6)
    return base / "report"


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    pytest.importorskip("selenium", reason="needs the Python package selenium")
    with chromium(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture
def browser(driver, site):
    """Opens a page of the report; at the end nothing may have been complained about."""
    found = Browser(driver, site)
    yield found
    assert found.complaints() == []


PAGES = ("index.html", "table-rods.html", "table-rods-forms.html", "table-rods-queries.html")


def test_a_table_is_sorted_by_a_click_or_a_key_and_filtered(browser):
    browser.open("table-rods.html")
    given = browser.column(0)
    assert len(given) == 4
    head = "#scores thead tr:last-child th:nth-child(2) button"
    browser.click(head)
    numbers = [float(value) for value in browser.column(1) if value != "--"]
    assert numbers == sorted(numbers, reverse=True)
    assert browser.column(1)[-1] == "--"
    browser.run("document.querySelector(arguments[0]).focus()", head)
    browser.press("\ue007")  # Enter
    numbers = [float(value) for value in browser.column(1) if value != "--"]
    assert numbers == sorted(numbers)
    assert browser.column(1)[-1] == "--"
    browser.click(head)
    assert browser.column(0) == given
    browser.choose(".filter", "pca")
    assert browser.column(0) == ["PCA"]


def test_charts_are_drawn_and_names_are_text_in_them(browser):
    browser.open("table-rods.html")
    for chart in ("cost", "precision", "classes", "confusion"):
        browser.run("document.querySelector(`[data-chart=${arguments[0]}]`).scrollIntoView()", chart)
        browser.wait("document.querySelector(`[data-chart=${arguments[0]}] .plot[data-drawn]`) !== null", chart)
    assert browser.run("return document.querySelectorAll('img').length") == 0
    assert "<img src=x" in browser.run("return document.querySelector('#scores tbody').textContent")


def test_the_viewer_draws_and_turns_a_form_with_mouse_and_keys(browser):
    browser.open("table-rods-forms.html")
    browser.click("figure:not(.input) .tile")
    browser.wait("document.getElementById('scene').dataset.drawn")
    time.sleep(1)
    before = browser.picture("#scene")
    drawn = (np.ptp(before, axis=2) > 40).mean()
    assert 0.005 < drawn < 0.9
    browser.press("\ue014\ue014\ue014")  # arrow to the right
    time.sleep(1)
    turned = browser.picture("#scene")
    assert (np.abs(turned - before).sum(axis=2) > 60).mean() > 0.005
    browser.click("[data-turn=in]")
    time.sleep(1)
    assert (np.ptp(browser.picture("#scene"), axis=2) > 40).mean() > 1.1 * (np.ptp(turned, axis=2) > 40).mean()
    before = browser.picture("#scene")
    eye = browser.run("return document.getElementById('scene').layout.scene.camera.eye")
    browser.drag("#scene", (-250, 30), (60, 0))
    time.sleep(2)
    assert (np.abs(browser.picture("#scene") - before).sum(axis=2) > 60).mean() > 0.005
    eyes = [browser.run(f"return document.getElementById('scene').layout.{name}.camera.eye") for name in SCENES]
    assert eyes[0] == pytest.approx(eyes[1])
    assert max(abs(eyes[0][axis] - eye[axis]) for axis in "xyz") > 0.1
    first = browser.run("return document.getElementById('scene').dataset.drawn")
    browser.press("n")
    browser.wait("document.getElementById('scene').dataset.drawn !== arguments[0]", first)
    browser.press("\ue00c")  # Escape
    assert not browser.run("return document.getElementById('viewer').open")


def test_the_forms_of_the_gallery_are_pictures(browser):
    browser.open("table-rods-forms.html")
    browser.wait("document.querySelectorAll('.tile').length >= 9")
    time.sleep(0.5)
    assert (np.ptp(browser.picture("figure:not(.input) .poses"), axis=2) > 30).mean() > 0.01


def test_a_query_shows_its_matches_and_a_match_becomes_the_query(browser):
    browser.open("table-rods-queries.html")
    browser.wait("document.querySelectorAll('.match').length")
    hits, misses = (
        browser.run(f"return document.querySelectorAll('.match.{kind}').length") for kind in ("hit", "miss")
    )
    assert (hits, misses) == (3 * 2, 3 * 3)
    marks = browser.run("return [...document.querySelectorAll('.match.miss .mark')].map((mark) => mark.textContent)")
    assert set(marks) == {"✗"}
    browser.press("n")
    browser.wait("document.getElementById('matches').dataset.query === 'thick1'")
    browser.click(".match.miss")
    browser.wait("document.getElementById('matches').dataset.query.startsWith('thin')")
    address = browser.run("return location.hash")
    browser.open(f"table-rods-queries.html{address}")
    browser.wait("document.getElementById('matches').dataset.query?.startsWith('thin')")
    browser.open("table-rods-queries.html#%/100%")  # no address of ours
    browser.wait("document.getElementById('matches').dataset.query === 'thick0'")
    assert (np.ptp(browser.picture(".query .thumb"), axis=2) > 30).mean() > 0.01


def test_a_search_says_when_nothing_was_found(browser):
    browser.open("table-rods.html")
    for words, said in (("xyz", 'No row that is shown is called "xyz".'), ("pca", "")):
        browser.choose(".filter", words)
        assert browser.run("return document.querySelector('#scores .nothing').textContent") == said
    browser.open("table-rods-queries.html")
    browser.wait("document.getElementById('matches').dataset.query === 'thick0'")
    for words, said in (("xyz", 'No shape of this gallery is called "xyz".'), ("thin1", "")):
        browser.choose("#query-name", words)
        assert browser.run("return document.getElementById('query-none').textContent") == said
    browser.wait("document.getElementById('matches').dataset.query === 'thin1'")


def test_the_widest_table_and_its_commands_fit_a_desk_and_no_label_covers_another(driver, tmp_path):
    """Table I, with three groups of columns, spreads and long titles."""
    from click.testing import CliRunner

    from benchmark.cli.main import cli

    made = CliRunner().invoke(
        cli, ["report", "-t", "I", "--published", "--results", str(ROOT / "results"), "-o", str(tmp_path)]
    )
    assert made.exit_code == 0, made.output
    browser = Browser(driver, tmp_path)
    for name in ("index.html", "table-I-humans.html"):
        browser.open(name)
        wide = "(each) => each.scrollWidth <= each.clientWidth"
        assert browser.run(f"return [...document.querySelectorAll('.frame, pre, .missing, .card')].every({wide})")
    browser.run("document.querySelector('[data-chart=cost]').scrollIntoView()")
    browser.wait("document.querySelector('[data-chart=cost] .plot[data-drawn]') !== null")
    labels = browser.run(
        "const inside = document.querySelector('[data-chart=cost] .plot').getBoundingClientRect();"
        "return [...document.querySelectorAll('[data-chart=cost] .textpoint text')].filter((each) => each.textContent)"
        ".map((each) => each.getBoundingClientRect()).map((r) => [r.left - inside.left, inside.right - r.right,"
        " r.left, r.right, r.top + 3, r.bottom - 3])"
    )
    assert len(labels) > 15
    assert min(min(left, right) for left, right, *_ in labels) >= 0
    for k, (*_, left, right, top, bottom) in enumerate(labels):
        for *_, other_left, other_right, other_top, other_bottom in labels[:k]:
            is_beside = right <= other_left or other_right <= left
            assert is_beside or bottom <= other_top or other_bottom <= top


@pytest.mark.parametrize("name", PAGES)
def test_a_phone_needs_no_sideways_scroll_of_the_page(browser, name):
    browser.open(name, PHONE)
    time.sleep(0.5)
    assert browser.run("return document.documentElement.scrollWidth") <= PHONE[0]
    wide = "(frame) => frame.getBoundingClientRect().right <= innerWidth + 1"
    assert browser.run(f"return [...document.querySelectorAll('.frame')].every({wide})")


def test_light_and_dark_follow_the_system_until_they_are_chosen(browser):
    def brightness():
        return browser.picture("header").mean()

    browser.open("index.html")
    light = brightness()
    browser.open("index.html", dark=True)
    dark = brightness()
    assert light > 200 > 80 > dark
    browser.click("#theme")
    assert brightness() > 200
    browser.open("table-rods.html", dark=True, fresh=False)
    assert brightness() > 200
