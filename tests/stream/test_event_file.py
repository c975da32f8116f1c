"""The event file: what is written comes back, its index is DSEC's, and what is damaged is refused."""

import h5py
import numpy as np
import pytest
from refusals import refusal
from text_heap import break_text_heap

import saf_gen
from saf_gen.errors import BadInput
from saf_gen.stream.event_file import EventColumns, EventFile, EventWriter, has_events, intact_digest
from saf_gen.stream.metadata import Metadata, Truth

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


def test_no_event_at_all(tmp_path):
    write(tmp_path / "none.h5", some_events(0))
    with saf_gen.open_events(tmp_path / "none.h5") as events:
        events.verify()
        assert events.count == 0
        assert not events.counts(0, 0.2).any()


def test_times_that_fall_are_refused_and_nothing_is_left(tmp_path):
    late, early = some_events(10), some_events(10)

    def wrong():
        with EventWriter(tmp_path / "a.h5", shape=SHAPE, readout_hz=20_000, metadata=Metadata()) as writer:
            writer.write(late._replace(t=late.t + 1000))
            writer.write(early._replace(t=early.t % 7))

    assert "fall" in str(refusal(wrong))
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
    assert intact_digest(path, "") is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda file: file.attrs.update(format="another"), "format is 'another'"),
        (lambda file: file.attrs.update(layout=2), "layout version is"),
        (lambda file: file.attrs.pop("rows"), "size"),
        (lambda file: file.pop("events/p"), "has no /events/p"),
        (lambda file: file.create_dataset("events2", data=1), "events2"),
        (lambda file: file.create_dataset("truth/secret", data=1), "secret"),
        (lambda file: (file.pop("events/x"), file.create_dataset("events/x", data=np.zeros(7, "u2"))), "/events/x"),
        (lambda file: (file.pop("t_offset"), file.update({"t_offset": h5py.ExternalLink("b.h5", "/x")})), "link"),
        (lambda file: (file.pop("events/y"), file.update({"events/y": h5py.ExternalLink("b.h5", "/x")})), "link"),
    ],
)
def test_what_is_no_event_file_is_refused_in_one_line(path, change, words):
    with h5py.File(path, "r+") as file:
        change(file)
    assert words in str(refusal(EventFile, path))


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
