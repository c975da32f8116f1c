"""``saf-gen leaderboard``: several evaluations in one table."""

import json
import shutil

import h5py
import numpy as np
import pytest
from planted_sweeps import SHAPE, list_streams, make_spikes, make_truth, write_sweep

from saf_gen.benchmark.records import read_records
from saf_gen.cli import main
from saf_gen.stream.checked_file import read_small_datasets
from saf_gen.stream.metadata import stream_digests
from saf_gen.stream.stream_writer import write_stream

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """A dataset of two scenes in one split, one under a light that grows fourfold, in sweeps of 800 frames."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "test").mkdir()
    lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
    gain = np.linspace(0.5, 2.0, SHAPE[0])
    sequences = []
    for scene, light, peak in (("board", "constant", 300.0), ("leaf", "ramp", 40.0)):
        name, brightness = f"{scene}-{light}-00", gain if light == "ramp" else np.ones(SHAPE[0])
        write_stream(
            folder / f"test/{name}.h5",
            make_spikes(peak, gain=brightness),
            focus_position=lens,
            truth=make_truth(peak),
            gain=brightness[:, None].astype(np.float32),
            light_names=("all",),
        )
        sequences.append({"id": name, "scene": scene, "variant": 1, "light": light})
    return list_streams(folder, *sequences)


@pytest.fixture(scope="module")
def evaluated(dataset, tmp_path_factory):
    """The folder of two evaluations of the dataset: of two methods, and of one that was run later."""
    folder = tmp_path_factory.mktemp("evaluated")
    methods = {"first": ["sd+argmax", "er_count+argmax"], "later": ["sd_code+egs_code"]}
    for name, some in methods.items():
        options = [word for method in some for word in ("--method", method)]
        with pytest.raises(SystemExit) as ended:
            main(["evaluate", str(dataset), "--out", str(folder / name), *options])
        assert ended.value.code == 0
    return folder


@pytest.fixture
def runs(evaluated, tmp_path):
    return tuple(shutil.copytree(evaluated / name, tmp_path / name) for name in ("first", "later"))


def test_records_state_light_motion_and_method(runs):
    by_light = {r.what.light: r for r in read_records(runs[0])}
    for record in by_light.values():
        described = (record.what.track, record.what.scene_motion, record.what.lens_motion)
        assert described == ("recorded", "static", "sweep")
        assert record.judgement.time_to_focus_s == record.judgement.frames_seen / 20_000
        assert record.judgement.reversals is None
        assert "cores" in record.who.machine
    assert by_light["constant"].what.light_ratio == 1
    assert by_light["constant"].what.mean_rate == pytest.approx(0.25, rel=0.02)
    assert by_light["ramp"].what.light_ratio == pytest.approx(4)
    assert by_light["ramp"].what.mean_rate == pytest.approx(0.25 * 1.25, rel=0.02)
    (parameters,) = {r.who.parameters for r in read_records(runs[1])}
    assert "sd_code" not in parameters  # measure and search are stated with every option
    assert parameters.endswith(")")
    assert " + " in parameters


def test_a_method_that_ran_later_joins_the_table(call, runs, tmp_path):
    out = tmp_path / "both"
    code, printed, err = call("leaderboard", "merge", *runs, "--out", out)
    assert (code, err) == (0, "")
    assert "3 methods, 2 sequences, 2 evaluations" in printed
    assert "Undecided: 2 scenes (intervals need 3) cannot tell these 3 methods apart." in " ".join(printed.split())
    assert printed.splitlines()[-1] == f"All columns, conditions and names: open {out / 'index.html'}"
    document = json.loads((out / "leaderboard.json").read_text())
    methods = {"sd+argmax", "er_count+argmax", "sd_code+egs_code"}
    assert {row["method"] for row in document["rows"]} == methods
    places = next(a for a in document["axes"] if a["axis"] == "focus_position")
    assert [b["bin"] for b in places["bins"]] == ["first 10 %", "middle"]
    assert sorted(map(str, read_records(out))) == sorted(str(record) for run in runs for record in read_records(run))
    before = sorted(tmp_path.rglob("*"))
    code, printed, _ = call("leaderboard", "merge", out, runs[0] / "records.jsonl")  # merged again, and only printed
    assert code == 0
    assert "3 methods, 2 sequences" in printed
    assert sorted(tmp_path.rglob("*")) == before


def refused(call, *arguments):
    code, printed, err = call("leaderboard", "merge", *arguments)
    assert (code, printed, err.count("\n")) == (2, "", 1), err
    return err


def test_data_that_is_not_the_same_is_refused_in_one_line_that_names_both(call, runs, tmp_path):
    other = tmp_path / "board-constant-00.h5"
    write_sweep(other, 500.0)
    assert call("evaluate", other, "--out", tmp_path / "other", "--method", "sd+argmax")[0] == 0
    line = refused(call, runs[0], tmp_path / "other", "--out", tmp_path / "both")
    assert "the data digest of board-constant-00 differs: " in line
    assert str(runs[0]) in line
    assert str(tmp_path / "other") in line
    assert not (tmp_path / "both").exists()


def test_an_evaluation_is_never_written_over(call, runs):
    before = (runs[0] / "records.jsonl").read_bytes()
    assert "is one of the evaluations" in refused(call, *runs, "--out", runs[0])
    assert "is one of the evaluations" in refused(call, runs[0] / "records.jsonl", "--out", runs[0])
    assert (runs[0] / "records.jsonl").read_bytes() == before


def test_what_holds_no_records_is_one_line(call, runs, tmp_path):
    assert "there is no records.jsonl" in refused(call, runs[0], tmp_path / "nothing")
    intact = (runs[0] / "records.jsonl").read_text()
    (runs[0] / "records.jsonl").write_text(intact[:-20])
    assert "records.jsonl:4: this is not JSON" in refused(call, *runs)


def test_merging_replaces_what_was_merged_before(call, evaluated, runs, tmp_path):
    out = tmp_path / "both"
    assert "replaced" not in call("leaderboard", "merge", *runs, "--out", out)[1]
    code, printed, _ = call("leaderboard", "merge", runs[0], "--out", out)
    assert code == 0
    assert printed.splitlines()[-2] == "replaced the earlier evaluation of 3 methods"
    assert len({r.who.method for r in read_records(out)}) == 2


@pytest.mark.parametrize("name", ["focus/position", "truth/track"])
def test_a_stream_made_elsewhere_with_gaps_is_evaluated_with_what_is_known(call, tmp_path, name):
    path = tmp_path / "gaps.h5"
    track = np.full(SHAPE[0], 300 / 799, np.float32)
    lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
    write_stream(path, make_spikes(300.0), focus_position=lens, truth=make_truth(300.0, track=track))
    with h5py.File(path, "r+") as file:
        file[name][600:603] = np.nan
        spikes = file.attrs.pop("spikes_sha256")
        small = list(read_small_datasets(file, str(path)))
        file.attrs["content_sha256"], _ = stream_digests(
            small, file["spikes"].shape, spikes=spikes, readout_hz=20_000.0, frames=SHAPE[0]
        )
    code, _, err = call("evaluate", path, "--method", "sd+argmax")
    assert (code, err) == (0, "")
    document = json.loads((tmp_path / "gaps-evaluation/leaderboard.json").read_text())
    (row,) = document["rows"]
    assert (row["rank"], row["answerable_1dof"], row["median_error_dof"]) == (None, None, None)
    assert (row["lens_travel"] is None) == (name == "focus/position")
    (held,) = read_records(tmp_path / "gaps-evaluation")
    assert (held.judgement.error, held.success()) == (None, None)


def interrupted(*_, **__):
    raise KeyboardInterrupt


AGAIN = "finished work is kept: run the same command again to continue"


def test_an_interrupted_evaluation_reports_how_to_go_on(call, dataset, tmp_path, monkeypatch):
    monkeypatch.setattr("saf_gen.benchmark.evaluate.evaluate", interrupted)
    code, printed, err = call("evaluate", dataset, "--out", tmp_path / "out")
    assert (code, printed) == (130, "split test: 2 sequences of 2 scenes\n")
    assert err == f"saf-gen: stopped; {AGAIN}\n"
    assert not (tmp_path / "out").exists()


def test_interrupted_tuning_reports_how_to_go_on(call, dataset, tmp_path, monkeypatch):
    monkeypatch.setattr("saf_gen.leaderboard.tuning.tune", interrupted)
    file = tmp_path / "cen.json"
    command = ("tune", dataset, "--method", "cen+argmax", "--try", "measure.highest=0.1,0.2", "--out", file)
    assert call(*command) == (130, "", f"saf-gen: stopped; {AGAIN}\n")
    assert not file.exists()


def test_an_interrupted_command_that_writes_nothing_reports_only_that(call, tmp_path, monkeypatch):
    monkeypatch.setattr("saf_gen.stream.dataset.verify_dataset", interrupted)
    assert call("verify", tmp_path) == (130, "", "saf-gen: stopped\n")
