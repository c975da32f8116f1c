"""Servers and datasets of strangers, for ``saf-gen fetch``: whatever they send, one line within 20 seconds.

``python tests/robustness/hostile_servers.py --count 200 --seed 1`` starts servers that answer in ways drawn at random,
and honest servers of datasets with damaged files or hostile manifests. It ends with 1 if a fetch raises anything
but BadInput, is silent for 20 seconds, writes outside its folder, or leaves what is no dataset.
"""

import argparse
import json
import shutil
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import saf_gen
from saf_gen.errors import BadInput
from saf_gen.stream.dataset import index_folder
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.sharing import fetch_dataset, server

SILENCE_S = 20.0
Answer = Callable[[socket.socket, str, bytes], None]


def _send(connection: socket.socket, head: str, body: bytes = b"") -> None:
    connection.sendall(head.replace("\n", "\r\n").encode("latin-1") + b"\r\n\r\n" + body)


def _chunked(size: str) -> Answer:
    def answer(connection: socket.socket, path: str, content: bytes) -> None:
        _send(connection, "HTTP/1.1 200 OK\nTransfer-Encoding: chunked", f"{size}\r\n".encode() + content[:100])

    return answer


def _head(head: str, body: bytes = b"") -> Answer:
    return lambda connection, path, content: _send(connection, head, body)


def _raw(data: bytes) -> Answer:
    return lambda connection, path, content: connection.sendall(data)


def _drip(connection: socket.socket, path: str, content: bytes) -> None:
    _send(connection, f"HTTP/1.1 200 OK\nContent-Length: {len(content)}")
    for byte in content:
        connection.sendall(bytes([byte]))
        time.sleep(0.05)


def _drip_head(connection: socket.socket, path: str, content: bytes) -> None:
    for byte in b"HTTP/1.1 200 OK\r\nX-Long: " + b"a" * 10_000:
        connection.sendall(bytes([byte]))
        time.sleep(0.05)


def _silence(connection: socket.socket, path: str, content: bytes) -> None:
    time.sleep(60)


def _endless(connection: socket.socket, path: str, content: bytes) -> None:
    _send(connection, "HTTP/1.1 200 OK")
    while True:
        connection.sendall(bytes(1 << 16))


def _redirect(to: str) -> Answer:
    return _head(f"HTTP/1.1 302 Found\nLocation: {to}\nContent-Length: 0")


ANSWERS: dict[str, Answer] = {
    **{f"a chunk of size {size:.20}": _chunked(size) for size in ("-1", "zz", "f" * 20, "", "0x10", "1;" + "a" * 9000)},
    **{
        f"a redirect to {to:.30}": _redirect(to)
        for to in ("http://[::1", "ftp://127.0.0.1/x", "file:///etc/passwd", "javascript:1",
                   "http://" + "a" * 300 + ".com/", "http://a..b/", "//", "", "http://127.0.0.1:99999/",
                   "http://127.0.0.1:1/",
                   "\\x", "http://xn--zzzzzz/", "gopher://x", "data:text/plain,x", "/manifest.json", "http://user:pw@[::ffff:1.2.3.4/")
    },
    "a negative length": _head("HTTP/1.1 200 OK\nContent-Length: -5", b"x"),
    "two lengths": _head("HTTP/1.1 200 OK\nContent-Length: 5\nContent-Length: 7", b"xxxxx"),
    "a length of words": _head("HTTP/1.1 200 OK\nContent-Length: many", b"x"),
    "a huge length": _head(f"HTTP/1.1 200 OK\nContent-Length: {10**30}", b"x"),
    "a short body": _head("HTTP/1.1 200 OK\nContent-Length: 5000", b"x"),
    "no status": _raw(b"hello\r\n\r\n"),
    "another protocol": _raw(b"SSH-2.0-OpenSSH_9.6\r\n"),
    "zeros": _raw(bytes(5000)),
    "nothing": _raw(b""),
    "a status of 999": _head("HTTP/1.1 999 What"),
    "a status of 0": _head("HTTP/1.1 0 What"),
    "a status of words": _head("HTTP/1.1 abc What"),
    "a partial answer": _head("HTTP/1.1 206 Partial\nContent-Range: bytes 5-9/10\nContent-Length: 5", b"xxxxx"),
    "a wrong range": _head("HTTP/1.1 206 Partial\nContent-Range: lines all\nContent-Length: 2", b"{}"),
    "an early hint": _head("HTTP/1.1 103 Early Hints"),
    "a switch": _head("HTTP/1.1 101 Switching Protocols\nUpgrade: x"),
    "many headers": _head("HTTP/1.1 200 OK\n" + "\n".join(f"X-{n}: {n}" for n in range(20_000))),
    "a long header": _head("HTTP/1.1 200 OK\nX-Long: " + "a" * 2_000_000),
    "a header with a zero": _raw(b"HTTP/1.1 200 OK\r\nX: a\0b\r\n\r\n"),
    "a compressed body": _head("HTTP/1.1 200 OK\nContent-Encoding: gzip\nContent-Length: 9", b"\x1f\x8b\x08zzzzzz"),
    "a body of noise": _head("HTTP/1.1 200 OK\nContent-Length: 300", bytes(range(256)) + b"x" * 44),
    "JSON of another kind": _head("HTTP/1.1 200 OK\nContent-Length: 7", b'{"x":1}'),
    "deep JSON": _head("HTTP/1.1 200 OK", b"[" * 100_000),
    "a number of many digits": _head("HTTP/1.1 200 OK", b'{"format": ' + b"1" * 100_000 + b"}"),
    "an error": _head("HTTP/1.1 404 Not Found\nContent-Length: 0"),
    "an error of the server": _head("HTTP/1.1 503 Busy\nContent-Length: 0"),
    "a body that drips": _drip,
    "a head that drips": _drip_head,
    "silence": _silence,
    "an endless body": _endless,
}  # fmt: skip

