"""Debian's chromium without a screen, opening the pages of a report from their folder."""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")

#: Seconds until something that was waited for counts as never come.
PATIENCE = 60
PHONE, DESK = (390, 844), (1400, 1000)


@contextmanager
def chromium(profile: Path) -> Iterator[Any]:
    """A browser of its own, which reaches no network.

    Parameters
    ----------
    profile
        Folder for what it keeps.

    Raises
    ------
    ImportError
        Without the Python package selenium.
    """
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in (
        "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars", f"--user-data-dir={profile}",
        "--enable-unsafe-swiftshader", "--use-angle=swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND",
    ):  # fmt: skip
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        yield driver
    finally:
        driver.quit()


class Browser:
    """Opens pages of one report, and does on them what a reader does.

    Parameters
    ----------
    driver
        From :func:`chromium`.
    site
        Folder of the report.
    """

    def __init__(self, driver: Any, site: Path) -> None:
        self.driver, self.site = driver, site
        self.run = driver.execute_script
        self.complaints()  # of other pages

    def open(self, name: str, size: tuple[int, int] = DESK, dark: bool = False, fresh: bool = True) -> None:
        """Open a page in a window of some size, with nothing chosen before if it is to be fresh."""
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        self.driver.get("about:blank")  # the address behind # alone would load nothing anew
        self.driver.get(f"file://{self.site.resolve()}/{name}")
        if fresh:
            self.run("localStorage.clear(); delete document.documentElement.dataset.theme")

    def wait(self, script: str, *arguments: object) -> Any:
        """What a script says as soon as that is true of the page."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if value := self.run(f"return {script}", *arguments):
                return value
            time.sleep(0.1)
        raise AssertionError(f"never true: {script}; {self.complaints()}")

    def click(self, selector: str) -> None:
        """Click an element as soon as it is there."""
        self.wait("document.querySelector(arguments[0]) !== null", selector)
        self.run("document.querySelector(arguments[0]).click()", selector)

    def choose(self, selector: str, value: str) -> None:
        """Give a field a value, as a reader who picks or types it."""
        self.wait("document.querySelector(arguments[0]) !== null", selector)
        self.run(
            "let field = document.querySelector(arguments[0]); field.value = arguments[1];"
            "field.dispatchEvent(new Event('input')); field.dispatchEvent(new Event('change'))",
            selector,
            value,
        )

    def press(self, keys: str) -> None:
        """Press keys."""
        from selenium.webdriver import ActionChains

        ActionChains(self.driver).send_keys(keys).perform()

    def drag(self, selector: str, start: tuple[int, int], by: tuple[int, int]) -> None:
        """Drag from a point beside the middle of an element, in pixels."""
        from selenium.webdriver import ActionChains
        from selenium.webdriver.common.by import By

        place = self.driver.find_element(By.CSS_SELECTOR, selector)
        chain = ActionChains(self.driver).move_to_element_with_offset(place, *start).click_and_hold()
        chain.move_by_offset(by[0] // 2, by[1] // 2).move_by_offset(by[0] // 2, by[1] // 2).release().perform()

    def column(self, number: int) -> list[str]:
        """Texts of a column of the scores, as far as it is shown."""
        rows = "[...document.querySelectorAll('#scores tbody tr')].filter((row) => !row.hidden)"
        return list(self.run(f"return {rows}.map((row) => row.cells[{number}].textContent)"))

    def picture(self, selector: str = "") -> NDArray[np.int64]:
        """Pixels of an element, or of the window; (height, width, 3), 0 to 255."""
        from selenium.webdriver.common.by import By

        shot = self.driver.find_element(By.CSS_SELECTOR, selector).screenshot_as_png if selector else None
        png = shot or self.driver.get_screenshot_as_png()
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)

    def complaints(self) -> list[str]:
        """What the console said since it was last asked."""
        lines = self.driver.get_log("browser")
        return [line["message"] for line in lines if line["level"] in ("SEVERE", "ERROR")]
