"""A real headless Chromium."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from selenium.webdriver import ActionChains, Chrome, ChromeOptions, ChromeService
from selenium.webdriver.support.wait import WebDriverWait

# The flags under which Chromium runs as root, without a GPU, and without looking for anything on the network.
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--hide-scrollbars",
)
PATIENCE = 300.0  # seconds after which a browser counts as hung, on a machine however busy


def missing() -> str | None:
    """What has to be installed for a browser, or None."""
    absent = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    return f"{' and '.join(absent)} not installed: apt-get install chromium chromium-driver" if absent else None


class Browser:
    """One window of a Chromium."""

    def __init__(self, driver: Chrome) -> None:
        self._driver = driver

    def open(self, path: Path) -> None:
        self._driver.get(path.resolve().as_uri())

    def size(self, width: int, height: int) -> None:
        """Set what the page has, not what the window has around it."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def medium(self, name: str) -> None:
        """Lay the page out as for ``print``; an empty name is the screen again."""
        self._driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": name})

    def run(self, script: str, *arguments: object) -> Any:
        return self._driver.execute_script(script, *arguments)

    def until(self, script: str) -> None:
        """Wait until a script gives something true."""
        WebDriverWait(self._driver, PATIENCE, 0.05).until(lambda _: self.run(script), f"never came true: {script}")

    def press(self, key: str) -> None:
        """Press a key on whatever has the focus."""
        ActionChains(self._driver).send_keys(key).perform()

    def log(self) -> list[str]:
        """Errors and warnings of the console."""
        entries = self._driver.get_log("browser")  # type: ignore[no-untyped-call]
        return [entry["message"] for entry in entries]

    def picture(self, path: Path, *, whole: bool = True) -> None:
        answer = self._driver.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": whole})
        path.write_bytes(base64.b64decode(answer["data"]))


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A fresh Chromium with an empty profile in ``profile``; its driver ends with the block."""
    options = ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    # A named driver: Selenium looks for none on the network.
    with Chrome(options, ChromeService(shutil.which("chromedriver"))) as driver:
        yield Browser(driver)


def choose(window: Browser, name: str, value: str) -> None:
    """Set a control of the page to a value, as somebody would who picks it."""
    window.run(
        "const e = document.getElementById(arguments[0]); e.value = arguments[1]; e.dispatchEvent(new Event('change'))",
        name,
        value,
    )
