"""The event file: what is written comes back, its index is DSEC's, and what is damaged is refused."""

import itertools
import zlib

import h5py
import numpy as np
import pytest
from refusals import refusal
from text_heap import break_text_heap

import saf_gen
from saf_gen.errors import BadInput
from saf_gen.stream.event_file import CHUNK, COLUMNS, EventColumns, EventFile, EventWriter, has_events
from saf_gen.stream.full_disk import ErrorRecordingFile
from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.recordings import recording_of

SHAPE = (4000, 6, 9)  # 0.2 s


def some_events(count=5000, seed=1):
    random = np.random.default_rng(seed)
    t = np.sort(random.integers(0, 199_000, count))
    return EventColumns(
        random.integers(0, 9, count).astype(np.uint16),
        random.integers(0, 6, count).astype(np.uint16),
        t.astype(np.uint32),
        random.integers(0, 2, count).astype(np.uint8),
    )


def write(path, events, *, pieces=1, **provenance):
    metadata = Metadata(
        focus_position=np.linspace(0, 1, SHAPE[0], dtype=np.float32),
        truth=Truth(position=0.4, depth_of_focus=(0.38, 0.42), frame=1600.0),
        provenance=provenance,
    )
    with EventWriter(path, shape=SHAPE, readout_hz=20_000, metadata=metadata) as writer:
        for part in np.array_split(np.arange(len(events.t)), pieces):
            writer.write(EventColumns(*(column[part] for column in events)))
    return writer.content_sha256


@pytest.fixture
def path(tmp_path):
    write(tmp_path / "events.h5", some_events())
    return tmp_path / "events.h5"


def test_what_is_written_comes_back(path):
    with saf_gen.open_events(path) as events:
        events.verify()
        assert (events.count, events.shape, events.seconds) == (5000, SHAPE, 0.2)
        assert events.truth.position == 0.4
        for got, put in zip(events.events(0, 0.2), some_events(), strict=True):
            np.testing.assert_array_equal(got, put)
            assert got.dtype == put.dtype


@pytest.mark.parametrize(("first", "stop"), [(0.0, 0.001), (0.05, 0.0512), (0.123456, 0.123457), (0.1985, 0.2)])
def test_events_of_a_time_are_those_of_that_time(path, first, stop):
    everything = some_events()
    within = (everything.t >= round(first * 1e6)) & (everything.t < round(stop * 1e6))
    with saf_gen.open_events(path) as events:
        np.testing.assert_array_equal(events.events(first, stop).t, everything.t[within])
        assert events.counts(first, stop).sum() == within.sum()


def test_plain_h5py_finds_a_millisecond_as_in_dsec(path):
    with h5py.File(path) as file:
        t, index = file["events/t"][:], file["ms_to_idx"][:]
        assert file["t_offset"][()] == 0
        assert {name: file[f"events/{name}"].dtype.name for name in "xytp"} == {
            "x": "uint16", "y": "uint16", "t": "uint32", "p": "uint8"
        }  # fmt: skip
    assert len(index) >= 200
    for ms, at in enumerate(index[:200].astype(int)):
        assert at == len(t) or t[at] >= 1000 * ms
        assert at == 0 or t[at - 1] < 1000 * ms


def test_pieces_do_not_matter(tmp_path):
    digests = {write(tmp_path / f"{n}.h5", some_events(), pieces=n) for n in (1, 3, 40)}
    assert len(digests) == 1
    assert write(tmp_path / "other.h5", some_events(seed=2)) not in digests


def test_hdf5_reads_nothing_back_while_events_are_written(tmp_path, monkeypatch):
    """On a full disk, it would read what was never written; 300,000 events are five chunks of each column."""
    read, readinto = [], ErrorRecordingFile.readinto
    monkeypatch.setattr(
        ErrorRecordingFile, "readinto", lambda disk, data: read.append(len(data)) or readinto(disk, data)
    )
    put = some_events(300_000)
    write(tmp_path / "events.h5", put, pieces=70)
    assert read == []
    with saf_gen.open_events(tmp_path / "events.h5") as events:
        events.verify()
        for got, wanted in zip(events.events(0, 0.2), put, strict=True):
            np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize(("frames", "hz"), [(4000, 20_000.0), (4001, 20_000.0), (1000, 30_000.0), (7, 20_000.0)])
