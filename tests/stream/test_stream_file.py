"""The stream file: data are read as written, plain h5py agrees, and no incomplete file is accepted."""

import hashlib
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import threading
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.core.bits import pack_bits
from saf_gen.errors import BadInput
from saf_gen.stream import time_blocks
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import StreamWriter, write_stream

DOCS = Path(__file__).parents[2] / "docs/files.md"


def random_frames(count, rows=6, columns=9, seed=0):
    return (np.random.default_rng(seed).random((count, rows, columns)) < 0.2).astype(np.uint8)


def full_metadata(count, rows=6, columns=9):
    sweep = np.linspace(0, 1, count, dtype=np.float32)
    plane = np.arange(rows * columns, dtype=np.float32).reshape(rows, columns)
    return {
        "focus_position": sweep,
        "image_distance": 0.05 + sweep,
        "object_distance": 1 + sweep,
        "gain": np.stack([sweep, 1 - sweep], axis=1),
        "light_names": ("sun", "lámpara"),
        "truth": Truth(0.4, (0.3, 0.5), 12.5, plane, plane > 3, plane / 54, np.arange(5.0)),
        "provenance": {"recipe": "name: x\n", "versions": "{}" * 60_000},
    }


@pytest.mark.parametrize("count", [1, 64, 2_001])
def test_frames_counts_and_bytes_come_back(tmp_path, count):
    frames = random_frames(count)
    digest = write_stream(tmp_path / "new" / "a.h5", frames.astype(bool))
    assert digest == write_stream(tmp_path / "a.h5", frames.astype(np.float32).tolist())
    with open_stream(tmp_path / "new" / "a.h5") as stream:
        assert stream.shape == frames.shape
        assert stream.readout_hz == 20_000
        assert stream.content_sha256 == digest
        assert np.array_equal(stream.frames(0, count), frames)
        assert stream.frames(0, count).dtype == np.uint8
        assert np.array_equal(stream.counts(0, count), frames.sum(axis=0))
        assert stream.counts(0, count).dtype == np.uint32
        assert np.array_equal(stream.packed(0, -(-count // 8)), pack_bits(frames))
        stream.verify()


@pytest.fixture(scope="module")
def chunked(tmp_path_factory):
    """A stream of 4,333 frames in nine chunks of 2 rows and 2,000 frames, and its frames; a test changes a copy."""
    frames = np.random.default_rng(1).integers(0, 2, (4_333, 6, 1_800), np.uint8)
    path = tmp_path_factory.mktemp("chunked") / "a.h5"
    write_stream(path, frames)
    with h5py.File(path) as file:
        assert file["spikes"].chunks == (2, 1_800, 250)
    return path, frames


def test_any_window_and_region_equals_slicing(chunked):
    path, frames = chunked
    packed = pack_bits(frames)
    draw = np.random.default_rng(3)
    with open_stream(path) as stream:
        for _ in range(60):
            a, b = sorted(draw.choice(4_334, 2, replace=False))
            p, q = sorted(draw.choice(543, 2, replace=False))
            (r0, r1), (c0, c1) = (sorted(draw.choice(n + 1, 2, replace=False)) for n in (6, 60))
            region = (slice(r0, r1), slice(c0, c1))
            assert np.array_equal(stream.frames(a, b, region=region), frames[a:b, r0:r1, c0:c1])
            assert np.array_equal(stream.counts(a, b, region=region), frames[a:b, r0:r1, c0:c1].sum(axis=0))
            assert np.array_equal(stream.packed(p, q, region=region), packed[r0:r1, c0:c1, p:q])


def damage(path, but=()):
    """Overwrite all chunks on the disk but those that begin at these rows and bytes."""
    with h5py.File(path) as file:
        chunks = file["spikes"].id
        places = [chunks.get_chunk_info(k) for k in range(chunks.get_num_chunks())]
    with path.open("r+b") as file:
        for place in places:
            if (place.chunk_offset[0], place.chunk_offset[2]) not in but:
                file.seek(place.byte_offset)
                file.write(bytes(place.size))


def test_a_stream_that_fits_in_memory_is_read_once(tmp_path, chunked):
    path, frames = shutil.copy(chunked[0], tmp_path / "a.h5"), chunked[1]
    with open_stream(path) as stream:
        counts = stream.counts(0, 4_333)
        damage(path)
        assert np.array_equal(stream.counts(0, 4_333), counts)
        assert np.array_equal(counts, frames.sum(axis=0))
        assert "damaged" in refusal(stream.verify).problem


def test_a_region_leaves_other_chunks_alone(tmp_path, chunked):
    path, frames = shutil.copy(chunked[0], tmp_path / "a.h5"), chunked[1]
    damage(path, but=[(0, 250), (2, 0), (2, 250), (2, 500), (4, 250)])
    with open_stream(path) as stream:
        assert np.array_equal(stream.counts(2_130, 2_140), frames[2_130:2_140].sum(axis=0))
        packed = stream.packed(0, 542, region=(slice(2, 3), slice(0, 9)))
        assert np.array_equal(packed, pack_bits(frames)[2:3, :9])
        assert "damaged" in refusal(stream.counts, 0, 10).problem


def test_plain_h5py_reads_the_documented_datasets(tmp_path):
    frames, metadata = random_frames(2_345), full_metadata(2_345)
    digest = write_stream(tmp_path / "a.h5", frames, readout_hz=40_000, **metadata)
    with h5py.File(tmp_path / "a.h5") as file:
        assert {"format": "saf-gen stream", "layout": 1, "content_sha256": digest}.items() <= dict(file.attrs).items()
        assert dict(file["spikes"].attrs) == {"frames": 2_345, "readout_hz": 40_000.0}
        unpacked = np.unpackbits(file["spikes"][:], axis=2, bitorder="little")
        assert np.array_equal(unpacked[:, :, :2_345].transpose(2, 0, 1), frames)
        assert not unpacked[:, :, 2_345:].any()
        assert file["focus/image_distance"].dtype == file["focus/object_distance"].dtype == np.float32
        assert file["light/names"].asstr()[:].tolist() == ["sun", "lámpara"]
        assert (file["truth/position"][()], file["truth/frame"][()]) == (0.4, 12.5)
        assert file["truth/target"].dtype == bool
        assert file["truth/sharpness"].dtype == np.float64
        assert file["provenance/recipe"].asstr()[()] == "name: x\n"


def test_metadata_comes_back(tmp_path):
    metadata = full_metadata(21)
    write_stream(tmp_path / "a.h5", random_frames(21), **metadata)
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.truth.known
        assert (stream.truth.position, stream.truth.depth_of_focus, stream.truth.frame) == (0.4, (0.3, 0.5), 12.5)
        for name in ("depth", "target", "best_position", "sharpness"):
            assert np.array_equal(getattr(stream.truth, name), getattr(metadata["truth"], name))
        for name in ("focus_position", "image_distance", "object_distance", "gain"):
            assert np.array_equal(getattr(stream.metadata, name), metadata[name])
        assert stream.light_names == ("sun", "lámpara")
        assert stream.metadata.provenance == metadata["provenance"]


def test_a_stream_without_metadata_has_none(tmp_path):
    write_stream(tmp_path / "a.h5", [[[True]], [[False]]])
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.focus_position is None
        assert stream.gain is None
        assert stream.light_names == ()
        assert not stream.truth.known
        assert np.isnan(stream.truth.frame)
    with h5py.File(tmp_path / "a.h5") as file:
        assert list(file) == ["spikes"]


def test_the_digest_covers_content_and_not_blocks_or_provenance(tmp_path):
    frames, metadata = random_frames(4_321), full_metadata(4_321)
    packed, digests = pack_bits(frames), set()
    for step in (37, 251, 541):
        described = Metadata(**{**metadata, "provenance": {"step": str(step)}})
        with StreamWriter(tmp_path / "a.h5", shape=frames.shape, metadata=described) as writer:
            for first in range(0, 541, step):
                writer.write(packed[:, :, first : first + step])
        digests.add(writer.content_sha256)
    assert digests == {write_stream(tmp_path / "b.h5", frames, **metadata)}


def test_the_digest_follows_every_value(tmp_path):
    frames, metadata = random_frames(20), full_metadata(20)
    flipped = frames.copy()
    flipped[13, 2, 3] ^= 1
    variants = [
        (frames, 20_000, metadata),
        (flipped, 20_000, metadata),
        (frames, 40_000, metadata),
        (frames[:19], 20_000, full_metadata(19)),
        (frames, 20_000, metadata | {"light_names": ("sun", "x")}),
        (frames, 20_000, metadata | {"truth": Truth(0.5)}),
        (frames, 20_000, metadata | {"gain": None, "light_names": ()}),
    ]
    digests = {write_stream(tmp_path / "a.h5", f, readout_hz=hz, **m) for f, hz, m in variants}
    assert len(digests) == len(variants)


def test_the_digest_is_as_documented(tmp_path):
    """Computed here only from the description in docs/files.md."""
    frames = random_frames(2_011)
    digest = write_stream(tmp_path / "a.h5", frames, truth={"position": 0.25}, light_names=("a", "b"))
    packed = np.packbits(frames, axis=0, bitorder="little").transpose(1, 2, 0)
    blocks = packed[:, :, :250].tobytes() + packed[:, :, 250:].tobytes()

    def sha(data):
        return hashlib.sha256(data).hexdigest()

    lines = [
        "readout_hz 20000.0",
        "frames 2011",
        f"/light/names text 2 {sha(b'a' + bytes(1) + b'b' + bytes(1))}",
        f"/spikes uint8 6x9x252 {sha(blocks)}",
        f"/truth/depth_of_focus float64 2 {sha(struct.pack('<dd', np.nan, np.nan))}",
        f"/truth/frame float64 scalar {sha(struct.pack('<d', np.nan))}",
        f"/truth/position float64 scalar {sha(struct.pack('<d', 0.25))}",
    ]
    assert digest == sha("\n".join(lines).encode())


def test_a_file_of_other_chunks_reads_the_same(tmp_path):
    frames = random_frames(2_345)
    write_stream(tmp_path / "a.h5", frames, truth={"position": 0.25})
    for name, how in {"plain": {}, "other": {"chunks": (3, 4, 100), "compression": "gzip", "shuffle": True}}.items():
        path = tmp_path / f"{name}.h5"
        with h5py.File(tmp_path / "a.h5") as old, h5py.File(path, "w") as new:
            new.attrs.update(old.attrs)
            new.create_dataset("spikes", data=old["spikes"][:], **how).attrs.update(old["spikes"].attrs)
            old.copy("truth", new)
        with open_stream(path) as stream:
            stream.verify()
            assert np.array_equal(stream.frames(1_990, 2_100), frames[1_990:2_100])


def test_a_chunk_that_hdf5_did_not_deflate_reads_the_same(tmp_path):
    """HDF5 skips deflate if it would not help, as for random bits."""
    frames = np.random.default_rng(0).integers(0, 2, (2_000, 20, 20), np.uint8)
    write_stream(tmp_path / "a.h5", frames)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        spikes = file["spikes"]
        spikes.id.write_direct_chunk((0, 0, 0), spikes[:].tobytes(), filter_mask=1)
    with open_stream(tmp_path / "a.h5") as stream:
        stream.verify()
        assert np.array_equal(stream.frames(0, 2_000), frames)


@pytest.mark.parametrize("shape", [(3,), (0, 2, 2), (2, 0, 2), (1, 2, 3, 4)])
def test_frames_must_have_three_axes_that_are_not_empty(tmp_path, shape):
    assert_says(refusal(write_stream, tmp_path / "a.h5", np.zeros(shape)), f"{shape} | (T, H, W)")


@pytest.mark.parametrize("value", [np.uint8(2), 2.0, -1.0, 0.5, np.nan])
def test_frames_must_hold_zero_and_one(tmp_path, value):
    """Frames of bytes, the usual ones, are checked separately."""
    frames = np.zeros((9, 2, 2), np.asarray(value).dtype)
    frames[8, 1, 1] = value
    assert_says(refusal(write_stream, tmp_path / "a.h5", frames), f"{value} | allowed: 0 and 1, or bool")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("focus_position", np.zeros(9), r"focus_position has shape \(9,\); allowed: \(10\)"),
        ("gain", np.zeros(10), r"gain has shape \(10,\); allowed: \(10, any G\)"),
        ("gain", np.zeros((9, 2)), r"gain has shape \(9, 2\)"),
        ("image_distance", ["a"] * 10, "image_distance has dtype"),
        ("image_distance", [1e300] * 10, r"image_distance holds 1e\+300; allowed: numbers that float32 can hold"),
        ("truth", {"depth": np.zeros((2, 2))}, r"depth has shape \(2, 2\); allowed: \(2, 3\)"),
        ("truth", {"depth_of_focus": (1, 2, 3)}, r"depth_of_focus has shape \(3,\); allowed: \(2\)"),
        ("truth", {"positon": 1}, "unknown field of truth 'positon'.*did you mean 'position'"),
        ("focus_positions", np.zeros(10), "unknown optional field 'focus_positions'.*mean 'focus_position'"),
        ("provenance", {"a/b": ""}, "provenance has the name 'a/b'"),
        ("provenance", {"a": 3}, "provenance/a holds 3; allowed: Unicode text"),
        ("light_names", ("a\0",), "light_names holds"),
        ("light_names", ("a",), "gain has 2 lights, light_names has 1"),
        ("readout_hz", 0, "readout_hz is 0"),
        ("readout_hz", np.nan, "readout_hz is nan"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, field, value, message):
    with pytest.raises(BadInput, match=message):
        write_stream(tmp_path / "a.h5", np.zeros((10, 2, 3)), **{"gain": np.zeros((10, 2)), field: value})


@pytest.mark.parametrize("field", ["focus_position", "track"])
def test_a_lens_and_a_track_are_known_in_every_frame_or_refused(tmp_path, field):
    held = np.linspace(0, 1, 10)
    held[[4, 7, 8]] = np.nan, np.inf, -np.inf
    optional = {field: held} if field == "focus_position" else {"truth": {"position": 0.5, field: held}}
    error = refusal(write_stream, tmp_path / "a.h5", np.zeros((10, 2, 3)), **optional)
    assert error.problem == f"{field} is not finite in 3 of 10 frames, first in frame 4"
    assert error.allowed == "a finite position in every frame"
    assert not list(tmp_path.iterdir())


def written(path, pieces, shape=(20, 2, 3)):
    with StreamWriter(path, shape=shape) as writer:
        for piece in pieces:
            writer.write(piece)


@pytest.mark.parametrize(
    ("pieces", "message"),
    [
        ([np.zeros((2, 3, 2), np.uint8)], "only 2 bytes along time were written; allowed: 3 for 20 frames"),
        ([np.zeros((2, 3, 2), np.uint8)] * 2, "4 bytes along time were written; allowed: 3 for 20 frames"),
        ([np.zeros((3, 2, 3), np.uint8)], r"dtype uint8 and shape \(3, 2, 3\); allowed: uint8 \(2, 3, bytes\)"),
        ([np.zeros((2, 3, 3))], "dtype float64"),
        ([np.full((2, 3, 3), 16, np.uint8)], "spikes after the last frame; allowed: 0 in bits 4 to 7, because T = 20"),
    ],
)
def test_wrong_pieces_are_refused_and_leave_nothing(tmp_path, pieces, message):
    with pytest.raises(BadInput, match=message):
        written(tmp_path / "a.h5", pieces)
    assert not list(tmp_path.iterdir())


def test_an_exception_leaves_neither_file_nor_temporary_and_keeps_the_old_one(tmp_path):
    digest = write_stream(tmp_path / "a.h5", np.zeros((3, 1, 1)))
    writer = StreamWriter(tmp_path / "a.h5", shape=(8, 1, 1))
    with pytest.raises(KeyboardInterrupt), writer:
        raise KeyboardInterrupt if list(tmp_path.glob(f".a.h5.*.{os.getpid()}.part")) else AssertionError
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.content_sha256 == digest


@pytest.mark.slow
def test_a_killed_writer_leaves_no_file_of_that_name(tmp_path):
    script = f"""
import numpy as np, time
from saf_gen.stream.stream_writer import StreamWriter
with StreamWriter({str(tmp_path / "a.h5")!r}, shape=(8000, 20, 20)) as writer:
    writer.write(np.zeros((20, 20, 500), np.uint8))
    print("half", flush=True)
    time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "half\n"
        process.send_signal(signal.SIGKILL)
        process.wait(10)
    assert list(tmp_path.iterdir()) == list(tmp_path.glob(f".a.h5.*.{process.pid}.part"))


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path):
    """A limit on the size of files acts like a full disk, with another errno.

    It is reached in the first structures of HDF5, in those written at the end, and in the spikes.
    """
    script = f"""
import resource, signal
import numpy as np
from saf_gen.errors import BadInput
from saf_gen.stream.stream_writer import write_stream
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
random = np.random.default_rng(0)
for limit, frames in ((600, 40), (6_000, 40), (100_000, 4_000)):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    spikes, provenance = random.integers(0, 2, (frames, 40, 40), np.uint8), {{"note": "x" * 3000, "more": "y" * 3000}}
    try:
        write_stream({str(tmp_path / "a.h5")!r}, spikes, provenance=provenance)
    except BadInput as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"(.*a\.h5 cannot be written: File too large; choose another folder\n){3}", done.stdout)
    assert done.stderr == ""
    assert not list(tmp_path.iterdir())


def test_an_error_of_the_caller_is_not_reported_as_one_of_the_stream(tmp_path):
    with pytest.raises(FileNotFoundError), StreamWriter(tmp_path / "a.h5", shape=(8, 1, 1)):
        (tmp_path / "frames.dat").read_bytes()
    assert not list(tmp_path.iterdir())


def test_writer_and_reader_use_the_threads_they_are_given(tmp_path):
    with StreamWriter(tmp_path / "a.h5", shape=(4_000, 20, 20), threads=1) as writer:
        writer.write(pack_bits(random_frames(4_000, 20, 20)))
        assert sum(t.name.startswith("deflate") for t in threading.enumerate()) == 1
    before = set(threading.enumerate())
    with open_stream(tmp_path / "a.h5", threads=1) as stream:
        stream.verify()
        assert sum(t.name.startswith("inflate") for t in set(threading.enumerate()) - before) == 1


def test_what_the_disk_changed_is_found_before_the_rename(tmp_path, monkeypatch):
    """A bit of the spikes flips when the file is closed."""
    close = h5py.File.close

    def close_and_flip(file):
        changes = bool(file) and file.mode == "r+"
        place = file["spikes"].id.get_chunk_info(0) if changes else None
        close(file)
        if changes:
            (part,) = tmp_path.iterdir()
            raw = bytearray(part.read_bytes())
            raw[place.byte_offset + place.size // 2] ^= 1
            part.write_bytes(raw)

    monkeypatch.setattr(h5py.File, "close", close_and_flip)
    assert "check the disk" in refusal(write_stream, tmp_path / "a.h5", np.ones((8, 1, 1))).hint
    assert not list(tmp_path.iterdir())


def test_changed_spikes_are_found_by_verify(tmp_path):
    write_stream(tmp_path / "a.h5", random_frames(100))
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["spikes"][0] = file["spikes"][0] + 1
    with open_stream(tmp_path / "a.h5") as stream, pytest.raises(BadInput, match=r"content has SHA-256 .* as stored"):
        stream.verify()


@pytest.mark.parametrize(("where", "what"), [("focus/position", "content"), ("provenance/recipe", "provenance")])
def test_a_changed_value_outside_the_spikes_is_found_on_opening(tmp_path, where, what):
    write_stream(tmp_path / "a.h5", random_frames(100), focus_position=np.zeros(100), provenance={"recipe": "name: x"})
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        value = file[where][()]
        file[where][()] = value + (b"y" if isinstance(value, bytes) else 1)
    with pytest.raises(BadInput, match=f"{what} has SHA-256 .* as stored"):
        open_stream(tmp_path / "a.h5")


def test_a_changed_byte_in_a_chunk_is_found(tmp_path):
    write_stream(tmp_path / "a.h5", random_frames(2_000, 20, 20))
    with h5py.File(tmp_path / "a.h5") as file:
        at = file["spikes"].id.get_chunk_info(0)
    raw = bytearray((tmp_path / "a.h5").read_bytes())
    for i in range(at.byte_offset + 100, at.byte_offset + 140):
        raw[i] ^= 0xFF
    (tmp_path / "a.h5").write_bytes(raw)
    with open_stream(tmp_path / "a.h5") as stream:
        for read in (stream.verify, lambda: stream.counts(0, 9), lambda: stream.packed(0, 250)):
            assert "truncated, damaged" in str(refusal(read))
        assert "truncated, damaged" in str(refusal(lambda: list(stream.counts_of_windows([0], 100))))


@pytest.mark.parametrize("kept", [1, 100, 0.5, -1])
def test_a_truncated_file_is_refused(tmp_path, kept):
    write_stream(tmp_path / "a.h5", random_frames(2_000, 20, 20), **full_metadata(2_000, 20, 20))
    raw = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "a.h5").write_bytes(raw[: int(kept * len(raw)) if 0 < kept < 1 else kept])
    problem = refusal(open_stream, tmp_path / "a.h5").problem
    assert "truncated, damaged" in problem or "not an HDF5 file" in problem


def test_a_missing_file_names_the_nearest(tmp_path):
    write_stream(tmp_path / "camel-constant-0.h5", np.zeros((3, 1, 1)))
    assert_says(refusal(open_stream, tmp_path / "camel-constant-1.h5"), "no such file | 'camel-constant-0.h5'")
    assert "there is no folder" in str(refusal(open_stream, tmp_path / "none" / "a.h5"))
    (tmp_path / "of" / "test").mkdir(parents=True)
    (tmp_path / "of/test/a.h5").touch()
    for folder, nearest in ((tmp_path, "camel-constant-0.h5"), (tmp_path / "of", "of/test/a.h5")):
        assert_says(refusal(open_stream, folder), f"this is a folder | mean '{tmp_path / nearest}'")


def test_a_file_of_another_kind_is_refused(tmp_path):
    path = tmp_path / "a.h5"
    path.touch()
    assert "is empty" in str(refusal(open_stream, path))
    path.write_text("hello, hello, hello")
    assert "is not an HDF5 file" in str(refusal(open_stream, path))
    with h5py.File(path, "w") as file:
        file["x"] = 1
    assert_says(refusal(open_stream, path), "not a saf-gen stream | attribute format")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.attrs.__setitem__("layout", 2), "has layout 2; allowed: layout 1; update saf_gen"),
        (lambda f: f.__delitem__("spikes"), "truncated, damaged"),
        (lambda f: f["spikes"].attrs.__delitem__("frames"), "/spikes does not state frames and readout_hz"),
        (lambda f: f["spikes"].attrs.__setitem__("frames", 9), r"/spikes is uint8 \(1, 1, 1\) for 9 frames"),
        (lambda f: f.create_dataset("focus/position", data=[1.0]), r"focus_position has shape \(1,\)"),
    ],
)
def test_a_file_that_breaks_the_layout_is_refused(tmp_path, change, message):
    write_stream(tmp_path / "a.h5", np.zeros((3, 1, 1)))
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        change(file)
    with pytest.raises(BadInput, match=message):
        open_stream(tmp_path / "a.h5")


