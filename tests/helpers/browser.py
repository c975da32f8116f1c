"""A page in a real browser: the machine's Chromium, without a window, driven by a script beside the page.

The page is shown in a frame of an outer page, both from a server on this machine, so that the outer page's
script may look into it and work it, while the page's own policy stays in force.
"""

import html
import json
import re
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
NO_CHROMIUM = "no Chromium here: apt install chromium (tools/install-chromium.sh does it where it may)"
SECONDS = 120
OUTER = """<!doctype html><meta charset="utf-8"><body style="margin:0">
<iframe id="page" src="index.html" %(sandbox)s style="border:0;width:%(width)dpx;height:900px"></iframe>
<pre id="told"></pre>
<script>
const frame = document.getElementById("page");
const tell = (what) => { document.getElementById("told").textContent = JSON.stringify(what); };
frame.addEventListener("load", async () => {
  try {
    tell(await (async (page, window) => { %(script)s })(frame.contentDocument, frame.contentWindow));
  } catch (error) { tell({ error: String(error.stack) }); }
});
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
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield server
        finally:
            server.shutdown()


def run_chromium(*options: str, profile: Path) -> str:
    """What Chromium prints with these options, without any other host to reach."""
    always = [
        "--headless",
        "--no-sandbox",  # it has none as root, and shows nothing but our own file
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--no-first-run",
        "--disable-background-networking",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
        f"--user-data-dir={profile}",
    ]
    done = subprocess.run(
        [CHROMIUM or NAMES[0], *always, *options], capture_output=True, text=True, timeout=SECONDS, check=True
    )
    return done.stdout


def run_in_page(
    folder: Path, script: str, *, profile: Path, width: int = 1200, scripts: bool = True, flags: tuple = ()
) -> Any:
    """What ``script`` returns of the page in ``folder``, where it knows it as ``page`` and ``window``.

    ``width`` of the page in pixels; without ``scripts`` the page's own do not run. Beside the answer, as
    ``asked``, what the browser asked the server for.
    """
    sandbox = "" if scripts else 'sandbox="allow-same-origin"'
    outer = folder / "outer.html"
    outer.write_text(OUTER % {"sandbox": sandbox, "width": width, "script": script}, encoding="utf-8")
    with serve_folder(folder) as server:
        address = f"http://127.0.0.1:{server.server_address[1]}/outer.html"
        size = f"--window-size={max(width, 500)},1000"
        shown = run_chromium("--dump-dom", "--virtual-time-budget=20000", size, *flags, address, profile=profile)
        asked = [path for path in server.asked if path != "/favicon.ico"]
    found = re.search(r'<pre id="told">(.*?)</pre>', shown, flags=re.DOTALL)
    assert found is not None, shown[-2000:]
    assert found[1], "the page was not loaded in time"
    answer = json.loads(html.unescape(found[1]))
    assert not (isinstance(answer, dict) and "error" in answer), answer["error"]
    assert asked == ["/outer.html", "/index.html"]
    return answer
