"""Spikes in .npy, .npz and .mat files, and SAF's folders: read correctly and in parts, and nothing in them is run."""

import struct
import zipfile

import h5py
import numpy as np
import pytest
from openpyxl import load_workbook
from planted_sweeps import list_streams
from refusals import assert_says, refusal
from scipy import io
from spreadsheets import HEADING, write_xlsx

from saf_gen.stream.interop import SpikeArray, export_raw_frames
from saf_gen.stream.interop.array_files import open_array
from saf_gen.stream.interop.saf_folder import import_saf_folder, read_saf_config
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

SPIKES = np.random.default_rng(7).integers(0, 2, (41, 5, 6), np.uint8)
PACKED = np.packbits(SPIKES, axis=0, bitorder="little")


def write_hdf5_matlab(path, **arrays):
    """Write a MATLAB file of version 7.3: HDF5 after 512 bytes, with reversed axes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            file.create_dataset(name, data=array.transpose())
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))


TIME_LAST = SPIKES.transpose(1, 2, 0)
LSB, MSB = ("--bits", "lsb"), ("--bits", "msb")
WRITERS = {
    "a.npy": (lambda path: np.save(path, SPIKES), "TYX", ()),
    "bool.npy": (lambda path: np.save(path, SPIKES.astype(bool)), "TYX", ()),
    "float.npy": (lambda path: np.save(path, SPIKES.astype(np.float32)), "TYX", ()),
    "time last.npy": (lambda path: np.save(path, TIME_LAST), "YXT", ()),
    "columns first.npy": (lambda path: np.save(path, SPIKES.transpose(2, 0, 1)), "XTY", ()),
    "lsb.npy": (lambda path: np.save(path, PACKED), "TYX", LSB),
    "msb.npy": (lambda path: np.save(path, np.packbits(SPIKES, axis=0)), "TYX", MSB),
    "columns.npy": (lambda path: np.save(path, np.asfortranarray(SPIKES)), "TYX", ()),
    "a.npz": (lambda path: np.savez(path, note=np.arange(3), seq=SPIKES), "TYX", ()),
    "lsb.npz": (lambda path: np.savez_compressed(path, seq=PACKED), "TYX", LSB),
    "last.npz": (lambda path: np.savez_compressed(path, seq=np.packbits(TIME_LAST, axis=2)), "YXT", MSB),
    "old.mat": (lambda path: io.savemat(path, {"spk": TIME_LAST, "rate": 20_000.0}), "YXT", ()),
    "first.mat": (lambda path: io.savemat(path, {"spk": SPIKES}), "TYX", ()),
    "lsb.mat": (lambda path: io.savemat(path, {"spk": PACKED.transpose(1, 2, 0)}), "YXT", LSB),
    "logical.mat": (lambda path: io.savemat(path, {"spk": TIME_LAST > 0}, do_compression=True), "YXT", ()),
    "new.mat": (lambda path: write_hdf5_matlab(path, spk=TIME_LAST, rate=np.ones((1, 1))), "YXT", ()),
}


@pytest.mark.parametrize("name", WRITERS)
def test_an_array_of_each_kind_is_read_bit_for_bit_as_it_is_stated(tmp_path, call, name):
    write, axes, packing = WRITERS[name]
    write(tmp_path / name)
    options = ("--frames", 41, "--rate", 40_000, "--axes", axes, *packing)
    code, out, err = call("import", tmp_path / name, "--out", tmp_path / "a.h5", *options)
    assert (code, err) == (0, "")
    assert f"read as an array with axes {axes}" in out
    assert ("eight frames per byte" in out) == bool(packing)
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.readout_hz == 40_000
        assert np.array_equal(stream.frames(0, 41), SPIKES)


@pytest.mark.parametrize(("name", "shape"), [("a.npy", (41, 5, 6)), ("a.npz", (41, 5, 6)), ("old.mat", (5, 6, 41))])
def test_axes_are_asked_for_with_the_shape_that_the_other_program_shows(tmp_path, call, name, shape):
    WRITERS[name][0](tmp_path / name)
    code, _, err = call("import", tmp_path / name, "--out", tmp_path / "a.h5")
    assert code == 2
    assert f"an array of the shape {shape} does not say which axis is time; allowed: --axes" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "a.h5").exists()


UNCLEAR = {
    "bytes": (PACKED, {}, "in frame 0 or a later one | add --bits lsb or --bits msb"),
    "0 and 255": (SPIKES * 255, {}, "holds 255 | allowed: 0 and 1"),
    "bytes without a spike": (SPIKES * 0, {}, "may be one readout or eight | store it as bool"),
    "bool as bytes": (SPIKES > 0, {"order": "lsb"}, "--bits lsb is given for an array of bool"),
    "not a number": (SPIKES * np.nan, {}, "holds nan"),
}


@pytest.mark.parametrize(("array", "options", "words"), UNCLEAR.values(), ids=UNCLEAR)
def test_values_that_may_be_readouts_or_bytes_are_not_guessed(tmp_path, array, options, words):
    np.save(tmp_path / "a.npy", array)
    says = refusal(lambda: SpikeArray(tmp_path / "a.npy", axes="TYX", **options).write(tmp_path / "a.h5", readout_hz=1))
    assert_says(says, words)
    assert not (tmp_path / "a.h5").exists()


def test_an_array_without_a_spike_is_read_where_its_type_or_its_user_says_how(tmp_path):
    np.save(tmp_path / "a.npy", SPIKES > 1)
    assert not SpikeArray(tmp_path / "a.npy", axes="TYX").frames(0, 41).any()
    np.save(tmp_path / "a.npy", 0 * SPIKES)
    assert SpikeArray(tmp_path / "a.npy", axes="TYX", order="lsb").shape == (8 * 41, 5, 6)


def test_packed_frames_without_a_number_fill_whole_bytes(tmp_path):
    np.save(tmp_path / "a.npy", PACKED)
    assert SpikeArray(tmp_path / "a.npy", axes="TYX", order="lsb").shape == (48, 5, 6)
    assert SpikeArray(tmp_path / "a.npy", axes="TYX", order="lsb", frames=3).shape == (3, 5, 6)


def test_rows_are_turned_over_and_a_lens_is_read(tmp_path, call):
    np.save(tmp_path / "a.npy", SPIKES)
    (tmp_path / "lens.csv").write_text("frame,position\n0,0\n40,1\n")
    options = ("--axes", "TYX", "--flip", "--focus", tmp_path / "lens.csv", "--truth", "frame:10")
    assert call("import", tmp_path / "a.npy", "--out", tmp_path / "a.h5", *options)[0] == 0
    with open_stream(tmp_path / "a.h5") as stream:
        assert np.array_equal(stream.frames(0, 41), SPIKES[:, ::-1])
        assert stream.truth.position == pytest.approx(0.25)


def test_a_long_array_in_an_archive_is_inflated_once(tmp_path, monkeypatch):
    """Blocks of 2,000 frames are read one after the other; the file is opened for its header and its content."""
    long = np.random.default_rng(3).integers(0, 2, (5_000, 3, 4), np.uint8)
    np.savez_compressed(tmp_path / "a.npz", seq=long)
    opened = []
    real = zipfile.ZipFile.open
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *args, **options: opened.append(1) or real(*args, **options))
    SpikeArray(tmp_path / "a.npz", axes="TYX").write(tmp_path / "a.h5", readout_hz=20_000)
    assert len(opened) <= 3  # header, search for a spike, and again from the start
    with open_stream(tmp_path / "a.h5") as stream:
        assert np.array_equal(stream.frames(0, 5_000), long)


def write_bad_header(path):
    with zipfile.ZipFile(path, "w") as archive:
        header = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
        text = "{'descr': '|u1', 'fortran_order': False, 'shape': (9000000, 250, 400), }"
        archive.writestr("seq.npy", header + text.ljust(117).encode() + b"\n" + b"\0" * 100)


def write_unlikely_storage(path):
    """Write a filter that other code would have to undo, and a chunk of 128 MB."""
    with h5py.File(path, "w") as file:
        file.create_dataset("lzf", data=SPIKES, compression="lzf")
        file.create_dataset("huge", (8, 4_096, 4_096), "uint8", chunks=(8, 4_096, 4_096))


def write_links(path):
    with h5py.File(path, "w") as file:
        file["spk"] = h5py.ExternalLink("/etc/other.h5", "/spikes")
        file["text"] = "words"


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.npy", lambda p: np.save(p, np.array([{"a": 1}]), allow_pickle=True), "cannot be read | Python objects"),
        ("a.npz", lambda p: np.savez(p, a=np.array([[["x"]]], object)), "a holds objects"),
        ("a.npz", lambda p: np.savez(p, a=SPIKES, b=SPIKES), "has 2 arrays of three axes | a (41, 5, 6) | --key"),
        ("a.npz", lambda p: np.savez(p, a=SPIKES[0]), "has no arrays of three axes"),
        ("a.npz", write_bad_header, "seq has 228 bytes | allowed: the size that its header states"),
        ("a.npz", lambda p: p.write_bytes(b"PK no zip"), "cannot be read"),
        ("a.npy", lambda p: p.write_bytes(b""), "cannot be read"),
        ("a.mat", lambda p: p.write_bytes(b"no MATLAB" * 40), "cannot be read"),
        ("a.mat", write_links, "has no arrays of three axes"),
        ("a.mat", write_unlikely_storage, "has no arrays of three axes"),
        ("a.npy", lambda p: np.save(p, np.zeros((1, 4_097, 4_096), bool)), "at most 4194304 pixels"),
        ("a.npy", lambda p: np.save(p, SPIKES[0]), "the array is uint8 (5, 6)"),
        ("a.npy", lambda p: np.save(p, np.ones((4, 5, 6), complex)), "complex128"),
        ("a.npy", lambda p: np.save(p, SPIKES * 0.5), "holds 0.5 in frame 0 or a later one"),
    ],
)  # fmt: skip
def test_a_file_that_does_not_fit_is_one_line_and_nothing_is_written(tmp_path, name, write, message):
    write(tmp_path / name)
    error = refusal(lambda: SpikeArray(tmp_path / name, axes="TYX").write(tmp_path / "a.h5", readout_hz=20_000))
    assert_says(error, message)
    assert not (tmp_path / "a.h5").exists()


def test_an_option_that_does_not_fit_is_one_line(tmp_path, call):
    np.savez(tmp_path / "a.npz", seq=SPIKES)
    (tmp_path / "raw.dat").write_bytes(b"\0" * 13_000)
    array, raw = (tmp_path / "a.npz", "--axes", "TYX"), (tmp_path / "raw.dat", "--layout", "416")
    for options, message in (
        ((*array, "--key", "sek"), "did you mean 'seq'?"),
        ((*array, "--layout", "416"), "--layout is given for an array"),
        ((*array, "--size", "6x5"), "--size is given for an array"),
        ((*array, "--frames", 42), "allowed: 1 to 41"),
        ((tmp_path / "a.npz", "--axes", "TYZ"), "unknown order of axes 'TYZ'"),
        ((*raw, "--key", "seq"), "--key seq is given for a raw file"),
        ((*raw, "--axes", "TYX"), "--axes TYX is given for a raw file"),
        ((tmp_path / "none.npz", "--axes", "TYX"), "there is no such file"),
        ((tmp_path, "--truth", 0.5), "--truth is given with a folder"),
    ):
        code, _, err = call("import", *options, "--out", tmp_path / "a.h5")
        assert (code, message in err) == (2, True), err


@pytest.mark.slow
@pytest.mark.daily(1)
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "deflated"])
def test_arrays_of_a_matlab_file_are_what_scipy_reads(tmp_path, packed):
    """Twelve types of number, with the last axis first."""
    kinds = (*"bhilBHILfd?", np.int64)
    arrays = {f"a{k}": np.random.default_rng(k).integers(0, 2, (3, 4, 9)).astype(t) for k, t in enumerate(kinds)}
    arrays |= {"text": np.array("abc"), "cell": np.array(["a", 1], object), "fields": {"a": 1.0}}
    io.savemat(tmp_path / "a.mat", arrays, do_compression=packed)
    for name in (name for name in arrays if name.startswith("a")):
        found = open_array(tmp_path / "a.mat", key=name)
        assert found.dtype == arrays[name].dtype
        assert np.array_equal(found[2:9], np.moveaxis(arrays[name], -1, 0)[2:9])
    for name in ("text", "cell", "fields"):
        assert_says(refusal(open_array, tmp_path / "a.mat", key=name), f"unknown array '{name}'")


def element(kind, raw):
    return struct.pack(">II", kind, len(raw)) + raw + b"\0" * (-len(raw) % 8)


@pytest.mark.slow
def test_a_matlab_file_of_the_other_byte_order_is_read(tmp_path):
    values = SPIKES.astype(">i2")
    head = element(6, struct.pack(">II", 10, 0)) + element(5, struct.pack(">iii", 5, 6, 41)) + element(1, b"spk")
    matrix = element(14, head + element(3, values.transpose(1, 2, 0).tobytes(order="F")))
    (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0".ljust(124) + b"\1\0MI" + matrix)
    assert np.array_equal(open_array(tmp_path / "a.mat")[0:41], SPIKES)


@pytest.mark.slow
def test_a_damaged_matlab_file_is_refused_even_where_it_crashes_scipy(tmp_path):
    """The type of the values is one byte, after which scipy's reader looks for a function without a check."""
    io.savemat(tmp_path / "a.mat", {"spk": TIME_LAST})
    content = (tmp_path / "a.mat").read_bytes()
    at = content.index(b"spk") + 4
    for damaged in (content[:at] + b"\x00\x80" + content[at + 2 :], content[:200], content[:-100], content[:128]):
        (tmp_path / "b.mat").write_bytes(damaged)
        assert_says(refusal(open_array, tmp_path / "b.mat"), "b.mat")


