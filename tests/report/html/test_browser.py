"""The report in a browser: Debian's chromium without a screen, the report opened from its folder."""

import functools
import itertools
import re
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import contents
from benchmark.report.html import forms
from benchmark.report.html.pages import write_report
from benchmark.report.pictures import posing
from benchmark.report.pictures.painting import painted
from benchmark.report.results import Results
from tests.records import failed
from tests.report.html.browser import CHROMIUM, DESK, DRIVER, PHONE, Browser, chromium
from tests.report.html.made_up import REFUSED, write_made_up
from tests.toy import rod, write_rods
from tests.verbs import call

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs Debian's packages chromium and chromium-driver"),
]

ROOT = Path(__file__).parents[3]

SCENES = ("scene", "scene2")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The report of a small run: two methods that make forms, a descriptor, and a failure with a name from outside."""
    base = tmp_path_factory.mktemp("site")
    write_rods(base / "rods")
    results = base / "results"
    chosen = ["-m", "identity", "-m", "pca", "-m", "surface-area"]
    call("run", "-d", base / "rods", "--executor", "serial", "--results", results, *chosen)
    store = Store.open(results)
    example = next(iter(store.records))
    name = "<img src=x onerror=alert(1)>"
    store.write_record(
        failed("crashed", name, method="fell", title=name, gallery=example["gallery"], data=example["data"])
    )
    known = methods()
    artefacts = ArtefactReader(store, known)
    written = write_report(contents(Results(store, known).all()), artefacts, base / "report", "report")
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
    call("report", "-t", "I", "--published", "--results", ROOT / "results", "-o", tmp_path)
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


# Large, by keyboard, readable ----------------------------------------------------------------------------------------

TAB, ENTER, LEFT, RIGHT, DOWN = "\ue004", "\ue007", "\ue012", "\ue014", "\ue015"

#: Pages of a report of 400 shapes and 20 methods, each with what shows that it is there.
LARGE = {
    "index.html": "document.querySelectorAll('.card').length === 1",
    "table-rods.html": "document.querySelectorAll('#scores tbody tr').length === 21",
    "table-rods-forms.html": "document.querySelectorAll('.tile').length > 20",
    "table-rods-queries.html": "document.querySelectorAll('.match').length === 95",
    "table-rods-queries.html#0/s3-p3/method-0/method-19/DCG": "document.querySelectorAll('.pair').length === 20",
}


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    """400 shapes and 20 methods; one picture stands for all of a size, since drawing 8000 takes minutes."""
    drawn = functools.cache(lambda size: painted(*rod_picture(), size, 1.0))
    folder = tmp_path_factory.mktemp("large")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forms, "painted", lambda _points, _faces, _values, size, _half: drawn(size))
        patch.setattr(posing, "upright", lambda form, *_: form.vertices)
        assert write_made_up(folder, (20, 20, 20)).n_ranked == 20
    return folder


def rod_picture():
    mesh = rod(0.2, 1.2)
    return mesh.vertices - mesh.vertices.mean(axis=0), mesh.faces, None


def processor_seconds(driver):
    """Processor time that all processes of the browser have taken so far."""
    processes = psutil.Process(driver.service.process.pid).children(recursive=True)
    return sum(sum(each.cpu_times()[:2]) for each in processes if each.is_running())


@pytest.mark.parametrize("size", [DESK, PHONE])
def test_400_shapes_and_20_methods_open_in_two_seconds(driver, large, size):
    """Processor-seconds of all processes of the browser: what a clock says hangs on what else the machine does."""
    browser = Browser(driver, large)
    for name, is_there in LARGE.items():
        browser.open("index.html", size)
        driver.get("about:blank")
        time.sleep(0.5)
        before = processor_seconds(driver)
        driver.get(f"file://{large}/{name}")
        browser.wait(is_there)
        assert processor_seconds(driver) - before < 2, name
        assert browser.run("return document.documentElement.scrollWidth") <= size[0]
    assert browser.complaints() == []


def test_queries_on_which_two_methods_differ_come_most_first_and_are_filtered(driver, large):
    browser = Browser(driver, large)
    browser.open("table-rods-queries.html")
    browser.wait("document.querySelectorAll('.match').length")
    browser.choose("#query-view", "two")
    for name, value in (("first", "method-0"), ("second", "method-18"), ("measure", "FT")):
        browser.choose(f"#query-{name}", value)
    browser.wait("document.getElementById('matches').dataset.query === 'method-0|method-18|FT'")

    def differences():
        told = browser.run("return [...document.querySelectorAll('article h3 > span')].map((each) => each.textContent)")
        pairs = [each.partition("; FT ")[2].split(" → ") for each in told if "; FT " in each]
        return [abs(float(first) - float(second)) for first, second in pairs]

    shown = differences()
    assert len(shown) == 20
    assert shown[0] > 0.5
    assert all(before > after - 0.011 for before, after in itertools.pairwise(shown))  # two decimals are shown
    browser.click("#matches > button")
    assert len(differences()) == 40
    assert browser.run("return document.querySelector('.pair').querySelectorAll('.form').length") == 3
    assert browser.run("return document.querySelector('.pair').querySelectorAll('.match').length") == 10
    address = browser.run("return location.hash")
    browser.choose("#query-class", "s7")
    browser.wait("/ of 20 queries differ/.test(document.getElementById('query').textContent)")
    browser.choose("#query-pose", "p4")
    browser.wait("/ of 1 queries differ/.test(document.getElementById('query').textContent)")
    browser.choose("#query-view", "one")
    browser.wait("document.getElementById('matches').dataset.query === 's7-p4'")
    browser.open(f"table-rods-queries.html{address}")  # the address names the methods and the measure
    browser.wait("document.getElementById('matches').dataset.query === 'method-0|method-18|FT'")
    assert browser.complaints() == []


def test_a_shape_without_a_form_has_its_reason_and_so_has_a_method_that_crashed(driver, large):
    browser = Browser(driver, large)
    browser.open("table-rods-queries.html#0/s0-p0")
    browser.wait("document.getElementById('matches').dataset.query === 's0-p0'")
    reasons = browser.run("return [...document.querySelectorAll('.why')].map((each) => each.textContent)")
    assert reasons == [REFUSED, "crashed: it <b>fell</b>"]
    forms = "return document.querySelectorAll('.side .form .thumb:not(.none)').length"
    assert browser.run(forms) == 18
    browser.press("n")
    browser.wait("document.getElementById('matches').dataset.query === 's0-p1'")
    assert browser.run(forms) == 19
    assert browser.complaints() == []


def test_the_queries_are_read_with_the_keyboard_alone(driver, large):
    browser = Browser(driver, large)
    browser.open("table-rods-queries.html#0/s3-p3")
    browser.wait("document.getElementById('matches').dataset.query === 's3-p3'")
    at = "return document.activeElement.id || document.activeElement.className"
    passed = []
    while "match" not in browser.run(at) and len(passed) < 25:
        browser.press(TAB)
        passed.append(browser.run(at))
        told = browser.run(
            "const style = getComputedStyle(document.activeElement);"
            "return [parseFloat(style.outlineWidth), style.outlineStyle]"
        )
        assert told[0] >= 2, passed
        assert told[1] != "none"
    wanted = ["query-view", "query-class", "query-pose", "query-name", "query-before", "query-next"]
    assert [each for each in passed if each in wanted] == wanted
    place = (
        "const [row, item] = ['.row', 'li'].map((each) => document.activeElement.closest(each));"
        "return [row, item].map((each) => [...each.parentNode.children].indexOf(each))"
    )
    places = []
    for key in (RIGHT, RIGHT, DOWN, LEFT):
        browser.press(key)
        places.append(browser.run(place))
    assert places == [[0, 1], [0, 2], [1, 2], [1, 1]]
    browser.press(TAB)  # one stop for each row
    assert browser.run(place) == [2, 0]
    name = browser.run("return document.activeElement.title.split(':')[0]")
    browser.press(ENTER)
    browser.wait("document.getElementById('matches').dataset.query === arguments[0]", name)
    assert browser.run(at) == "query"
    browser.press("n")
    browser.wait("document.getElementById('matches').dataset.query !== arguments[0]", name)
    assert browser.complaints() == []


#: Texts whose colour is too near to that of their ground [WCAG 2.2, 1.4.3], as the browser has computed both.
PALE = """
const pen = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
const rgba = (text) => {
  pen.clearRect(0, 0, 1, 1); pen.fillStyle = text; pen.fillRect(0, 0, 1, 1);
  const [r, g, b, a] = pen.getImageData(0, 0, 1, 1).data;
  return [r, g, b, a / 255];
};
const over = (top, below) => [0, 1, 2].map((n) => top[3] * top[n] + (1 - top[3]) * below[n]);
const linear = (part) => (part <= 10.31 ? part / 255 / 12.92 : ((part / 255 + 0.055) / 1.055) ** 2.4);
const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b) + 0.05;
const contrast = (a, b) => Math.max(light(a) / light(b), light(b) / light(a));
const ground = (element) => {
  const below = element.parentElement ? ground(element.parentElement) : [255, 255, 255];
  return over(rgba(getComputedStyle(element).backgroundColor), below);
};
const found = new Set();
const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (texts.nextNode()) {
  const element = texts.currentNode.parentElement;
  const hidden = "script, svg, option, [hidden], dialog:not([open])";
  if (!texts.currentNode.data.trim() || element.closest(hidden)) continue;
  const style = getComputedStyle(element);
  const size = parseFloat(style.fontSize);
  const least = size >= 24 || (size >= 18.66 && style.fontWeight >= 700) ? 3 : 4.5;
  const value = contrast(over(rgba(style.color), ground(element)), ground(element));
  if (value < least) found.add(`${element.tagName}.${element.className} ${value.toFixed(2)} ${element.textContent}`);
}
for (const button of document.querySelectorAll(".match")) {
  const value = contrast(rgba(getComputedStyle(button).borderTopColor), ground(button));
  if (value < 3) found.add(`border of ${button.className} ${value.toFixed(2)}`);
}
const accent = getComputedStyle(document.documentElement).getPropertyValue("--accent");
const focus = contrast(rgba(accent), ground(document.body));
if (focus < 3) found.add(`focus ${focus}`);
return [...found];
"""


@pytest.mark.parametrize("dark", [False, True])
def test_every_text_can_be_read_and_all_that_can_be_used_has_a_name(driver, large, dark):
    browser = Browser(driver, large)
    for name, is_there in LARGE.items():
        browser.open(name, dark=dark)
        browser.wait(is_there)
        assert browser.run(PALE) == [], name
        for node in driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]:
            properties = {each["name"]: each["value"].get("value") for each in node.get("properties", [])}
            if properties.get("focusable") and node["role"]["value"] != "RootWebArea":
                assert re.search(r"\w", node["name"].get("value", "")), (name, node["role"]["value"])
    assert browser.complaints() == []