def test_reads_outside_say_the_range(tmp_path):
    write_stream(tmp_path / "a.h5", np.zeros((20, 2, 3)))
    with open_stream(tmp_path / "a.h5") as stream:
        for a, b in ((-1, 3), (0, 21), (5, 4), (5, 5)):
            for read in (stream.frames, stream.counts):
                error = refusal(read, a, b)
                assert f"frames {a} to {b}" in error.problem
                assert "<= 20" in error.allowed
        assert_says(refusal(stream.packed, 0, 4), "bytes 0 to 4 | <= 3")
        assert "whole numbers" in str(refusal(stream.counts, 0, 1.5))
        for region in ((slice(0, 3), slice(0, 3)), (slice(1, 1), slice(0, 3)), (slice(0, 2), slice(0, 3, 2))):
            assert "slice" in refusal(stream.counts, 0, 1, region=region).problem


def test_the_example_in_the_docs_runs(tmp_path, monkeypatch):
    frames = random_frames(2_345)
    write_stream(tmp_path / "sequence.h5", frames)
    monkeypatch.chdir(tmp_path)
    code = re.search(r"```python\n(import h5py.*?)```", DOCS.read_text(), re.DOTALL)[1]
    names = {}
    exec(code, names)
    assert np.array_equal(names["frames"], frames)
    assert np.array_equal(names["counts"], frames[1_000:1_100].sum(axis=0))
    with open_stream("sequence.h5") as stream:
        assert names["content_sha256"] == stream.content_sha256


@pytest.mark.parametrize("what", ["write", "count", "verify"])
def test_memory_does_not_grow_with_time(tmp_path, monkeypatch, what):
    monkeypatch.setattr(time_blocks, "BUDGET_BYTES", 0)
    time_block = pack_bits(random_frames(2_000, 40, 40))
    peaks = []
    for count in (10, 40):
        path = tmp_path / f"{count}.h5"
        tracemalloc.start()
        with StreamWriter(path, shape=(2_000 * count, 40, 40)) as writer:
            for _ in range(count):
                writer.write(time_block)
        if what != "write":
            tracemalloc.reset_peak()
            with open_stream(path) as stream:
                stream.verify() if what == "verify" else stream.counts(0, 2_000 * count)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # Thirty more blocks are streamed; the number of blocks in the threads at the peak varies by a few.
    assert peaks[1] < peaks[0] + 5 * time_block.nbytes
