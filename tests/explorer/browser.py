"""A headless Chromium, driven by its DevTools protocol."""

import itertools
import json
import shutil
import subprocess
import time
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
PATIENCE = 60  # s for one answer, on a machine with other work


class Page:
    """One tab: asks, and keeps what the page says to the console."""

    def __init__(self, address: str) -> None:
        import websocket

        self.socket = websocket.create_connection(address, timeout=PATIENCE, suppress_origin=True)
        self.numbers, self.complaints, self.loaded = itertools.count(1), [], False
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")
        self.requests: list[str] = []

    def _listen(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self.socket.recv())
        name, told = message.get("method"), message.get("params", {})
        if name == "Runtime.exceptionThrown":
            self.complaints.append(told["exceptionDetails"]["exception"].get("description", "exception"))
        elif name == "Log.entryAdded" or (name == "Runtime.consoleAPICalled" and told["type"] != "log"):
            self.complaints.append(json.dumps(told))
        elif name == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
        elif name == "Page.loadEventFired":
            self.loaded = True
        return message

    def ask(self, method: str, **params: Any) -> Any:
        """The answer to a command."""
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while (message := self._listen()).get("id") != number:
            pass
        assert "error" not in message, (method, message)
        return message["result"]

    def open(self, path: Path, width: int, height: int, dark: bool = False, touch: bool = False) -> None:
        """Load a file at a size of the window, in points."""
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=touch,
        )
        self.ask("Emulation.setTouchEmulationEnabled", enabled=touch)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", features=[scheme])
        self.loaded, self.complaints, self.requests = False, [], []
        self.ask("Page.navigate", url=path.resolve().as_uri())
        while not self.loaded:
            self._listen()

    def run(self, script: str) -> Any:
        """The value of an expression, or of the promise that it is."""
        answer = self.ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def mouse(self, kind: str, x: float, y: float) -> None:
        """A mouse event: Pressed, Moved or Released."""
        held = 0 if kind == "Released" else 1
        self.ask(
            "Input.dispatchMouseEvent",
            type=f"mouse{kind}",
            x=x,
            y=y,
            button="left",
            buttons=held,
            clickCount=1,
        )

    def key(self, key: str) -> None:
        """A key, pressed and released."""
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, **(text if kind == "keyDown" else {}))

    def picture(self, path: Path, whole: bool = True) -> None:
        """A picture of the page, of all of it or of what the window shows."""
        shot = self.ask("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(b64decode(shot["data"]))


@contextmanager
def chromium(folder: Path) -> Iterator[Page]:
    """A browser with a profile in a folder of its own; ends with the block."""
    assert CHROMIUM is not None
    profile = folder / "profile"
    options = [f"--user-data-dir={profile}", "--remote-debugging-port=0", "--remote-allow-origins=*"]
    process = subprocess.Popen(
        [CHROMIUM, *FLAGS, *options, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        port, until = profile / "DevToolsActivePort", time.monotonic() + PATIENCE
        while not port.exists() or len(port.read_text().split()) < 2:
            assert process.poll() is None and time.monotonic() < until, "Chromium does not start"
            time.sleep(0.05)
        number = port.read_text().split()[0]
        with urlopen(f"http://127.0.0.1:{number}/json") as answer:
            (tab,) = [t for t in json.load(answer) if t["type"] == "page"]
        page = Page(tab["webSocketDebuggerUrl"])
        yield page
        page.ask("Browser.close")
    finally:
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
