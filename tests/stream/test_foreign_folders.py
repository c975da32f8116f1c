"""Folders of others: hidden files, ids that meet, names for the shell, and disks that refuse."""

import fcntl
import json
import os
import shlex

import numpy as np
import pytest
from folder_server import serve
from refusals import assert_says, refusal

from saf_gen.errors import BadInput
from saf_gen.stream import stream_file
from saf_gen.stream.dataset import index_folder
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.sharing.fetching import check_published
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

SPIKES = np.eye(8, dtype=np.uint8)[None].repeat(16, axis=0)


@pytest.mark.parametrize(
    "hidden",
    ["._a-lamp-00.h5", ".Trashes/a.h5", ".ipynb_checkpoints/a-checkpoint.h5", "test/._a.h5", ".a.h5", "x/.y/z.h5"],
)
def test_hidden_files_are_left_out_and_named(tmp_path, call, hidden):
    write_stream(tmp_path / "a-lamp-00.h5", SPIKES)
    (tmp_path / hidden).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / hidden).write_bytes(b"\0\5\x16\7 no stream")  # what macOS writes beside a file
    code, out, err = call("dataset", "index", tmp_path)
    assert code == 0
    assert out.startswith("1 sequence in split test; next: ")
    assert err == f"left out, because hidden: {hidden}\n"


@pytest.mark.parametrize("light", ["Sun", "LED_2", "lamp1.5", "half light", "灯", "sun"])
def test_a_name_tells_scene_and_light_in_letters_of_any_script(tmp_path, call, light):
    for name in (f"desk-{light}-01", "desk-dynamic-lamp-02", "night-desk-lamp-03"):
        write_stream(tmp_path / f"{name}.h5", SPIKES)
    code, _, err = call("dataset", "index", tmp_path)
    entries = read_manifest(tmp_path).sequences
    assert {(entry.scene, entry.scene_motion, entry.light, entry.repeat) for entry in entries} == {
        ("desk", "static", light, 1), ("desk", "dynamic", "lamp", 2), ("night-desk", "static", "lamp", 3)
    }  # fmt: skip
    assert (code, err) == (0, "")


def test_names_that_tell_no_light_are_counted_as_scenes_and_named(tmp_path, call):
    names = ["desk sun.h5", "desk lamp.h5", "desk-lamp.h5", "x.h5", "desk-lamp-01.h5"]
    for name in names:
        write_stream(tmp_path / name, SPIKES)
    code, _, err = call("dataset", "index", tmp_path)
    assert code == 0
    assert_says(err, "no light | desk-sun-01.h5 | desk lamp.h5, desk sun.h5, desk-lamp.h5, x.h5")
    entries = read_manifest(tmp_path).sequences
    assert sorted(entry.scene for entry in entries if entry.light == "recorded") == [
        "desk lamp",
        "desk sun",
        "desk-lamp",
        "x",
    ]


@pytest.mark.skipif(os.name == "nt", reason="the names are those that Windows refuses")
@pytest.mark.parametrize("name", ["a:b-lamp-01.h5", "what?-lamp-01.h5", "con.h5", "con/desk-lamp-01.h5"])
def test_names_that_others_could_not_fetch_are_told_before_anything_is_written(tmp_path, call, name, monkeypatch):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    write_stream(tmp_path / name, SPIKES)
    code, _, err = call("dataset", "index", tmp_path)
    assert code == 0
    assert err == f"names that some systems cannot hold; rename them before you publish: {name}\n"
    assert refusal(check_published, tmp_path, read_manifest(tmp_path))

    (tmp_path / "manifest.json").unlink()
    monkeypatch.setattr("saf_gen.stream.dataset.index_folder", _fail)
    assert call("dataset", "index", tmp_path)[2].startswith(err)


def _fail(folder, *, split):
    raise BadInput("nothing is written")


