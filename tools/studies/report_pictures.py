"""``python -m tools.studies.report_pictures REPORT -o docs/images/report``: pictures of a report for its page.

The report is one of a run with Tables I and III, ``tosca`` for the latter; it needs Debian's chromium.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tools.browser import PHONE, Browser, chromium

#: White between pictures that stand side by side, in pixels.
GAP = 16

#: A window that shows a whole chart, in pixels.
TALL = (1400, 1300)


@click.command()
@click.argument("report", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("-o", "--output", type=click.Path(file_okay=False, path_type=Path), required=True)
def main(report: Path, output: Path) -> None:
    """Take the pictures of REPORT."""
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile)) as driver:
        browser = Browser(driver, report)
        for name, picture in pictures(browser):
            image = Image.fromarray(picture.astype(np.uint8))
            image.quantize(256, dither=Image.Dither.NONE).save(output / f"{name}.png", optimize=True)
            print(output / f"{name}.png", *image.size)
        if said := browser.complaints():
            raise click.ClickException(f"the console says: {said[0]}")


def pictures(browser: Browser) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Name and pixels of each picture."""
    browser.open("index.html")
    yield "overview", shot(browser)
    browser.open("table-III-tosca.html", (1400, 800))
    yield "scores", shot(browser)
    browser.open("table-III-tosca.html", TALL)
    yield "cost", chart(browser, "cost")
    browser.open("table-I-humans.html", TALL)
    yield "attraction", chart(browser, "attraction")
    browser.open("table-III-tosca-forms.html")
    yield "forms", shot(browser)
    browser.open("table-I-humans-forms.html", (1160, 840), dark=True)
    yield "viewer", viewer(browser)
    browser.open("table-III-tosca-queries.html", (1400, 920))
    yield "queries", query(browser, "cat4")
    browser.open("table-III-tosca-queries.html#0//classic-mds/least-squares-mds/DCG", (1400, 920))
    yield "differences", differences(browser)
    yield "phone", side_by_side(list(on_a_phone(browser)))


def on_a_phone(browser: Browser) -> Iterator[NDArray[np.int64]]:
    """Scores, forms, the viewer, a query and where two methods differ, 390 pixels wide, light and dark."""
    browser.open("table-I-humans.html", PHONE)
    yield shot(browser)
    browser.open("table-III-tosca-forms.html", PHONE, dark=True)
    yield shot(browser)
    browser.open("table-I-humans-forms.html", PHONE, dark=True)
    yield viewer(browser)
    browser.open("table-III-tosca-queries.html", PHONE)
    yield query(browser, "cat4")
    browser.open("table-III-tosca-queries.html#0//classic-mds/least-squares-mds/DCG", PHONE, dark=True)
    yield differences(browser)


def shot(browser: Browser) -> NDArray[np.int64]:
    """The window, when its pictures have come."""
    browser.wait("[...document.images].every((image) => image.complete)")
    time.sleep(1)
    return browser.picture()


def chart(browser: Browser, name: str) -> NDArray[np.int64]:
    """The section of a chart."""
    browser.run("document.querySelector(`[data-chart=${arguments[0]}]`).closest('section').scrollIntoView()", name)
    browser.wait("document.querySelector(`[data-chart=${arguments[0]}] .plot[data-drawn]`) !== null", name)
    browser.run("document.querySelector('header').style.position = 'static'")  # else it lies over what is below
    time.sleep(1)
    return browser.picture(f"section:has([data-chart={name}])")


def viewer(browser: Browser) -> NDArray[np.int64]:
    """The viewer: the last pose of the first subject in the form that keeps most detail."""
    browser.click("figure:not(.input) .tile:last-child")
    browser.wait("document.getElementById('scene').dataset.drawn")
    browser.choose("#viewer-method", "mesh-unfolding")
    time.sleep(3)
    return browser.picture()


def query(browser: Browser, shape: str) -> NDArray[np.int64]:
    """The nearest matches of a shape on complete surfaces."""
    browser.choose("#query-name", shape)
    browser.wait("document.getElementById('matches').dataset.query === arguments[0]", shape)
    return shot(browser)


def differences(browser: Browser) -> NDArray[np.int64]:
    """The queries on which two methods differ most."""
    browser.wait("document.querySelector('.pair') !== null")
    return shot(browser)


def side_by_side(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Pictures of one height beside each other."""
    gap = np.full((parts[0].shape[0], GAP, 3), 255)
    return np.concatenate([each for part in parts for each in (part, gap)][:-1], axis=1)


if __name__ == "__main__":
    main()
