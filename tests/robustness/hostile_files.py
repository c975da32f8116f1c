# ruff: noqa: E501  a file in a line
"""Files of strangers that hold, or state, far more than their size, with the commands that read them.

Each function draws and writes one kind of file into a folder, and returns its :class:`Hostile`. Files are written with
the libraries of their formats, and then changed where a library would refuse.
"""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import av
import h5py
import numpy as np
import OpenEXR
import tifffile
from openpyxl import Workbook
from PIL import Image, PngImagePlugin
from scipy.io import savemat

MIB = 1 << 20
READ_ARRAY = (
    "import {} --out out.h5 --axes TYX --bits lsb",
    "import {} --out out.h5 --axes TYX",
    "encode {} --out out.h5 --rate 900 --linear",
)
TO_STREAM = "import camera.npy --axes TYX --out out.h5"
READ_PICTURE = ("encode {} --out out.h5 --rate 900 --sensor ideal --linear", f"{TO_STREAM} --mask {{}}")
READ_MESH = ("scenes new made --from {}",)
READ_STREAM = ("inspect {}", "dataset index .", "score {} --measure sd --window 8", "cut {} --out out/o.h5 --to 8")
READ_LOG = tuple(f"{TO_STREAM} --{option} {{}}" for option in ("focus", "mask", "times", "light"))


@dataclass(frozen=True)
class Hostile:
    """A file, the command that reads it, and what must come of it.

    ``must`` is ``refused``; ``read`` if it is large and honest; or ``either``, if all that matters is that it is cheap.
    """

    kind: str
    command: str
    must: str = "refused"
    spikes: int | None = None
    """Spikes of the stream that is written, if the file is read."""


Random = np.random.Generator


def pick(random: Random, *of: object) -> object:
    return of[int(random.integers(len(of)))]


def _command(random: Random, path: Path, commands: tuple[str, ...]) -> str:
    return str(pick(random, *commands)).format(path.name)


# Arrays


def _npy_head(shape: object, *, kind: str = "'|u1'", order: str = "False") -> bytes:
    text = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text


class Zeros(io.RawIOBase):
    """A file of a head and then zeros, which is never in memory."""

    def __init__(self, head: bytes, count: int) -> None:
        self._head, self._left = head, count

    def read(self, size: int = -1) -> bytes:
        if self._head:
            head, self._head = self._head, b""
            return head
        size = min(self._left, MIB)
        self._left -= size
        return bytes(size)


def write_zip(path: Path, name: str, head: bytes, count: int, *, method: int = zipfile.ZIP_DEFLATED) -> None:
    with (
        zipfile.ZipFile(path, "w", method, compresslevel=1) as archive,
        archive.open(name, "w", force_zip64=True) as out,
    ):
        zeros = Zeros(head, count)
        while block := zeros.read():
            out.write(block)


class Planted:
    """What a pickle would run."""

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (Path("planted"),)


def npz(random: Random, folder: Path) -> Hostile:
    path, must = folder / "a.npz", "refused"
    kind = str(pick(random, "bzip2", "lzma", "one huge frame", "many members", "a long head", "a wrong size", "objects",
                    "a huge shape", "negative", "a huge type", "a head of nonsense", "encrypted", "overlapping",
                    "dark", "flat", "a nested zip", "turned zeros"))  # fmt: skip
    commands: tuple[str, ...] = READ_ARRAY
    if kind in ("bzip2", "lzma"):
        method = zipfile.ZIP_BZIP2 if kind == "bzip2" else zipfile.ZIP_LZMA
        write_zip(path, "spikes.npy", _npy_head((1 << 30, 1, 1)), 3 << 28, method=method)
    elif kind == "one huge frame":
        side = int(random.integers(20_000, 30_000))
        write_zip(path, "spikes.npy", _npy_head((1, side, side)), side * side)
    elif kind == "flat":  # frames of one pixel that is far too large for one read
        write_zip(path, "spikes.npy", _npy_head((2, 1, 300 << 20)), 600 << 20)
    elif kind == "turned zeros":
        write_zip(path, "spikes.npy", _npy_head((100, 100, 50_000)), 500_000_000)
        commands, must = ("import {} --out out.h5 --bits lsb --axes YXT",), "read"
    elif kind == "many members":
        with zipfile.ZipFile(path, "w") as archive:
            for number in range(20_000):
                archive.writestr(f"{number}.npy", _npy_head((0,)))
    elif kind == "a long head":
        text = b"{" + b" " * (64 << 20) + b"}"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("spikes.npy", b"\x93NUMPY\2\0" + struct.pack("<I", len(text)) + text)
    elif kind == "objects":
        with path.open("wb") as file:
            np.savez(file, spikes=np.array([[[Planted()]]], dtype=object))
    elif kind == "encrypted":
        write_zip(path, "spikes.npy", _npy_head((8, 8, 8)), 512)
        data = bytearray(path.read_bytes())
        data[6] |= 1
        data[data.index(b"PK\1\2") + 8] |= 1
        path.write_bytes(data)
    elif kind == "overlapping":  # every entry of the list names the same member
        write_zip(path, "spikes.npy", _npy_head((1000, 100, 100)), 10_000_000)
        data = path.read_bytes()
        at, end = data.index(b"PK\1\2"), data.rindex(b"PK\5\6")
        entry, count = data[at:end], 30_000
        tail = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, count, count, count * len(entry), at, 0)
        path.write_bytes(data[:at] + entry * count + tail)
    elif kind == "dark":
        frames = int(pick(random, 2_000, 4_000))
        write_zip(path, "spikes.npy", _npy_head((frames, 250, 400)), frames * 100_000)
        commands, must = READ_ARRAY[:1], "read"
    elif kind == "a nested zip":
        inner = io.BytesIO()
        np.savez_compressed(inner, spikes=np.zeros((10, 1000, 1000), np.uint8))
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("spikes.npy", inner.getvalue())
    else:
        head = {
            "a wrong size": _npy_head((1 << 40, 100, 100)),
            "a huge shape": _npy_head((1 << 62, 1 << 62, 1 << 62)),
            "negative": _npy_head((-1, 100, 100)),
            "a huge type": _npy_head((1, 1, 1), kind="'V2000000000'"),
            "a head of nonsense": _npy_head("(" * 5000, kind="'" + "a" * 3000 + "'"),
        }[kind]
        write_zip(path, "spikes.npy", head, 10_000)
    return Hostile(f"npz, {kind}", _command(random, path, commands), must, 0)