def test_a_large_array_of_an_old_matlab_file_is_refused_before_it_is_read(tmp_path):
    """Its head states a size of 430 MB, of which the file holds nothing."""
    head = element(6, struct.pack(">II", 9, 0)) + element(5, struct.pack(">iii", 250, 400, 4_300))
    matrix = element(14, head + element(1, b"spk") + element(2, bytes(8)))
    (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0".ljust(124) + b"\1\0MI" + matrix)
    assert_says(refusal(open_array, tmp_path / "a.mat"), "spk has 430,000,000 bytes | at most 419,430,400 | -v7.3")


# --- SAF's folders ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Twenty raw frames in layout 416."""
    folder = tmp_path_factory.mktemp("raw")
    write_stream(folder / "a.h5", np.random.default_rng(1).integers(0, 2, (20, 250, 400), np.uint8))
    export_raw_frames(folder / "a.h5", folder / "a.dat", layout="416")
    return (folder / "a.dat").read_bytes()


@pytest.mark.slow
def test_a_folder_of_saf_becomes_a_dataset_that_is_evaluated(tmp_path, call, raw):
    folder = tmp_path / "datasets"
    (folder / "desk").mkdir(parents=True)
    (folder / "desk" / "a.dat").write_bytes(raw)
    rows = [HEADING, (1, "desk lamp", 20, 11, 4, "datasets\\desk\\a.dat"), (2, "desk", 16, 1, 4, "./sad/desk/a.dat")]
    write_xlsx(folder / "config.xlsx", rows)
    code, out, err = call("import", folder, "--out", tmp_path / "mine")
    assert code == 0
    assert "2 recordings; next: saf-gen dataset index" in out
    assert "assumed to move evenly" in err
    with open_stream(tmp_path / "mine" / "desk_lamp-recorded-01.h5") as stream:
        assert stream.shape == (20, 250, 400)
        assert (stream.truth.frame, stream.truth.position) == (10, pytest.approx(10.5 / 20))
        assert "evenly" in stream.metadata.provenance["assumed"]
    with open_stream(tmp_path / "mine" / "desk-recorded-02.h5") as stream:
        assert stream.shape[0] == 16
    before = (tmp_path / "mine" / "desk-recorded-02.h5").stat().st_mtime_ns
    list(import_saf_folder(folder, tmp_path / "mine"))
    assert (tmp_path / "mine" / "desk-recorded-02.h5").stat().st_mtime_ns == before
    write_stream(tmp_path / "mine" / "desk-recorded-02.h5", np.zeros((16, 250, 400), bool), provenance={"import": "[]"})
    list(import_saf_folder(folder, tmp_path / "mine"))  # replaces a stream of another origin
    with open_stream(tmp_path / "mine" / "desk-recorded-02.h5") as stream:
        assert stream.truth.frame == 0
    write_xlsx(folder / "config.xlsx", [*rows[:2], (2, "desk", 16, 5, 4, "desk/a.dat")])
    list(import_saf_folder(folder, tmp_path / "mine"))
    with open_stream(tmp_path / "mine" / "desk-recorded-02.h5") as stream:
        assert stream.truth.frame == 4
    assert call("dataset", "index", tmp_path / "mine")[0] == 0
    assert call("evaluate", tmp_path / "mine", "--method", "sd+argmax")[0] == 0


def test_a_sheet_lists_a_recording_once_with_one_set_of_numbers(tmp_path, raw):
    (tmp_path / "a.dat").write_bytes(raw)
    same, other_block = (2, "other", 20, 11, 4, "./a.dat"), (2, "other", 20, 11, 8, "a.dat")
    write_xlsx(tmp_path / "config.xlsx", [HEADING, (1, "desk", 20, 11, 4, "a.dat"), same])
    said = "lists a.dat twice, as 'desk-recorded-01' and 'other-recorded-02'"
    assert_says(refusal(read_saf_config, tmp_path), said)
    write_xlsx(tmp_path / "config.xlsx", [HEADING, (1, "desk", 20, 11, 4, "a.dat"), other_block])
    assert len(read_saf_config(tmp_path)) == 2


def test_a_sheet_with_gaps_keeps_its_columns(tmp_path, raw):
    """Other programs leave out the headings of columns, and cells that are empty."""
    (tmp_path / "a.dat").write_bytes(raw)
    write_xlsx(tmp_path / "config.xlsx", [(1, None, 20, 11, None, "a.dat"), (), (2, "desk", 16, 1, 4, "a.dat", "seen")])
    assert [one.name for one in read_saf_config(tmp_path)] == ["a-recorded-01", "desk-recorded-02"]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ((1, "desk", "many", 1, 4, "a.dat"), "config.xlsx:2 | frames is 'many'"),
        ((1, "desk", 20, 21, 4, "a.dat"), "focal frame is 21 | 1 to 20"),
        ((1, "desk", 20, 0, 4, "a.dat"), "focal frame is '0'"),
        ((1, "desk", 21, 1, 4, "a.dat"), "21 frames were requested | 1 to 20"),
        ((1, "desk", 20, 1, 4, "b.dat"), "path is 'b.dat'"),
        ((1, "desk", 20, 1, 4, "../../secret.dat"), "path is '../../secret.dat'"),
        ((1, "desk"), "frames is ''"),
    ],
)
def test_a_row_that_does_not_fit_is_one_line(tmp_path, raw, row, message):
    folder = tmp_path / "up" / "datasets"
    folder.mkdir(parents=True)
    for path in (folder / "a.dat", tmp_path / "secret.dat"):
        path.write_bytes(raw)
    write_xlsx(folder / "config.xlsx", [HEADING, row])
    assert_says(refusal(read_saf_config, folder), message)
    assert_says(refusal(lambda: list(import_saf_folder(folder, tmp_path / "out"))), message)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_dataset_goes_to_a_folder_of_saf_and_back(tmp_path, call):
    spikes = np.random.default_rng(3).integers(0, 2, (2, 37, 250, 400), np.uint8)
    for part, name, lens in zip(spikes, ("up", "down"), (np.linspace(0, 1, 37), np.linspace(1, 0, 37)), strict=True):
        fields = {"focus_position": lens.astype(np.float32), "truth": Truth(0.3, frame=11.6)}
        write_stream(tmp_path / "data/test" / f"{name}.h5", part, **fields)
    list_streams(tmp_path / "data", {"id": "up"}, {"id": "down"})
    assert call("export", tmp_path / "data", "--for", "saf", "--out", tmp_path / "saf/datasets", "--dt", 9)[0] == 0
    listed = read_saf_config(tmp_path / "saf/datasets")
    assert [(one.frames, one.focal_frame, one.block) for one in listed] == [(37, 12, 9)] * 2
    notes = [row[-1] for row in load_workbook(tmp_path / "saf/datasets/config.xlsx").active.values]
    assert notes == ["note", None, "the lens does not move evenly from 0 to 1"]
    assert call("import", tmp_path / "saf/datasets", "--out", tmp_path / "back")[0] == 0
    for part, name in zip(spikes, ("up-recorded-01", "down-recorded-02"), strict=True):
        with open_stream(tmp_path / "back" / f"{name}.h5") as stream:
            np.testing.assert_array_equal(stream.frames(0, 37), part)
            assert stream.truth.frame == 12


