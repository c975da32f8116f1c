"""Shows a page in the machine's headless Chromium and runs a script on it.

A server on this machine serves the page and an outer page, which shows it in a frame. The script runs in the outer
page: it can read and operate the page, whose content security policy stays in force. All tests of a process share
one Chromium and one outer page, because starting them takes longer than loading a page. Each page gets a new frame
and an empty storage.
"""

import atexit
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
    "--no-sandbox",  # root has no sandbox, and only our own file is shown
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

RUN = """(async () => {
  try {
    return JSON.stringify(await (async () => { %s })());
  } catch (error) {
    return JSON.stringify({ error: String(error.stack) });
  }
})()"""


class _Quiet(SimpleHTTPRequestHandler):
    """Serves the outer page and the server's current folder, and records requests instead of printing them."""

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
    """Serves ``folder`` at http://127.0.0.1:PORT/; ``asked`` lists the requested paths."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Quiet)
        self.folder = Path()
        self.asked: list[str] = []
        threading.Thread(target=partial(self.serve_forever, 0.01), daemon=True).start()


class _Chromium:
    """A browser that is controlled by the Chrome DevTools Protocol over a pair of pipes."""

    def __init__(self) -> None:
        self._profile = tempfile.mkdtemp(prefix="chromium-")
        (asked, ask), (tell, told) = os.pipe(), os.pipe()
        # Chromium reads from descriptor 3 and writes to 4; a shell connects them to our pipes.
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
        """End the browser and delete its profile."""
        self._process.kill()
        self._process.wait()
        self._ask.close()
        self._told.close()
        shutil.rmtree(self._profile, ignore_errors=True)

    def call(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        number = next(self._numbers)
        asked = {"id": number, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        self._ask.write(json.dumps(asked).encode() + b"\0")
        while (message := self._read()).get("id") != number:
            self._note(message)
        assert "error" not in message, (method, message["error"])
        return message["result"]

    def wait_for(self, event: str, session: str) -> None:
        """Wait until this event has happened in the session."""
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
    """Load this page in a new tab with a new profile; return a function that calls a protocol method in the tab."""
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
    """Open the outer page once per process; return its server and a function that calls protocol methods in its tab."""
    server = _Server()
    return server, _open_tab(f"http://127.0.0.1:{server.server_address[1]}/outer.html")


def run_in_page(folder: Path, script: str, *, width: int = 1200, scripts: bool = True, dark: bool = False) -> Any:
    """Return the result of ``script``, which sees the page in ``folder`` as ``page`` and ``window``.

    ``width`` is in pixels. If ``scripts`` is false, the page's own scripts do not run. ``dark`` sets the reader's
    preferred colour scheme. A page that requests anything but itself from the server fails the test.
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


def run_at(address: str, script: str, *, width: int = 1200, dark: bool = False) -> Any:
    """Return the result of ``script`` in a page that a server of this machine serves, in a new tab.

    The script sees ``document`` and ``window``; see :func:`run_in_page` for the parameters.
    """
    call = _open_tab(address)
    call("Emulation.setDeviceMetricsOverride", width=width, height=1000, deviceScaleFactor=1, mobile=False)
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    call("Emulation.setEmulatedMedia", features=[scheme])
    try:
        told = call("Runtime.evaluate", expression=RUN % script, awaitPromise=True, returnByValue=True)
    finally:
        call("Page.navigate", url="about:blank")  # a page that goes on asking its server would take a core
    answer = json.loads(told["result"]["value"])
    assert not (isinstance(answer, dict) and "error" in answer), answer["error"]
    return answer
