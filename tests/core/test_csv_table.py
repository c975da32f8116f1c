"""Tables next to a document: reading, and errors with their line."""

import os

import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.core.csv_table import parse_columns, read_text_in
from saf_gen.errors import BadInput

NAMES = ("time_s", "gain")


@pytest.fixture
def folder(tmp_path):
    """A folder ``inside`` with tables, next to a file outside.csv that must stay out of reach."""
    inside = tmp_path / "inside"
    (inside / "curves").mkdir(parents=True)
    (inside / "lamp.csv").write_text("time_s,gain\n0,1\n")
    (inside / "curves" / "dusk.csv").write_text("time_s,gain\n0,2\n")
    (tmp_path / "outside.csv").write_text("secret")
    return inside


def test_a_table_is_its_columns(folder):
    """Also as spreadsheets write it."""
    (folder / "excel.csv").write_bytes(b"\xef\xbb\xbftime_s,gain\r\n0,1\r\n\r\n# a pause\r\n0.5, 1e-3\r\n")
    times, gains = parse_columns(read_text_in(folder, "excel.csv"), NAMES, name="excel.csv")
    assert times.dtype == gains.dtype == np.float64
    assert times.tolist() == [0, 0.5]
    assert gains.tolist() == [1, 1e-3]
    assert not times.flags.writeable


@pytest.mark.parametrize("name", ["lamp.csv", "./lamp.csv", "curves/dusk.csv", "curves/../lamp.csv"])
def test_a_file_in_the_folder_or_below_it_is_read(folder, tmp_path, name):
    (tmp_path / "link").symlink_to(folder)
    for root in (folder, tmp_path / "link"):
        assert read_text_in(root, name).startswith("time_s,gain")


@pytest.mark.parametrize("name", ["../outside.csv", "/etc/hostname", "curves/../../outside.csv", "link.csv", ".."])
def test_a_path_that_leads_out_is_refused(folder, name):
    (folder / "link.csv").symlink_to(folder.parent / "outside.csv")
    with pytest.raises(BadInput, match=r"r.yaml:3: '.*' is outside the folder.*; allowed: a file in") as caught:
        read_text_in(folder, name, where="r.yaml:3")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lampp.csv", "'lampp.csv' | mean 'lamp.csv"),
        ("curves/dusc.csv", "mean 'curves/dusk.csv"),
        ("pipe.csv", "'pipe.csv' is a folder, a pipe or a device"),
        ("curves", "'curves' is a folder, a pipe or a device"),
        ("picture.csv", "'picture.csv' cannot be read"),
        ("long.csv", "'long.csv' has 4194305 bytes | at most 4194304"),
        ("round.csv", "r.yaml:3 | 'round.csv' cannot be resolved: "),
        ("a\0b.csv", r"'a\x00b.csv' cannot be resolved"),
    ],
)
def test_what_is_no_table_is_refused(folder, name, message):
    """A pipe that nobody fills is not waited for."""
    os.mkfifo(folder / "pipe.csv")
    (folder / "picture.csv").write_bytes(b"\x89PNG\xff\xfe")
    (folder / "long.csv").write_bytes(b"0" * ((4 << 20) + 1))
    (folder / "round.csv").symlink_to(folder / "and.csv")
    (folder / "and.csv").symlink_to(folder / "round.csv")
    assert_says(refusal(read_text_in, folder, name, where="r.yaml:3"), message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "t.csv | the table has no rows | time_s,gain, then numbers"),
        ("gain,time_s\n0,1\n", "t.csv:1 | the columns are 'gain,time_s' | time_s,gain"),
        ("time_s;gain\n0;1\n", "t.csv:1 | the columns are 'time_s;gain'"),
        ("time_s,gain\n0,1\n1\n", "t.csv:3 | the row is '1' | 2 numbers"),
        ("time_s,gain\n0,bright\n", "t.csv:2 | gain is 'bright' | a finite number"),
        ("time_s,gain\n0,inf\n", "t.csv:2 | gain is 'inf'"),
        ("time_s,gain\n0,\n", "t.csv:2 | gain is ''"),
        ("time_s,gain\n# x\n1,1\n\n0.5,2\n", "t.csv:5 | time_s goes from 1 to 0.5"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_by_line(text, message):
    assert_says(refusal(parse_columns, text, NAMES, name="t.csv"), message)
