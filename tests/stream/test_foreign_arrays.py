"""Spikes in .npy, .npz and .mat files, and SAF's folders: read correctly and in parts, and nothing in them is run."""

import struct
import zipfile
from contextlib import suppress

import h5py
import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy import io
from spreadsheets import HEADING, SHEET, write_xlsx

from saf_gen.errors import BadInput
from saf_gen.stream.interop import SpikeArray, export_raw_frames, spreadsheet
from saf_gen.stream.interop.array_files import open_array
from saf_gen.stream.interop.saf_folder import import_saf_folder, read_saf_config
from saf_gen.stream.interop.spreadsheet import read_sheet
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


WRITERS = {
    "a.npy": lambda path: np.save(path, SPIKES),
    "bool.npy": lambda path: np.save(path, SPIKES.astype(bool)),
    "packed.npy": lambda path: np.save(path, PACKED),
    "columns.npy": lambda path: np.save(path, np.asfortranarray(SPIKES)),
    "a.npz": lambda path: np.savez(path, note=np.arange(3), seq=SPIKES),
    "packed.npz": lambda path: np.savez_compressed(path, seq=PACKED),
    "old.mat": lambda path: io.savemat(path, {"spk": SPIKES.transpose(1, 2, 0), "rate": 20_000.0}),
    "logical.mat": lambda path: io.savemat(path, {"spk": SPIKES.transpose(1, 2, 0) > 0}, do_compression=True),
    "new.mat": lambda path: write_hdf5_matlab(path, spk=SPIKES.transpose(1, 2, 0), rate=np.ones((1, 1))),
}


@pytest.mark.parametrize("name", WRITERS)
def test_an_array_of_each_kind_is_read_bit_for_bit(tmp_path, call, name):
    WRITERS[name](tmp_path / name)
    options = ["--layout", "packed"] if name == "packed.npy" else []  # random bits show no packing; RSIR's key does
    code, out, err = call(
        "import", tmp_path / name, "--out", tmp_path / "a.h5", "--frames", 41, "--rate", 40_000, *options
    )
    assert (code, err) == (0, "")
    assert f"layout {'packed' if 'packed' in name else 'frames'}" in out
    with open_stream(tmp_path / "a.h5") as stream:
        assert stream.readout_hz == 40_000
        assert np.array_equal(stream.frames(0, 41), SPIKES)


def test_packed_frames_without_a_number_fill_whole_bytes(tmp_path):
    np.save(tmp_path / "a.npy", PACKED)
    assert SpikeArray(tmp_path / "a.npy", layout="packed").shape == (48, 5, 6)
    assert SpikeArray(tmp_path / "a.npy", layout="packed", frames=3).shape == (3, 5, 6)


def test_rows_are_turned_over_and_a_lens_is_read(tmp_path, call):
    np.save(tmp_path / "a.npy", SPIKES)
    (tmp_path / "lens.csv").write_text("frame,position\n0,0\n40,1\n")
    options = ("--flip", "--focus", tmp_path / "lens.csv", "--truth", "frame:10")
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
    SpikeArray(tmp_path / "a.npz").write(tmp_path / "a.h5", readout_hz=20_000)
    assert len(opened) <= 5  # header, search for the layout, and again from the start
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
        ("a.npy", lambda p: np.save(p, np.zeros((1, 4_097, 4_096), bool)), "axis 2, counted from 0, may be time"),
        ("a.npy", lambda p: np.save(p, SPIKES[0]), "the array is uint8 (5, 6)"),
        ("a.npy", lambda p: np.save(p, np.ones((4, 5, 6), complex)), "complex128"),
        ("a.npy", lambda p: np.save(p, SPIKES * 0.5), "holds 0.5 in frame 0 or a later one"),
    ],
)  # fmt: skip
def test_a_file_that_does_not_fit_is_one_line_and_nothing_is_written(tmp_path, name, write, message):
    write(tmp_path / name)
    error = refusal(lambda: SpikeArray(tmp_path / name).write(tmp_path / "a.h5", readout_hz=20_000))
    assert_says(error, message)
    assert not (tmp_path / "a.h5").exists()