def npy(random: Random, folder: Path) -> Hostile:
    path = folder / "a.npy"
    heads = {
        "a huge shape": _npy_head((1 << 62, 1 << 62, 1 << 62)),
        "a product of 0": _npy_head((1 << 62, 0, 1 << 62)),
        "more than it has": _npy_head((1 << 30, 100, 100)),
        "negative": _npy_head((-8, 100, 100)),
        "a huge type": _npy_head((1, 1, 1), kind="'V2000000000'"),
        "many axes": _npy_head("(" + "1," * 3000 + ")"),
        "deep": _npy_head("(" * 3000 + ")" * 3000),
        "a tower": _npy_head((1, 1, 1), kind="9**9**9**9"),
        "a number of many digits": _npy_head("(" + "9" * 20_000 + ",)"),
        "objects": _npy_head((1, 1, 1), kind="'|O'"),
        "records": _npy_head((1, 1, 1), kind="[('x', '<f8')]"),
        "text": _npy_head((8, 8, 8), kind="'<U40'"),
        "version 9": b"\x93NUMPY\x09\0" + b"x" * 100,
        "a head of 2 GiB": b"\x93NUMPY\2\0" + struct.pack("<I", 2**31) + b"x" * 1000,
        "a zip": b"",
        "a pickle": b"\x80\x04\x95" + b"cos\nsystem\n",
        "nothing": b"",
    }
    kind = str(pick(random, *heads))
    path.write_bytes(heads[kind] + (bytes(1000) if kind not in ("nothing", "a zip") else b""))
    if kind == "a zip":
        with path.open("wb") as file:
            np.savez_compressed(file, spikes=np.zeros((8, 8, 8), np.uint8))
    return Hostile(f"npy, {kind}", _command(random, path, READ_ARRAY))


def mat(random: Random, folder: Path) -> Hostile:
    path, must = folder / "a.mat", "refused"
    kind = str(pick(random, "cells", "one huge frame", "a huge element", "cut", "nonsense", "many arrays", "dark"))
    commands: tuple[str, ...] = READ_ARRAY
    if kind == "cells":
        deep: object = 1.0
        for _ in range(int(random.integers(10, 60))):
            deep = {"a": deep}
        cell = np.empty((1, 200), object)
        cell[:] = [[np.zeros((300, 300), np.uint8)] * 200]
        savemat(path, {"spikes": cell, "deep": deep}, do_compression=True)
    elif kind in ("one huge frame", "a huge element", "dark"):
        # as savemat writes it, which would need all of it in memory
        dims = {
            "one huge frame": (25_000, 25_000, 1),
            "a huge element": (1 << 30, 1 << 30, 3),
            "dark": (250, 400, 3000),
        }
        shape = dims[kind]
        stated = min(int(np.prod(shape, dtype=float)), 2**32 - 80)
        inner = (
            struct.pack("<4I", 6, 8, 9, 0)
            + struct.pack("<2I3i4x", 5, 12, *shape)
            + struct.pack("<2I8s", 1, 6, b"spikes")
        )
        inner += struct.pack("<2I", 2, stated)
        pack, body = zlib.compressobj(1), b""
        body += pack.compress(struct.pack("<2I", 14, len(inner) + stated) + inner)
        most = min(stated, 700 << 20)
        for at in range(0, most, MIB):
            body += pack.compress(bytes(min(MIB, most - at)))
        body += pack.flush()
        head = b"MATLAB 5.0".ljust(124) + b"\0\1IM"
        path.write_bytes(head + struct.pack("<2I", 15, len(body)) + body)
        if kind == "dark":
            commands, must = ("import {} --out out.h5 --bits lsb --axes YXT",), "read"
    elif kind == "many arrays":
        savemat(path, {f"a{n}": np.zeros((2, 2), np.uint8) for n in range(3000)})
    else:
        savemat(path, {"spikes": np.zeros((30, 30, 30), np.uint8)}, do_compression=True)
        data = bytearray(path.read_bytes())
        if kind == "cut":
            data = data[: int(random.integers(1, len(data)))]
        else:
            data[128:] = random.bytes(len(data) - 128)
        path.write_bytes(data)
    return Hostile(f"mat 5, {kind}", _command(random, path, commands), must, 0)