def test_the_index_reaches_past_the_last_event_and_slices_add_up_to_all_of_them(tmp_path, frames, hz):
    """Recordings of whole milliseconds, of whole microseconds, and of neither."""
    end = round(frames / hz * 1e6)
    put = some_events(500)._replace(t=np.sort(np.random.default_rng(2).integers(0, end, 500)))
    put.t[-1] = end - 1
    metadata = Metadata(focus_position=np.zeros(frames, np.float32))
    with EventWriter(tmp_path / "a.h5", shape=(frames, 6, 9), readout_hz=hz, metadata=metadata) as writer:
        writer.write(put)
    with h5py.File(tmp_path / "a.h5") as file:
        index = file["ms_to_idx"][:]
    assert index[-1] == 500
    assert (len(index) - 2) * 1000 < end <= (len(index) - 1) * 1000
    with saf_gen.open_events(tmp_path / "a.h5") as events:
        events.verify()
        assert events.events(0, events.seconds).t.size == events.count == events.counts_of_ms().sum() == 500
        edges = np.linspace(0, events.seconds, 8)
        assert sum(events.counts(a, b).sum() for a, b in itertools.pairwise(edges)) == 500


@pytest.mark.parametrize(
    ("full_s", "words"),
    [(None, ""), (0.0, "never full"), (0.0123, "full for 12.3 ms, 6.15% of the time"), (0.2, "200 ms, 100.00% of")],
)
def test_inspect_says_for_how_long_the_bus_was_full(tmp_path, call, full_s, words):
    with EventWriter(tmp_path / "a.h5", shape=SHAPE, readout_hz=20_000, metadata=Metadata()) as writer:
        writer.write(some_events())
        writer.notes = {} if full_s is None else {"bus_full_s": f"{full_s:.6f}"}
    with saf_gen.open_events(tmp_path / "a.h5") as events:
        assert events.bus_full_s == full_s
    code, output, _ = call("inspect", tmp_path / "a.h5")
    assert code == 0
    assert words in output
    assert ("full" in output) == (full_s is not None)


@pytest.mark.parametrize("text", ["soon", "nan", "-1", "0.3"])
def test_a_bus_that_was_full_for_no_part_of_the_recording_is_refused(tmp_path, text):
    write(tmp_path / "a.h5", some_events(), bus_full_s=text)
    assert f"/provenance/bus_full_s is '{text}'; allowed: 0 to 0.2" in str(
        refusal(saf_gen.open_events, tmp_path / "a.h5")
    )


def test_no_event_at_all(tmp_path):
    write(tmp_path / "none.h5", some_events(0))
    with saf_gen.open_events(tmp_path / "none.h5") as events:
        events.verify()
        assert events.count == 0
        assert not events.counts(0, 0.2).any()


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([[10, 20], [5, 30]], "the times of events fall"),
        ([[10, 30, 20, 40]], "the times of events fall"),
        ([[10, 20], [30, 200_000]], "an event was read after 200,000 µs; allowed: events before the end"),
        ([[10, 20], [30, 2**32]], "an event was read after 4,294,967,296 µs; allowed: events before the end"),
    ],
)
def test_times_that_fall_or_leave_the_recording_are_refused_and_nothing_is_left(tmp_path, times, words):
    def wrong():
        with EventWriter(tmp_path / "a.h5", shape=SHAPE, readout_hz=20_000, metadata=Metadata()) as writer:
            for t in times:
                writer.write(some_events(len(t))._replace(t=np.array(t)))

    assert words in str(refusal(wrong))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("damage", ["events/x", "events/p", "truth/position", "ms_to_idx"])
def test_a_changed_value_is_found(path, damage):
    with h5py.File(path, "r+") as file:
        held = file[damage]
        if held.shape:
            held[3] = held[3] + 1
        else:
            held[()] = held[()] + 0.01

    def verify():
        with saf_gen.open_events(path) as events:
            events.verify()

    refusal(verify)
    assert recording_of(path, "", verify=True) is None


GROWING = {"chunks": (CHUNK,), "maxshape": (None,)}


