"""Untrusted streams: other files are not read, memory is not filled, and anything that no stream holds is refused."""

import struct
import tracemalloc
import zlib

import h5py
import numpy as np
import pytest
from refusals import refusal
from text_heap import break_text_heap

from saf_gen.errors import BadInput
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

SECRET = b"what nobody else should read"


@pytest.fixture
def untrusted(tmp_path):
    """A complete stream, and other files of the machine that it must not reach."""
    path = tmp_path / "a.h5"
    frames = np.random.default_rng(5).integers(0, 2, (400, 12, 10), np.uint8)
    write_stream(path, frames, focus_position=np.linspace(0, 1, 400), provenance={"recipe": "name: x"})
    (tmp_path / "secret").write_bytes(SECRET * 100)
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["position"] = np.frombuffer(SECRET, np.uint8)
        other.create_dataset("spikes", (12, 10, 50), "uint8").attrs.update(frames=400, readout_hz=2e4)
    return path


def replace(file, name, **how):
    """Replace a dataset by another one with the same attributes."""
    attributes = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, **how).attrs.update(attributes)


def virtual(file, name, shape):
    layout = h5py.VirtualLayout(shape=shape, dtype="uint8")
    layout[...] = h5py.VirtualSource("other.h5", "spikes", shape=shape)
    attributes = dict(file[name].attrs)
    del file[name]
    file.create_virtual_dataset(name, layout).attrs.update(attributes)


def link(name, to):
    def change(file):
        del file[name]
        file[name] = to

    return change