def _be_hdf5(random: Random, path: Path, name: str, *, axes: int = 3) -> str:
    """Write an HDF5 file of one hostile dataset ``name``, and return its kind."""
    kind = str(pick(random, "nothing stored", "a huge frame", "packed twice", "a huge chunk", "lzf", "szip", "an unknown filter",
                    "a link outside", "links in a ring", "virtual", "stored outside", "records", "deep", "many",
                    "a filled shape"))  # fmt: skip
    with h5py.File(path, "w") as file:
        if kind == "nothing stored":
            file.create_dataset(name, (400, 250, 1 << 33), "u1", chunks=(100, 250, 256))
        elif kind == "a filled shape":
            file.create_dataset(name, (1 << 33, 250, 400), "u1", chunks=(64, 250, 400), fillvalue=1)
        elif kind == "a huge frame":
            made = file.create_dataset(name, (1, 40_000, 40_000), "u1", chunks=(1, 4000, 4000), compression="gzip")
            for row in range(10):
                for column in range(10):
                    made[:, row * 4000 : row * 4000 + 4000, column * 4000 : column * 4000 + 4000] = 1
        elif kind == "packed twice":
            plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            plist.set_chunk((32, 1000, 1000))
            plist.set_deflate(9)
            plist.set_filter(h5py.h5z.FILTER_DEFLATE, 0, (9,))
            space = h5py.h5s.create_simple((3200, 1000, 1000))
            made = h5py.Dataset(h5py.h5d.create(file.id, name.encode(), h5py.h5t.NATIVE_UINT8, space, plist))
            chunk = zlib.compress(zlib.compress(bytes(32_000_000), 9), 9)
            for at in range(0, 3200, 32):
                made.id.write_direct_chunk((at, 0, 0), chunk)
        elif kind == "a huge chunk":
            file.create_dataset(name, (4000, 1000, 1000), "u1", chunks=(4000, 1000, 1000), compression="gzip")
        elif kind in ("lzf", "szip"):
            if kind == "szip" and not h5py.h5z.filter_avail(h5py.h5z.FILTER_SZIP):
                kind = "lzf"
            file.create_dataset(name, data=np.zeros((80, 64, 64), np.uint8), compression=kind)
        elif kind == "an unknown filter":
            plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            plist.set_chunk((8, 64, 64))
            plist.set_filter(32001, h5py.h5z.FLAG_OPTIONAL, (1,) * 7)  # that of blosc
            space = h5py.h5s.create_simple((80, 64, 64))
            h5py.h5d.create(file.id, name.encode(), h5py.h5t.NATIVE_UINT8, space, plist)
        elif kind == "a link outside":
            file[name] = h5py.ExternalLink("camera.h5", "/spikes")
        elif kind == "links in a ring":
            file[name], file["b"] = h5py.SoftLink("/b"), h5py.SoftLink(f"/{name}")
            file["group"] = file.create_group("g")
            file["g/g"] = file["g"]
        elif kind == "virtual":
            layout = h5py.VirtualLayout((1 << 30, 250, 400), "u1")
            layout[0:8] = h5py.VirtualSource("camera.h5", "spikes", (8, 250, 400))
            file.create_virtual_dataset(name, layout)
        elif kind == "stored outside":
            file.create_dataset(name, (8, 8, 8), "u1", external=[("/etc/passwd", 0, 512)])
        elif kind == "records":
            file.create_dataset(name, (8, 8, 8), np.dtype([(f"f{n}", "f8") for n in range(500)]))
        elif kind == "deep":
            at = file
            for _ in range(400):
                at = at.create_group("g")
        else:
            for number in range(5000):
                file.create_dataset(f"a{number}", data=np.zeros(axes * [1], np.uint8))
    return kind


def mat73(random: Random, folder: Path) -> Hostile:
    path = folder / "a.mat"
    kind = _be_hdf5(random, path, "spikes")
    return Hostile(f"mat 7.3, {kind}", _command(random, path, READ_ARRAY))