def put(name, data, **options):
    """Return a change of a file: a dataset in place of another."""

    def change(file):
        file.pop(name, None)
        file.create_dataset(name, data=data, **options)

    return change


def never_written(name, dtype, shape, **options):
    def change(file):
        del file[name]
        file.create_dataset(name, shape, dtype, **options)

    return change


def column(name, data):
    return put(f"events/{name}", data, **GROWING)


def with_value(name, at, value):
    return lambda file: file[name].__setitem__(at, value)


def linked_group(file):
    del file["events"]
    file["events"] = h5py.ExternalLink("other.h5", "/events")


def deflated_bomb(file):
    """200 MB in a chunk of 128 KiB."""
    del file["events/x"]
    stored = file.create_dataset("events/x", (5000,), "u2", **GROWING, compression="gzip")
    stored.id.write_direct_chunk((0,), zlib.compress(bytes(200 << 20)))


def deflated_twice(file):
    del file["events/x"]
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((CHUNK,))
    plist.set_deflate(9)
    plist.set_deflate(9)
    h5py.h5d.create(
        file.id, b"events/x", h5py.h5t.NATIVE_UINT16, h5py.h5s.create_simple((5000,), (h5py.h5s.UNLIMITED,)), plist
    )


HUGE = 1_600_000_000
"""Milliseconds of an index that takes 12 GiB in memory and nothing in the file."""
FOREIGN = {
    "another format": (lambda file: file.attrs.update(format="another"), "format is 'another'"),
    "another layout": (lambda file: file.attrs.update(layout=2), "layout version is"),
    "no rows": (lambda file: file.attrs.pop("rows"), "does not say its size"),
    "half a row": (lambda file: file.attrs.update(rows=6.5), "does not say its size"),
    "no rate": (lambda file: file.attrs.update(readout_hz=np.nan), "does not say its size"),
    "pixels without end": (lambda file: file.attrs.update(rows=1 << 40), "has 9,895,604,649,984 pixels"),
    "hours": (lambda file: file.attrs.update(readout_hz=0.5), "lasts 8000 s; allowed: at most 4,000 s"),
    "more frames than its logs": (lambda file: file.attrs.update(frames=8000, readout_hz=40_000.0), "focus_position"),
    "no polarities": (lambda file: file.pop("events/p"), "has no /events/p"),
    "an unknown dataset": (lambda file: file.create_dataset("events2", data=1), "events2"),
    "an unknown column": (lambda file: file.create_dataset("events/z", data=1), "/events/z, which is not part"),
    "an unknown truth": (lambda file: file.create_dataset("truth/secret", data=1), "secret"),
    "another length": (column("x", np.zeros(7, "u2")), "/events/x is uint16 (7,)"),
    "two axes": (put("events/x", np.zeros((5000, 1), "u2")), "/events/x is uint16 (5000, 1)"),
    "wrong type of a column": (column("x", np.zeros(5000, "i4")), "/events/x is int32 (5000,)"),
    "a column of NaN": (column("t", np.full(5000, np.nan)), "/events/t is float64 (5000,)"),
    "one long chunk": (never_written("events/x", "u2", (5000,), chunks=(1 << 26,), maxshape=(None,)), "in chunks of"),
    "a column never written": (
        never_written("events/y", "u2", (5000,), **GROWING), "/events/y was not written to its end: 0 of 1 chunk"
    ),
    "columns never written": (
        lambda file: [never_written(f"events/{c}", d, (1 << 38,), **GROWING)(file) for c, d in COLUMNS.items()],
        "/events/x was not written to its end: 0 of 4194304 chunks",
    ),
    "another filter": (put("events/x", np.zeros(5000, "u2"), **GROWING, compression="lzf"), "the filters [32000]"),
    "a bomb": (deflated_bomb, "has a chunk of"),
    "a bomb in a bomb": (deflated_twice, "the filters [1, 1]"),
    "an offset": (put("t_offset", np.int64(5)), "/t_offset is not 0"),
    "offsets": (put("t_offset", np.zeros(3, "i8")), "/t_offset is not 0"),
    "a text for the offset": (put("t_offset", "0"), "/t_offset is not 0"),
    "a linked offset": (
        lambda file: (file.pop("t_offset"), file.update({"t_offset": h5py.ExternalLink("b.h5", "/x")})), "link"
    ),
    "a linked column": (
        lambda file: (file.pop("events/y"), file.update({"events/y": h5py.ExternalLink("b.h5", "/x")})), "link"
    ),
    "linked columns": (linked_group, "/events is a link"),
    "no index": (lambda file: file.pop("ms_to_idx"), "has no /ms_to_idx"),
    "an empty index": (put("ms_to_idx", np.zeros(0, "u8")), "/ms_to_idx is uint64 (0,); allowed: uint64 (201,)"),
    "an index of two axes": (put("ms_to_idx", np.zeros((201, 1), "u8")), "/ms_to_idx is uint64 (201, 1)"),
    "an index of NaN": (put("ms_to_idx", np.full(201, np.nan)), "/ms_to_idx is float64 (201,)"),
    "a signed index": (put("ms_to_idx", np.zeros(201, "i8")), "/ms_to_idx is int64 (201,)"),
    "a short index": (put("ms_to_idx", np.zeros(200, "u8")), "/ms_to_idx is uint64 (200,)"),
    "an index without end": (never_written("ms_to_idx", "u8", (HUGE,), chunks=(1 << 20,)), "/ms_to_idx is uint64 (16"),
    "an index in chunks": (put("ms_to_idx", np.zeros(201, "u8"), chunks=(201,)), "is uint64 (201,) in chunks"),
    "an index never written": (never_written("ms_to_idx", "u8", (201,)), "/ms_to_idx was not written to its end"),
    "an index that falls": (with_value("ms_to_idx", 50, 0), "/ms_to_idx falls or leaves the events"),
    "an index that begins late": (with_value("ms_to_idx", slice(0, 2), 3), "/ms_to_idx falls or leaves the events"),
    "an index beyond the events": (with_value("ms_to_idx", 200, 5001), "/ms_to_idx falls or leaves the events"),
    "an index without its end": (with_value("ms_to_idx", 200, 4999), "/ms_to_idx falls or leaves the events"),
    "a long index": (put("ms_to_idx", np.full(202, 5000, "u8")), "/ms_to_idx is uint64 (202,)"),
    "an endless index": (with_value("ms_to_idx", 200, 2**64 - 1), "/ms_to_idx falls or leaves the events"),
}  # fmt: skip
DISPLACED = {
    "columns beyond the sensor": (with_value("events/x", 2500, 9), "/events/x holds 9; allowed: 0 to 8"),
    "rows beyond the sensor": (with_value("events/y", 2500, 65535), "/events/y holds 65535; allowed: 0 to 5"),
    "a third polarity": (with_value("events/p", 2500, 2), "/events/p holds 2; allowed: 0 to 1"),
    "a time that falls": (with_value("events/t", 2500, 0), "the times of its events fall"),
    "a time after the end": (with_value("events/t", 4999, 200_000), "/events/t holds 200000; allowed: 0 to 199999"),
    "a time long after the end": (with_value("events/t", 4999, 4_000_000_000), "/events/t holds 4000000000"),
    "no time at all": (with_value("events/t", slice(None), 0), "its index of milliseconds does not fit"),
    "an index of others": (
        with_value("ms_to_idx", slice(1, -1), 2500), "its index of milliseconds does not fit its events"
    ),
}  # fmt: skip
"""What shows when events are read, so that a large file opens as fast as a small one."""