@pytest.mark.parametrize(
    ("fields", "words", "message"),
    [
        ({}, "--for saf", "dt is 100 | 1 to 20"),
        ({}, "--for saf --dt 30", "dt is 30 | 1 to 20"),
        ({"truth": Truth()}, "--for saf --dt 20", "the lens passes no known focus"),
        ({"size": (24, 32)}, "--for saf --dt 20", "has 32x24 pixels | 400x250"),
        ({}, "--for spikecv", "--for spikecv is given with a folder | --for saf"),
        ({}, "", "no --for is given with a folder | --for saf"),
        ({}, "--for saf --layout dense", "--layout is given with a folder"),
    ],
)
def test_a_dataset_that_saf_cannot_read_is_one_line(tmp_path, call, fields, words, message):
    truth, size = fields.get("truth", Truth(0.3, frame=6.0)), fields.get("size", (250, 400))
    lens = np.linspace(0, 1, 20, dtype=np.float32)
    write_stream(tmp_path / "data/test/a.h5", np.zeros((20, *size), np.uint8), focus_position=lens, truth=truth)
    list_streams(tmp_path / "data", {"id": "a"})
    code, _, err = call("export", tmp_path / "data", "--out", tmp_path / "saf", *words.split())
    assert code == 2
    assert_says(err, message)
    assert not (tmp_path / "saf").exists()


@pytest.mark.slow
def test_a_sheet_that_is_invalid_or_too_large_is_refused(tmp_path):
    def says(words):
        assert_says(
            refusal(read_saf_config, tmp_path), f"config.xlsx: cannot be read | {words} | a spreadsheet (.xlsx)"
        )

    config = tmp_path / "config.xlsx"
    write_xlsx(config, [HEADING] * 10_001)
    says("more than 10,000 rows")
    with zipfile.ZipFile(config, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/workbook.xml", bytes(9 << 20))
    says("unpacks to 9,437,184 bytes; allowed: 8,388,608")
    with zipfile.ZipFile(config, "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("xl/workbook.xml", "x")
    says("packed by method 12")
    with zipfile.ZipFile(config, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/workbook.xml", "x")
    says("")
    config.write_text("no zip")
    says("not a zip file")
    config.unlink()
    assert_says(refusal(read_saf_config, tmp_path), "this is a folder without config.xlsx")
