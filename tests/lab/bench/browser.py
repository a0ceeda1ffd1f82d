"""A real headless Chromium, driven over the WebDriver protocol (W3C) with the standard library alone."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
STARTED = re.compile(r"started successfully on port (\d+)")


def missing() -> str | None:
    """What has to be installed for a browser, or None."""
    absent = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    return f"{' and '.join(absent)} not installed: apt-get install chromium chromium-driver" if absent else None


class Browser:
    """One window of a Chromium."""

    def __init__(self, address: str, session: str) -> None:
        self._base = f"{address}/session/{session}"

    def _send(self, path: str, body: object = None, method: str = "POST") -> Any:
        return send(f"{self._base}/{path}", body, method)

    def open(self, path: Path) -> None:
        self._send("url", {"url": path.resolve().as_uri()})

    def size(self, width: int, height: int) -> None:
        """Set what the page has, not what the window has around it."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._send("goog/cdp/execute", {"cmd": "Emulation.setDeviceMetricsOverride", "params": metrics})

    def medium(self, name: str) -> None:
        """Lay the page out as for ``print``; an empty name is the screen again."""
        self._send("goog/cdp/execute", {"cmd": "Emulation.setEmulatedMedia", "params": {"media": name}})

    def run(self, script: str, *arguments: object) -> Any:
        return self._send("execute/sync", {"script": script, "args": list(arguments)})

    def until(self, script: str, seconds: float = PATIENCE) -> None:
        """Wait until a script gives something true."""
        end = time.monotonic() + seconds
        while not self.run(script):
            assert time.monotonic() < end, f"never came true: {script}"
            time.sleep(0.05)

    def press(self, key: str) -> None:
        """Press a key on whatever has the focus."""
        actions = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self._send("actions", {"actions": [{"type": "key", "id": "keyboard", "actions": actions}]})

    def log(self) -> list[str]:
        """Errors and warnings of the console."""
        return [entry["message"] for entry in self._send("se/log", {"type": "browser"})]

    def picture(self, path: Path, *, whole: bool = True) -> None:
        parameters = {"cmd": "Page.captureScreenshot", "params": {"captureBeyondViewport": whole}}
        path.write_bytes(base64.b64decode(self._send("goog/cdp/execute", parameters)["data"]))

    def close(self) -> None:
        send(self._base, method="DELETE")


def send(address: str, body: object = None, method: str = "POST") -> Any:
    data = None if method == "DELETE" else json.dumps(body or {}).encode()
    request = urllib.request.Request(address, data, {"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        return json.loads(answer.read())["value"]


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A fresh Chromium with an empty profile in ``profile``; its driver ends with the block."""
    log = profile / "chromedriver.log"
    with log.open("wb") as said:  # port 0: the driver takes one that is free
        driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=said, stderr=subprocess.STDOUT)
    try:
        end = time.monotonic() + PATIENCE
        while (started := STARTED.search(log.read_text())) is None:
            assert driver.poll() is None, log.read_text()
            assert time.monotonic() < end, "chromedriver does not start"
            time.sleep(0.05)
        address = f"http://127.0.0.1:{started[1]}"
        options = {"args": [*FLAGS, f"--user-data-dir={profile}"], "binary": shutil.which("chromium")}
        wanted = {"browserName": "chrome", "goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        session = send(f"{address}/session", {"capabilities": {"alwaysMatch": wanted}})["sessionId"]
        window = Browser(address, session)
        try:
            yield window
        finally:
            window.close()
    finally:
        driver.terminate()
        driver.wait(PATIENCE)


def choose(window: Browser, name: str, value: str) -> None:
    """Set a control of the page to a value, as somebody would who picks it."""
    window.run(
        "const e = document.getElementById(arguments[0]); e.value = arguments[1]; e.dispatchEvent(new Event('change'))",
        name,
        value,
    )