def read_file(path):
    with saf_gen.open_events(path) as events:
        events.counts(0, 0.2)


def verify_file(path):
    with saf_gen.open_events(path) as events:
        events.verify()


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_no_event_file_is_refused_in_one_line_when_it_is_opened(path, kind):
    change, words = FOREIGN[kind]
    with h5py.File(path.with_name("other.h5"), "w") as other:
        other["events/x"] = 1
    with h5py.File(path, "r+") as file:
        change(file)
    assert words in str(refusal(EventFile, path))


@pytest.mark.parametrize("read", [read_file, verify_file])
@pytest.mark.parametrize("kind", DISPLACED)
def test_events_that_no_camera_records_are_refused_where_they_are_read(path, kind, read):
    change, words = DISPLACED[kind]
    with h5py.File(path, "r+") as file:
        change(file)
    assert words in str(refusal(read, path))


@pytest.mark.parametrize("kind", ["an index without end", "a column never written", "columns beyond the sensor"])
def test_every_command_says_in_one_line_what_is_wrong_with_events(tmp_path, call, kind):
    """Of a dataset, `verify` and `evaluate` name the sequence and end with exit code 1, as with any damaged file."""
    path = tmp_path / "events.h5"
    digest = write(path, some_events())
    entry = SequenceEntry("a", "test", "plane", 0, "static", "sweep", "constant", 0, 1, path.name, 4000, "f", digest)
    write_manifest(tmp_path, Manifest("made", "r", "llvm", (entry,)))
    change, words = (FOREIGN | DISPLACED)[kind]
    with h5py.File(path, "r+") as file:
        change(file)
    judge = ("evaluate", tmp_path, "--method", "er_count+argmax:window=100", "--out", tmp_path / "judged")
    view = ("view", path, "--out", tmp_path / "view.png")
    for arguments, ends in ((("inspect", path), 2), (view, 2), (("verify", tmp_path), 1), (judge, 1)):
        code, _, error = call(*arguments)
        assert (code, words in error, error.count("\n")) == (ends, True, 1), error
    assert not (tmp_path / "view.png").exists()


