"""Headless Chromium for the tests of pages, where the machine has one.

Without it they are skipped, or fail if the environment variable JFSF_BROWSER is
"required".
"""

import base64
import io
import os
import shutil
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",  # WebGL by software
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)
PHONE = {"width": 390, "height": 844, "pixelRatio": 2.0, "touch": True}

MISSING = CHROMIUM is None or DRIVER is None
NEEDED = "needs chromium and chromedriver (apt-get install chromium chromium-driver)"
REQUIRED = os.environ.get("JFSF_BROWSER") == "required"

needs_chromium = pytest.mark.skipif(MISSING and not REQUIRED, reason=NEEDED)


class Page:
    """A page in a browser of its own."""

    def __init__(self, driver):
        """driver: of selenium."""
        self.driver = driver

    def one(self, selector):
        """The element."""
        return self.driver.find_element("css selector", selector)

    def all(self, selector):
        """The elements."""
        return self.driver.find_elements("css selector", selector)

    def run(self, script):
        """What a script returns."""
        return self.driver.execute_script(script)

    def errors(self):
        """What the page has complained of so far."""
        found = self.driver.get_log("browser")
        return [entry["message"] for entry in found if entry["level"] == "SEVERE"]

    def click(self, selector, x=0.5, y=0.5):
        """Click at a share of an element's width and height."""
        from selenium.webdriver.common.action_chains import ActionChains

        target = self.one(selector)
        self.run(f"document.querySelector('{selector}').scrollIntoView()")
        size = target.size
        at = round((x - 0.5) * size["width"]), round((y - 0.5) * size["height"])
        ActionChains(self.driver).move_to_element_with_offset(
            target, *at
        ).click().perform()

    def drag(self, selector, right):
        """Drag an element by so many pixels."""
        from selenium.webdriver.common.action_chains import ActionChains

        target = self.one(selector)
        self.run(f"document.querySelector('{selector}').scrollIntoView()")
        chain = ActionChains(self.driver).move_to_element(target).click_and_hold()
        chain.move_by_offset(right, 0).release().perform()

    def pixels(self, selector):
        """The colours (h, w, 4) of a canvas, transparent where nothing is drawn."""
        self.settle()
        script = f"return document.querySelector('{selector}').toDataURL()"
        data = base64.b64decode(self.run(script).partition(",")[2])
        image = matplotlib.image.imread(io.BytesIO(data), format="png")
        return np.rint(255 * image).astype(int)

    def settle(self):
        """Wait until all that waits for a frame is drawn."""
        self.driver.execute_async_script(
            "const done = arguments[0];"
            "requestAnimationFrame(() => requestAnimationFrame(() => done()));"
        )


def opened(path: Path, profile: Path, phone: bool = False, flags=()):
    """Generator of one `Page`, for a fixture; flags are further ones of Chromium."""
    from selenium import webdriver

    if MISSING:
        pytest.fail(NEEDED)
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM or ""
    size = "--window-size=1280,900"
    for flag in (*FLAGS, *flags, size, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    if phone:
        options.add_experimental_option("mobileEmulation", {"deviceMetrics": PHONE})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = webdriver.ChromeService(executable_path=DRIVER)
    driver = webdriver.Chrome(options=options, service=service)
    try:
        driver.get(path.absolute().as_uri())
        yield Page(driver)
    finally:
        driver.quit()
