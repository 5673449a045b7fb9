"""A real browser, driven: headless Chromium, its console, and what it asked the network for."""

import importlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from typing import Any

Driver = Any
"""selenium.webdriver.Chrome, which only the environment of the system tests has."""


@contextmanager
def chromium(profile: Path, *, size: tuple[int, int] = (1280, 900)) -> Iterator[Driver]:
    """Chromium without a screen; its profile goes into a folder of its own."""
    webdriver = importlib.import_module("selenium.webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = which("chromium") or "chromium"
    for flag in ("headless", "no-sandbox", "disable-gpu", "disable-dev-shm-usage"):
        options.add_argument(f"--{flag}")
    options.add_argument(f"--user-data-dir={profile}")
    options.add_argument("--window-size={},{}".format(*size))
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(which("chromedriver")))
    try:
        driver.get("about:blank")
        driver.get_log("performance")  # of the browser's own first page
        yield driver
    finally:
        driver.quit()


def complaints(driver: Driver) -> list[str]:
    """What the console said since it was last asked."""
    return [entry["message"] for entry in driver.get_log("browser")]


def requested(driver: Driver) -> list[str]:
    """Every address that was asked for since this was last called."""
    messages = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    return [
        message["params"]["request"]["url"]
        for message in messages
        if message["method"] == "Network.requestWillBeSent"
    ]