def test_an_index_has_a_card_unless_there_is_one_and_tells_scenes_of_several_splits(tmp_path, call):
    for name in ("train/desk-sun-01", "test/desk-lamp-01", "test/car-sun-01"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_stream(tmp_path / f"{name}.h5", SPIKES)
    assert call("dataset", "index", tmp_path)[2] == "scenes that are in several splits: desk\n"
    assert '"path": "sequences.csv"' in (tmp_path / "README.md").read_text()
    (tmp_path / "manifest.json").unlink()
    (tmp_path / "README.md").write_text("mine")
    assert call("dataset", "index", tmp_path)[0] == 0
    assert (tmp_path / "README.md").read_text() == "mine"


def test_only_hidden_files_are_no_streams(tmp_path):
    (tmp_path / "._a.h5").write_bytes(b"")
    assert_says(refusal(index_folder, tmp_path), "has no recording")


@pytest.mark.parametrize(
    ("first", "second"),
    [("a-b/c.h5", "a/b-c.h5"), ("a/b/c.h5", "a/b-c.h5"), ("a-b-c.h5", "a/b/c.h5"), ("a/b.h5", "a-b.h5")],
)
def test_two_streams_of_one_id_are_refused(tmp_path, first, second):
    for name in (first, second):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        write_stream(tmp_path / name, SPIKES)
    assert_says(refusal(index_folder, tmp_path), f"{first} | {second} | the same id | rename")
    assert not (tmp_path / "manifest.json").exists()


@pytest.mark.slow
@pytest.mark.daily(2)
@pytest.mark.parametrize("folder", ["set.v1.2", "a+b (copy)", "v2,x", "ünï.1", "two  blanks", "run.h5", "50 %", "it's"])
def test_names_with_dots_and_blanks_survive_every_export(tmp_path, call, folder):
    spikes = np.random.default_rng(1).integers(0, 2, (64, 8, 8), np.uint8)
    lens = np.linspace(0, 1, len(spikes), dtype=np.float32)
    names = ["test/run.v1.5", "test/run.v1.6", "test/a.b c", "test/a.b_c", "test/x.h5.bak"]
    for name in names:
        (tmp_path / folder / "test").mkdir(parents=True, exist_ok=True)
        write_stream(tmp_path / folder / f"{name}.h5", spikes, focus_position=lens)
    steps = [
        ("dataset", "index", tmp_path / folder),
        ("fetch", "ADDRESS", "--out", tmp_path / "fetched.v1"),
        ("verify", tmp_path / "fetched.v1"),
        ("evaluate", tmp_path / "fetched.v1", "--method", "sd+argmax:window=8", "--out", tmp_path / "ranked.v1"),
        ("export", tmp_path / "fetched.v1" / "test/run.v1.5.h5", "--out", tmp_path / "raw.v1.5"),
        ("view", tmp_path / "fetched.v1" / "test/run.v1.5.h5", "--as", "tfp", "--out", tmp_path / "run.v1.5.png"),
    ]
    with serve(tmp_path / folder) as (_, address):
        for step in steps:
            code, _, err = call(*(address if word == "ADDRESS" else word for word in step))
            assert code == 0, err
    for name in names:
        assert (tmp_path / "fetched.v1" / f"{name}.h5").read_bytes() == (tmp_path / folder / f"{name}.h5").read_bytes()
    records = (tmp_path / "ranked.v1" / "records.jsonl").read_text().splitlines()
    assert {json.loads(line)["sequence"] for line in records} == {name.replace("/", "-") for name in names}
    assert (tmp_path / "raw.v1.5").stat().st_size == spikes.size // 8
    assert (tmp_path / "run.v1.5.png").stat().st_size


@pytest.mark.parametrize("name", ["my data", "it's", "a;b", "$HOME", "a&b", "(1)", "a.b.c", "*", "tab\there"])
def test_the_next_command_can_be_pasted_into_a_shell(tmp_path, call, name):
    folder = tmp_path / name
    write_stream(folder / "test" / "a-lamp-00.h5", SPIKES)
    _, out, _ = call("dataset", "index", folder)
    if name.isprintable():
        command = shlex.split(out.strip().split("next: ")[1])
        assert command == ["saf-gen", "evaluate", str(folder)]
    assert "\t" not in out


def test_a_stream_is_read_while_another_program_holds_a_lock(tmp_path):
    """HDF5 takes such a lock for each file that it opens; network disks may not grant it."""
    write_stream(tmp_path / "a.h5", SPIKES)
    with (tmp_path / "a.h5").open("r+b") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with open_stream(tmp_path / "a.h5") as stream:
            assert np.array_equal(stream.frames(0, 16), SPIKES)


@pytest.mark.parametrize("number", sorted(stream_file.UNREADABLE))
def test_an_error_of_the_disk_is_not_called_damage(tmp_path, monkeypatch, number):
    write_stream(tmp_path / "a.h5", SPIKES)

    def fail(*_, **__):
        raise OSError(number, "no")

    monkeypatch.setattr("h5py.File", fail)
    error = refusal(open_stream, tmp_path / "a.h5")
    assert error.problem == f"cannot be read: {os.strerror(number)}"
    assert error.hint == ""
