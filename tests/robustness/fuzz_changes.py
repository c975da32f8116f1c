"""Ways to corrupt a file: hostile values in its structure, broken text, changed bytes, other kinds of file."""

import copy
import json
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import yaml
from fuzz_samples import repack

from saf_gen.core.config.json_document import CHECKSUM

Rng = Random
NUMBERS = [
    0, -1, 1, 2, -0.0, 0.5, 1e308, -1e308, 5e-324, 1e-320, 2**31, 2**32, 2**53 + 1, 2**63, 2**64, 10**400,
    -(10**400), 1e999, float("nan"), float("inf"), float("-inf"), 3.9999999999999996,
]  # fmt: skip
TEXTS = [
    "", " ", "\n", "\0", "\x1b[2J\x1b]0;t\x07", "\x9b31m", "‮evil", "\ud800", "𝕏" * 9, "é", "=cmd|' /C calc'!A0",
    "@tuned.json", "evil.py:Evil", "evil:Evil", "os:system", "secret.txt", "../secret.txt", "/etc/passwd",
    "/dev/zero", ".", "..", "/", "a/../../b", "<script>alert(1)</script>", "$x$ \\frac{", "{{7*7}}", "%s%n", "NaN",
    "1e5", "0x10", "1_000", "2026-13-01", "true", "null", "sd+argmax", "sd+argmax@frame", "sd", "sweep",
    "constant", "image_distance", "x" * 300, "x" * 100_000, "file:///etc/passwd", "http://127.0.0.1:9/", "\r\n",
    "'", '"', "|", "`", "a\tb", "con", "-", "--help", "~", "*", "&a", "!!python/object:x",
]  # fmt: skip
VALUES: list[Any] = [
    *NUMBERS, *TEXTS, None, True, False, [], {}, [[]], [None], {"": ""}, {"kind": "constant"}, {"uniform": [0, 1]},
    {"uniform": [1, 0]}, {"choice": []}, {"choice": ["a", 1]}, {"log_uniform": [0, 1]},
    {"uniform": [0, float("inf")]}, [0, 1], [1, 0], [0.1] * 5000, {str(n): n for n in range(2000)},
]  # fmt: skip


def change_tree(data: Any, rng: Rng) -> Any:
    """Return plain data in which a few values are replaced, removed, duplicated, moved or added."""
    data = copy.deepcopy(data)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        at = _places(data)
        if not at:
            return rng.choice(VALUES)
        holder, key = rng.choice(at)
        what = rng.random()
        if what < 0.6:
            holder[key] = copy.deepcopy(rng.choice(VALUES))
        elif what < 0.7:
            del holder[key]
        elif what < 0.8:
            other, there = rng.choice(at)
            if there in (other if isinstance(other, dict) else range(len(other))):
                holder[key] = copy.deepcopy(other[there])
        elif isinstance(holder, dict):
            holder[rng.choice(["", "x", f"{key}s", str(key)[:-1], "kind", "\x1b", "__proto__"])] = rng.choice(VALUES)
        else:
            holder.extend(copy.deepcopy(holder[key:]) * rng.choice([1, 5]))
    return data


def _places(data: Any) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        found += [(data, key), *_places(value)]
    return found


def change_yaml(raw: bytes, rng: Rng) -> bytes:
    """Change the values of a YAML file, or append a construct that only YAML has."""
    if rng.random() < 0.25:
        text = raw.decode(errors="replace")
        key = rng.choice([line.split(":")[0].strip() for line in text.splitlines() if ":" in line] or ["x"])
        return (text + "\n" + rng.choice(YAML_TRICKS).replace("KEY", key) + "\n").encode(errors="surrogatepass")
    tree = change_tree(yaml.safe_load(raw), rng)
    dumped = yaml.safe_dump(tree, allow_unicode=rng.random() < 0.5, default_flow_style=rng.choice([True, False, None]))
    return dumped.encode("utf-8", "surrogatepass")


