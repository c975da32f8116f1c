"""A web server for the files of a folder, in a thread of this process."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote


class _Handler(SimpleHTTPRequestHandler):
    """Breaks off its first answers of a file as ``breaks`` states."""

    server: Any

    def log_message(self, *_: object) -> None:
        pass

    def do_GET(self) -> None:
        name = unquote(self.path).strip("/")
        path = Path(self.directory) / name
        self.server.requests.append(name)
        if not path.is_file():
            self.send_error(404)
            return
        content = path.read_bytes()
        self.send_response(200)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        left = self.server.breaks.get(name, 0)
        self.server.breaks[name] = left - 1
        self.wfile.write(content[:1000] if left > 0 else content)


@contextmanager
def serve(folder: Path, *, breaks: Mapping[str, int] | None = None) -> Iterator[tuple[Any, str]]:
    """Yield a server, whose ``requests`` are the names of files so far, and its address."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, directory=str(folder))) as server:
        server.requests, server.breaks = [], dict(breaks or {})  # type: ignore[attr-defined]
        threading.Thread(target=partial(server.serve_forever, 0.01), daemon=True).start()
        try:
            yield server, f"http://127.0.0.1:{server.server_address[1]}"
        finally:
            server.shutdown()
