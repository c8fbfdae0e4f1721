"""Debian's chromium, headless, spoken to over its DevTools protocol: pages are opened, asked, clicked and looked at.

Rules of this file: the loopback interface only, a profile of its own, every wait has a bound; what a page writes to its
console as an error, and every exception, is kept for the test to judge.
"""

from __future__ import annotations

import base64
import contextlib
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

CHROMIUM = shutil.which("chromium")
START_S = 30.0
ANSWER_S = 60.0  # a browser without a graphics card, on a machine that has other work
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
    "--remote-debugging-port=0", "--remote-allow-origins=*",
)  # fmt: skip


class Page:
    """One page that is open in a browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self.errors: list[str] = []  # of its console, and exceptions
        self.requested: list[str] = []  # addresses
        self._socket, self._number = socket, 0
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A method's result; AssertionError when the browser refuses it."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        end = time.monotonic() + ANSWER_S
        while True:
            message = json.loads(self._socket.recv(max(0.0, end - time.monotonic())))
            if message.get("id") == self._number:
                assert "error" not in message, (method, message["error"])
                result: dict[str, Any] = message["result"]
                return result
            self._note(message)

    def _note(self, message: dict[str, Any]) -> None:
        method, told = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.errors.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            self.requested.append(told["request"]["url"])

    def size(self, width: int, height: int, scale: float = 1.0) -> None:
        """As wide as a device, px."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale,
                  mobile=width < 600)  # fmt: skip

    def open(self, address: str) -> None:
        """Go there."""
        self.call("Page.navigate", url=address)
        self.wait_for("document.readyState === 'complete'")

    def ask(self, expression: str) -> Any:
        """The value of an expression of JavaScript, awaited."""
        told = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, (expression, told["exceptionDetails"])
        return told["result"].get("value")

    def wait_for(self, expression: str, timeout_s: float = ANSWER_S) -> Any:
        """Its value as soon as it is true; AssertionError with what the page shows when that does not come in time."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            with contextlib.suppress(AssertionError):
                if value := self.ask(expression):
                    return value
            time.sleep(0.05)
        shown = self.ask("document.body.innerText")
        raise AssertionError(f"not within {timeout_s} s: {expression}\n{shown}\n{self.errors}")

    def text(self, selector: str) -> str:
        """What an element shows."""
        return str(self.ask(f"document.querySelector({json.dumps(selector)}).innerText"))

    def click(self, selector: str) -> None:
        """A real click at the middle of an element."""
        where = self.ask(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            " e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        self.drag([tuple(where)])

    def drag(self, points: list[tuple[float, float]]) -> None:
        """Press at the first point, px, move along, let go at the last."""
        self.mouse("mousePressed", *points[0])
        for point in points[1:]:
            self.mouse("mouseMoved", *point)
        self.mouse("mouseReleased", *points[-1])

    def mouse(self, kind: str, x: float, y: float) -> None:
        """One event of the left button, px: mousePressed, mouseMoved or mouseReleased."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def key(self, key: str, code: str = "") -> None:
        """Press a key and let it go."""
        for kind in ("keyDown", "keyUp"):
            written = "\r" if key == "Enter" else key if len(key) == 1 else ""
            text = {"text": written} if kind == "keyDown" and written else {}
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code or key, **text)

    def type(self, selector: str, text: str) -> None:
        """Write into a field."""
        self.ask(f"document.querySelector({json.dumps(selector)}).focus()")
        self.call("Input.insertText", text=text)

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """A picture of what is seen, or of the whole page, as PNG."""
        told = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(told["data"]))


@contextlib.contextmanager
def opened(folder: Path, address: str, width: int = 1280, height: int = 900, scale: float = 1.0) -> Iterator[Page]:
    """A page in a browser of its own, which ends with the block."""
    profile = folder / "profile"
    command = [str(CHROMIUM), *FLAGS, f"--user-data-dir={profile}", "about:blank"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with connect(_debugger(profile), max_size=None, ping_interval=None) as socket:
            page = Page(socket)
            page.size(width, height, scale)
            page.open(address)
            yield page
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _debugger(profile: Path) -> str:
    """Address of the blank page's debugger, once the browser has written where it listens."""
    written, end = profile / "DevToolsActivePort", time.monotonic() + START_S
    while time.monotonic() < end:
        with contextlib.suppress(OSError, ValueError, IndexError):
            port = int(written.read_text().splitlines()[0])
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=5.0) as answer:
                pages = [target for target in json.load(answer) if target["type"] == "page"]
                return str(pages[0]["webSocketDebuggerUrl"])
        time.sleep(0.05)
    raise AssertionError("chromium does not listen")
