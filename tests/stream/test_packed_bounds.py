"""Readers of packed formats hold the bounds that they state, and honest dark recordings are far above their ratio."""

import io
import struct
import zipfile
import zlib

import h5py
import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy.io import savemat

import saf_gen
from saf_gen.core.config.json_document import parse_json
from saf_gen.core.config.yaml_document import parse_yaml
from saf_gen.core.csv_table import parse_columns
from saf_gen.scene.ply_file import validate_ply
from saf_gen.stream.interop import SpikeArray
from saf_gen.stream.interop.array_files import open_array
from saf_gen.stream.interop.bad_pixels import read_mask
from saf_gen.stream.interop.saf_folder import read_saf_config


def as_npy(array):
    data = io.BytesIO()
    np.save(data, array)
    return data.getvalue()


def write_zip(path, name, data, method):
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr(name, data)
    return path


def save_mat(path, spikes):
    savemat(path, {"spikes": spikes}, do_compression=True)


@pytest.mark.slow
@pytest.mark.parametrize("write", [np.savez_compressed, save_mat])
def test_a_dark_recording_that_packs_a_thousand_to_one_is_read(tmp_path, write):
    dark = np.zeros((600, 100, 200), bool)
    path = tmp_path / ("a.npz" if write is np.savez_compressed else "a.mat")
    write(path, spikes=dark)
    assert dark.size > 500 * path.stat().st_size
    SpikeArray(path, axes="TYX").write(tmp_path / "out.h5", readout_hz=20_000)
    with saf_gen.open_stream(tmp_path / "out.h5") as stream:
        assert (stream.shape, stream.counts(0, 600).sum()) == (dark.shape, 0)


def a_zip_for_npy(folder):
    np.savez(folder / "a.npz", spikes=np.zeros((8, 8, 8), np.uint8))
    return (folder / "a.npz").rename(folder / "a.npy")


def a_huge_slice(folder):
    return write_zip(
        folder / "a.npz", "spikes.npy", as_npy(np.zeros((1, 1, 129 << 20), np.uint8)), zipfile.ZIP_DEFLATED
    )


def written_by(method):
    return lambda folder: write_zip(folder / "a.npz", "spikes.npy", as_npy(np.zeros((8, 8, 8), np.uint8)), method)


def stored_nowhere(folder):
    with h5py.File(folder / "a.mat", "w") as file:
        file.create_dataset("spikes", (1 << 33, 250, 400), "u1", chunks=(64, 250, 400))
    return folder / "a.mat"


def packed_twice(folder):
    with h5py.File(folder / "a.mat", "w") as file:
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((8, 64, 64))
        plist.set_deflate(9)
        plist.set_filter(h5py.h5z.FILTER_DEFLATE, 0, (9,))
        space = h5py.h5s.create_simple((8, 64, 64))
        made = h5py.h5d.create(file.id, b"spikes", h5py.h5t.NATIVE_UINT8, space, plist)
        made.write_direct_chunk((0, 0, 0), zlib.compress(zlib.compress(bytes(8 * 64 * 64))))
    return folder / "a.mat"


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (a_zip_for_npy, "cannot be read | magic"),
        (a_huge_slice, "one slice takes 135,266,304 bytes | at most 134,217,728 | time on the first axis"),
        (written_by(zipfile.ZIP_BZIP2), "packed by method 12 | deflate"),
        (written_by(zipfile.ZIP_LZMA), "packed by method 14 | deflate"),
        (stored_nowhere, "spikes states 858,993,459,200,000 bytes | holds 0 of it"),
        (packed_twice, "has no arrays of three axes"),
    ],
)
def test_an_array_that_would_cost_more_than_it_may_is_refused_before_it_is_read(tmp_path, write, says):
    assert_says(refusal(open_array, write(tmp_path)), says)


def test_a_mask_of_another_size_is_refused_before_it_is_read(tmp_path):
    write_zip(tmp_path / "a.npz", "mask.npy", as_npy(np.zeros((2_000, 4_000), np.uint8)), zipfile.ZIP_DEFLATED)
    assert_says(refusal(read_mask, str(tmp_path / "a.npz"), (64, 64)), "2000 × 4000 pixels | 64 rows × 64 columns")


def test_an_archive_that_lists_one_member_many_times_is_refused(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", spikes=np.zeros((100, 10, 10), np.uint8))
    data = (tmp_path / "a.npz").read_bytes()
    begin, end = data.index(b"PK\1\2"), data.rindex(b"PK\5\6")
    entries = data[begin:end] * 300
    tail = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 300, 300, len(entries), begin, 0)
    (tmp_path / "a.npz").write_bytes(data[:begin] + entries + tail)
    assert_says(refusal(open_array, tmp_path / "a.npz"), "several of its members are one and the same")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_sheet_that_is_packed_as_no_program_packs_it_is_refused(tmp_path, method):
    """Of bzip2, 3 KB hold gigabytes, and zipfile unpacks them at once."""
    write_zip(tmp_path / "config.xlsx", "xl/worksheets/sheet1.xml", b" " * (1 << 20), method)
    assert_says(refusal(read_saf_config, tmp_path), "packed by method | deflate")


@pytest.mark.slow
@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("read", "text", "says"),
    [
        (parse_yaml, "- 1\n" * 250_000, "too many values"),
        (parse_yaml, "[" + "[]," * 250_000 + "]", "too many values"),
        (parse_json, "[" + "1," * 10_000_001 + "1]", "holds 10,000,002 values | at most 10,000,000"),
    ],
)
def test_a_document_of_too_many_values_is_refused_before_they_are_made(read, text, says):
    assert_says(refusal(read, text, "a.file"), says)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_rows_of_nothing_are_refused(tmp_path, form):
    """There may be 10¹⁸ of them."""
    head = f"ply\nformat {form} 1.0\nelement nothing {10**18}\nend_header\n"
    (tmp_path / "a.ply").write_text(head)
    assert_says(refusal(validate_ply, tmp_path / "a.ply"), "damaged | hold nothing")


LONG = "".join(f"{n},{n % 7}\n" for n in range(300_000))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "says"),
    [
        (LONG + "x,1\n", "300002 | t is 'x'"),
        (LONG + "300000,1,1\n", "300002 | 2 numbers"),
        (LONG + "299999,1\n", "300002 | t goes from 299999 to 299999"),
        (LONG + "300000,inf\n", "300002 | v is 'inf'"),
    ],
)
def test_a_fault_far_down_a_long_table_is_named_with_its_line(text, says):
    assert_says(refusal(parse_columns, f"t,v\n{text}", ("t", "v"), name="a.csv"), says)


@pytest.mark.slow
def test_a_long_table_is_read_as_python_reads_its_numbers():
    text = f"# note\n\nt,v\n{LONG}300_000, 1e-3 \r\n\n300001,.1\n"
    t, v = parse_columns(text, ("t", "v"), name="a.csv")
    assert (t.size, t[-1], v[-1], v[-2]) == (300_002, 300_001, 0.1, 1e-3)
    assert np.array_equal(t, np.arange(300_002))