def test_an_option_that_does_not_fit_is_one_line(tmp_path, call):
    np.savez(tmp_path / "a.npz", seq=SPIKES)
    (tmp_path / "raw.dat").write_bytes(b"\0" * 13_000)
    for options, message in (
        ((tmp_path / "a.npz", "--key", "sek"), "did you mean 'seq'?"),
        ((tmp_path / "a.npz", "--layout", "416"), "unknown layout of an array '416'"),
        ((tmp_path / "a.npz", "--frames", 42), "allowed: 1 to 41"),
        ((tmp_path / "raw.dat", "--key", "seq"), "--key seq is given for a raw file"),
        ((tmp_path / "none.npz",), "there is no such file"),
        ((tmp_path, "--truth", 0.5), "--truth is given with a folder"),
    ):
        code, _, err = call("import", *options, "--out", tmp_path / "a.h5")
        assert (code, message in err) == (2, True), err
    # A byte above 1 after the inspected slices: these are frames, but with an invalid value.
    late = np.zeros((300, 2, 2), np.uint8)
    late[0], late[299] = 1, 9
    np.save(tmp_path / "late.npy", late)
    assert_says(refusal(SpikeArray(tmp_path / "late.npy").frames, 0, 300), "holds 9 | --layout packed")


@pytest.mark.parametrize("packed", [False, True], ids=["plain", "deflated"])
def test_slices_of_a_matlab_file_are_what_scipy_reads_in_any_order(tmp_path, packed):
    """Twelve types of number, and frames that need several inflated blocks."""
    kinds = (*"bhilBHILfd?", np.int64)
    arrays = {f"a{k}": np.random.default_rng(k).integers(0, 2, (3, 4, 9)).astype(t) for k, t in enumerate(kinds)}
    arrays["large"] = np.random.default_rng(3).integers(0, 255, (300, 400, 20), np.uint8)
    arrays |= {"text": np.array("abc"), "complex": arrays["a0"] * 1j}
    io.savemat(tmp_path / "a.mat", arrays, do_compression=packed)
    known = io.loadmat(tmp_path / "a.mat")
    for name in [*arrays][:-2]:
        found = open_array(tmp_path / "a.mat", key=name)
        expected = np.moveaxis(known[name], -1, 0)
        assert found.shape == expected.shape
        assert name == "a10" or found.dtype == expected.dtype  # scipy returns booleans as integers
        for span in (slice(0, 2), slice(5, 9), slice(3, 4), slice(0, len(expected))):
            assert np.array_equal(found[span], expected[span])
    assert_says(refusal(open_array, tmp_path / "a.mat", key="text"), "unknown array 'text'")
    assert_says(refusal(open_array, tmp_path / "a.mat", key="complex"), "unknown array 'complex'")