ATTACKS = {
    "an external link": (
        link("spikes", h5py.ExternalLink("other.h5", "/spikes")),
        "/spikes is a link; allowed: data inside the file",
    ),
    "a soft link": (
        link("focus/position", h5py.SoftLink("/spikes")),
        "/focus/position is a link; allowed: data inside the file",
    ),
    "storage outside": (
        lambda f: replace(f, "focus/position", shape=(400,), dtype="u1", external=[("secret", 0, 400)]),
        "/focus/position is stored in other files",
    ),
    "spikes outside": (
        lambda f: replace(f, "spikes", shape=(12, 10, 50), dtype="u1", external=[("secret", 0, 6000)]),
        "/spikes is stored in other files",
    ),
    "a virtual dataset": (lambda f: virtual(f, "spikes", (12, 10, 50)), "/spikes is stored in other files"),
    "another filter": (
        lambda f: replace(f, "spikes", data=np.zeros((12, 10, 50), "u1"), chunks=(12, 10, 50), compression="lzf"),
        r"/spikes has the filters \[.*32000\]; allowed: deflate",
    ),
    "an unknown dataset": (lambda f: f.create_dataset("truth/positon", data=0.5), "truth/positon.* mean 'position'"),
    "an unknown group": (lambda f: f.create_group("provenance/more"), "/provenance/more is not a dataset"),
    "a type in place of data": (
        lambda f: f.__setitem__("truth/frame", np.dtype("f8")),
        "/truth/frame is not a dataset",
    ),
    "a group of itself": (lambda f: f.__setitem__("truth", f["/"]), "/truth/"),
    "a structure": (
        lambda f: replace(f, "focus/position", data=np.zeros(400, [("a", "f4")])),
        r"/focus/position holds \[\('a'",
    ),
    "a reference": (
        lambda f: replace(f, "focus/position", shape=(400,), dtype=h5py.ref_dtype),
        "/focus/position holds object",
    ),
    "text for numbers": (lambda f: replace(f, "focus/position", data="half"), "/focus/position holds object"),
    "a number for text": (lambda f: replace(f, "provenance/recipe", data=1), "/provenance/recipe holds int64"),
    "eight tebibytes": (
        lambda f: replace(f, "focus/position", shape=(1 << 41,), dtype="f4", chunks=(1 << 20,)),
        "/focus/position has the shape",
    ),
    "pixels without end": (
        lambda f: replace(f, "spikes", shape=(1 << 20, 1 << 20, 50), dtype="u1", chunks=(1, 1, 50)),
        "/spikes has 1,099,511,627,776 pixels",
    ),
    "a chunk without end": (
        lambda f: replace(f, "spikes", shape=(2000, 2000, 50), dtype="u1", chunks=(2000, 2000, 50)),
        "/spikes has chunks of 200,000,000 bytes",
    ),
    "many names": (
        lambda f: [f.create_dataset(f"provenance/{n}", data=1) for n in range(1001)],
        "/provenance holds 1,002 names",
    ),
    "a list for the format": (lambda f: f.attrs.__setitem__("format", ["saf-gen stream"] * 2), "not a saf-gen stream"),
    "a list for the layout": (lambda f: f.attrs.__setitem__("layout", [1, 1]), "has layout None"),
    "no rate": (lambda f: f["spikes"].attrs.__setitem__("readout_hz", np.nan), "does not state frames and readout_hz"),
    "words for frames": (lambda f: f["spikes"].attrs.__setitem__("frames", "many"), "truncated, damaged"),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_what_a_stream_does_not_hold_is_refused_in_one_line(untrusted, monkeypatch, attack):
    monkeypatch.chdir(untrusted.parent)
    change, message = ATTACKS[attack]
    with h5py.File(untrusted, "r+") as file:
        change(file)
    with pytest.raises(BadInput, match=message) as caught:
        open_stream(untrusted)
    assert "\n" not in str(caught.value)
    assert SECRET.decode()[:9] not in str(caught.value)


def test_text_that_claims_to_be_endless_is_refused_before_it_is_read(untrusted):
    """A text is stored as a reference of 16 bytes that begins with its length."""
    with h5py.File(untrusted) as file:
        at = file["provenance/recipe"].id.get_offset()
    raw = bytearray(untrusted.read_bytes())
    raw[at : at + 4] = struct.pack("<I", 0xFFFFFFFF)
    untrusted.write_bytes(raw)
    with pytest.raises(BadInput, match="/provenance/recipe holds 4,294,967,295 bytes of text"):
        open_stream(untrusted)


@pytest.mark.parametrize("length", [0, 2**63])
def test_text_whose_pieces_have_no_end_is_refused_before_hdf5_looks_for_it(untrusted, length):
    break_text_heap(untrusted, length)
    with pytest.raises(BadInput, match="its text is stored in broken pieces; make the file again"):
        open_stream(untrusted)


def test_no_text_is_read_before_all_are_checked(untrusted):
    with h5py.File(untrusted, "r+") as file:
        file.attrs["layout"] = "text where a number belongs"
    break_text_heap(untrusted, 0)
    with pytest.raises(BadInput, match="has layout None"):
        open_stream(untrusted)


@pytest.mark.parametrize(
    "chunks",
    [pytest.param((12, 10, 50), id="our chunks"), pytest.param((6, 10, 25), id="others", marks=pytest.mark.slow)],
)
def test_a_chunk_that_inflates_a_thousandfold_fills_no_memory(untrusted, chunks):
    with h5py.File(untrusted, "r+") as file:
        replace(file, "spikes", shape=(12, 10, 50), dtype="u1", chunks=chunks, compression="gzip")
        file["spikes"][:] = 0
        file["spikes"].id.write_direct_chunk((0, 0, 0), zlib.compress(bytes(1 << 27), 1))
    with open_stream(untrusted) as stream:
        tracemalloc.start()
        with pytest.raises(BadInput, match="a chunk does not hold"):
            stream.counts(0, 400)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 1 << 25  # the chunk has 0.5 MB deflated and 128 MB inflated


@pytest.mark.parametrize(
    ("chunks", "written", "said"),
    [
        ((6, 10, 25), 6, "2 of 4 chunks"),
        ((12, 10, 50), 0, "0 of 1 chunk"),
        ((5, 3, 7), 5, "32 of 96 chunks"),
        (None, 0, "0 of 1 chunk"),
    ],
)
def test_spikes_that_were_never_written_are_not_read_as_dark(untrusted, chunks, written, said):
    with h5py.File(untrusted, "r+") as file:
        replace(file, "spikes", shape=(12, 10, 50), dtype="u1", chunks=chunks)
        if written:
            file["spikes"][:written] = 0
    assert refusal(open_stream, untrusted).problem == f"/spikes was not written to its end: {said}"


SEED, FLIPS = 17, 200


@pytest.mark.slow
def test_no_flipped_bit_is_read_as_data(tmp_path):
    """Everything that a stream returns is as written, or the damage is reported."""
    path, rng = tmp_path / "a.h5", np.random.default_rng(SEED)
    frames = rng.random((2_100, 12, 10)) < 0.2
    metadata = {
        "focus_position": np.linspace(0, 1, 2_100),
        "gain": np.ones((2_100, 2)),
        "light_names": ("sun", "sky"),
        "truth": {"position": 0.163, "depth_of_focus": (0.1, 0.2), "frame": 3.5, "depth": np.ones((12, 10))},
        "provenance": {"recipe": "name: x\n" * 50, "seed": "3"},
    }
    write_stream(path, frames, **metadata)
    content = path.read_bytes()

    def read():
        with open_stream(path) as stream:
            yield stream.readout_hz, stream.content_sha256, stream.light_names, dict(stream.metadata.provenance)
            yield stream.truth.position, stream.truth.depth_of_focus, stream.truth.frame, stream.truth.depth.tobytes()
            yield stream.focus_position.tobytes(), stream.gain.tobytes(), stream.frames(0, 2_100).tobytes()

    written, refused = list(read()), 0
    for at, bit in zip(rng.integers(0, len(content), FLIPS), rng.integers(0, 8, FLIPS), strict=True):
        damaged = bytearray(content)
        damaged[at] ^= 1 << bit
        path.write_bytes(damaged)
        try:
            assert list(read()) == written, f"bit {bit} of byte {at}, seed {SEED}"
        except BadInput:
            refused += 1
    assert refused > FLIPS / 2
