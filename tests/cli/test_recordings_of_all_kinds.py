"""Every command that reads a recording works with every kind of recording, or names the form that is missing."""

import json

import numpy as np
import pytest
from refusals import refusal

from saf_gen import SpikeWindows
from saf_gen.benchmark.records import read_records
from saf_gen.stream.event_file import EventColumns, EventWriter
from saf_gen.stream.frame_file import FrameWriter
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.stream_writer import write_stream

FRAMES, ROWS, COLUMNS, HZ = 400, 8, 12, 1000.0
SHAPE = FRAMES, ROWS, COLUMNS
METADATA = {
    "focus_position": np.linspace(0, 1, FRAMES, dtype=np.float32),
    "truth": Truth(position=0.5, depth_of_focus=(0.45, 0.55), frame=199.5),
}
KINDS = ("spikes", "photons", "events", "frames")
WINDOW = {"frames": 3}
"""Frames per window; 20 for the others."""


def write_events(path, light):
    random = np.random.default_rng(2)
    t, y, x = np.nonzero(light)
    polarity = random.integers(0, 2, len(t)).astype(np.uint8)
    with EventWriter(path, shape=SHAPE, readout_hz=HZ, metadata=Metadata(**METADATA)) as writer:
        writer.write(EventColumns(x.astype(np.uint16), y.astype(np.uint16), (t * 1000).astype(np.uint32), polarity))


def write(kind, path):
    """Write a recording whose contrast is highest in its middle."""
    sharp = 1 - np.abs(np.linspace(-1, 1, FRAMES))[:, None, None]
    stripes = np.where(np.arange(COLUMNS) % 2, 1.0, -1.0)
    rate = 0.3 + 0.25 * sharp * np.broadcast_to(stripes, (ROWS, COLUMNS))
    light = np.random.default_rng(1).random(SHAPE) < rate
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "events":
        write_events(path, light)
    elif kind == "frames":
        options = {"shape": SHAPE, "readout_hz": HZ, "black_level_dn": 0, "metadata": Metadata(**METADATA)}
        with FrameWriter(path, **options) as writer:
            for frame in (4000 * rate).astype(np.uint16):
                writer.write(frame)
    else:
        write_stream(path, light, readout_hz=HZ, kind=kind, **METADATA)
    return path


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


@pytest.fixture
def recording(kind, tmp_path):
    return write(kind, tmp_path / "data/a-lamp-00.h5")


WORKS = ("spikes", "photons", "events", "frames")
BITS = ("spikes", "photons")
COMMANDS = {
    "inspect": ("inspect FILE", WORKS),
    "view": ("view FILE --out OUT.png --measure sd", WORKS),
    "view, one readout": ("view FILE --out OUT.png --as spikes", BITS),
    "score": ("score FILE --measure sd --window WINDOW", WORKS),
    "score with the law of spikes": ("score FILE --measure sd_calibrated --window WINDOW", ("spikes",)),
    "score from intervals": ("score FILE --measure sd_tfi --window WINDOW", BITS),
    "score of changes": ("score FILE --measure change_rate --window WINDOW", ("spikes", "photons", "frames")),
    "cut": ("cut FILE --to 100 --rows 0:4 --out OUT.h5", BITS),
    "export": ("export FILE --out OUT.dat --layout dense", BITS),
    "index": ("dataset index FOLDER", WORKS),
    "evaluate": ("evaluate FILE --method sd+argmax:window=WINDOW --out OUT", WORKS),
}
"""By name: the words of a command, and the kinds of recordings that it takes; of others it names the missing form."""
MISSING = ("spikes", "intervals", "holds events", "holds frames", "recording of events", "recording of frames")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_takes_a_recording_or_names_the_form_that_is_missing(command, kind, recording, tmp_path, call):
    words, taken = COMMANDS[command]
    values = {"FILE": recording, "FOLDER": recording.parent, "OUT": tmp_path / "out", "WINDOW": WINDOW.get(kind, 20)}
    for name, value in values.items():
        words = words.replace(name, str(value))
    code, _, error = call(*words.split())
    if kind in taken:
        assert code == 0, error
        return
    assert (code, error.count("\n")) == (2, 1), error
    assert any(form in error for form in MISSING), error
    assert not list(tmp_path.glob("out*"))


def test_scores_of_every_kind_are_highest_where_the_contrast_is(kind, recording, call):
    code, text, _ = call("score", recording, "--measure", "sd", "--window", WINDOW.get(kind, 20))
    rows = [line.split(",") for line in text.splitlines()[1:]]
    best = max(rows, key=lambda row: float(row[1]))
    assert code == 0
    assert abs(int(best[0]) - 200) < 60


@pytest.mark.slow
def test_a_folder_of_any_kind_becomes_a_dataset_that_is_intact_and_evaluated(kind, recording, tmp_path, call):
    write(kind, tmp_path / "data/b-lamp-01.h5")
    code, shown, error = call("dataset", "index", recording.parent)
    assert (code, error) == (0, "")
    command = shown.partition("next: saf-gen ")[2].split()
    assert f"Recordings of {kind}" in json.loads((recording.parent / "croissant.json").read_text())["description"]
    assert call("verify", recording.parent)[0] == 0
    if "--method" not in command:
        command += ["--method", "sd+argmax:window=20"]
    assert ("er_count+elp_events:window=20" in command) == (kind == "events")
    code, _, error = call(*command, "--out", tmp_path / "judged")
    assert code == 0, error
    records = list(read_records(tmp_path / "judged"))
    assert {record.judgement.status for record in records} == {"answered"}
    assert len(records) == 2 * command.count("--method")


def test_a_folder_of_several_kinds_is_no_dataset(tmp_path, call):
    for kind in ("spikes", "events"):
        write(kind, tmp_path / f"data/{kind}-lamp-00.h5")
    code, _, error = call("dataset", "index", tmp_path / "data")
    assert (code, error.count("\n")) == (2, 1)
    assert "events-lamp-00.h5 holds events and spikes-lamp-00.h5 holds spikes" in error
    assert not (tmp_path / "data/manifest.json").exists()


def test_windows_for_training_are_those_of_spikes_and_photons(kind, recording, call):
    assert call("dataset", "index", recording.parent)[0] == 0
    if kind in BITS:
        assert SpikeWindows(recording.parent, window=20)[0][0].shape == (1, ROWS, COLUMNS)
        recording.unlink()
        assert "no such file" in refusal(SpikeWindows(recording.parent, window=20, stride=7).__getitem__, 0).problem
        return
    error = refusal(SpikeWindows, recording.parent, window=20)
    assert f"holds {kind}, not spikes" in error.problem
    assert str(recording) in str(error)
