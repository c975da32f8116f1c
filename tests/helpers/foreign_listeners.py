"""What may listen at an address that should be a Dask scheduler's, on the loopback interface."""

import http.server
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


def says(data: bytes) -> Callable[[socket.socket], None]:
    """Return a handler that sends ``data`` and then waits."""

    def handle(connection: socket.socket) -> None:
        connection.sendall(data)
        time.sleep(60)

    return handle


def drips(connection: socket.socket) -> None:
    while True:
        connection.sendall(b"\1")
        time.sleep(0.1)


HANDLERS: dict[str, Callable[[socket.socket], None]] = {
    "silent": lambda connection: time.sleep(60),
    "closes": lambda connection: connection.close(),
    "ssh": says(b"SSH-2.0-OpenSSH_9.6\r\n"),
    "noise": says(os.urandom(4096)),
    "zeros": says(bytes(4096)),
    "announces a petabyte": says((1 << 50).to_bytes(8, "little")),
    "drips": drips,
}


@contextmanager
def listener(kind: str) -> Iterator[str]:
    """Yield the address, ``tcp://127.0.0.1:PORT``, of one of HANDLERS, of ``http``, or of ``nothing``."""
    if kind == "http":
        server = http.server.HTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler)
        server.RequestHandlerClass.log_message = lambda *_: None  # type: ignore[method-assign]
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield f"tcp://127.0.0.1:{server.server_port}"
        server.shutdown()
        server.server_close()
        return
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        if kind == "nothing":
            server.close()
        else:
            threading.Thread(target=_serve, args=(server, HANDLERS[kind]), daemon=True).start()
        yield address


def _serve(server: socket.socket, handle: Callable[[socket.socket], None]) -> None:
    def run(connection: socket.socket) -> None:
        with suppress(OSError), connection:
            handle(connection)

    while True:
        try:
            connection, _ = server.accept()
        except OSError:  # the test is over
            return
        threading.Thread(target=run, args=(connection,), daemon=True).start()