def test_other_files_are_refused_by_name(path, tmp_path):
    stream = tmp_path / "stream.h5"
    saf_gen.write_stream(stream, np.zeros((16, 4, 4), np.uint8))
    (tmp_path / "text.h5").write_text("no events")
    assert "saf-gen recapture" in str(refusal(saf_gen.open_events, stream))
    refusal(saf_gen.open_events, tmp_path / "text.h5")
    refusal(saf_gen.open_events, tmp_path / "missing.h5")
    assert "saf_gen.open_events" in str(refusal(saf_gen.open_stream, path))
    assert [has_events(tmp_path / name) for name in ("events.h5", "stream.h5", "text.h5", "missing.h5")] == [
        True, False, False, False
    ]  # fmt: skip


@pytest.mark.parametrize("length", [0, 2**63])
def test_text_whose_pieces_have_no_end_is_refused_before_hdf5_looks_for_it(tmp_path, length):
    path = tmp_path / "events.h5"
    write(path, some_events(), recipe="name: x")
    break_text_heap(path, length)
    assert has_events(path)
    assert "its text is stored in broken pieces" in str(refusal(saf_gen.open_events, path))
    assert "holds events" in str(refusal(saf_gen.open_stream, path))


def test_events_of_others_are_refused_by_what_they_lack(tmp_path):
    """DSEC's own files have these columns, and neither a size nor a truth."""
    with h5py.File(tmp_path / "dsec.h5", "w") as file:
        for name, column in some_events()._asdict().items():
            file[f"events/{name}"] = column
    assert "holds no events of ours" in str(refusal(saf_gen.open_events, tmp_path / "dsec.h5"))
    assert "not a saf-gen stream" in str(refusal(saf_gen.open_stream, tmp_path / "dsec.h5"))


@pytest.mark.parametrize(("first", "stop"), [(0.1, 0.1), (-0.1, 0.1), (0.1, 0.3), (0.2, 0.1)])
def test_times_outside_the_recording_are_refused(path, first, stop):
    with saf_gen.open_events(path) as events:
        refusal(events.events, first, stop)


@pytest.mark.slow
def test_a_flipped_byte_is_found_or_changes_nothing(path):
    """200 places, evenly: a reader gets what was written, or one line."""
    made, put = path.read_bytes(), some_events()
    found = 0
    for at in np.linspace(0, len(made) - 1, 200).astype(int):
        damaged = bytearray(made)
        damaged[at] ^= 0x55
        path.write_bytes(damaged)
        try:
            with saf_gen.open_events(path) as events:
                events.verify()
                held = events.events(0, 0.2)
        except BadInput:
            found += 1
            continue
        for got, wanted in zip(held, put, strict=True):
            np.testing.assert_array_equal(got, wanted)
    assert found > 100
