"""Chromium without a window, driven over two pipes by its DevTools protocol: nothing to install for it."""

import fcntl
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = "--headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking --disable-sync "
FLAGS += "--disable-component-update --disable-extensions --hide-scrollbars --remote-debugging-pipe"
WAIT = 60  # s for one answer


class Page:
    """The one page of a browser, and what it has complained of."""

    def __init__(self, to: IO[bytes], answers: IO[bytes]) -> None:
        self.to, self.answers, self.number = to, answers, 0
        self.session: str | None = None
        self.complaints: list[str] = []
        self.loaded = False
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **values: Any) -> Any:
        """Send a command, and return its result once it is there."""
        self.number += 1
        session = {} if self.session is None else {"sessionId": self.session}
        message = {"id": self.number, "method": method, "params": values} | session
        self.to.write(json.dumps(message).encode() + b"\0")
        self.to.flush()
        while (answer := self._next()).get("id") != self.number:
            pass
        assert "error" not in answer, answer
        return answer["result"]

    def _next(self) -> dict[str, Any]:
        content = bytearray()
        while (byte := self.answers.read(1)) != b"\0":
            assert byte, "the browser has ended"
            content += byte
        message: dict[str, Any] = json.loads(content)
        told, values = message.get("method"), message.get("params", {})
        self.loaded = self.loaded or told == "Page.loadEventFired"
        if told == "Log.entryAdded" and values["entry"]["level"] in ("error", "warning"):
            self.complaints.append(values["entry"]["text"])
        if told in ("Runtime.exceptionThrown", "Network.loadingFailed"):
            self.complaints.append(json.dumps(values)[:300])
        if told == "Runtime.consoleAPICalled" and values["type"] in ("error", "warning", "assert"):
            self.complaints.append(json.dumps(values["args"])[:300])
        return message

    def visit(self, url: str) -> None:
        """Load a page to its end."""
        self.loaded = False
        self.ask("Page.navigate", url=url)
        started = time.monotonic()
        while not self.loaded:
            assert time.monotonic() - started < WAIT
            self._next()

    def look(self, width: int, scheme: str) -> None:
        """Show the page at a width (CSS pixels), with light or dark colours."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        self.ask("Emulation.setDeviceMetricsOverride", **size)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.ask("Emulation.setEmulatedMedia", features=[feature])

    def value(self, expression: str) -> Any:
        """What an expression of JavaScript gives, as JSON."""
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")


@contextmanager
def browser() -> Iterator[Page]:
    """A browser with nothing but a profile of its own, for as long as it is needed."""
    (read_by_it, to), (answers, written_by_it) = os.pipe(), os.pipe()
    with tempfile.TemporaryDirectory() as profile:
        given = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (read_by_it, written_by_it)]  # none is 3 or 4
        line = (
            f'exec "{CHROMIUM}" {FLAGS} --user-data-dir="{profile}" 3</dev/fd/{given[0]} 4>/dev/fd/{given[1]}'
        )
        process = subprocess.Popen(["sh", "-c", line], pass_fds=given, stderr=subprocess.DEVNULL)
        for descriptor in (*given, read_by_it, written_by_it):
            os.close(descriptor)
        try:
            with os.fdopen(to, "wb") as sent, os.fdopen(answers, "rb") as received:
                yield Page(sent, received)
        finally:
            process.terminate()
            process.wait()