YAML_TRICKS = [
    "KEY: !!python/object/apply:os.system ['touch PLANTED']",
    "KEY: &a [*a]",
    "KEY: {<<: {a: 1}}",
    "a0: &a0 [x,x,x,x,x,x,x,x,x,x]\n"
    + "\n".join(f"a{n}: &a{n} [{','.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)),
    "KEY: " + "[" * 200_000,
    "KEY: " + "{a: " * 5000,
    "? [a, b]\n: 1",
    "KEY: 1" + "0" * 400,
    "KEY: 1" + "0" * 5000,
    "KEY: 1:30:00",
    "KEY: 2026-13-45",
    "KEY: !!binary '/w=='",
    "KEY: !!set {a, b}",
    "KEY: !!timestamp 9",
    "KEY: !!int x",
    "KEY: !!float ''",
    "KEY: 0b2",
    "KEY: 0o9",
    "KEY: .inf",
    "KEY: =",
    "KEY: <<",
    'KEY: "\\uD800"',
    'KEY: "\\x1b[2J"',
    "KEY: |\n " + "x" * 3_000_000,
    "KEY: [" + "1," * 120_000 + "]",
    "--- a\n--- b",
    "%YAML 9.9\n---\na: 1",
    "\tKEY: 1",
    "KEY: *nobody",
    "KEY: !<tag:x> 1",
    "KEY: 190:20:30.15",
    "KEY: 0.1.2",
    "KEY: ~",
]


def change_json(raw: bytes, rng: Rng) -> bytes:
    """Change the values of a JSON file, or those in one line of a JSON Lines file."""
    if not raw.startswith(b"{"):
        return change_bytes(raw, rng)
    lines = raw.decode().splitlines() if raw.count(b"\n{") else [raw.decode()]
    number = rng.randrange(len(lines))
    if rng.random() < 0.15:
        lines[number] = (
            rng.choice(JSON_TRICKS)
            if rng.random() < 0.5
            else lines[number].replace(":", f':{rng.choice(JSON_TRICKS)},"z":', 1)
        )
    else:
        tree = json.loads(lines[number])
        if rng.random() < 0.8:
            tree.pop(CHECKSUM, None)  # older files have no checksum and are still read
        lines[number] = json.dumps(change_tree(tree, rng), ensure_ascii=rng.random() < 0.5)
    if rng.random() < 0.1:
        lines.insert(rng.randrange(len(lines) + 1), rng.choice(lines))
    return "\n".join(lines).encode("utf-8", "surrogatepass")


JSON_TRICKS = [
    "[" * 200_000, '{"a":' * 50_000, "1" * 5000, "1" * 300, "1e99999", "-0", "NaN", "[1,2", '"\\ud800"',
    '"\\u0000"', '{"a":1,"a":2}', "nul", "'x'", "\ufeff{}", '"' + "x" * 1_000_000 + '"',
    "[" + "0," * 300_000 + "0]", "", "{}", "[]", "//", "0x1F", "01", "1.", ".5", "+1",
]  # fmt: skip


def change_text(raw: bytes, rng: Rng) -> bytes:
    """Change words, lines or the encoding of a text."""
    text = raw.decode(errors="replace")
    lines = text.splitlines() or [""]
    at = rng.randrange(len(lines))
    what = rng.randrange(11)
    if what == 0:
        del lines[at]
    elif what == 1:
        lines.insert(at, rng.choice(lines))
    elif what == 2:
        lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
    elif what == 3:
        lines[at] = rng.choice(["\t", " ", "   ", "#", "-"]) + lines[at]
    elif what in (4, 5, 6):
        words = lines[at].replace(",", " , ").replace(":", " : ").replace('"', ' " ').replace("+", " + ").split(" ")
        words[rng.randrange(len(words))] = str(rng.choice([*NUMBERS, *TEXTS]))
        lines[at] = "".join(words) if rng.random() < 0.5 else " ".join(words)
    elif what == 7:
        return text.encode(rng.choice(["utf-16", "utf-32", "utf-8-sig", "utf-16-be"]))
    elif what == 8:
        lines = [f"{line}\r" for line in lines]
    elif what == 9:
        lines[at] = lines[at] * rng.choice([2, 100])
    else:
        lines = lines[at:]
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def change_bytes(raw: bytes, rng: Rng) -> bytes:
    """Flip bits, write extreme integers, and insert, delete or zero bytes; most changes are near the beginning."""
    data = bytearray(raw) or bytearray(b"\0")
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        size = len(data)
        at = rng.randrange(size) if rng.random() < 0.5 else rng.randrange(min(size, 600))
        what = rng.randrange(9)
        if what <= 1:
            data[at] ^= 1 << rng.randrange(8)
        elif what == 2:
            data[at] = rng.choice([0, 0xFF, 0x7F, 0x80])
        elif what == 3:
            value = rng.choice([0, 1, 2**31 - 1, 2**32 - 1, 2**16, 2**24, 0x80000000])
            data[at : at + 4] = struct.pack(rng.choice("<>") + "I", value)
        elif what == 4:
            data[at : at + 8] = struct.pack("<Q", rng.choice([2**63, 2**64 - 1, 2**40, 2**32]))
        elif what == 5:
            del data[at:]
        elif what == 6:
            data[at:at] = bytes(rng.randrange(256) for _ in range(rng.choice([1, 8, 100])))
        elif what == 7:
            del data[at : at + rng.choice([1, 4, 512])]
        else:
            data[at : at + 64] = bytes(min(64, size - at))
        data = data or bytearray(b"\0")
    return bytes(data)


def flip_bit(raw: bytes, rng: Rng) -> bytes:
    """Flip a random bit."""
    data = bytearray(raw)
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def change_member(path: Path, raw: bytes, rng: Rng) -> bytes:
    """Change one file inside an archive, and keep the archive's checksums correct."""
    inner: Callable[[bytes, Rng], bytes] = rng.choice([change_bytes, change_text])
    try:
        return repack(path, lambda data: inner(data, rng), pick=rng.randrange(100))
    except (ValueError, KeyError, OSError):
        return change_bytes(raw, rng)


def change_hdf5(path: Path, raw: bytes, rng: Rng) -> bytes:
    """Change datasets, attributes and links of an HDF5 file with h5py, and usually remove its digests."""
    work = path.with_suffix(".changed")
    work.write_bytes(raw)
    with h5py.File(work, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        for _ in range(rng.choice([1, 1, 2, 3])):
            name = rng.choice(names)
            if file.get(name) is not None:  # not a dangling link
                _change_item(file, name, rng)
        if rng.random() < 0.8:
            for key in ("spikes_sha256", "provenance_sha256"):
                file.attrs.pop(key, None)
    data = work.read_bytes()
    work.unlink()
    return data


def _change_item(file: h5py.File, name: str, rng: Rng) -> None:
    what = rng.randrange(9)
    holder = rng.choice([file, file[name]])
    if what <= 1:
        key = rng.choice([*holder.attrs, "x", "format", "layout", "frames", "readout_hz"])
        value = rng.choice(
            [*VALUES[:-2], np.zeros(3), np.arange(4, dtype="u1"), np.bytes_(b"x"), np.float32("nan"), h5py.Empty("f4")]
        )
        try:
            holder.attrs[key] = value
        except (TypeError, ValueError, OverflowError, OSError, RuntimeError):
            holder.attrs[key] = [1, 2]
        return
    attributes = dict(file[name].attrs)
    shape = getattr(file[name], "shape", ()) or ()
    if what == 2:
        del file[name]
        return
    del file[name]
    if what == 3:
        file[name] = rng.choice(
            [h5py.ExternalLink("secret.h5", "/x"), h5py.SoftLink("/spikes"), h5py.SoftLink("/nowhere")]
        )
        return
    dtype = rng.choice(
        ["f4", "f8", "u1", "i8", "bool", "u2", ">f4", "f2", "S5", h5py.string_dtype(), [("a", "f4")], "c8"]
    )
    larger = tuple(n + 1 for n in shape)
    wanted = rng.choice(
        [(), (0,), (1,), shape, shape[::-1], (*shape, 1), larger, (3, 3), (1 << 40,), (1 << 20, 1 << 20)]
    )
    try:
        if what == 4 and np.prod(wanted, dtype=float) < 1e6:
            data = rng.choice(
                [np.zeros(wanted), np.full(wanted, np.nan), np.full(wanted, 1e300), np.full(wanted, -1.0)]
            )
            file.create_dataset(name, data=data.astype("f8"))
        elif what == 5:
            file.create_dataset(name, data=rng.choice([t for t in TEXTS if "\0" not in t and "\ud800" not in t]))
        elif what == 6:
            file.create_dataset(
                name, shape=wanted or (1,), dtype="u1", external=[("secret.txt", 0, h5py.h5f.UNLIMITED)]
            )
        elif what == 7:
            chunks = tuple(max(min(n, 64), 1) for n in wanted) or None
            filters: dict[str, Any] = rng.choice(
                [{"compression": "gzip"}, {"compression": "lzf"}, {"fletcher32": True}, {"shuffle": True}]
            )
            file.create_dataset(name, shape=wanted, dtype=dtype, chunks=chunks, fillvalue=None, **filters)
            if chunks and "compression" in filters and filters["compression"] == "gzip":
                file[name].id.write_direct_chunk((0,) * len(wanted), zlib.compress(bytes(rng.choice([10, 1 << 22]))))
        else:
            file.create_dataset(name, shape=wanted, dtype=dtype)
    except (TypeError, ValueError, OSError, RuntimeError, OverflowError, MemoryError):
        if name not in file:
            file.create_group(name)
    for key, value in attributes.items():
        file[name].attrs[key] = value


def put_other_kind(path: Path, rng: Rng) -> None:
    """Replace a file by something that is not a regular file, or is empty, endless, huge or random."""
    what = rng.randrange(8)
    path.unlink()
    if what == 0:
        path.mkdir()
    elif what == 1:
        os.mkfifo(path)
    elif what == 2:
        path.symlink_to("/dev/zero")
    elif what == 3:
        path.symlink_to(path.name)
    elif what == 4:
        path.write_bytes(b"")
    elif what == 5:
        path.symlink_to("/nowhere/at/all")
    elif what == 6:
        path.write_bytes(b"a: " + b"x" * 50_000_000)
    else:
        path.write_bytes(bytes(rng.randrange(256) for _ in range(5000)))