def test_a_matlab_file_of_the_other_byte_order_is_read(tmp_path):
    def element(kind, raw):
        return struct.pack(">II", kind, len(raw)) + raw + b"\0" * (-len(raw) % 8)

    values = SPIKES.astype(">i2")
    head = element(6, struct.pack(">II", 10, 0)) + element(5, struct.pack(">iii", 5, 6, 41)) + element(1, b"spk")
    matrix = element(14, head + element(3, values.transpose(1, 2, 0).tobytes(order="F")))
    (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0".ljust(124) + b"\1\0MI" + matrix)
    assert np.array_equal(open_array(tmp_path / "a.mat")[0:41], SPIKES)


def test_no_damaged_matlab_file_ends_the_process(tmp_path):
    """scipy's reader crashed for one file in 3,000. Two kinds of file, 400 each with one byte changed, seed 5."""
    random = np.random.default_rng(5)
    for packed in (False, True):
        io.savemat(tmp_path / "a.mat", {"rate": 20_000.0, "spk": SPIKES.transpose(1, 2, 0)}, do_compression=packed)
        content = (tmp_path / "a.mat").read_bytes()
        for _ in range(400):
            damaged = bytearray(content)
            damaged[random.integers(124, min(len(content), 400))] ^= 1 << random.integers(8)
            (tmp_path / "b.mat").write_bytes(damaged)
            with suppress(BadInput):
                found = open_array(tmp_path / "b.mat", key="spk")
                assert found[0 : found.shape[0]].nbytes < 1e6


# --- SAF's folders ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Twenty raw frames in layout 416."""
    folder = tmp_path_factory.mktemp("raw")
    write_stream(folder / "a.h5", np.random.default_rng(1).integers(0, 2, (20, 250, 400), np.uint8))
    export_raw_frames(folder / "a.h5", folder / "a.dat", layout="416")
    return (folder / "a.dat").read_bytes()


@pytest.mark.parametrize("shared", [True, False])
def test_a_folder_of_saf_becomes_a_dataset_that_is_evaluated(tmp_path, call, raw, shared):
    folder = tmp_path / "datasets"
    (folder / "desk").mkdir(parents=True)
    (folder / "desk" / "a.dat").write_bytes(raw)
    rows = [HEADING, (1, "desk lamp", 20, 11, 4, "datasets\\desk\\a.dat"), (2, "desk", 16, 1, 4, "./sad/desk/a.dat")]
    write_xlsx(folder / "config.xlsx", rows, shared=shared)
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
    if not shared:
        return
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


def test_a_sheet_with_gaps_keeps_its_columns(tmp_path):
    write_xlsx(tmp_path / "a.xlsx", [("a", "", "c"), (1, "", 2.5)])
    assert read_sheet(tmp_path / "a.xlsx") == [["a", "", "c"], ["1", "", "2.5"]]


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


def test_a_sheet_that_is_invalid_or_too_large_is_refused(tmp_path, monkeypatch):
    bomb = '<!DOCTYPE a [<!ENTITY a "aaaa">]>'
    write_xlsx(tmp_path / "config.xlsx", [HEADING], prolog=bomb)
    assert_says(refusal(read_saf_config, tmp_path), "declares a document type")
    write_xlsx(tmp_path / "config.xlsx", [HEADING])
    assert_says(refusal(read_saf_config, tmp_path), "lists no recording")
    monkeypatch.setattr("saf_gen.stream.interop.spreadsheet.MAX_BYTES", 100)
    assert_says(refusal(read_saf_config, tmp_path), "is larger than")
    with zipfile.ZipFile(tmp_path / "config.xlsx", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(spreadsheet.SHEET, "x" * 100)
    begin = 30 + len(spreadsheet.SHEET)  # of the deflated bytes
    packed = bytearray((tmp_path / "config.xlsx").read_bytes())
    packed[begin : begin + 4] = b"\xff" * 4
    (tmp_path / "config.xlsx").write_bytes(packed)
    assert_says(refusal(read_saf_config, tmp_path), "a spreadsheet (.xlsx) | while decompressing")
    (tmp_path / "config.xlsx").write_text("no zip")
    assert_says(refusal(read_saf_config, tmp_path), "a spreadsheet (.xlsx)")
    (tmp_path / "config.xlsx").unlink()
    assert_says(refusal(read_saf_config, tmp_path), "this is a folder without config.xlsx")


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ('<row><c r="XFD1"/></row>' * 200_000, "is larger than"),
        ('<row><c r="ZZZ1"><v>1</v></c></row>', "a cell ZZZ1 | 256 columns"),
        ('<row><c r="AAA1"/></row>' * 500, "a cell AAA1 | 256 columns"),
    ],
)
def test_a_small_spreadsheet_does_not_become_a_large_table(tmp_path, rows, words):
    with zipfile.ZipFile(tmp_path / "config.xlsx", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(spreadsheet.SHEET, SHEET.format(rows))
    assert_says(refusal(read_saf_config, tmp_path), words)
