"""A page in a real browser: the machine's Chromium, without a window, driven by a script beside the page.

The page is shown in a frame of an outer page, both from a server on this machine, so that the outer page's
script may look into it and work it, while the page's own policy stays in force. One Chromium serves all tests of a
process, as its start takes longer than a page; each page is shown in a profile of its own, which is new.
"""

import atexit
import base64
import itertools
import json
import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
NO_CHROMIUM = "no Chromium here: apt install chromium (tools/install-chromium.sh does it where it may)"
SECONDS = 120
OPTIONS = (
    "--headless",
    "--no-sandbox",  # it has none as root, and shows nothing but our own file
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--remote-debugging-pipe",
)
OUTER = """<!doctype html><meta charset="utf-8"><body style="margin:0">
<iframe id="page" %(sandbox)s style="border:0;width:%(width)dpx;height:900px"></iframe>
<script>
const frame = document.getElementById("page");
const told = new Promise((tell) => frame.addEventListener("load", async () => {
  try {
    tell(JSON.stringify(await (async (page, window) => { %(script)s })(frame.contentDocument, frame.contentWindow)));
  } catch (error) { tell(JSON.stringify({ error: String(error.stack) })); }
}));
frame.src = "index.html";
</script>"""


class _Quiet(SimpleHTTPRequestHandler):
    """Serves a folder, and keeps what was asked for to itself."""

    asked: list[str]

    def log_message(self, *_: Any) -> None:
        self.server.asked.append(self.path)


@contextmanager
def serve_folder(folder: Path) -> Iterator[ThreadingHTTPServer]:
    """The folder at http://127.0.0.1:PORT/; ``asked`` lists the paths that were asked for."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder))) as server:
        server.asked = []
        threading.Thread(target=partial(server.serve_forever, 0.01), daemon=True).start()
        try:
            yield server
        finally:
            server.shutdown()


class _Chromium:
    """A browser that is told what to do by the Chrome DevTools Protocol over a pair of pipes."""

    def __init__(self) -> None:
        self._profile = tempfile.mkdtemp(prefix="chromium-")
        (asked, ask), (tell, told) = os.pipe(), os.pipe()
        # It reads from descriptor 3 and writes to 4; a shell puts our pipes there.
        words = [CHROMIUM or NAMES[0], *OPTIONS, f"--user-data-dir={self._profile}"]
        shell = ["sh", "-c", f'exec "$@" 3</dev/fd/{asked} 4>/dev/fd/{told}', "sh", *words]
        quiet: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
        self._process = subprocess.Popen(shell, pass_fds=(asked, told), stderr=subprocess.DEVNULL, **quiet)
        os.close(asked)
        os.close(told)
        self._ask, self._told = os.fdopen(ask, "wb", buffering=0), os.fdopen(tell, "rb")
        self._numbers = itertools.count(1)
        self._events: list[tuple[str | None, str]] = []
        atexit.register(self.close)

    def close(self) -> None:
        """End it, and delete its profile."""
        self._process.kill()
        self._process.wait()
        self._ask.close()
        self._told.close()
        shutil.rmtree(self._profile, ignore_errors=True)

    def call(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """The result of a method of the protocol."""
        number = next(self._numbers)
        asked = {"id": number, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        self._ask.write(json.dumps(asked).encode() + b"\0")
        while (message := self._read()).get("id") != number:
            self._note(message)
        assert "error" not in message, (method, message["error"])
        return message["result"]

    def wait_for(self, event: str, session: str) -> None:
        """Return when this event has happened in the session."""
        while (session, event) not in self._events:
            self._note(self._read())
        self._events.remove((session, event))

    def _note(self, message: dict[str, Any]) -> None:
        if "method" in message:
            self._events.append((message.get("sessionId"), message["method"]))

    def _read(self) -> dict[str, Any]:
        late = threading.Timer(SECONDS, self._process.kill)  # the pipe then ends
        late.start()
        try:
            text = bytearray()
            while not text.endswith(b"\0"):
                piece = self._told.peek()
                assert piece, f"Chromium has ended, or was silent for {SECONDS} s"
                text += self._told.read(piece.find(b"\0") + 1 or len(piece))
        finally:
            late.cancel()
        return json.loads(text[:-1])


@cache
def _start_chromium() -> _Chromium:
    return _Chromium()


@contextmanager
def show_page(address: str, *, width: int = 1200, dark: bool = False) -> Iterator[partial]:
    """A tab with this page, loaded, in a profile of its own: what calls a method of the protocol in it."""
    chromium = _start_chromium()
    profile = chromium.call("Target.createBrowserContext")["browserContextId"]
    try:
        tab = chromium.call("Target.createTarget", url="about:blank", browserContextId=profile)["targetId"]
        session = chromium.call("Target.attachToTarget", targetId=tab, flatten=True)["sessionId"]
        size = {"width": max(width, 500), "height": 1000, "deviceScaleFactor": 1, "mobile": False}
        chromium.call("Emulation.setDeviceMetricsOverride", session, **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        chromium.call("Emulation.setEmulatedMedia", session, features=[scheme])
        chromium.call("Emulation.setFocusEmulationEnabled", session, enabled=True)
        chromium.call("Page.enable", session)
        chromium.call("Page.navigate", session, url=address)
        chromium.wait_for("Page.loadEventFired", session)
        yield partial(chromium.call, session=session)
    finally:
        chromium.call("Target.disposeBrowserContext", browserContextId=profile)


def run_in_page(folder: Path, script: str, *, width: int = 1200, scripts: bool = True, dark: bool = False) -> Any:
    """What ``script`` returns of the page in ``folder``, where it knows it as ``page`` and ``window``.

    ``width`` of the page in pixels; without ``scripts`` the page's own do not run; ``dark`` is what the reader
    prefers. The page may ask the server for nothing but itself.
    """
    sandbox = "" if scripts else 'sandbox="allow-same-origin"'
    outer = folder / "outer.html"
    outer.write_text(OUTER % {"sandbox": sandbox, "width": width, "script": script}, encoding="utf-8")
    with serve_folder(folder) as server:
        address = f"http://127.0.0.1:{server.server_address[1]}/outer.html"
        with show_page(address, width=width, dark=dark) as call:
            told = call("Runtime.evaluate", expression="told", awaitPromise=True, returnByValue=True)
        asked = [path for path in server.asked if path != "/favicon.ico"]
    answer = json.loads(told["result"]["value"])
    assert not (isinstance(answer, dict) and "error" in answer), answer["error"]
    assert asked == ["/outer.html", "/index.html"]
    return answer


def print_page(page: Path) -> bytes:
    """The page on paper, as a PDF file."""
    with show_page(page.as_uri()) as call:
        return base64.b64decode(call("Page.printToPDF")["data"])
