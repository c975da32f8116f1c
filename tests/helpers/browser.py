"""A page in a real browser: the machine's Chromium, without a window, driven by a script beside the page.

The page is shown in a frame of an outer page, both from a server on this machine, so that the outer page's
script may look into it and work it, while the page's own policy stays in force. One Chromium and one outer page
serve all tests of a process, as their start takes longer than a page; each page is shown in a frame of its own,
which is new, and finds nothing stored by the one before.
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
OUTER = b'<!doctype html><meta charset="utf-8"><body style="margin:0">'
SHOWN = """(async () => {
  localStorage.clear();
  sessionStorage.clear();
  const frame = document.createElement("iframe");
  if (!%(scripts)s) frame.sandbox = "allow-same-origin";
  frame.style = "border:0;width:%(width)dpx;height:900px";
  frame.src = "index.html";
  const loaded = new Promise((done) => frame.addEventListener("load", done, { once: true }));
  document.body.append(frame);
  await loaded;
  try {
    return JSON.stringify(await (async (page, window) => { %(script)s })(frame.contentDocument, frame.contentWindow));
  } catch (error) {
    return JSON.stringify({ error: String(error.stack) });
  } finally { frame.remove(); }
})()"""


class _Quiet(SimpleHTTPRequestHandler):
    """Serves the outer page and the server's folder of the moment, and keeps what was asked for to itself."""

    server: "_Server"

    def do_GET(self) -> None:
        self.directory = str(self.server.folder)
        if self.path != "/outer.html":
            return super().do_GET()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(OUTER)

    def end_headers(self) -> None:
        self.send_header("Cache-Control", "no-store")
        super().end_headers()

    def log_message(self, *_: Any) -> None:
        self.server.asked.append(self.path)


class _Server(ThreadingHTTPServer):
    """``folder`` at http://127.0.0.1:PORT/; ``asked`` lists the paths that were asked for."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Quiet)
        self.folder = Path()
        self.asked: list[str] = []
        threading.Thread(target=partial(self.serve_forever, 0.01), daemon=True).start()


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


def _open_tab(address: str) -> partial:
    """A tab with this page, loaded, in a profile of its own: what calls a method of the protocol in it."""
    chromium = _start_chromium()
    profile = chromium.call("Target.createBrowserContext")["browserContextId"]
    tab = chromium.call("Target.createTarget", url="about:blank", browserContextId=profile)["targetId"]
    session = chromium.call("Target.attachToTarget", targetId=tab, flatten=True)["sessionId"]
    chromium.call("Emulation.setFocusEmulationEnabled", session, enabled=True)
    chromium.call("Page.enable", session)
    chromium.call("Page.navigate", session, url=address)
    chromium.wait_for("Page.loadEventFired", session)
    return partial(chromium.call, session=session)


@cache
def _open_outer_page() -> tuple[_Server, partial]:
    """The outer page, which stays open for all tests of a process: its server, and what calls a method in its tab."""
    server = _Server()
    return server, _open_tab(f"http://127.0.0.1:{server.server_address[1]}/outer.html")


def run_in_page(folder: Path, script: str, *, width: int = 1200, scripts: bool = True, dark: bool = False) -> Any:
    """What ``script`` returns of the page in ``folder``, where it knows it as ``page`` and ``window``.

    ``width`` of the page in pixels; without ``scripts`` the page's own do not run; ``dark`` is what the reader
    prefers. The page may ask the server for nothing but itself.
    """
    server, call = _open_outer_page()
    server.folder, server.asked = folder, []
    call("Emulation.setDeviceMetricsOverride", width=max(width, 500), height=1000, deviceScaleFactor=1, mobile=False)
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    call("Emulation.setEmulatedMedia", features=[scheme])
    shown = SHOWN % {"scripts": json.dumps(scripts), "width": width, "script": script}
    told = call("Runtime.evaluate", expression=shown, awaitPromise=True, returnByValue=True)
    answer = json.loads(told["result"]["value"])
    assert not (isinstance(answer, dict) and "error" in answer), answer["error"]
    assert [path for path in server.asked if path != "/favicon.ico"] == ["/index.html"]
    return answer


def print_page(page: Path) -> bytes:
    """The page on paper, as a PDF file."""
    call = _open_tab(page.as_uri())
    printed = call("Page.printToPDF")["data"]
    call("Page.close")
    return base64.b64decode(printed)