def stream(random: Random, folder: Path) -> Hostile:
    path = folder / "a.h5"
    kind = _be_hdf5(random, path, "spikes")
    with h5py.File(path, "a") as file:
        file.attrs.update(format="saf-gen stream", layout=1, content_sha256="0" * 64)
        if isinstance(file.get("spikes", getlink=True), h5py.HardLink):
            file["spikes"].attrs.update(frames=8 * file["spikes"].shape[2], readout_hz=20_000.0)
    must = "either" if kind == "a huge frame" else "refused"  # it may be cut
    return Hostile(f"stream, {kind}", _command(random, path, READ_STREAM), must)


# Pictures and video


def _png(width: int, height: int, rows: bytes, *, colour: int = 0, depth: int = 8, extra: bytes = b"") -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = chunk(b"IHDR", struct.pack(">2I5B", width, height, depth, colour, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + extra + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def picture(random: Random, folder: Path) -> Hostile:
    kinds = ("png huge", "png of 16 bits huge", "png packed", "png text", "png profile", "tiff huge",
             "tiff ring", "tiff of many channels", "tiff packed", "jpeg huge", "ppm huge", "ppm plain", "bmp huge", "webp cut", "exr huge",
             "exr far windows", "exr packed", "apng of many", "png cut")  # fmt: skip
    kind = str(pick(random, *kinds))
    ending = kind.split()[0].replace("apng", "png").replace("jpeg", "jpg")
    path, must = folder / f"a.{ending}", "refused"
    commands = READ_PICTURE[:1] if ending in ("exr", "webp", "jpg", "ppm") else READ_PICTURE
    if kind in ("png huge", "png of 16 bits huge"):
        deep = 16 if "16" in kind else 8
        side = int(pick(random, 30_000, 2**31 - 1))
        path.write_bytes(_png(side, side, zlib.compress(bytes(MIB)), colour=2, depth=deep))
    elif kind == "png packed":  # more rows than it says
        pack = zlib.compressobj(9)
        rows = b"".join(pack.compress(bytes(MIB)) for _ in range(400)) + pack.flush()
        path.write_bytes(_png(64, 64, rows))
        must = "either"
    elif kind in ("png text", "png profile"):
        packed = zlib.compress(bytes(300 * MIB), 1)
        info = PngImagePlugin.PngInfo()
        name = b"zTXt" if "text" in kind else b"iCCP"
        info.add(name, b"a\0\0" + packed)
        Image.new("L", (64, 64), 9).save(path, pnginfo=info)
        data = path.read_bytes()
        path.write_bytes(data)
        must = "either"
    elif kind == "png cut":
        Image.fromarray(random.integers(0, 255, (64, 64), np.uint8)).save(path)
        path.write_bytes(path.read_bytes()[: int(random.integers(9, 3000))])
    elif kind == "apng of many":
        pages = [Image.new("L", (32, 32), n % 250) for n in range(300)]
        pages[0].save(path, save_all=True, append_images=pages[1:], duration=10)
        commands = READ_PICTURE[:1]
    elif kind in ("tiff huge", "tiff of many channels", "tiff ring", "tiff packed"):
        tifffile.imwrite(path, np.zeros((64, 64), np.uint8), photometric="minisblack")
        if kind == "tiff packed":
            strips = zlib.compress(bytes(200 * MIB), 9)
            tifffile.imwrite(
                path, iter([strips]), shape=(64, 64), dtype=np.uint8, compression="zlib", photometric="minisblack"
            )
            must = "either"
        raw = bytearray(path.read_bytes())
        first = struct.unpack_from("<I", raw, 4)[0]
        count = struct.unpack_from("<H", raw, first)[0]
        for at in range(first + 2, first + 2 + 12 * count, 12):
            tag = struct.unpack_from("<H", raw, at)[0]
            if (kind == "tiff huge" and tag in (256, 257, 278)) or (kind == "tiff of many channels" and tag == 277):
                struct.pack_into("<2HII", raw, at, tag, 4, 1, 65_535 if "channels" in kind else 1 << 20)
        if kind == "tiff ring":
            struct.pack_into("<I", raw, first + 2 + 12 * count, first)
            must = "either"
        path.write_bytes(raw)
    elif kind == "jpeg huge":
        Image.new("RGB", (64, 64)).save(path)
        raw = bytearray(path.read_bytes())
        at = raw.index(b"\xff\xc0")
        struct.pack_into(">2H", raw, at + 5, 65_000, 65_000)
        path.write_bytes(raw)
    elif kind.startswith("ppm"):
        path.write_bytes(
            b"P6 99999 99999 255\n" + bytes(1000) if "huge" in kind else b"P3 2000 2000 65535\n" + b"1 " * 1000
        )
    elif kind == "bmp huge":
        Image.new("L", (64, 64)).save(path)
        raw = bytearray(path.read_bytes())
        struct.pack_into("<2i", raw, 18, 100_000, 100_000)
        path.write_bytes(raw)
    elif kind == "webp cut":
        Image.fromarray(random.integers(0, 255, (64, 64, 3), np.uint8)).save(path, lossless=True)
        path.write_bytes(path.read_bytes()[:-40])
    else:
        _write_exr(path, kind)
    return Hostile(kind, _command(random, path, commands), must)


def _write_exr(path: Path, kind: str) -> None:
    pixels = np.zeros((64, 64), np.float32)
    if kind == "exr packed":
        pixels = np.zeros((2000, 2000), np.float32)
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(head, {"Y": pixels}).write(str(path))
    if kind == "exr packed":
        return
    raw = bytearray(path.read_bytes())
    for name in (b"dataWindow", b"displayWindow"):
        if kind == "exr huge" or name == b"displayWindow":
            at = raw.index(name) + len(name) + 1 + 6 + 4
            struct.pack_into("<4i", raw, at, -(1 << 30), -(1 << 30), 1 << 30, 1 << 30)
    path.write_bytes(raw)


def video(random: Random, folder: Path) -> Hostile:
    kind = str(pick(random, "y4m huge", "mp4 huge", "mkv huge", "mkv of many", "a playlist", "an svg", "noise"))
    path, must = folder / {"y4m huge": "a.y4m", "mp4 huge": "a.mp4"}.get(kind, "a.mkv"), "refused"
    if kind == "y4m huge":
        path.write_bytes(b"YUV4MPEG2 W100000 H100000 F25:1 C420\nFRAME\n" + bytes(10_000))
    elif kind == "a playlist":
        path.write_bytes(b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n")
    elif kind == "an svg":
        path.write_bytes(
            b'<svg xmlns="http://www.w3.org/2000/svg" width="99999" height="99999"><image href="/etc/passwd"/></svg>'
        )
    elif kind == "noise":
        path.write_bytes(b"\x1a\x45\xdf\xa3" + random.bytes(20_000))
    else:
        count, side = (2_000, 64) if kind == "mkv of many" else (4, 64)
        with av.open(str(path), "w") as container:
            made = container.add_stream("mpeg4", rate=25)
            made.width = made.height = side
            for _ in range(count):
                frame = av.VideoFrame.from_ndarray(np.full((side, side, 3), 90, np.uint8), format="rgb24")
                for packet in made.encode(frame.reformat(format="yuv420p")):
                    container.mux(packet)
            for packet in made.encode():
                container.mux(packet)
        if kind != "mkv of many":
            raw = bytearray(path.read_bytes())
            if kind == "mp4 huge":
                at = raw.index(b"mp4v") + 28
                struct.pack_into(">2H", raw, at, 65_000, 65_000)
            else:
                for name in (b"\xb0", b"\xba"):
                    at = raw.index(name + b"\x81\x40")
                    raw[at + 2] = 0x7F
            path.write_bytes(raw)
        must = "either"  # the size in the stream of bits counts
    return Hostile(f"video, {kind}", _command(random, path, READ_PICTURE[:1]), must)


# Meshes


def _glb(document: dict[str, object], binary: bytes = b"") -> bytes:
    text = json.dumps({"asset": {"version": "2.0"}, **document}).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text + struct.pack("<2I", len(binary), 0x004E4942) + binary
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks


def _card(count: int = 3, **accessor: object) -> dict[str, object]:
    """Return the document of one triangle, whose accessor may state more."""
    return {
        "buffers": [{"byteLength": 36}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", **accessor}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}], "scene": 0,
    }  # fmt: skip


TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()


def mesh(random: Random, folder: Path) -> Hostile:
    kinds = ("glb count", "glb empty count", "glb sparse", "glb many primitives", "glb tree of doubles", "glb ring", "glb deep json",
             "glb long data", "glb picture", "glb many nodes", "ply count", "ply no properties", "ply no properties text",
             "ply list", "ply many lists", "stl count", "stl long word", "stl many words", "obj far index", "obj long face",
             "obj many groups", "obj long line", "xml bomb", "ply short rows")  # fmt: skip
    kind = str(pick(random, *kinds))
    path, must = folder / f"a.{kind.split()[0]}", "refused"
    card = _card()
    if kind == "glb count":
        path.write_bytes(_glb(_card(int(pick(random, 1 << 24, 1 << 40, 1 << 70))), TRIANGLE))
    elif kind == "glb empty count":
        card["accessors"] = [{"componentType": 5126, "count": 9_900_000, "type": "VEC3"}]
        path.write_bytes(_glb(card, TRIANGLE))
    elif kind == "glb sparse":
        part = {
            "count": int(pick(random, 1 << 30, 3)),
            "indices": {"bufferView": 0, "componentType": 5125},
            "values": {"bufferView": 0},
        }
        card["accessors"] = [{"componentType": 5126, "count": 1 << 23, "type": "VEC3", "sparse": part}]
        path.write_bytes(_glb(card, TRIANGLE))
        must = "either"
    elif kind == "glb many primitives":
        card["accessors"] = [{"componentType": 5126, "count": 3_000_000, "type": "VEC3"}]
        card["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}}] * 20_000}]
        path.write_bytes(_glb(card, TRIANGLE))
    elif kind == "glb tree of doubles":
        card["nodes"] = [{"children": [n + 1, n + 1]} for n in range(40)] + [{"mesh": 0}]
        path.write_bytes(_glb(card, TRIANGLE))
    elif kind == "glb ring":
        card["nodes"] = [{"children": [1]}, {"children": [0], "mesh": 0}]
        path.write_bytes(_glb(card, TRIANGLE))
    elif kind == "glb many nodes":
        card["nodes"] = [{"mesh": 0}] * 100_000
        card["scenes"] = [{"nodes": list(range(100_000))}]
        path.write_bytes(_glb(card, TRIANGLE))
    elif kind == "glb deep json":
        path.write_bytes(_glb(card, TRIANGLE).replace(b'"scene": 0', b'"extras": ' + b"[" * 90_000, 1))
    elif kind == "glb long data":
        path = folder / "a.gltf"
        card["buffers"] = [{"byteLength": 36, "uri": "data:application/octet-stream;base64," + "AAAA" * (4 * MIB)}]
        path.write_text(json.dumps({"asset": {"version": "2.0"}, **card}))
        must = "either"
    elif kind == "glb picture":
        data = _png(30_000, 30_000, zlib.compress(bytes(MIB)), colour=2)
        views = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": len(data)}]
        card |= {"buffers": [{"byteLength": 36 + len(data)}], "bufferViews": views, "textures": [{"source": 0}],
                 "images": [{"bufferView": 1, "mimeType": "image/png"}],
                 "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]}  # fmt: skip
        card["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 0}, "material": 0}]}]
        path.write_bytes(_glb(card, TRIANGLE + data))
    elif kind.startswith("ply"):
        path.write_bytes(_ply(random, kind))
    elif kind == "stl count":
        path.write_bytes(bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50))
    elif kind in ("stl long word", "stl many words"):
        facet = b"facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet\n"
        more = b"solid " + b"x" * MIB + b"\n" if "long" in kind else b"solid\n" + b"a " * (12 * MIB)
        path.write_bytes(more + facet * 40_000 + b"endsolid\n")
        must = "either"
    elif kind == "obj far index":
        path.write_bytes(
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + str(pick(random, 2**31 - 1, 10**30, -9)).encode() + b"\n"
        )
    elif kind == "obj long face":
        path.write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + b" 1 2 3" * 300_000 + b"\n")
        must = "either"
    elif kind == "obj many groups":
        path.write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"".join(b"g g%d\nf 1 2 3\n" % n for n in range(100_000)))
        must = "either"
    elif kind == "obj long line":
        path.write_bytes(b"v 0 0 0\n#" + b"x" * (40 * MIB) + b"\nv " + b"1" * (4 * MIB) + b" 0 0\nv 0 1 0\nf 1 2 3\n")
    else:
        entities = "".join(f'<!ENTITY a{n + 1} "{f"&a{n};" * 10}">' for n in range(12))
        path.write_text(f'<!DOCTYPE x [<!ENTITY a0 "ha">{entities}]><scene version="3.0.0">&a12;</scene>')
    return Hostile(kind, _command(random, path, READ_MESH), must)


def _ply(random: Random, kind: str) -> bytes:
    many = int(pick(random, 1 << 30, 1 << 62))
    corners = "property list uchar int vertex_indices"
    points = "property float x\nproperty float y\nproperty float z"
    form = "binary_little_endian" if "text" not in kind and kind != "ply count" else "ascii"
    head = f"ply\nformat {form} 1.0\n"
    three = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n" if form == "ascii" else TRIANGLE + b"\3" + struct.pack("<3i", 0, 1, 2)
    if kind == "ply count":
        head += f"element vertex {many}\n{points}\nelement face 1\n{corners}\n"
    elif kind.startswith("ply no properties"):
        head += f"element vertex 3\n{points}\nelement face 1\n{corners}\nelement nothing {many}\n"
    elif kind == "ply list":
        head += f"element vertex 3\n{points}\nelement face {many}\nproperty list uint int vertex_indices\n"
        three = TRIANGLE + struct.pack("<I", 2**32 - 1)
    elif kind == "ply many lists":
        head += f"element vertex 3\n{points}\nelement face 100000\n{corners}\n"
        three = TRIANGLE + b"\3" + struct.pack("<3i", 0, 1, 2) + b"".join(
            bytes([3 + n % 2]) + struct.pack("<3i", 0, 1, 2) + bytes(4 * (n % 2)) for n in range(99_998))  # fmt: skip
    else:
        head += f"element vertex {many}\n{points}\nelement face 1\n{corners}\n"
    return head.encode() + b"end_header\n" + three


# Text, tables and documents


def text(random: Random, folder: Path) -> Hostile:
    kinds = {
        "a line of zeros": b"0" * (200 * MIB), "many short rows": b"frame,position\n" + b"1,0\n" * (24 * MIB),
        "many empty lines": b"\n" * (100 * MIB), "a wide heading": b"frame," + b"a," * (4 * MIB),
        "many rows": b"frame,position\n" + b"".join(b"%d,0\n" % n for n in range(2_000_000)),
        "bytes": bytes(range(256)) * 1000, "a long number": b"frame,position\n1," + b"9" * (20 * MIB),
        "many pixels": b"row,column\n" + b"1,1\n" * (12 * MIB),
    }  # fmt: skip
    kind = str(pick(random, *kinds))
    path = folder / "a.csv"
    path.write_bytes(kinds[kind])
    return Hostile(f"csv, {kind}", _command(random, path, READ_LOG), "either")


def yaml(random: Random, folder: Path) -> Hostile:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)]
    kinds = {
        "aliases": "\n".join(lines), "many values": "- 1\n" * 900_000, "deep": "[" * 100_000, "deep keys": "{a: " * 50_000,
        "deep lines": "".join(" " * n + "a:\n" for n in range(2000)), "a ring": "a: &a [*a]", "tags": "!!python/object/apply:os.system ['touch planted']",
        "many keys": "\n".join(f"k{n}: {n}" for n in range(250_000)), "a long text": "a: " + "x" * (3 * MIB),
        "too long": "# " + "x" * (30 * MIB), "many empty lists": "[" + "[]," * 1_300_000 + "]",
        "many anchors": "\n".join(f"- &a{n} 1" for n in range(200_000)), "many documents": "---\n" * 1_000_000,
        "a long number": "a: " + "9" * (3 * MIB), "sixties": "a: " + ":".join(["59"] * 100_000),
    }  # fmt: skip
    kind = str(pick(random, *kinds))
    commands = ("recipes check {}", "generate {} --dry-run --out out", "sensors check {}", "sensors show {}")
    path = folder / "a.yaml"
    path.write_text(kinds[kind])
    return Hostile(f"yaml, {kind}", _command(random, path, commands))


def documents(random: Random, folder: Path) -> Hostile:
    """Draw a JSON document in the place of one that commands read."""
    kinds = {
        "deep": b"[" * 500_000, "deep keys": b'{"a":' * 200_000, "many lists": b'{"format": "saf-gen dataset", "layout": 1, "x": [' + b"[]," * (12 * MIB) + b"1]}",
        "a long number": b'{"a": ' + b"9" * (8 * MIB) + b"}", "a long text": b'{"a": "' + b"x" * (60 * MIB) + b'"}',
        "many keys": b"{" + b",".join(b'"%d":1' % n for n in range(900_000)) + b"}", "an empty list": b"[]", "nothing": b"",
        "many sequences": b'{"format": "saf-gen dataset", "layout": 1, "name": "a", "recipe_fingerprint": "", "variant": "", "sequences": [' + b"{}," * (10 * MIB) + b"{}]}",
        "many files": b'{"format": "saf-gen dataset", "layout": 1, "name": "a", "recipe_fingerprint": "", "variant": "", "sequences": [], "files": [' + b"{}," * (10 * MIB) + b"{}]}",
        "surrogates": b'["' + b"\\ud800" * 100_000 + b'"]', "one long line of records": b'{"method": "' + b"a" * (30 * MIB) + b'"}',
    }  # fmt: skip
    kind = str(pick(random, *kinds))
    where, command = pick(random,
        ("data/manifest.json", "verify data"), ("data/manifest.json", "evaluate data --out out"),
        ("a.jsonl", "evaluate whole --predictions a.jsonl --out out"), ("tuned.json", "methods show @tuned.json"),
        ("tuned.json", "evaluate whole --method @tuned.json --out out"), ("judged/records.jsonl", "leaderboard merge judged"),
        ("judged/records.jsonl", "leaderboard verify judged --on whole"),
        ("a.txt", "evaluate whole --methods a.txt --out out"),
    )  # fmt: skip
    path = folder / where
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(kinds[kind])
    return Hostile(f"json, {kind}", command)


NETWORK = """from saf_gen.core.onnx_network import OnnxNetwork
from pathlib import Path
net = OnnxNetwork(Path(__file__).with_name("a.onnx"))

def look(view):
    return net()
"""


def network(random: Random, folder: Path) -> Hostile:
    """Draw an ONNX file: Protocol Buffers, whose fields are a number, a kind and a length."""

    def field(number: int, data: bytes | int) -> bytes:
        if isinstance(data, int):
            return _varint(number << 3) + _varint(data)
        return _varint(number << 3 | 2) + _varint(len(data)) + data

    def tensor(*shape: int, raw: bytes = b"", more: bytes = b"") -> bytes:
        return (
            b"".join(field(1, n) for n in shape) + field(2, 1) + field(8, b"w") + (field(9, raw) if raw else b"") + more
        )

    def value(name: bytes, size: int) -> bytes:
        shape = field(1, field(1, size))
        return field(1, name) + field(2, field(1, field(1, 1) + field(2, shape)))

    kind = str(
        pick(
            random,
            "noise",
            "a huge tensor",
            "a file outside",
            "a constant that grows",
            "deep",
            "a long file",
            "nothing",
        )
    )
    shape = field(1, 1) + field(2, 7) + field(8, b"s") + field(9, struct.pack("<q", 1 << 37))
    outside = field(13, field(1, b"location") + field(2, b"../../../../etc/passwd")) + field(14, 1)
    made = field(1, b"s") + field(2, b"y") + field(4, b"ConstantOfShape")
    same = field(1, b"w") + field(2, b"y") + field(4, b"Identity")
    graphs = {
        "a huge tensor": field(1, same) + field(5, tensor(1 << 40, 1 << 20)) + field(12, value(b"y", 1)),
        "a file outside": field(1, same) + field(5, tensor(8, more=outside)) + field(12, value(b"y", 8)),
        "a constant that grows": field(1, made) + field(5, shape) + field(12, value(b"y", 1)),
    }
    deep = b""
    for _ in range(3000):
        deep = field(1, field(5, field(1, b"b") + field(6, deep)))
    data = {
        "noise": random.bytes(5000), "nothing": b"", "a long file": bytes(80 * MIB), "deep": field(8, 8) + field(7, deep),
        **{name: field(1, 8) + field(8, field(2, 17)) + field(7, field(2, b"g") + graph) for name, graph in graphs.items()},
    }[kind]  # fmt: skip
    path = folder / "a.onnx"
    path.write_bytes(data)
    (folder / "net.py").write_text(NETWORK)
    commands = ("methods check sd+net.py:look", "evaluate whole --method sd+net.py:look --out out")
    # What grows does so when it is run, and then costs the rows of the method.
    must = "either" if kind == "a constant that grows" else "refused"
    return Hostile(f"onnx, {kind}", _command(random, path, commands), must)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def sheet(random: Random, folder: Path) -> Hostile:
    kinds = ("bzip2", "lzma", "packed", "entities", "many rows", "far columns", "deep", "many texts", "one file")
    kind, space = str(pick(random, *kinds)), "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    (folder / "saf").mkdir()
    (folder / "saf/a.dat").write_bytes(bytes(13_000 * 200))
    body = {
        "many rows": "<row/>" * 1_200_000, "far columns": '<row><c r="IV1"/></row>' * 300_000, "deep": "<c>" * 300_000 + "</c>" * 300_000,
        "one file": "".join(f"<row><c><v>{n}</v></c><c><v>a</v></c><c><v>8</v></c><c><v>2</v></c><c/>"
                            "<c t='inlineStr'><is><t>a.dat</t></is></c></row>" for n in range(40_000)),
    }.get(kind, "")  # fmt: skip
    text = f'<worksheet xmlns="{space}"><sheetData>{body}</sheetData></worksheet>'.encode()
    if kind == "entities":
        text = b'<!DOCTYPE x [<!ENTITY a "' + b"a" * 1000 + b'">]>' + text
    if kind in ("bzip2", "lzma", "packed"):
        method = {"bzip2": zipfile.ZIP_BZIP2, "lzma": zipfile.ZIP_LZMA, "packed": zipfile.ZIP_DEFLATED}[kind]
        write_zip(folder / "saf/config.xlsx", "xl/worksheets/sheet1.xml", text[:-30], 1 << 30, method=method)
    else:
        usual = io.BytesIO()
        Workbook().save(usual)
        members = {"xl/worksheets/sheet1.xml": text}
        if kind == "many texts":
            members["xl/sharedStrings.xml"] = f'<sst xmlns="{space}">{"<si/>" * 1_500_000}</sst>'.encode()
        with (
            zipfile.ZipFile(usual) as old,
            zipfile.ZipFile(folder / "saf/config.xlsx", "w", zipfile.ZIP_DEFLATED) as archive,
        ):
            for name in old.namelist():
                archive.writestr(name, members.get(name, old.read(name)))
    return Hostile(f"xlsx, {kind}", "import saf --out out", "refused")


KINDS: tuple[Callable[[Random, Path], Hostile], ...] = (
    npz, npy, mat, mat73, stream, picture, video, mesh, text, yaml, documents, network, sheet,
)  # fmt: skip


def draw(seed: int, number: int, folder: Path) -> Hostile:
    """Write the file of a number, each kind in turn."""
    return KINDS[number % len(KINDS)](np.random.default_rng([seed, number]), folder)


def digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()