ADDRESSES = (
    "http://[::1", "http://" + "a" * 64 + ".example/", "http://" + "a." * 200 + "b/", "http://a..b/x", "http://", "http:///x",
    "https://:80/", "http://127.0.0.1:0/", "http://127.0.0.1:99999/x", "http://127.0.0.1:port/", "ftp://a/b", "file:///etc",
    "http://a b/", "http://\u0000/", "http://exa\nmple/", "http://xn--0/", "http://[v1.x]/", "http://%zz/", "http://1.2.3.4.5/",
    "http://user@:pw@/", "ssh://x", "://", "http://\ud800/", "http://[fe80::1%25eth0]/", "http://127.0.0.1/?a=b", "http://0/",
)  # fmt: skip


@contextmanager
def serve(answer: Answer, files: dict[str, bytes], only: str) -> Iterator[str]:
    """Serve files; a request for the file ``only`` ("" for any) gets the hostile answer."""
    listener = socket.create_server(("127.0.0.1", 0))

    def work(connection: socket.socket) -> None:
        with connection:
            try:
                path = connection.recv(65536).split(b" ", 2)[1].decode().strip("/")
                content = files.get(path, b"")
                if path == only or not only:
                    answer(connection, path, content)
                else:
                    _send(connection, f"HTTP/1.1 200 OK\nContent-Length: {len(content)}", content)
            except (OSError, IndexError, UnicodeError):
                return

    def accept() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=work, args=(connection,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        listener.close()


def make_published(folder: Path) -> dict[str, bytes]:
    """Return the files of a dataset of two small streams, by name."""
    rng = np.random.default_rng(3)
    for name in ("train/a-constant-00", "test/b-constant-00"):
        saf_gen.write_stream(folder / f"{name}.h5", rng.integers(0, 2, (200, 24, 32), dtype=np.uint8))
    index_folder(folder)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


NAMES = (
    "../../evil.h5", "/tmp/evil.h5", "a/../../evil.h5", "C:\\evil.h5", "C:evil.h5", "con.h5", "a/NUL", "a./b.h5", "a ",
    "manifest.json", "Manifest.JSON", "folder of the other", "the other in capitals", ".fetch/a.h5", "a\0b", "a" * 300,
    "", ".", ".ssh", "a//b",
    "sequences.csv", "readme.md", "com\u00b9.h5",
)  # fmt: skip
VALUES = (-1, 0, 1, 10**400, 1 << 61, "1", None, True, 1.5, [], "0" * 64, "../x", "F" * 64)


def hostile_dataset(random: np.random.Generator, files: dict[str, bytes]) -> tuple[str, dict[str, bytes]]:
    """Return what is hostile, and the files of a dataset of which one differs, under a manifest without a checksum."""
    manifest = json.loads(files["manifest.json"])
    del manifest["checksum"]
    changed, number = dict(files), int(random.integers(2))
    one, kind = manifest["files"][number], str(random.choice(KINDS))
    data = bytearray(files[one["file"]])
    if kind == "flipped bits":
        for at in random.integers(len(data), size=20):
            data[at] ^= 1 << int(random.integers(8))
    elif kind == "cut":
        data = data[: int(random.integers(len(data)))]
    elif kind == "longer":
        data += random.bytes(1 << int(random.integers(20)))
    elif kind == "noise":
        data = bytearray(random.bytes(len(data)))
    changed[one["file"]] = bytes(data)
    if kind == "a name":
        other = manifest["files"][1 - number]["file"]
        taken = {"folder of the other": other.split("/")[0], "the other in capitals": other.upper()}
        name = NAMES[int(random.integers(len(NAMES)))]
        name = taken.get(name, name)
        next(entry for entry in manifest["sequences"] if entry["file"] == one["file"])["file"] = name
        changed[name], one["file"] = bytes(data), name
    elif kind == "a value":
        one[str(random.choice(["bytes", "sha256", "file"]))] = VALUES[int(random.integers(len(VALUES)))]
    elif kind == "a file twice":
        manifest["files"].append(dict(one))
    elif kind == "no sequence":
        manifest["files"].append({**one, "file": "evil.py"})
    elif kind == "no digest":
        del manifest["files"][number]
    elif kind == "a name of the dataset":
        manifest["name"] = str(random.choice(["../x", "/tmp/x", "NUL", "", "a" * 200, ".", "a\nb"]))
    changed["manifest.json"] = json.dumps(manifest).encode()
    if kind == "a manifest of another kind":
        changed["manifest.json"] = b'{"x": 1}'
    elif kind == "a manifest of noise":
        changed["manifest.json"] = random.bytes(500)
    return kind, changed


KINDS = ("nothing", "flipped bits", "cut", "longer", "noise", "a name", "a value", "a file twice", "no digest",
         "no sequence", "a name of the dataset", "a manifest of another kind", "a manifest of noise")  # fmt: skip


def _answer(connection: socket.socket, path: str, content: bytes) -> None:
    _send(connection, f"HTTP/1.1 200 OK\nContent-Length: {len(content)}", content)


def attempt(source: str, root: Path, whole: dict[str, bytes]) -> str:
    """Fetch, and return ``refused`` or ``read``, or what is wrong."""
    out, heard = root / "deep" / "out", [time.monotonic()]
    silence = [0.0]

    def hear(*_: object) -> None:
        silence[0] = max(silence[0], time.monotonic() - heard[0])
        heard[0] = time.monotonic()

    try:
        fetch_dataset(source, out, report=hear, tell=hear)
        ended = "read"
    except BadInput as error:
        ended = "refused" if "\n" not in str(error) else f"WRONG: two lines: {error}"
    except BaseException as error:  # noqa: BLE001  this is what is looked for
        ended = f"WRONG: {type(error).__name__}: {error}"
    hear()
    if silence[0] > SILENCE_S:
        ended = f"WRONG: silent for {silence[0]:.1f} s"
    outside = [path for path in root.rglob("*") if path.is_file() and not path.is_relative_to(out)]
    if outside or Path("/tmp/evil.h5").exists():
        ended = f"WRONG: wrote {outside}"
    if ended == "refused" and (out / "manifest.json").exists():
        ended = "WRONG: left a manifest"
    if ended == "read":
        read_manifest(out)
        streams = {path.name: path.read_bytes() for path in out.rglob("*.h5")}
        ended = "read" if streams == whole else "WRONG: other streams"
    shutil.rmtree(root / "deep", ignore_errors=True)
    return ended


def run(count: int, seed: int, say: Callable[[str], None] = print) -> Counter[str]:
    """Try ``count`` servers and as many datasets; return how many were refused, read, and wrong."""
    random, totals = np.random.default_rng(seed), Counter[str]()
    server.WAIT_S = 0.1
    with TemporaryDirectory() as temporary:
        base = Path(temporary)
        files = make_published(base / "made")
        whole = {path.name: path.read_bytes() for path in (base / "made").rglob("*.h5")}
        (base / "try").mkdir()
        slow = {name for name, answer in ANSWERS.items() if answer in (_drip, _drip_head, _silence)}
        for number in range(count):
            if number < len(ADDRESSES):
                what, ended = ADDRESSES[number], attempt(ADDRESSES[number], base / "try", whole)
            else:
                names = [name for name in ANSWERS if name not in slow or number % 50 == 0]
                what, only = (
                    str(random.choice(names)),
                    str(random.choice(["", "manifest.json", "test/b-constant-00.h5", "README.md"])),
                )
                with serve(ANSWERS[what], files, only) as address:
                    ended = attempt(address, base / "try", whole)
            totals[ended[:5] if ended.startswith("WRONG") else ended] += 1
            if ended.startswith("WRONG"):
                say(f"server, {what!r:.60}: {ended}")
        for _ in range(count):
            what, changed = hostile_dataset(random, files)
            with serve(_answer, changed, "") as address:
                ended = attempt(address, base / "try", whole)
            totals[ended[:5] if ended.startswith("WRONG") else ended] += 1
            if ended.startswith("WRONG"):
                say(f"dataset, {what}: {ended}")
    return totals


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    totals = run(options.count, options.seed)
    print(", ".join(f"{count} {name}" for name, count in sorted(totals.items())))
    sys.exit(bool(totals["WRONG"]))


if __name__ == "__main__":
    main()
