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


def test_a_table_is_its_columns():
    times, gains = parse_columns("time_s, gain\n0, 1\n\n# a pause\n0.5, 1e-3\n", NAMES, name="t.csv")
    assert times.dtype == gains.dtype == np.float64
    assert times.tolist() == [0, 0.5]
    assert gains.tolist() == [1, 1e-3]
    assert not times.flags.writeable


def test_the_ways_of_spreadsheets_are_read(folder):
    (folder / "excel.csv").write_bytes(b"\xef\xbb\xbftime_s,gain\r\n0,1\r\n1,2\r\n")
    assert parse_columns(read_text_in(folder, "excel.csv"), NAMES, name="excel.csv")[1].tolist() == [1, 2]


@pytest.mark.parametrize("name", ["lamp.csv", "./lamp.csv", "curves/dusk.csv", "curves/../lamp.csv"])
def test_a_file_in_the_folder_or_below_it_is_read(folder, name):
    assert read_text_in(folder, name).startswith("time_s,gain")


def test_the_folder_itself_may_be_reached_by_a_link(folder, tmp_path):
    (tmp_path / "link").symlink_to(folder)
    assert read_text_in(tmp_path / "link", "lamp.csv").startswith("time_s")


@pytest.mark.parametrize("name", ["../outside.csv", "/etc/hostname", "curves/../../outside.csv", "link.csv", ".."])
def test_a_path_that_leads_out_is_refused(folder, name):
    (folder / "link.csv").symlink_to(folder.parent / "outside.csv")
    with pytest.raises(BadInput, match=r"r.yaml:3: '.*' is outside the folder.*; allowed: a file in") as caught:
        read_text_in(folder, name, where="r.yaml:3")
    assert "secret" not in str(caught.value)


def test_a_pipe_that_nobody_fills_is_not_waited_for(folder):
    os.mkfifo(folder / "pipe.csv")
    assert_says(refusal(read_text_in, folder, "pipe.csv"), "'pipe.csv' is a folder, a pipe or a device")


def test_a_missing_file_is_refused_with_the_nearest(folder):
    assert_says(refusal(read_text_in, folder, "lampp.csv"), "'lampp.csv' | mean 'lamp.csv")
    assert_says(refusal(read_text_in, folder, "curves/dusc.csv"), "mean 'curves/dusk.csv")


def test_a_file_that_is_no_text_or_too_large_is_refused(folder):
    (folder / "picture.csv").write_bytes(b"\x89PNG\xff\xfe")
    assert_says(refusal(read_text_in, folder, "picture.csv"), "'picture.csv' cannot be read")
    assert_says(refusal(read_text_in, folder, "curves"), "'curves' is a folder, a pipe or a device")
    (folder / "long.csv").write_bytes(b"0" * ((4 << 20) + 1))
    assert_says(refusal(read_text_in, folder, "long.csv"), "'long.csv' has 4194305 bytes | at most 4194304")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "t.csv | the table has no rows | time_s,gain, then numbers"),
        ("time_s,gain\n", "t.csv | the table has no rows"),
        ("gain,time_s\n0,1\n", "t.csv:1 | the columns are 'gain,time_s' | time_s,gain"),
        ("0,1\n1,2\n", "t.csv:1 | the columns are '0,1'"),
        ("time_s;gain\n0;1\n", "t.csv:1 | the columns are 'time_s;gain'"),
        ("time_s,gain\n0,1\n1\n", "t.csv:3 | the row is '1' | 2 numbers"),
        ("time_s,gain\n0,1,2\n", "t.csv:2 | the row is '0,1,2'"),
        ("time_s,gain\n0,bright\n", "t.csv:2 | gain is 'bright' | a finite number"),
        ("time_s,gain\n0,nan\n", "t.csv:2 | gain is 'nan' | a finite number"),
        ("time_s,gain\n0,inf\n", "t.csv:2 | gain is 'inf'"),
        ("time_s,gain\n0,\n", "t.csv:2 | gain is ''"),
        ("time_s,gain\n0,1\n0,2\n", "t.csv:3 | time_s goes from 0 to 0 | a column that rises"),
        ("time_s,gain\n# x\n1,1\n\n0.5,2\n", "t.csv:5 | time_s goes from 1 to 0.5"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_by_line(text, message):
    assert_says(refusal(parse_columns, text, NAMES, name="t.csv"), message)


def test_a_circular_link_is_refused(folder):
    (folder / "round.csv").symlink_to(folder / "and.csv")
    (folder / "and.csv").symlink_to(folder / "round.csv")
    with pytest.raises(BadInput, match=r"r.yaml:3: 'round.csv' cannot be resolved: ") as caught:
        read_text_in(folder, "round.csv", where="r.yaml:3")
    assert "\n" not in str(caught.value)


def test_a_name_that_no_file_can_have_is_refused(folder):
    assert_says(refusal(read_text_in, folder, "a\0b.csv"), r"'a\x00b.csv' cannot be resolved")
